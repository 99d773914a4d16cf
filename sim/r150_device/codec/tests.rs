use proptest::prelude::*;
use rigsim_settings::SimTime;

use super::*;
use crate::scanner::Decoded;

const TIMEOUT: Duration = Duration::from_millis(20);

/// Everything that the decoder finds in chunks that arrive `gap` apart.
fn decode(chunks: &[&[u8]], gap: Duration) -> Vec<Decoded> {
    let mut decoder = decoder(TIMEOUT);
    let mut found = Vec::new();
    let mut now = SimTime::ZERO;
    for chunk in chunks {
        found.extend(decoder.expire(now - Duration::from_nanos(1)));
        for &byte in *chunk {
            found.extend(decoder.push(now, byte));
        }
        now += gap;
    }
    found.extend(decoder.expire(SimTime::MAX));
    found
}

fn whole(bytes: &[u8]) -> Vec<Decoded> {
    decode(&[bytes], Duration::ZERO)
}

fn frame(command: u8, parameters: &[u8]) -> Decoded {
    Decoded::Frame(encode(command, parameters))
}

#[test]
fn reference_frames() {
    assert_eq!(encode(0x07, &[]), [0xAA, 0x55, 0x00, 0x07, 0xC7, 0x84]);
    assert_eq!(encode(0xF0, &[]), [0xAA, 0x55, 0x00, 0xF0, 0xF7, 0x07]);
    assert_eq!(encode(0x06, &[]), [0xAA, 0x55, 0x00, 0x06, 0x4E, 0x95]);
    let full_ahead = [0xAA, 0x55, 0x04, 0x12, 0xE8, 0x03, 0xE8, 0x03, 0x4B, 0xC6];
    assert_eq!(encode(0x12, &[0xE8, 0x03, 0xE8, 0x03]), full_ahead);
    assert_eq!(whole(&full_ahead), [frame(0x12, &[0xE8, 0x03, 0xE8, 0x03])]);
}

#[test]
fn the_crc_is_the_one_of_the_manuals_routine() {
    assert_eq!(crc(b"123456789"), 0x906E);
    // The routine of the manual's appendix, with the table computed instead of looked up.
    let routine = |bytes: &[u8]| {
        let fcs = bytes.iter().fold(0xFFFF_u16, |fcs, byte| {
            let mut entry = (fcs ^ u16::from(*byte)) & 0xFF;
            for _ in 0..8 {
                entry = if entry & 1 == 1 {
                    entry >> 1 ^ 0x8408
                } else {
                    entry >> 1
                };
            }
            fcs >> 8 ^ entry
        });
        fcs ^ 0xFFFF
    };
    for byte in 0..=255 {
        assert_eq!(crc(&[byte, byte, 3, 1]), routine(&[byte, byte, 3, 1]));
    }
}

#[test]
fn the_longest_frame_fits() {
    let parameters = [0xAA; 255];
    assert_eq!(
        whole(&encode(0x07, &parameters)),
        [frame(0x07, &parameters)]
    );
}

#[test]
fn a_bad_crc_is_reported_with_its_bytes_and_the_right_crc() {
    let mut bytes = encode(0x07, &[]);
    bytes[5] ^= 1;
    assert_eq!(expected(&bytes), 0x84C7);
    assert_eq!(whole(&bytes), [Decoded::Wrong(bytes)]);
}

#[test]
fn a_frame_inside_the_parameters_of_a_bad_one_is_found() {
    let inner = encode(0x07, &[]);
    let mut outer = encode(0x12, &[&[1, 2][..], &inner, &[3]].concat());
    let last = outer.len() - 1;
    outer[last] ^= 0xFF;
    let found = whole(&outer);
    assert!(matches!(&found[0], Decoded::Wrong(bytes) if *bytes == outer));
    assert_eq!(found[1..], [frame(0x07, &[])]);
}

#[test]
fn a_frame_inside_the_parameters_of_a_good_one_is_not() {
    let inner = encode(0x07, &[]);
    assert_eq!(whole(&encode(0x06, &inner)), [frame(0x06, &inner)]);
}

#[test]
fn a_frame_behind_a_torn_one_is_found() {
    // A header that announces 200 bytes, then silence, then nothing but good frames.
    let torn = [0xAA, 0x55, 200, 0x12, 1, 2, 3];
    let good = encode(0x07, &[]);
    let found = decode(&[&torn, &good, &good], TIMEOUT + Duration::from_nanos(1));
    assert_eq!(
        found,
        [
            Decoded::Partial(torn.to_vec()),
            frame(7, &[]),
            frame(7, &[])
        ]
    );
    // Without the silence they are inside it, and come out when it is given up.
    let found = decode(&[&torn, &good, &good], Duration::from_millis(1));
    let all = [&torn[..], &good, &good].concat();
    assert_eq!(found, [Decoded::Partial(all), frame(7, &[]), frame(7, &[])]);
}

#[test]
fn a_byte_at_the_timeout_is_in_time_and_one_later_is_not() {
    let bytes = encode(0x07, &[]);
    let (head, tail) = bytes.split_at(3);
    assert_eq!(decode(&[head, tail], TIMEOUT), [frame(7, &[])]);
    let late = decode(&[head, tail], TIMEOUT + Duration::from_nanos(1));
    assert_eq!(
        late,
        [
            Decoded::Partial(head.to_vec()),
            Decoded::Noise(tail.to_vec())
        ]
    );
}

#[test]
fn noise_is_reported_once_and_in_runs() {
    let good = encode(0x07, &[]);
    let bytes = [&[0x00, 0xAA, 0xAA][..], &good, &[0x55; 100]].concat();
    let found = whole(&bytes);
    assert_eq!(found[0], Decoded::Noise(vec![0x00, 0xAA, 0xAA]));
    assert_eq!(found[1], frame(7, &[]));
    assert_eq!(found[2], Decoded::Noise(vec![0x55; 64]));
    assert_eq!(found[3], Decoded::Noise(vec![0x55; 36]));
    assert_eq!(found.len(), 4);
}

/// Streams made of good frames, broken ones, and bytes that look like beginnings.
fn stream() -> impl Strategy<Value = Vec<u8>> {
    let good =
        (any::<u8>(), prop::collection::vec(any::<u8>(), 0..12)).prop_map(|(c, p)| encode(c, &p));
    let headers = prop::collection::vec(
        prop::sample::select(vec![0xAA, 0x55, 0x00, 0x02, 0xFF]),
        0..20,
    );
    let noise = prop::collection::vec(any::<u8>(), 0..20);
    let broken = (any::<u8>(), any::<u8>()).prop_map(|(c, flip)| {
        let mut frame = encode(c, &[1, 2, 3]);
        frame[usize::from(flip) % 9] ^= 1 << (flip % 8);
        frame
    });
    prop::collection::vec(prop_oneof![good, headers, noise, broken], 0..12).prop_map(|p| p.concat())
}

fn reported_bytes(found: &[Decoded]) -> usize {
    found
        .iter()
        .map(|decoded| match decoded {
            Decoded::Frame(bytes)
            | Decoded::Wrong(bytes)
            | Decoded::Partial(bytes)
            | Decoded::Noise(bytes) => bytes.len(),
        })
        .sum()
}

proptest! {
    #[test]
    fn any_split_gives_the_same(bytes in stream(), cuts in prop::collection::vec(0usize..300, 0..8)) {
        let mut cuts: Vec<usize> = cuts.into_iter().map(|cut| cut.min(bytes.len())).collect();
        cuts.extend([0, bytes.len()]);
        cuts.sort_unstable();
        let chunks: Vec<&[u8]> = cuts.windows(2).map(|pair| &bytes[pair[0]..pair[1]]).collect();
        prop_assert_eq!(decode(&chunks, Duration::from_micros(1)), whole(&bytes));
    }

    #[test]
    fn what_is_encoded_decodes(command: u8, parameters in prop::collection::vec(any::<u8>(), 0..=255)) {
        prop_assert_eq!(whole(&encode(command, &parameters)), [frame(command, &parameters)]);
    }

    #[test]
    fn a_good_frame_after_anything_and_a_pause_is_found(bytes in stream()) {
        let good = encode(0x12, &[1, 2, 3, 4]);
        let found = decode(&[&bytes, &good], TIMEOUT + Duration::from_nanos(1));
        prop_assert_eq!(found.last(), Some(&frame(0x12, &[1, 2, 3, 4])));
    }

    #[test]
    fn every_byte_is_accounted_for(bytes in stream()) {
        // A frame inside a reported one counts twice, so this is a bound from below.
        prop_assert!(reported_bytes(&whole(&bytes)) >= bytes.len());
    }

    #[test]
    fn hostile_streams_stay_linear(bytes in prop::collection::vec(prop::sample::select(vec![0xAA, 0x55, 0xFF]), 0..3000)) {
        prop_assert!(reported_bytes(&whole(&bytes)) <= 2 * bytes.len());
    }
}
