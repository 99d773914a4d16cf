//! A custom device beside those that ship: a small robot with two wheels and a protocol of
//! lines. `docs/devices.md` walks through it.
//!
//! | line | reply |
//! |---|---|
//! | `S left right` sets the wheels' speeds, mm/s, −500 to 500 | `OK` |
//! | `O` reads the odometry | `O left right`, mm |
//! | `B` reads the battery | `B volts`, mV |
//! | anything else | `E` |

use std::collections::VecDeque;
use std::process::ExitCode;
use std::time::Duration;

use rigsim_core::SimTime;
use rigsim_core::device::host::{Frame, FrameReader, Message};
use rigsim_core::device::names::COMMON;
use rigsim_core::device::{
    Begin, Device, DeviceSettings, DeviceSpec, Devices, Effect, EffectError, Form, Framing,
    HostSpec, LinkSpec, OnHardware, Setup, Sum, Tally, Work, effects, typed,
};
use rigsim_core::event::{Code, EventKind, code};
use rigsim_core::mecanum::MECANUM_SPEC;
use rigsim_core::message::{FieldInfo, MessageInfo, Sender};
use rigsim_core::r150::R150_SPEC;
use rigsim_physics::{Plant, World};
use rigsim_settings::Voltage;
use schemars::JsonSchema;
use serde::Deserialize;

#[path = "robot/differential.rs"]
mod differential;

use differential::{Differential, DifferentialShape};

const MOST_LINE: usize = 64;

/// The robot, and the devices that ship.
pub const DEVICES: Devices = &[&ROBOT, &R150_SPEC, &MECANUM_SPEC];

fn main() -> ExitCode {
    rigsim_cli::main(DEVICES)
}

static ROBOT: DeviceSpec = DeviceSpec {
    id: "robot",
    title: "a robot",
    about: "Small robot with two wheels and a protocol of lines",
    links: &[LinkSpec {
        id: "main",
        name: "main",
        optional: None,
        framing: Framing {
            form: Form::Lines,
            name: |_| "a reply".to_owned(),
            unasked: || b"OK\n".to_vec(),
        },
    }],
    starts: &[],
    settings: || Box::new(RobotSettings::default()),
    compare_first: &["baud", "battery"],
    build: |setup, world| Box::new(Robot::new(setup, world)),
    codes: CODES,
    messages: &[&REPLIES],
    names: &[COMMON],
    host: HostSpec {
        read: |value, _| Ok(rigsim_settings::read::<Command>(value)?.message()),
        schema: |generator| vec![Command::json_schema(generator)],
        frames: |_, sender, _| Box::new(Lines(Vec::new(), sender)),
        plan: "",
        stop: "",
        chatters: false,
    },
    effects: &[effects::<RobotFault>()],
    check_scope: |_| Ok(()),
};

rigsim_settings::settings! {
    /// The robot.
    pub struct RobotSettings {
        /// Speed of its serial port.
        baud: u32 = 57_600, unit "baud", range 1200..=1_000_000, assumed "a common one";
        /// Silence after which the wheels stop.
        watchdog: Duration = Duration::from_millis(500),
            range Duration::from_millis(10)..=Duration::from_secs(60), assumed "half a second";
        /// Voltage of the battery.
        battery: f64 = 11.8, unit "V", range 6.0..=12.6, assumed "three cells";
    }
}

impl DeviceSettings for RobotSettings {
    fn baud(&self, _link: usize) -> u32 {
        self.baud
    }
}

rigsim_core::codes! {
    /// A line that is not a command.
    BAD_LINE = "bad_line", Warning, ClientUnlessDisturbed;
    /// The wheels were stopped since nothing came.
    WATCHDOG_FIRED = "watchdog_fired", Warning, ClientUnlessDisturbedOrLate;
}

rigsim_core::faults! {
    /// What can break in a robot only.
    pub enum RobotFault {
        /// A cell of the battery is dead; it is well again at the end.
        DeadCell = "dead-cell", Electrical,
        sees "A lower voltage in `B`.",
        counts "The battery was asked for.",
        {
            /// Voltage that is missing.
            by: Voltage,
        }
    }
}

impl Effect for RobotFault {
    fn begin(&self, at: &mut Begin<'_>) -> Result<Work, EffectError> {
        if let Some(robot) = at.device.get::<Robot>() {
            at.tally.count_from(robot.asked);
        }
        Ok(Work::Hardware(Box::new(self.clone())))
    }
}

impl OnHardware for RobotFault {
    fn add(&self, sum: &mut Sum) {
        let Self::DeadCell { by } = self;
        if let Some(missing) = sum.own_mut::<Missing>() {
            missing.0 += by.0;
        }
    }

    fn watch(&mut self, device: &dyn Device, tally: &mut Tally) {
        if let Some(robot) = device.get::<Robot>() {
            tally.count_to(robot.asked, || "the battery was asked for".to_owned());
        }
    }
}

/// What dead cells together take from the battery, V.
#[derive(Debug, Default)]
struct Missing(f64);

/// Replies, each behind its letter.
static REPLIES: [MessageInfo; 3] = [
    reply(
        b'S',
        "speeds",
        const {
            &[FieldInfo {
                name: "ok",
                ..FieldInfo::new::<bool>()
            }]
        },
    ),
    reply(
        b'O',
        "odometry",
        const {
            &[
                FieldInfo::decimal("", "left", "Way of the left wheel.", "mm"),
                FieldInfo::decimal("", "right", "Way of the right wheel.", "mm"),
            ]
        },
    ),
    reply(
        b'B',
        "battery",
        const { &[FieldInfo::decimal("", "volts", "Voltage.", "mV")] },
    ),
];

const fn reply(letter: u8, name: &'static str, fields: &'static [FieldInfo]) -> MessageInfo {
    MessageInfo::new(Sender::Device, 0, fields).named(letter, name, "")
}

/// Commands of a scripted client.
#[derive(Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
enum Command {
    /// Robot: the wheels' speeds, mm/s.
    Speeds { left: i32, right: i32 },
    /// Robot: how far the wheels have rolled.
    Odometry,
    /// Robot: the battery's voltage.
    Battery,
}

impl Command {
    fn message(&self) -> Message {
        let line = match self {
            Self::Speeds { left, right } => format!("S {left} {right}\n"),
            Self::Odometry => "O\n".to_owned(),
            Self::Battery => "B\n".to_owned(),
        };
        Message {
            link: 0,
            command: line.bytes().next(),
            bytes: line.into_bytes(),
        }
    }
}

struct Lines(Vec<u8>, Sender);

impl FrameReader for Lines {
    fn push(&mut self, _now: SimTime, byte: u8) -> Vec<Frame> {
        self.0.push(byte);
        self.0.truncate(MOST_LINE);
        if byte != b'\n' {
            return Vec::new();
        }
        let bytes = std::mem::take(&mut self.0);
        let line = bytes.trim_ascii_end();
        let [done, odometry, battery] = &REPLIES;
        let (info, payload) = match line.split_first() {
            Some((b'O', numbers)) => (odometry, numbers.to_vec()),
            Some((b'B', numbers)) => (battery, numbers.to_vec()),
            _ => (done, vec![u8::from(line == b"OK")]),
        };
        let message = Some((info, payload)).filter(|_| self.1 == Sender::Device);
        let command = message.as_ref().map(|(info, _)| info.id);
        vec![Frame {
            bytes,
            command,
            command_byte: None,
            message,
        }]
    }
}

/// Firmware and body.
struct Robot {
    settings: RobotSettings,
    body: Differential,
    line: Vec<u8>,
    /// mm/s.
    speeds: [i32; 2],
    stop_due: Option<SimTime>,
    /// V.
    missing: f64,
    /// Number of times that the battery was asked for while cells were dead.
    asked: u64,
    output: VecDeque<Vec<u8>>,
    events: VecDeque<(SimTime, EventKind)>,
}

impl Robot {
    fn new(setup: &Setup<'_>, world: &mut World) -> Self {
        Self {
            settings: typed::<RobotSettings>(setup.settings).clone(),
            body: Differential::new(setup.name, DifferentialShape::default(), world, setup.pose),
            line: Vec::new(),
            speeds: [0; 2],
            stop_due: None,
            missing: 0.0,
            asked: 0,
            output: VecDeque::new(),
            events: VecDeque::new(),
        }
    }

    /// Handles a line; returns the reply if it is a command.
    fn obey(&mut self, now: SimTime, line: &str) -> Option<String> {
        match line.split(' ').collect::<Vec<_>>()[..] {
            ["S", left, right] => {
                let speeds = [left.parse().ok()?, right.parse().ok()?];
                let allowed = speeds.iter().all(|speed| (-500..=500).contains(speed));
                self.speeds = allowed.then_some(speeds)?;
                self.stop_due = Some(now + self.settings.watchdog);
                Some("OK".to_owned())
            }
            ["O"] => {
                let [left, right] = self.body.travel().map(|m| (m * 1000.0).round());
                Some(format!("O {left} {right}"))
            }
            ["B"] => {
                self.asked += u64::from(self.missing > 0.0);
                let volts = (self.settings.battery - self.missing).max(0.0);
                Some(format!("B {}", (volts * 1000.0).round()))
            }
            _ => None,
        }
    }

    fn emit(&mut self, at: SimTime, code: Code, text: String) {
        self.events.push_back((at, EventKind::new(code, text)));
    }
}

impl Device for Robot {
    fn receive(&mut self, now: SimTime, _link: usize, bytes: &[u8]) {
        for &byte in bytes {
            if byte != b'\n' {
                self.line.push(byte);
                self.line.truncate(MOST_LINE);
            } else {
                let line = std::mem::take(&mut self.line);
                let line = line.escape_ascii().to_string();
                let reply = self.obey(now, &line);
                match reply {
                    Some(_) => self.emit(now, code::REQUEST, line),
                    None => self.emit(now, BAD_LINE, format!("no command: {line}")),
                }
                let reply = reply.unwrap_or_else(|| "E".to_owned());
                self.output.push_back(format!("{reply}\n").into_bytes());
                self.emit(now, code::REPLY, reply);
            }
        }
    }

    fn advance(&mut self, now: SimTime) {
        if self.next_deadline().is_some_and(|due| due <= now) {
            self.stop_due = None;
            if std::mem::take(&mut self.speeds) != [0; 2] {
                let text = "no speeds in time: the wheels stop".to_owned();
                self.emit(now, WATCHDOG_FIRED, text);
            }
        }
    }

    fn next_deadline(&self) -> Option<SimTime> {
        self.stop_due
    }

    fn has_output(&self) -> bool {
        !self.output.is_empty() || !self.events.is_empty()
    }

    fn exchange_signals(&mut self, _now: SimTime, _passed: Duration) {
        self.body
            .set_speeds(self.speeds.map(|speed| f64::from(speed) / 1000.0));
    }

    fn poll_output(&mut self) -> Option<(usize, Vec<u8>)> {
        Some((0, self.output.pop_front()?))
    }

    fn poll_event(&mut self) -> Option<(SimTime, EventKind)> {
        self.events.pop_front()
    }

    fn plant(&self) -> &dyn Plant {
        &self.body
    }

    fn plant_mut(&mut self) -> &mut dyn Plant {
        &mut self.body
    }

    fn no_faults(&self) -> Sum {
        Sum::new(0.0, Missing::default())
    }

    fn set_faults(&mut self, _now: SimTime, sum: &Sum) {
        self.missing = sum.own::<Missing>().map_or(0.0, |missing| missing.0);
    }
}
