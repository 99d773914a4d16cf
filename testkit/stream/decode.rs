//! A decoder on a stream, beside what a second reading finds.

use std::ops::Range;
use std::time::Duration;

use rigsim_core::SimTime;
use rigsim_core::scanner::{Decoded, Scanner};

use super::Stream;

/// Silence after which the decoders give a partial frame up.
pub(super) const TIMEOUT: Duration = Duration::from_millis(20);
/// A pause that is shorter.
const BREATH: Duration = Duration::from_millis(19);

/// Plays a stream to a decoder: it finds what another `reading` finds in each part, passes none of the bytes
/// over in silence, reports none of the others twice, and holds nothing for ever.
pub(super) fn decodes(
    stream: &Stream<'_>,
    mut decoder: Scanner,
    reading: impl Fn(&[u8]) -> Vec<Range<usize>>,
) {
    let mut wanted = Vec::new();
    let mut found = Vec::new();
    let (mut begin, mut end) = (0, 0);
    let mut now = SimTime::ZERO;
    for (piece, long) in stream.pieces() {
        end += piece.len();
        for &byte in piece {
            found.extend(decoder.push(now, byte));
        }
        now += if long { TIMEOUT } else { BREATH };
        found.extend(decoder.expire(now));
        if long {
            assert_eq!(decoder.deadline(), None, "something is held for ever");
            let part = &stream.bytes[begin..end];
            wanted.extend(reading(part).into_iter().map(|range| &part[range]));
            begin = end;
        }
    }
    let mut good = Vec::new();
    let mut bad = 0;
    for found in &found {
        match found {
            Decoded::Frame(bytes) => good.push(bytes.as_slice()),
            Decoded::Wrong(bytes) | Decoded::Partial(bytes) | Decoded::Noise(bytes) => {
                bad += bytes.len();
            }
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
