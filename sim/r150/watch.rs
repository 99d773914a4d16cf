//! What happens to the hardware of an R150 and its firmware does not know: fuses that blow and
//! wheels that would lift.

use std::borrow::Cow;
use std::collections::VecDeque;
use std::fmt;

use sim_physics::r150::{FuseId, R150Health};
use sim_settings::SimTime;

use super::event::{FUSE_BLOWN, TIPPING};
use crate::event::{Code, EventKind, Level, Role};

/// Something that happened to the hardware.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum HardwareEvent {
    /// A fuse blew.
    FuseBlown(FuseId),
    /// A wheel would lift.
    Tipping,
}

impl EventKind for HardwareEvent {
    fn level(&self) -> Level {
        Level::Warning
    }

    fn code(&self) -> Code {
        match self {
            Self::FuseBlown(_) => FUSE_BLOWN,
            Self::Tipping => TIPPING,
        }
    }

    fn link(&self) -> Option<usize> {
        None
    }

    fn role(&self) -> Role {
        Role::Other
    }

    fn bytes(&self) -> Option<Cow<'_, [u8]>> {
        None
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
            Self::Tipping => write!(f, "a wheel would lift: the vehicle would tip over"),
        }
    }
}

/// Most events kept for whoever takes them.
const MOST: usize = 64;

/// Tells what has changed in the hardware since the last look.
#[derive(Debug, Default)]
pub(super) struct Watch {
    last: R150Health,
    events: VecDeque<(SimTime, HardwareEvent)>,
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
        if state.tipping && !last.tipping {
            self.tell(now, HardwareEvent::Tipping);
        }
    }

    pub(super) fn has_news(&self) -> bool {
        !self.events.is_empty()
    }

    pub(super) fn poll(&mut self) -> Option<(SimTime, HardwareEvent)> {
        self.events.pop_front()
    }

    fn tell(&mut self, now: SimTime, event: HardwareEvent) {
        if self.events.len() >= MOST {
            self.events.pop_front();
        }
        self.events.push_back((now, event));
    }
}
