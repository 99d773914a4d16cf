//! The stream of the mecanum board's main link: packets without header or checksum.
//!
//! ```text
//! cmd_type | pkg_length | seq | fields; pkg_length counts the whole packet
//! ```
//!
//! All that tells a packet from noise is that a known type is followed by the length which that
//! type has. The article names neither a byte order nor a way to find the beginning of a packet
//! again; both are our assumptions, and the order is a setting.

use std::marker::PhantomData;
use std::time::Duration;

use super::settings::ByteOrder;
use crate::message::{Message, MessageInfo};
use crate::scanner::{Format, Read, Scanner};

/// Bytes of a packet before its fields: type and length.
const HEADER: usize = 2;

/// Reads a whole packet, fields little-endian; `None` if type or length is none of this
/// direction's.
#[must_use]
pub fn parse<P: Message>(bytes: &[u8]) -> Option<P> {
    let [kind, length, fields @ ..] = bytes else {
        return None;
    };
    let mut fields = fields;
    let info = P::info_of(*kind)?;
    let fits = usize::from(*length) == bytes.len() && fields.len() == info.length;
    fits.then(|| P::take(*kind, &mut fields)).flatten()
}

/// A whole packet, fields little-endian.
#[must_use]
pub fn encode<P: Message>(packet: &P) -> Vec<u8> {
    let mut bytes = vec![packet.info().id, length_byte(packet.info())];
    packet.put(&mut bytes);
    bytes
}

/// Turns the bytes of a packet of this direction from little-endian into `order`, or back.
pub fn reorder<P: Message>(bytes: &mut [u8], order: ByteOrder) {
    let info = bytes.first().and_then(|kind| P::info_of(*kind));
    let (Some(info), ByteOrder::Big) = (info, order) else {
        return;
    };
    let mut fields = bytes.get_mut(HEADER..).unwrap_or_default();
    for field in info.fields {
        for _ in 0..field.count.unwrap_or(1) {
            let Some((element, rest)) = fields.split_at_mut_checked(field.wire.size()) else {
                return;
            };
            element.reverse();
            fields = rest;
        }
    }
}

/// The length that a packet says it has: all of it.
fn length_byte(info: &MessageInfo) -> u8 {
    u8::try_from(HEADER + info.length).unwrap_or(u8::MAX)
}

/// Finding of the decoder in the stream.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Decoded<P> {
    /// A whole packet.
    Packet(P),
    /// A packet that was begun and not finished in time.
    Partial(Vec<u8>),
    /// Bytes that begin no packet.
    Noise(Vec<u8>),
}

/// Streaming decoder of the packets of one direction.
pub type Decoder<P> = Scanner<Packets<P>>;

impl<P: Message> Decoder<P> {
    /// A decoder that drops a partial packet after `inter_byte_timeout` of silence.
    #[must_use]
    pub const fn new(inter_byte_timeout: Duration, order: ByteOrder) -> Self {
        Self::of(Packets(order, PhantomData), inter_byte_timeout)
    }
}

/// The form of the packets of one direction.
#[derive(Debug, Clone, Copy)]
pub struct Packets<P>(ByteOrder, PhantomData<P>);

impl<P: Message> Format for Packets<P> {
    type Decoded = Decoded<P>;

    fn may_begin(&self, bytes: &[u8]) -> bool {
        let length = bytes.get(1);
        P::info_of(bytes[0])
            .is_some_and(|info| length.is_none_or(|length| *length == length_byte(info)))
    }

    fn read(&self, bytes: &[u8]) -> Read<Decoded<P>> {
        let length = bytes.get(1).copied().map(usize::from);
        let Some(bytes) = length.and_then(|length| bytes.get(..length)) else {
            return Read::Begun;
        };
        let mut bytes = bytes.to_vec();
        reorder::<P>(&mut bytes, self.0);
        match parse::<P>(&bytes) {
            Some(packet) => Read::Whole(bytes.len(), Decoded::Packet(packet)),
            None => Read::Noise(bytes.len().max(1)),
        }
    }

    fn partial(bytes: Vec<u8>) -> Decoded<P> {
        Decoded::Partial(bytes)
    }

    fn noise(bytes: Vec<u8>) -> Decoded<P> {
        Decoded::Noise(bytes)
    }
}

#[cfg(test)]
mod tests;
