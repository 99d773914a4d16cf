//! An R150: the firmware of [`crate::r150_device`] with the hardware of [`sim_physics::r150`].

pub mod event;
pub mod watch;

use std::sync::Arc;
use std::time::Duration;

use sim_physics::r150::{Load, PwmSource, R150Plant, R150Truth, Rail};
use sim_physics::{BodyId, Pose, World};
use sim_settings::SimTime;

use crate::defects::Defects;
use crate::event::EventKind;
use crate::noise::Noise;
use crate::r150_device::R150Device;
use crate::r150_device::vehicle::{Action, Start};
use crate::settings::R150Settings;
use crate::unit::Unit;
use watch::Watch;

/// Rounds in which pins and measurements may chase one another at one instant; what is not settled
/// then goes on at the next one.
const MOST_ROUNDS: usize = 8;

/// Firmware and hardware of one R150.
#[derive(Debug)]
pub struct R150 {
    device: R150Device,
    plant: R150Plant,
    /// Up to when the plant's slow states have advanced.
    plant_at: SimTime,
    watch: Watch,
}

impl R150 {
    /// A vehicle that has just been switched on, standing at `pose`.
    #[must_use]
    pub fn new(
        name: &str,
        settings: &R150Settings,
        start: Start,
        pose: Pose,
        seed: u64,
        world: &mut World,
    ) -> Self {
        let plant = R150Plant::with_name(name, &settings.plant, world, pose);
        let noise = Noise::new(seed, &format!("{name}.measurement_noise"));
        let reply_time = Noise::new(seed, &format!("{name}.reply_time"));
        let device = R150Device::new(
            settings.firmware.clone(),
            start,
            plant.measurements(),
            noise,
            reply_time,
        );
        let mut vehicle = Self {
            device,
            plant,
            plant_at: SimTime::ZERO,
            watch: Watch::default(),
        };
        vehicle.settle(SimTime::ZERO);
        vehicle
    }

    /// Somebody works a button.
    pub fn operate(&mut self, now: SimTime, action: Action) {
        self.device.operate(now, action);
    }

    /// Replaces all that is wrong with the firmware.
    pub fn set_defects(&mut self, now: SimTime, defects: Defects) {
        self.device.set_defects(now, defects);
    }

    /// The firmware restarts, and is up after `boot`; says whether it ran.
    pub fn reset(&mut self, now: SimTime, boot: Duration) -> bool {
        self.device.reset(now, boot)
    }

    /// The firmware's state.
    #[must_use]
    pub fn device(&self) -> &R150Device {
        &self.device
    }

    /// How things really are.
    #[must_use]
    pub fn truth(&self) -> R150Truth {
        self.plant.truth()
    }

    /// Its body in the world, for contact queries.
    #[must_use]
    pub fn body(&self) -> BodyId {
        self.plant.body()
    }

    /// The hardware, to look at.
    #[must_use]
    pub fn plant(&self) -> &R150Plant {
        &self.plant
    }

    /// The hardware, for its faults.
    pub(crate) fn plant_mut(&mut self) -> &mut R150Plant {
        &mut self.plant
    }
}

/// What an operator does to the hardware.
impl R150 {
    /// Wires a load to a rail; gives what was there before.
    pub fn set_load(&mut self, rail: Rail, load: Load) -> Load {
        let before = self.plant.load(rail);
        self.plant.set_load(rail, load);
        before
    }

    /// Wires a source to a PWM input, 0–3.
    pub fn set_pwm_source(&mut self, input: usize, source: PwmSource) {
        self.plant.set_pwm_source(input, source);
    }

    /// Puts a payload on the deck, kg.
    pub fn set_payload(&mut self, world: &mut World, payload: f64) {
        self.plant.set_payload(world, payload);
    }

    /// Pushes steadily: ahead and to the left in N, counter-clockwise in N·m, until changed.
    pub fn set_push(&mut self, ahead: f64, left: f64, turn: f64) {
        self.plant.set_push(ahead, left, turn);
    }

    /// Lifts the vehicle and sets it down elsewhere, standing.
    pub fn place(&mut self, world: &mut World, pose: Pose) {
        self.plant.place(world, pose);
    }
}

impl Unit for R150 {
    fn receive(&mut self, now: SimTime, _link: usize, bytes: &[u8]) {
        self.device.receive(now, bytes);
    }

    fn advance(&mut self, now: SimTime) {
        self.device.advance(now);
    }

    fn next_deadline(&self) -> Option<SimTime> {
        self.device.next_deadline()
    }

    fn expect_burst(&mut self, by: Duration, until: SimTime) {
        self.device.expect_burst(by, until);
    }

    fn has_news(&self) -> bool {
        self.device.has_news() || self.watch.has_news()
    }

    fn settle(&mut self, now: SimTime) {
        for _ in 0..MOST_ROUNDS {
            self.device.sense(now, &self.plant.measurements());
            let commands = self.device.commands();
            if commands == *self.plant.commands() {
                break;
            }
            self.plant.set_commands(&commands);
            // What the module has drawn is gone with it, so that the supply may be back at once. It
            // would come and go for ever; so it stays off until somebody looks again.
            if !self.device.has_supply() {
                break;
            }
        }
        self.watch.look(now, self.plant.health());
    }

    fn client_left(&mut self, now: SimTime, _link: usize) {
        self.device.client_left(now);
    }

    fn poll_output(&mut self) -> Option<(usize, Vec<u8>)> {
        self.device.poll_output().map(|frame| (0, frame))
    }

    fn poll_event(&mut self) -> Option<(SimTime, Arc<dyn EventKind>)> {
        if let Some((at, event)) = self.device.poll_event() {
            return Some((at, Arc::new(event)));
        }
        let (at, event) = self.watch.poll()?;
        Some((at, Arc::new(event)))
    }

    fn distance_m(&self) -> f64 {
        self.plant.truth().distance
    }

    fn at_rest(&self) -> bool {
        self.plant.at_rest()
    }

    fn wake(&mut self) {
        self.plant.wake();
    }

    fn rest_until(&mut self, now: SimTime) {
        if now > self.plant_at {
            self.plant.rest(now.since(self.plant_at));
            self.plant_at = now;
        }
    }

    fn before_step(&mut self, world: &mut World) {
        self.plant.before_step(world);
    }

    fn after_step(&mut self, now: SimTime, _step: Duration, world: &mut World) {
        self.plant.after_step(world);
        self.plant_at = now;
    }
}
