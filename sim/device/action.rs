//! Deeds of people to a device, and changes around it.

use std::fmt;

use schemars::{JsonSchema, Schema, SchemaGenerator};
use serde::Deserialize;
use sim_physics::world::ObstacleError;
use sim_physics::{Pose, World};
use sim_settings::{Angle, Force, Length, Mass, SimTime, Torque};
use toml::de::ValueDeserializer;

use super::Device;

/// Brings something back to how it was.
pub type Restore = Box<dyn FnOnce(&mut dyn Device, &mut World, SimTime) + Send + Sync>;

/// Something that goes on in a rig: a fault that was armed, or a deed that can be undone.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct EffectHandle(pub(crate) u64);

/// Change of something that stays until it is changed again.
pub struct Change {
    /// Name of what was changed: other actions that change the same have the same here.
    pub(crate) of: String,
    /// Set if it is something of the world around all devices, and not of one of them.
    pub(crate) in_world: bool,
    /// Brings back what was before; none if that was no other.
    pub(crate) restore: Option<Restore>,
}

impl Change {
    /// A change of something of a device; `restore` brings back what was before, unless nothing
    /// `changed`.
    pub fn new(
        of: impl Into<String>,
        changed: bool,
        restore: impl FnOnce(&mut dyn Device, &mut World, SimTime) + Send + Sync + 'static,
    ) -> Self {
        let restore: Restore = Box::new(restore);
        Self {
            of: of.into(),
            in_world: false,
            restore: changed.then_some(restore),
        }
    }

    /// A change of something in the world around all devices.
    pub fn in_world(
        of: impl Into<String>,
        changed: bool,
        restore: impl FnOnce(&mut World) + Send + Sync + 'static,
    ) -> Self {
        Self {
            in_world: true,
            ..Self::new(of, changed, |_, world, _| restore(world))
        }
    }

    /// A change of something of a device of this type.
    pub fn of_own<D: Device>(
        of: impl Into<String>,
        changed: bool,
        restore: impl FnOnce(&mut D, SimTime) + Send + Sync + 'static,
    ) -> Self {
        Self::new(of, changed, |device, _, now| {
            if let Some(own) = device.get_mut() {
                restore(own, now);
            }
        })
    }
}

/// Changes that an action has made and that can be brought back.
///
/// # Errors
/// The world cannot be changed so.
pub type Performed = Result<Vec<Change>, ObstacleError>;

/// Something that can be done to a device or to the world around it.
pub trait Action: fmt::Debug + Send + Sync {
    /// Does it.
    fn perform(&self, device: &mut dyn Device, world: &mut World, now: SimTime) -> Performed;

    /// Tells whether it can be said to last for a time.
    fn can_end(&self) -> bool;

    /// The obstacle that has to be there.
    fn needs(&self) -> Option<&str> {
        None
    }

    /// The obstacles that it brings, as far as they have names.
    fn brings(&self) -> Vec<&str> {
        Vec::new()
    }
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
                let changed = before != device.plant().vehicle().push();
                let restore = move |device: &mut dyn Device, _: &mut World, _| {
                    device.plant_mut().set_push(before)
                };
                Ok(vec![Change::new("push", changed, restore)])
            }
            Self::Payload(mass) => {
                let before = device.plant().vehicle().payload();
                device.plant_mut().set_payload(world, mass.0);
                let changed = before != device.plant().vehicle().payload();
                let restore = move |device: &mut dyn Device, world: &mut World, _| {
                    device.plant_mut().set_payload(world, before);
                };
                Ok(vec![Change::new("payload", changed, restore)])
            }
            Self::Place(Place { x, y, heading }) => {
                let heading = heading.map_or(0.0, |angle| angle.0.to_radians());
                let (x, y) = (x.0, y.0);
                device.plant_mut().place(world, Pose { x, y, heading });
                Ok(Vec::new())
            }
        }
    }

    fn can_end(&self) -> bool {
        !matches!(self, Self::Place(_))
    }
}
