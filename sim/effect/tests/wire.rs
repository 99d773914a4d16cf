//! Bytes.

use super::*;

const HEARTBEAT: [u8; 7] = [0xAA, 0x55, 1, 7, 1, 0x9A, 0x7E];

fn heartbeat(rig: &mut Rig) -> Vec<u8> {
    ask(rig, Request::Heartbeat)
}

fn right() -> Vec<u8> {
    Reply::Bool {
        command: 7,
        success: true,
    }
    .encode()
}

#[test]
fn one_flipped_bit_makes_the_crc_wrong() {
    let mut rig = r150();
    let handle = inject(
        &mut rig,
        "kind = \"bit-flips\"\nprobability = 1\ncount = 1\ndirection = \"to-client\"",
    );
    let seen = heartbeat(&mut rig);
    let flipped: u32 = seen
        .iter()
        .zip(right())
        .map(|(seen, right)| (seen ^ right).count_ones())
        .sum();
    assert_eq!((seen.len(), flipped), (HEARTBEAT.len(), 1));
    assert!(frames(&seen).is_empty());
    assert_eq!(heartbeat(&mut rig), right(), "it may flip one bit only");
    assert_eq!(rig.hits(handle), 1);
}

#[test]
fn a_request_with_flipped_bits_is_not_answered() {
    let mut rig = r150();
    inject(
        &mut rig,
        "kind = \"bit-flips\"\nprobability = 1\ndirection = \"to-device\"",
    );
    assert_eq!(heartbeat(&mut rig), NOTHING);
}

#[test]
fn bytes_are_lost_doubled_and_inserted() {
    for (kind, length) in [
        ("dropped-bytes", 6),
        ("duplicated-bytes", 8),
        ("inserted-bytes", 8),
    ] {
        let mut rig = r150();
        let handle = inject(
            &mut rig,
            &format!("kind = \"{kind}\"\nprobability = 1\ncount = 1\ndirection = \"to-client\""),
        );
        let seen = heartbeat(&mut rig);
        assert_eq!(seen.len(), length, "{kind}");
        rig.clear(handle);
        assert_eq!(heartbeat(&mut rig), right());
    }
}

#[test]
fn a_burst_spoils_bytes_in_a_row() {
    let mut rig = r150();
    inject(
        &mut rig,
        "kind = \"burst\"\nprobability = 1\nlength = 4\ncount = 1\ndirection = \"to-client\"",
    );
    let seen = heartbeat(&mut rig);
    assert_eq!(seen[4..], right()[4..]);
    assert_ne!(seen[..4], right()[..4]);
}

#[test]
fn a_delay_puts_the_reply_off() {
    let mut rig = r150();
    inject(
        &mut rig,
        "kind = \"delay\"\nby = \"100ms\"\ndirection = \"to-client\"",
    );
    assert_eq!(heartbeat(&mut rig), NOTHING);
    assert_eq!(run(&mut rig, MAIN, MS(80)), right());
}

#[test]
fn pauses_tear_a_reply_into_pieces() {
    let mut rig = r150();
    inject(
        &mut rig,
        "kind = \"fragmentation\"\nsize = 3\npause = \"20ms\"",
    );
    send(&mut rig, &Request::Heartbeat.encode());
    let pieces: Vec<usize> = (0..4).map(|_| run(&mut rig, MAIN, MS(20)).len()).collect();
    assert_eq!(pieces, [3, 3, 1, 0]);
}

#[test]
fn a_torn_request_is_given_up() {
    let mut rig = r150();
    inject(
        &mut rig,
        "kind = \"fragmentation\"\nsize = 3\npause = \"50ms\"\ndirection = \"to-device\"",
    );
    send(&mut rig, &Request::Heartbeat.encode());
    assert_eq!(run(&mut rig, MAIN, MS(200)), NOTHING);
}

#[test]
fn a_stall_holds_everything_back_and_releases_it_at_once() {
    let mut rig = r150();
    let stall = "kind = \"stall\"\ndirection = \"to-client\"";
    let (one, other) = (inject(&mut rig, stall), inject(&mut rig, stall));
    assert_eq!(heartbeat(&mut rig), NOTHING);
    assert_eq!(heartbeat(&mut rig), NOTHING);
    rig.clear(one);
    assert_eq!(run(&mut rig, MAIN, MS(10)), NOTHING);
    rig.clear(other);
    let mut seen = Vec::new();
    rig.client_reads(MAIN, &mut seen);
    assert_eq!(seen, [right(), right()].concat());
    assert_eq!(heartbeat(&mut rig), right());
}

#[test]
fn a_mute_device_still_hears_and_a_deaf_one_stops_by_its_watchdog() {
    let mut rig = r150();
    let handle = inject(&mut rig, "kind = \"mute\"");
    for _ in 0..20 {
        let full = Request::SetMotors {
            right: 500,
            left: 500,
        };
        assert_eq!(ask(&mut rig, full), NOTHING);
    }
    assert!(rig.device::<R150>(0).unwrap().truth().motion.forward_speed > 0.3);
    rig.clear(handle);
    inject(&mut rig, "kind = \"mute\"\ndirection = \"to-device\"");
    for _ in 0..60 {
        ask(
            &mut rig,
            Request::SetMotors {
                right: 500,
                left: 500,
            },
        );
    }
    assert_eq!(
        rig.device::<R150>(0).unwrap().truth().motion.forward_speed,
        0.0
    );
}

#[test]
fn a_wrong_baud_is_garbage_and_not_the_client_s_fault() {
    let mut rig = r150();
    let handle = inject(&mut rig, "kind = \"wrong-baud\"\nbaud = 57600");
    assert!(frames(&heartbeat(&mut rig)).is_empty());
    let reported = std::iter::from_fn(|| rig.poll_event())
        .any(|event| event.kind.code().name == "baud_mismatch");
    assert!(!reported);
    assert!(rig.hits(handle) > 0);
    rig.clear(handle);
    run(&mut rig, MAIN, MS(100));
    assert_eq!(heartbeat(&mut rig), right());
}

#[test]
fn an_idle_line_makes_bytes_but_not_within_a_reply() {
    let mut rig = r150();
    let handle = inject(
        &mut rig,
        "kind = \"idle-noise\"\nevery = \"10ms\"\ncount = 30",
    );
    let seen = run(&mut rig, MAIN, MS(1000));
    assert_eq!(seen.len(), 30);
    assert_eq!(rig.hits(handle), 30);
}

#[test]
fn a_pulled_cable_is_reported_to_the_server_of_the_port() {
    let mut rig = r150();
    assert!(!rig.cable_pulled(MAIN));
    let handle = inject(&mut rig, "kind = \"cable-pulled\"");
    assert!(rig.cable_pulled(MAIN));
    assert_eq!(rig.hits(handle), 1, "a client was attached");
    assert_eq!(heartbeat(&mut rig), NOTHING);
    rig.clear(handle);
    assert!(!rig.cable_pulled(MAIN));
    assert_eq!(heartbeat(&mut rig), right());
}

#[test]
fn links_have_their_own_faults() {
    let mut rig = car(true);
    inject(&mut rig, "kind = \"mute\"\nlink = \"ros\"");
    let end = rig.now() + MS(1000);
    let main = run(&mut rig, MAIN, MS(1000));
    assert!(!main.is_empty() && rig.now() >= end);
    assert_eq!(run(&mut rig, ROS, MS(500)), NOTHING);
}

#[test]
fn through_another_adapter_the_same_bytes_come_whenever_the_client_reads() {
    // The adapter is another for a millisecond, from the middle of a reply on.
    let seen_at = |end: u64, often: bool| {
        let mut rig = Rig::new(RigSettings {
            world: WorldSettings::default(),
            map: WorldMap::default(),
            wire: Wire::Paced,
            seed: 1,
        });
        let settings = R150Settings::default();
        rig.add(&crate::r150::R150_SPEC, &Setup::new("r150", &settings));
        rig.attach(MAIN, SimTime::ZERO).unwrap();
        send(&mut rig, &Request::SystemInfo.encode());
        let (mut bytes, mut fault) = (Vec::new(), None);
        for step in 0..=end {
            match step {
                54 => {
                    fault = Some(inject(
                        &mut rig,
                        "kind = \"other-adapter\"\nadapter = \"ftdi\"",
                    ))
                }
                64 => rig.clear(fault.take().unwrap()),
                _ => {}
            }
            rig.advance(SimTime::from_micros(100 * step)).unwrap();
            if often || step == end {
                rig.client_reads(MAIN, &mut bytes);
            }
        }
        bytes
    };
    let mut lengths = Vec::new();
    for end in 50..250 {
        let seen = seen_at(end, true);
        assert_eq!(seen, seen_at(end, false), "after {} us", 100 * end);
        lengths.push(seen.len());
    }
    lengths.dedup();
    assert!(lengths.len() > 1, "{lengths:?}");
}
