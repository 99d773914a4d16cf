//! Whether the machine keeps up.

use std::time::{Duration, Instant};

/// So many used-up budgets within a second mean that the machine is too slow.
const TOO_MANY_BUDGETS: u32 = 10;
/// For how long used-up budgets are counted together.
const COUNTED: Duration = Duration::from_secs(1);

/// Notices when a machine is too slow for what is asked of it.
#[derive(Default)]
pub(crate) struct Slowness {
    /// Since when budgets are counted, and how many were used up.
    count: Option<(Instant, u32)>,
    /// When there were last too many.
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

    /// Whether it is too slow now.
    pub(crate) fn is_slow(&self) -> bool {
        self.slow_at.is_some_and(|at| at.elapsed() <= 2 * COUNTED)
    }
}
