//! What people do to a mecanum car.

use schemars::JsonSchema;
use serde::Deserialize;

use super::Mecanum;
use crate::device::{Begin, Change, Effect, EffectError, Work};
use crate::mecanum_device::OperatorInput;
use crate::mecanum_device::kinematics::{Course, Movement};

crate::actions! {
    /// What an operator does.
    pub enum Operator: Operator {
        /// Mecanum car: a motion key of the remote control goes down.
        Press(CarKey) = "press" tries ["\"forward\"", "\"turn-left\""];
        /// The motion key goes up.
        Release = "release";
    }
}

/// A motion key of the car's remote control.
#[derive(Debug, Clone, Copy, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum CarKey {
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

impl Effect for Operator {
    fn begin(&self, at: &mut Begin<'_>) -> Result<Work, EffectError> {
        let Some(car) = at.device.get_mut::<Mecanum>() else {
            return Ok(Work::Done(Vec::new()));
        };
        let input = match self {
            Self::Press(key) => OperatorInput::Press(key.movement()),
            Self::Release => OperatorInput::Release,
        };
        let held = car.device().key();
        let before = held.map_or(OperatorInput::Release, OperatorInput::Press);
        car.operate(at.now, input);
        let restore = move |car: &mut Mecanum, now| car.operate(now, before);
        Ok(Work::Done(vec![Change::of_own(
            "key",
            before != input,
            restore,
        )]))
    }

    fn can_end(&self) -> bool {
        matches!(self, Self::Press(_))
    }
}
