//! Faults at work: those that are armed on one device.

mod firmware;
mod protocol;
mod stage;
mod tally;
mod traffic;
mod wire;

use std::collections::BTreeMap;

use sim_physics::World;
use sim_physics::faults::BodyFaults;
use sim_settings::SimTime;

use crate::defects::Defects;
use crate::device::{Change, Device, EffectHandle, Motion};
use crate::fault::{Fault, FaultKind, FirmwareFault};
use crate::noise::Noise;
use protocol::FramesAtWork;
use stage::Stage;
use tally::Tally;
use wire::WireAtWork;

/// An armed fault.
struct Armed {
    handle: EffectHandle,
    name: String,
    fault: Fault,
    /// Index of the link that it is about.
    link: usize,
    tally: Tally,
    work: Work,
}

/// What a fault keeps while it is armed.
enum Work {
    Wire(WireAtWork),
    Frames(FramesAtWork),
    /// Number of times that the defect had shown when last looked at.
    Firmware(FirmwareFault, u64),
    /// Effect when last looked at; the device keeps the rest.
    Device(bool),
    /// Done at once; the rig undoes it.
    Operator,
}

/// Slower than this a vehicle stands, m/s and rad/s.
const STANDING: f64 = 0.01;

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
    body: BodyFaults,
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
            body: BodyFaults::default(),
        }
    }

    pub(crate) fn count(&self) -> usize {
        self.armed.len()
    }

    pub(crate) fn arms(&self, handle: EffectHandle) -> bool {
        self.armed.iter().any(|armed| armed.handle == handle)
    }

    /// Tells whether nothing is armed nor held back any more.
    pub(crate) fn is_spent(&self) -> bool {
        self.armed.is_empty()
            && self.late.is_empty()
            && self.stages.iter().flatten().all(Stage::is_empty)
    }

    /// Arms a fault on a link; `stream` gives it random numbers of its own for each purpose. Gives
    /// what an operator has changed.
    pub(crate) fn arm(
        &mut self,
        now: SimTime,
        (handle, name): (EffectHandle, &str),
        (fault, link): (&Fault, usize),
        device: &mut dyn Device,
        stream: impl Fn(&str) -> Noise,
    ) -> Vec<Change> {
        let mut tally = Tally::default();
        let mut changes = Vec::new();
        let (work, acted) = match &fault.kind {
            FaultKind::Wire(kind) => {
                let wire = WireAtWork::new(kind, &fault.scope, link, now, stream);
                (Work::Wire(wire), false)
            }
            FaultKind::Protocol(kind) => {
                let framing = device.framing(link);
                let own = FramesAtWork::new(kind, &fault.scope, now, framing, stream("frames"));
                (Work::Frames(own), false)
            }
            FaultKind::Firmware(kind) => {
                let acted =
                    matches!(kind, FirmwareFault::Reset { boot } if device.reset(now, boot.0));
                let (count, _) = firmware::count(&device.defect_counts(), kind);
                (Work::Firmware(kind.clone(), count), acted)
            }
            FaultKind::Electrical(_) | FaultKind::Mechanical(_) | FaultKind::Sensor(_) => {
                device.arm(handle, fault, stream("device"));
                (Work::Device(false), false)
            }
            FaultKind::Operator(kind) => {
                changes = device.be_operated(now, kind);
                let acted = changes.iter().any(|change| change.restore.is_some());
                (Work::Operator, acted)
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
        changes
    }

    /// Ends a fault; gives its name and its id.
    pub(crate) fn disarm(
        &mut self,
        now: SimTime,
        handle: EffectHandle,
        device: &mut dyn Device,
    ) -> Option<(String, &'static str)> {
        let at = self.armed.iter().position(|armed| armed.handle == handle)?;
        let ended = self.armed.remove(at);
        match &ended.work {
            Work::Wire(wire) if wire.stalls() => self.release(now, ended.link),
            Work::Device(_) => device.disarm(handle),
            Work::Wire(_) | Work::Frames(_) | Work::Firmware(..) | Work::Operator => {}
        }
        Some((ended.name, ended.fault.id()))
    }

    /// Puts hardware and firmware into the state that all armed faults together make.
    pub(crate) fn apply(&mut self, now: SimTime, device: &mut dyn Device, world: &mut World) {
        device.apply_faults(now);
        let mut defects = Defects::default();
        let mut body = BodyFaults::default();
        for armed in &self.armed {
            match &armed.fault.kind {
                FaultKind::Firmware(fault) => firmware::add(&mut defects, fault),
                FaultKind::Mechanical(fault) => fault.add_to_body(&mut body),
                FaultKind::Wire(_)
                | FaultKind::Protocol(_)
                | FaultKind::Electrical(_)
                | FaultKind::Operator(_)
                | FaultKind::Sensor(_) => {}
            }
        }
        if body != std::mem::replace(&mut self.body, body) {
            device.plant_mut().set_body_faults(world, &body);
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
                Work::Wire(_) | Work::Frames(_) | Work::Operator => {}
                Work::Firmware(fault, counted) => {
                    let (count, what) = firmware::count(&device.defect_counts(), fault);
                    let more = count.saturating_sub(*counted);
                    armed.tally.hit_times(more, || what.to_owned());
                    *counted = count;
                }
                Work::Device(acted) => {
                    let acts = device.acts(armed.handle, &armed.fault)
                        || acts_on_body(&armed.fault.kind, &device.plant().motion());
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
        mut told: impl FnMut(EffectHandle, &str, &'static str, u64, Option<String>),
    ) {
        for armed in &mut self.armed {
            let first = armed.tally.first.take();
            let id = armed.fault.id();
            told(armed.handle, &armed.name, id, armed.tally.hits, first);
        }
    }
}

/// Tells whether a fault has an effect on a vehicle as a body.
fn acts_on_body(fault: &FaultKind, motion: &Motion) -> bool {
    let speeds = [motion.forward_speed, motion.leftward_speed, motion.yaw_rate];
    let moves = speeds.iter().any(|speed| speed.abs() > STANDING);
    matches!(fault, FaultKind::Mechanical(fault) if fault.acts_on_body(moves))
}
