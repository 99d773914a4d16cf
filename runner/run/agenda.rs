//! Plan of what happens when.

use std::collections::BTreeMap;

use rigsim_core::SimTime;
use rigsim_core::device::EffectHandle;

/// Something planned.
pub(super) enum Item {
    /// A step happens, for the first time or again.
    Occur(usize),
    /// End of what a step did, or of its repetitions.
    End(usize, Option<EffectHandle>),
    /// A step is ended before its time.
    Clear(usize),
    /// Conditions are looked at.
    Judge,
}

/// By time, then in the order of the file, then ends before beginnings, then as it was planned.
#[derive(Default)]
pub(super) struct Agenda {
    items: BTreeMap<(SimTime, usize, bool, u64), Item>,
    planned: u64,
}

impl Agenda {
    pub(super) fn plan(&mut self, at: SimTime, item: Item) {
        let place = match &item {
            Item::Occur(step) | Item::End(step, _) | Item::Clear(step) => *step,
            Item::Judge => usize::MAX,
        };
        let is_end = matches!(item, Item::End(..));
        self.planned += 1;
        self.items.insert((at, place, !is_end, self.planned), item);
    }

    /// Removes all that is planned of a step; returns the effects that it was still to end.
    pub(super) fn take_all_of(&mut self, step: usize) -> Vec<Option<EffectHandle>> {
        let of_step =
            |place: usize| move |(_, other, ..): &(SimTime, usize, bool, u64)| *other == place;
        let keys: Vec<_> = self.items.keys().copied().filter(of_step(step)).collect();
        let items = keys.iter().filter_map(|key| self.items.remove(key));
        let ends = items.filter_map(|item| match item {
            Item::End(_, effect) => Some(effect),
            Item::Occur(_) | Item::Clear(_) | Item::Judge => None,
        });
        ends.collect()
    }

    pub(super) fn next(&self) -> Option<SimTime> {
        self.items.keys().next().map(|(at, ..)| *at)
    }

    pub(super) fn is_due(&self, now: SimTime) -> bool {
        self.next().is_some_and(|at| at <= now)
    }

    pub(super) fn take_due(&mut self, now: SimTime) -> Option<Item> {
        if self.is_due(now) {
            self.items.pop_first().map(|(_, item)| item)
        } else {
            None
        }
    }
}
