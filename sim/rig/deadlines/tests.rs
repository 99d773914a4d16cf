use proptest::prelude::*;

use super::*;

proptest! {
    #[test]
    fn it_finds_what_a_search_finds(
        devices in 0_usize..20,
        changes in prop::collection::vec((any::<prop::sample::Index>(), 0_u64..8), 0..60),
        at in 0_u64..8,
    ) {
        let mut deadlines = Deadlines::new();
        let mut times = Vec::new();
        for (device, (index, time)) in changes.into_iter().enumerate() {
            if device < devices {
                deadlines.push();
                times.push(SimTime::MAX);
            }
            if !times.is_empty() {
                let index = index.index(times.len());
                times[index] = SimTime::from_nanos(time);
                deadlines.set(index, times[index]);
            }
            let earliest = times.iter().min().copied().unwrap_or(SimTime::MAX);
            prop_assert_eq!(deadlines.earliest(), earliest);
        }
        let at = SimTime::from_nanos(at);
        for from in 0..times.len() + 2 {
            let due = (from..times.len()).find(|&device| times[device] <= at);
            prop_assert_eq!(deadlines.due(at, from), due);
            let own = times.get(from).copied().unwrap_or(SimTime::MAX);
            prop_assert_eq!(deadlines.of(from), own);
        }
    }
}
