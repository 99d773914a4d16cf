//! A mecanum car: the firmware of [`crate::mecanum_device`] with the hardware of
//! [`sim_physics::mecanum`].

pub mod event;

use std::sync::Arc;
use std::time::Duration;

use sim_physics::mecanum::{MecanumPlant, MecanumTruth};
use sim_physics::{BodyId, Pose, World};
use sim_settings::SimTime;

use crate::defects::Defects;
use crate::event::EventKind;
use crate::mecanum_device::settings::PulseDirection;
use crate::mecanum_device::{Action, Link, MecanumDevice};
use crate::settings::MecanumSettings;
use crate::unit::Unit;

/// Rounds in which pins and measurements may chase one another at one instant; what is not settled
/// then goes on at the next one.
const MOST_ROUNDS: usize = 8;

/// Firmware and hardware of one car.
#[derive(Debug)]
pub struct Mecanum {
    device: MecanumDevice,
    plant: MecanumPlant,
    /// Up to when the plant's slow states have advanced.
    plant_at: SimTime,
}

impl Mecanum {
    /// A car that has just been switched on, standing at `pose`; `ros_configured` says whether its
    /// second UART is the ROS link instead of the magnetic sensor's.
    #[must_use]
    pub fn new(
        name: &str,
        settings: &MecanumSettings,
        ros_configured: bool,
        pose: Pose,
        world: &mut World,
    ) -> Self {
        let plant = settings.plant.expecting(settings.firmware.wiring);
        let mut plant = MecanumPlant::with_name(name, &plant, world, pose);
        plant.set_directed_encoders(settings.firmware.pulse_direction == PulseDirection::Counted);
        let firmware = settings.firmware.clone();
        let measured = plant.measurements();
        let device = MecanumDevice::new(SimTime::ZERO, firmware, ros_configured, measured);
        let mut car = Self {
            device,
            plant,
            plant_at: SimTime::ZERO,
        };
        car.settle(SimTime::ZERO);
        car
    }

    /// Somebody works the remote control.
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
    pub fn device(&self) -> &MecanumDevice {
        &self.device
    }

    /// How things really are.
    #[must_use]
    pub fn truth(&self) -> MecanumTruth {
        self.plant.truth()
    }

    /// Its body in the world, for contact queries.
    #[must_use]
    pub fn body(&self) -> BodyId {
        self.plant.body()
    }

    /// The hardware, to look at.
    #[must_use]
    pub fn plant(&self) -> &MecanumPlant {
        &self.plant
    }

    /// The hardware, to load, push or break it.
    pub fn plant_mut(&mut self) -> &mut MecanumPlant {
        &mut self.plant
    }
}

impl Unit for Mecanum {
    fn receive(&mut self, now: SimTime, link: usize, bytes: &[u8]) {
        if let Some(link) = Link::from_index(link) {
            self.device.receive(now, link, bytes);
        }
    }

    fn advance(&mut self, now: SimTime) {
        self.device.advance(now);
    }

    fn next_deadline(&self) -> Option<SimTime> {
        self.device.next_deadline()
    }

    fn expect_burst(&mut self, _by: Duration, _until: SimTime) {
        // The board has no rule for how closely packets may follow one another.
    }

    fn has_news(&self) -> bool {
        self.device.has_news()
    }

    fn settle(&mut self, now: SimTime) {
        for _ in 0..MOST_ROUNDS {
            self.device.sense(now, &self.plant.measurements());
            let commands = self.device.commands();
            if commands == *self.plant.commands() {
                break;
            }
            self.plant.set_commands(&commands);
        }
    }

    fn poll_output(&mut self) -> Option<(usize, Vec<u8>)> {
        self.device
            .poll_output()
            .map(|(link, bytes)| (link.index(), bytes))
    }

    fn poll_event(&mut self) -> Option<(SimTime, Arc<dyn EventKind>)> {
        let (at, event) = self.device.poll_event()?;
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
