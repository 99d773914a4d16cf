//! What must hold of a session at any time.

use std::hash::Hash as _;

use sim_core::SimTime;
use sim_core::device_kind::DeviceKind;
use sim_core::line::{ClientLine, MOST_IN_FLIGHT};
use sim_core::mecanum_device::Link;
use sim_core::rig::{PortId, Rig};

use super::Player;
use crate::stream;

/// Most bytes that a client may ever find waiting: the line's and those that faults hold.
const MOST_WAITING: usize = MOST_IN_FLIGHT + 16_384;
impl Player {
    pub(super) fn check(&mut self) {
        for device in 0..self.rig.devices() {
            let numbers = truth(&self.rig, device);
            for number in numbers {
                assert!(number.is_finite(), "device {device}: {numbers:?}");
                number.to_bits().hash(&mut self.seen);
            }
            let distance = self.rig.distance_m(device);
            assert!(distance >= self.distance[device], "{distance} m");
            self.distance[device] = distance;
            if let Some(r150) = self.rig.r150(device) {
                let soc = r150.truth().soc;
                assert!((0.0..=1.0).contains(&soc), "charge of {soc}");
            }
        }
        while let Some(event) = self.rig.poll_event() {
            assert!(event.at >= self.told && event.at <= self.now, "{event:?}");
            self.told = event.at;
            let words = event.kind.to_string();
            assert!(!words.is_empty());
            (event.at, event.device, words).hash(&mut self.seen);
        }
        assert_eq!(self.rig.events_lost(), 0);
    }
}

/// A client, or the place of one.
pub(super) struct Client {
    pub(super) port: PortId,
    pub(super) kind: DeviceKind,
    pub(super) baud: u32,
    pub(super) attached: bool,
    pub(super) line: ClientLine,
    /// Whether nothing has disturbed its line since it came.
    pub(super) undisturbed: bool,
    pub(super) since: SimTime,
    pub(super) sent: usize,
    read: usize,
    /// The beginning of something that is not whole yet.
    unread: Vec<u8>,
}

impl Client {
    pub(super) fn new(port: PortId, kind: DeviceKind, baud: u32) -> Self {
        Self {
            port,
            kind,
            baud,
            attached: false,
            line: ClientLine::at(baud),
            undisturbed: true,
            since: SimTime::ZERO,
            sent: 0,
            read: 0,
            unread: Vec::new(),
        }
    }

    /// Opens the port; whether its line is disturbed depends on its speed, too.
    pub(super) fn comes(&mut self, now: SimTime, undisturbed: bool) {
        *self = Self {
            attached: true,
            undisturbed: undisturbed && self.line.baud == self.baud,
            since: now,
            line: self.line,
            ..Self::new(self.port, self.kind, self.baud)
        };
    }

    /// Looks at what it has read.
    pub(super) fn gets(&mut self, bytes: &[u8], now: SimTime) {
        assert!(bytes.len() <= MOST_WAITING, "{} bytes at once", bytes.len());
        assert!(self.attached || bytes.is_empty(), "bytes for nobody");
        self.read += bytes.len();
        if self.undisturbed {
            self.unread.extend(bytes);
            let whole = self.whole();
            assert!(self.says_well(whole), "{:02X?}", self.unread);
            self.unread.drain(..whole);
            let most = self.most(now);
            assert!(self.read <= most, "{} bytes of {most}", self.read);
        }
    }

    /// How much of what has come is whole frames, packets or lines, if all is well.
    fn whole(&self) -> usize {
        let bytes = &self.unread;
        match (self.kind, self.port.link) {
            (DeviceKind::R150, _) => {
                let mut at = 0;
                while let Some(&length) = bytes.get(at + 2)
                    && at + 6 + usize::from(length) <= bytes.len()
                {
                    at += 6 + usize::from(length);
                }
                at
            }
            (DeviceKind::Mecanum, 0) => bytes.len() / 39 * 39,
            (DeviceKind::Mecanum, _) => {
                let end = bytes.iter().rposition(|byte| *byte == b'\n');
                end.map_or(0, |end| end + 1)
            }
        }
    }

    fn says_well(&self, whole: usize) -> bool {
        let bytes = &self.unread[..whole];
        match self.kind {
            DeviceKind::R150 => stream::frames_cover(bytes),
            DeviceKind::Mecanum => {
                Link::from_index(self.port.link).is_some_and(|link| stream::sends_well(link, bytes))
            }
        }
    }

    /// Most that the device can have said to it by `now`.
    fn most(&self, now: SimTime) -> usize {
        let millis = now.since(self.since).as_millis();
        let millis = usize::try_from(millis).unwrap_or(usize::MAX - 1) + 1;
        match self.kind {
            // The longest reply, of 82 bytes, is to the shortest request, of 6.
            DeviceKind::R150 => 14 * self.sent,
            // Whether bytes take time or not, it speaks ten times a second.
            DeviceKind::Mecanum => 60 * (millis / 100 + 2),
        }
    }
}

/// Something is always due, since batteries and temperatures never stand still.
pub(super) trait ExpectDue {
    fn expect_due(self) -> SimTime;
}

impl ExpectDue for Option<SimTime> {
    fn expect_due(self) -> SimTime {
        self.unwrap_or_else(|| panic!("nothing is due for ever"))
    }
}

/// The numbers of a device's truth.
#[must_use]
pub fn truth(rig: &Rig, device: usize) -> [f64; 18] {
    let mut numbers = [0.0; 18];
    if let Some(r150) = rig.r150(device) {
        let t = r150.truth();
        numbers = [
            t.pose.x,
            t.pose.y,
            t.pose.heading,
            t.forward_speed,
            t.leftward_speed,
            t.yaw_rate,
            t.distance,
            t.wheel_speed.right,
            t.wheel_speed.left,
            t.motor_current.right,
            t.motor_current.left,
            t.motor_supply_current.right,
            t.motor_supply_current.left,
            t.battery_voltage,
            t.battery_current,
            t.soc,
            t.charge_drawn,
            t.mass,
        ];
    }
    if let Some(car) = rig.mecanum(device) {
        let t = car.truth();
        let body = [
            t.pose.x,
            t.pose.y,
            t.pose.heading,
            t.forward_speed,
            t.leftward_speed,
            t.yaw_rate,
        ];
        let rest = body.into_iter().chain([t.distance, t.mass]);
        let rest = rest.chain(t.wheel_speed).chain(t.motor_torque);
        for (number, value) in numbers.iter_mut().zip(rest) {
            *number = value;
        }
    }
    numbers
}
