//! Promises of a session at any time.

use std::hash::Hash as _;

use rigsim_core::SimTime;
use rigsim_core::device::host::{MessageInfo, Sender};
use rigsim_core::device::names::Reading;
use rigsim_core::device::{Counters, DeviceSpec, View};
use rigsim_core::line::{ClientLine, MOST_IN_FLIGHT, Wire};
use rigsim_core::rig::{PortId, Rig};
use rigsim_core::scanner::{Form, Part};

use super::Player;

/// Most bytes that a client may ever find waiting: the line's and those that faults hold.
const MOST_WAITING: usize = MOST_IN_FLIGHT + 16_384;
impl Player {
    pub(super) fn check(&mut self) {
        for device in 0..self.rig.devices() {
            for number in truth(&self.rig, device) {
                number.to_bits().hash(&mut self.seen);
            }
            let distance = self.rig.distance_m(device);
            assert!(distance >= self.distance[device], "{distance} m");
            self.distance[device] = distance;
            let charge = named(&self.rig, device, |name| name == "truth.soc_percent");
            let is_sane = charge.iter().all(|soc| (0.0..=100.0).contains(soc));
            assert!(is_sane, "charge of {charge:?} %");
        }
        while let Some(event) = self.rig.poll_event() {
            let (reported, now) = (self.reported, self.now);
            let in_order = reported <= event.at && event.at <= now;
            assert!(
                in_order,
                "{event:?} is reported after {reported} s, at {now} s"
            );
            self.reported = event.at;
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
    device: &'static DeviceSpec,
    pub(super) baud: u32,
    wire: Wire,
    pub(super) attached: bool,
    pub(super) line: ClientLine,
    /// Set if nothing has disturbed its line since it came.
    pub(super) undisturbed: bool,
    pub(super) since: SimTime,
    pub(super) sent: usize,
    /// A client before it has sent something.
    heir: bool,
    read: usize,
    /// The beginning of something that is not whole yet.
    unread: Vec<u8>,
}

impl Client {
    pub(super) fn new(port: PortId, device: &'static DeviceSpec, baud: u32, wire: Wire) -> Self {
        Self {
            port,
            device,
            baud,
            wire,
            attached: false,
            line: ClientLine::at(baud),
            undisturbed: true,
            since: SimTime::ZERO,
            sent: 0,
            heir: false,
            read: 0,
            unread: Vec::new(),
        }
    }

    /// Opens the port; whether its line is disturbed depends on its speed, too, and on whether it
    /// may get replies to one who was there before.
    pub(super) fn comes(&mut self, now: SimTime, undisturbed: bool) {
        let heir = self.heir || self.sent > 0;
        *self = Self {
            attached: true,
            heir,
            undisturbed: undisturbed && !heir && self.line.baud == self.baud,
            since: now,
            line: self.line,
            ..Self::new(self.port, self.device, self.baud, self.wire)
        };
    }

    /// Checks the bytes that it has read.
    pub(super) fn gets(&mut self, bytes: &[u8], now: SimTime) {
        assert!(bytes.len() <= MOST_WAITING, "{} bytes at once", bytes.len());
        assert!(self.attached || bytes.is_empty(), "bytes for no client");
        self.read += bytes.len();
        if self.undisturbed {
            self.unread.extend(bytes);
            let whole = whole(self.device, self.port.link, &self.unread);
            assert!(whole.is_some(), "{:02X?}", self.unread);
            self.unread.drain(..whole.unwrap_or_default());
            let most = self.most(now);
            assert!(self.read <= most, "{} bytes of {most}", self.read);
        }
    }

    /// Most that the device can have said to it by `now`.
    fn most(&self, now: SimTime) -> usize {
        let bits = now.since(self.since).as_nanos() * u128::from(self.baud) / 1_000_000_000;
        let carried = match self.wire {
            Wire::Paced | Wire::Bare => usize::try_from(bits / 10).unwrap_or(usize::MAX) + 1,
            Wire::Instant => usize::MAX,
        };
        // The longest reply, of 82 bytes, is to the shortest request, of 6.
        let asked = match self.device.host.chatters {
            true => usize::MAX,
            false => 14 * self.sent,
        };
        carried.min(asked)
    }
}

/// Returns the length of the whole messages at the beginning of what a device has sent on a link; `None`
/// if something else stands there.
fn whole(device: &DeviceSpec, link: usize, bytes: &[u8]) -> Option<usize> {
    let messages = || {
        let all = device.all_messages();
        all.filter(move |info| info.link == link && info.sender == Sender::Device)
    };
    let form = device.links[link].framing.form;
    let mut end = 0;
    loop {
        match form.part(&bytes[end..], messages()) {
            Part::Frame(length) => {
                let line = &bytes[end..end + length];
                let says = |info: &MessageInfo| info.values(line).count() == info.fields.len();
                if matches!(form, Form::Lines) && !messages().any(says) {
                    return None;
                }
                end += length;
            }
            Part::Begun => return Some(end),
            Part::Wrong(_) | Part::Noise(_) => return None,
        }
    }
}

/// The numbers of a device's truth, all of them finite.
pub(crate) fn truth(rig: &Rig, index: usize) -> Vec<f64> {
    let groups = ["truth.", "wheel.", "rail."];
    let numbers = named(rig, index, |name| {
        groups.iter().any(|group| name.starts_with(group))
    });
    let finite = numbers.iter().all(|number| number.is_finite());
    assert!(finite, "device {index} at {} s: {numbers:?}", rig.now());
    numbers
}

/// The numbers that a device has under some names of conditions.
fn named(rig: &Rig, index: usize, is_meant: impl Fn(&str) -> bool) -> Vec<f64> {
    let (Some(spec), Some(device)) = (rig.spec(index), rig.any_device(index)) else {
        return Vec::new();
    };
    let view = View {
        now: rig.now(),
        world: rig.world(),
        device,
        counters: &Counters::default(),
    };
    let names = spec.all_names().filter(|info| is_meant(info.name));
    let numbers = names.filter_map(|info| match info.getter.read(&view) {
        Reading::Number(number) => Some(number),
        Reading::Flag(_) => None,
    });
    numbers.collect()
}
