//! The module against its datasheet. The hardware here is a table of readings, so that every
//! number in a reply has a known source.

mod choices;
mod commands;
mod control;
mod motion;
mod protections;
mod robustness;

use crate::firmware::Firmware as _;
use std::time::Duration;

use rigsim_physics::r150::{PwmReading, R150Measurements, Sides};
use rigsim_settings::SimTime;

use super::R150Device;
use super::codec;
use super::command::{
    Motors, PwmInputs, PwmOutputs, REPLIES, Reply, Request, Success, SystemInfo, Version, code,
};
use super::settings::{NoiseSettings, R150FirmwareSettings};
use super::vehicle::Start;
use crate::event::EventKind;
use crate::message::Message as _;
use crate::noise::Noise;
use crate::scanner::Decoded;

/// The smallest step of simulated time.
const QUANTUM: Duration = Duration::from_nanos(1);

/// Reads a whole frame, as a client does; `None` for what is not a reply.
pub(crate) fn read_reply(frame: &[u8]) -> Option<Reply> {
    let (command, parameters) = codec::parts(frame)?;
    let info = REPLIES.iter().find(|info| info.id == command)?;
    let mut rest = Some(parameters).filter(|all| all.len() == info.length)?;
    let rest = &mut rest;
    Some(match command {
        code::GetPwmOutputs => Reply::PwmOutputs(PwmOutputs::take(command, rest)?),
        code::GetPwmInputs => Reply::PwmInputs(PwmInputs::take(command, rest)?),
        code::SystemInfo => Reply::SystemInfo(SystemInfo::take(command, rest)?),
        code::Version => Reply::Version(Version::take(command, rest)?),
        code::SetMotors => Reply::Motors(Motors::take(command, rest)?),
        _ => {
            let Success { success } = Success::take(command, rest)?;
            Reply::Bool { command, success }
        }
    })
}

/// Readings with a different number everywhere.
pub(super) fn readings() -> R150Measurements {
    R150Measurements {
        module_powered: true,
        motor_rpm: Sides {
            right: 1512.6,
            left: -700.4,
        },
        motor_turns: Sides::default(),
        soc: 0.8004,
        bus_voltage: 51.25,
        rail_voltage: [12.01, 0.0, 11.98, 12.0, 51.2, 5.0],
        rail_current: [1.5, 0.0, 0.25, 3.125, 7.0, 0.5],
        converter_12v: 12.05,
        supply_current: 9.75,
        temperature: [31.25, 40.0],
        pwm_in: [
            PwmReading {
                frequency: 10.0,
                duty: 0.5,
            },
            PwmReading {
                frequency: 20_000.0,
                duty: 1.0,
            },
            PwmReading::default(),
            PwmReading {
                frequency: 1234.4,
                duty: 0.1239,
            },
        ],
        power_module_fault: false,
    }
}

/// The default settings, but for replies that begin at once and report what is.
fn at_once() -> R150FirmwareSettings {
    R150FirmwareSettings {
        reply_spread: Duration::ZERO,
        noise: NoiseSettings {
            voltage: 0.0,
            current: 0.0,
            temperature: 0.0,
            speed: 0.0,
        },
        ..R150FirmwareSettings::default()
    }
}

/// A module on a bench.
struct Bench {
    device: R150Device,
    now: SimTime,
    readings: R150Measurements,
}

impl Bench {
    fn new() -> Self {
        Self::with(|_| {})
    }

    fn with(change: impl FnOnce(&mut R150FirmwareSettings)) -> Self {
        let mut settings = at_once();
        change(&mut settings);
        Self::start(settings, Start::Ready)
    }

    fn start(settings: R150FirmwareSettings, start: Start) -> Self {
        let readings = readings();
        let noise = || Noise::new(1, "test");
        let device = R150Device::new(settings, start, readings, noise(), noise());
        Self {
            device,
            now: SimTime::ZERO,
            readings,
        }
    }

    /// Advances time up to and including `at`.
    fn until(&mut self, at: SimTime) {
        self.now = at;
        self.device.advance(at);
    }

    fn after(&mut self, span: Duration) {
        self.until(self.now + span);
    }

    /// The last frame that came out of it, if any did.
    fn reply(&mut self) -> Option<Vec<u8>> {
        let mut last = None;
        while let Some(frame) = self.device.poll_output() {
            last = Some(frame);
        }
        last
    }

    fn send(&mut self, bytes: &[u8]) -> Option<Vec<u8>> {
        self.device.handle_bytes(self.now, bytes);
        self.reply()
    }

    fn ask(&mut self, request: Request) -> Option<Reply> {
        let frame = self.send(&request.encode())?;
        let mut reply = None;
        let mut decoder = codec::decoder(Duration::from_secs(1));
        for byte in frame {
            for decoded in decoder.push(self.now, byte) {
                if let Decoded::Frame(frame) = decoded {
                    reply = read_reply(&frame);
                }
            }
        }
        reply
    }

    fn drive(&mut self, right: i16, left: i16) -> Option<Reply> {
        self.ask(Request::SetMotors { right, left })
    }

    fn power(&mut self, status: u32) -> bool {
        match self.ask(Request::PowerControl { on: status }) {
            Some(Reply::Bool { success, .. }) => success,
            other => panic!("{other:?}"),
        }
    }

    fn info(&mut self) -> SystemInfo {
        match self.ask(Request::SystemInfo) {
            Some(Reply::SystemInfo(info)) => info,
            other => panic!("{other:?}"),
        }
    }

    /// Changes what its sensors read.
    fn read(&mut self, change: impl FnOnce(&mut R150Measurements)) {
        change(&mut self.readings);
        self.device.sense(self.now, &self.readings);
    }

    /// Turns the motors as they read for so long that their speeds are measured.
    fn spin(&mut self) {
        let span = Duration::from_secs(10);
        self.after(span);
        self.read(|r| {
            r.motor_turns.right += r.motor_rpm.right / 60.0 * 10.0;
            r.motor_turns.left += r.motor_rpm.left / 60.0 * 10.0;
        });
    }

    fn events(&mut self) -> Vec<EventKind> {
        std::iter::from_fn(|| self.device.poll_event())
            .map(|(_, event)| event)
            .collect()
    }

    /// Codes of everything but traffic since the last look.
    fn codes(&mut self) -> Vec<&'static str> {
        self.events()
            .iter()
            .map(|event| event.code().name)
            .filter(|code| !["request", "reply", "control_taken"].contains(code))
            .collect()
    }

    fn duty(&self) -> [f64; 2] {
        let commands = self.device.commands();
        [commands.motor_duty.right, commands.motor_duty.left]
    }
}
