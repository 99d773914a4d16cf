//! Faults of a vehicle as a body.

use rigsim_settings::{Force, Mass, Torque};

use super::defaults;
use crate::device::parameters::Probability;
use crate::device::{
    Begin, Declared, Device, Effect, EffectError, MotorState, OnHardware, Sum, Tally, Work,
};

crate::faults! {
    /// The vehicle as a body, and the ground under it.
    pub enum BodyFault {
        /// The ground under the wheels is slippery.
        Ice = "ice", Mechanical,
        sees "Speeds of wheels that spin; the vehicle itself lags behind and slides.",
        counts "The vehicle was driven or moved.",
        lasts [300, 2000, 0]
        {
            /// Friction at most; default 0.05.
            #[serde(default = "defaults::ice")]
            friction: Probability,
        }
        /// A payload lies on the deck.
        Payload = "payload", Mechanical,
        sees "Slower starts and longer stops; more current.",
        counts "The vehicle was driven or moved.",
        tries ["mass = \"5 kg\""]
        lasts [2000, 0]
        {
            /// Mass of the payload.
            mass: Mass,
        }
        /// Something pushes the vehicle.
        Push = "push", Mechanical,
        sees "Speeds that it did not command; none if the brakes hold.",
        counts "The push acted.",
        tries ["ahead = \"20 N\"", "left = \"20 N\""]
        lasts [300, 2000, 0]
        {
            /// Force ahead; default 0.
            #[serde(default = "defaults::no_force")]
            ahead: Force,
            /// Force to the left; default 0.
            #[serde(default = "defaults::no_force")]
            left: Force,
            /// Torque, counter-clockwise; default 0.
            #[serde(default = "defaults::no_torque")]
            turn: Torque,
        }
    }
}

/// Slower than this a vehicle stands, m/s and rad/s.
const STANDING: f64 = 0.01;

impl Effect for BodyFault {
    fn begin(&self, _at: &mut Begin<'_>) -> Result<Work, EffectError> {
        Ok(Work::Hardware(Box::new(self.clone())))
    }
}

impl OnHardware for BodyFault {
    fn add(&self, sum: &mut Sum) {
        let body = &mut sum.body;
        match self {
            Self::Ice { friction } => {
                let most = body.friction.unwrap_or(f64::INFINITY);
                body.friction = Some(most.min(friction.0));
            }
            Self::Payload { mass } => body.payload += mass.0,
            Self::Push { ahead, left, turn } => {
                body.push.ahead += ahead.0;
                body.push.left += left.0;
                body.push.turn += turn.0;
            }
        }
    }

    fn watch(&mut self, device: &dyn Device, tally: &mut Tally) {
        let motion = device.plant().motion();
        let speeds = [motion.forward_speed, motion.leftward_speed, motion.yaw_rate];
        let moves = speeds.iter().any(|speed| speed.abs() > STANDING);
        let turns = |motor: MotorState| motor.driven || motor.turns;
        let acts = match self {
            Self::Push { ahead, left, turn } => [ahead.0, left.0, turn.0] != [0.0; 3],
            Self::Ice { .. } | Self::Payload { .. } => {
                moves || device.motors().into_iter().any(turns)
            }
        };
        tally.hit_when(acts, || self.info().counts.trim_end_matches('.').to_owned());
    }
}
