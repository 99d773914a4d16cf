//! Faults of the protocol: what becomes of whole frames between firmware and line.

use std::time::Duration;

use sim_settings::SimTime;

use super::tally::Tally;
use crate::device::Framing;
use crate::fault::Fault;
use crate::fault::parameters::WrongLength;
use crate::noise::Noise;

/// Most frames that all faults together make of one.
const MOST_OF_ONE: usize = 16;
/// Shortest time between two unsolicited frames.
const SHORTEST_EVERY: Duration = Duration::from_millis(1);

/// A protocol fault at work.
pub(super) struct FrameFault {
    framing: &'static dyn Framing,
    fault: Fault,
    noise: Noise,
    /// The frame before, for a fault that sends it again.
    previous: Option<Vec<u8>>,
    /// Time at which it next sends something by itself.
    due: Option<SimTime>,
}

impl FrameFault {
    pub(super) fn new(
        fault: &Fault,
        now: SimTime,
        framing: &'static dyn Framing,
        noise: Noise,
    ) -> Self {
        let sends = matches!(fault, Fault::UnsolicitedFrame { .. });
        Self {
            framing,
            fault: fault.clone(),
            noise,
            previous: None,
            due: sends.then_some(now),
        }
    }

    /// Passes frames on, each with the time at which it is sent.
    pub(super) fn pass(&mut self, frames: &mut Vec<(SimTime, Vec<u8>)>, tally: &mut Tally) {
        let (command, most) = (self.fault.command(), self.fault.most());
        let chance = self.fault.probability().get();
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
        if let Fault::PreviousReply { .. } = self.fault {
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
        if !happens || matches!(self.fault, Fault::UnsolicitedFrame { .. }) {
            frames.push((at, frame));
            return;
        }
        tally.hit(|| framing.name(&frame));
        match &self.fault {
            Fault::BadCrc { .. } => frames.push((at, spoil_end(frame))),
            Fault::WrongCommand { with, .. } => {
                frames.push((at, framing.with_command(frame, *with)));
            }
            Fault::WrongLength { by, what, .. } => {
                frames.push((at, with_length(framing, frame, *by, *what)));
            }
            Fault::TornReply { .. } => {
                let half = frame.len().div_ceil(2);
                frames.push((at, frame[..half].to_vec()));
            }
            Fault::LateReply { by, .. } => frames.push((at + by.0, frame)),
            Fault::ReplyTwice { .. } => frames.extend([(at, frame.clone()), (at, frame)]),
            // A missing one.
            _ => {}
        }
    }

    /// Time at which it next sends something by itself.
    pub(super) fn due(&self) -> Option<SimTime> {
        self.due
    }

    /// Returns the frame that it sends by itself at `now`, if any.
    pub(super) fn send(&mut self, now: SimTime, tally: &mut Tally) -> Option<Vec<u8>> {
        let Fault::UnsolicitedFrame { bytes, every, .. } = &self.fault else {
            return None;
        };
        self.due.filter(|due| *due <= now)?;
        if !tally.is_below(self.fault.most()) {
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
