//! A decoder on a stream, beside what a second reading finds.

use std::ops::Range;
use std::time::Duration;

use sim_core::SimTime;
use sim_core::mecanum_device::codec::{Decoded as Packets, Decoder as PacketDecoder, Packet};
use sim_core::mecanum_device::settings::ByteOrder;
use sim_core::r150_device::codec::{Decoded, Decoder, encode};

use super::Stream;

/// Silence after which the decoders give a partial frame up.
pub(super) const TIMEOUT: Duration = Duration::from_millis(20);
/// A pause that is shorter.
const BREATH: Duration = Duration::from_millis(19);

/// Bytes that a report of a decoder covers.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Found {
    /// A whole frame or packet, as it was sent.
    Good(Vec<u8>),
    /// So many bytes of none.
    Bad(usize),
}

/// A decoder that keeps a beginning until it is whole or given up.
pub(super) trait Decode {
    fn push(&mut self, now: SimTime, byte: u8, found: &mut Vec<Found>);
    fn expire(&mut self, now: SimTime, found: &mut Vec<Found>);
    fn deadline(&self) -> Option<SimTime>;
}

impl Decode for Decoder {
    fn push(&mut self, now: SimTime, byte: u8, found: &mut Vec<Found>) {
        self.push(now, byte, &mut |decoded| found.push(of_frame(&decoded)));
    }

    fn expire(&mut self, now: SimTime, found: &mut Vec<Found>) {
        self.expire(now, &mut |decoded| found.push(of_frame(&decoded)));
    }

    fn deadline(&self) -> Option<SimTime> {
        self.deadline()
    }
}

fn of_frame(decoded: &Decoded) -> Found {
    match decoded {
        Decoded::Frame(frame) => Found::Good(encode(frame.command, &frame.parameters)),
        Decoded::BadCrc { bytes, .. } | Decoded::Partial(bytes) | Decoded::Noise(bytes) => {
            Found::Bad(bytes.len())
        }
    }
}

/// The decoder of one direction of the main link, and how its packets are written.
pub(super) struct Direction<P> {
    pub(super) decoder: PacketDecoder<P>,
    pub(super) encode: fn(&P) -> Vec<u8>,
    pub(super) order: ByteOrder,
}

impl<P: Packet> Direction<P> {
    fn found(encode: fn(&P) -> Vec<u8>, order: ByteOrder, decoded: &Packets<P>) -> Found {
        match decoded {
            Packets::Packet(packet) => {
                let mut bytes = encode(packet);
                P::reorder(&mut bytes, order);
                Found::Good(bytes)
            }
            Packets::Partial(bytes) | Packets::Noise(bytes) => Found::Bad(bytes.len()),
        }
    }
}

impl<P: Packet> Decode for Direction<P> {
    fn push(&mut self, now: SimTime, byte: u8, found: &mut Vec<Found>) {
        let (encode, order) = (self.encode, self.order);
        let mut take = |decoded| found.push(Self::found(encode, order, &decoded));
        self.decoder.push(now, byte, &mut take);
    }

    fn expire(&mut self, now: SimTime, found: &mut Vec<Found>) {
        let (encode, order) = (self.encode, self.order);
        let mut take = |decoded| found.push(Self::found(encode, order, &decoded));
        self.decoder.expire(now, &mut take);
    }

    fn deadline(&self) -> Option<SimTime> {
        self.decoder.deadline()
    }
}

/// Plays a stream to a decoder: it finds what `wanted` finds in each part, passes none of the bytes
/// over in silence, reports none of the others twice, and holds nothing for ever.
pub(super) fn decodes(
    stream: &Stream<'_>,
    decoder: &mut impl Decode,
    wanted: impl Fn(&[u8]) -> Vec<Range<usize>>,
) {
    let parts = stream.parts();
    let wanted: Vec<&[u8]> = parts
        .iter()
        .flat_map(|part| wanted(part).into_iter().map(|range| &part[range]))
        .collect();
    let mut found = Vec::new();
    let mut now = SimTime::ZERO;
    for (piece, long) in stream.pieces() {
        for &byte in piece {
            decoder.push(now, byte, &mut found);
        }
        now += if long { TIMEOUT } else { BREATH };
        decoder.expire(now, &mut found);
        if long {
            assert_eq!(decoder.deadline(), None, "something is held for ever");
        }
    }
    let mut good = Vec::new();
    let mut bad = 0;
    for found in &found {
        match found {
            Found::Good(bytes) => good.push(bytes.as_slice()),
            Found::Bad(bytes) => bad += bytes,
        }
    }
    assert_eq!(good, wanted);
    let good: usize = good.iter().map(|bytes| bytes.len()).sum();
    let length = stream.bytes.len();
    assert!(
        bad <= length && bad + good >= length,
        "{bad} bad bytes and {good} in frames are reported of {length}"
    );
}
