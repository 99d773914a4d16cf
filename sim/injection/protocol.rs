//! Faults of the protocol: what becomes of whole frames between firmware and line.

use std::time::Duration;

use sim_settings::SimTime;

use super::tally::Tally;
use crate::device::Framing;
use crate::fault::parameters::WrongLength;
use crate::fault::{ProtocolFault, Scope};
use crate::noise::Noise;

/// Most frames that all faults together make of one.
const MOST_OF_ONE: usize = 16;
/// Shortest time between two unsolicited frames.
const SHORTEST_EVERY: Duration = Duration::from_millis(1);

/// A protocol fault at work.
pub(super) struct FramesAtWork {
    framing: &'static dyn Framing,
    command: Option<u8>,
    chance: f64,
    most: Option<u64>,
    effect: Effect,
    noise: Noise,
}

#[derive(Debug)]
enum Effect {
    Crc,
    Command(Option<u8>),
    Length(i8, WrongLength),
    Torn,
    Late(Duration),
    Twice,
    Missing,
    Previous(Option<Vec<u8>>),
    Unsolicited {
        bytes: Vec<u8>,
        every: Option<Duration>,
        due: Option<SimTime>,
    },
}

impl FramesAtWork {
    pub(super) fn new(
        kind: &ProtocolFault,
        scope: &Scope,
        now: SimTime,
        framing: &'static dyn Framing,
        noise: Noise,
    ) -> Self {
        let effect = match kind {
            ProtocolFault::BadCrc {} => Effect::Crc,
            ProtocolFault::WrongCommand { with } => Effect::Command(*with),
            ProtocolFault::WrongLength { by, what } => Effect::Length(*by, *what),
            ProtocolFault::TornReply {} => Effect::Torn,
            ProtocolFault::LateReply { by } => Effect::Late(by.0),
            ProtocolFault::ReplyTwice {} => Effect::Twice,
            ProtocolFault::MissingReply {} => Effect::Missing,
            ProtocolFault::PreviousReply {} => Effect::Previous(None),
            ProtocolFault::UnsolicitedFrame { bytes, every } => {
                let bytes = bytes.as_ref().map(|bytes| bytes.0.clone());
                Effect::Unsolicited {
                    bytes: bytes.unwrap_or_else(|| framing.unasked()),
                    every: every.map(|every| every.0.max(SHORTEST_EVERY)),
                    due: Some(now),
                }
            }
        };
        Self {
            framing,
            command: scope.command,
            chance: scope.probability.get(),
            most: scope.count,
            effect,
            noise,
        }
    }

    /// Passes frames on, each with the time at which it is sent.
    pub(super) fn pass(&mut self, frames: &mut Vec<(SimTime, Vec<u8>)>, tally: &mut Tally) {
        for (at, frame) in std::mem::take(frames) {
            let wanted = self
                .command
                .is_none_or(|command| self.framing.is_command(&frame, command));
            let happens = wanted && self.noise.uniform() < self.chance && tally.is_below(self.most);
            self.pass_frame(at, frame, happens, frames, tally);
            frames.truncate(MOST_OF_ONE);
        }
    }

    fn pass_frame(
        &mut self,
        at: SimTime,
        frame: Vec<u8>,
        happens: bool,
        frames: &mut Vec<(SimTime, Vec<u8>)>,
        tally: &mut Tally,
    ) {
        let framing = self.framing;
        if let Effect::Previous(previous) = &mut self.effect {
            let before = previous.replace(frame.clone());
            if let (true, Some(before)) = (happens, before) {
                tally.hit(|| {
                    format!(
                        "{} in place of {}",
                        framing.name(&before),
                        framing.name(&frame)
                    )
                });
                frames.push((at, before));
            } else {
                frames.push((at, frame));
            }
            return;
        }
        if !happens || matches!(self.effect, Effect::Unsolicited { .. }) {
            frames.push((at, frame));
            return;
        }
        tally.hit(|| framing.name(&frame));
        match self.effect {
            Effect::Crc => frames.push((at, spoil_end(frame))),
            Effect::Command(with) => frames.push((at, framing.with_command(frame, with))),
            Effect::Length(by, what) => frames.push((at, with_length(framing, frame, by, what))),
            Effect::Torn => {
                let half = frame.len().div_ceil(2);
                frames.push((at, frame[..half].to_vec()));
            }
            Effect::Late(by) => frames.push((at + by, frame)),
            Effect::Twice => frames.extend([(at, frame.clone()), (at, frame)]),
            Effect::Missing | Effect::Previous(_) | Effect::Unsolicited { .. } => {}
        }
    }

    /// Time at which it next sends something by itself.
    pub(super) fn due(&self) -> Option<SimTime> {
        match self.effect {
            Effect::Unsolicited { due, .. } => due,
            _ => None,
        }
    }

    /// Returns the frame that it sends by itself at `now`, if any.
    pub(super) fn send(&mut self, now: SimTime, tally: &mut Tally) -> Option<Vec<u8>> {
        let Effect::Unsolicited { bytes, every, due } = &mut self.effect else {
            return None;
        };
        due.filter(|due| *due <= now)?;
        if !tally.is_below(self.most) {
            *due = None;
            return None;
        }
        *due = every.map(|every| now + every);
        tally.hit(|| format!("{} bytes that nobody asked for", bytes.len()));
        Some(bytes.clone())
    }
}

/// Another CRC than the right one.
fn spoil_end(mut frame: Vec<u8>) -> Vec<u8> {
    if let Some(last) = frame.last_mut() {
        *last ^= 0xFF;
    }
    frame
}

/// So many bytes more or fewer, or a length field that says so.
fn with_length(framing: &dyn Framing, mut frame: Vec<u8>, by: i8, what: WrongLength) -> Vec<u8> {
    match (what, framing.length_at()) {
        (WrongLength::Field, Some(at)) => {
            if let Some(length) = frame.get_mut(at) {
                *length = length.wrapping_add_signed(by);
            }
            frame
        }
        _ => framing.with_length(frame, by),
    }
}
