//! Whether the machine keeps up.

use std::time::{Duration, Instant};

/// So many used-up budgets within a second mean that the machine is too slow for good.
const TOO_MANY_BUDGETS: u32 = 10;

/// Notices when a machine is too slow for what is asked of it.
#[derive(Default)]
pub(crate) struct Slowness {
    /// Since when budgets are counted, and how many were used up.
    count: Option<(Instant, u32)>,
    told: bool,
}

impl Slowness {
    /// A budget was used up; says whether this is to be told.
    pub(crate) fn note(&mut self) -> bool {
        let now = Instant::now();
        let (since, count) = self.count.unwrap_or((now, 0));
        let is_old = now - since > Duration::from_secs(1);
        let (since, count) = if is_old { (now, 1) } else { (since, count + 1) };
        self.count = Some((since, count));
        count >= TOO_MANY_BUDGETS && !std::mem::replace(&mut self.told, true)
    }

    /// Whether it has been told.
    pub(crate) fn is_told(&self) -> bool {
        self.told
    }
}
