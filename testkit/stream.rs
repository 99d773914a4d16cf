//! Bytes for the decoders.
//!
//! Each decoder is compared with a second reading of the same stream that shares no code with it
//! (`reading`). The firmware gets the stream whole and in
//! pieces, and must do the same.

mod decode;
mod reading;

use std::fmt::Debug;
use std::sync::LazyLock;
use std::time::Duration;

use rigsim_core::SimTime;
use rigsim_core::firmware::Firmware;
use rigsim_core::mecanum_device::codec as packets;
use rigsim_core::mecanum_device::packet::{Request, Status};
use rigsim_core::mecanum_device::settings::MecanumFirmwareSettings;
use rigsim_core::mecanum_device::{Link, MecanumDevice, ascii};
use rigsim_core::noise::Noise;
use rigsim_core::r150_device::R150Device;
use rigsim_core::r150_device::codec;
use rigsim_core::r150_device::settings::R150FirmwareSettings;
use rigsim_core::r150_device::vehicle::Start;
use rigsim_physics::mecanum::MecanumPlant;
use rigsim_physics::r150::R150Plant;
use rigsim_physics::{MecanumPlantSettings, Pose, R150PlantSettings, World, WorldSettings};

use decode::{TIMEOUT, decodes};
use reading::{frames_cover, sends_well};

/// A stream that is cut into pieces, with a pause after each.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Stream<'b> {
    /// A client reads it, instead of the board.
    pub for_client: bool,
    /// The firmware gets it too; the decoder alone is played ten times as fast.
    pub firmware: bool,
    /// Bytes that are sent.
    pub bytes: &'b [u8],
    /// Places where they are cut, ascending, each with whether the pause there is longer than the
    /// timeout.
    pub cuts: Vec<(usize, bool)>,
}

impl<'b> Stream<'b> {
    /// Reads a stream out of a fuzzer's bytes, any of which are one: a byte with the number of cuts
    /// (its low three bits), whether a client reads it, and whether the firmware gets it; two bytes for
    /// each cut; then the stream.
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
            for_client: first & 8 != 0,
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
}

/// Plays a stream to the R150's decoder and firmware.
pub fn r150(stream: &Stream<'_>) {
    static DEVICE: LazyLock<R150Device> = LazyLock::new(|| {
        let mut world = World::new(&WorldSettings::default());
        let plant = R150Plant::new(
            "r150",
            &R150PlantSettings::default(),
            &mut world,
            Pose::default(),
        );
        let settings = R150FirmwareSettings::default();
        let noise = || Noise::new(1, "noise");
        R150Device::new(
            settings,
            Start::Ready,
            plant.measurements(),
            noise(),
            noise(),
        )
    });
    decodes(stream, codec::decoder(TIMEOUT), reading::frames);
    let now = SimTime::from_secs(1);
    alike(
        stream,
        &DEVICE,
        now,
        |device, bytes| device.handle_bytes(now, bytes),
        R150Device::commands,
        |frame| frames_cover(frame),
    );
}

/// Firmware that gets a stream at once does the same as one that gets it in pieces; what it sends is
/// as it should be.
fn alike<D: Firmware + Clone, C: Debug + PartialEq>(
    stream: &Stream<'_>,
    device: &LazyLock<D>,
    now: SimTime,
    mut receive: impl FnMut(&mut D, &[u8]),
    commands: impl Fn(&D) -> C,
    is_good: impl Fn(&D::Output) -> bool,
) where
    D::Output: Debug + PartialEq,
{
    if !stream.firmware {
        return;
    }
    let (mut whole, mut split) = (D::clone(device), D::clone(device));
    receive(&mut whole, stream.bytes);
    for (piece, _) in stream.pieces() {
        receive(&mut split, piece);
    }
    let done = |device: &mut D| {
        let at_once = (commands(device), device.next_deadline());
        device.advance(now + Duration::from_millis(100));
        let sent: Vec<_> = std::iter::from_fn(|| device.poll_output()).collect();
        for output in &sent {
            assert!(is_good(output), "{} sends {output:02X?}", D::NAME);
        }
        let events: Vec<_> = std::iter::from_fn(|| device.poll_event()).collect();
        for (_, event) in &events {
            assert!(!event.to_string().is_empty(), "an event without words");
        }
        (at_once, sent, events)
    };
    assert_eq!(done(&mut whole), done(&mut split));
}

/// Plays a stream to the decoder of a direction of the main link, and to the firmware.
pub fn mecanum(stream: &Stream<'_>) {
    if stream.for_client {
        let decoder = packets::decoder::<Status>(TIMEOUT);
        decodes(stream, decoder, |part| reading::packets(part, &[[0, 39]]));
    } else {
        let decoder = packets::decoder::<Request>(TIMEOUT);
        let headers = [[0, 9], [1, 9], [2, 4]];
        decodes(stream, decoder, |part| reading::packets(part, &headers));
        split_mecanum(stream, Link::Main);
    }
}

fn split_mecanum(stream: &Stream<'_>, link: Link) {
    static DEVICE: LazyLock<MecanumDevice> = LazyLock::new(|| {
        let mut world = World::new(&WorldSettings::default());
        let settings = MecanumPlantSettings::default();
        let plant = MecanumPlant::new("mecanum", &settings, &mut world, Pose::default());
        let settings = MecanumFirmwareSettings::default();
        MecanumDevice::new(SimTime::ZERO, settings, true, plant.measurements())
    });
    let now = SimTime::from_nanos(50_000_000);
    alike(
        stream,
        &DEVICE,
        now,
        |device, bytes| device.handle_bytes(now, link, bytes),
        MecanumDevice::commands,
        |(link, bytes)| sends_well(*link, bytes),
    );
}

/// Plays a stream to the decoder of the ROS link's lines, and to the firmware.
pub fn ascii(stream: &Stream<'_>) {
    let mut decoder = ascii::Decoder::default();
    let found: Vec<ascii::Line> = stream
        .bytes
        .iter()
        .filter_map(|byte| decoder.push(*byte))
        .collect();
    let found: Vec<reading::Line<'_>> = found
        .iter()
        .map(|line| match line {
            ascii::Line::Command(command) => {
                Ok((command.letter.as_str().as_bytes()[0], command.tenths))
            }
            ascii::Line::Bad { bytes, .. } => Err(bytes.as_slice()),
        })
        .collect();
    assert_eq!(found, reading::lines(stream.bytes));
    split_mecanum(stream, Link::Ros);
}
