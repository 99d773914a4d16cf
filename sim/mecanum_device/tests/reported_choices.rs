//! What the article leaves open about reports, and we chose: every other choice works, too.

use super::super::settings::{
    AsciiMileage, AsciiSpeedSign, HeadingRange, MagnBits, NoEcho, Overflow, StatusSeq,
};
use super::*;

fn with(change: impl FnOnce(&mut MecanumFirmwareSettings)) -> Bench {
    Bench::with(false, change)
}

fn set_pose(seq: u8, axis_x: i16, ori: i16) -> Request {
    let axis_y = 0;
    Request::SetPose {
        seq,
        axis_x,
        axis_y,
        ori,
    }
}

fn report(bench: &mut Bench) -> String {
    let line = bench.output(Link::Ros).pop().unwrap();
    String::from_utf8(line).unwrap()
}

#[test]
fn the_sequence_number_may_be_the_clients() {
    let mut bench = with(|s| s.status_seq = StatusSeq::Echo);
    bench.run_ms(100);
    assert_eq!(bench.last_status().seq, 0);
    bench.send(set_pose(200, 0, 0));
    bench.run_ms(200);
    let seqs: Vec<u8> = bench.statuses().iter().map(|status| status.seq).collect();
    assert_eq!(seqs, [200, 200]);
}

#[test]
fn values_beyond_their_fields_may_saturate() {
    let mut bench = with(|s| s.overflow = Overflow::Saturate);
    bench.send(set_pose(0, i16::MAX, i16::MIN));
    bench.go(1, 10, 500);
    bench.run_ms(1500);
    bench.go(0, 10, -500);
    bench.run_ms(1500);
    let status = bench.last_status();
    assert_eq!(status.ori, i16::MIN);
    // It has gone back along a heading of −3277° and some, which is to the right.
    bench.send(set_pose(0, i16::MAX, 0));
    bench.go(0, 1, 500);
    bench.run_ms(300);
    assert_eq!(bench.last_status().axis_x, i16::MAX);
    bench.read(|r| r.pulses = r.pulses.map(|count| count.wrapping_add(20_000)));
    bench.run_ms(100);
    assert_eq!(bench.last_status().mile, u16::MAX);
}

#[test]
fn the_heading_may_stay_within_half_a_turn() {
    let mut bench = with(|s| s.heading_range = HeadingRange::HalfTurn);
    for (set, read) in [
        (0, 0),
        (1800, 1800),
        (-1800, 1800),
        (1801, -1799),
        (-1799, -1799),
        (3600, 0),
        (5400, 1800),
        (-32_768, -368),
    ] {
        bench.send(set_pose(0, 0, set));
        bench.run_ms(100);
        assert_eq!(bench.last_status().ori, read, "{set}");
    }
}

#[test]
fn the_bits_of_the_bar_may_be_others() {
    for (bits, read) in [
        (MagnBits::FromLeft, 0b0000_0000_0000_0110),
        (MagnBits::FromRight, 0b0110_0000_0000_0000),
        (MagnBits::Any, 1),
    ] {
        let mut bench = with(|s| s.magn_bits = bits);
        bench.run_ms(100);
        assert_eq!(bench.last_status().magn, 0);
        bench.read(|r| r.magnetic_bar = 0b110);
        bench.run_ms(100);
        assert_eq!(bench.last_status().magn, read);
    }
}

#[test]
fn the_number_of_a_tag_may_be_kept() {
    for (hold, after) in [(false, 0), (true, 77)] {
        let mut bench = with(|s| s.rfid_hold = hold);
        bench.read(|r| r.tag = 77);
        bench.run_ms(50);
        bench.read(|r| r.tag = 0);
        bench.run_ms(50);
        assert_eq!(bench.last_status().rfid, after);
        bench.read(|r| r.tag = 78);
        bench.run_ms(100);
        assert_eq!(bench.last_status().rfid, 78);
        // The board forgets it without a supply.
        bench.read(|r| r.board_powered = false);
        bench.read(|r| {
            r.board_powered = true;
            r.tag = 0;
        });
        bench.run_ms(100);
        assert_eq!(bench.last_status().rfid, 0);
    }
}

#[test]
fn no_echo_may_read_otherwise() {
    for (choice, reads) in [
        (NoEcho::Farthest, 4500),
        (NoEcho::Zero, 0),
        (NoEcho::Max, u16::MAX),
    ] {
        let mut bench = with(|s| s.ultrasonic_no_echo = choice);
        // What is beyond its range gives none either; what is at its end does.
        bench.read(|r| {
            r.echoes[0] = Some(4.6);
            r.echoes[2] = Some(4.5);
            r.echoes[3] = Some(0.01);
        });
        bench.run_ms(100);
        assert_eq!(bench.last_status().ut_f, [reads, reads, 4500, 20]);
    }
}

#[test]
fn setting_the_pose_may_clear_the_mileage() {
    let mut bench = with(|s| s.odometry.set_pose_clears_mileage = true);
    bench.go(0, 10, 500);
    bench.run_ms(1300);
    assert_eq!(bench.last_status().mile, 314);
    bench.send(set_pose(0, 0, 0));
    bench.run_ms(100);
    assert_eq!(bench.last_status().mile, 0);
}

#[test]
fn a_reported_speed_may_have_no_sign() {
    let mut bench = Bench::with(true, |s| s.ascii_speed_sign = AsciiSpeedSign::None);
    bench.line("X-10\n");
    bench.run_ms(1000);
    assert_eq!(report(&mut bench), "V50 S50 \n");
}

#[test]
fn a_reported_mileage_may_count_down_or_begin_again() {
    for (choice, reads) in [
        (AsciiMileage::Total, "V0 S150 \n"),
        (AsciiMileage::Signed, "V0 S-50 \n"),
        (AsciiMileage::Motion, "V0 S100 \n"),
    ] {
        let mut bench = Bench::with(true, |s| s.ascii_mileage = choice);
        bench.line("X5\n");
        bench.run_ms(1300);
        assert_eq!(report(&mut bench), "V0 S50 \n");
        bench.line("X-10\n");
        bench.run_ms(2500);
        assert_eq!(report(&mut bench), reads);
    }
}

#[test]
fn status_packets_may_come_more_often() {
    let mut bench = with(|s| s.status_period = Duration::from_millis(40));
    bench.run_ms(200);
    assert_eq!(bench.statuses().len(), 5);
}
