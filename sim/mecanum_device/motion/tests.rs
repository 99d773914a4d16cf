use std::time::Duration;

use super::super::kinematics::Course;
use super::*;

const NOW: SimTime = SimTime::from_secs(1);

fn motion(course: Course, tenths: u32) -> Motion {
    Motion {
        movement: Movement {
            course,
            negative: false,
        },
        revolutions: f64::from(tenths) / 10.0,
        speed_rpm: 30.0,
    }
}

fn motions(change: impl FnOnce(&mut MecanumFirmwareSettings)) -> Motions {
    let mut settings = MecanumFirmwareSettings {
        motion_pause: Duration::ZERO,
        ..MecanumFirmwareSettings::default()
    };
    change(&mut settings);
    Motions::new(settings)
}

/// Appends a motion and starts what can; false if one was lost.
fn put(motions: &mut Motions, motion: Motion) -> bool {
    let lost = motions.append(motion);
    motions.start(NOW, &mut |_| ());
    lost.is_none()
}

fn changes(of: impl FnOnce(&mut dyn FnMut(Change))) -> Vec<Change> {
    let mut seen = Vec::new();
    of(&mut |change| seen.push(change));
    seen
}

#[test]
fn each_wheel_stops_by_itself_and_the_last_ends_the_motion() {
    let mut motions = motions(|_| ());
    let ahead = motion(Course::Ahead, 10);
    let left = motion(Course::LeftFront, 1);
    assert!(put(&mut motions, ahead));
    assert!(put(&mut motions, left));
    assert_eq!(motions.rotations(), [1; 4]);
    assert_eq!(
        changes(|c| motions.turned(NOW, [59, 60, 61, 59], &mut |x| c(x))),
        []
    );
    assert_eq!(motions.rotations(), [1, 0, 0, 1]);
    assert_eq!(
        changes(|c| motions.turned(NOW, [1, 9, 9, 0], &mut |x| c(x))),
        []
    );
    assert_eq!(motions.rotations(), [0, 0, 0, 1]);
    let seen = changes(|c| motions.turned(NOW, [0, 0, 0, 1], &mut |x| c(x)));
    assert_eq!(seen, [Change::Done(ahead), Change::Started(left)]);
    assert_eq!(motions.rotations(), [0, 1, 1, 0]);
    let seen = changes(|c| motions.turned(NOW, [0, 6, 6, 0], &mut |x| c(x)));
    assert_eq!(seen, [Change::Done(left)]);
    assert_eq!(motions.rotations(), [0; 4]);
}

#[test]
fn between_two_motions_the_wheels_are_held_unless_one_preempts() {
    let pause = Duration::from_millis(100);
    let mut motions = motions(|s| s.motion_pause = pause);
    for _ in 0..2 {
        assert!(put(&mut motions, motion(Course::Ahead, 1)));
    }
    motions.turned(NOW, [6; 4], &mut |_| ());
    assert_eq!((motions.rotations(), motions.driven()), ([0; 4], [true; 4]));
    assert_eq!(motions.due(), Some(NOW + pause));
    motions.start(NOW + pause - Duration::from_nanos(1), &mut |_| ());
    assert_eq!(motions.running(), None);
    motions.start(NOW + pause, &mut |_| ());
    assert_eq!((motions.rotations(), motions.due()), ([1; 4], None));
    motions.turned(NOW + pause, [6; 4], &mut |_| ());
    assert_eq!((motions.driven(), motions.due()), ([false; 4], None));
    // Within the pause one that comes late waits, and one that preempts does not.
    assert!(put(&mut motions, motion(Course::Ahead, 1)));
    assert_eq!(motions.running(), None);
    motions.preempt(motion(Course::Strafe, 1));
    motions.start(NOW + pause, &mut |_| ());
    assert_eq!(motions.rotations(), [-1, 1, 1, -1]);
}

#[test]
fn the_queue_has_its_length_beside_the_motion_that_runs() {
    let mut motions = motions(|s| s.queue_length = 2);
    let one = motion(Course::Ahead, 1);
    for _ in 0..3 {
        assert!(put(&mut motions, one));
    }
    assert!(!put(&mut motions, one));
    assert_eq!(motions.waiting(), 2);
    assert_eq!(motions.discard(), 3);
    assert_eq!(motions.discard(), 0);
    assert_eq!(motions.running(), None);
}

#[test]
fn motions_without_distance_or_speed_end_as_they_come() {
    let mut motions = motions(|_| ());
    let nothing = motion(Course::Strafe, 0);
    let still = Motion {
        speed_rpm: 0.0,
        ..motion(Course::Strafe, 5)
    };
    let ahead = motion(Course::Ahead, 1);
    assert!(put(&mut motions, nothing));
    assert_eq!(motions.running(), None);
    for next in [ahead, nothing, still, ahead] {
        assert!(put(&mut motions, next));
    }
    let seen = changes(|c| motions.turned(NOW, [6; 4], &mut |x| c(x)));
    assert_eq!(seen, [Change::Done(ahead), Change::Started(ahead)]);
}

#[test]
fn preemption_may_spare_what_waits() {
    for (preempt, discarded, waiting) in [(Preempt::All, 3, 0), (Preempt::Running, 1, 2)] {
        let mut motions = motions(|s| s.preempt = preempt);
        for tenths in 1..=3 {
            assert!(put(&mut motions, motion(Course::Ahead, tenths)));
        }
        assert_eq!(motions.preempt(motion(Course::Strafe, 1)), discarded);
        motions.start(NOW, &mut |_| ());
        assert_eq!(motions.rotations(), [-1, 1, 1, -1]);
        assert_eq!(motions.waiting(), waiting);
    }
}

#[test]
fn no_distance_may_be_endless_and_no_speed_may_wait() {
    let nothing = motion(Course::Ahead, 0);
    let mut motions = motions(|s| s.zero_distance = ZeroDistance::Endless);
    put(&mut motions, nothing);
    motions.turned(NOW, [i64::MAX; 4], &mut |_| ());
    motions.turned(NOW, [i64::MAX; 4], &mut |_| ());
    assert_eq!(motions.rotations(), [1; 4]);
    let still = Motion {
        speed_rpm: 0.0,
        ..motion(Course::Ahead, 1)
    };
    let mut motions = super::tests::motions(|s| s.zero_speed = ZeroSpeed::Wait);
    put(&mut motions, still);
    assert_eq!(motions.running(), Some(&still));
    // What has no distance still ends.
    let mut motions = super::tests::motions(|s| s.zero_speed = ZeroSpeed::Wait);
    put(&mut motions, nothing);
    assert_eq!(motions.running(), None);
}

#[test]
fn a_wheel_that_is_counted_back_has_the_more_to_go_until_it_has_arrived() {
    let mut motions = motions(|_| ());
    put(&mut motions, motion(Course::Ahead, 1));
    motions.turned(NOW, [-3, 6, 6, 6], &mut |_| ());
    assert_eq!(motions.rotations(), [1, 0, 0, 0]);
    motions.turned(NOW, [8, -6, 0, 0], &mut |_| ());
    assert_eq!(motions.rotations(), [1, 0, 0, 0]);
    motions.turned(NOW, [1, 0, 0, 0], &mut |_| ());
    assert_eq!(motions.running(), None);
}

#[test]
fn a_distance_between_pulses_ends_at_the_pulse_beyond() {
    let mut motions = motions(|s| s.odometry.pulses_per_revolution = 7);
    put(&mut motions, motion(Course::Ahead, 1));
    assert_eq!(motions.rotations(), [1; 4]);
    motions.turned(NOW, [1; 4], &mut |_| ());
    assert_eq!(motions.running(), None);
    put(&mut motions, motion(Course::Ahead, 15));
    motions.turned(NOW, [10; 4], &mut |_| ());
    assert_eq!(motions.rotations(), [1; 4]);
    motions.turned(NOW, [1; 4], &mut |_| ());
    assert_eq!(motions.running(), None);
}
