//! Reading of one motor's PG wire by the firmware: distance and speed of the wheel.
//!
//! The wire gives pulses without a direction. The firmware takes them for pulses of the direction
//! in which it last drove the motor, and after a reversal for those of the old one as long as the
//! wheel needs to come to a stand; where the wheel was dragged or coasted the other way, that is
//! wrong, as it is on the real board. A setting gives the motors counters with a direction instead.

use std::collections::VecDeque;
use std::time::Duration;

use rigsim_settings::SimTime;

/// Most pulse times kept to measure the speed.
const MOST_EDGES: usize = 256;

/// Over what time the speed is measured.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SpeedWindow {
    /// The mean is over this time.
    pub window: Duration,
    /// Without a pulse for this long the wheel stands.
    pub timeout: Duration,
}

/// The time in which a wheel goes from full speed to a stand.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Stopping {
    /// Time for which it is driven the other way.
    pub reversed: Duration,
    /// Time for which it is held.
    pub held: Duration,
}

/// Source of the pulses' direction.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Counting {
    /// The counter counts up only, and pulses count the way in which the motor was last driven.
    Driven {
        /// Delay after which a wheel stands.
        stopping: Stopping,
    },
    /// The counter counts down when the motor turns back.
    Counted {
        /// The motor rolls its wheel backward when it turns forward.
        reversed: bool,
    },
}

/// Speed that a wheel should have by what its motor was asked to do, in shares of its full speed.
#[derive(Debug, Clone, Copy)]
struct Expected {
    at: SimTime,
    share: f64,
    wanted: f64,
}

impl Expected {
    fn share(&self, now: SimTime, stopping: Stopping) -> f64 {
        let full = if self.wanted == 0.0 {
            stopping.held
        } else {
            stopping.reversed
        };
        if full.is_zero() {
            return self.wanted;
        }
        let most = now.since(self.at).as_secs_f64() / full.as_secs_f64();
        self.share + (self.wanted - self.share).clamp(-most, most)
    }
}

/// One motor's pulse counter.
#[derive(Debug, Clone)]
pub struct Encoder {
    counting: Counting,
    /// As the wire had it last.
    count: u32,
    /// The way in which the motor is or was last driven, and the way in which pulses counted last.
    backward: bool,
    counted_backward: bool,
    expected: Expected,
    /// Times at which pulses came, and the place of the wheel by then, in pulses from the first of
    /// these.
    edges: VecDeque<(SimTime, i64)>,
}

impl Encoder {
    /// A counter that starts where the wire is.
    #[must_use]
    pub fn new(counting: Counting, count: u32) -> Self {
        Self {
            counting,
            count,
            backward: false,
            counted_backward: false,
            expected: Expected {
                at: SimTime::ZERO,
                share: 0.0,
                wanted: 0.0,
            },
            edges: VecDeque::new(),
        }
    }

    /// The motor is to turn with this share of its full speed from now on, negative backward.
    pub fn drive(&mut self, now: SimTime, share: f64) {
        if let Counting::Driven { stopping } = self.counting
            && self.expected.wanted.to_bits() != share.to_bits()
        {
            self.expected = Expected {
                at: now,
                share: self.expected.share(now, stopping),
                wanted: share,
            };
        }
        if share != 0.0 {
            self.backward = share < 0.0;
        }
    }

    /// Returns whether the motor was last driven backward.
    #[must_use]
    pub fn is_backward(&self) -> bool {
        self.backward
    }

    /// Reads the wire; gives the pulses that have come since the last reading, backward ones
    /// negative.
    pub fn read(&mut self, now: SimTime, count: u32, speed: SpeedWindow) -> i64 {
        let came = count.wrapping_sub(self.count);
        self.count = count;
        if came == 0 {
            return 0;
        }
        let (came, backward) = match self.counting {
            Counting::Driven { stopping } => (i64::from(came), self.turns_back(now, stopping)),
            Counting::Counted { reversed } => (i64::from(came.cast_signed()), reversed),
        };
        let came = if backward { -came } else { came };
        self.note(now, came, speed);
        came
    }

    /// Distance that pulses that were read get on in the direction in which the motor is driven.
    #[must_use]
    pub fn progress(&self, pulses: i64) -> i64 {
        if self.backward { -pulses } else { pulses }
    }

    /// Pulses a second, backward negative. A wheel that is not `driven` stands as soon as its next
    /// pulse is overdue; a driven one may only have become slow.
    #[must_use]
    pub fn pulse_rate(&self, now: SimTime, driven: bool, speed: SpeedWindow) -> f64 {
        let (Some(first), Some(last)) = (self.edges.front(), self.edges.back()) else {
            return 0.0;
        };
        let span = last.0.since(first.0).as_secs_f64();
        let silence = now.since(last.0);
        if span <= 0.0 || silence >= speed.timeout {
            return 0.0;
        }
        #[expect(clippy::cast_precision_loss, reason = "far fewer pulses than 2^53")]
        let rate = (last.1 - first.1) as f64 / span;
        let silence = silence.as_secs_f64();
        if silence * rate.abs() <= 1.0 {
            rate
        } else if driven {
            rate.signum() / silence
        } else {
            0.0
        }
    }

    /// Returns whether the wheel should turn backward.
    fn turns_back(&mut self, now: SimTime, stopping: Stopping) -> bool {
        let share = self.expected.share(now, stopping);
        let backward = if share == 0.0 {
            self.backward
        } else {
            share < 0.0
        };
        if backward != self.counted_backward {
            self.counted_backward = backward;
            self.edges.clear();
        }
        backward
    }

    fn note(&mut self, now: SimTime, came: i64, speed: SpeedWindow) {
        let last = self.edges.back().copied();
        if last.is_some_and(|(at, _)| now.since(at) >= speed.timeout) {
            // From standstill; the time before tells nothing about the speed.
            self.edges.clear();
        }
        let total = self.edges.back().map_or(0, |(_, total)| *total) + came;
        match self.edges.back_mut() {
            Some((at, last)) if *at == now => *last = total,
            _ => self.edges.push_back((now, total)),
        }
        // The one edge before the window stays, so that its whole length is measured.
        let begin = now - speed.window;
        while self.edges.len() > MOST_EDGES || self.edges.get(1).is_some_and(|(at, _)| *at <= begin)
        {
            self.edges.pop_front();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SPEED: SpeedWindow = SpeedWindow {
        window: Duration::from_millis(200),
        timeout: Duration::from_secs(1),
    };
    const MS: fn(u64) -> SimTime = SimTime::from_millis;
    const DRIVEN: Counting = Counting::Driven {
        stopping: Stopping {
            reversed: Duration::from_millis(200),
            held: Duration::from_millis(100),
        },
    };

    /// A pulse every `gap` milliseconds from time zero to `end`.
    fn turning(gap: usize, end: u64) -> Encoder {
        let mut encoder = Encoder::new(DRIVEN, u32::MAX);
        let mut count = u32::MAX;
        for at in (0..=end).step_by(gap) {
            count = count.wrapping_add(1);
            assert_eq!(encoder.read(MS(at), count, SPEED), 1);
        }
        encoder
    }

    #[test]
    fn a_steady_wheel_has_a_steady_speed_across_the_wrap_of_the_counter() {
        let encoder = turning(20, 2000);
        for after in 0..=20 {
            let rate = encoder.pulse_rate(MS(2000 + after), true, SPEED);
            assert!((rate - 50.0).abs() < 1e-9, "{rate}");
        }
    }

    #[test]
    fn a_slow_wheel_is_measured_over_more_than_the_window() {
        let rate = turning(500, 2000).pulse_rate(MS(2100), true, SPEED);
        assert!((rate - 2.0).abs() < 1e-9, "{rate}");
    }

    #[test]
    fn a_wheel_that_stops_is_seen_to() {
        let encoder = turning(20, 2000);
        let nano = Duration::from_nanos(1);
        assert_eq!(encoder.pulse_rate(MS(2020) + nano, false, SPEED), 0.0);
        assert!((encoder.pulse_rate(MS(2100), true, SPEED) - 10.0).abs() < 1e-9);
        assert!(encoder.pulse_rate(MS(3000) - nano, true, SPEED) > 0.99);
        assert_eq!(encoder.pulse_rate(MS(3000), true, SPEED), 0.0);
    }

    #[test]
    fn a_standstill_does_not_slow_the_speed_after_it() {
        let mut encoder = turning(20, 2000);
        for (pulse, at) in (9000..=9100).step_by(20).enumerate() {
            let count = u32::try_from(101 + pulse).unwrap();
            encoder.read(MS(at), count, SPEED);
        }
        assert!((encoder.pulse_rate(MS(9100), true, SPEED) - 50.0).abs() < 1e-9);
    }

    #[test]
    fn pulses_count_the_way_the_motor_was_driven_until_it_stands() {
        for (stopping, begins) in [(200, 220), (0, 120)] {
            let mut encoder = turning(20, 100);
            encoder.counting = Counting::Driven {
                stopping: Stopping {
                    reversed: Duration::from_millis(stopping),
                    held: Duration::ZERO,
                },
            };
            encoder.drive(MS(0), 0.5);
            let mut count = encoder.count;
            let mut read = |at, encoder: &mut Encoder| {
                count = count.wrapping_add(3);
                encoder.read(at, count, SPEED)
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
            assert_eq!(encoder.pulse_rate(after, true, SPEED), 0.0);
            read(begins + Duration::from_millis(60), &mut encoder);
            let rate = encoder.pulse_rate(begins + Duration::from_millis(60), true, SPEED);
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
            encoder.read(MS(at), count, SPEED)
        });
        assert_eq!(directions, [1, -1]);
    }

    #[test]
    fn a_counter_with_a_direction_needs_no_driving() {
        for (reversed, sign) in [(false, 1), (true, -1)] {
            let mut encoder = Encoder::new(Counting::Counted { reversed }, 1);
            assert_eq!(encoder.read(MS(0), 0, SPEED), -sign);
            assert_eq!(encoder.read(MS(20), u32::MAX, SPEED), -sign);
            let rate = encoder.pulse_rate(MS(20), false, SPEED);
            assert!((rate + f64::from(i32::try_from(sign).unwrap()) * 50.0).abs() < 1e-9);
            // Which way it is driven changes nothing.
            encoder.drive(MS(30), -1.0);
            assert_eq!(encoder.read(MS(40), 3, SPEED), 4 * sign);
        }
    }

    #[test]
    fn memory_is_bounded() {
        let mut encoder = Encoder::new(DRIVEN, 0);
        for nanos in 0..100_000u32 {
            encoder.read(SimTime::from_nanos(nanos.into()), nanos, SPEED);
        }
        assert!(encoder.edges.len() <= MOST_EDGES);
    }
}
