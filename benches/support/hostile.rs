//! Streams that make a decoder work, each beside the same decoder on clean frames, per byte.
//!
//! The streams are those that look dear when a decoder's code is read. A search over some thousand
//! short patterns and silences, of the bytes that mean something to a decoder, found none dearer.

use std::hint::black_box;
use std::time::Duration;

use rigsim_core::SimTime;
use rigsim_core::mecanum_device::{ascii, codec as packets, packet};
use rigsim_core::r150_device::codec as frames;
use rigsim_core::scanner::Scanner;

use super::{Aim, Options, Table, alternate, cpu_seconds, nanos};

const SILENCE: Duration = Duration::from_millis(5);

/// A decoder, fed by the byte.
trait Decode {
    fn push(&mut self, now: SimTime, byte: u8);
    /// After a silence that is longer than its timeout.
    fn silence(&mut self, now: SimTime);
}

impl Decode for Scanner {
    fn push(&mut self, now: SimTime, byte: u8) {
        black_box(self.push(now, byte));
    }

    fn silence(&mut self, now: SimTime) {
        black_box(self.expire(now));
    }
}

impl Decode for ascii::Decoder {
    fn push(&mut self, _: SimTime, byte: u8) {
        black_box(self.push(byte));
    }

    fn silence(&mut self, _: SimTime) {}
}

/// A pattern that is repeated, with a silence after every so many bytes.
struct Stream {
    name: &'static str,
    pattern: Vec<u8>,
    silence_after: usize,
}

impl Stream {
    fn new(name: &'static str, pattern: &[u8]) -> Self {
        Self {
            name,
            pattern: pattern.to_vec(),
            silence_after: usize::MAX,
        }
    }

    fn torn(name: &'static str, pattern: &[u8], silence_after: usize) -> Self {
        Self {
            silence_after,
            ..Self::new(name, pattern)
        }
    }

    /// Seconds per byte.
    fn decode(&self, decoder: &mut impl Decode, bytes: usize) -> f64 {
        let mut now = SimTime::ZERO;
        let mut stream = self.pattern.iter().cycle();
        let taken = cpu_seconds(|| {
            let mut left = bytes;
            while left > 0 {
                let piece = left.min(self.silence_after);
                left -= piece;
                for &byte in stream.by_ref().take(piece) {
                    decoder.push(now, byte);
                }
                now += SILENCE;
                decoder.silence(now);
            }
        });
        taken / f64::from(u32::try_from(bytes).unwrap())
    }
}

pub fn rows(options: &Options, table: &Table) {
    let frame = frames::encode(0x12, &[0xE8, 0x03, 0xE8, 0x03]);
    let streams = [
        Stream::new("header bytes only", &[0xAA, 0x55]),
        Stream::new("nested frames of the greatest length", &[0xAA, 0x55, 0xFF]),
        Stream::new("first header byte only", &[0xAA]),
        Stream::new(
            "nested empty frames with a wrong CRC",
            &[0xAA, 0x55, 0x00, 0x07],
        ),
        Stream::torn("nested frames, torn", &[0xAA, 0x55, 0xFF], 260),
    ];
    let decoder = || frames::decoder(SILENCE);
    beside(options, table, "R150", decoder, &frame, &streams);

    let motion = packet::Request::Motion {
        seq: 1,
        is_reset: 1,
        moving_idx: 0,
        s: 100,
        v: 100,
    };
    let streams = [
        Stream::new("type bytes only", &[0]),
        Stream::new("beginnings of packets that break off", &[0, 0, 9, 2]),
        Stream::new("shortest packets with noise between them", &[2, 4, 0, 0, 7]),
        Stream::torn("nested packets, torn", &[0, 9], 8),
        Stream::torn("noise, a silence after each byte", &[4, 9, 7], 1),
    ];
    let decoder = || packets::decoder::<packet::Request>(SILENCE);
    beside(
        options,
        table,
        "car's packets",
        decoder,
        &motion.encode(),
        &streams,
    );

    let streams = [
        Stream::new("unknown packets of the greatest length", &[3, 255]),
        Stream::new("unknown packets of the least length", &[3, 3, 0]),
        Stream::torn("noise, a silence after each byte", &[4, 2, 1], 1),
        Stream::torn("nested packets of the greatest length, torn", &[255], 254),
    ];
    beside(
        options,
        table,
        "car's packets, further",
        decoder,
        &motion.encode(),
        &streams,
    );

    let long = [vec![b'9'; 40], b"\n".to_vec()].concat();
    let beyond = [b"X".to_vec(), vec![b'9'; 31], b"\n".to_vec()].concat();
    let streams = [
        Stream::new("a line without end", b"X"),
        Stream::new("lines that are just too long", &long),
        Stream::new("lines of a letter", b"X\n"),
        Stream::new("empty lines", b"\n"),
        Stream::new("numbers far beyond their range", &beyond),
    ];
    let decoder = || ascii::Decoder::default();
    beside(options, table, "car's lines", decoder, b"X10 \n", &streams);
}

fn beside<D: Decode>(
    options: &Options,
    table: &Table,
    decoder_name: &str,
    decoder: impl Fn() -> D,
    clean: &[u8],
    streams: &[Stream],
) {
    let bytes = options.count(1 << 18, 1 << 12);
    let clean = Stream::new("clean", clean);
    for stream in streams {
        let [own, floor] = alternate(
            options.count(40, 1),
            [&mut || stream.decode(&mut decoder(), bytes), &mut || {
                clean.decode(&mut decoder(), bytes)
            }],
        );
        let what = format!("{decoder_name}, decoding {}, per byte", stream.name);
        table.ratio(&what, &own, &floor, nanos, Aim::AtMost(10.0));
    }
}
