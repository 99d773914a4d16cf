//! The firmware of the rayland-dual board in a mecanum car.
//!
//! [`MecanumDevice`] is a state machine: bytes on two links, measurements, key presses and time go
//! in; status packets, report lines, pin states and events come out. It sees pins, never physics.
//! Any bytes are legal input.
//!
//! Its driver
//! 1. never moves time back,
//! 2. calls [`MecanumDevice::advance`] at (or after) each [`MecanumDevice::next_deadline`]; what is
//!    due between is done in order, each at its own time,
//! 3. after any call takes all of [`MecanumDevice::poll_output`] and
//!    [`MecanumDevice::poll_event`],
//! 4. applies [`MecanumDevice::commands`] to the plant, and hands what the plant then measures to
//!    [`MecanumDevice::sense`].
//!
//! Bytes and measurements that arrive exactly at a deadline come before it.

pub mod ascii;
pub mod codec;
mod defects;
pub mod encoder;
pub mod event;
pub mod kinematics;
mod locomotion;
pub mod motion;
pub mod odometry;
pub mod packet;
mod requests;
pub mod settings;
mod telemetry;

#[cfg(test)]
mod tests;

use std::fmt;
use std::time::Duration;

use rigsim_physics::mecanum::{MecanumCommands, MecanumMeasurements};
use rigsim_settings::SimTime;

use crate::event::code::OPERATED;
use crate::firmware::{Firmware, Shell};
use crate::scanner::Scanner;
use kinematics::Movement;
use locomotion::Locomotion;
use motion::Motion;
use packet::Request;
use settings::MecanumFirmwareSettings;

/// Largest speed of a motion packet, 1/10 r/min.
pub const MAX_SPEED: i16 = 500;
/// Most packets and lines kept until they are taken; the oldest go first.
const MOST_OUTPUTS: usize = 64;

rigsim_settings::words! {
    /// A serial link of the board, in the order of their indices on the device.
    pub enum Link {
        /// To the on-board Android: binary packets.
        Main = "main",
        /// To an external computer, on the UART of the magnetic sensor: lines of text.
        Ros = "ros",
    }
}

crate::actions! {
    /// What an operator does.
    #[derive(Copy, PartialEq)]
    pub enum OperatorInput: Operator {
        /// Mecanum car: a motion key of the remote control goes down.
        Press(Movement) = "press" tries ["\"forward\"", "\"turn-left\""];
        /// The motion key goes up.
        Release = "release";
    }
}

impl fmt::Display for OperatorInput {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Press(movement) => write!(f, "{movement} key down"),
            Self::Release => f.write_str("key up"),
        }
    }
}

/// The board, without the hardware around it.
#[derive(Debug, Clone)]
pub struct MecanumDevice {
    settings: MecanumFirmwareSettings,
    ros_configured: bool,
    decoder: Scanner,
    lines: ascii::Decoder,
    drive: Locomotion,
    measured: MecanumMeasurements,
    status_due: Option<SimTime>,
    report_due: Option<SimTime>,
    /// Number of the next status packet.
    seq: u8,
    /// Time of the client's last sign of life.
    heard: SimTime,
    /// Number of the client's last packet.
    heard_seq: u8,
    /// The last tag that was under the reader.
    last_tag: u32,
    shell: Shell<(Link, Vec<u8>), u8>,
    /// A link timeout that is out of order has missed its time.
    missed_timeout: bool,
}

impl MecanumDevice {
    /// A board that is switched on at `now`.
    ///
    /// With `ros_configured` its second UART is the ROS link; without, the magnetic sensor has it,
    /// and bytes for that link go nowhere. `measured` is what its inputs read at that moment.
    #[must_use]
    pub fn new(
        now: SimTime,
        settings: MecanumFirmwareSettings,
        ros_configured: bool,
        measured: MecanumMeasurements,
    ) -> Self {
        let mut device = Self {
            ros_configured,
            decoder: codec::decoder::<Request>(settings.inter_byte_timeout),
            lines: ascii::Decoder::default(),
            drive: Locomotion::new(&settings, &measured),
            measured,
            status_due: None,
            report_due: None,
            seq: 0,
            heard: now,
            heard_seq: 0,
            last_tag: measured.tag,
            shell: Shell::new(MOST_OUTPUTS),
            missed_timeout: false,
            settings,
        };
        if measured.board_powered {
            device.schedule(now);
        }
        device
    }

    /// Takes bytes whose last has arrived on `link` at `now`.
    pub fn handle_bytes(&mut self, now: SimTime, link: Link, bytes: &[u8]) {
        self.advance_before(now);
        if !self.hears(bytes.len()) {
            return;
        }
        for &byte in bytes {
            match link {
                Link::Main => {
                    let found = self.decoder.push(now, byte);
                    self.handle(now, found);
                }
                Link::Ros if self.ros_configured => {
                    if let Some(line) = self.lines.push(byte) {
                        self.line(now, line);
                    }
                }
                Link::Ros => {}
            }
        }
    }

    /// Takes what the inputs read at `now`.
    pub fn sense(&mut self, now: SimTime, measured: &MecanumMeasurements) {
        self.advance_before(now);
        let measured = &self.overlook(measured);
        let was_powered = std::mem::replace(&mut self.measured, *measured).board_powered;
        self.update_supply(now, was_powered, Duration::ZERO);
        if was_powered && self.works() {
            let shell = &mut self.shell;
            self.drive.sense(now, &measured.pulses, &mut |change| {
                shell.report(now, event::motion(change));
            });
            if measured.tag != 0 {
                self.last_tag = measured.tag;
            }
        }
    }

    /// An operator works the remote control at `now`.
    pub fn operate(&mut self, now: SimTime, action: OperatorInput) {
        self.advance_before(now);
        let text = format!("operator: {action}");
        self.shell.emit(now, OPERATED, text);
        match action {
            OperatorInput::Press(movement) => {
                if self.works() && !self.drive.remote {
                    let text = format!("{movement} key has no effect: the board drives");
                    self.shell.emit(now, event::KEY_IGNORED, text);
                }
                self.drive.set_key(now, Some(movement));
            }
            OperatorInput::Release => self.drive.set_key(now, None),
        }
    }

    /// The pins that the firmware drives.
    #[must_use]
    pub fn commands(&self) -> MecanumCommands {
        if self.runs() {
            self.drive.commands()
        } else {
            MecanumCommands::default()
        }
    }

    /// Returns whether the remote control drives.
    #[must_use]
    pub fn is_remote(&self) -> bool {
        self.drive.remote
    }

    /// The key of the remote control that is held.
    #[must_use]
    pub fn key(&self) -> Option<Movement> {
        self.drive.key
    }

    /// The motion that runs.
    #[must_use]
    pub fn running(&self) -> Option<&Motion> {
        self.drive.motions.running()
    }

    /// Number of motions that wait.
    #[must_use]
    pub fn waiting(&self) -> usize {
        self.drive.motions.waiting()
    }

    /// When the motions are discarded unless the client sends something.
    fn link_deadline(&self) -> Option<SimTime> {
        let timeout = self
            .settings
            .link_timeout
            .filter(|_| !self.missed_timeout)?;
        if self.drive.remote {
            return None;
        }
        self.drive.motions.running()?;
        Some(self.heard + timeout)
    }

    fn hear(&mut self, now: SimTime) {
        self.heard = now;
        self.missed_timeout = false;
    }
}

impl Firmware for MecanumDevice {
    type Output = (Link, Vec<u8>);
    type Status = u8;
    const NAME: &'static str = "the board";

    fn shell(&self) -> &Shell<(Link, Vec<u8>), u8> {
        &self.shell
    }

    fn shell_mut(&mut self) -> &mut Shell<(Link, Vec<u8>), u8> {
        &mut self.shell
    }

    fn has_supply(&self) -> bool {
        self.measured.board_powered
    }

    fn due(&self) -> Option<SimTime> {
        if self.shell.defects.hung {
            // Nothing is sent then, but it is counted.
            return self.status_due.into_iter().chain(self.report_due).min();
        }
        [
            self.decoder.deadline(),
            self.link_deadline(),
            self.drive.due(),
            self.status_due,
            self.report_due,
        ]
        .into_iter()
        .flatten()
        .min()
    }

    fn serve(&mut self, now: SimTime) {
        if self.shell.defects.hung {
            self.miss_packets(now);
            return;
        }
        let found = self.decoder.expire(now);
        self.handle(now, found);
        let timed_out = self.link_deadline().is_some_and(|due| due <= now);
        if timed_out && self.shell.defects.watchdog_off {
            self.missed_timeout = true;
            self.shell.counts.watchdog_off += 1;
        } else if timed_out {
            let silence = now.since(self.heard).as_secs_f64() * 1000.0;
            let why = format!("nothing valid from the client for {silence:.1} ms");
            self.discard(now, event::LINK_TIMEOUT, &why);
        }
        if self.drive.due().is_some_and(|due| due <= now) {
            self.start_due(now);
        }
        self.send_due(now);
    }

    fn start(&mut self, now: SimTime) {
        self.drive = Locomotion::new(&self.settings, &self.measured);
        self.schedule(now);
    }

    fn forget(&mut self) {
        self.decoder.clear();
        self.lines.clear();
        self.drive = Locomotion::new(&self.settings, &self.measured);
        self.status_due = None;
        self.report_due = None;
        self.seq = 0;
        self.heard_seq = 0;
        self.last_tag = 0;
    }

    fn status_to_keep(&self, now: SimTime) -> u8 {
        self.motor_state(now)
    }

    fn mend_watchdog(&mut self, _now: SimTime) {
        self.missed_timeout = false;
    }
}
