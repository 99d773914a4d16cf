//! Counting what faults do.

/// Number of times that a fault has acted, and the first thing it acted on.
#[derive(Debug, Default)]
pub(super) struct Tally {
    pub(super) hits: u64,
    /// Until it has been told.
    pub(super) first: Option<String>,
}

impl Tally {
    /// Counts; only the first is put into words.
    pub(super) fn hit(&mut self, what: impl FnOnce() -> String) {
        if self.hits == 0 {
            self.first = Some(what());
        }
        self.hits = self.hits.saturating_add(1);
    }

    pub(super) fn hit_times(&mut self, times: u64, what: impl FnOnce() -> String) {
        if times > 0 {
            self.hit(what);
            self.hits = self.hits.saturating_add(times - 1);
        }
    }

    pub(super) fn is_below(&self, most: Option<u64>) -> bool {
        most.is_none_or(|most| self.hits < most)
    }
}
