//! Velocity of a body and what pushes it, in its own axes.

/// Velocity of a body.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Twist {
    /// m/s.
    pub ahead: f64,
    /// m/s.
    pub left: f64,
    /// rad/s, counter-clockwise.
    pub turn: f64,
}

/// Force and torque on a body.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Wrench {
    /// N.
    pub ahead: f64,
    /// N.
    pub left: f64,
    /// N·m, counter-clockwise.
    pub turn: f64,
}

impl Twist {
    /// Returns the mean of this and another.
    #[must_use]
    pub(crate) fn mean(self, other: Self) -> Self {
        Self {
            ahead: (self.ahead + other.ahead) / 2.0,
            left: (self.left + other.left) / 2.0,
            turn: (self.turn + other.turn) / 2.0,
        }
    }

    /// Returns the velocity after `seconds` in which a wrench acts on a mass, kg, and its inertia, kg·m².
    #[must_use]
    pub(crate) fn pushed(self, by: Wrench, seconds: f64, mass: f64, inertia: f64) -> Self {
        Self {
            ahead: self.ahead + seconds * by.ahead / mass,
            left: self.left + seconds * by.left / mass,
            turn: self.turn + seconds * by.turn / inertia,
        }
    }
}

impl Wrench {
    /// Returns the power that it gives a body that moves so, W.
    #[must_use]
    pub(crate) fn power(self, velocity: Twist) -> f64 {
        self.ahead * velocity.ahead + self.left * velocity.left + self.turn * velocity.turn
    }
}
