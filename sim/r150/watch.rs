//! Events of an R150's hardware that its firmware does not know of: fuses that blow, motors
//! that are too hot.

use rigsim_physics::r150::{FuseId, R150Health, Side};
use rigsim_settings::SimTime;

use crate::event::{Code, EventKind};
use crate::newest::Newest;
use crate::r150_device::event::{FUSE_BLOWN, MOTOR_COOLED, MOTOR_HOT};

/// Most events kept until they are taken.
const MOST: usize = 64;

/// Reports what has changed in the hardware since the last look.
#[derive(Debug)]
pub(super) struct Watch {
    last: R150Health,
    events: Newest<(SimTime, EventKind)>,
}

impl Default for Watch {
    fn default() -> Self {
        Self {
            last: R150Health::default(),
            events: Newest::new(MOST),
        }
    }
}

impl Watch {
    pub(super) fn look(&mut self, now: SimTime, state: R150Health) {
        if state == self.last {
            return;
        }
        let last = std::mem::replace(&mut self.last, state);
        for (index, fuse) in FuseId::ALL.into_iter().enumerate() {
            if state.fuse_blown[index] && !last.fuse_blown[index] {
                let of = match fuse {
                    FuseId::MotorRight => "the right motor",
                    FuseId::MotorLeft => "the left motor",
                    FuseId::Tail => "the tail supply, which feeds the module,",
                    FuseId::SmallModules => "the small modules",
                };
                self.emit(now, FUSE_BLOWN, format!("the fuse of {of} blew"));
            }
        }
        for side in Side::ALL {
            let heat = |health: &R150Health| (health.derated[side], health.shut_off[side]);
            let (derated, shut_off) = heat(&state);
            if heat(&state) == heat(&last) {
                continue;
            }
            let (code, text) = match (derated, shut_off) {
                (_, true) => (MOTOR_HOT, "motor or its driver is too hot and shut off"),
                (true, false) => (
                    MOTOR_HOT,
                    "motor or its driver is hot and gets less current",
                ),
                (false, false) => (MOTOR_COOLED, "motor has cooled"),
            };
            self.emit(now, code, format!("the {side} {text}"));
        }
    }

    pub(super) fn has_output(&self) -> bool {
        !self.events.is_empty()
    }

    pub(super) fn poll(&mut self) -> Option<(SimTime, EventKind)> {
        self.events.pop()
    }

    fn emit(&mut self, now: SimTime, code: Code, text: String) {
        self.events.push((now, EventKind::new(code, text)));
    }
}
