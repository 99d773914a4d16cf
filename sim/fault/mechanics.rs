//! Effects of mechanical faults, whichever vehicle has them.

use sim_physics::faults::{BodyFaults, EncoderState, MotorFaults};

use super::MechanicalFault;

/// What a motor, or the wheels that it turns, does.
#[derive(Debug, Clone, Copy)]
pub(crate) struct MotorState {
    /// It is driven.
    pub(crate) driven: bool,
    /// Its wheels turn.
    pub(crate) turns: bool,
    /// An encoder that repeats what it gave is wrong.
    pub(crate) repeats_wrongly: bool,
    /// Its brake should hold.
    pub(crate) braked: bool,
}

impl MechanicalFault {
    /// Adds what it does to a motor that it is about; it drags with `usual_drag`, N·m, unless it
    /// says otherwise.
    pub(crate) fn add_to_motor(&self, own: &mut MotorFaults, usual_drag: f64) {
        match self {
            Self::Blocked {} => own.blocked = true,
            Self::Dragging { torque } => {
                own.drag_torque += torque.map_or(usual_drag, |torque| torque.0.abs());
            }
            Self::FreeWheeling {} => own.free_wheeling = true,
            Self::EncoderLost {} => own.encoder = EncoderState::Lost,
            Self::EncoderStuck {} => own.encoder = EncoderState::Stuck,
            Self::WiredBackwards {} => own.reversed = !own.reversed,
            Self::BrakeStuckOn {} => own.brake_stuck_on = true,
            Self::BrakeStuckOpen {} => own.brake_stuck_open = true,
            // Interference comes and goes; the others are about the whole vehicle.
            Self::EncoderNoisy { .. }
            | Self::PortsSwapped { .. }
            | Self::SidesSwapped {}
            | Self::Ice { .. }
            | Self::Payload { .. }
            | Self::Push { .. } => {}
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
            Self::Blocked {}
            | Self::Dragging { .. }
            | Self::FreeWheeling {}
            | Self::EncoderLost {}
            | Self::EncoderStuck {}
            | Self::EncoderNoisy { .. }
            | Self::WiredBackwards {}
            | Self::PortsSwapped { .. }
            | Self::SidesSwapped {}
            | Self::BrakeStuckOn {}
            | Self::BrakeStuckOpen {} => {}
        }
    }

    /// Tells whether it has an effect on a vehicle as a body, which moves or not.
    pub(crate) fn acts_on_body(&self, moves: bool) -> bool {
        let mut body = BodyFaults::default();
        self.add_to_body(&mut body);
        body.push != [0.0; 3] || (moves && body != BodyFaults::default())
    }

    /// Tells whether it has an effect on a motor that it is about; where cables are swapped only
    /// the device knows.
    pub(crate) fn acts_on(&self, motor: MotorState) -> bool {
        match self {
            Self::Blocked {}
            | Self::FreeWheeling {}
            | Self::WiredBackwards {}
            | Self::BrakeStuckOn {} => motor.driven,
            Self::Dragging { .. } | Self::Ice { .. } | Self::Payload { .. } => {
                motor.driven || motor.turns
            }
            Self::EncoderLost {} => motor.turns,
            Self::EncoderStuck {} => motor.repeats_wrongly,
            Self::BrakeStuckOpen {} => motor.braked,
            // Interference is counted as it acts, and a push is on the body.
            Self::EncoderNoisy { .. }
            | Self::PortsSwapped { .. }
            | Self::SidesSwapped {}
            | Self::Push { .. } => false,
        }
    }
}
