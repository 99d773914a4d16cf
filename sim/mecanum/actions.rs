//! What people do to a mecanum car.

use super::Mecanum;
use crate::device::{Begin, Change, Effect, EffectError, Work};
use crate::mecanum_device::OperatorInput;

impl Effect for OperatorInput {
    fn begin(&self, at: &mut Begin<'_>) -> Result<Work, EffectError> {
        let Some(car) = at.device.get_mut::<Mecanum>() else {
            return Ok(Work::Done(Vec::new()));
        };
        let input = *self;
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
