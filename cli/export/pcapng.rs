//! Packet captures, one packet a frame, for Wireshark.
//!
//! Packets are upper PDUs (link type 252), which name their dissector, so that Wireshark needs no setting.

use std::collections::VecDeque;
use std::io::{self, Write as _};

use rigsim_core::SimTime;
use rigsim_core::device::host;
use rigsim_core::event::Event;
use rigsim_core::message::Sender;
use rigsim_core::rig::PortId;
use rigsim_runner::Run;
use rigsim_runner::trace::Record;

use super::dissector::dissector_name;
use super::frames::Frame;
use super::{About, Item, Out, Writer};
use crate::log::Words;

/// Packets that wait for comments: what they lead to comes a little later.
const WAITING: usize = 64;
/// Link type of upper PDUs.
const UPPER_PDU: u16 = 252;
/// Tag of an upper PDU: name of its dissector.
const DISSECTOR: u16 = 12;
const COMMENT: u16 = 1;

struct Packet {
    frame: Frame,
    comments: Vec<String>,
}

/// A line as Wireshark knows it.
struct Interface {
    port: PortId,
    dissector: String,
}

pub(super) struct Pcapng {
    out: Out,
    date: u64,
    words: Words,
    interfaces: Vec<Interface>,
    waiting: VecDeque<Packet>,
}

impl Pcapng {
    pub(super) fn begin(run: &Run, about: &About, out: Out) -> io::Result<Self> {
        let rig = &run.scenario().rig;
        let mut pcapng = Self {
            out,
            date: about.date,
            words: Words::new(rig),
            interfaces: Vec::new(),
            waiting: VecDeque::new(),
        };
        let mut section = Vec::new();
        section.extend(0x1A2B_3C4D_u32.to_le_bytes());
        section.extend([1, 0, 0, 0]);
        section.extend((-1_i64).to_le_bytes());
        let title = format!(
            "{}, seed {}\n{}",
            run.scenario().title,
            run.seed(),
            about.command
        );
        option(&mut section, COMMENT, title.as_bytes());
        let program = concat!("sim ", env!("CARGO_PKG_VERSION"));
        option(&mut section, 4, program.as_bytes());
        pcapng.block(0x0A0D_0D0A, section)?;
        for (device, plan) in rig.devices.iter().enumerate() {
            for link in 0..run.rig().links(device) {
                let name = match plan.device.links.get(link) {
                    Some(spec) if link > 0 => format!("{}/{}", plan.name, spec.id),
                    _ => plan.name.clone(),
                };
                let mut interface = Vec::new();
                interface.extend(UPPER_PDU.to_le_bytes());
                interface.extend([0; 6]);
                option(&mut interface, 2, name.as_bytes());
                // Times are in nanoseconds.
                option(&mut interface, 9, &[9]);
                pcapng.block(1, interface)?;
                pcapng.interfaces.push(Interface {
                    port: PortId { device, link },
                    dissector: dissector_name(plan.device, link),
                });
            }
        }
        Ok(pcapng)
    }

    fn block(&mut self, kind: u32, mut body: Vec<u8>) -> io::Result<()> {
        // The end of its options.
        body.extend([0; 4]);
        let length = u32::try_from(body.len() + 12)
            .unwrap_or(u32::MAX)
            .to_le_bytes();
        self.out.write_all(&kind.to_le_bytes())?;
        self.out.write_all(&length)?;
        self.out.write_all(&body)?;
        self.out.write_all(&length)
    }

    fn packet(&mut self, packet: &Packet) -> io::Result<()> {
        let frame = &packet.frame;
        let mut interfaces = self.interfaces.iter();
        let Some(index) = interfaces.position(|one| one.port == frame.port) else {
            return Ok(());
        };
        let mut data = Vec::new();
        let dissector = match frame.is_noise {
            true => "data",
            false => &self.interfaces[index].dissector,
        };
        let name = padded(dissector.as_bytes());
        data.extend(DISSECTOR.to_be_bytes());
        data.extend(u16::try_from(name.len()).unwrap_or(u16::MAX).to_be_bytes());
        data.extend(name);
        data.extend([0; 4]);
        data.extend(&frame.found.bytes);

        let time = self.date.saturating_add(frame.at.as_nanos());
        let length = u32::try_from(data.len()).unwrap_or(u32::MAX);
        let mut body = Vec::new();
        body.extend(u32::try_from(index).unwrap_or(u32::MAX).to_le_bytes());
        let [low, high] = [time & 0xFFFF_FFFF, time >> 32];
        for half in [high, low] {
            body.extend(u32::try_from(half).unwrap_or(u32::MAX).to_le_bytes());
        }
        body.extend([length.to_le_bytes(), length.to_le_bytes()].concat());
        body.extend(padded(&data));
        for comment in &packet.comments {
            option(&mut body, COMMENT, comment.as_bytes());
        }
        // As the client's machine sees it: replies come in, requests go out.
        let direction: u32 = if frame.sender == Sender::Device { 1 } else { 2 };
        option(&mut body, 2, &direction.to_le_bytes());
        self.block(6, body)
    }

    /// Comments on the newest packet that fits, or on an empty one.
    fn comment(
        &mut self,
        at: SimTime,
        port: PortId,
        comment: String,
        fits: impl Fn(&Frame) -> bool,
    ) {
        let mut packets = self.waiting.iter_mut();
        let packet = packets.rfind(|packet| packet.frame.at <= at && fits(&packet.frame));
        if let Some(packet) = packet {
            packet.comments.push(comment);
            return;
        }
        let frame = Frame {
            port,
            sender: Sender::Device,
            at,
            found: host::Frame::none(Vec::new()),
            is_noise: true,
        };
        self.waiting.push_back(Packet {
            frame,
            comments: vec![comment],
        });
    }

    fn event(&mut self, event: &Event) {
        let kind = &event.kind;
        let is_fault = kind.fault().is_some();
        if !is_fault && !kind.is_client_error() {
            return;
        }
        let port = PortId {
            device: event.device,
            link: kind.link().unwrap_or(0),
        };
        let fits = |frame: &Frame| match is_fault {
            true => frame.port.device == port.device,
            false => frame.port == port && frame.sender == Sender::Client,
        };
        self.comment(event.at, port, self.words.plain(event), fits);
    }
}

impl Writer for Pcapng {
    fn take(&mut self, at: SimTime, item: &Item<'_>) -> io::Result<()> {
        match item {
            Item::Event(event) => self.event(event),
            Item::Frame(frame) => {
                let noise = frame
                    .is_noise
                    .then(|| "noise: bytes that are no frame".to_owned());
                self.waiting.push_back(Packet {
                    frame: (*frame).clone(),
                    comments: noise.into_iter().collect(),
                });
            }
            Item::Record(Record::Failure { step, what, .. }) => {
                let step = step.as_ref().map(|step| format!("\"{step}\": "));
                let text = format!("FAILED: {}{what}", step.unwrap_or_default());
                let port = PortId { device: 0, link: 0 };
                self.comment(at, port, text, |_| true);
            }
            Item::Record(_) | Item::Values(_) => {}
        }
        while self.waiting.len() > WAITING {
            if let Some(packet) = self.waiting.pop_front() {
                self.packet(&packet)?;
            }
        }
        Ok(())
    }

    fn finish(mut self: Box<Self>) -> io::Result<()> {
        for packet in std::mem::take(&mut self.waiting) {
            self.packet(&packet)?;
        }
        self.out.flush()
    }
}

/// Bytes with zeros up to a multiple of four.
fn padded(bytes: &[u8]) -> Vec<u8> {
    let mut padded = bytes.to_vec();
    padded.resize(bytes.len().next_multiple_of(4), 0);
    padded
}

/// Adds an option, cut to what fits its length.
fn option(body: &mut Vec<u8>, code: u16, value: &[u8]) {
    let value = &value[..value.len().min(usize::from(u16::MAX))];
    body.extend(code.to_le_bytes());
    body.extend(u16::try_from(value.len()).unwrap_or(u16::MAX).to_le_bytes());
    body.extend(padded(value));
}
