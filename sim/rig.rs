//! Any number of devices in one world, advanced from event to event.
//!
//! Simulated-time and real-time runs take the same path: the driver of a [`Rig`] says up to when
//! it may go and what the clients send. At one instant things happen in a fixed order: bytes
//! arrive, then deadlines of the firmware are served, device by device in the order in which they
//! were added; then the physics takes the step that ends there.

mod deadlines;
mod effects;
mod faults;
mod port;
mod service;

use std::collections::BTreeMap;
use std::time::Duration;

use rigsim_physics::{PhysicsError, World, WorldMap, WorldSettings};
use rigsim_settings::SimTime;

use crate::device::{Device, DeviceSpec, EffectHandle, Motion, Setup};
use crate::event::Event;
use crate::injection::Injection;
use crate::line::{SerialLine, Wire};
use crate::newest::Newest;
use deadlines::Deadlines;
use effects::Effects;
pub use port::PortId;

/// Interval at which slow states (charge, temperatures) advance while nothing moves.
const REST_TICK: Duration = Duration::from_millis(100);
/// Rounds without time passing after which the rig gives up; an honest instant takes a few for
/// each byte that arrives in it.
const MOST_ROUNDS: u32 = 100_000;

/// Most events kept until they are taken; the oldest go first, and are counted.
const MOST_EVENTS: usize = 1 << 16;

/// Reason for which a rig cannot go on.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum RigError {
    /// A body's position or velocity is not a number.
    #[error(transparent)]
    Physics(#[from] PhysicsError),
    /// Something happens over and over at one instant.
    #[error("device {device} is stuck at {at} s: something in it happens over and over")]
    Stuck {
        /// Index of the device.
        device: usize,
        /// Simulated time.
        at: SimTime,
    },
}

/// Settings that all devices of a run share.
#[derive(Debug, Clone, PartialEq)]
pub struct RigSettings {
    /// The plane that they stand on.
    pub world: WorldSettings,
    /// Things that stand and lie on it.
    pub map: WorldMap,
    /// Pace of bytes on the lines.
    pub wire: Wire,
    /// From which every random stream of the run is derived.
    pub seed: u64,
}

/// A device in the rig.
struct Slot {
    spec: &'static DeviceSpec,
    device: Box<dyn Device>,
    /// Up to when its plant has advanced.
    plant_at: SimTime,
    lines: Vec<SerialLine>,
    /// A wheel would have lifted in the last step.
    tips: bool,
    /// Faults armed in it, if any.
    faults: Option<Box<Injection>>,
}

impl Slot {
    /// Advances the slow states of its plant, while nothing in the world moves.
    fn rest_until(&mut self, now: SimTime) {
        if now > self.plant_at {
            self.device.plant_mut().rest(now.since(self.plant_at));
            self.plant_at = now;
        }
    }
}

/// Devices, their lines, and the world around them.
pub struct Rig {
    settings: RigSettings,
    world: World,
    slots: Vec<Slot>,
    /// Times at which something next happens to each device by itself.
    deadlines: Deadlines,
    now: SimTime,
    /// Time at which the physics next takes a step or, at rest, a tick.
    physics_due: SimTime,
    resting: bool,
    events: Newest<Event>,
    effects: Effects,
    /// Number of times that each fault has acted.
    fault_hits: BTreeMap<EffectHandle, u64>,
    /// Number of times that faults have been armed under each name.
    fault_names: BTreeMap<String, u32>,
}

impl Rig {
    /// An empty world at time zero.
    #[must_use]
    pub fn new(settings: RigSettings) -> Self {
        let mut world = World::with_map(&settings.world, &settings.map);
        world.set_seed(settings.seed);
        let physics_due = SimTime::ZERO + world.step_length();
        Self {
            settings,
            world,
            slots: Vec::new(),
            deadlines: Deadlines::new(),
            now: SimTime::ZERO,
            physics_due,
            resting: false,
            events: Newest::new(MOST_EVENTS),
            effects: Effects::default(),
            fault_hits: BTreeMap::new(),
            fault_names: BTreeMap::new(),
        }
    }

    /// Puts a device into the world; the rig gives it its seed. Its index is the number of devices
    /// there were before.
    pub fn add(&mut self, spec: &'static DeviceSpec, setup: &Setup<'_>) -> usize {
        let seed = self.settings.seed;
        let built = (spec.build)(&Setup { seed, ..*setup }, &mut self.world);
        let (own_settings, wire) = (setup.settings, self.settings.wire);
        let line =
            |link| SerialLine::new(own_settings.baud(link), wire, own_settings.adapter(link));
        self.slots.push(Slot {
            spec,
            device: built,
            plant_at: self.now,
            lines: (0..setup.links).map(line).collect(),
            tips: false,
            faults: None,
        });
        self.deadlines.push();
        self.resting = false;
        let device = self.slots.len() - 1;
        self.after_change(device);
        device
    }

    /// The present.
    #[must_use]
    pub fn now(&self) -> SimTime {
        self.now
    }

    /// The world, to look at.
    #[must_use]
    pub fn world(&self) -> &World {
        &self.world
    }

    /// Applies `change` to the world, and has every device look at it again.
    pub fn with_world<T>(&mut self, change: impl FnOnce(&mut World) -> T) -> T {
        let outcome = change(&mut self.world);
        for device in 0..self.slots.len() {
            self.rest_to_grid(device);
            self.slots[device].device.plant_mut().wake();
            self.after_change(device);
        }
        outcome
    }

    /// Number of devices.
    #[must_use]
    pub fn devices(&self) -> usize {
        self.slots.len()
    }

    /// Returns the table row of this device; `None` if there is no such device.
    #[must_use]
    pub fn spec(&self, device: usize) -> Option<&'static DeviceSpec> {
        self.slots.get(device).map(|slot| slot.spec)
    }

    /// Returns the number of a device's links; 0 if there is no such device.
    #[must_use]
    pub fn links(&self, device: usize) -> usize {
        self.slots.get(device).map_or(0, |slot| slot.lines.len())
    }

    /// The device with this index; `None` if there is no such device.
    #[must_use]
    pub fn any_device(&self, device: usize) -> Option<&dyn Device> {
        self.slots.get(device).map(|slot| slot.device.as_ref())
    }

    /// The device with this index as one of this type; `None` if there is no such device.
    #[must_use]
    pub fn device<T: Device>(&self, device: usize) -> Option<&T> {
        self.any_device(device)?.get()
    }

    /// Returns the true pose and motion of a device; `None` if there is no such device.
    #[must_use]
    pub fn motion(&self, device: usize) -> Option<Motion> {
        self.any_device(device)
            .map(|device| device.plant().motion())
    }

    /// Returns the distance that a device has driven, m; 0 if there is no such device.
    #[must_use]
    pub fn distance_m(&self, device: usize) -> f64 {
        self.motion(device).map_or(0.0, |motion| motion.distance)
    }

    /// Applies `change` to a device, in its world, at the present time, and follows up what it
    /// changed; `None` if there is no such device.
    pub fn with_any_device<T>(
        &mut self,
        device: usize,
        change: impl FnOnce(&mut dyn Device, &mut World, SimTime) -> T,
    ) -> Option<T> {
        let now = self.now;
        self.rest_to_grid(device);
        let found = self.slots.get_mut(device)?.device.as_mut();
        let outcome = change(found, &mut self.world, now);
        self.after_change(device);
        Some(outcome)
    }

    /// Advances to `to`. Earlier than the present does nothing.
    ///
    /// # Errors
    /// When the physics of a body has broken down, or something happens over and over without time
    /// passing; the rig is of no more use then.
    pub fn advance(&mut self, to: SimTime) -> Result<(), RigError> {
        self.go(to, false).map(|_| ())
    }

    /// Advances to `to`, or to the end of the first instant at which there are events to be taken;
    /// says whether there are any.
    ///
    /// # Errors
    /// As [`Rig::advance`].
    pub fn advance_to_event(&mut self, to: SimTime) -> Result<bool, RigError> {
        self.go(to, true)
    }

    fn go(&mut self, to: SimTime, to_event: bool) -> Result<bool, RigError> {
        let mut rounds = 0;
        loop {
            let at = self.deadlines.earliest().min(self.physics_due);
            if to_event && at.min(to) > self.now && !self.events.is_empty() {
                return Ok(true);
            }
            if at > to {
                break;
            }
            rounds = if at > self.now { 0 } else { rounds + 1 };
            if rounds > MOST_ROUNDS {
                let device = self.deadlines.due(at, 0).unwrap_or(0);
                return Err(RigError::Stuck { device, at });
            }
            self.now = self.now.max(at);
            let mut from = 0;
            while let Some(device) = self.deadlines.due(at, from) {
                self.serve(device);
                from = device + 1;
            }
            if self.physics_due <= at {
                self.step_physics()?;
            }
        }
        self.now = self.now.max(to);
        Ok(!self.events.is_empty())
    }

    /// Advances to `to` and stops before anything happens there, so that what is done to the rig
    /// next comes first at that instant. Earlier than the present does nothing.
    ///
    /// # Errors
    /// As [`Rig::advance`].
    pub fn approach(&mut self, to: SimTime) -> Result<(), RigError> {
        if to > self.now {
            // Later than the present, so it is not the first nanosecond.
            self.advance(to - Duration::from_nanos(1))?;
            self.now = to;
        }
        Ok(())
    }

    /// Time at which something next happens by itself; `None` never comes as long as there is a
    /// device.
    #[must_use]
    pub fn next_deadline(&self) -> Option<SimTime> {
        let to_client = self.slots.iter().flat_map(Slot::next_for_clients);
        let of_devices = self.deadlines.earliest().min(self.physics_due);
        let of_devices = (!self.slots.is_empty()).then_some(of_devices);
        of_devices.into_iter().chain(to_client).min()
    }

    /// Takes the next event.
    pub fn poll_event(&mut self) -> Option<Event> {
        self.events.pop()
    }

    /// Number of events that were lost because they were not taken.
    #[must_use]
    pub fn events_lost(&self) -> u64 {
        self.events.lost
    }

    /// While nothing moves, a device's slow states lag behind; this brings them to where the next
    /// step of the physics would begin, so that no time is counted twice.
    fn rest_to_grid(&mut self, device: usize) {
        if self.resting
            && let Some(slot) = self.slots.get_mut(device)
        {
            let step = self.world.step_length();
            let begin = self.now.next_multiple(step) - step;
            slot.rest_until(begin);
        }
    }

    /// Time after which slow states advance while nothing moves: a whole number of steps.
    fn rest_tick(&self) -> Duration {
        let step = self.world.step_length();
        let steps = REST_TICK.as_nanos().div_ceil(step.as_nanos().max(1));
        step.saturating_mul(u32::try_from(steps).unwrap_or(u32::MAX))
    }

    fn step_physics(&mut self) -> Result<(), RigError> {
        let now = self.now;
        if self.resting {
            for slot in &mut self.slots {
                slot.rest_until(now);
            }
        } else {
            let step = self.world.step_length();
            for slot in &mut self.slots {
                slot.rest_until(now - step);
                slot.device.plant_mut().before_step(&mut self.world);
            }
            self.world.step()?;
            for slot in &mut self.slots {
                slot.device.plant_mut().after_step(&mut self.world);
                slot.plant_at = now;
            }
        }
        for slot in &mut self.slots {
            if let Some(faults) = &mut slot.faults {
                faults.tick(now, slot.device.as_mut());
            }
        }
        self.resting = self.slots.iter().all(|slot| slot.device.plant().at_rest());
        let pace = if self.resting {
            self.rest_tick()
        } else {
            self.world.step_length()
        };
        self.physics_due = now.next_multiple(pace);
        for device in 0..self.slots.len() {
            self.after_change(device);
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests;
