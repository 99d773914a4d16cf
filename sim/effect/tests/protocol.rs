//! Frames.

use super::*;

#[test]
fn a_bad_crc_and_only_for_the_command_that_was_named() {
    let mut rig = r150();
    let handle = inject(&mut rig, "kind = \"bad-crc\"\ncommand = 0x12\ncount = 1");
    assert_eq!(replies(&mut rig, Request::Heartbeat).len(), 1);
    let motors = Request::SetMotors { right: 0, left: 0 };
    let seen = ask(&mut rig, motors);
    assert_eq!((seen.len(), frames(&seen)), (14, vec![]));
    run(&mut rig, MAIN, MS(50));
    assert_eq!(replies(&mut rig, motors).len(), 1);
    assert_eq!(rig.hits(handle), 1);
}

#[test]
fn a_reply_with_another_command() {
    let mut rig = r150();
    inject(&mut rig, "kind = \"wrong-command\"\nwith = 0x02");
    let seen = replies(&mut rig, Request::Heartbeat);
    let answer = Reply::Bool {
        command: 2,
        success: true,
    };
    assert_eq!(seen, [answer]);
}

#[test]
fn a_reply_of_a_wrong_length() {
    let mut rig = r150();
    let handle = inject(&mut rig, "kind = \"wrong-length\"\nby = -1");
    let seen = ask(&mut rig, Request::Heartbeat);
    assert_eq!(seen[..4], [0xAA, 0x55, 0, 7]);
    assert_eq!(seen, codec::encode(7, &[]));
    rig.clear(handle);
    inject(
        &mut rig,
        "kind = \"wrong-length\"\nby = 5\nwhat = \"field\"",
    );
    let seen = ask(&mut rig, Request::Heartbeat);
    assert_eq!((seen.len(), seen[2]), (7, 6));
}

#[test]
fn a_reply_that_is_torn_late_twice_or_missing() {
    let mut rig = r150();
    let whole = ask(&mut rig, Request::Heartbeat);
    let handle = inject(&mut rig, "kind = \"torn-reply\"");
    assert_eq!(ask(&mut rig, Request::Heartbeat), whole[..4]);
    rig.clear(handle);
    let handle = inject(&mut rig, "kind = \"late-reply\"\nby = \"100ms\"");
    assert_eq!(ask(&mut rig, Request::Heartbeat), NOTHING);
    rig.clear(handle);
    assert_eq!(run(&mut rig, MAIN, MS(80)), whole, "it still comes");
    let handle = inject(&mut rig, "kind = \"reply-twice\"");
    assert_eq!(
        ask(&mut rig, Request::Heartbeat),
        [whole.clone(), whole.clone()].concat()
    );
    rig.clear(handle);
    let handle = inject(&mut rig, "kind = \"missing-reply\"");
    assert_eq!(ask(&mut rig, Request::Heartbeat), NOTHING);
    rig.clear(handle);
    assert_eq!(ask(&mut rig, Request::Heartbeat), whole);
}

#[test]
fn what_is_late_goes_to_the_client_that_is_there_by_then() {
    let mut rig = r150();
    inject(&mut rig, "kind = \"late-reply\"\nby = \"300ms\"");
    ask(&mut rig, Request::Heartbeat);
    let now = rig.now();
    rig.detach(MAIN, now).unwrap();
    rig.attach(MAIN, now + MS(10)).unwrap();
    assert_ne!(run(&mut rig, MAIN, MS(500)), NOTHING);
}

#[test]
fn the_previous_reply_again() {
    let mut rig = r150();
    let handle = inject(&mut rig, "kind = \"previous-reply\"");
    let first = ask(&mut rig, Request::Heartbeat);
    assert_eq!(rig.hits(handle), 0);
    assert_eq!(ask(&mut rig, Request::Version), first);
    assert_eq!(rig.hits(handle), 1);
}

#[test]
fn a_frame_without_a_request() {
    let mut rig = r150();
    let handle = inject(
        &mut rig,
        "kind = \"unsolicited-frame\"\nevery = \"50ms\"\ncount = 3",
    );
    let seen = frames(&run(&mut rig, MAIN, MS(1000)));
    assert_eq!(seen.len(), 3);
    assert_eq!(rig.hits(handle), 3);
}

#[test]
fn packets_and_lines_of_the_car_are_spoilt_too() {
    let mut rig = car(true);
    let handle = inject(&mut rig, "kind = \"wrong-length\"\nby = -2");
    let seen = run(&mut rig, MAIN, MS(1000));
    assert_eq!(seen[..2], [0, 37]);
    assert!(statuses(&seen).is_empty());
    rig.clear(handle);
    run(&mut rig, MAIN, MS(200));
    rig.client_reads(ROS, &mut Vec::new());
    inject(
        &mut rig,
        "kind = \"wrong-command\"\nlink = \"ros\"\nwith = 88",
    );
    let text = String::from_utf8(run(&mut rig, ROS, MS(500))).unwrap();
    assert!(text.contains("X0 S0 \n"), "{text}");
    assert!(!status(&mut rig).seq.is_multiple_of(251));
}
