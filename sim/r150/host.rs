//! Commands and replies of an R150, for scripted clients.

use std::time::Duration;

use rigsim_settings::SimTime;
use schemars::JsonSchema;

use crate::device::HostSpec;
use crate::device::host::{Frame as Found, FrameReader, Message, Sender};
use crate::message::Message as _;
use crate::r150_device::codec::{Decoded, Decoder, Frame};
use crate::r150_device::command::{Reply, Request};

/// Silence after which a client gives up a frame that was begun.
const PAUSE: Duration = Duration::from_millis(50);

pub(super) const HOST: HostSpec = HostSpec {
    read: |value, _| {
        let request: Request = rigsim_settings::read(value)?;
        Ok(Message {
            link: 0,
            bytes: request.encode(),
            command: Some(request.command()),
        })
    },
    schema: |generator| vec![Request::json_schema(generator)],
    frames: |_, sender, _| Box::new(Reader(Decoder::new(PAUSE), sender)),
    plan: include_str!("identify.toml"),
    chatters: false,
};

struct Reader(Decoder, Sender);

impl FrameReader for Reader {
    fn push(&mut self, now: SimTime, byte: u8) -> Vec<Found> {
        let mut found = Vec::new();
        let sender = self.1;
        let mut take = |decoded| {
            found.push(match decoded {
                Decoded::Frame(frame) => read_frame(&frame, sender),
                Decoded::BadCrc { bytes, command, .. } => Found {
                    command: Some(command),
                    ..Found::none(bytes)
                },
                Decoded::Partial(bytes) | Decoded::Noise(bytes) => Found::none(bytes),
            });
        };
        self.0.expire(now, &mut take);
        self.0.push(now, byte, &mut take);
        found
    }
}

/// A request or a reply; some modules set the command's high bit in a reply.
fn read_frame(frame: &Frame, sender: Sender) -> Found {
    let parameters = frame.parameters();
    let find = |command: u8| {
        let info = match sender {
            Sender::Client => Request::parse(command, parameters).ok()?.info(),
            Sender::Device => Reply::parse(command, parameters).ok()?.info(),
        };
        Some((command, info))
    };
    let plain = [frame.command(), frame.command() & 0x7F];
    let found = plain.into_iter().find_map(find);
    Found {
        bytes: frame.bytes().to_vec(),
        command: Some(found.map_or(frame.command(), |(command, _)| command)),
        command_byte: Some(frame.command()),
        message: found.map(|(_, info)| (info, parameters.to_vec())),
    }
}
