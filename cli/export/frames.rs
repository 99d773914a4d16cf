//! Frames in the bytes that a recording has of each line.

use std::collections::BTreeMap;
use std::time::Duration;

use rigsim_core::SimTime;
use rigsim_core::device::{Form, Part};
use rigsim_core::message::{MessageInfo, Sender};
use rigsim_core::rig::PortId;
use rigsim_runner::Run;
use rigsim_runner::trace::PortRecord;

/// A frame that was begun and not gone on with for so long is noise.
const SILENCE: Duration = Duration::from_millis(50);
/// Most bytes of noise in one piece.
const MOST_NOISE: usize = 64;

/// Bytes that belong together on a line, as the client sent or got them.
#[derive(Debug, Clone)]
pub(super) struct Frame {
    pub(super) port: PortId,
    pub(super) sender: Sender,
    /// Time of the last byte.
    pub(super) at: SimTime,
    pub(super) bytes: Vec<u8>,
    pub(super) is_noise: bool,
}

/// One direction of a line.
struct Stream {
    form: Form,
    messages: Vec<&'static MessageInfo>,
    bytes: Vec<u8>,
    times: Vec<SimTime>,
    /// Bytes at the front that begin no frame.
    noise: usize,
}

/// All lines.
pub(super) struct Streams(BTreeMap<(PortId, bool), Stream>);

impl Streams {
    pub(super) fn new(run: &Run) -> Self {
        let both = |port: &PortId| [(*port, false), (*port, true)];
        let stream = |(port, to_client): (PortId, bool)| {
            let device = run.rig().any_device(port.device)?;
            let sender = if to_client {
                Sender::Device
            } else {
                Sender::Client
            };
            let own = |info: &&MessageInfo| info.link == port.link && info.sender == sender;
            let messages = run.rig().spec(port.device)?.all_messages();
            let stream = Stream {
                form: device.framing(port.link).form(),
                messages: messages.filter(own).collect(),
                bytes: Vec::new(),
                times: Vec::new(),
                noise: 0,
            };
            Some(((port, to_client), stream))
        };
        let links = |device| (0..run.rig().links(device)).map(move |link| PortId { device, link });
        let ports = (0..run.rig().devices()).flat_map(links);
        let ports: Vec<PortId> = ports.collect();
        Self(ports.iter().flat_map(both).filter_map(stream).collect())
    }

    /// Adds bytes, each with its time, and returns the frames that they complete.
    pub(super) fn add(
        &mut self,
        port: PortRecord,
        sender: Sender,
        bytes: impl Iterator<Item = (SimTime, u8)>,
    ) -> Vec<Frame> {
        let port = PortId::from(port);
        let mut frames = Vec::new();
        if let Some(stream) = self.0.get_mut(&(port, sender == Sender::Device)) {
            for (at, byte) in bytes {
                stream.silence(port, sender, at, &mut frames);
                stream.bytes.push(byte);
                stream.times.push(at);
                stream.split(port, sender, &mut frames);
            }
        }
        frames
    }

    /// What was begun long before this time is noise.
    pub(super) fn silence(&mut self, now: SimTime) -> Vec<Frame> {
        let mut frames = Vec::new();
        for ((port, to_client), stream) in &mut self.0 {
            let sender = if *to_client {
                Sender::Device
            } else {
                Sender::Client
            };
            stream.silence(*port, sender, now, &mut frames);
        }
        frames
    }
}

impl Stream {
    fn silence(&mut self, port: PortId, sender: Sender, now: SimTime, frames: &mut Vec<Frame>) {
        if self
            .times
            .last()
            .is_some_and(|last| now.since(*last) > SILENCE)
        {
            let all = self.bytes.len();
            frames.extend(self.cut(port, sender, all, true));
        }
    }

    fn split(&mut self, port: PortId, sender: Sender, frames: &mut Vec<Frame>) {
        while let Some(rest) = self.bytes.get(self.noise..).filter(|rest| !rest.is_empty()) {
            match self.form.part(rest, sender, self.messages.iter().copied()) {
                Part::Begun => return,
                Part::Noise(count) => self.noise += count,
                Part::Frame(length) => {
                    frames.extend(self.cut(port, sender, self.noise, true));
                    frames.extend(self.cut(port, sender, length, false));
                }
            }
            if self.noise >= MOST_NOISE {
                frames.extend(self.cut(port, sender, self.noise, true));
            }
        }
    }

    /// Takes bytes off the front.
    fn cut(&mut self, port: PortId, sender: Sender, count: usize, is_noise: bool) -> Option<Frame> {
        self.noise = 0;
        let bytes: Vec<u8> = self.bytes.drain(..count).collect();
        let times: Vec<SimTime> = self.times.drain(..count).collect();
        Some(Frame {
            port,
            sender,
            at: *times.last()?,
            bytes,
            is_noise,
        })
    }
}
