//! The client's clock against a search among all that it was given.

use proptest::prelude::*;

use super::*;

const BAUD: u32 = 115_200;

fn drain() -> Duration {
    Duration::from_secs(PORT_BYTES * 10) / BAUD
}

proptest! {
    #[test]
    fn it_finds_what_a_search_among_all_finds(
        reported in prop::collection::vec((0_u64..300, 0_u64..40, any::<bool>()), 0..60),
    ) {
        let mut clock = ClientClock::default();
        let (mut now, mut ahead) = (SimTime::ZERO, 0);
        let mut all: Vec<(SimTime, i128)> = Vec::new();
        for (wait, by, stands) in reported {
            now += Duration::from_millis(wait);
            let by = Duration::from_millis(by);
            clock.late(now, by, if stands { by } else { Duration::ZERO }, BAUD);
            ahead += if stands { nanos(by) } else { 0 };
            all.push((now + drain(), ahead - nanos(by)));
            let in_force = all.iter().filter(|(until, _)| *until >= now).map(|(_, of)| *of);
            let at = i128::from(now.as_nanos());
            let least = in_force.min().unwrap_or(ahead);
            prop_assert_eq!(clock.sent(now), Sent { earliest: at + least, latest: at + ahead });
        }
    }
}

#[test]
fn what_has_waited_is_old_until_a_line_has_carried_it_and_not_one_quantum_longer() {
    let mut clock = ClientClock::default();
    let by = Duration::from_millis(300);
    clock.late(SimTime::from_secs(1), by, by, BAUD);
    let last = SimTime::from_secs(1) + drain();
    let age = |sent: Sent| sent.latest - sent.earliest;
    assert_eq!(age(clock.sent(last)), nanos(by));
    assert_eq!(age(clock.sent(last + Duration::from_nanos(1))), 0);
}

#[test]
fn stalls_beyond_number_and_measure_are_bounded() {
    let mut clock = ClientClock::default();
    for n in 0..10_000 {
        let now = SimTime::from_nanos(n);
        clock.late(now, Duration::from_nanos(1), Duration::from_nanos(1), BAUD);
    }
    assert_eq!(clock.waiting.len(), MOST);
    let now = SimTime::from_nanos(10_000);
    assert_eq!(clock.sent(now).earliest, 10_000);
    clock.late(now, Duration::MAX, Duration::MAX, 0);
    assert_eq!(clock.waiting.len(), MOST);
    assert_eq!(
        clock.sent(now + Duration::from_secs(1_000_000)).earliest,
        clock.ahead + 1_000_000_000_010_000
    );
}
