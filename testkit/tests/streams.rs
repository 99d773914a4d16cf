//! Every decoder finds what an independent reading of the stream finds, however it is split.

use proptest::prelude::*;
use rigsim_core::mecanum_device::packet::Status;
use rigsim_core::r150_device::codec::encode;
use rigsim_testkit::stream::{Stream, ascii, mecanum, r150};

/// Bytes made of pieces that mean something to a decoder, whole and torn.
fn bytes_of(
    piece: impl Strategy<Value = Vec<u8>> + 'static,
    likely: &'static [u8],
) -> impl Strategy<Value = Vec<u8>> {
    let torn = prop::collection::vec(prop::sample::select(likely), 0..12);
    let junk = prop::collection::vec(any::<u8>(), 0..12);
    let piece = piece.boxed();
    let cut = (piece.clone(), any::<prop::sample::Index>()).prop_map(|(piece, at)| {
        let length = at.index(piece.len() + 1);
        piece[..length].to_vec()
    });
    let part = prop_oneof![4 => piece, 2 => cut, 2 => torn, 1 => junk];
    prop::collection::vec(part, 0..12).prop_map(|parts| parts.concat())
}

/// The bytes behind cuts at any places.
fn stream(bytes: impl Strategy<Value = Vec<u8>>) -> impl Strategy<Value = Vec<u8>> {
    let cuts = prop::collection::vec(any::<[u8; 2]>(), 0..8);
    (bytes, cuts, any::<u8>()).prop_map(|(bytes, cuts, rules)| {
        let count = u8::try_from(cuts.len()).unwrap_or(0);
        let head = count | rules & !7;
        [vec![head], cuts.concat(), bytes].concat()
    })
}

fn frame() -> impl Strategy<Value = Vec<u8>> {
    let command = prop::sample::select(vec![0x02, 0x03, 0x06, 0x07, 0x12, 0xF0, 0x55]);
    let parameters = prop::collection::vec(prop::sample::select(&[0xAA, 0x55, 4, 0, 7][..]), 0..24);
    (command, parameters).prop_map(|(command, parameters)| encode(command, &parameters))
}

fn packet() -> impl Strategy<Value = Vec<u8>> {
    let body = prop::collection::vec(prop::sample::select(&[0, 1, 2, 4, 9, 39][..]), 7);
    let heads = prop::sample::select(vec![[0_u8, 9], [1, 9], [2, 4]]);
    let request = (heads, body).prop_map(|([kind, length], body)| {
        [&[kind, length], &body[..usize::from(length) - 2]].concat()
    });
    prop_oneof![3 => request, 1 => Just(Status::default().encode())]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(4096))]

    #[test]
    fn r150_frames(data in stream(bytes_of(frame(), &[0xAA, 0x55, 0, 1, 7]))) {
        r150(&Stream::read(&data));
    }

    #[test]
    fn mecanum_packets(data in stream(bytes_of(packet(), &[0, 1, 2, 4, 9, 39]))) {
        mecanum(&Stream::read(&data));
    }

    #[test]
    fn ascii_lines(
        data in stream(bytes_of(
            "[XYZABQx][+-]?[0-9]{0,33} ?\r?\n".prop_map(String::into_bytes),
            b"XZ-0+19 \r\n",
        )),
    ) {
        ascii(&Stream::read(&data));
    }
}
