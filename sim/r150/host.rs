//! Commands and replies of an R150, for scripted clients.

use std::time::Duration;

use rigsim_settings::SimTime;
use schemars::JsonSchema;

use crate::device::HostSpec;
use crate::device::host::{Message, Reply as Found, ReplyReader};
use crate::r150_device::codec::{Decoded, Decoder, Frame};
use crate::r150_device::command::{Reply, Request};
use crate::r150_device::settings::Resync;

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
    reader: |_, _| Box::new(Reader(Decoder::new(PAUSE, Resync::SecondByte))),
    chatters: false,
};

struct Reader(Decoder);

impl ReplyReader for Reader {
    fn push(&mut self, now: SimTime, byte: u8) -> Vec<Found> {
        let mut found = Vec::new();
        self.0.expire(now, &mut |_| {});
        self.0.push(now, byte, &mut |decoded| {
            if let Decoded::Frame(frame) = decoded {
                found.extend(read_frame(&frame));
            }
        });
        found
    }
}

/// A reply; some modules set the command's high bit in it.
fn read_frame(frame: &Frame) -> Option<Found> {
    let plain = [frame.command(), frame.command() & 0x7F];
    plain.into_iter().find_map(|command| {
        let reply = Reply::parse(command, frame.parameters()).ok()?;
        Some(Found {
            command: Some(command),
            fields: reply.fields(),
        })
    })
}
