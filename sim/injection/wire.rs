//! Faults of the wire: what becomes of single bytes on their way.

use std::time::Duration;

use sim_settings::SimTime;

use super::stage::HELD_UP;
use super::tally::Tally;
use crate::fault::Fault;
use crate::fault::parameters::Direction;
use crate::noise::Noise;

/// One way along a link.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Way {
    ToDevice,
    ToClient,
}

impl Way {
    pub(super) const BOTH: [Self; 2] = [Self::ToDevice, Self::ToClient];

    pub(super) const fn index(self) -> usize {
        self as usize
    }

    pub(super) const fn words(self) -> &'static str {
        match self {
            Self::ToDevice => "to the device",
            Self::ToClient => "to the client",
        }
    }
}

/// Most bytes that all faults together make of one.
const MOST_OF_ONE: usize = 64;
/// A wire fault at work.
#[derive(Debug)]
pub(super) struct WireFault {
    pub(super) link: usize,
    fault: Fault,
    ways: [OneWay; 2],
}

/// State of one direction.
#[derive(Debug)]
struct OneWay {
    noise: Noise,
    /// Bytes of a burst that are still to come, or of a piece that have passed.
    counted: u16,
    /// Time of the last byte.
    last: SimTime,
    noise_due: Option<SimTime>,
}

/// Longest mean time between two bytes of idle noise.
const LONGEST_NOISE: Duration = Duration::from_hours(24 * 365);
/// Shortest mean time between two bytes of idle noise.
const SHORTEST_NOISE: Duration = Duration::from_millis(1);

impl WireFault {
    /// `stream` gives the random numbers of each way.
    pub(super) fn new(
        fault: &Fault,
        link: usize,
        now: SimTime,
        stream: impl Fn(&str) -> Noise,
    ) -> Self {
        let mut own = Self {
            link,
            fault: fault.clone(),
            ways: ["to-device", "to-client"].map(|way| OneWay {
                noise: stream(way),
                counted: 0,
                last: SimTime::ZERO,
                noise_due: None,
            }),
        };
        for way in Way::BOTH {
            own.schedule_noise(now, way);
        }
        own
    }

    fn acts(&self, way: Way) -> bool {
        match self.fault.direction() {
            Direction::Both => true,
            Direction::ToDevice => way == Way::ToDevice,
            Direction::ToClient => way == Way::ToClient,
        }
    }

    pub(super) fn pulls_cable(&self, link: usize) -> bool {
        self.link == link && matches!(self.fault, Fault::CablePulled { .. })
    }

    pub(super) fn stalls(&self) -> bool {
        matches!(self.fault, Fault::Stall { .. })
    }

    pub(super) fn stalls_way(&self, link: usize, way: Way) -> bool {
        self.stalls() && self.link == link && self.acts(way)
    }

    /// The speed at which the device's end runs, if that is what is wrong.
    pub(super) fn baud(&self) -> Option<u32> {
        match self.fault {
            Fault::WrongBaud { baud, .. } => Some(baud.max(1)),
            _ => None,
        }
    }

    /// Something is sent while a speed is wrong or the cable is out.
    pub(super) fn note_sent(&self, way: Way, bytes: usize, tally: &mut Tally) {
        let to = way.words();
        if let Some(baud) = self.baud() {
            tally.hit(|| format!("{bytes} bytes {to} at {baud} baud"));
        } else if self.pulls_cable(self.link) {
            tally.hit(|| format!("{bytes} bytes {to} went nowhere"));
        }
    }

    /// Passes bytes on that have arrived at these times.
    pub(super) fn pass(&mut self, way: Way, bytes: &mut Vec<(SimTime, u8)>, tally: &mut Tally) {
        if !self.acts(way) {
            return;
        }
        let arrived = std::mem::take(bytes);
        for (at, byte) in arrived {
            if bytes.len() < MOST_OF_ONE {
                self.pass_byte(way, at, byte, bytes, tally);
            }
        }
    }

    fn pass_byte(
        &mut self,
        way: Way,
        at: SimTime,
        byte: u8,
        bytes: &mut Vec<(SimTime, u8)>,
        tally: &mut Tally,
    ) {
        let more = tally.is_below(self.fault.most());
        let chance = self.fault.probability().get();
        let own = &mut self.ways[way.index()];
        // A draw for each byte, whether it is used or not, so that the limit shifts nothing.
        let mut happens = || own.noise.uniform() < chance && more;
        let to = way.words();
        match &self.fault {
            Fault::BitFlips { .. } => {
                let hit = happens();
                let bit = own.noise.below(8);
                if hit {
                    tally.hit(|| format!("bit {bit} of a byte 0x{byte:02X} {to}"));
                    bytes.push((at, byte ^ 1 << bit));
                } else {
                    bytes.push((at, byte));
                }
            }
            Fault::DroppedBytes { .. } => {
                if happens() {
                    tally.hit(|| format!("a byte 0x{byte:02X} {to}"));
                } else {
                    bytes.push((at, byte));
                }
            }
            Fault::DuplicatedBytes { .. } => {
                bytes.push((at, byte));
                if happens() {
                    tally.hit(|| format!("a byte 0x{byte:02X} {to}"));
                    bytes.push((at, byte));
                }
            }
            Fault::InsertedBytes { .. } => {
                let hit = happens();
                let foreign = own.noise.byte();
                if hit {
                    tally.hit(|| format!("0x{foreign:02X} before a byte 0x{byte:02X} {to}"));
                    bytes.push((at, foreign));
                }
                bytes.push((at, byte));
            }
            Fault::Burst { length, .. } => {
                let length = (*length).max(1);
                let begins = happens();
                let garbage = own.noise.byte();
                if own.counted == 0 && begins {
                    tally.hit(|| format!("{length} bytes from a byte 0x{byte:02X} {to}"));
                    own.counted = length;
                }
                if own.counted > 0 {
                    own.counted -= 1;
                    bytes.push((at, garbage));
                } else {
                    bytes.push((at, byte));
                }
            }
            Fault::Delay { by, jitter, .. } => {
                let late = by.0.saturating_add(jitter.0.mul_f64(own.noise.uniform()));
                if !late.is_zero() {
                    tally.hit(|| format!("a byte 0x{byte:02X} {to} by {late:?}"));
                }
                bytes.push((before_held_up(at, late), byte));
            }
            Fault::Fragmentation { size, pause, .. } => {
                let (size, pause) = ((*size).max(1), pause.0);
                let gap = at.since(own.last) > pause;
                let mut at = at.max(own.last);
                if gap {
                    own.counted = 0;
                }
                if own.counted == size {
                    own.counted = 0;
                    at = before_held_up(at.max(own.last), pause);
                    tally.hit(|| format!("{pause:?} after {size} bytes {to}"));
                }
                own.counted += 1;
                own.last = at;
                bytes.push((at, byte));
            }
            Fault::Stall { .. } => {
                tally.hit(|| format!("a byte 0x{byte:02X} {to}"));
                bytes.push((HELD_UP, byte));
            }
            Fault::Mute { .. } => tally.hit(|| format!("a byte 0x{byte:02X} {to}")),
            // Counted when they were sent.
            Fault::CablePulled { .. } => {}
            _ => bytes.push((at, byte)),
        }
    }

    /// Time at which a byte next comes out of nothing.
    pub(super) fn noise_due(&self) -> Option<SimTime> {
        self.ways.iter().filter_map(|own| own.noise_due).min()
    }

    /// The byte that comes out of nothing this way at `now`, if one does; only an idle line makes
    /// one.
    pub(super) fn make_noise(
        &mut self,
        now: SimTime,
        way: Way,
        idle: bool,
        tally: &mut Tally,
    ) -> Option<u8> {
        let own = &mut self.ways[way.index()];
        own.noise_due.filter(|due| *due <= now)?;
        let byte = own.noise.byte();
        self.schedule_noise(now, way);
        if !idle || !tally.is_below(self.fault.most()) {
            return None;
        }
        tally.hit(|| format!("0x{byte:02X} {}", way.words()));
        Some(byte)
    }

    fn schedule_noise(&mut self, now: SimTime, way: Way) {
        let acts = self.acts(way);
        if let (Fault::IdleNoise { every, .. }, true) = (&self.fault, acts) {
            let every = every.0.clamp(SHORTEST_NOISE, LONGEST_NOISE);
            let own = &mut self.ways[way.index()];
            // Evenly spread from nothing to twice the mean, but never at once again.
            let wait = every.mul_f64(2.0 * own.noise.uniform());
            own.noise_due = Some(now + wait.max(Duration::from_micros(1)));
        }
    }
}

/// Later, but not so late that it would seem to be held up.
fn before_held_up(at: SimTime, by: Duration) -> SimTime {
    if at == HELD_UP {
        return at;
    }
    (at + by).min(HELD_UP - Duration::from_nanos(1))
}
