//! What a UART makes of bytes that were sent at another speed than it listens at.
//!
//! A byte goes over the line as a start bit (low), eight data bits, least significant first, and a
//! stop bit (high). The receiver waits for a falling edge and looks at the line in the middle of
//! each of the ten bits, by its own clock. Where the clocks differ by more than about five per
//! cent in either direction it looks at the wrong bits, and where they differ much it finds more
//! or fewer bytes than were sent.

use std::time::Duration;

/// Bits on the line for each byte: start, eight data, stop.
pub const BITS_PER_BYTE: u64 = 10;

/// Time that one byte takes at `baud`, to the nearest nanosecond.
#[must_use]
pub fn byte_time(baud: u32) -> Duration {
    let baud = u64::from(baud.max(1));
    Duration::from_nanos((BITS_PER_BYTE * 1_000_000_000 + baud / 2) / baud)
}

/// A byte as the receiver found it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Received {
    /// Its value.
    pub byte: u8,
    /// When the receiver had it, from the beginning of the burst.
    pub after: Duration,
}

/// What a receiver at `to_baud` finds in `bytes` sent back to back at `from_baud`; the line is
/// idle before and after.
///
/// The receiver hands on bytes whose stop bit is wrong too, as common UARTs do, and then waits
/// for the line to go high.
#[must_use]
pub fn resample(bytes: &[u8], from_baud: u32, to_baud: u32) -> Vec<Received> {
    // Time is counted in units of 1/(from·to) seconds, so that a bit is a whole number at both
    // speeds; half of the receiver's bit needs a factor of two.
    let sent_bit = 2 * u128::from(to_baud.max(1));
    let read_bit = 2 * u128::from(from_baud.max(1));
    let second = sent_bit * u128::from(from_baud.max(1));
    let bits = bytes.len() as u128 * u128::from(BITS_PER_BYTE);
    let level = |time: u128| is_high(bytes, time / sent_bit);
    let mut received = Vec::new();
    let mut time = 0;
    // The line is high before the first bit and after a good stop bit.
    let mut was_high = true;
    while time < bits * sent_bit {
        if !was_high || level(time) {
            // No falling edge here: go to the next bit of the sender.
            was_high = level(time);
            time = (time / sent_bit + 1) * sent_bit;
            continue;
        }
        let sample = |bit: u128| level(time + bit * read_bit + read_bit / 2);
        if sample(0) {
            // A glitch shorter than half a bit is no start bit.
            was_high = true;
            time = (time / sent_bit + 1) * sent_bit;
            continue;
        }
        let byte = (0..8).fold(0, |byte, bit| byte | u8::from(sample(1 + bit)) << bit);
        let stop = time + 9 * read_bit + read_bit / 2;
        let nanos = stop * 1_000_000_000 / second;
        let after = Duration::from_nanos(u64::try_from(nanos).unwrap_or(u64::MAX));
        received.push(Received { byte, after });
        was_high = level(stop);
        time = stop;
    }
    received
}

/// Level of the sender's bit `index`, counted from the first start bit.
fn is_high(bytes: &[u8], index: u128) -> bool {
    let byte = usize::try_from(index / u128::from(BITS_PER_BYTE)).unwrap_or(usize::MAX);
    let Some(byte) = bytes.get(byte) else {
        return true;
    };
    match index % u128::from(BITS_PER_BYTE) {
        0 => false,
        9 => true,
        bit => byte >> (bit - 1) & 1 == 1,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn values(bytes: &[u8], from: u32, to: u32) -> Vec<u8> {
        resample(bytes, from, to).iter().map(|r| r.byte).collect()
    }

    #[test]
    fn a_byte_at_half_speed_reads_as_its_bits_doubled() {
        // 0x55 is 0 1010 1010 1 on the line. Sent at 57,600 and read at 115,200, each bit is seen
        // twice: 0011 0011 0 is read as start 0, data 0110 0110 least significant first, which is
        // 0x66, stop 0. From then on the receiver finds the second half's edges.
        assert_eq!(values(&[0x55], 57_600, 115_200)[0], 0x66);
        assert!(values(&[0x55], 57_600, 115_200).len() > 1);
    }

    #[test]
    fn a_fast_sender_is_seen_as_fewer_bytes() {
        let sent = [0xAA, 0x55, 0x00, 0x07, 0xC7, 0x84];
        assert!(resample(&sent, 115_200, 9_600).len() <= 1);
    }

    #[test]
    fn byte_times() {
        assert_eq!(byte_time(115_200), Duration::from_nanos(86_806));
        assert_eq!(byte_time(9_600), Duration::from_nanos(1_041_667));
        assert_eq!(byte_time(0), Duration::from_secs(10));
    }

    #[test]
    fn tolerance_is_about_five_per_cent() {
        let sent: Vec<u8> = (0..=255).collect();
        assert_eq!(values(&sent, 115_200, 118_000), sent);
        assert_eq!(values(&sent, 115_200, 112_500), sent);
        assert_ne!(values(&sent, 115_200, 123_000), sent);
        assert_ne!(values(&sent, 115_200, 106_000), sent);
    }

    proptest! {
        #[test]
        fn the_same_speed_changes_nothing(
            bytes in prop::collection::vec(any::<u8>(), 0..60),
            baud in 1u32..4_000_000,
        ) {
            prop_assert_eq!(values(&bytes, baud, baud), bytes);
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
}
