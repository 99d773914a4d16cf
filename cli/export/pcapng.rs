//! Packet captures, one packet a frame, for Wireshark.
//!
//! Packets are upper PDUs (link type 252), which name their dissector, so that Wireshark needs no setting.

use std::collections::VecDeque;
use std::io::{self, Write as _};

use rigsim_core::SimTime;
use rigsim_core::device::host;
use rigsim_core::event::Event;
use rigsim_core::rig::PortId;
use rigsim_runner::Run;
use rigsim_runner::trace::Record;

use super::dissector::dissector_name;
use super::frames::Frame;
use super::{About, Item, Out, VERSION, Writer};
use crate::log::Words;

/// Packets that wait for comments: what they lead to comes a little later.
const WAITING: usize = 64;
/// Link type of upper PDUs.
const UPPER_PDU: u16 = 252;
/// Tag of an upper PDU: name of its dissector.
const DISSECTOR: u16 = 12;
const COMMENT: u16 = 1;

pub(super) struct Pcapng {
    out: Out,
    date: u64,
    words: Words,
    /// Lines as Wireshark knows them, with their dissectors.
    interfaces: Vec<(PortId, String)>,
    /// With their comments.
    waiting: VecDeque<(Frame, Vec<String>)>,
}

impl Pcapng {
    pub(super) fn begin(run: &Run, about: &About, out: Out) -> io::Result<Self> {
        let scenario = run.scenario();
        let mut pcapng = Self {
            out,
            date: about.date,
            words: Words::new(&scenario.rig),
            interfaces: Vec::new(),
            waiting: VecDeque::new(),
        };
        let title = format!("{}, seed {}\n{}", scenario.title, run.seed(), about.command);
        let section = [
            &0x1A2B_3C4D_u32.to_le_bytes()[..],
            &[1, 0, 0, 0],
            &[0xFF; 8],
        ]
        .concat();
        pcapng.block(
            0x0A0D_0D0A,
            section,
            &[(COMMENT, title.as_bytes()), (4, VERSION.as_bytes())],
        )?;
        for link in scenario.rig.links() {
            let device = scenario.rig.devices[link.id.device].device;
            let name = match link.id.link {
                0 => link.device,
                index => format!("{}/{}", link.device, device.links[index].id),
            };
            let interface = [&UPPER_PDU.to_le_bytes()[..], &[0; 6]].concat();
            // Times are in nanoseconds.
            pcapng.block(1, interface, &[(2, name.as_bytes()), (9, &[9])])?;
            pcapng
                .interfaces
                .push((link.id, dissector_name(device, link.id.link)));
        }
        Ok(pcapng)
    }

    fn block(&mut self, kind: u32, mut body: Vec<u8>, options: &[(u16, &[u8])]) -> io::Result<()> {
        for (code, value) in options.iter().chain(&[(0, &[][..])]) {
            let value = &value[..value.len().min(usize::from(u16::MAX))];
            body.extend(
                [
                    code.to_le_bytes(),
                    number::<u16, _>(value.len()).to_le_bytes(),
                ]
                .concat(),
            );
            body.extend(padded(value));
        }
        let length = number::<u32, _>(body.len() + 12).to_le_bytes();
        self.out
            .write_all(&[&kind.to_le_bytes(), &length, &body[..], &length].concat())
    }

    fn packet(&mut self, (frame, comments): &(Frame, Vec<String>)) -> io::Result<()> {
        let (port, is_reply) = frame.way;
        let mut interfaces = self.interfaces.iter();
        let Some(index) = interfaces.position(|(own, _)| *own == port) else {
            return Ok(());
        };
        let name = if frame.is_noise {
            "data"
        } else {
            &self.interfaces[index].1
        };
        let name = padded(name.as_bytes());
        let tag = [
            DISSECTOR.to_be_bytes(),
            number::<u16, _>(name.len()).to_be_bytes(),
        ]
        .concat();
        let data = [&tag[..], &name, &[0; 4], &frame.found.bytes].concat();
        let time = self.date.saturating_add(frame.at.as_nanos());
        let [high, low] = [time >> 32, time & 0xFFFF_FFFF].map(number);
        let head = [
            number(index),
            high,
            low,
            number(data.len()),
            number(data.len()),
        ];
        let body = [head.map(u32::to_le_bytes).concat(), padded(&data)].concat();
        // As the client's machine sees it: replies come in, requests go out.
        let direction: u32 = if is_reply { 1 } else { 2 };
        let direction = direction.to_le_bytes();
        let comments = comments.iter().map(|comment| (COMMENT, comment.as_bytes()));
        let options: Vec<_> = comments.chain([(2, &direction[..])]).collect();
        self.block(6, body, &options)
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
        if let Some((_, comments)) = packets.rfind(|(frame, _)| fits(frame)) {
            return comments.push(comment);
        }
        let (way, found) = ((port, true), host::Frame::none(Vec::new()));
        let frame = Frame {
            way,
            at,
            found,
            is_noise: true,
        };
        self.waiting.push_back((frame, vec![comment]));
    }

    fn event(&mut self, event: &Event) {
        let kind = &event.kind;
        let is_fault = kind.fault().is_some();
        let device = event.device;
        let port = PortId {
            device,
            link: kind.link().unwrap_or(0),
        };
        if is_fault || kind.is_client_error() {
            self.comment(
                event.at,
                port,
                self.words.plain(event),
                |frame| match is_fault {
                    true => frame.way.0.device == device,
                    false => frame.way == (port, false),
                },
            );
        }
    }
}

impl Writer for Pcapng {
    fn take(&mut self, at: SimTime, item: Item) -> io::Result<()> {
        match item {
            Item::Event(event) => self.event(&event),
            Item::Frame(frame) => {
                let noise = frame
                    .is_noise
                    .then(|| "noise: bytes that are not a frame".to_owned());
                self.waiting.push_back((frame, noise.into_iter().collect()));
            }
            Item::Record(Record::Failure { step, what, .. }) => {
                let step = step.map(|step| format!("\"{step}\": ")).unwrap_or_default();
                let port = PortId { device: 0, link: 0 };
                self.comment(at, port, format!("FAILED: {step}{what}"), |_| true);
            }
            _ => {}
        }
        match self.waiting.len() > WAITING {
            true => self
                .waiting
                .pop_front()
                .map_or(Ok(()), |packet| self.packet(&packet)),
            false => Ok(()),
        }
    }

    fn finish(mut self: Box<Self>) -> io::Result<()> {
        let rest = std::mem::take(&mut self.waiting);
        rest.iter().try_for_each(|packet| self.packet(packet))?;
        self.out.flush()
    }
}

/// A number of the file, which is small.
fn number<N: TryFrom<T> + Default, T>(number: T) -> N {
    N::try_from(number).unwrap_or_default()
}

/// Bytes with zeros up to a multiple of four.
fn padded(bytes: &[u8]) -> Vec<u8> {
    let mut padded = bytes.to_vec();
    padded.resize(bytes.len().next_multiple_of(4), 0);
    padded
}
