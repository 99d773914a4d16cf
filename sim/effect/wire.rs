//! Faults of the wire: what becomes of single bytes on their way.

use std::time::Duration;

use rigsim_settings::{SimTime, Span};

use super::defaults;
use crate::device::parameters::{Direction, Interval, Scope};
use crate::device::{Begin, Declared, Effect, EffectError, OnBytes, Tally, TimedByte, Way, Work};
use crate::line::Adapter;
use crate::noise::Noise;

crate::faults! {
    /// Bytes on their way.
    pub enum WireFault {
        /// Single bits change on the wire.
        BitFlips = "bit-flips", Wire,
        sees "Frames with a wrong CRC, or packets with wrong values; no reply to its own requests.",
        counts "A bit was flipped.",
        tries ["probability = 0.1", "probability = 1.0, count = 1"]
        {}
        chance "Probability for each byte; default 0.01." "defaults::rarely"
        most way on
        /// Bytes are lost on the wire.
        DroppedBytes = "dropped-bytes", Wire,
        sees "Frames that are too short; the next frame seems to be their end.",
        counts "A byte was lost.",
        tries ["probability = 0.1", "probability = 1.0, count = 1"]
        {}
        chance "Probability for each byte; default 0.01." "defaults::rarely"
        most way on
        /// Bytes arrive twice.
        DuplicatedBytes = "duplicated-bytes", Wire,
        sees "Frames with one byte too many.",
        counts "A byte was doubled.",
        tries ["probability = 0.1", "probability = 1.0, count = 1"]
        {}
        chance "Probability for each byte; default 0.01." "defaults::rarely"
        most way on
        /// Random bytes appear between the others.
        InsertedBytes = "inserted-bytes", Wire,
        sees "Frames with a foreign byte in or before them.",
        counts "A byte was inserted.",
        tries ["probability = 0.1", "probability = 1.0, count = 1"]
        {}
        chance "Probability before each byte; default 0.01." "defaults::rarely"
        most way on
        /// Interference makes several bytes in a row random.
        Burst = "burst", Wire,
        sees "Runs of garbage inside frames and across them.",
        counts "A burst began.",
        tries ["probability = 0.1", "probability = 1.0, count = 1"]
        weaker ["bit-flips"]
        {
            /// Bytes of a burst; default 8.
            #[serde(default = "defaults::burst_length")]
            length: u16,
        }
        chance "Probability for each byte that a burst begins; default 0.01." "defaults::rarely"
        most "Maximum number of bursts; default no limit."
        way on
        /// Bytes are delayed by a fixed or a random time. They keep their order.
        Delay = "delay", Wire,
        sees "Late replies; with jitter, frames with pauses inside.",
        counts "A byte came late.",
        tries ["by = \"300 ms\"", ""]
        weaker ["fragmentation"]
        {
            /// Delay of every byte; default 50 ms.
            #[serde(default = "defaults::delay")]
            by: Span,
            /// Maximum of a further, random delay of each byte; default none.
            #[serde(default)]
            jitter: Span,
        }
        way on
        /// Pauses divide what is sent in one piece.
        Fragmentation = "fragmentation", Wire,
        sees "A reply in pieces, over several reads.",
        counts "A pause was put between two bytes.",
        tries ["pause = \"30 ms\"", ""]
        {
            /// Bytes of a piece; default 3.
            #[serde(default = "defaults::piece")]
            size: u16,
            /// Pause after each piece; default 5 ms. The R150 drops an unfinished request after 20 ms.
            #[serde(default = "defaults::pause")]
            pause: Span,
        }
        way "Direction; default to-client." "defaults::to_client"
        on
        /// Bytes stop, and all come at once when the stall ends, as with a busy USB adapter.
        Stall = "stall", Wire,
        sees "Silence, then everything at once, old replies first.",
        counts "A byte was stalled.",
        tries ["", "direction = \"to-client\""]
        weaker ["delay"]
        {}
        way on
        /// One wire of the cable is broken: nothing arrives that way.
        Mute = "mute", Wire,
        sees "No replies; with `to-device`, a vehicle that does nothing and whose watchdog fires.",
        counts "A byte was lost.",
        tries ["", "direction = \"to-device\""]
        weaker ["stall", "missing-reply"]
        {}
        way "Direction; default to-client." "defaults::to_client"
        on
        /// The device's serial port runs at a wrong baud rate.
        WrongBaud = "wrong-baud", Wire,
        sees "Garbage instead of replies, and no reply to its requests.",
        counts "Something was sent at different baud rates.",
        weaker ["burst"]
        {
            /// Baud rate of the device's end; default 9600.
            #[serde(default = "defaults::wrong_baud")]
            baud: u32,
        }
        on
        /// The client's computer has another adapter.
        OtherAdapter = "other-adapter", Wire,
        sees "Replies in other pieces, as with `bytes` one byte after another; with `ftdi` late ones.",
        counts "A byte came through it.",
        tries ["adapter = \"ftdi\"", ""]
        lasts [2000, 0]
        {
            /// The adapter; default `bytes`.
            #[serde(default = "defaults::no_adapter")]
            adapter: Adapter,
        }
        on
        /// Random bytes appear on an idle line.
        IdleNoise = "idle-noise", Wire,
        sees "Bytes between replies that belong to no frame.",
        counts "A byte appeared.",
        tries ["every = \"10 ms\"", "", "count = 1"]
        {
            /// Mean time between two bytes; default 100 ms.
            #[serde(default = "defaults::noise_every")]
            every: Interval,
        }
        most
        way "Direction; default to-client." "defaults::to_client"
        on
        /// The cable is pulled, and plugged in again at the end.
        CablePulled = "cable-pulled", Wire,
        sees "Its port hangs up, as with a pulled USB adapter, and can be opened again afterwards.",
        counts "A client had the port open, or something was sent.",
        weaker ["mute"]
        {}
        on
    }
}

impl Effect for WireFault {
    fn begin(&self, at: &mut Begin<'_>) -> Result<Work, EffectError> {
        let scope = self.scope();
        let mut at_work = AtWork {
            kind: self.clone(),
            ways: Way::ALL.map(|way| OneWay {
                acts: match scope.direction {
                    Direction::Both => true,
                    Direction::ToDevice => way == Way::ToDevice,
                    Direction::ToClient => way == Way::ToClient,
                },
                noise: (at.stream)(match way {
                    Way::ToDevice => Direction::ToDevice.as_str(),
                    Way::ToClient => Direction::ToClient.as_str(),
                }),
                counted: 0,
                last: SimTime::ZERO,
                noise_due: None,
            }),
            scope,
        };
        for way in Way::ALL {
            at_work.schedule_noise(at.now, way);
        }
        Ok(Work::Bytes(Box::new(at_work)))
    }

    fn holds_back(&self) -> Duration {
        match self {
            Self::Delay { by, jitter, .. } => by.0 + jitter.0,
            // Pieces are late by as many pauses as there are before them, which only the bytes say.
            _ => Duration::ZERO,
        }
    }

    fn disturbs_requests(&self) -> bool {
        self.scope().direction != Direction::ToClient
    }
}

/// Most bytes that all faults together make of one.
const MOST_OF_ONE: usize = 64;

/// A fault at work.
struct AtWork {
    kind: WireFault,
    scope: Scope,
    ways: [OneWay; 2],
}

/// State of one direction.
struct OneWay {
    acts: bool,
    noise: Noise,
    /// Bytes of a burst that are still to come, or of a piece that have passed.
    counted: u16,
    /// Time of the last byte.
    last: SimTime,
    noise_due: Option<SimTime>,
}

impl OnBytes for AtWork {
    fn pass(&mut self, way: Way, bytes: &mut Vec<TimedByte>, tally: &mut Tally) {
        if !self.ways[way.index()].acts {
            return;
        }
        for (at, byte) in std::mem::take(bytes) {
            if bytes.len() < MOST_OF_ONE {
                self.pass_byte(way, at, byte, bytes, tally);
            }
        }
    }

    fn stalls(&self, way: Way) -> bool {
        matches!(self.kind, WireFault::Stall { .. }) && self.ways[way.index()].acts
    }

    fn pulls_cable(&self) -> bool {
        matches!(self.kind, WireFault::CablePulled { .. })
    }

    fn baud(&self) -> Option<u32> {
        match self.kind {
            WireFault::WrongBaud { baud, .. } => Some(baud.max(1)),
            _ => None,
        }
    }

    fn adapter(&self) -> Option<Adapter> {
        match self.kind {
            WireFault::OtherAdapter { adapter, .. } => Some(adapter),
            _ => None,
        }
    }

    fn count_sent(&self, way: Way, bytes: usize, tally: &mut Tally) {
        if let Some(baud) = self.baud() {
            tally.hit(|| format!("{bytes} bytes {way} at {baud} baud"));
        } else if self.pulls_cable() {
            tally.hit(|| format!("{bytes} bytes {way} went nowhere"));
        }
    }

    fn due(&self) -> Option<SimTime> {
        self.ways.iter().filter_map(|state| state.noise_due).min()
    }

    /// Only an idle line makes noise.
    fn add(&mut self, now: SimTime, way: Way, idle: bool, tally: &mut Tally) -> Option<u8> {
        let state = &mut self.ways[way.index()];
        state.noise_due.filter(|due| *due <= now)?;
        let byte = state.noise.byte();
        self.schedule_noise(now, way);
        if !idle || !tally.is_below(self.scope.count) {
            return None;
        }
        tally.hit(|| format!("0x{byte:02X} {way}"));
        Some(byte)
    }
}

impl AtWork {
    fn pass_byte(
        &mut self,
        way: Way,
        at: SimTime,
        byte: u8,
        bytes: &mut Vec<TimedByte>,
        tally: &mut Tally,
    ) {
        let more = tally.is_below(self.scope.count);
        let chance = self.scope.probability.0;
        let state = &mut self.ways[way.index()];
        // A draw for each byte, whether it is used or not, so that the limit shifts nothing.
        let mut happens = || state.noise.uniform() < chance && more;
        match &self.kind {
            WireFault::BitFlips { .. } => {
                let hit = happens();
                let bit = state.noise.below(8);
                if hit {
                    tally.hit(|| format!("bit {bit} of a byte 0x{byte:02X} {way}"));
                    bytes.push((at, byte ^ 1 << bit));
                } else {
                    bytes.push((at, byte));
                }
            }
            // The second is the first with certainty.
            WireFault::DroppedBytes { .. } | WireFault::Mute { .. } => {
                if happens() {
                    tally.hit(|| format!("a byte 0x{byte:02X} {way}"));
                } else {
                    bytes.push((at, byte));
                }
            }
            WireFault::DuplicatedBytes { .. } => {
                bytes.push((at, byte));
                if happens() {
                    tally.hit(|| format!("a byte 0x{byte:02X} {way}"));
                    bytes.push((at, byte));
                }
            }
            WireFault::InsertedBytes { .. } => {
                let hit = happens();
                let foreign = state.noise.byte();
                if hit {
                    tally.hit(|| format!("0x{foreign:02X} before a byte 0x{byte:02X} {way}"));
                    bytes.push((at, foreign));
                }
                bytes.push((at, byte));
            }
            WireFault::Burst { length, .. } => {
                let length = (*length).max(1);
                let begins = happens();
                let garbage = state.noise.byte();
                if state.counted == 0 && begins {
                    tally.hit(|| format!("{length} bytes from a byte 0x{byte:02X} {way}"));
                    state.counted = length;
                }
                if state.counted > 0 {
                    state.counted -= 1;
                    bytes.push((at, garbage));
                } else {
                    bytes.push((at, byte));
                }
            }
            WireFault::Delay { by, jitter, .. } => {
                let late = by.0.saturating_add(jitter.0.mul_f64(state.noise.uniform()));
                if !late.is_zero() {
                    tally.hit(|| format!("a byte 0x{byte:02X} {way} by {late:?}"));
                }
                bytes.push((before_max(at, late), byte));
            }
            WireFault::Fragmentation { size, pause, .. } => {
                let (size, pause) = ((*size).max(1), pause.0);
                let gap = at.since(state.last) > pause;
                let mut at = at.max(state.last);
                if gap {
                    state.counted = 0;
                }
                if state.counted == size {
                    state.counted = 0;
                    at = before_max(at.max(state.last), pause);
                    tally.hit(|| format!("{pause:?} after {size} bytes {way}"));
                }
                state.counted += 1;
                state.last = at;
                bytes.push((at, byte));
            }
            WireFault::Stall { .. } => {
                tally.hit(|| format!("a byte 0x{byte:02X} {way}"));
                bytes.push((SimTime::MAX, byte));
            }
            // Counted when they were sent.
            WireFault::CablePulled { .. } => {}
            WireFault::OtherAdapter { adapter, .. } => {
                tally.hit(|| format!("a byte 0x{byte:02X} {way} through `{adapter}`"));
                bytes.push((at, byte));
            }
            WireFault::IdleNoise { .. } | WireFault::WrongBaud { .. } => bytes.push((at, byte)),
        }
    }

    fn schedule_noise(&mut self, now: SimTime, way: Way) {
        let state = &mut self.ways[way.index()];
        if let (WireFault::IdleNoise { every, .. }, true) = (&self.kind, state.acts) {
            // Evenly spread from nothing to twice the mean, but never at once again.
            let wait = every.0.mul_f64(2.0 * state.noise.uniform());
            state.noise_due = Some(now + wait.max(Duration::from_micros(1)));
        }
    }
}

/// Later, but not so late that it would seem to be held.
fn before_max(at: SimTime, by: Duration) -> SimTime {
    if at == SimTime::MAX {
        return at;
    }
    (at + by).min(SimTime::MAX - Duration::from_nanos(1))
}
