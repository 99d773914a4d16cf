//! The faults that are armed on one device.

use std::collections::BTreeMap;

use sim_physics::World;
use sim_settings::SimTime;

use super::frame::Form;
use super::mecanum::Echoes;
use super::protocol::FrameFault;
use super::stage::Stage;
use super::wire::WireFault;
use super::{Fault, FaultHandle, FaultLevel, Tally, firmware, mecanum, operator, r150};
use crate::defects::DefectCounts;
use crate::device_kind::DeviceKind;
use crate::mecanum::Mecanum;
use crate::noise::Noise;
use crate::r150::R150;
use crate::r150_device::vehicle::Action;

/// The device that has the faults.
pub(crate) enum Target<'r> {
    R150(&'r mut R150),
    Mecanum(&'r mut Mecanum),
}

impl Target<'_> {
    pub(super) fn defect_counts(&self) -> &DefectCounts {
        match self {
            Self::R150(r150) => r150.device().defect_counts(),
            Self::Mecanum(car) => car.device().defect_counts(),
        }
    }
}

/// An armed fault.
pub(super) struct Armed {
    handle: FaultHandle,
    name: String,
    pub(super) fault: Fault,
    pub(super) tally: Tally,
    pub(super) work: Work,
}

/// What a fault keeps while it is armed.
pub(super) enum Work {
    Wire(WireFault),
    Frames(FrameFault),
    Device(Box<OnDevice>),
}

pub(super) struct OnDevice {
    pub(super) noise: Noise,
    /// Whether the hardware fault had an effect when last looked at.
    pub(super) acted: bool,
    /// How often the firmware's defect had shown when last looked at.
    pub(super) counted: u64,
    /// What undoes the operator's deed.
    undo: Vec<Action>,
    /// What the ultrasonic sensors gave at the start.
    pub(super) echoes: Echoes,
    /// What interference adds to the R150's encoders now, rpm.
    pub(super) errors: [f64; 2],
    /// Shares of the car's next pulses of interference.
    pub(super) pulses: [f64; 4],
}

/// All faults of one device, and what they hold back.
pub(crate) struct Faults {
    kind: DeviceKind,
    pub(super) armed: Vec<Armed>,
    /// By link and way.
    pub(super) stages: Vec<[Stage; 2]>,
    /// By time and order, with the link.
    pub(super) late: BTreeMap<(SimTime, u64), (usize, Vec<u8>)>,
    /// How many frames have been put off so far.
    pub(super) order: u64,
    pub(super) ticked: SimTime,
    pub(super) r150: r150::Layer,
    car: mecanum::Layer,
}

impl Faults {
    pub(crate) fn new(kind: DeviceKind, links: usize, now: SimTime) -> Self {
        Self {
            kind,
            armed: Vec::new(),
            stages: (0..links).map(|_| Default::default()).collect(),
            late: BTreeMap::new(),
            order: 0,
            ticked: now,
            r150: r150::Layer::default(),
            car: mecanum::Layer::default(),
        }
    }

    pub(crate) fn count(&self) -> usize {
        self.armed.len()
    }

    pub(crate) fn arms(&self, handle: FaultHandle) -> bool {
        self.armed.iter().any(|armed| armed.handle == handle)
    }

    /// Whether nothing is armed nor held back any more.
    pub(crate) fn is_spent(&self) -> bool {
        self.armed.is_empty()
            && self.late.is_empty()
            && self.stages.iter().flatten().all(Stage::is_empty)
    }

    /// Arms a fault; `stream` gives it random numbers of its own for each purpose.
    pub(crate) fn arm(
        &mut self,
        now: SimTime,
        (handle, name): (FaultHandle, &str),
        fault: &Fault,
        target: &mut Target<'_>,
        stream: impl Fn(&str) -> Noise,
    ) {
        let mut tally = Tally::default();
        let kind = self.kind;
        let work = match fault.level() {
            FaultLevel::Wire => WireFault::new(fault, now, stream).map(Work::Wire),
            FaultLevel::Protocol => {
                let form = |link| Form::of(kind, link);
                FrameFault::new(fault, now, form, stream("frames")).map(Work::Frames)
            }
            _ => Some(self.begin(now, fault, target, stream("device"), &mut tally)),
        };
        let Some(work) = work else {
            return;
        };
        self.armed.push(Armed {
            handle,
            name: name.to_owned(),
            fault: fault.clone(),
            tally,
            work,
        });
    }

    fn begin(
        &self,
        now: SimTime,
        fault: &Fault,
        target: &mut Target<'_>,
        noise: Noise,
        tally: &mut Tally,
    ) -> Work {
        let counted = firmware::count(target.defect_counts(), fault).map_or(0, |(count, _)| count);
        let mut own = OnDevice {
            noise,
            acted: false,
            counted,
            undo: Vec::new(),
            echoes: Echoes::default(),
            errors: [0.0; 2],
            pulses: [0.0; 4],
        };
        let done = match (fault, target) {
            (Fault::Reset { boot }, Target::R150(r150)) => r150.reset(now, boot.0),
            (Fault::Reset { boot }, Target::Mecanum(car)) => car.reset(now, boot.0),
            (fault, Target::R150(r150)) => {
                let (undo, done) = operator::begin(fault, r150, now);
                own.undo = undo;
                let held = self.held().chain(operator::held_by(fault));
                done || operator::hold(held, r150, now)
            }
            (_, Target::Mecanum(car)) => {
                own.echoes = car.plant().unspoilt().echoes;
                false
            }
        };
        if done {
            tally.hit(|| fault.info().counts.trim_end_matches('.').to_owned());
        }
        Work::Device(Box::new(own))
    }

    fn held(&self) -> impl Iterator<Item = operator::Held> {
        self.armed
            .iter()
            .filter_map(|armed| operator::held_by(&armed.fault))
    }

    /// Ends a fault; gives its name and its id.
    pub(crate) fn disarm(
        &mut self,
        now: SimTime,
        handle: FaultHandle,
        target: &mut Target<'_>,
    ) -> Option<(String, &'static str)> {
        let at = self.armed.iter().position(|armed| armed.handle == handle)?;
        let ended = self.armed.remove(at);
        match &ended.work {
            Work::Wire(wire) if wire.stalls() => self.release(now, wire.link),
            Work::Device(own) => self.undo(now, &ended.fault, &own.undo, target),
            _ => {}
        }
        Some((ended.name, ended.fault.id()))
    }

    fn undo(&mut self, now: SimTime, fault: &Fault, undo: &[Action], target: &mut Target<'_>) {
        let Target::R150(r150) = target else {
            return;
        };
        if operator::held_by(fault).is_some() {
            operator::hold(self.held(), r150, now);
            return;
        }
        // As long as somebody else does the same, it stays done, and is for him to undo.
        let heir = self
            .armed
            .iter_mut()
            .find(|armed| std::mem::discriminant(&armed.fault) == std::mem::discriminant(fault));
        match heir.map(|heir| &mut heir.work) {
            Some(Work::Device(heir)) => {
                if heir.undo.is_empty() {
                    heir.undo = undo.to_vec();
                }
            }
            _ => {
                for action in undo {
                    r150.operate(now, *action);
                }
            }
        }
    }

    /// Puts hardware and firmware into the state that all armed faults together make.
    pub(crate) fn apply(&mut self, now: SimTime, target: &mut Target<'_>, world: &mut World) {
        match target {
            Target::R150(r150) => {
                let errors = self.devices().fold([0.0; 2], |sum: [f64; 2], (_, own)| {
                    [sum[0] + own.errors[0], sum[1] + own.errors[1]]
                });
                let faults = self.armed.iter().map(|armed| &armed.fault);
                let layer = r150::Layer::of(faults, errors);
                layer.apply(&self.r150, r150, world, now);
                self.r150 = layer;
            }
            Target::Mecanum(car) => {
                let faults = self.devices().map(|(fault, own)| (fault, &own.echoes));
                let layer = mecanum::Layer::of(faults);
                layer.apply(&self.car, car, world, now);
                self.car = layer;
            }
        }
    }

    fn devices(&self) -> impl Iterator<Item = (&Fault, &OnDevice)> {
        self.armed.iter().filter_map(|armed| match &armed.work {
            Work::Device(own) => Some((&armed.fault, own.as_ref())),
            _ => None,
        })
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
