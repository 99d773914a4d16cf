//! A device of one's own beside those that ship: a small robot with two wheels and a protocol of
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
use std::sync::Arc;
use std::time::Duration;

use schemars::JsonSchema;
use serde::Deserialize;
use sim_core::SimTime;
use sim_core::device::host::{Field, Message, Reply, ReplyReader};
use sim_core::device::names::MOTION;
use sim_core::device::{
    Breakable, Device, DeviceSettings, DeviceSpec, Devices, Framing, HostSpec, LineSettings,
    LinkSpec, NameInfo, Setup, TextLines,
};
use sim_core::event::{Code, EventKind, Role, Told, code};
use sim_core::mecanum::MECANUM_SPEC;
use sim_core::r150::R150_SPEC;
use sim_physics::differential::{Differential, DifferentialShape};
use sim_physics::{Plant, World};

const MOST_LINE: usize = 64;

/// The robot, and the devices that ship.
pub const DEVICES: Devices = &[&ROBOT, &R150_SPEC, &MECANUM_SPEC];

fn main() -> ExitCode {
    sim_cli::main(DEVICES)
}

static ROBOT: DeviceSpec = DeviceSpec {
    id: "robot",
    title: "a robot",
    about: "Small robot with two wheels and a protocol of lines",
    links: &[LinkSpec::always("main", "main")],
    starts: &[],
    settings: || Box::new(RobotSettings::default()),
    build: |setup, world| Box::new(Robot::new(setup, world)),
    codes: CODES,
    names: &[MOTION, NAMES],
    observer: || Box::new(()),
    host: HostSpec {
        read: |value, _| Ok(Command::deserialize(value)?.message()),
        schema: Command::json_schema,
        fields: |_, _| vec!["ok", "left", "right", "volts"],
        reader: |_, _| Box::new(Replies(Vec::new())),
        chatters: false,
    },
    operator: None,
    surroundings: None,
    faults: &[],
    check_fault: |_| Ok(()),
};

sim_settings::settings! {
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
    fn line(&self, _link: usize) -> LineSettings {
        LineSettings::at(self.baud)
    }
}

sim_core::codes! {
    /// A line that is no command.
    BAD_LINE = "bad_line", ClientUnlessDisturbed;
    /// The wheels were stopped since nothing came.
    WATCHDOG_FIRED = "watchdog_fired", ClientUnlessDisturbedOrLate;
}

static NAMES: &[NameInfo] = &[
    NameInfo::flag("client.attached", "a client has the port open", |v| {
        v.observed.attached > 0
    }),
    NameInfo::count("count.requests", "request", "valid lines"),
    NameInfo::count("count.bad_line", "bad_line", "lines that are no command"),
    NameInfo::count(
        "count.watchdog_fired",
        "watchdog_fired",
        "times that the watchdog fired",
    ),
];

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

struct Replies(Vec<u8>);

impl ReplyReader for Replies {
    fn push(&mut self, _now: SimTime, byte: u8) -> Vec<Reply> {
        if byte != b'\n' {
            self.0.push(byte);
            self.0.truncate(MOST_LINE);
            return Vec::new();
        }
        let line = String::from_utf8_lossy(&self.0).into_owned();
        self.0.clear();
        let number = |word: &str| word.parse().map_or(Field::Flag(false), Field::Number);
        let (command, fields) = match line.split(' ').collect::<Vec<_>>()[..] {
            ["O", left, right] => (b'O', vec![("left", number(left)), ("right", number(right))]),
            ["B", volts] => (b'B', vec![("volts", number(volts))]),
            _ => (b'S', vec![("ok", Field::Flag(line == "OK"))]),
        };
        let command = Some(command);
        vec![Reply { command, fields }]
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
    output: VecDeque<Vec<u8>>,
    events: VecDeque<(SimTime, Told)>,
}

impl Robot {
    fn new(setup: &Setup<'_>, world: &mut World) -> Self {
        Self {
            settings: setup.settings.get().cloned().unwrap_or_default(),
            body: Differential::new(setup.name, DifferentialShape::default(), world, setup.pose),
            line: Vec::new(),
            speeds: [0; 2],
            stop_due: None,
            output: VecDeque::new(),
            events: VecDeque::new(),
        }
    }

    /// Takes a line; gives the reply, unless it is no command.
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
            ["B"] => Some(format!("B {}", (self.settings.battery * 1000.0).round())),
            _ => None,
        }
    }

    fn tell(&mut self, at: SimTime, code: Code, role: Role, text: String) {
        self.events.push_back((at, Told { code, role, text }));
    }
}

impl Breakable for Robot {}

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
                    Some(_) => self.tell(now, code::REQUEST, Role::Request, line),
                    None => self.tell(now, BAD_LINE, Role::Other, format!("no command: {line}")),
                }
                let reply = reply.unwrap_or_else(|| "E".to_owned());
                self.output.push_back(format!("{reply}\n").into_bytes());
                self.tell(now, code::REPLY, Role::Reply, reply);
            }
        }
    }

    fn advance(&mut self, now: SimTime) {
        if self.next_deadline().is_some_and(|due| due <= now) {
            self.stop_due = None;
            if std::mem::take(&mut self.speeds) != [0; 2] {
                let text = "no speeds in time: the wheels stop".to_owned();
                self.tell(now, WATCHDOG_FIRED, Role::Other, text);
            }
        }
    }

    fn next_deadline(&self) -> Option<SimTime> {
        self.stop_due
    }

    fn has_news(&self) -> bool {
        !self.output.is_empty() || !self.events.is_empty()
    }

    fn settle(&mut self, _now: SimTime) {
        self.body
            .set_speeds(self.speeds.map(|speed| f64::from(speed) / 1000.0));
    }

    fn poll_output(&mut self) -> Option<(usize, Vec<u8>)> {
        Some((0, self.output.pop_front()?))
    }

    fn poll_event(&mut self) -> Option<(SimTime, Arc<dyn EventKind>)> {
        let (at, event) = self.events.pop_front()?;
        Some((at, Arc::new(event)))
    }

    fn plant(&self) -> &dyn Plant {
        &self.body
    }

    fn plant_mut(&mut self) -> &mut dyn Plant {
        &mut self.body
    }

    fn framing(&self, _link: usize) -> &'static dyn Framing {
        &TextLines {
            name: "a reply",
            unasked: b"OK\n",
        }
    }
}
