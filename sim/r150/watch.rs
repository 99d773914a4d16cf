//! Events of an R150's hardware that its firmware does not know of: fuses that blow, motors
//! that are too hot, wheels that would lift.

use std::collections::VecDeque;
use std::fmt;
use std::sync::Arc;

use rigsim_physics::r150::{FuseId, R150Health, Side};
use rigsim_settings::SimTime;

use super::event::{FUSE_BLOWN, MOTOR_COOLED, MOTOR_HOT};
use crate::event::{Code, EventKind, PlainEvent};

/// Something that happened to the hardware.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum HardwareEvent {
    /// A fuse blew.
    FuseBlown(FuseId),
    /// A motor driver allows less current because of heat, or has shut off.
    MotorHot(Side, bool),
    /// It allows as much as ever.
    MotorCooled(Side),
}

impl EventKind for HardwareEvent {
    fn code(&self) -> Code {
        match self {
            Self::FuseBlown(_) => FUSE_BLOWN,
            Self::MotorHot(..) => MOTOR_HOT,
            Self::MotorCooled(_) => MOTOR_COOLED,
        }
    }
}

impl fmt::Display for HardwareEvent {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::FuseBlown(fuse) => write!(
                f,
                "the fuse of {} blew",
                match fuse {
                    FuseId::MotorRight => "the right motor",
                    FuseId::MotorLeft => "the left motor",
                    FuseId::Tail => "the tail supply, which feeds the module,",
                    FuseId::SmallModules => "the small modules",
                }
            ),
            Self::MotorHot(motor, shut_off) => {
                let outcome = if *shut_off {
                    "too hot and shut off"
                } else {
                    "hot and gets less current"
                };
                write!(f, "the {motor} motor or its driver is {outcome}")
            }
            Self::MotorCooled(motor) => write!(f, "the {motor} motor has cooled"),
        }
    }
}

/// Most events kept until they are taken.
const MOST: usize = 64;

/// Reports what has changed in the hardware since the last look.
#[derive(Debug, Default)]
pub(super) struct Watch {
    last: R150Health,
    events: VecDeque<(SimTime, Arc<dyn EventKind>)>,
}

impl Watch {
    pub(super) fn look(&mut self, now: SimTime, state: R150Health) {
        if state == self.last {
            return;
        }
        let last = std::mem::replace(&mut self.last, state);
        for (index, fuse) in FuseId::ALL.into_iter().enumerate() {
            if state.fuse_blown[index] && !last.fuse_blown[index] {
                self.tell(now, HardwareEvent::FuseBlown(fuse));
            }
        }
        for side in Side::ALL {
            let heat = |health: &R150Health| (health.derated[side], health.shut_off[side]);
            let (derated, shut_off) = heat(&state);
            if heat(&state) == heat(&last) {
                continue;
            }
            let event = if derated || shut_off {
                HardwareEvent::MotorHot(side, shut_off)
            } else {
                HardwareEvent::MotorCooled(side)
            };
            self.tell(now, event);
        }
        if state.tipping && !last.tipping {
            self.tell(now, PlainEvent::tipping());
        }
    }

    pub(super) fn has_output(&self) -> bool {
        !self.events.is_empty()
    }

    pub(super) fn poll(&mut self) -> Option<(SimTime, Arc<dyn EventKind>)> {
        self.events.pop_front()
    }

    fn tell(&mut self, now: SimTime, event: impl EventKind) {
        if self.events.len() >= MOST {
            self.events.pop_front();
        }
        self.events.push_back((now, Arc::new(event)));
    }
}
