//! Deeds of people to a device, and changes around it.

use std::fmt;

use schemars::{JsonSchema, Schema, SchemaGenerator};
use serde::Deserialize;
use sim_physics::{Pose, World};
use sim_settings::{Angle, Force, Length, Mass, SimTime, Torque};
use toml::de::ValueDeserializer;

use super::Device;

/// Brings something back to how it was.
pub type Restore = Box<dyn FnOnce(&mut dyn Device, &mut World, SimTime) + Send>;

/// Change of something that stays until it is changed again.
pub struct Change {
    /// Name of what was changed: other actions that change the same have the same here.
    pub of: String,
    /// Brings back what was before; none if that was no other.
    pub restore: Option<Restore>,
}

impl Change {
    /// A change of something from what it was `before` to what it is `now`.
    pub fn of<T: PartialEq + Send + 'static>(
        of: impl Into<String>,
        before: T,
        now: &T,
        restore: impl FnOnce(T, &mut dyn Device, &mut World, SimTime) + Send + 'static,
    ) -> Self {
        let changed = before != *now;
        let restore: Restore =
            Box::new(move |device, world, now| restore(before, device, world, now));
        Self {
            of: of.into(),
            restore: changed.then_some(restore),
        }
    }
}

/// Change that an action has made, unless nothing brings it back.
pub type Performed = Option<Change>;

/// Something that can be done to a device.
pub trait Action: fmt::Debug + Send + Sync {
    /// Does it.
    fn perform(&self, device: &mut dyn Device, world: &mut World, now: SimTime) -> Performed;

    /// Tells whether it can be said to last for a time.
    fn can_end(&self) -> bool;
}

/// Things that can be done to a device, as files have them.
#[derive(Clone, Copy)]
pub struct Actions {
    /// Reads one.
    pub read: fn(ValueDeserializer<'_>) -> Result<Box<dyn Action>, toml::de::Error>,
    /// The form of them in files: alternatives, each a word or a table with its name as the only
    /// key.
    pub schema: fn(&mut SchemaGenerator) -> Schema,
}

/// Actions of this type.
#[must_use]
pub const fn actions<T>() -> Actions
where
    T: Action + JsonSchema + for<'de> Deserialize<'de> + 'static,
{
    Actions {
        read: |value| Ok(Box::new(T::deserialize(value)?)),
        schema: |generator| T::json_schema(generator),
    }
}

/// Deeds of hands that any vehicle knows.
pub static HANDS: Actions = actions::<Hands>();

/// Deeds of somebody's hands to a vehicle.
#[derive(Debug, Clone, Copy, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum Hands {
    /// Pushes steadily until another push, or for as long as `for` says.
    Push(Push),
    /// Puts a payload on the deck.
    Payload(Mass),
    /// Lifts the vehicle and sets it down elsewhere.
    Place(Place),
}

/// A push in the vehicle's axes.
#[derive(Debug, Clone, Copy, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "PushText")]
pub struct Push {
    /// Ahead.
    pub ahead: Option<Force>,
    /// To the left.
    pub left: Option<Force>,
    /// Counter-clockwise.
    pub turn: Option<Torque>,
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
    /// Counter-clockwise from x; 0 unless given.
    pub heading: Option<Angle>,
}

impl Action for Hands {
    fn perform(&self, device: &mut dyn Device, world: &mut World, _now: SimTime) -> Performed {
        match *self {
            Self::Push(Push { ahead, left, turn }) => {
                let [ahead, left] = [ahead, left].map(|force| force.map_or(0.0, |force| force.0));
                let before = device.plant().vehicle().push();
                device
                    .plant_mut()
                    .set_push([ahead, left, turn.map_or(0.0, |torque| torque.0)]);
                let now = device.plant().vehicle().push();
                let restore = |push, device: &mut dyn Device, _: &mut World, _| {
                    device.plant_mut().set_push(push);
                };
                Some(Change::of("push", before, &now, restore))
            }
            Self::Payload(mass) => {
                let before = device.plant().vehicle().payload();
                device.plant_mut().set_payload(world, mass.0);
                let now = device.plant().vehicle().payload();
                let restore = |payload, device: &mut dyn Device, world: &mut World, _| {
                    device.plant_mut().set_payload(world, payload);
                };
                Some(Change::of("payload", before, &now, restore))
            }
            Self::Place(Place { x, y, heading }) => {
                let heading = heading.map_or(0.0, |angle| angle.0.to_radians());
                let (x, y) = (x.0, y.0);
                device.plant_mut().place(world, Pose { x, y, heading });
                None
            }
        }
    }

    fn can_end(&self) -> bool {
        !matches!(self, Self::Place(_))
    }
}
