//! Effects of mechanical faults, whichever vehicle has them.

use sim_physics::faults::{BodyFaults, EncoderState, MotorFaults};

use super::Fault;

impl Fault {
    /// Adds what it does to a motor that it is about; it drags with `usual_drag`, N·m, unless it
    /// says otherwise.
    pub(crate) fn add_to_motor(&self, own: &mut MotorFaults, usual_drag: f64) {
        match self {
            Self::Blocked { .. } => own.blocked = true,
            Self::Dragging { torque, .. } => {
                own.drag_torque += torque.map_or(usual_drag, |torque| torque.0.abs());
            }
            Self::FreeWheeling { .. } => own.free_wheeling = true,
            Self::EncoderLost { .. } => own.encoder = EncoderState::Lost,
            Self::EncoderStuck { .. } => own.encoder = EncoderState::Stuck,
            Self::WiredBackwards { .. } => own.reversed = !own.reversed,
            Self::BrakeStuckOn { .. } => own.brake_stuck_on = true,
            Self::BrakeStuckOpen { .. } => own.brake_stuck_open = true,
            _ => {}
        }
    }

    /// Adds what it does to the body of a vehicle.
    pub(crate) fn add_to_body(&self, body: &mut BodyFaults) {
        match self {
            Self::Ice { friction } => {
                let most = body.friction.unwrap_or(f64::INFINITY);
                body.friction = Some(most.min(friction.get()));
            }
            Self::Payload { mass } => body.payload += mass.0,
            Self::Push { ahead, left, turn } => {
                let [old_ahead, old_left, old_turn] = body.push;
                body.push = [old_ahead + ahead.0, old_left + left.0, old_turn + turn.0];
            }
            _ => {}
        }
    }
}
