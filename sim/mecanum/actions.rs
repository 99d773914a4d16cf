//! Deeds of people to a mecanum car.

use schemars::JsonSchema;
use serde::Deserialize;
use sim_physics::World;
use sim_settings::SimTime;

use super::Mecanum;
use crate::device::{self, Actions, Change, Device, Performed, actions};
use crate::mecanum_device::OperatorInput;
use crate::mecanum_device::kinematics::{Course, Movement};

pub(super) const OPERATOR: Actions = actions::<Operator>();

/// What an operator does.
#[derive(Debug, Clone, Copy, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
enum Operator {
    /// Mecanum car: a motion key of the remote control goes down.
    Press(CarKey),
    /// The motion key goes up.
    Release,
}

/// A motion key of the car's remote control.
#[derive(Debug, Clone, Copy, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
enum CarKey {
    Forward,
    Backward,
    TurnLeft,
    TurnRight,
    StrafeLeft,
    StrafeRight,
    LeftFront,
    RightFront,
    LeftRear,
    RightRear,
}

impl CarKey {
    fn movement(self) -> Movement {
        let (course, negative) = match self {
            Self::Forward => (Course::Ahead, false),
            Self::Backward => (Course::Ahead, true),
            Self::TurnLeft => (Course::Rotate, true),
            Self::TurnRight => (Course::Rotate, false),
            Self::StrafeLeft => (Course::Strafe, false),
            Self::StrafeRight => (Course::Strafe, true),
            Self::LeftFront => (Course::LeftFront, false),
            Self::RightRear => (Course::LeftFront, true),
            Self::RightFront => (Course::RightFront, false),
            Self::LeftRear => (Course::RightFront, true),
        };
        Movement { course, negative }
    }
}

impl device::Action for Operator {
    fn perform(&self, device: &mut dyn Device, _world: &mut World, now: SimTime) -> Performed {
        let Some(car) = device.get_mut::<Mecanum>() else {
            return Ok(Vec::new());
        };
        let input = match self {
            Self::Press(key) => OperatorInput::Press(key.movement()),
            Self::Release => OperatorInput::Release,
        };
        let held = car.device().key();
        let before = held.map_or(OperatorInput::Release, OperatorInput::Press);
        car.operate(now, input);
        let restore = move |car: &mut Mecanum, now| car.operate(now, before);
        Ok(vec![Change::of_own("key", before != input, restore)])
    }

    fn can_end(&self) -> bool {
        matches!(self, Self::Press(_))
    }
}
