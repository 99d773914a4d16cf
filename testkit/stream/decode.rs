//! A decoder on a stream, beside what a second reading finds.

use std::ops::Range;
use std::time::Duration;

use rigsim_core::SimTime;
use rigsim_core::mecanum_device::codec::{Decoded as Packets, reorder};
use rigsim_core::mecanum_device::settings::ByteOrder;
use rigsim_core::message::Message;
use rigsim_core::r150_device::codec::{Decoded, encode};
use rigsim_core::scanner::{Format, Scanner};

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

/// What a frame of an R150 covers.
pub(super) fn of_frame(decoded: Decoded) -> Found {
    match decoded {
        Decoded::Frame(frame) => Found::Good(encode(frame.command(), frame.parameters())),
        Decoded::BadCrc { bytes, .. } | Decoded::Partial(bytes) | Decoded::Noise(bytes) => {
            Found::Bad(bytes.len())
        }
    }
}

/// What a packet covers that is written so.
pub(super) fn of_packet<P: Message>(
    encode: fn(&P) -> Vec<u8>,
    order: ByteOrder,
    decoded: Packets<P>,
) -> Found {
    match decoded {
        Packets::Packet(packet) => {
            let mut bytes = encode(&packet);
            reorder::<P>(&mut bytes, order);
            Found::Good(bytes)
        }
        Packets::Partial(bytes) | Packets::Noise(bytes) => Found::Bad(bytes.len()),
    }
}

/// Plays a stream to a decoder: it finds what `wanted` finds in each part, passes none of the bytes
/// over in silence, reports none of the others twice, and holds nothing for ever.
pub(super) fn decodes<F: Format>(
    stream: &Stream<'_>,
    decoder: &mut Scanner<F>,
    of: impl Fn(F::Decoded) -> Found,
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
            decoder.push(now, byte, &mut |decoded| found.push(of(decoded)));
        }
        now += if long { TIMEOUT } else { BREATH };
        decoder.expire(now, &mut |decoded| found.push(of(decoded)));
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
