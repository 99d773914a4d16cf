//! Commands and replies of an R150, for scripted clients.

use schemars::JsonSchema;

use super::R150_SPEC;
use crate::device::HostSpec;
use crate::device::host::{Message, frames};
use crate::message::Message as _;
use crate::r150_device::codec;
use crate::r150_device::command::Request;

pub(super) const HOST: HostSpec = HostSpec {
    read: |value, _| {
        let request: Request = rigsim_settings::read(value)?;
        Ok(Message {
            link: 0,
            bytes: request.encode(),
            command: Some(request.id()),
        })
    },
    schema: |generator| vec![Request::json_schema(generator)],
    frames: |link, sender, _| frames(codec::FORM, (&R150_SPEC, link), sender, false),
    plan: include_str!("identify.toml"),
    stop: "set_motors = { right = 0, left = 0 }",
    chatters: false,
};
