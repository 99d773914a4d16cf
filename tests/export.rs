//! Runs exported for other tools. `tests/tools` reads them with those tools.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "a test fails by panicking, and clippy takes helpers for production code"
)]

mod harness;

use std::collections::BTreeMap;
use std::fs;

use harness::live::{DRIVE, Folder};

/// The types of the blocks of a capture; both lengths of each have to be right.
fn blocks(capture: &[u8]) -> Vec<u32> {
    let number = |at: usize| u32::from_le_bytes(capture[at..at + 4].try_into().unwrap());
    let (mut at, mut kinds) = (0, Vec::new());
    while at < capture.len() {
        let length = number(at + 4) as usize;
        assert_eq!(number(at + length - 4) as usize, length, "block at {at}");
        kinds.push(number(at));
        at += length;
    }
    kinds
}

#[test]
fn a_capture_has_a_packet_for_each_frame() {
    let folder = Folder::with(&[("drive.toml", DRIVE)]);
    let all = ["run", "--seed", "1", "--output", ".", "--export", "pcapng"];
    folder
        .sim(&[&all[..], &["drive.toml"]].concat())
        .expect_clean();
    assert!(
        !folder.file("drive.pcapng").exists(),
        "a passed run is exported only if asked"
    );
    folder
        .sim(&[&all[..], &["--export-all", "drive.toml"]].concat())
        .expect_clean();
    let capture = fs::read(folder.file("drive.pcapng")).unwrap();
    let traffic = folder.sim(&["trace", "drive.trace.jsonl"]).expect_clean();
    let frames = traffic.out.lines();
    let frames = frames.filter(|line| line.contains(" -> ") || line.contains(" <- "));
    let blocks = blocks(&capture);
    assert_eq!(blocks[..2], [0x0A0D_0D0A, 1], "a section, an interface");
    assert!(blocks[2..].iter().all(|kind| *kind == 6));
    assert_eq!(blocks.len() - 2, frames.count());

    // Exported again, it is the same, and replaces nothing else.
    let again = ["trace", "./drive.trace.jsonl", "--export", "drive.pcapng"];
    folder.sim(&again).expect_clean();
    assert!(fs::read(folder.file("drive.pcapng")).unwrap() == capture);
    fs::write(folder.file("mine.pcapng"), "mine").unwrap();
    let other = ["trace", "drive.trace.jsonl", "--export", "mine.pcapng"];
    let refused = folder.sim(&other);
    assert_eq!(refused.status.code(), Some(2), "{}", refused.err);
    assert_eq!(folder.read("mine.pcapng"), "mine");
    let unknown = ["trace", "drive.trace.jsonl", "--export", "drive.doc"];
    let refused = folder.sim(&unknown);
    assert_eq!(refused.status.code(), Some(2));
    assert!(refused.err.contains("pcapng"), "{}", refused.err);
}

#[test]
fn a_recording_has_values_frames_and_the_scenario() {
    let folder = Folder::with(&[("drive.toml", DRIVE)]);
    let run = [
        "run",
        "--seed",
        "1",
        "--output",
        ".",
        "--export",
        "mcap",
        "--export-all",
    ];
    folder
        .sim(&[&run[..], &["drive.toml"]].concat())
        .expect_clean();
    let file = fs::read(folder.file("drive.mcap")).unwrap();
    let (mut counts, mut last) = (BTreeMap::new(), 0);
    for message in mcap::MessageStream::new(&file).unwrap() {
        let message = message.unwrap();
        let schema = message.channel.schema.clone().unwrap();
        assert_eq!(schema.encoding, "protobuf");
        let key = (message.channel.topic.clone(), schema.name.clone());
        *counts.entry(key).or_insert(0_usize) += 1;
        last = last.max(message.log_time);
    }
    let count = |topic: &str, schema: &str| counts[&(topic.to_owned(), schema.to_owned())];
    let moments = count("/r150/truth", "rigsim.r150_truth");
    assert_eq!(count("/tf", "foxglove.FrameTransform"), moments);
    assert_eq!(count("/world", "foxglove.SceneUpdate"), 1);
    let traffic = folder.sim(&["trace", "drive.trace.jsonl"]).expect_clean();
    let frames = traffic.out.lines();
    let frames = frames.filter(|line| line.contains(" -> ") || line.contains(" <- "));
    assert_eq!(count("/r150/line_0", "rigsim.Line"), frames.count());
    let summary = mcap::Summary::read(&file).unwrap().unwrap();
    let attachments = summary.attachment_indexes.iter().map(|index| &*index.name);
    assert_eq!(
        attachments.collect::<Vec<_>>(),
        ["drive.toml", "report.json"]
    );
    // Midnight, and so many times 50 ms behind it.
    let day = 86_400 * 1_000_000_000;
    assert_eq!((last % day) / 50_000_000 + 1, moments as u64);
}
