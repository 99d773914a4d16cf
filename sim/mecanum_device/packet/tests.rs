use super::super::codec::{parse, reorder};
use super::*;
use proptest::prelude::*;

/// Type and length of every request.
const HEADERS: [[u8; 2]; 3] = [[0, 9], [1, 9], [2, 4]];

#[test]
fn requests_byte_by_byte() {
    let motion = Request::Motion {
        seq: 7,
        is_reset: 1,
        moving_idx: 2,
        s: 0x0102,
        v: -500,
    };
    assert_eq!(motion.encode(), [0, 9, 7, 1, 2, 0x02, 0x01, 0x0C, 0xFE]);
    let pose = Request::SetPose {
        seq: 255,
        axis_x: 10,
        axis_y: -10,
        ori: 900,
    };
    assert_eq!(pose.encode(), [1, 9, 255, 10, 0, 0xF6, 0xFF, 0x84, 0x03]);
    let mode = Request::ControlMode { seq: 1, mode: 1 };
    assert_eq!(mode.encode(), [2, 4, 1, 1]);
    for request in [motion, pose, mode] {
        assert_eq!(
            parse::<Request>(&request.encode(), ByteOrder::Little),
            Some(request)
        );
    }
}

#[test]
fn the_status_packet_byte_by_byte() {
    let status = Status {
        seq: 3,
        v_x: 1,
        v_y: -1,
        axis_x: 0x0203,
        axis_y: -2,
        ori: -900,
        rfid: 0x0403_0201,
        magn: 0x8001,
        infra: 1,
        ut_f: [1, 2, 3, 4],
        ut_b: [4500, 20, 256, 65_535],
        moto_state: 3,
        mile: 0x1234,
    };
    #[rustfmt::skip]
    let bytes = [
        0, 39, 3,
        1, 0, 0xFF, 0xFF,
        0x03, 0x02, 0xFE, 0xFF, 0x7C, 0xFC,
        1, 2, 3, 4,
        0x01, 0x80,
        1,
        1, 0, 2, 0, 3, 0, 4, 0,
        0x94, 0x11, 20, 0, 0, 1, 0xFF, 0xFF,
        3,
        0x34, 0x12,
    ];
    assert_eq!(bytes.len(), 39);
    assert_eq!(status.encode(), bytes);
    assert_eq!(parse::<Status>(&bytes, ByteOrder::Little), Some(status));
}

#[test]
fn big_endian_turns_every_field_and_no_other_byte() {
    let motion = Request::Motion {
        seq: 7,
        is_reset: 1,
        moving_idx: 2,
        s: 0x0102,
        v: -500,
    };
    let big = motion.encode_in(ByteOrder::Big);
    assert_eq!(big, [0, 9, 7, 1, 2, 0x01, 0x02, 0xFE, 0x0C]);
    let pose = Request::SetPose {
        seq: 255,
        axis_x: 10,
        axis_y: -10,
        ori: 900,
    };
    let big = pose.encode_in(ByteOrder::Big);
    assert_eq!(big, [1, 9, 255, 0, 10, 0xFF, 0xF6, 0x03, 0x84]);
    let mode = Request::ControlMode { seq: 1, mode: 1 };
    assert_eq!(mode.encode_in(ByteOrder::Big), [2, 4, 1, 1]);
    let status = Status {
        seq: 3,
        v_x: 1,
        v_y: 2,
        axis_x: 3,
        axis_y: 4,
        ori: 5,
        rfid: 0x0102_0304,
        magn: 6,
        infra: 1,
        ut_f: [7, 8, 9, 10],
        ut_b: [11, 12, 13, 0x1234],
        moto_state: 3,
        mile: 0x5678,
    };
    #[rustfmt::skip]
    let bytes = [
        0, 39, 3,
        0, 1, 0, 2,
        0, 3, 0, 4, 0, 5,
        1, 2, 3, 4,
        0, 6,
        1,
        0, 7, 0, 8, 0, 9, 0, 10,
        0, 11, 0, 12, 0, 13, 0x12, 0x34,
        3,
        0x56, 0x78,
    ];
    assert_eq!(status.encode_in(ByteOrder::Big), bytes);
}

proptest! {
    #[test]
    fn turned_twice_it_is_as_it_was(status: bool, kind in 0u8..3, order: bool, mut bytes in prop::collection::vec(any::<u8>(), 0..50)) {
        let order = if order { ByteOrder::Big } else { ByteOrder::Little };
        if let Some(first) = bytes.first_mut() {
            *first = kind;
        }
        let reorder = if status { reorder::<Status> } else { reorder::<Request> };
        let mut turned = bytes.clone();
        reorder(&mut turned, order);
        reorder(&mut turned, order);
        prop_assert_eq!(turned, bytes);
    }

    #[test]
    fn what_parses_encodes_to_the_same_bytes(mut bytes in prop::collection::vec(any::<u8>(), 39)) {
        (bytes[0], bytes[1]) = (0, 39);
        prop_assert_eq!(parse::<Status>(&bytes, ByteOrder::Little).unwrap().encode(), bytes.clone());
        for [kind, length] in HEADERS {
            let mut request = bytes[..usize::from(length)].to_vec();
            (request[0], request[1]) = (kind, length);
            prop_assert_eq!(parse::<Request>(&request, ByteOrder::Little).unwrap().encode(), request);
        }
    }

    #[test]
    fn only_headers_with_their_length_parse(bytes in prop::collection::vec(0u8..12, 0..12)) {
        let header = bytes.get(..2).is_some_and(|head| {
            HEADERS.iter().any(|known| known == head)
                && usize::from(head[1]) == bytes.len()
        });
        prop_assert_eq!(parse::<Request>(&bytes, ByteOrder::Little).is_some(), header);
    }
}
