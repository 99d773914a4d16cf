//! Faults of the protocol: what becomes of whole frames between firmware and line.

use std::time::Duration;

use rigsim_settings::{SimTime, Span};

use super::defaults;
use crate::device::parameters::{Interval, Scope};
use crate::device::{
    Begin, Declared, Effect, EffectError, Framing, OnFrames, Tally, TimedFrame, Work,
};
use crate::noise::Noise;

rigsim_settings::file_words! {
    /// Part of a frame that is wrong about its length.
    #[derive(Default)]
    pub enum WrongLength {
        /// Parameters are missing or added, and the rest of the frame fits them.
        #[default]
        Parameters = "parameters",
        /// Only the length field is wrong.
        Field = "field",
    }
}

crate::faults! {
    /// Whole frames, packets and lines of the device.
    pub enum FrameFault {
        /// Replies carry another command byte, packets another type, lines another letter; the CRC is right.
        WrongCommand = "wrong-command", Protocol,
        sees "A well-formed reply to a request that it did not send.",
        counts "A frame was changed.",
        tries ["", "count = 1"]
        {
            /// The byte to send; default the right one with its lowest bit flipped.
            #[serde(default, skip_serializing_if = "Option::is_none")]
            with: Option<u8>,
        }
        only chance most on
        /// Replies are too short or too long.
        WrongLength = "wrong-length", Protocol,
        sees "A well-formed frame with missing or extra parameters, or one whose length field is wrong.",
        counts "A frame was changed.",
        tries ["", "what = \"field\", count = 1", "count = 1"]
        {
            /// By how many bytes; default −1.
            #[serde(default = "defaults::one_less")]
            by: i8,
            /// What is wrong: the number of `parameters`, or the length `field`; default parameters.
            #[serde(default)]
            what: WrongLength,
        }
        only chance most on
        /// Only the first half of a reply is sent.
        TornReply = "torn-reply", Protocol,
        sees "A frame that never ends; the next frame seems to be its end.",
        counts "A frame was cut.",
        tries ["", "count = 1"]
        weaker ["missing-reply"]
        {}
        only chance most on
        /// Replies are sent late. A later one may overtake them.
        LateReply = "late-reply", Protocol,
        sees "No reply in time, and later a reply that it no longer expects.",
        counts "A frame was delayed.",
        tries ["", "count = 1"]
        {
            /// Delay; default 500 ms.
            #[serde(default = "defaults::late")]
            by: Span,
        }
        only chance most on
        /// Replies are sent twice.
        ReplyTwice = "reply-twice", Protocol,
        sees "The same frame again at once, which it may take for the reply to its next request.",
        counts "A frame was sent twice.",
        tries ["", "count = 1"]
        {}
        only chance most on
        /// Replies are not sent.
        MissingReply = "missing-reply", Protocol,
        sees "No reply, although the command took effect.",
        counts "A frame was not sent.",
        tries ["", "count = 1"]
        weaker ["late-reply"]
        {}
        only chance most on
        /// The previous frame is sent again instead of the right one.
        PreviousReply = "previous-reply", Protocol,
        sees "An old reply: other values than requested, or the reply to another command.",
        counts "An old frame was sent. The first frame after the start has no previous one.",
        tries ["", "count = 1"]
        {}
        only "Only replaces replies to this command, or packets of this type; default all."
        chance most on
        /// The device sends a frame without a request.
        UnsolicitedFrame = "unsolicited-frame", Protocol,
        sees "A heartbeat reply, a status packet of zeros, or a line that it did not request.",
        counts "The frame was sent.",
        tries ["every = \"50 ms\"", ""]
        {
            /// Repeated at this interval; default once.
            #[serde(default, skip_serializing_if = "Option::is_none")]
            every: Option<Interval>,
        }
        most on
    }
}

impl Effect for FrameFault {
    fn check(&self) -> Result<(), String> {
        match self {
            Self::WrongLength { by: 0, .. } => {
                Err("`by`: 0 bytes more is the right length".to_owned())
            }
            _ => Ok(()),
        }
    }

    fn begin(&self, at: &mut Begin<'_>) -> Result<Work, EffectError> {
        let kind = self.clone();
        let mut on_frames = Frames::new(at, self.scope(), move |framing, frame, before| {
            kind.change(framing, frame, before)
        });
        if let Self::UnsolicitedFrame { every, .. } = self {
            on_frames.every = every.map(|every| every.0);
            on_frames.due = Some(at.now);
        }
        Ok(Work::Frames(Box::new(on_frames)))
    }
}

impl FrameFault {
    fn change(
        &self,
        framing: &Framing,
        frame: Vec<u8>,
        before: Option<Vec<u8>>,
    ) -> Option<Vec<Later>> {
        let at_once = |frame| vec![(Duration::ZERO, frame)];
        Some(match self {
            Self::WrongCommand { with, .. } => at_once(framing.with_command(frame, *with)),
            Self::WrongLength { by, what, .. } => at_once(with_length(framing, frame, *by, *what)),
            Self::TornReply { .. } => {
                let half = frame.len().div_ceil(2);
                at_once(frame[..half].to_vec())
            }
            Self::LateReply { by, .. } => vec![(by.0, frame)],
            Self::ReplyTwice { .. } => [at_once(frame.clone()), at_once(frame)].concat(),
            Self::MissingReply { .. } => Vec::new(),
            Self::PreviousReply { .. } => at_once(before?),
            Self::UnsolicitedFrame { .. } => return None,
        })
    }
}

/// A frame that is sent so much later.
pub type Later = (Duration, Vec<u8>);

/// Most frames that all faults together make of one.
const MOST_OF_ONE: usize = 16;

/// A fault of frames at work: `change` gets a frame and the one before it, and returns what is sent
/// instead; nothing if the frame stays as it is.
pub struct Frames<F> {
    framing: Framing,
    scope: Scope,
    noise: Noise,
    change: F,
    previous: Option<Vec<u8>>,
    every: Option<Duration>,
    due: Option<SimTime>,
}

impl<F> Frames<F>
where
    F: Fn(&Framing, Vec<u8>, Option<Vec<u8>>) -> Option<Vec<Later>> + Send + Sync,
{
    /// A fault that changes the frames that its scope says.
    pub fn new(at: &Begin<'_>, scope: Scope, change: F) -> Self {
        Self {
            framing: at.framing,
            scope,
            noise: (at.stream)("frames"),
            change,
            previous: None,
            every: None,
            due: None,
        }
    }
}

impl<F> OnFrames for Frames<F>
where
    F: Fn(&Framing, Vec<u8>, Option<Vec<u8>>) -> Option<Vec<Later>> + Send + Sync,
{
    fn pass(&mut self, frames: &mut Vec<TimedFrame>, tally: &mut Tally) {
        let (command, most) = (self.scope.command, self.scope.count);
        let chance = self.scope.probability.0;
        for (at, frame) in std::mem::take(frames) {
            let wanted = command.is_none_or(|command| self.framing.is_command(&frame, command));
            let happens = wanted && self.noise.uniform() < chance && tally.is_below(most);
            let before = self.previous.replace(frame.clone());
            let changed = happens.then(|| (self.change)(&self.framing, frame.clone(), before));
            match changed.flatten() {
                None => frames.push((at, frame)),
                Some(changed) => {
                    tally.hit(|| (self.framing.name)(&frame));
                    frames.extend(changed.into_iter().map(|(by, frame)| (at + by, frame)));
                }
            }
            frames.truncate(MOST_OF_ONE);
        }
    }

    fn due(&self) -> Option<SimTime> {
        self.due
    }

    fn send(&mut self, now: SimTime, tally: &mut Tally) -> Option<Vec<u8>> {
        self.due.filter(|due| *due <= now)?;
        let more = tally.is_below(self.scope.count);
        self.due = self.every.filter(|_| more).map(|every| now + every);
        let bytes = more.then(|| (self.framing.unasked)())?;
        tally.hit(|| format!("{} bytes without a request", bytes.len()));
        Some(bytes)
    }
}

/// So many bytes more or fewer, or a length field that says so.
fn with_length(framing: &Framing, mut frame: Vec<u8>, by: i8, what: WrongLength) -> Vec<u8> {
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
