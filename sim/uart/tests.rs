use super::*;
use proptest::prelude::*;

/// Bytes that a receiver finds in those sent back to back; the line is idle before and after.
fn resample(bytes: &[u8], from_baud: u32, to_baud: u32) -> Vec<u8> {
    let mut receiver = Receiver::new(from_baud, to_baud);
    receiver.hear(bytes);
    receiver.if_idle()
}

#[test]
fn a_byte_at_half_speed_reads_as_its_bits_doubled() {
    // 0x55 is 0 1010 1010 1 on the line. Sent at 57,600 and read at 115,200, each bit is seen
    // twice: 0011 0011 0 is read as start 0, data 0110 0110 least significant first, which is
    // 0x66, stop 0. From then on the receiver finds the second half's edges.
    assert_eq!(resample(&[0x55], 57_600, 115_200)[0], 0x66);
    assert!(resample(&[0x55], 57_600, 115_200).len() > 1);
}

#[test]
fn a_fast_sender_is_seen_as_fewer_bytes() {
    let sent = [0xAA, 0x55, 0x00, 0x07, 0xC7, 0x84];
    assert!(resample(&sent, 115_200, 9_600).len() <= 1);
}

#[test]
fn byte_times() {
    assert_eq!(byte_time(115_200, 1), Duration::from_nanos(86_806));
    assert_eq!(byte_time(9_600, 1), Duration::from_nanos(1_041_667));
    assert_eq!(byte_time(0, 1), Duration::from_secs(10));
}

#[test]
fn tolerance_is_about_five_per_cent() {
    let sent: Vec<u8> = (0..=255).collect();
    assert_eq!(resample(&sent, 115_200, 118_000), sent);
    assert_eq!(resample(&sent, 115_200, 112_500), sent);
    assert_ne!(resample(&sent, 115_200, 123_000), sent);
    assert_ne!(resample(&sent, 115_200, 106_000), sent);
}

proptest! {
    #[test]
    fn the_same_speed_changes_nothing(
        bytes in prop::collection::vec(any::<u8>(), 0..60),
        baud in 1u32..4_000_000,
    ) {
        prop_assert_eq!(resample(&bytes, baud, baud), bytes);
    }

    #[test]
    fn what_is_settled_is_what_a_whole_burst_gives(
        bytes in prop::collection::vec(any::<u8>(), 0..60),
        cut in 0_usize..60,
        from in 1_200u32..300_000,
        to in 1_200u32..300_000,
    ) {
        let (first, second) = bytes.split_at(cut.min(bytes.len()));
        let mut receiver = Receiver::new(from, to);
        let mut found = Vec::new();
        for part in [first, second] {
            receiver.hear(part);
            found.extend(std::iter::from_fn(|| receiver.next_settled()));
        }
        found.extend(receiver.if_idle());
        prop_assert_eq!(found, resample(&bytes, from, to));
    }

    #[test]
    fn any_speeds_end_and_make_at_most_five_bytes_of_one(
        bytes in prop::collection::vec(any::<u8>(), 0..60),
        from in 0u32..5_000_000,
        to in 0u32..5_000_000,
    ) {
        prop_assert!(resample(&bytes, from, to).len() <= 5 * bytes.len());
    }
}
