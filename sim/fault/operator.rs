//! What people do to an R150, and how they undo it.

use sim_settings::SimTime;

use super::Fault;
use crate::r150::R150;
use crate::r150_device::vehicle::{Action, Key};

/// Nobody drives with this key: it is let go at the same instant.
const TOUCH: [Action; 2] = [Action::Press(Key::Forward), Action::ReleaseKey];

/// Does it; gives what undoes it, and whether it changed anything.
pub(super) fn begin(fault: &Fault, r150: &mut R150, now: SimTime) -> (Vec<Action>, bool) {
    let vehicle = r150.device().vehicle();
    let (locked, parked) = (vehicle.locked(), vehicle.parked());
    let (autonomous, stopped) = (vehicle.autonomous(), vehicle.emergency_stop());
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
                None => act.extend(TOUCH),
            }
            undo.push(Action::ReleaseKey);
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
    (undo, true)
}

/// What the app holds: power and PWM.
pub(super) type Held = [bool; 2];

/// What a fault makes the app hold.
pub(super) fn held_by(fault: &Fault) -> Option<Held> {
    match fault {
        Fault::AppTakesControl { power, pwm } => Some([*power, *pwm]),
        _ => None,
    }
}

/// Makes the app hold what any of these say; says whether that is news.
pub(super) fn hold(held: impl Iterator<Item = Held>, r150: &mut R150, now: SimTime) -> bool {
    let control = r150.device().control();
    let before = [control.app_holds_power, control.app_holds_pwm];
    let wanted = held.fold([false; 2], |[power, pwm], held| {
        [power || held[0], pwm || held[1]]
    });
    if wanted == before {
        return false;
    }
    let [power, pwm] = wanted;
    r150.operate(now, Action::AppHolds { power, pwm });
    true
}
