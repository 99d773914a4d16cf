//! Bytes for the decoders.
//!
//! Each decoder is compared with a second reading of the same stream that shares no code with it:
//! it has all bytes at once, so it can be a loop over the description of the format.

use std::ops::Range;
use std::sync::LazyLock;
use std::time::Duration;

use sim_core::SimTime;
use sim_core::mecanum_device::ascii::Syntax;
use sim_core::mecanum_device::codec::{Decoded as Packets, Decoder as PacketDecoder, Packet};
use sim_core::mecanum_device::packet::{Request, Status};
use sim_core::mecanum_device::settings::MecanumFirmwareSettings;
use sim_core::mecanum_device::{Link, MecanumDevice, ascii};
use sim_core::noise::Noise;
use sim_core::r150_device::R150Device;
use sim_core::r150_device::codec::{Decoded, Decoder};
use sim_core::r150_device::settings::{R150FirmwareSettings, Resync};
use sim_core::r150_device::vehicle::Start;
use sim_physics::mecanum::MecanumPlant;
use sim_physics::r150::R150Plant;
use sim_physics::{MecanumPlantSettings, Pose, R150PlantSettings, World, WorldSettings};

/// Silence after which the decoders give a partial frame up.
const TIMEOUT: Duration = Duration::from_millis(20);
/// A pause that is shorter.
const BREATH: Duration = Duration::from_millis(19);

/// The longest line of the ROS link.
const LONGEST: usize = 32;

/// A stream that is cut into pieces, with a pause after each.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Stream<'b> {
    /// A variant of the decoder under test.
    pub variant: bool,
    /// The firmware gets it too; the decoder alone is played ten times as fast.
    pub firmware: bool,
    /// What is sent.
    pub bytes: &'b [u8],
    /// Where it is cut, ascending, and whether the pause there is longer than the timeout.
    pub cuts: Vec<(usize, bool)>,
}

impl<'b> Stream<'b> {
    /// Reads a stream out of a fuzzer's bytes, any of which are one: a byte with the number of cuts
    /// (its low three bits), the variant and whether the firmware gets it (the next two), two bytes for each cut, then the stream.
    #[must_use]
    pub fn read(data: &'b [u8]) -> Self {
        let (first, rest) = data.split_first().unwrap_or((&0, &[]));
        let (heads, bytes) = rest.split_at(rest.len().min(2 * usize::from(first & 7)));
        let mut cuts: Vec<(usize, bool)> = heads
            .chunks_exact(2)
            .map(|head| {
                let word = u16::from_le_bytes([head[0], head[1]]);
                (
                    usize::from(word >> 1) % (bytes.len() + 1),
                    word.is_multiple_of(2),
                )
            })
            .collect();
        // One pause at one place, the longest, for two short ones would make a long one.
        cuts.sort_unstable_by_key(|(at, long)| (*at, !long));
        cuts.dedup_by_key(|(at, _)| *at);
        Self {
            variant: first & 8 != 0,
            firmware: first & 16 != 0,
            bytes,
            cuts,
        }
    }

    /// The pieces, and whether each is followed by a long pause.
    fn pieces(&self) -> impl Iterator<Item = (&'b [u8], bool)> {
        let end = (self.bytes.len(), true);
        let starts = std::iter::once(0).chain(self.cuts.iter().map(|(at, _)| *at));
        let ends = self.cuts.iter().copied().chain([end]);
        starts
            .zip(ends)
            .map(|(start, (end, long))| (&self.bytes[start..end], long))
    }

    /// The parts that only short pauses interrupt.
    fn parts(&self) -> Vec<&'b [u8]> {
        let mut start = 0;
        let mut parts = Vec::new();
        for (at, long) in self.cuts.iter().copied().chain([(self.bytes.len(), true)]) {
            if long {
                parts.push(&self.bytes[start..at]);
                start = at;
            }
        }
        parts
    }
}

/// What a report of a decoder covers.
#[derive(Debug, Clone, PartialEq)]
enum Found<F> {
    Good(F),
    Bad(usize),
}

/// Whether reports account for a stream: none of its bytes is passed over in silence, and bad bytes
/// are not reported twice.
fn accounts<F>(found: &[Found<F>], good: usize, length: usize) {
    let bad: usize = found
        .iter()
        .map(|found| match found {
            Found::Bad(bytes) => *bytes,
            Found::Good(_) => 0,
        })
        .sum();
    assert!(
        bad <= length,
        "{bad} bad bytes reported of a stream of {length}"
    );
    assert!(
        bad + good >= length,
        "{bad} bad bytes and {good} in frames are not all of {length}"
    );
}

/// CRC-16/X-25, bit by bit.
fn crc(bytes: &[u8]) -> u16 {
    let mut crc = 0xFFFF_u16;
    for byte in bytes {
        crc ^= u16::from(*byte);
        for _ in 0..8 {
            let carry = crc & 1 == 1;
            crc >>= 1;
            if carry {
                crc ^= 0x8408;
            }
        }
    }
    !crc
}

/// Where the frames of the R150 stand in `bytes`.
fn frames(bytes: &[u8], resync: Resync) -> Vec<Range<usize>> {
    let mut found = Vec::new();
    let mut at = 0;
    while at < bytes.len() {
        if !bytes[at..].starts_with(&[0xAA, 0x55]) {
            at += 1;
            continue;
        }
        let total = bytes
            .get(at + 2)
            .map_or(usize::MAX, |length| 6 + usize::from(*length));
        let frame = bytes[at..].get(..total);
        at += match (frame, resync) {
            (Some(frame), _) if crc(&frame[3..total - 2]).to_le_bytes() == frame[total - 2..] => {
                found.push(at..at + total);
                total
            }
            (_, Resync::SecondByte) => 1,
            (Some(_), Resync::NextFrame) => total,
            (None, Resync::NextFrame) => bytes.len(),
        };
    }
    found
}

/// Plays a stream to the R150's decoder and firmware.
pub fn r150(stream: &Stream<'_>) {
    let resync = if stream.variant {
        Resync::NextFrame
    } else {
        Resync::SecondByte
    };
    let parts = stream.parts();
    let wanted: Vec<(u8, &[u8])> = parts
        .iter()
        .flat_map(|part| {
            frames(part, resync)
                .into_iter()
                .map(|range| (part[range.start + 3], &part[range.start + 4..range.end - 2]))
        })
        .collect();
    let mut decoder = Decoder::new(TIMEOUT, resync);
    let mut found = Vec::new();
    let mut take = |decoded| {
        found.push(match decoded {
            Decoded::Frame(frame) => Found::Good(frame),
            Decoded::BadCrc { bytes, .. } | Decoded::Partial(bytes) | Decoded::Noise(bytes) => {
                Found::Bad(bytes.len())
            }
        });
    };
    let mut now = SimTime::ZERO;
    for (piece, long) in stream.pieces() {
        for &byte in piece {
            decoder.push(now, byte, &mut take);
        }
        now += if long { TIMEOUT } else { BREATH };
        decoder.expire(now, &mut take);
        if long {
            assert_eq!(decoder.deadline(), None, "something is held for ever");
        }
    }
    let good: Vec<(u8, &[u8])> = found
        .iter()
        .filter_map(|found| match found {
            Found::Good(frame) => Some((frame.command, frame.parameters.as_slice())),
            Found::Bad(_) => None,
        })
        .collect();
    assert_eq!(good, wanted);
    let in_frames = good.iter().map(|(_, parameters)| 6 + parameters.len());
    accounts(&found, in_frames.sum(), stream.bytes.len());
    split_r150(stream);
}

/// How the firmware gets its bytes at one instant changes nothing of what it does.
fn split_r150(stream: &Stream<'_>) {
    static DEVICE: LazyLock<R150Device> = LazyLock::new(|| {
        let mut world = World::new(&WorldSettings::default());
        let plant = R150Plant::new(&R150PlantSettings::default(), &mut world, Pose::default());
        let settings = R150FirmwareSettings::default();
        let noise = Noise::new(1, "noise");
        R150Device::new(settings, Start::Ready, plant.measurements(), noise)
    });
    if !stream.firmware {
        return;
    }
    let now = SimTime::from_secs(1);
    let (mut whole, mut split) = (DEVICE.clone(), DEVICE.clone());
    whole.receive(now, stream.bytes);
    for (piece, _) in stream.pieces() {
        split.receive(now, piece);
    }
    assert_eq!(whole.commands(), split.commands());
    assert_eq!(whole.next_deadline(), split.next_deadline());
    for device in [&mut whole, &mut split] {
        device.advance(now + Duration::from_millis(100));
    }
    loop {
        let frames = [&mut whole, &mut split].map(R150Device::poll_output);
        assert_eq!(frames[0], frames[1]);
        let Some(frame) = &frames[0] else { break };
        let length = frame.len();
        assert!(frames_cover(frame), "a bad frame of {length} bytes");
    }
    loop {
        let events = [&mut whole, &mut split].map(R150Device::poll_event);
        assert_eq!(events[0], events[1]);
        let [Some((_, event)), _] = events else { break };
        assert!(!event.to_string().is_empty());
    }
}

/// Whether `bytes` are whole frames of the R150, one after the other.
#[must_use]
pub fn frames_cover(bytes: &[u8]) -> bool {
    let frames = frames(bytes, Resync::SecondByte);
    frames.iter().map(ExactSizeIterator::len).sum::<usize>() == bytes.len()
}

/// Where packets of one direction stand in `bytes`.
fn packets(bytes: &[u8], headers: &[[u8; 2]]) -> Vec<Range<usize>> {
    let mut found = Vec::new();
    let mut at = 0;
    while at < bytes.len() {
        let begins = headers
            .iter()
            .find(|header| bytes[at..].starts_with(header.as_slice()));
        let length = begins.map_or(0, |header| usize::from(header[1]));
        if length > 0 && at + length <= bytes.len() {
            found.push(at..at + length);
            at += length;
        } else {
            at += 1;
        }
    }
    found
}

/// Plays a stream to the mecanum board's decoder, or a client's in the variant, and to the firmware.
pub fn mecanum(stream: &Stream<'_>) {
    if stream.variant {
        packets_of::<Status>(stream, &[[0, 39]], |status| status.encode());
    } else {
        packets_of::<Request>(stream, &[[0, 9], [1, 9], [2, 4]], |request| {
            request.encode()
        });
        split_mecanum(stream, Link::Main);
    }
}

fn packets_of<P: Packet>(stream: &Stream<'_>, headers: &[[u8; 2]], encode: impl Fn(&P) -> Vec<u8>) {
    let parts = stream.parts();
    let wanted: Vec<&[u8]> = parts
        .iter()
        .flat_map(|part| packets(part, headers).into_iter().map(|range| &part[range]))
        .collect();
    let mut decoder = PacketDecoder::<P>::new(TIMEOUT);
    let mut found = Vec::new();
    let mut take = |decoded| {
        found.push(match decoded {
            Packets::Packet(packet) => Found::Good(encode(&packet)),
            Packets::Partial(bytes) | Packets::Noise(bytes) => Found::Bad(bytes.len()),
        });
    };
    let mut now = SimTime::ZERO;
    for (piece, long) in stream.pieces() {
        for &byte in piece {
            decoder.push(now, byte, &mut take);
        }
        now += if long { TIMEOUT } else { BREATH };
        decoder.expire(now, &mut take);
        if long {
            assert_eq!(decoder.deadline(), None, "something is held for ever");
        }
    }
    let good: Vec<&[u8]> = found
        .iter()
        .filter_map(|found| match found {
            Found::Good(packet) => Some(packet.as_slice()),
            Found::Bad(_) => None,
        })
        .collect();
    assert_eq!(good, wanted);
    let in_packets = good.iter().map(|packet| packet.len());
    accounts(&found, in_packets.sum(), stream.bytes.len());
}

fn split_mecanum(stream: &Stream<'_>, link: Link) {
    static DEVICE: LazyLock<MecanumDevice> = LazyLock::new(|| {
        let mut world = World::new(&WorldSettings::default());
        let settings = MecanumPlantSettings::default();
        let plant = MecanumPlant::new(&settings, &mut world, Pose::default());
        let settings = MecanumFirmwareSettings::default();
        MecanumDevice::new(SimTime::ZERO, settings, true, plant.measurements())
    });
    if !stream.firmware {
        return;
    }
    let now = SimTime::from_nanos(50_000_000);
    let (mut whole, mut split) = (DEVICE.clone(), DEVICE.clone());
    whole.receive(now, link, stream.bytes);
    for (piece, _) in stream.pieces() {
        split.receive(now, link, piece);
    }
    assert_eq!(whole.commands(), split.commands());
    assert_eq!(whole.next_deadline(), split.next_deadline());
    for device in [&mut whole, &mut split] {
        device.advance(now + Duration::from_millis(100));
    }
    loop {
        let packets = [&mut whole, &mut split].map(MecanumDevice::poll_output);
        assert_eq!(packets[0], packets[1]);
        let [Some((link, bytes)), _] = packets else {
            break;
        };
        assert!(sends_well(link, &bytes), "{link:?} sends {bytes:02X?}");
    }
    loop {
        let events = [&mut whole, &mut split].map(MecanumDevice::poll_event);
        assert_eq!(events[0], events[1]);
        let [Some((_, event)), _] = events else { break };
        assert!(!event.to_string().is_empty());
    }
}

/// Whether `bytes` are what the board sends on this link, whole.
#[must_use]
pub fn sends_well(link: Link, bytes: &[u8]) -> bool {
    match link {
        Link::Main => bytes
            .chunks(39)
            .all(|packet| packet.len() == 39 && packet.starts_with(&[0, 39])),
        Link::Ros => bytes.split_inclusive(|byte| *byte == b'\n').all(is_report),
    }
}

/// `V4 S500 \n`
fn is_report(line: &[u8]) -> bool {
    let is_number = |text: &str| {
        let digits = text.strip_prefix('-').unwrap_or(text);
        !digits.is_empty() && digits.bytes().all(|byte| byte.is_ascii_digit())
    };
    let numbers = std::str::from_utf8(line).ok().and_then(|line| {
        line.strip_prefix('V')?
            .strip_suffix(" \n")?
            .split_once(" S")
    });
    numbers.is_some_and(|(speed, mileage)| is_number(speed) && is_number(mileage))
}

/// Plays a stream to the decoder of the ROS link's lines, and to the firmware.
pub fn ascii(stream: &Stream<'_>) {
    let mut decoder = ascii::Decoder::new(Syntax::default());
    let found: Vec<ascii::Line> = stream
        .bytes
        .iter()
        .filter_map(|byte| decoder.push(*byte))
        .collect();
    let mut lines = stream.bytes.split(|byte| *byte == b'\n');
    let last = lines.next_back().unwrap_or_default();
    let told = lines.filter_map(line);
    // A line that goes on counts only once it is too long.
    let begun = (last.len() > LONGEST).then(|| line(last)).flatten();
    let wanted: Vec<Result<(u8, i32), &[u8]>> = told.chain(begun).collect();
    let found: Vec<Result<(u8, i32), &[u8]>> = found
        .iter()
        .map(|line| match line {
            ascii::Line::Command(command) => Ok((command.letter.byte(), command.tenths)),
            ascii::Line::Bad { bytes, .. } => Err(bytes.as_slice()),
        })
        .collect();
    assert_eq!(found, wanted);
    split_mecanum(stream, Link::Ros);
}

/// A line without its end: nothing, a command, or what is told of it.
fn line(bytes: &[u8]) -> Option<Result<(u8, i32), &[u8]>> {
    if bytes.len() > LONGEST {
        return Some(Err(&bytes[..LONGEST]));
    }
    let meant: Vec<u8> = bytes
        .iter()
        .copied()
        .filter(|byte| !b" \r".contains(byte))
        .collect();
    let (letter, number) = meant.split_first()?;
    let number = std::str::from_utf8(number)
        .ok()
        // A plus sign is no part of the article's numbers.
        .filter(|text| b"XYZAB".contains(letter) && !text.starts_with('+'))
        .and_then(|text| text.parse::<i128>().ok())
        .filter(|number| (-32_768..=32_768).contains(number));
    let number = number.and_then(|number| i32::try_from(number).ok());
    Some(number.map(|number| (*letter, number)).ok_or(bytes))
}
