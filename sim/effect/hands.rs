//! What people's hands do to any vehicle.

use rigsim_physics::Pose;
use rigsim_settings::{Angle, Length};
use schemars::JsonSchema;
use serde::Deserialize;

use crate::device::{Begin, Effect, EffectError, Work};

crate::actions! {
    /// What people's hands do to a vehicle.
    pub enum Hands: Operator {
        /// Lifts the vehicle and sets it down elsewhere.
        Place(Place) = "place";
    }
}

/// A place.
#[derive(Debug, Clone, Copy, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "PlaceText")]
pub struct Place {
    /// East.
    pub x: Length,
    /// North.
    pub y: Length,
    /// Counter-clockwise from x; default 0.
    pub heading: Option<Angle>,
}

impl Effect for Hands {
    fn begin(&self, at: &mut Begin<'_>) -> Result<Work, EffectError> {
        let Self::Place(Place { x, y, heading }) = self;
        let heading = heading.map_or(0.0, |angle| angle.0.to_radians());
        let (x, y) = (x.0, y.0);
        at.device
            .plant_mut()
            .place(at.world, Pose { x, y, heading });
        Ok(Work::Done(Vec::new()))
    }

    fn can_end(&self) -> bool {
        false
    }
}
