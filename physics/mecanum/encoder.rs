//! The pulses that a motor gives as its wheel turns.

use crate::faults::EncoderState;

/// Share of a pulse by which a wheel must turn back before it gives pulses again; assumed: Hall sensors
/// have a little, so that a standing wheel gives no pulses.
const HYSTERESIS: f64 = 0.1;

/// One PG wire and its counter.
#[derive(Debug, Clone)]
pub(super) struct PulseWire {
    per_radian: f64,
    /// The wheel's angle in pulses, and the last one given.
    angle: f64,
    edge: f64,
    /// Count that shows.
    pub(super) count: u32,
    /// Count that a stuck counter keeps back.
    held_back: u32,
}

/// How a wheel is foreseen to turn on: as it does, or slowing as it does until it stands.
#[derive(Debug, Clone, Copy)]
pub(super) struct Turning {
    /// rad/s
    speed: f64,
    /// rad/s², never in the direction of the speed.
    slowing: f64,
}

impl Turning {
    /// From speed (rad/s) and acceleration (rad/s²). Only one that slows the wheel is taken to go
    /// on: a wheel that has just been stopped must not be foreseen to turn back.
    pub(super) fn new(speed: f64, acceleration: f64) -> Self {
        let slows = speed * acceleration < 0.0;
        Self {
            speed,
            slowing: if slows { acceleration } else { 0.0 },
        }
    }

    /// Angle by which it turns in so many seconds, rad.
    pub(super) fn angle(self, seconds: f64) -> f64 {
        let seconds = self.until_it_stands(seconds);
        seconds * (self.speed + self.slowing * seconds / 2.0)
    }

    /// How it turns on after so many seconds.
    pub(super) fn after(self, seconds: f64) -> Self {
        let turned = self.until_it_stands(seconds);
        if turned < seconds {
            return Self::new(0.0, 0.0);
        }
        Self::new(self.speed + self.slowing * seconds, self.slowing)
    }

    /// Seconds after which it has turned on by an angle of so many radians, which is at least 0.
    fn seconds_for(self, angle: f64) -> Option<f64> {
        let reaching = self.speed * self.speed - 2.0 * self.slowing.abs() * angle;
        let reaches = self.speed != 0.0 && reaching >= 0.0;
        reaches.then(|| 2.0 * angle / (self.speed.abs() + reaching.sqrt()))
    }

    /// So many seconds, or less if it stands before.
    fn until_it_stands(self, seconds: f64) -> f64 {
        if self.slowing == 0.0 {
            seconds
        } else {
            seconds.min(-self.speed / self.slowing)
        }
    }
}

impl PulseWire {
    pub(super) fn new(pulses_per_revolution: f64) -> Self {
        Self {
            per_radian: pulses_per_revolution / std::f64::consts::TAU,
            // Half-way between two pulses, so that no wheel begins on the brink of one.
            angle: 0.5,
            edge: 0.0,
            count: 0,
            held_back: 0,
        }
    }

    /// Seconds until the next pulse of a wheel that turns on like this; none of one that stands
    /// before.
    pub(super) fn next_in(&self, turning: Turning) -> Option<f64> {
        let pulses = if turning.speed > 0.0 {
            self.edge + 1.0 - self.angle
        } else {
            self.angle - (self.edge - HYSTERESIS)
        };
        turning.seconds_for(pulses.max(0.0) / self.per_radian)
    }

    /// Turns the wheel by `angle` radians.
    pub(super) fn turn(&mut self, angle: f64, encoder: EncoderState) {
        self.angle += angle * self.per_radian;
        let edge = if self.angle >= self.edge + 1.0 {
            self.angle.floor()
        } else if self.angle < self.edge - HYSTERESIS {
            (self.angle + HYSTERESIS).floor()
        } else {
            self.edge
        };
        let mut pulses = whole((edge - self.edge).abs());
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
mod tests;
