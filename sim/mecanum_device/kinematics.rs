//! Direction of each wheel for each movement, and back.
//!
//! Speeds are those of the wheels' contact points; body speeds are ahead, to the left, and turning
//! counter-clockwise. The relation is that of Taheri, Qiao and Ghaeminezhad, IJCA 113(3), 2015, for
//! rollers that lie, seen from above, like `\` at LF and RR and like `/` at RF and LR.

use std::fmt;

use rigsim_physics::mecanum::WHEELS;
use schemars::JsonSchema;
use serde::Deserialize;

/// Speeds of the wheels LF, RF, LR, RR that give the body its speed. `arm` is half the wheelbase
/// plus half the track.
#[must_use]
pub fn wheel_speeds([ahead, left, turn]: [f64; 3], arm: f64) -> [f64; WHEELS] {
    [
        ahead - left - arm * turn,
        ahead + left + arm * turn,
        ahead + left - arm * turn,
        ahead - left + arm * turn,
    ]
}

/// The body's speed that wheels without slip give it, the inverse of [`wheel_speeds`]; the best
/// compromise where four wheels contradict one another.
#[must_use]
pub fn body_speed([lf, rf, lr, rr]: [f64; WHEELS], arm: f64) -> [f64; 3] {
    [
        (lf + rf + lr + rr) / 4.0,
        (-lf + rf + lr - rr) / 4.0,
        (-lf + rf - lr + rr) / (4.0 * arm),
    ]
}

rigsim_settings::words! {
    /// The five kinds of movement, in the order of `moving_idx`.
    pub enum Course {
        /// 0: forward and backward.
        Ahead = "ahead",
        /// 1: turning on the spot, right and left.
        Rotate = "rotate",
        /// 2: sideways, left and right.
        Strafe = "strafe",
        /// 3: to the left front and the right rear.
        LeftFront = "left front",
        /// 4: to the right front and the left rear.
        RightFront = "right front",
    }
}

impl Course {
    /// Direction of the body for a positive speed: ahead, left, counter-clockwise.
    fn direction(self) -> [f64; 3] {
        match self {
            Self::Ahead => [1.0, 0.0, 0.0],
            Self::Rotate => [0.0, 0.0, -1.0],
            Self::Strafe => [0.0, 1.0, 0.0],
            Self::LeftFront => [1.0, 1.0, 0.0],
            Self::RightFront => [1.0, -1.0, 0.0],
        }
    }
}

/// One of the ten movements of the article's picture: a course and its sign.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Deserialize, JsonSchema)]
#[serde(from = "CarKey")]
#[schemars(with = "CarKey")]
pub struct Movement {
    /// The course.
    pub course: Course,
    /// Returns whether it goes the course's negative way.
    pub negative: bool,
}

rigsim_settings::words! {
    /// A motion key of the car's remote control.
    #[derive(Deserialize, JsonSchema)]
    #[serde(rename_all = "kebab-case")]
    enum CarKey {
        Forward = "forward",
        Backward = "backward",
        TurnLeft = "turn left",
        TurnRight = "turn right",
        StrafeLeft = "strafe left",
        StrafeRight = "strafe right",
        LeftFront = "left front",
        RightFront = "right front",
        LeftRear = "left rear",
        RightRear = "right rear",
    }
}

impl From<CarKey> for Movement {
    fn from(key: CarKey) -> Self {
        let (course, negative) = match key {
            CarKey::Forward => (Course::Ahead, false),
            CarKey::Backward => (Course::Ahead, true),
            CarKey::TurnLeft => (Course::Rotate, true),
            CarKey::TurnRight => (Course::Rotate, false),
            CarKey::StrafeLeft => (Course::Strafe, false),
            CarKey::StrafeRight => (Course::Strafe, true),
            CarKey::LeftFront => (Course::LeftFront, false),
            CarKey::RightRear => (Course::LeftFront, true),
            CarKey::RightFront => (Course::RightFront, false),
            CarKey::LeftRear => (Course::RightFront, true),
        };
        Self { course, negative }
    }
}

impl Movement {
    /// Direction in which each wheel rolls, LF, RF, LR, RR: 1 forward, −1 backward, 0 not at all.
    #[must_use]
    pub fn rotations(self) -> [i8; WHEELS] {
        let sign = self.sign();
        wheel_speeds(self.course.direction(), 1.0).map(|speed| {
            if speed > 0.0 {
                sign
            } else if speed < 0.0 {
                -sign
            } else {
                0
            }
        })
    }

    /// 1, or −1 for the negative way.
    #[must_use]
    pub fn sign(self) -> i8 {
        if self.negative { -1 } else { 1 }
    }
}

impl fmt::Display for Movement {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut keys = CarKey::ALL.into_iter();
        let key = keys.find(|key| Self::from(*key) == *self);
        f.write_str(key.map_or("", CarKey::as_str))
    }
}

#[cfg(test)]
mod tests;
