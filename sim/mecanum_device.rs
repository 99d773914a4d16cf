//! The firmware of the rayland-dual board in a mecanum car.
//!
//! [`MecanumDevice`] is a state machine: bytes on two links, measurements, key presses and time go
//! in; status packets, report lines, pin states and events come out. It sees pins, never physics.
//! Any bytes are legal input.
//!
//! Its driver
//! 1. never lets the time go back,
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
mod event;
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

use std::collections::VecDeque;
use std::fmt;

use sim_physics::mecanum::{MecanumCommands, MecanumMeasurements, WHEELS};
use sim_settings::SimTime;

use crate::defects::{DefectCounts, Defects};
use codec::{Decoder, Rules};
pub use event::{Discard, Field, Handling, MecanumEvent};
use kinematics::Movement;
use locomotion::Locomotion;
use motion::Motion;
use packet::Request;
use settings::MecanumFirmwareSettings;

/// Largest speed of a motion packet, 1/10 r/min.
pub const MAX_SPEED: i16 = 500;
/// Most packets and lines kept for whoever takes them; the oldest go first.
const MOST_OUTPUTS: usize = 64;
/// Most events kept for whoever takes them; the oldest go first.
const MOST_EVENTS: usize = 1024;

/// A serial link of the board.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Link {
    /// To the on-board Android: binary packets.
    Main,
    /// To an external computer, on the UART of the magnetic sensor: lines of text.
    Ros,
}

impl Link {
    /// Both, in the order of their indices.
    pub const ALL: [Self; 2] = [Self::Main, Self::Ros];

    /// Index of the link on the device.
    #[must_use]
    pub const fn index(self) -> usize {
        self as usize
    }

    /// The link with an index.
    #[must_use]
    pub fn from_index(index: usize) -> Option<Self> {
        Self::ALL.get(index).copied()
    }
}

/// Input of an operator with the remote control.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum OperatorInput {
    /// A key goes down; the car moves so while it is held, in remote-control mode.
    Press(Movement),
    /// The key goes up.
    Release,
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
    decoder: Decoder<Request>,
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
    output: VecDeque<(Link, Vec<u8>)>,
    events: VecDeque<(SimTime, MecanumEvent)>,
    defects: Defects,
    defect_counts: DefectCounts,
    /// The motor state that is reported in place of the present one.
    stuck_status: Option<u8>,
    /// Time at which the firmware is up, while it is not.
    boot_due: Option<SimTime>,
    /// The latest time that it was told of: what turns out to have been due before that, as when it
    /// hung, is done then.
    not_before: SimTime,
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
            decoder: Decoder::by(Rules {
                inter_byte_timeout: settings.inter_byte_timeout,
                framing: settings.framing,
                partial: settings.partial_packet,
                order: settings.byte_order,
            }),
            lines: ascii::Decoder::new(ascii::Syntax::of(&settings)),
            drive: Locomotion::new(&settings, &measured),
            measured,
            status_due: None,
            report_due: None,
            seq: 0,
            heard: now,
            heard_seq: 0,
            last_tag: measured.tag,
            output: VecDeque::new(),
            events: VecDeque::new(),
            defects: Defects::default(),
            defect_counts: DefectCounts::default(),
            stuck_status: None,
            boot_due: None,
            not_before: SimTime::ZERO,
            missed_timeout: false,
            settings,
        };
        if measured.board_powered {
            device.schedule(now);
        }
        device
    }

    /// Takes bytes whose last has arrived on `link` at `now`.
    pub fn receive(&mut self, now: SimTime, link: Link, bytes: &[u8]) {
        self.advance_before(now);
        if !self.hears(bytes.len()) {
            return;
        }
        for &byte in bytes {
            match link {
                Link::Main => {
                    let mut found = Vec::new();
                    self.decoder
                        .push(now, byte, &mut |decoded| found.push(decoded));
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
        match (was_powered, measured.board_powered) {
            (true, false) => self.lose_power(now),
            (false, true) => {
                self.drive = Locomotion::new(&self.settings, measured);
                self.schedule(now);
                self.event(now, MecanumEvent::Started);
            }
            (true, true) if self.works() => {
                let events = &mut self.events;
                self.drive.sense(now, &measured.pulses, &mut |change| {
                    keep(events, (now, MecanumEvent::Motion(change)), MOST_EVENTS);
                });
                if measured.tag != 0 {
                    self.last_tag = measured.tag;
                }
            }
            _ => {}
        }
    }

    /// Somebody works the remote control at `now`.
    pub fn operate(&mut self, now: SimTime, action: OperatorInput) {
        self.advance_before(now);
        self.event(now, MecanumEvent::Operated(action));
        match action {
            OperatorInput::Press(movement) => {
                if self.works() && !self.drive.remote {
                    self.event(now, MecanumEvent::KeyIgnored(movement));
                }
                self.drive.set_key(now, Some(movement));
            }
            OperatorInput::Release => self.drive.set_key(now, None),
        }
    }

    /// Does everything that is due by `now`.
    pub fn advance(&mut self, now: SimTime) {
        // Each round removes the deadline that it serves or moves it later.
        while let Some(due) = self.next_deadline().filter(|due| *due <= now) {
            self.serve(due);
        }
    }

    /// Time at which something next happens by itself.
    #[must_use]
    pub fn next_deadline(&self) -> Option<SimTime> {
        if self.boot_due.is_some() {
            return self.boot_due.filter(|_| !self.defects.hung);
        }
        if self.defects.hung {
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

    /// Tells whether output or events wait to be taken.
    #[must_use]
    pub fn has_news(&self) -> bool {
        !self.output.is_empty() || !self.events.is_empty()
    }

    /// The next packet or line for the client of a link.
    pub fn poll_output(&mut self) -> Option<(Link, Vec<u8>)> {
        self.output.pop_front()
    }

    /// The next event and when it happened.
    pub fn poll_event(&mut self) -> Option<(SimTime, MecanumEvent)> {
        self.events.pop_front()
    }

    /// The pins that the firmware drives.
    #[must_use]
    pub fn commands(&self) -> MecanumCommands {
        if self.measured.board_powered && self.boot_due.is_none() {
            self.drive.commands()
        } else {
            MecanumCommands::default()
        }
    }

    /// Tells whether the remote control drives.
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

    /// Direction in which the firmware drives each wheel, LF, RF, LR, RR: 1 forward, −1 backward, 0
    /// not at all.
    #[must_use]
    pub fn rotations(&self) -> [i8; WHEELS] {
        self.drive.rotations()
    }

    /// Does what is due before `now`, so that what happens at `now` comes before its deadlines.
    fn advance_before(&mut self, now: SimTime) {
        if let Some(nanos) = now.as_nanos().checked_sub(1) {
            self.advance(SimTime::from_nanos(nanos));
        }
        self.not_before = now;
    }

    /// Does what is due at `now` and not earlier.
    fn serve(&mut self, due: SimTime) {
        let now = due.max(self.not_before);
        if self.boot_due.is_some() {
            self.boot(now);
            return;
        }
        if self.defects.hung {
            self.miss_packets(now);
            return;
        }
        let mut found = Vec::new();
        self.decoder.expire(now, &mut |decoded| found.push(decoded));
        self.handle(now, found);
        let timed_out = self.link_deadline().is_some_and(|due| due <= now);
        if timed_out && self.defects.watchdog_off {
            self.missed_timeout = true;
            self.defect_counts.watchdog_off += 1;
        } else if timed_out {
            self.discard(now, Discard::LinkTimeout(now.since(self.heard)));
        }
        if self.drive.due().is_some_and(|due| due <= now) {
            self.go_on(now);
        }
        self.send_due(now);
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

    /// Without a supply the board forgets everything.
    fn lose_power(&mut self, now: SimTime) {
        self.forget();
        self.boot_due = None;
        self.event(now, MecanumEvent::PowerLost);
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

    fn hear(&mut self, now: SimTime) {
        self.heard = now;
        self.missed_timeout = false;
    }

    fn event(&mut self, now: SimTime, event: MecanumEvent) {
        keep(&mut self.events, (now, event), MOST_EVENTS);
    }
}

fn keep<T>(queue: &mut VecDeque<T>, item: T, most: usize) {
    if queue.len() >= most {
        queue.pop_front();
    }
    queue.push_back(item);
}
