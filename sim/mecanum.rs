//! A mecanum car: the firmware of [`crate::mecanum_device`] with the hardware of
//! [`rigsim_physics::mecanum`].

mod actions;
mod faults;
mod host;
mod names;
mod settings;

use std::time::Duration;

use rigsim_physics::mecanum::{MecanumFaults, MecanumPlant, MecanumTruth};
use rigsim_physics::{Plant, World};
use rigsim_settings::SimTime;

use crate::defects::{DefectCounts, Defects};
use crate::device::names::COMMON;
use crate::device::{
    Device, DeviceSpec, Form, Framing, LinkSpec, MotorState, Setup, Sum, effects, typed,
};
use crate::effect;
use crate::event::EventKind;
use crate::firmware::Firmware;
use crate::mecanum_device::ascii::{COMMANDS, REPORTS};
use crate::mecanum_device::packet::{Request, Status};
use crate::mecanum_device::{Link, MecanumDevice, OperatorInput, codec, event};
use crate::message::Message;
use crate::noise::Noise;
pub use settings::MecanumSettings;

/// The mecanum car.
pub static MECANUM_SPEC: DeviceSpec = DeviceSpec {
    id: "mecanum",
    title: "a mecanum car",
    about: "Mecanum car on the rayland-dual board: binary link, and ASCII link with --ros-pty",
    links: &[
        LinkSpec {
            id: "main",
            name: "main",
            optional: None,
            framing: Framing {
                form: codec::FORM,
                name: |packet| match packet.get(2) {
                    Some(number) => format!("status packet {number}"),
                    None => "a frame".to_owned(),
                },
                unasked: || Status::default().encode(),
            },
        },
        LinkSpec {
            id: "ros",
            name: "ROS",
            optional: Some("this takes the UART of its magnetic sensor"),
            framing: Framing {
                form: Form::Lines,
                name: |_| "a report line".to_owned(),
                unasked: || b"V0 S0 \n".to_vec(),
            },
        },
    ],
    starts: &[],
    settings: || Box::new(MecanumSettings::default()),
    compare_first: &[
        "baud",
        "ros_baud",
        "byte_order",
        "status_period",
        "queue_length",
        "link_timeout",
        "motion_pause",
        "positive_turn",
        "positive_strafe",
        "ascii_letters",
        "full_speed",
        "odometry.pulses_per_revolution",
        "odometry.wheel_radius",
        "body.mass",
        "body.half_wheelbase",
        "body.half_track",
        "wheel.radius",
        "motor.full_speed",
        "encoder.pulses_per_revolution",
        "ultrasonic.range",
    ],
    build: |setup, world| Box::new(Mecanum::new(setup, world)),
    codes: event::CODES,
    names: &[COMMON, names::NAMES, names::ECHOES],
    messages: &[Request::INFOS, Status::INFOS, &COMMANDS, &REPORTS],
    host: host::HOST,
    effects: &[
        effect::FIRMWARE,
        effect::MOTORS,
        effects::<faults::MecanumFault>(),
        effects::<OperatorInput>(),
    ],
    check_scope: faults::check_scope,
};

/// Rounds in which pins and measurements may chase one another at one instant; what is not settled
/// then goes on at the next one.
const MOST_ROUNDS: usize = 8;
/// Least time between two looks at the pulses. Those within it are taken together: of wheels that turn
/// alike, and of encoders that give more than 100,000 a second.
const BETWEEN_PULSES: Duration = Duration::from_micros(10);

/// Firmware and hardware of one car.
#[derive(Debug)]
pub struct Mecanum {
    /// The firmware.
    pub device: MecanumDevice,
    /// The hardware.
    pub plant: MecanumPlant,
    /// Times at which the last pulse of a wheel was taken, and the next one is to be.
    pulse_taken: SimTime,
    pulse_due: Option<SimTime>,
}

impl Mecanum {
    /// A car that has just been switched on; with two links its second UART is the ROS link
    /// instead of the magnetic sensor's.
    fn new(setup: &Setup<'_>, world: &mut World) -> Self {
        let MecanumSettings { firmware, plant } = typed::<MecanumSettings>(setup.settings).clone();
        let mut plant = MecanumPlant::new(setup.name, &plant, world, setup.pose);
        let chance = format!("{}.ultrasonic", setup.name);
        plant.set_chance(Noise::new(setup.seed, &chance));
        let measured = plant.measurements();
        let device = MecanumDevice::new(SimTime::ZERO, firmware, setup.links > 1, measured);
        let mut car = Self {
            device,
            plant,
            pulse_taken: SimTime::ZERO,
            pulse_due: None,
        };
        car.exchange_signals(SimTime::ZERO, Duration::ZERO);
        car
    }

    /// Returns the true state of the car.
    #[must_use]
    pub fn truth(&self) -> MecanumTruth {
        self.plant.truth()
    }
}

impl Device for Mecanum {
    fn receive(&mut self, now: SimTime, link: usize, bytes: &[u8]) {
        if let Some(link) = Link::ALL.get(link) {
            self.device.handle_bytes(now, *link, bytes);
        }
    }

    fn advance(&mut self, now: SimTime) {
        self.device.advance(now);
    }

    fn next_deadline(&self) -> Option<SimTime> {
        [self.device.next_deadline(), self.pulse_due]
            .into_iter()
            .flatten()
            .min()
    }

    fn has_output(&self) -> bool {
        self.device.has_output()
    }

    fn exchange_signals(&mut self, now: SimTime, passed: Duration) {
        if self.pulse_due.is_some_and(|due| due <= now) {
            self.plant.pass_to(passed);
            self.pulse_taken = now;
        }
        for _ in 0..MOST_ROUNDS {
            self.device.sense(now, &self.plant.measurements());
            let commands = self.device.commands();
            if commands == *self.plant.commands() {
                break;
            }
            self.plant.pass_to(passed);
            self.plant.set_commands(&commands);
        }
        let next = self.plant.next_pulse().map(|at| now - passed + at);
        let soonest = (now + Duration::from_nanos(1)).max(self.pulse_taken + BETWEEN_PULSES);
        self.pulse_due = next.map(|due| due.max(soonest));
    }

    fn poll_output(&mut self) -> Option<(usize, Vec<u8>)> {
        self.device
            .poll_output()
            .map(|(link, bytes)| (link.index(), bytes))
    }

    fn poll_event(&mut self) -> Option<(SimTime, EventKind)> {
        self.device.poll_event()
    }

    fn plant(&self) -> &dyn Plant {
        &self.plant
    }

    fn plant_mut(&mut self) -> &mut dyn Plant {
        &mut self.plant
    }

    fn no_faults(&self) -> Sum {
        Sum::new(faults::USUAL_DRAG, MecanumFaults::default())
    }

    fn set_faults(&mut self, _now: SimTime, sum: &Sum) {
        self.set_layer(sum);
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

    fn check_watchdog(&self) -> Result<(), String> {
        if self.device.has_watchdog() {
            return Ok(());
        }
        let why = "this car has no watchdog that could fail: its `link_timeout` is \"off\"";
        Err(why.to_owned())
    }

    fn reset(&mut self, now: SimTime, boot: Duration) -> bool {
        self.device.reset(now, boot)
    }
}
