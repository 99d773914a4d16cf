use proptest::prelude::*;
use rigsim_settings::SimTime;

use super::super::packet::{Request, Status};
use super::*;
use crate::scanner::Decoded;

const TIMEOUT: Duration = Duration::from_millis(50);
const NANO: Duration = Duration::from_nanos(1);

/// Everything that the decoder finds in chunks that arrive `gap` apart.
fn decode<P: Message>(chunks: &[&[u8]], gap: Duration) -> Vec<Decoded> {
    let mut decoder = decoder::<P>(TIMEOUT);
    let mut found = Vec::new();
    let mut now = SimTime::ZERO;
    for chunk in chunks {
        found.extend(decoder.expire(now - NANO));
        for &byte in *chunk {
            found.extend(decoder.push(now, byte));
        }
        now += gap;
    }
    found.extend(decoder.expire(SimTime::MAX));
    found
}

fn whole(bytes: &[u8]) -> Vec<Decoded> {
    decode::<Request>(&[bytes], Duration::ZERO)
}

fn packet(packet: &impl Message) -> Decoded {
    Decoded::Frame(encode(packet))
}

fn motion(seq: u8) -> Request {
    Request::Motion {
        seq,
        is_reset: 1,
        moving_idx: 4,
        s: 100,
        v: 300,
    }
}

#[test]
fn packets_of_all_types_follow_one_another() {
    let requests = [
        motion(1),
        Request::ControlMode { seq: 2, mode: 1 },
        Request::SetPose {
            seq: 3,
            axis_x: 1,
            axis_y: 2,
            ori: 3,
        },
    ];
    let bytes = requests.map(|request| request.encode()).concat();
    assert_eq!(whole(&bytes), requests.map(|own| packet(&own)));
}

#[test]
fn a_byte_that_begins_no_packet_is_skipped_alone() {
    // Each of these has the right type and the wrong length, or a type that is none.
    for junk in [
        &[0, 4][..],
        &[2, 9],
        &[1, 39],
        &[0],
        &[1, 1],
        &[3, 9],
        &[0xFF],
    ] {
        let bytes = [junk, &motion(5).encode()].concat();
        let found = whole(&bytes);
        let noise = Decoded::Noise(junk.to_vec());
        assert_eq!(found, [noise, packet(&motion(5))], "{junk:?}");
    }
}

#[test]
fn noise_is_reported_in_runs() {
    let bytes = [&[0xAA; 100][..], &motion(1).encode()].concat();
    let found = whole(&bytes);
    assert_eq!(found[0], Decoded::Noise(vec![0xAA; 64]));
    assert_eq!(found[1], Decoded::Noise(vec![0xAA; 36]));
    assert_eq!(found[2], packet(&motion(1)));
    assert_eq!(found.len(), 3);
}

#[test]
fn a_byte_at_the_timeout_is_in_time_and_one_later_is_not() {
    let bytes = motion(1).encode();
    let (head, tail) = bytes.split_at(5);
    let in_time = decode::<Request>(&[head, tail], TIMEOUT);
    assert_eq!(in_time, [packet(&motion(1))]);
    // The last byte of the speed looks like the beginning of a pose.
    let late = decode::<Request>(&[head, tail], TIMEOUT + NANO);
    assert_eq!(
        late,
        [
            Decoded::Partial(head.to_vec()),
            Decoded::Noise(tail[..3].to_vec()),
            Decoded::Partial(tail[3..].to_vec())
        ]
    );
}

#[test]
fn a_torn_packet_is_rescanned_from_its_second_byte() {
    let inner = Request::ControlMode { seq: 9, mode: 0 };
    let torn = [&[0, 9, 1][..], &inner.encode()].concat();
    let good = motion(2).encode();
    assert_eq!(
        decode::<Request>(&[&torn, &good], TIMEOUT + NANO),
        [
            Decoded::Partial(torn.clone()),
            packet(&inner),
            packet(&motion(2))
        ]
    );
    // Without the silence the next packet's first bytes complete it, as nothing tells otherwise.
    let found = whole(&[&torn[..], &good].concat());
    let Decoded::Frame(bytes) = &found[0] else {
        panic!("{found:?}")
    };
    assert!(matches!(
        parse(bytes, ByteOrder::Little),
        Some(Request::Motion { seq: 1, .. })
    ));
}

#[test]
fn big_endian_packets_decode() {
    let bytes = motion(2).encode_in(ByteOrder::Big);
    assert_eq!(whole(&bytes), [Decoded::Frame(bytes.clone())]);
    assert_eq!(parse(&bytes, ByteOrder::Big), Some(motion(2)));
}

#[test]
fn a_reset_forgets_what_is_held() {
    let mut decoder = decoder::<Request>(TIMEOUT);
    let mut found = Vec::new();
    for byte in [0xFF, 0, 9, 1] {
        found.extend(decoder.push(SimTime::ZERO, byte));
    }
    assert_eq!(decoder.deadline(), Some(SimTime::ZERO + TIMEOUT));
    decoder.clear();
    assert_eq!(decoder.deadline(), None);
    found.extend(decoder.expire(SimTime::MAX));
    assert_eq!(found, []);
}

#[test]
fn a_client_decodes_status_packets_the_same_way() {
    let status = Status {
        seq: 8,
        mile: 77,
        ..Status::default()
    };
    let bytes = status.encode();
    let (_, rest) = bytes.split_at(30);
    // It may attach in the middle of one.
    let found = decode::<Status>(&[rest, &bytes], TIMEOUT + NANO);
    assert_eq!(found.last(), Some(&packet(&status)));
}

/// Streams made of packets, broken ones, and bytes that look like beginnings.
fn stream() -> impl Strategy<Value = Vec<u8>> {
    let fields = prop::collection::vec(any::<u8>(), 7);
    let good = (
        prop::sample::select(&[[0u8, 9], [1, 9], [2, 4]][..]),
        fields,
    )
        .prop_map(|([kind, length], f)| {
            [&[kind, length][..], &f[..usize::from(length) - 2]].concat()
        });
    let torn = (good.clone(), 1usize..9).prop_map(|(mut packet, length)| {
        packet.truncate(length);
        packet
    });
    let headers = prop::collection::vec(prop::sample::select(vec![0, 1, 2, 4, 9, 39]), 0..20);
    let noise = prop::collection::vec(any::<u8>(), 0..20);
    prop::collection::vec(prop_oneof![good, torn, headers, noise], 0..12).prop_map(|p| p.concat())
}

/// Every byte that was found, in order.
fn bytes_of(found: &[Decoded]) -> Vec<u8> {
    let bytes = found.iter().map(|decoded| match decoded {
        Decoded::Frame(bytes)
        | Decoded::Wrong(bytes)
        | Decoded::Partial(bytes)
        | Decoded::Noise(bytes) => bytes.clone(),
    });
    bytes.collect::<Vec<_>>().concat()
}

proptest! {
    #[test]
    fn any_split_gives_the_same(bytes in stream(), cuts in prop::collection::vec(0usize..300, 0..8)) {
        let mut cuts: Vec<usize> = cuts.into_iter().map(|cut| cut.min(bytes.len())).collect();
        cuts.extend([0, bytes.len()]);
        cuts.sort_unstable();
        let chunks: Vec<&[u8]> = cuts.windows(2).map(|pair| &bytes[pair[0]..pair[1]]).collect();
        prop_assert_eq!(decode::<Request>(&chunks, Duration::from_micros(1)), whole(&bytes));
    }

    #[test]
    fn every_byte_is_accounted_for_in_order(bytes in stream()) {
        // Only the end is given up, and what is found inside that counts twice.
        let found = bytes_of(&whole(&bytes));
        prop_assert_eq!(&found[..bytes.len()], &bytes[..]);
        prop_assert!(found.len() <= bytes.len() + 9);
    }

    #[test]
    fn a_packet_after_anything_and_a_pause_is_found(bytes in stream()) {
        let found = decode::<Request>(&[&bytes, &motion(77).encode()], TIMEOUT + NANO);
        prop_assert_eq!(found.last(), Some(&packet(&motion(77))));
    }

    #[test]
    fn the_other_direction_takes_any_bytes_too(bytes in prop::collection::vec(any::<u8>(), 0..200)) {
        let split: Vec<&[u8]> = bytes.chunks(1).collect();
        let at_once = decode::<Status>(&[&bytes], Duration::ZERO);
        prop_assert_eq!(decode::<Status>(&split, Duration::ZERO), at_once);
    }
}
