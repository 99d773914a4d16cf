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
    kind: ProtocolFault,
    scope: Scope,
    noise: Noise,
    /// The frame before, for a fault that sends it again.
    previous: Option<Vec<u8>>,
    /// Time at which it next sends something by itself.
    due: Option<SimTime>,
}

impl FramesAtWork {
    pub(super) fn new(
        kind: &ProtocolFault,
        scope: &Scope,
        now: SimTime,
        framing: &'static dyn Framing,
        noise: Noise,
    ) -> Self {
        let sends = matches!(kind, ProtocolFault::UnsolicitedFrame { .. });
        Self {
            framing,
            kind: kind.clone(),
            scope: scope.clone(),
            noise,
            previous: None,
            due: sends.then_some(now),
        }
    }

    /// Passes frames on, each with the time at which it is sent.
    pub(super) fn pass(&mut self, frames: &mut Vec<(SimTime, Vec<u8>)>, tally: &mut Tally) {
        let (command, most) = (self.scope.command, self.scope.count);
        let chance = self.scope.probability.get();
        for (at, frame) in std::mem::take(frames) {
            let wanted = command.is_none_or(|command| self.framing.is_command(&frame, command));
            let happens = wanted && self.noise.uniform() < chance && tally.is_below(most);
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
        if let ProtocolFault::PreviousReply {} = self.kind {
            let before = self.previous.replace(frame.clone());
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
        if !happens || matches!(self.kind, ProtocolFault::UnsolicitedFrame { .. }) {
            frames.push((at, frame));
            return;
        }
        tally.hit(|| framing.name(&frame));
        match &self.kind {
            ProtocolFault::BadCrc {} => frames.push((at, spoil_end(frame))),
            ProtocolFault::WrongCommand { with } => {
                frames.push((at, framing.with_command(frame, *with)));
            }
            ProtocolFault::WrongLength { by, what } => {
                frames.push((at, with_length(framing, frame, *by, *what)));
            }
            ProtocolFault::TornReply {} => {
                let half = frame.len().div_ceil(2);
                frames.push((at, frame[..half].to_vec()));
            }
            ProtocolFault::LateReply { by } => frames.push((at + by.0, frame)),
            ProtocolFault::ReplyTwice {} => frames.extend([(at, frame.clone()), (at, frame)]),
            // The last two are dealt with above.
            ProtocolFault::MissingReply {}
            | ProtocolFault::PreviousReply {}
            | ProtocolFault::UnsolicitedFrame { .. } => {}
        }
    }

    /// Time at which it next sends something by itself.
    pub(super) fn due(&self) -> Option<SimTime> {
        self.due
    }

    /// Returns the frame that it sends by itself at `now`, if any.
    pub(super) fn send(&mut self, now: SimTime, tally: &mut Tally) -> Option<Vec<u8>> {
        let ProtocolFault::UnsolicitedFrame { bytes, every } = &self.kind else {
            return None;
        };
        self.due.filter(|due| *due <= now)?;
        if !tally.is_below(self.scope.count) {
            self.due = None;
            return None;
        }
        self.due = every.map(|every| now + every.0.max(SHORTEST_EVERY));
        let bytes = bytes.as_ref().map(|bytes| bytes.0.clone());
        let bytes = bytes.unwrap_or_else(|| self.framing.unasked());
        tally.hit(|| format!("{} bytes that nobody asked for", bytes.len()));
        Some(bytes)
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
