//! The pulses that a motor gives as its wheel turns.

use crate::faults::EncoderState;

/// One PG wire and its counter.
#[derive(Debug, Clone)]
pub(super) struct PulseWire {
    per_radian: f64,
    /// Share of a pulse by which a wheel must turn back before it gives pulses again.
    hysteresis: f64,
    /// The wheel's angle in pulses, and the last one given.
    angle: f64,
    edge: f64,
    /// Set if the counter counts down when the wheel turns back.
    pub(super) directed: bool,
    /// Count that shows.
    pub(super) count: u32,
    /// Count that a stuck counter keeps back.
    held_back: u32,
}

impl PulseWire {
    pub(super) fn new(pulses_per_revolution: f64, hysteresis: f64) -> Self {
        Self {
            per_radian: pulses_per_revolution / std::f64::consts::TAU,
            hysteresis,
            // Half-way between two pulses, so that no wheel begins on the brink of one.
            angle: 0.5,
            edge: 0.0,
            directed: false,
            count: 0,
            held_back: 0,
        }
    }

    /// Seconds until the next pulse if the wheel turns on with this speed, rad/s; none of one that
    /// stands.
    pub(super) fn next_in(&self, speed: f64) -> Option<f64> {
        let pulses = if speed > 0.0 {
            self.edge + 1.0 - self.angle
        } else {
            self.angle - (self.edge - self.hysteresis)
        };
        let seconds = pulses.max(0.0) / (speed.abs() * self.per_radian);
        (speed != 0.0).then_some(seconds)
    }

    /// Lets the wheel turn by `angle` radians.
    pub(super) fn turn(&mut self, angle: f64, encoder: EncoderState) {
        self.angle += angle * self.per_radian;
        let edge = if self.angle >= self.edge + 1.0 {
            self.angle.floor()
        } else if self.angle < self.edge - self.hysteresis {
            (self.angle + self.hysteresis).floor()
        } else {
            self.edge
        };
        let turned = edge - self.edge;
        let mut pulses = whole(turned.abs());
        if self.directed && turned < 0.0 {
            pulses = pulses.wrapping_neg();
        }
        self.edge = edge;
        match encoder {
            EncoderState::Lost => pulses = 0,
            EncoderState::Stuck => {
                self.held_back = self.held_back.wrapping_add(pulses);
                return;
            }
            EncoderState::Working => {}
        }
        self.count = self.count.wrapping_add(pulses).wrapping_add(self.held_back);
        self.held_back = 0;
    }
}

#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "a cast from a float saturates, and a counter that saturates has long lost its meaning"
)]
fn whole(value: f64) -> u32 {
    value as u32
}

#[cfg(test)]
mod tests {
    use super::*;

    fn wire() -> PulseWire {
        PulseWire::new(60.0, 0.1)
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
        for speed in [3.0, -3.0, 0.01] {
            let mut wire = wire();
            for count in 1..=5 {
                let seconds = wire.next_in(speed).unwrap();
                wire.turn(speed * seconds * 0.999, EncoderState::Working);
                assert_eq!(wire.count, count - 1, "{speed}");
                wire.turn(speed * seconds * 0.002, EncoderState::Working);
                assert_eq!(wire.count, count, "{speed}");
            }
        }
        assert_eq!(wire().next_in(0.0), None);
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
    fn a_counter_with_a_direction_counts_down() {
        let mut wire = wire();
        wire.directed = true;
        wire.turn(-5.0 * PULSE, EncoderState::Working);
        assert_eq!(wire.count.cast_signed(), -5);
        wire.turn(-2.0 * PULSE, EncoderState::Stuck);
        wire.turn(12.0 * PULSE, EncoderState::Working);
        assert_eq!(wire.count, 5);
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
}
