//! Faults at work: those that are armed on one device.

mod firmware;
mod protocol;
mod stage;
mod tally;
mod traffic;
mod wire;

use std::collections::BTreeMap;

use sim_physics::World;
use sim_settings::SimTime;

use crate::defects::Defects;
use crate::device::Device;
use crate::fault::{Fault, FaultHandle, FaultLevel};
use crate::noise::Noise;
use protocol::FrameFault;
use stage::Stage;
use tally::Tally;
use wire::WireFault;

/// An armed fault.
struct Armed {
    handle: FaultHandle,
    name: String,
    fault: Fault,
    /// Index of the link that it is about.
    link: usize,
    tally: Tally,
    work: Work,
}

/// What a fault keeps while it is armed.
enum Work {
    Wire(WireFault),
    Frames(FrameFault),
    /// Number of times that the defect had shown when last looked at.
    Firmware(u64),
    /// Effect when last looked at; the device keeps the rest.
    Device(bool),
}

/// All faults of one device, and what they hold back.
pub(crate) struct Injection {
    armed: Vec<Armed>,
    /// By link and way.
    stages: Vec<[Stage; 2]>,
    /// By time and order, with the link.
    late: BTreeMap<(SimTime, u64), (usize, Vec<u8>)>,
    /// Number of frames that have been put off so far.
    order: u64,
    ticked: SimTime,
    defects: Defects,
}

impl Injection {
    pub(crate) fn new(links: usize, now: SimTime) -> Self {
        Self {
            armed: Vec::new(),
            stages: (0..links).map(|_| Default::default()).collect(),
            late: BTreeMap::new(),
            order: 0,
            ticked: now,
            defects: Defects::default(),
        }
    }

    pub(crate) fn count(&self) -> usize {
        self.armed.len()
    }

    pub(crate) fn arms(&self, handle: FaultHandle) -> bool {
        self.armed.iter().any(|armed| armed.handle == handle)
    }

    /// Tells whether nothing is armed nor held back any more.
    pub(crate) fn is_spent(&self) -> bool {
        self.armed.is_empty()
            && self.late.is_empty()
            && self.stages.iter().flatten().all(Stage::is_empty)
    }

    /// Arms a fault on a link; `stream` gives it random numbers of its own for each purpose.
    pub(crate) fn arm(
        &mut self,
        now: SimTime,
        (handle, name): (FaultHandle, &str),
        (fault, link): (&Fault, usize),
        device: &mut dyn Device,
        stream: impl Fn(&str) -> Noise,
    ) {
        let mut tally = Tally::default();
        let (work, acted) = match fault.level() {
            FaultLevel::Wire => {
                let wire = WireFault::new(fault, link, now, stream);
                (Work::Wire(wire), false)
            }
            FaultLevel::Protocol => {
                let framing = device.framing(link);
                let own = FrameFault::new(fault, now, framing, stream("frames"));
                (Work::Frames(own), false)
            }
            FaultLevel::Firmware => {
                let acted = matches!(fault, Fault::Reset { boot } if device.reset(now, boot.0));
                let shown = firmware::count(&device.defect_counts(), fault);
                (Work::Firmware(shown.map_or(0, |(count, _)| count)), acted)
            }
            FaultLevel::Electrical
            | FaultLevel::Mechanical
            | FaultLevel::Operator
            | FaultLevel::Sensor => {
                let acted = device.arm(now, handle, fault, stream("device"));
                (Work::Device(false), acted)
            }
        };
        if acted {
            tally.hit(|| fault.info().counts.trim_end_matches('.').to_owned());
        }
        self.armed.push(Armed {
            handle,
            name: name.to_owned(),
            fault: fault.clone(),
            link,
            tally,
            work,
        });
    }

    /// Ends a fault; gives its name and its id.
    pub(crate) fn disarm(
        &mut self,
        now: SimTime,
        handle: FaultHandle,
        device: &mut dyn Device,
    ) -> Option<(String, &'static str)> {
        let at = self.armed.iter().position(|armed| armed.handle == handle)?;
        let ended = self.armed.remove(at);
        match &ended.work {
            Work::Wire(wire) if wire.stalls() => self.release(now, ended.link),
            Work::Device(_) => device.disarm(now, handle),
            Work::Wire(_) | Work::Frames(_) | Work::Firmware(_) => {}
        }
        Some((ended.name, ended.fault.id()))
    }

    /// Puts hardware and firmware into the state that all armed faults together make.
    pub(crate) fn apply(&mut self, now: SimTime, device: &mut dyn Device, world: &mut World) {
        device.apply_faults(world);
        let mut defects = Defects::default();
        for armed in &self.armed {
            firmware::add(&mut defects, &armed.fault);
        }
        if defects != std::mem::replace(&mut self.defects, defects) {
            device.set_defects(now, defects);
        }
    }

    /// Time has passed for the hardware up to `now`: interference goes on.
    pub(crate) fn tick(&mut self, now: SimTime, device: &mut dyn Device) {
        let seconds = now.since(self.ticked).as_secs_f64();
        self.ticked = now;
        device.interfere(seconds, &mut |handle, what| {
            let mut armed = self.armed.iter_mut();
            if let Some(armed) = armed.find(|armed| armed.handle == handle) {
                armed.tally.hit(|| what);
            }
        });
    }

    /// Looks whether faults of firmware and hardware have an effect.
    pub(crate) fn watch(&mut self, device: &dyn Device) {
        for armed in &mut self.armed {
            match &mut armed.work {
                Work::Wire(_) | Work::Frames(_) => {}
                Work::Firmware(counted) => {
                    let shown = firmware::count(&device.defect_counts(), &armed.fault);
                    if let Some((count, what)) = shown {
                        let more = count.saturating_sub(*counted);
                        armed.tally.hit_times(more, || what.to_owned());
                        *counted = count;
                    }
                }
                Work::Device(acted) => {
                    let acts = device.acts(armed.handle, &armed.fault);
                    if acts && !*acted {
                        armed.tally.hit(|| device.acted_on(&armed.fault));
                    }
                    *acted = acts;
                }
            }
        }
    }

    /// Hands on what has been counted: handle, name, id, hits, and at the first hit what it was.
    pub(crate) fn report(
        &mut self,
        mut told: impl FnMut(FaultHandle, &str, &'static str, u64, Option<String>),
    ) {
        for armed in &mut self.armed {
            let first = armed.tally.first.take();
            let id = armed.fault.id();
            told(armed.handle, &armed.name, id, armed.tally.hits, first);
        }
    }
}
