//! What people do to a mecanum car.

use super::Mecanum;
use crate::device::{Begin, Change, Effect, EffectError, Work};
use crate::mecanum_device::OperatorInput;

impl Effect for OperatorInput {
    fn begin(&self, at: &mut Begin<'_>) -> Result<Work, EffectError> {
        let car = at.device.typed::<Mecanum>();
        let input = *self;
        let held = car.device.key();
        let before = held.map_or(OperatorInput::Release, OperatorInput::Press);
        car.device.operate(at.now, input);
        let restore = move |car: &mut Mecanum, now| car.device.operate(now, before);
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
