//! Promises of a session at any time.

use std::hash::Hash as _;
use std::time::Duration;

use sim_core::SimTime;
use sim_core::device::names::Reading;
use sim_core::device::{Observed, View};
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
            for number in &numbers {
                assert!(number.is_finite(), "device {device}: {numbers:?}");
                number.to_bits().hash(&mut self.seen);
            }
            let distance = self.rig.distance_m(device);
            assert!(distance >= self.distance[device], "{distance} m");
            self.distance[device] = distance;
            if let Some(r150) = self.rig.device::<sim_core::r150::R150>(device) {
                let soc = r150.truth().soc;
                assert!((0.0..=1.0).contains(&soc), "charge of {soc}");
            }
        }
        while let Some(event) = self.rig.poll_event() {
            let (told, now) = (self.told, self.now);
            let in_order = told <= event.at && event.at <= now;
            assert!(in_order, "{event:?} is told after {told} s, at {now} s");
            self.told = event.at;
            let words = event.kind.to_string();
            assert!(!words.is_empty());
            (event.at, event.device, words).hash(&mut self.seen);
        }
        assert_eq!(self.rig.events_lost(), 0);
    }
}

/// Expectation of a client of its port.
#[derive(Debug, Clone, Copy)]
pub(super) enum Says {
    /// An R150 that speaks when it is spoken to.
    Replies,
    /// A car that speaks so often, and to each packet or line if it acknowledges them.
    Reports {
        link: Link,
        period: Duration,
        acknowledges: bool,
    },
}

/// A client, or the place of one.
pub(super) struct Client {
    pub(super) port: PortId,
    says: Says,
    pub(super) baud: u32,
    pub(super) attached: bool,
    pub(super) line: ClientLine,
    /// Set if nothing has disturbed its line since it came.
    pub(super) undisturbed: bool,
    pub(super) since: SimTime,
    pub(super) sent: usize,
    /// Somebody before it has sent something.
    heir: bool,
    read: usize,
    /// The beginning of something that is not whole yet.
    unread: Vec<u8>,
}

impl Client {
    pub(super) fn new(port: PortId, baud: u32, says: Says) -> Self {
        Self {
            port,
            says,
            baud,
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
            ..Self::new(self.port, self.baud, self.says)
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

    /// Length of the whole frames, packets or lines in what has come, if all is well.
    fn whole(&self) -> usize {
        let bytes = &self.unread;
        match self.says {
            Says::Replies => {
                let mut at = 0;
                while let Some(&length) = bytes.get(at + 2)
                    && at + 6 + usize::from(length) <= bytes.len()
                {
                    at += 6 + usize::from(length);
                }
                at
            }
            Says::Reports {
                link: Link::Main, ..
            } => bytes.len() / 39 * 39,
            Says::Reports {
                link: Link::Ros, ..
            } => {
                let end = bytes.iter().rposition(|byte| *byte == b'\n');
                end.map_or(0, |end| end + 1)
            }
        }
    }

    fn says_well(&self, whole: usize) -> bool {
        let bytes = &self.unread[..whole];
        match self.says {
            Says::Replies => stream::frames_cover(bytes),
            Says::Reports { link, .. } => stream::sends_well(link, bytes),
        }
    }

    /// Most that the device can have said to it by `now`.
    fn most(&self, now: SimTime) -> usize {
        match self.says {
            // The longest reply, of 82 bytes, is to the shortest request, of 6.
            Says::Replies => 14 * self.sent,
            // Whether bytes take time or not, it speaks no oftener; a line is never longer than 60
            // bytes, and the shortest that is answered has 2.
            Says::Reports {
                period,
                acknowledges,
                ..
            } => {
                let periods = now.since(self.since).as_nanos() / period.as_nanos();
                let periods = usize::try_from(periods).unwrap_or(usize::MAX / 100);
                60 * (periods + 2) + if acknowledges { 30 * self.sent } else { 0 }
            }
        }
    }
}

/// The numbers of a device's truth.
#[must_use]
pub fn truth(rig: &Rig, index: usize) -> Vec<f64> {
    let (Some(spec), Some(device)) = (rig.spec(index), rig.any_device(index)) else {
        return Vec::new();
    };
    let view = View {
        now: rig.now(),
        world: rig.world(),
        device,
        observed: &Observed::new(spec),
    };
    let groups = ["truth.", "wheel.", "rail."];
    let names = spec.all_names();
    let names = names.filter(|info| groups.iter().any(|group| info.name.starts_with(group)));
    let numbers = names.filter_map(|info| match info.getter.read(&view) {
        Reading::Number(number) => Some(number),
        Reading::Flag(_) => None,
    });
    numbers.collect()
}
