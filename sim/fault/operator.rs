//! What people do to an R150, and how they undo it.

use sim_settings::SimTime;

use super::Fault;
use crate::r150::R150;
use crate::r150_device::control::Parts;
use crate::r150_device::vehicle::{Action, Key};

/// Nobody drives with this key: it is let go at the same instant.
const TOUCH: [Action; 2] = [Action::Press(Key::Forward), Action::ReleaseKey];

/// Does it; gives what undoes it, and whether it changed anything.
pub(super) fn begin(fault: &Fault, r150: &mut R150, now: SimTime) -> (Vec<Action>, bool) {
    let vehicle = r150.device().vehicle();
    let (locked, parked) = (vehicle.locked(), vehicle.parked());
    let (autonomous, stopped) = (vehicle.autonomous(), vehicle.emergency_stop());
    // A key that goes on driving after it is let go is ended by the top button, which does nothing
    // else while the parking brake is off; while it is on, nothing drives.
    let end_key = (vehicle.key_outlasts_press() && !parked).then_some(Action::ReleaseParking);
    let mut undo = Vec::new();
    let mut act = Vec::new();
    // The parking brake can be released in remote mode only.
    let release = |undo: &mut Vec<Action>| {
        undo.extend(TOUCH);
        undo.push(Action::ReleaseParking);
        undo.extend(autonomous.then_some(Action::Autonomous));
    };
    let acted = match fault {
        Fault::EmergencyStop {} => {
            act.push(Action::EmergencyStop(true));
            undo.push(Action::EmergencyStop(false));
            !stopped
        }
        Fault::RemoteControlTakesOver { key } => {
            match key {
                Some(key) => act.push(Action::Press(key.key())),
                None => act.extend(TOUCH.into_iter().chain(end_key)),
            }
            undo.push(Action::ReleaseKey);
            undo.extend(end_key);
            undo.extend(autonomous.then_some(Action::Autonomous));
            autonomous || key.is_some()
        }
        Fault::Locked {} => {
            act.push(Action::Lock);
            undo.push(Action::Unlock);
            if !parked {
                release(&mut undo);
            }
            !locked
        }
        Fault::Parked {} => {
            act.push(Action::Park);
            release(&mut undo);
            !parked
        }
        _ => false,
    };
    if !acted {
        return (Vec::new(), false);
    }
    for action in act {
        r150.operate(now, action);
    }
    if matches!(fault, Fault::EmergencyStop {}) {
        // The emergency stop may have locked the vehicle, too.
        let vehicle = r150.device().vehicle();
        undo.extend((vehicle.locked() && !locked).then_some(Action::Unlock));
        if vehicle.parked() && !parked {
            release(&mut undo);
        }
    }
    (undo, true)
}

/// What the app holds: power and PWM.
pub(super) type Held = Parts;

/// What a fault makes the app hold.
pub(super) fn held_by(fault: &Fault) -> Option<Held> {
    match fault {
        Fault::AppTakesControl { power, pwm } => Some(Parts {
            power: *power,
            pwm: *pwm,
        }),
        _ => None,
    }
}

/// Makes the app hold what any of these say; says whether that is news.
pub(super) fn hold(held: impl Iterator<Item = Held>, r150: &mut R150, now: SimTime) -> bool {
    let wanted = held.fold(Parts::default(), |all, held| Parts {
        power: all.power || held.power,
        pwm: all.pwm || held.pwm,
    });
    if wanted == r150.device().control().held_by_app() {
        return false;
    }
    let Parts { power, pwm } = wanted;
    r150.operate(now, Action::AppHolds { power, pwm });
    true
}
