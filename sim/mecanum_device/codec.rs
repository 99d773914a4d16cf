//! The stream of the mecanum board's main link: packets without header or checksum.
//!
//! ```text
//! cmd_type | pkg_length | seq | fields; pkg_length counts the whole packet
//! ```
//!
//! All that tells a packet from noise is that a known type is followed by the length which that
//! type has. The article names neither a byte order nor a way to find the beginning of a packet
//! again; both are our assumptions, and the order is a setting.

use std::time::Duration;

use super::settings::ByteOrder;
use crate::message::Message;
use crate::scanner::{Form, Scanner};

/// Bytes of a packet before its fields: type and length.
const HEADER: usize = 2;

/// Reads a whole packet whose fields have this byte order; `None` if type or length is none of this
/// direction's.
#[must_use]
pub fn parse<P: Message>(bytes: &[u8], order: ByteOrder) -> Option<P> {
    let mut bytes = bytes.to_vec();
    reorder::<P>(&mut bytes, order);
    let [kind, length, ref fields @ ..] = bytes[..] else {
        return None;
    };
    let mut fields = fields;
    let info = P::info_of(kind)?;
    let fits = usize::from(length) == HEADER + fields.len() && fields.len() == info.length;
    fits.then(|| P::take(kind, &mut fields)).flatten()
}

/// A whole packet, fields little-endian.
#[must_use]
pub fn encode<P: Message>(packet: &P) -> Vec<u8> {
    let mut bytes = vec![packet.info().id, 0];
    packet.put(&mut bytes);
    bytes[1] = u8::try_from(bytes.len()).unwrap_or(u8::MAX);
    bytes
}

/// Turns the bytes of a packet of this direction from little-endian into `order`, or back.
pub fn reorder<P: Message>(bytes: &mut [u8], order: ByteOrder) {
    let info = bytes.first().and_then(|kind| P::info_of(*kind));
    let (Some(info), ByteOrder::Big) = (info, order) else {
        return;
    };
    info.swap_bytes(bytes.get_mut(HEADER..).unwrap_or_default());
}

/// The form of packets.
pub const FORM: Form = Form::Frames {
    header: &[],
    length_at: 1,
    uncounted: 0,
    id_at: 0,
    answers: None,
    fields_at: HEADER,
    check: None,
};

/// A decoder of the packets of one direction that drops a partial one after `inter_byte_timeout` of
/// silence.
#[must_use]
pub fn decoder<P: Message>(inter_byte_timeout: Duration) -> Scanner {
    Scanner::new(FORM, P::INFOS, inter_byte_timeout)
}

#[cfg(test)]
mod tests;
