//! Frames in the bytes that a recording has of each line.

use std::collections::BTreeMap;

use rigsim_core::SimTime;
use rigsim_core::device::Form;
use rigsim_core::device::host::{self, FrameReader};
use rigsim_core::message::Sender;
use rigsim_core::rig::PortId;
use rigsim_runner::Run;

/// Bytes that belong together on a line, as the client sent or received them.
#[derive(Debug, Clone)]
pub(super) struct Frame {
    pub(super) port: PortId,
    pub(super) sender: Sender,
    /// Time of the last byte.
    pub(super) at: SimTime,
    pub(super) found: host::Frame,
    pub(super) is_noise: bool,
}

/// One direction of a line.
struct Stream {
    reader: Box<dyn FrameReader>,
    is_text: bool,
    /// Bytes that are in no frame yet.
    bytes: Vec<u8>,
    last: SimTime,
}

impl Stream {
    /// Adds bytes, and returns what they complete: the time of its last byte, and whether it is noise.
    fn add(
        &mut self,
        bytes: impl Iterator<Item = (SimTime, u8)>,
    ) -> Vec<(SimTime, host::Frame, bool)> {
        let mut frames = Vec::new();
        for (now, byte) in bytes {
            self.bytes.push(byte);
            for found in self.reader.push(now, byte) {
                // What is found in a torn frame has been reported with that.
                let is_new = self.bytes.starts_with(&found.bytes);
                let count = if is_new {
                    found.bytes.len()
                } else {
                    self.bytes.len()
                };
                self.bytes.drain(..count);
                let ends_now = self.bytes.is_empty() && found.bytes.last() == Some(&byte);
                if self.bytes.is_empty() && !ends_now {
                    self.bytes.push(byte);
                }
                let at = if ends_now { now } else { self.last };
                let is_noise = !self.is_text && found.command.is_none() && found.message.is_none();
                frames.push((at, found, is_noise));
            }
            self.last = now;
        }
        frames
    }
}

/// All lines.
pub(super) struct Streams(BTreeMap<(PortId, bool), Stream>);

impl Streams {
    pub(super) fn new(run: &Run) -> Self {
        let mut streams = BTreeMap::new();
        for port in run.ports() {
            let plan = &run.scenario().rig.devices[port.device];
            let form = plan.device.links.get(port.link);
            let form = form.map(|link| link.framing.form);
            let Some(own) = plan.own_settings() else {
                continue;
            };
            for sender in [Sender::Client, Sender::Device] {
                let stream = Stream {
                    reader: (plan.device.host.frames)(port.link, sender, own),
                    is_text: matches!(form, Some(Form::Lines)),
                    bytes: Vec::new(),
                    last: SimTime::ZERO,
                };
                streams.insert((*port, sender == Sender::Device), stream);
            }
        }
        Self(streams)
    }

    /// Adds bytes, each with its time, and returns the frames that they complete.
    pub(super) fn add(
        &mut self,
        port: PortId,
        sender: Sender,
        bytes: impl Iterator<Item = (SimTime, u8)>,
    ) -> Vec<Frame> {
        let stream = self.0.get_mut(&(port, sender == Sender::Device));
        let found = stream.map_or_else(Vec::new, |stream| stream.add(bytes));
        let frame = |(at, found, is_noise)| Frame {
            port,
            sender,
            at,
            found,
            is_noise,
        };
        found.into_iter().map(frame).collect()
    }

    /// Returns what was begun and never finished.
    pub(super) fn rest(&mut self) -> Vec<Frame> {
        let streams = self.0.iter_mut();
        let streams = streams.filter(|(_, stream)| !stream.bytes.is_empty());
        let rest = streams.map(|((port, to_client), stream)| Frame {
            port: *port,
            sender: if *to_client {
                Sender::Device
            } else {
                Sender::Client
            },
            at: stream.last,
            found: host::Frame::none(std::mem::take(&mut stream.bytes)),
            is_noise: true,
        });
        rest.collect()
    }
}

#[cfg(test)]
mod tests;
