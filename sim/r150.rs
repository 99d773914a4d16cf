//! An R150: the firmware of [`crate::r150_device`] with the hardware of [`sim_physics::r150`].

mod actions;
pub mod event;
mod faults;
mod framing;
mod host;
mod names;
mod settings;
mod watch;

use std::sync::Arc;
use std::time::Duration;

use sim_physics::r150::{R150Plant, R150Truth, Rail};
use sim_physics::{Plant, Pose, World};
use sim_settings::SimTime;

use crate::defects::{DefectCounts, Defects};
use crate::device::names::MOTION;
use crate::device::{Device, DeviceSpec, Framing, LinkSpec, Setup, StartSpec};
use crate::event::EventKind;
use crate::fault::parameters::{Key, RailName};
use crate::noise::Noise;
use crate::r150_device::R150Device;
use crate::r150_device::vehicle::{self, OperatorInput, Start};
use crate::rig::Rig;
pub use settings::R150Settings;
use watch::Watch;

/// The XAG R150.
pub static R150_SPEC: DeviceSpec = DeviceSpec {
    id: "r150",
    title: "an R150",
    about: "XAG R150 unmanned ground vehicle, through its RS-232 IO module",
    links: &[LinkSpec::always("main", "RS-232")],
    starts: &[
        StartSpec {
            id: "ready",
            about: "Unlocked, brake released, autonomous: the first motor command moves it",
        },
        StartSpec {
            id: "locked",
            about: "Locked, parked, in remote mode, as the hardware starts",
        },
    ],
    settings: || Box::new(R150Settings::default()),
    build: |setup, world| Box::new(R150::new(setup, world)),
    codes: event::CODES,
    names: &[MOTION, names::NAMES],
    observer: || Box::new(names::Noted::default()),
    host: host::HOST,
    operator: Some(actions::OPERATOR),
    surroundings: Some(actions::SURROUNDINGS),
    faults: &[
        "bad-crc",
        "reset",
        "hang",
        "slow-replies",
        "stuck-status",
        "frozen-sensors",
        "watchdog-off",
        "rail-load",
        "rail-short",
        "rail-open",
        "supply-sag",
        "over-temperature",
        "power-module-fault",
        "battery-empty",
        "charge-drop",
        "fuse-blown",
        "can-failing",
        "blocked",
        "dragging",
        "free-wheeling",
        "encoder-lost",
        "encoder-stuck",
        "encoder-noisy",
        "wired-backwards",
        "sides-swapped",
        "brake-stuck-on",
        "brake-stuck-open",
        "emergency-stop",
        "remote-control-takes-over",
        "locked",
        "parked",
        "app-takes-control",
    ],
    check_fault: faults::check,
};

/// Puts an R150 into the world of a rig; gives its index. Its one link has index 0.
pub fn add(rig: &mut Rig, name: &str, settings: &R150Settings, start: Start, pose: Pose) -> usize {
    let setup = Setup {
        name,
        settings,
        start: start as usize,
        links: 1,
        pose,
        seed: 0,
    };
    rig.add(&R150_SPEC, &setup)
}

/// The bits of outputs.
fn bits(rails: &[RailName]) -> u8 {
    let bit = |name: &RailName| 1 << rail(*name).index();
    rails.iter().map(bit).fold(0, |bits, bit| bits | bit)
}

fn rail(name: RailName) -> Rail {
    Rail::ALL[name as usize]
}

fn key(key: Key) -> vehicle::Key {
    match key {
        Key::Forward => vehicle::Key::Forward,
        Key::Backward => vehicle::Key::Backward,
        Key::Left => vehicle::Key::Left,
        Key::Right => vehicle::Key::Right,
    }
}

/// Rounds in which pins and measurements may chase one another at one instant; what is not settled
/// then goes on at the next one.
const MOST_ROUNDS: usize = 8;

/// Firmware and hardware of one R150.
#[derive(Debug)]
pub struct R150 {
    device: R150Device,
    plant: R150Plant,
    faults: faults::Faults,
    /// Up to when the plant's slow states have advanced.
    plant_at: SimTime,
    watch: Watch,
}

impl R150 {
    /// A vehicle that has just been switched on.
    fn new(setup: &Setup<'_>, world: &mut World) -> Self {
        let &Setup { name, seed, .. } = setup;
        let settings = setup
            .settings
            .get::<R150Settings>()
            .cloned()
            .unwrap_or_default();
        let start = match setup.start {
            0 => Start::Ready,
            _ => Start::Locked,
        };
        let plant = R150Plant::with_name(name, &settings.plant, world, setup.pose);
        let noise = Noise::new(seed, &format!("{name}.measurement_noise"));
        let reply_time = Noise::new(seed, &format!("{name}.reply_time"));
        let device = R150Device::new(
            settings.firmware,
            start,
            plant.measurements(),
            noise,
            reply_time,
        );
        let mut vehicle = Self {
            device,
            plant,
            faults: faults::Faults::default(),
            plant_at: SimTime::ZERO,
            watch: Watch::default(),
        };
        vehicle.settle(SimTime::ZERO);
        vehicle
    }

    /// Somebody works a button.
    pub fn operate(&mut self, now: SimTime, action: OperatorInput) {
        self.device.operate(now, action);
    }

    /// The firmware's state.
    #[must_use]
    pub fn device(&self) -> &R150Device {
        &self.device
    }

    /// Returns the true state of the vehicle.
    #[must_use]
    pub fn truth(&self) -> R150Truth {
        self.plant.truth()
    }

    /// The hardware, to look at.
    #[must_use]
    pub fn plant(&self) -> &R150Plant {
        &self.plant
    }

    /// The hardware, to load or break it.
    pub fn plant_mut(&mut self) -> &mut R150Plant {
        &mut self.plant
    }
}

impl Device for R150 {
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
            self.plant.pass_to(now.since(self.plant_at));
            self.plant.set_commands(&commands);
            // What the module has drawn is gone with it, so that the supply may be back at once. It
            // would come and go for ever; so it stays off until somebody looks again.
            if !self.device.has_supply() {
                break;
            }
        }
        self.watch.look(now, self.plant.health());
    }

    fn poll_output(&mut self) -> Option<(usize, Vec<u8>)> {
        self.device.poll_output().map(|frame| (0, frame))
    }

    fn poll_event(&mut self) -> Option<(SimTime, Arc<dyn EventKind>)> {
        if let Some((at, event)) = self.device.poll_event() {
            return Some((at, Arc::new(event)));
        }
        self.watch.poll()
    }

    fn plant(&self) -> &dyn Plant {
        &self.plant
    }

    fn plant_mut(&mut self) -> &mut dyn Plant {
        &mut self.plant
    }

    fn rest_until(&mut self, now: SimTime) {
        if now > self.plant_at {
            self.plant.rest(now.since(self.plant_at));
            self.plant_at = now;
        }
    }

    fn after_step(&mut self, now: SimTime, world: &mut World) {
        self.plant.after_step(world);
        self.plant_at = now;
    }

    fn set_defects(&mut self, now: SimTime, defects: Defects) {
        self.device.set_defects(now, defects);
    }

    fn defect_counts(&self) -> DefectCounts {
        *self.device.defect_counts()
    }

    fn reset(&mut self, now: SimTime, boot: Duration) -> bool {
        self.device.reset(now, boot)
    }

    fn framing(&self, _link: usize) -> &'static dyn Framing {
        &framing::Frames
    }
}
