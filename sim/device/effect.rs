//! What a step can do to a device or around it: faults, actions of people, changes of the world.
//!
//! All are one kind of object, an [`Effect`]: parameters, a target, a beginning and an end, and what
//! counts as a hit. They differ in what they are at [`Work`] on: bytes, frames, hardware and
//! firmware, or nothing any more since they have changed something once.
//!
//! [`faults!`](crate::faults) and [`actions!`](crate::actions) declare them. Those that every device
//! has are in [`crate::effect`]; a device's own are in its folder, and its row lists them.

use std::any::Any;
use std::fmt;
use std::sync::Arc;
use std::time::Duration;

use rigsim_physics::World;
use rigsim_physics::faults::{BodyFaults, MotorFaults};
use rigsim_physics::world::ObstacleError;
use rigsim_settings::{ReadError, Reader, SimTime};
use schemars::{JsonSchema, Schema, SchemaGenerator};
use serde::Deserialize;

use super::parameters::Scope;
use super::{Device, Framing};
use crate::defects::Defects;
use crate::line::Adapter;
use crate::noise::Noise;

rigsim_settings::words! {
    /// Where something acts, in the order of the catalogue.
    #[non_exhaustive]
    pub enum Level {
        /// Bytes on their way.
        Wire = "wire",
        /// Whole frames, packets and lines of the device.
        Protocol = "protocol",
        /// The device's program.
        Firmware = "firmware",
        /// Supply, outputs, fuses.
        Electrical = "electrical",
        /// Motors, wheels, brakes, load, ground.
        Mechanical = "mechanical",
        /// Sensors of the world.
        Sensor = "sensor",
        /// People who work buttons or move the vehicle.
        Operator = "operator",
        /// What is around the vehicle.
        World = "world",
    }
}

impl Level {
    /// Returns the key of a step under which files have such effects.
    #[must_use]
    pub const fn key(self) -> &'static str {
        match self {
            Self::Operator => "operator",
            Self::World => "world",
            _ => "fault",
        }
    }
}

/// A kind of effect, as it is declared.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct EffectInfo {
    /// Its name in files: the `kind` of a fault, the key of an action.
    pub id: &'static str,
    /// Level at which it acts.
    pub level: Level,
    /// Parameters of a fault. Those of actions are in their schema.
    pub parameters: &'static [ParameterInfo],
    /// What a client notices; empty for actions.
    pub client_sees: &'static str,
    /// What counts as a hit.
    pub counts: &'static str,
    /// Parameters that a search tries, as in files, the usual or strongest first; the values of an
    /// action. If empty: a fault or an action without any.
    pub tries: &'static [&'static str],
    /// Durations that a search tries, in ms, and 0 for good. If empty: the usual ones.
    pub lasts: &'static [u64],
    /// Kinds that are milder, by their names. A search shrinks a finding to them.
    pub weaker: &'static [&'static str],
    /// Summary in a sentence.
    pub summary: &'static str,
}

impl EffectInfo {
    /// Returns whether it is a fault: one that hits nothing fails its scenario.
    #[must_use]
    pub fn is_fault(&self) -> bool {
        self.level.key() == "fault"
    }
}

/// A parameter of a fault.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ParameterInfo {
    /// Its key in files.
    pub name: &'static str,
    /// Meaning, and the default.
    pub description: &'static str,
    /// Set if it must be given.
    pub required: bool,
}

impl ParameterInfo {
    /// One that many faults have, and that may be left out.
    #[doc(hidden)]
    #[must_use]
    pub const fn shared(name: &'static str, description: &'static str) -> Self {
        Self {
            name,
            description,
            required: false,
        }
    }
}

/// What the macros declare of an effect.
pub trait Declared {
    /// Returns the declaration of its kind.
    fn info(&self) -> &'static EffectInfo;

    /// Returns its target and how often it acts.
    fn scope(&self) -> Scope {
        Scope::default()
    }
}

/// Kinds of effects that one type declares.
pub trait Kinds {
    /// Their declarations.
    const KINDS: &'static [EffectInfo];
}

/// Something that can be done to a device or to the world around it.
pub trait Effect: Declared + fmt::Debug + Send + Sync {
    /// Checks that its parameters make sense.
    ///
    /// # Errors
    /// Says in a sentence why not.
    fn check(&self) -> Result<(), String> {
        Ok(())
    }

    /// Begins it on a device.
    ///
    /// # Errors
    /// When this device or the world around it does not allow it.
    fn begin(&self, at: &mut Begin<'_>) -> Result<Work, EffectError>;

    /// Returns whether it can end, and what was before comes back.
    fn can_end(&self) -> bool {
        true
    }

    /// Names the obstacle that has to be there.
    fn needs(&self) -> Option<&str> {
        None
    }

    /// Names the obstacles that it adds.
    fn brings(&self) -> Vec<&str> {
        Vec::new()
    }

    /// Returns how late bytes of a client may still be after its end.
    fn holds_back(&self) -> Duration {
        Duration::ZERO
    }

    /// Returns whether the device may get other bytes than its client sent. What that looks like is
    /// not attributed to the client.
    fn disturbs_requests(&self) -> bool {
        false
    }
}

/// Refusal to apply an effect.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum EffectError {
    /// There is no such device in the rig.
    #[error("there is no device {0}")]
    NoDevice(usize),
    /// This device cannot have it.
    #[error("{0}")]
    Impossible(String),
    /// Too many are at work.
    #[error("more than {MOST_ARMED} faults at once on one device, or {MOST_EVER} in one run")]
    TooMany,
    /// The world cannot be changed so.
    #[error(transparent)]
    World(#[from] ObstacleError),
}

/// Most faults at once on one device.
pub(crate) const MOST_ARMED: usize = 256;
/// Most faults in a run.
pub(crate) const MOST_EVER: usize = 1_000_000;

/// Where an effect begins.
pub struct Begin<'a> {
    /// The present.
    pub now: SimTime,
    /// The device.
    pub device: &'a mut dyn Device,
    /// The world around it.
    pub world: &'a mut World,
    /// Frames of the link on which it acts.
    pub framing: Framing,
    /// What it hits.
    pub tally: &'a mut Tally,
    /// Returns separate random numbers for each purpose.
    pub stream: &'a dyn Fn(&str) -> Noise,
}

/// What an effect does while it lasts.
pub enum Work {
    /// It changes bytes on their way.
    Bytes(Box<dyn OnBytes>),
    /// It changes what the firmware sends.
    Frames(Box<dyn OnFrames>),
    /// It is part of what is wrong with hardware and firmware.
    Hardware(Box<dyn OnHardware>),
    /// It has changed this.
    Done(Vec<Change>),
}

rigsim_settings::words! {
    /// One way along a link.
    pub enum Way {
        /// From the client to the device.
        ToDevice = "to the device",
        /// From the device to the client.
        ToClient = "to the client",
    }
}

/// A byte on its way and when it arrives.
pub type TimedByte = (SimTime, u8);
/// A frame of the device and when it is sent.
pub type TimedFrame = (SimTime, Vec<u8>);

/// An effect on the bytes of a link.
pub trait OnBytes: Send + Sync {
    /// Passes bytes on that arrive at these times. [`SimTime::MAX`] holds a byte until the effect
    /// ends.
    fn pass(&mut self, way: Way, bytes: &mut Vec<TimedByte>, tally: &mut Tally);

    /// Returns whether it holds bytes until it ends.
    fn stalls(&self, _way: Way) -> bool {
        false
    }

    /// Returns whether the cable is out.
    fn pulls_cable(&self) -> bool {
        false
    }

    /// Returns the wrong speed of the device's end of the link, baud.
    fn baud(&self) -> Option<u32> {
        None
    }

    /// Returns the adapter that replaces the client's.
    fn adapter(&self) -> Option<Adapter> {
        None
    }

    /// Counts what is sent while speeds differ or the cable is out.
    fn count_sent(&self, _way: Way, _bytes: usize, _tally: &mut Tally) {}

    /// Returns the time at which it next adds a byte by itself.
    fn due(&self) -> Option<SimTime> {
        None
    }

    /// Returns the byte that it adds at `now`; `idle` says whether the line is.
    fn add(&mut self, _now: SimTime, _way: Way, _idle: bool, _tally: &mut Tally) -> Option<u8> {
        None
    }
}

/// An effect on the frames that a device sends on a link.
pub trait OnFrames: Send + Sync {
    /// Passes frames on.
    fn pass(&mut self, frames: &mut Vec<TimedFrame>, tally: &mut Tally);

    /// Returns the time at which it next sends a frame by itself.
    fn due(&self) -> Option<SimTime> {
        None
    }

    /// Returns the frame that it sends at `now`.
    fn send(&mut self, _now: SimTime, _tally: &mut Tally) -> Option<Vec<u8>> {
        None
    }
}

/// An effect on hardware or firmware.
pub trait OnHardware: Send + Sync {
    /// Adds its part to all that is wrong.
    fn add(&self, sum: &mut Sum);

    /// Counts whether it acts now, after something has happened.
    fn watch(&mut self, device: &dyn Device, tally: &mut Tally);

    /// Advances interference by this long, s. Returns whether its part of the sum has changed.
    fn interfere(&mut self, _device: &mut dyn Device, _seconds: f64, _tally: &mut Tally) -> bool {
        false
    }
}

/// What all effects at work together make of a device.
pub struct Sum {
    /// Bugs of the firmware.
    pub defects: Defects,
    /// What is wrong with the vehicle as a body.
    pub body: BodyFaults,
    /// What is wrong with the motors of the wheels: left front, right front, left rear, right rear.
    pub motors: [MotorFaults; 4],
    /// Torque with which something drags on a wheel unless given, N·m.
    pub usual_drag: f64,
    own: Box<dyn Any>,
}

impl Sum {
    /// Nothing is wrong. `own` sums up what only such a device has.
    pub fn new(usual_drag: f64, own: impl Any) -> Self {
        Self {
            defects: Defects::default(),
            body: BodyFaults::default(),
            motors: Default::default(),
            usual_drag,
            own: Box::new(own),
        }
    }

    /// Returns the device's own part; `None` if it has another type.
    #[must_use]
    pub fn own<T: Any>(&self) -> Option<&T> {
        self.own.downcast_ref()
    }

    /// Returns the device's own part, to add to; `None` if it has another type.
    pub fn own_mut<T: Any>(&mut self) -> Option<&mut T> {
        self.own.downcast_mut()
    }
}

/// State of a motor, or of the wheels that it turns.
#[derive(Debug, Clone, Copy, Default)]
pub struct MotorState {
    /// It is driven.
    pub driven: bool,
    /// Its wheels turn.
    pub turns: bool,
    /// An encoder that repeats its last value is wrong.
    pub repeats_wrongly: bool,
    /// Its brake should hold.
    pub braked: bool,
}

/// Number of hits of an effect, and the first one in words.
#[derive(Debug, Default)]
pub struct Tally {
    pub(crate) hits: u64,
    /// Until it is reported.
    pub(crate) first: Option<String>,
    /// What [`Tally::count_to`] last counted to.
    counted: u64,
}

impl Tally {
    /// Counts a hit; only the first is put into words.
    pub fn hit(&mut self, what: impl FnOnce() -> String) {
        if self.hits == 0 {
            self.first = Some(what());
        }
        self.hits = self.hits.saturating_add(1);
    }

    /// Counts a hit when `acts` becomes true.
    pub fn hit_when(&mut self, acts: bool, what: impl FnOnce() -> String) {
        if acts {
            self.count_to(1, what);
        } else {
            self.counted = 0;
        }
    }

    /// Counts what a counter has counted since the last call.
    pub fn count_to(&mut self, count: u64, what: impl FnOnce() -> String) {
        let more = count.saturating_sub(self.counted);
        self.counted = count;
        if more > 0 {
            self.hit(what);
            self.hits = self.hits.saturating_add(more - 1);
        }
    }

    /// Begins to count from here.
    pub fn count_from(&mut self, count: u64) {
        self.counted = count;
    }

    /// Returns whether there are fewer hits than `most`.
    #[must_use]
    pub fn is_below(&self, most: Option<u64>) -> bool {
        most.is_none_or(|most| self.hits < most)
    }
}

/// Brings something back to how it was.
pub type Restore = Box<dyn FnOnce(&mut dyn Device, &mut World, SimTime) + Send + Sync>;

/// An effect that lasts in a rig.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct EffectHandle(pub(crate) u64);

/// Change of something that stays until it is changed again.
pub struct Change {
    /// Name of what was changed: other effects that change the same have the same here.
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
            if let Some(typed) = device.get_mut() {
                restore(typed, now);
            }
        })
    }
}

/// Kinds of effects that files have, with how they are read.
#[derive(Clone, Copy)]
pub struct Effects {
    /// Their declarations.
    pub kinds: &'static [EffectInfo],
    /// Reads one: a fault from its table, an action from its word or table.
    pub read: fn(Reader<'_, '_>) -> Result<Arc<dyn Effect>, ReadError>,
    /// The form of them in files, as alternatives.
    pub schema: fn(&mut SchemaGenerator) -> Schema,
}

/// Effects of this type.
#[must_use]
pub const fn effects<T>() -> Effects
where
    T: Effect + Kinds + JsonSchema + for<'de> Deserialize<'de> + 'static,
{
    Effects {
        kinds: T::KINDS,
        read: |value| Ok(Arc::new(T::deserialize(value)?)),
        schema: |generator| T::json_schema(generator),
    }
}
