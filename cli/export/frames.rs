//! Frames in the bytes that a recording has of each line.

use std::collections::BTreeMap;

use rigsim_core::SimTime;
use rigsim_core::device::Form;
use rigsim_core::device::host::{self, FrameReader};
use rigsim_core::message::Sender;
use rigsim_core::rig::PortId;
use rigsim_runner::Run;

/// A direction of a line: `true` is that of the replies.
pub(super) type Way = (PortId, bool);

/// Bytes that belong together on a line, as the client sent or received them.
#[derive(Debug, Clone)]
pub(super) struct Frame {
    pub(super) way: Way,
    /// Time of the last byte.
    pub(super) at: SimTime,
    pub(super) found: host::Frame,
    pub(super) is_noise: bool,
}

/// Bytes of one direction of a line.
struct Stream {
    way: Way,
    reader: Box<dyn FrameReader>,
    is_text: bool,
    /// Bytes that are in no frame yet.
    bytes: Vec<u8>,
    last: SimTime,
}

impl Stream {
    /// Adds a byte, and returns what ends with it or before it.
    fn add(&mut self, now: SimTime, byte: u8) -> Vec<Frame> {
        self.bytes.push(byte);
        let before = std::mem::replace(&mut self.last, now);
        let found = self.reader.push(now, byte).into_iter();
        let mut frame = |found: host::Frame| {
            // What is found in a torn frame has been reported with that.
            let is_new = self.bytes.starts_with(&found.bytes);
            let whole = self.bytes.len();
            self.bytes
                .drain(..if is_new { found.bytes.len() } else { whole });
            let ends_now = self.bytes.is_empty() && found.bytes.last() == Some(&byte);
            if self.bytes.is_empty() && !ends_now {
                self.bytes.push(byte);
            }
            Frame {
                way: self.way,
                at: if ends_now { now } else { before },
                is_noise: !self.is_text && found.command.is_none() && found.message.is_none(),
                found,
            }
        };
        found.map(&mut frame).collect()
    }
}

/// Both directions of all lines.
#[derive(Default)]
pub(super) struct Streams(BTreeMap<Way, Stream>);

impl Streams {
    pub(super) fn new(run: &Run) -> Self {
        let ports = run.ports().iter();
        let ways = ports.flat_map(|port| [(*port, false), (*port, true)]);
        let stream = |way: Way| {
            let plan = &run.scenario().rig.devices[way.0.device];
            let sender = [Sender::Client, Sender::Device][usize::from(way.1)];
            let stream = Stream {
                way,
                reader: (plan.device.host.frames)(way.0.link, sender, plan.own_settings()?),
                is_text: matches!(plan.device.links[way.0.link].framing.form, Form::Lines),
                bytes: Vec::new(),
                last: SimTime::ZERO,
            };
            Some((way, stream))
        };
        Self(ways.filter_map(stream).collect())
    }

    /// Adds bytes with their times, and returns the frames that they complete.
    pub(super) fn add(&mut self, way: Way, bytes: &[(SimTime, u8)]) -> Vec<Frame> {
        let stream = self.0.get_mut(&way).into_iter();
        let add = |stream: &mut Stream| {
            let frames = bytes.iter().flat_map(|(at, byte)| stream.add(*at, *byte));
            frames.collect::<Vec<_>>()
        };
        stream.flat_map(add).collect()
    }

    /// Returns what was begun and never finished.
    pub(super) fn rest(self) -> impl Iterator<Item = Frame> {
        let begun = self
            .0
            .into_values()
            .filter(|stream| !stream.bytes.is_empty());
        begun.map(|stream| Frame {
            way: stream.way,
            at: stream.last,
            found: host::Frame::none(stream.bytes),
            is_noise: true,
        })
    }
}

#[cfg(test)]
mod tests;
