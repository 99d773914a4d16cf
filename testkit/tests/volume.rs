//! Random inputs in numbers, for long campaigns: no search for new code as in `fuzz/`, but a hundred
//! times as many inputs a second. They are ignored unless asked for:
//!
//! ```sh
//! SIM_TESTKIT_MILLIONS=100 cargo test --release -p rigsim-testkit --test volume -- --ignored --nocapture
//! ```

#![expect(
    clippy::unwrap_used,
    clippy::print_stdout,
    reason = "a test fails by panicking, and a campaign tells how far it is"
)]

use arbitrary::{Arbitrary as _, Unstructured};
use rigsim_core::noise::Noise;
use rigsim_testkit::groups;
use rigsim_testkit::session::{Session, play};
use rigsim_testkit::stream::{Stream, ascii, mecanum, r150};

/// How many inputs of each decoder, and ten times how many operations.
fn inputs() -> u64 {
    let millions = std::env::var("SIM_TESTKIT_MILLIONS").unwrap_or_else(|_| "1".to_owned());
    1_000_000 * millions.parse::<u64>().unwrap()
}

fn choose<'a>(noise: &mut Noise, from: &[&'a [u8]]) -> &'a [u8] {
    from[usize::try_from(noise.below(u32::try_from(from.len()).unwrap())).unwrap()]
}

/// Plays streams of `pieces`, whole and torn, with random bytes between them, cut anywhere.
fn stream(name: &str, pieces: &[&[u8]], play: fn(&Stream<'_>)) {
    let mut noise = Noise::new(1, name);
    let mut data = Vec::new();
    for number in 0..inputs() {
        data.clear();
        // One in 16 goes through the firmware, too.
        let cuts = noise.below(8) & noise.below(8);
        let firmware = u32::from(noise.below(16) == 0) << 4;
        let rules = u32::from(noise.byte()) & 0b1110_1000;
        data.push(u8::try_from(cuts | rules | firmware).unwrap());
        data.extend((0..2 * cuts).map(|_| noise.byte()));
        for _ in 0..noise.below(8) {
            let piece = choose(&mut noise, pieces);
            let torn = noise.below(3) == 0;
            let length = u32::try_from(piece.len()).unwrap();
            let length = if torn {
                noise.below(length + 1)
            } else {
                length
            };
            data.extend(&piece[..usize::try_from(length).unwrap()]);
            if noise.below(4) == 0 {
                let begin = 1 + 2 * usize::try_from(cuts).unwrap();
                let length = u32::try_from(data.len()).unwrap();
                let at = usize::try_from(noise.below(length)).unwrap();
                let at = at.max(begin).min(data.len() - 1);
                data[at] ^= 1 << noise.below(8);
            }
            for _ in 0..noise.below(4) & noise.below(4) {
                data.push(noise.byte());
            }
        }
        play(&Stream::read(&data));
        if (number + 1).is_multiple_of(10_000_000) {
            println!("{name}: {} million", (number + 1) / 1_000_000);
        }
    }
}

#[test]
#[ignore = "a campaign"]
fn r150_frames() {
    let pieces: &[&[u8]] = &[
        &[0xAA, 0x55, 0x00, 0x07, 0xC7, 0x84],
        &[0xAA, 0x55, 0x00, 0xF0, 0xF7, 0x07],
        &[0xAA, 0x55, 0x00, 0x06, 0x4E, 0x95],
        &[0xAA, 0x55, 0x04, 0x12, 0xE8, 0x03, 0xE8, 0x03, 0x4B, 0xC6],
        &[0xAA, 0x55, 0x04, 0x02, 0x01, 0x00, 0x00, 0x00, 0x44, 0xC5],
        &[0xAA, 0x55],
        &[0xAA, 0x55, 0x0C, 0x06],
        &[0xAA, 0x55, 0x20, 0x07],
        &[0xAA],
    ];
    stream("r150", pieces, r150);
}

#[test]
#[ignore = "a campaign"]
fn mecanum_packets() {
    let pieces: &[&[u8]] = &[
        &[0, 9, 1, 1, 0, 10, 0, 44, 1],
        &[0, 9, 2, 0, 2, 5, 0, 212, 254],
        &[1, 9, 3, 10, 0, 246, 255, 132, 3],
        &[2, 4, 4, 0],
        &[0, 39, 0, 9, 1, 9, 2, 4],
        &[0, 9],
        &[1],
    ];
    stream("mecanum", pieces, mecanum);
}

#[test]
#[ignore = "a campaign"]
fn ascii_lines() {
    let pieces: &[&[u8]] = &[
        b"X10 \n",
        b"Y-5\r\n",
        b"Z32768\n",
        b"A-32769\n",
        b"B",
        b"00000000000",
        b"\n",
        b" ",
    ];
    stream("ascii", pieces, ascii);
}

#[test]
#[ignore = "a campaign"]
fn operations() {
    let mut noise = Noise::new(1, "operations");
    let (mut done, mut sessions) = (0, 0_u64);
    while done < inputs() / 10 {
        let data: Vec<u8> = (0..40 + noise.below(1200)).map(|_| noise.byte()).collect();
        let session = Session::arbitrary(&mut Unstructured::new(&data)).unwrap();
        done += u64::try_from(session.operations.len()).unwrap();
        sessions += 1;
        let groups: Vec<_> = groups().collect();
        let _ = play(groups[usize::from(noise.byte()) % groups.len()], &session);
        if sessions.is_multiple_of(50_000) {
            println!("{sessions} sessions, {done} operations");
        }
    }
    println!("{sessions} sessions, {done} operations");
}
