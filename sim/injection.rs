//! Effects at work on one device.

mod delay_line;
mod traffic;

use std::collections::BTreeMap;

use rigsim_physics::World;
use rigsim_physics::faults::BodyFaults;
use rigsim_settings::SimTime;

use crate::defects::Defects;
use crate::device::{Device, EffectHandle, EffectInfo, Sum, Tally, Way, Work};
use delay_line::DelayLine;

/// An effect at work.
struct Armed {
    handle: EffectHandle,
    name: String,
    info: &'static EffectInfo,
    /// Index of the link that it is about.
    link: usize,
    tally: Tally,
    work: Work,
}

/// All effects at work on one device, and what they hold back.
pub(crate) struct Injection {
    armed: Vec<Armed>,
    /// By link and way.
    delayed: Vec<[DelayLine; 2]>,
    /// By time and order, with the link.
    late: BTreeMap<(SimTime, u64), (usize, Vec<u8>)>,
    /// Number of frames that have been put off so far.
    order: u64,
    ticked: SimTime,
    defects: Defects,
    body: BodyFaults,
}

impl Injection {
    pub(crate) fn new(links: usize, now: SimTime) -> Self {
        Self {
            armed: Vec::new(),
            delayed: (0..links).map(|_| Default::default()).collect(),
            late: BTreeMap::new(),
            order: 0,
            ticked: now,
            defects: Defects::default(),
            body: BodyFaults::default(),
        }
    }

    pub(crate) fn count(&self) -> usize {
        self.armed.len()
    }

    pub(crate) fn arms(&self, handle: EffectHandle) -> bool {
        self.armed.iter().any(|armed| armed.handle == handle)
    }

    /// Returns whether nothing is at work nor held back any more.
    pub(crate) fn is_spent(&self) -> bool {
        self.armed.is_empty()
            && self.late.is_empty()
            && self.delayed.iter().flatten().all(DelayLine::is_empty)
    }

    /// Puts an effect to work on a link; `attached` says whether a client has its port open.
    pub(crate) fn arm(
        &mut self,
        now: SimTime,
        (handle, name): (EffectHandle, &str),
        info: &'static EffectInfo,
        (link, attached): (usize, bool),
        (work, tally): (Work, Tally),
    ) {
        let pulls_cable = matches!(&work, Work::Bytes(bytes) if bytes.pulls_cable());
        self.armed.push(Armed {
            handle,
            name: name.to_owned(),
            info,
            link,
            tally,
            work,
        });
        if pulls_cable {
            self.pull_cable(now, link, attached);
        }
    }

    /// Ends an effect; returns its name and its kind.
    pub(crate) fn disarm(
        &mut self,
        now: SimTime,
        handle: EffectHandle,
    ) -> Option<(String, &'static EffectInfo)> {
        let at = self.armed.iter().position(|armed| armed.handle == handle)?;
        let ended = self.armed.remove(at);
        if let Work::Bytes(_) = ended.work {
            self.release(now, ended.link);
        }
        Some((ended.name, ended.info))
    }

    /// Puts hardware and firmware into the state that all effects together make.
    pub(crate) fn apply(&mut self, now: SimTime, device: &mut dyn Device, world: &mut World) {
        let sum = self.sum(device);
        device.set_faults(now, &sum);
        let Sum { defects, body, .. } = sum;
        if body != std::mem::replace(&mut self.body, body) {
            device.plant_mut().set_body_faults(world, &body);
        }
        if defects != std::mem::replace(&mut self.defects, defects) {
            device.set_defects(now, defects);
        }
    }

    fn sum(&self, device: &dyn Device) -> Sum {
        let mut sum = device.no_faults();
        for armed in &self.armed {
            if let Work::Hardware(hardware) = &armed.work {
                hardware.add(&mut sum);
            }
        }
        sum
    }

    /// Time has passed for the hardware up to `now`: interference goes on.
    pub(crate) fn tick(&mut self, now: SimTime, device: &mut dyn Device) {
        let seconds = now.since(self.ticked).as_secs_f64();
        self.ticked = now;
        let mut changed = false;
        for armed in &mut self.armed {
            if let Work::Hardware(hardware) = &mut armed.work {
                changed |= hardware.interfere(device, seconds, &mut armed.tally);
            }
        }
        if changed {
            device.set_faults(now, &self.sum(device));
        }
    }

    /// Counts what effects on firmware and hardware hit.
    pub(crate) fn watch(&mut self, device: &dyn Device) {
        for armed in &mut self.armed {
            if let Work::Hardware(hardware) = &mut armed.work {
                hardware.watch(device, &mut armed.tally);
            }
        }
    }

    /// Hands on what has been counted: handle, name, kind, hits, and at the first hit what it was.
    pub(crate) fn report(
        &mut self,
        mut reported: impl FnMut(EffectHandle, &str, &'static EffectInfo, u64, Option<String>),
    ) {
        for armed in &mut self.armed {
            let first = armed.tally.first.take();
            let hits = armed.tally.hits;
            reported(armed.handle, &armed.name, armed.info, hits, first);
        }
    }
}
