//! Frames behind others that are torn.

use rigsim_core::SHIPPED;
use rigsim_core::SimTime;
use rigsim_core::message::Sender;
use rigsim_core::settings::SimSettings;

use super::Stream;

/// Requests of an R150: a heartbeat, and motors.
const FRAMES: [&[u8]; 2] = [
    &[0xAA, 0x55, 0x00, 0x07, 0xC7, 0x84],
    &[0xAA, 0x55, 0x04, 0x12, 0xE8, 0x03, 0xE8, 0x03, 0x4B, 0xC6],
];

#[test]
fn a_frame_behind_a_torn_one_is_whole() {
    let settings = SimSettings::new(SHIPPED);
    let device = SHIPPED.iter().find(|device| device.id == "r150").unwrap();
    let own = settings.of_device(device).unwrap();
    for (torn, whole) in
        [[0, 0], [0, 1], [1, 0], [1, 1]].map(|[a, b]: [usize; 2]| (FRAMES[a], FRAMES[b]))
    {
        for split in 0..torn.len() {
            let mut stream = Stream {
                way: (rigsim_core::rig::PortId { device: 0, link: 0 }, false),
                reader: (device.host.frames)(0, Sender::Client, own),
                is_text: false,
                bytes: Vec::new(),
                last: SimTime::ZERO,
            };
            // All at once, and again when the client has given up what is torn.
            let bytes = [&torn[..split], whole].concat();
            let times = (1..).map(SimTime::from_nanos);
            let later = (1_000_000_000..).map(SimTime::from_nanos);
            let all = times.zip(bytes).chain(later.zip(whole.iter().copied()));
            let found: Vec<_> = all.flat_map(|(at, byte)| stream.add(at, byte)).collect();
            let good = found.iter().filter(|frame| frame.found.message.is_some());
            let good: Vec<&[u8]> = good.map(|frame| &*frame.found.bytes).collect();
            assert_eq!(good, [whole; 2], "{torn:02X?} torn after {split}");
            assert_eq!(
                found[found.len() - 1].at.as_nanos(),
                999_999_999 + whole.len() as u64
            );
            assert!(stream.bytes.is_empty());
        }
    }
}
