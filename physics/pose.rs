//! Place and motion of a body.

use crate::twist::Twist;

/// A position and heading on the plane.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Pose {
    /// Metres along the world's x axis.
    pub x: f64,
    /// Metres along the world's y axis.
    pub y: f64,
    /// Radians counter-clockwise from the x axis, in −π..=π when read back.
    pub heading: f64,
}

/// The motion of a body as the world holds it.
///
/// The heading is kept as its cosine and sine, because every step needs those and only a reader
/// needs the angle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BodyMotion {
    /// Metres along the world's x axis.
    pub x: f64,
    /// Metres along the world's y axis.
    pub y: f64,
    /// Cosine of the heading.
    pub cos: f64,
    /// Sine of the heading.
    pub sin: f64,
    /// Velocity along the world's x axis, m/s.
    pub vx: f64,
    /// Velocity along the world's y axis, m/s.
    pub vy: f64,
    /// Radians per second, counter-clockwise.
    pub yaw_rate: f64,
}

impl BodyMotion {
    /// Position and heading.
    #[must_use]
    pub fn pose(&self) -> Pose {
        Pose {
            x: self.x,
            y: self.y,
            heading: libm::atan2(self.sin, self.cos),
        }
    }

    /// A vector of the world in the axes of the body: forward, left.
    #[must_use]
    pub fn to_body(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        [self.cos * x + self.sin * y, self.cos * y - self.sin * x]
    }

    /// A vector of the body, forward and left, in the axes of the world.
    #[must_use]
    pub fn to_world(&self, [forward, left]: [f64; 2]) -> [f64; 2] {
        [
            self.cos * forward - self.sin * left,
            self.sin * forward + self.cos * left,
        ]
    }

    /// Returns the velocity in the axes of the body.
    #[must_use]
    pub fn body_velocity(&self) -> Twist {
        let [ahead, left] = self.to_body([self.vx, self.vy]);
        Twist {
            ahead,
            left,
            turn: self.yaw_rate,
        }
    }
}
