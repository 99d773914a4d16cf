use super::*;

const MS: fn(u64) -> SimTime = SimTime::from_millis;
const STOPPING: Stopping = Stopping {
    reversed: Duration::from_millis(200),
    held: Duration::from_millis(100),
};

/// A pulse every `gap` milliseconds from time zero to `end`.
fn turning(gap: usize, end: u64) -> Encoder {
    let mut encoder = Encoder::new(STOPPING, u32::MAX);
    let mut count = u32::MAX;
    for at in (0..=end).step_by(gap) {
        count = count.wrapping_add(1);
        assert_eq!(encoder.read(MS(at), count), 1);
    }
    encoder
}

#[test]
fn a_steady_wheel_has_a_steady_speed_across_the_wrap_of_the_counter() {
    let encoder = turning(20, 2000);
    for after in 0..=20 {
        let rate = encoder.pulse_rate(MS(2000 + after), true);
        assert!((rate - 50.0).abs() < 1e-9, "{rate}");
    }
}

#[test]
fn a_slow_wheel_is_measured_over_more_than_the_window() {
    let rate = turning(500, 2000).pulse_rate(MS(2100), true);
    assert!((rate - 2.0).abs() < 1e-9, "{rate}");
}

#[test]
fn a_wheel_that_stops_is_seen_to() {
    let encoder = turning(20, 2000);
    let nano = Duration::from_nanos(1);
    assert_eq!(encoder.pulse_rate(MS(2020) + nano, false), 0.0);
    assert!((encoder.pulse_rate(MS(2100), true) - 10.0).abs() < 1e-9);
    assert!(encoder.pulse_rate(MS(3000) - nano, true) > 0.99);
    assert_eq!(encoder.pulse_rate(MS(3000), true), 0.0);
}

#[test]
fn a_standstill_does_not_slow_the_speed_after_it() {
    let mut encoder = turning(20, 2000);
    for (pulse, at) in (9000..=9100).step_by(20).enumerate() {
        let count = u32::try_from(101 + pulse).unwrap();
        encoder.read(MS(at), count);
    }
    assert!((encoder.pulse_rate(MS(9100), true) - 50.0).abs() < 1e-9);
}

#[test]
fn pulses_count_the_way_the_motor_was_driven_until_it_stands() {
    for (stopping, begins) in [(200, 220), (0, 120)] {
        let mut encoder = turning(20, 100);
        encoder.stopping = Stopping {
            reversed: Duration::from_millis(stopping),
            held: Duration::ZERO,
        };
        encoder.drive(MS(0), 0.5);
        let mut count = encoder.count;
        let mut read = |at, encoder: &mut Encoder| {
            count = count.wrapping_add(3);
            encoder.read(at, count)
        };
        assert_eq!(read(MS(119), &mut encoder), 3);
        // At half its speed it needs half its time.
        encoder.drive(MS(120), -1.0);
        let begins = MS(begins);
        if stopping > 0 {
            assert_eq!(read(begins - Duration::from_nanos(1), &mut encoder), 3);
        }
        let after = begins + Duration::from_nanos(1);
        assert_eq!(read(after, &mut encoder), -3);
        assert_eq!(encoder.pulse_rate(after, true), 0.0);
        read(begins + Duration::from_millis(60), &mut encoder);
        let rate = encoder.pulse_rate(begins + Duration::from_millis(60), true);
        assert!((rate + 50.0).abs() < 1e-4, "{rate}");
    }
}

#[test]
fn a_wheel_that_is_held_stands_after_its_time() {
    let mut encoder = turning(20, 1000);
    encoder.drive(MS(0), 1.0);
    encoder.drive(MS(1000), 0.0);
    // Held for half of it, half its speed is left.
    encoder.drive(MS(1050), -1.0);
    let mut count = encoder.count;
    let directions = [1149, 1151].map(|at| {
        count = count.wrapping_add(1);
        encoder.read(MS(at), count)
    });
    assert_eq!(directions, [1, -1]);
}

#[test]
fn memory_is_bounded() {
    let mut encoder = Encoder::new(STOPPING, 0);
    for nanos in 0..100_000u32 {
        encoder.read(SimTime::from_nanos(nanos.into()), nanos);
    }
    assert!(encoder.edges.len() <= MOST_EDGES);
}
