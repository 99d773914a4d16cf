use super::*;

fn wire() -> PulseWire {
    PulseWire::new(60.0)
}

const PULSE: f64 = std::f64::consts::TAU / 60.0;

#[test]
fn a_revolution_is_sixty_pulses_either_way() {
    for sign in [1.0, -1.0] {
        for pieces in [1, 7, 600] {
            let mut wire = wire();
            for _ in 0..pieces {
                wire.turn(
                    sign * std::f64::consts::TAU / f64::from(pieces),
                    EncoderState::Working,
                );
            }
            assert_eq!(wire.count, 60, "{sign} {pieces}");
        }
    }
}

#[test]
fn the_next_pulse_comes_when_it_is_said_to() {
    for (speed, acceleration) in [(3.0, 0.0), (-3.0, 2.0), (3.0, -2.0), (0.01, 5.0)] {
        let mut wire = wire();
        let mut turning = Turning::new(speed, acceleration);
        for count in 1..=5 {
            let seconds = wire.next_in(turning).unwrap();
            let until = turning.angle(seconds * 0.999);
            wire.turn(until, EncoderState::Working);
            assert_eq!(wire.count, count - 1, "{turning:?}");
            let beyond = turning.angle(seconds * 1.001);
            wire.turn(beyond - until, EncoderState::Working);
            assert_eq!(wire.count, count, "{turning:?}");
            turning = turning.after(seconds * 1.001);
        }
    }
}

/// It needs half a pulse forward for the first one and 0.6 back.
#[test]
fn a_wheel_that_stands_before_its_next_pulse_gives_none() {
    let next_in = |speed: f64, turns: f64| {
        // Slowing so that it turns by so many pulses until it stands.
        let acceleration = -speed * speed.abs() / (2.0 * turns * PULSE);
        wire().next_in(Turning::new(speed, acceleration))
    };
    assert!(next_in(3.0, 0.501).is_some() && next_in(3.0, 0.499).is_none());
    assert!(next_in(-3.0, 0.601).is_some() && next_in(-3.0, 0.599).is_none());
    let standing = Turning::new(0.0, -300.0);
    assert_eq!(wire().next_in(standing), None);
    assert_eq!(standing.angle(1.0), 0.0);
    let stopped = Turning::new(3.0, -300.0).after(1.0);
    assert_eq!((stopped.angle(1.0), wire().next_in(stopped)), (0.0, None));
}

#[test]
fn turning_back_counts_up_but_trembling_on_the_brink_does_not() {
    let mut wire = wire();
    wire.turn(5.0 * PULSE, EncoderState::Working);
    wire.turn(-5.0 * PULSE, EncoderState::Working);
    assert_eq!(wire.count, 10);
    wire.turn(0.51 * PULSE, EncoderState::Working);
    let count = wire.count;
    for _ in 0..100 {
        wire.turn(-0.02 * PULSE, EncoderState::Working);
        wire.turn(0.02 * PULSE, EncoderState::Working);
    }
    assert_eq!(wire.count, count);
}

#[test]
fn a_lost_wire_loses_pulses_and_a_stuck_counter_keeps_them() {
    let mut wire = wire();
    wire.turn(10.0 * PULSE, EncoderState::Lost);
    assert_eq!(wire.count, 0);
    wire.turn(10.0 * PULSE, EncoderState::Stuck);
    assert_eq!(wire.count, 0);
    wire.turn(PULSE, EncoderState::Working);
    assert_eq!(wire.count, 11);
}
