//! Time by which commands may come closer together than they were sent, because the machine that
//! runs the simulator was late.

use std::time::Duration;

use sim_settings::SimTime;

/// Most that are kept; beyond that the shortest are forgotten.
const MOST: usize = 16;

/// The allowances that are in force or will be.
#[derive(Debug, Clone, Default)]
pub(super) struct Bursts {
    /// Each later one lasts longer and is for less than the one before: no other is of use.
    kept: Vec<Burst>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Burst {
    by: Duration,
    until: SimTime,
}

impl Bursts {
    /// Up to and including `until`, commands may come up to `by` closer together than they were
    /// sent.
    pub(super) fn expect(&mut self, by: Duration, until: SimTime) {
        if self.kept.iter().any(|b| b.by >= by && b.until >= until) {
            return;
        }
        self.kept.retain(|b| b.by > by || b.until > until);
        let place = self.kept.partition_point(|b| b.by > by);
        self.kept.insert(place, Burst { by, until });
        self.kept.truncate(MOST);
    }

    /// By how much they may come closer together at `now`.
    pub(super) fn allowance(&self, now: SimTime) -> Duration {
        let in_force = self.kept.iter().find(|b| b.until >= now);
        in_force.map_or(Duration::ZERO, |b| b.by)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn it_allows_what_a_search_among_all_finds(
            expected in prop::collection::vec((0_u64..12, 0_u64..12), 0..40),
            now in 0_u64..14,
        ) {
            let mut bursts = Bursts::default();
            for (by, until) in &expected {
                bursts.expect(Duration::from_nanos(*by), SimTime::from_nanos(*until));
            }
            let in_force = expected.iter().filter(|(_, until)| *until >= now);
            let most = in_force.map(|(by, _)| *by).max().unwrap_or(0);
            prop_assert_eq!(bursts.allowance(SimTime::from_nanos(now)), Duration::from_nanos(most));
        }
    }

    #[test]
    fn many_are_bounded_and_the_longest_is_not_forgotten() {
        let mut bursts = Bursts::default();
        for n in 0..1000 {
            bursts.expect(Duration::from_nanos(1000 - n), SimTime::from_nanos(n));
        }
        assert_eq!(bursts.kept.len(), MOST);
        assert_eq!(bursts.allowance(SimTime::ZERO), Duration::from_nanos(1000));
    }
}
