//! An R150: the firmware of [`crate::r150_device`] with the hardware of [`rigsim_physics::r150`].

mod actions;
mod faults;
mod host;
mod names;
mod settings;
mod watch;

use std::time::Duration;

use rigsim_physics::r150::{R150Plant, R150Truth};
use rigsim_physics::{Plant, World};
use rigsim_settings::SimTime;

use crate::defects::{DefectCounts, Defects};
use crate::device::names::COMMON;
use crate::device::{
    Device, DeviceSpec, Framing, LinkSpec, MotorState, Setup, StartSpec, Sum, effects, typed,
};
use crate::effect;
use crate::event::EventKind;
use crate::firmware::Firmware;
use crate::message::Message;
use crate::noise::Noise;
use crate::r150_device::command::{REPLIES, Reply, Request, code};
use crate::r150_device::vehicle::{OperatorInput, Start};
use crate::r150_device::{R150Device, codec, event};
pub use settings::R150Settings;
use watch::Watch;

/// The XAG R150.
pub static R150_SPEC: DeviceSpec = DeviceSpec {
    id: "r150",
    title: "an R150",
    about: "XAG R150 unmanned ground vehicle, through its RS-232 IO module",
    links: &[LinkSpec {
        id: "main",
        name: "RS-232",
        optional: None,
        framing: FRAMES,
    }],
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
    compare_first: &[
        "baud",
        "reply_delay",
        "boot_time",
        "hardware_version",
        "software_version",
        "heartbeat_timeout",
        "motor_watchdog",
        "control_at_power_on",
        "motors_answered",
        "body.mass",
        "body.length",
        "body.width",
        "body.wheelbase",
        "body.track",
        "tyre.wheel_radius",
        "motor.current_limit",
        "motor.ramp_up",
        "motor.ramp_down",
        "battery.capacity",
        "battery.initial_soc",
    ],
    build: |setup, world| Box::new(R150::new(setup, world)),
    codes: event::CODES,
    names: &[COMMON, names::NAMES, names::STATUS, names::RAILS],
    messages: &[Request::INFOS, REPLIES],
    host: host::HOST,
    effects: &[
        effect::FIRMWARE,
        effect::MOTORS,
        effects::<faults::R150Fault>(),
        effects::<OperatorInput>(),
        effects::<actions::Surroundings>(),
    ],
    check_scope: faults::check_scope,
};

const FRAMES: Framing = Framing {
    form: codec::FORM,
    name: |frame| match codec::parts(frame) {
        Some((command, _)) => format!("the reply to 0x{command:02X}"),
        None => "a frame".to_owned(),
    },
    unasked: || {
        let command = code::Heartbeat;
        let success = true;
        Reply::Bool { command, success }.encode()
    },
};

/// Rounds in which pins and measurements may chase one another at one instant; what is not settled
/// then goes on at the next one.
const MOST_ROUNDS: usize = 8;

/// Firmware and hardware of one R150.
#[derive(Debug)]
pub struct R150 {
    /// The firmware.
    pub device: R150Device,
    /// The hardware.
    pub plant: R150Plant,
    watch: Watch,
}

impl R150 {
    /// A vehicle that has just been switched on.
    fn new(setup: &Setup<'_>, world: &mut World) -> Self {
        let &Setup { name, seed, .. } = setup;
        let settings = typed::<R150Settings>(setup.settings).clone();
        let start = match setup.start {
            0 => Start::Ready,
            _ => Start::Locked,
        };
        let plant = R150Plant::new(name, &settings.plant, world, setup.pose);
        let noise = Noise::new(seed, &format!("{name}.noise"));
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
            watch: Watch::default(),
        };
        vehicle.exchange_signals(SimTime::ZERO, Duration::ZERO);
        vehicle
    }

    /// Returns the true state of the vehicle.
    #[must_use]
    pub fn truth(&self) -> R150Truth {
        self.plant.truth()
    }
}

impl Device for R150 {
    fn receive(&mut self, now: SimTime, _link: usize, bytes: &[u8]) {
        self.device.handle_bytes(now, bytes);
    }

    fn advance(&mut self, now: SimTime) {
        self.device.advance(now);
    }

    fn next_deadline(&self) -> Option<SimTime> {
        self.device.next_deadline()
    }

    fn late(&mut self, now: SimTime, by: Duration, stood: Duration) {
        self.device.late(now, by, stood);
    }

    fn has_output(&self) -> bool {
        self.device.has_output() || self.watch.has_output()
    }

    fn exchange_signals(&mut self, now: SimTime, passed: Duration) {
        for _ in 0..MOST_ROUNDS {
            self.device.sense(now, &self.plant.measurements());
            let commands = self.device.commands();
            if commands == *self.plant.commands() {
                break;
            }
            self.plant.pass_to(passed);
            self.plant.set_commands(&commands);
            // What the module has drawn is gone with it, so that the supply may be back at once. It
            // would come and go for ever; so it stays off until it is asked again.
            if !self.device.has_supply() {
                break;
            }
        }
        self.watch.look(now, self.plant.health());
    }

    fn poll_output(&mut self) -> Option<(usize, Vec<u8>)> {
        self.device.poll_output().map(|frame| (0, frame))
    }

    fn poll_event(&mut self) -> Option<(SimTime, EventKind)> {
        self.device.poll_event().or_else(|| self.watch.poll())
    }

    fn plant(&self) -> &dyn Plant {
        &self.plant
    }

    fn plant_mut(&mut self) -> &mut dyn Plant {
        &mut self.plant
    }

    fn no_faults(&self) -> Sum {
        Sum::new(faults::USUAL_DRAG, faults::Layer::default())
    }

    fn set_faults(&mut self, now: SimTime, sum: &Sum) {
        self.set_layer(now, sum);
    }

    fn motors(&self) -> [MotorState; 4] {
        self.motor_states()
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
}
