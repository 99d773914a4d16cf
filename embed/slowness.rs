//! Hold-ups of the machine.

use std::time::{Duration, Instant};

/// So many used-up budgets within a second mean that the machine is too slow.
const TOO_MANY_BUDGETS: u32 = 10;
/// For how long used-up budgets are counted together.
const COUNTED: Duration = Duration::from_secs(1);

/// Real time for which simulated time stood still since the machine did not let the simulator run,
/// or was too slow for it. A client's own clock went on meanwhile.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct HeldUp {
    /// Number of times.
    pub times: u64,
    /// For how long in all.
    pub total: Duration,
    /// For how long at the longest.
    pub longest: Duration,
}

impl HeldUp {
    pub(crate) fn note(&mut self, by: Duration) {
        self.times += 1;
        self.total = self.total.saturating_add(by);
        self.longest = self.longest.max(by);
    }
}

/// Notices when a machine is too slow for what is asked of it.
#[derive(Default)]
pub(crate) struct Slowness {
    /// Since when budgets are counted, and how many were used up.
    count: Option<(Instant, u32)>,
    /// Time at which there were last too many.
    slow_at: Option<Instant>,
}

impl Slowness {
    /// A budget was used up; says whether this is the first time that there are too many.
    pub(crate) fn note(&mut self) -> bool {
        let now = Instant::now();
        let (since, count) = self.count.unwrap_or((now, 0));
        let is_old = now - since > COUNTED;
        let (since, count) = if is_old { (now, 1) } else { (since, count + 1) };
        self.count = Some((since, count));
        count >= TOO_MANY_BUDGETS && self.slow_at.replace(now).is_none()
    }

    /// Tells whether it is too slow now.
    pub(crate) fn is_slow(&self) -> bool {
        self.slow_at.is_some_and(|at| at.elapsed() <= 2 * COUNTED)
    }
}
