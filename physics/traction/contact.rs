//! Axes of a contact patch in the body.

use nalgebra::Vector3;

use super::Patch;

/// Along, and across.
const UNITS: [[f64; 2]; 2] = [[1.0, 0.0], [0.0, 1.0]];

/// The two axes of a patch, along and across.
///
/// The methods say the same thing in the forms that the solver needs, so that the axes of a tyre
/// cost nothing.
pub trait Contact: Copy + std::fmt::Debug {
    /// Number of the axes, from the first, that the turning of the wheel pushes along.
    const DRIVEN: usize;

    /// A vector of the body, forward and left, as its parts along and across.
    fn split(&self, vector: [f64; 2]) -> [f64; 2];

    /// The parts along and across as a vector of the body, forward and left.
    fn join(&self, parts: [f64; 2]) -> [f64; 2];

    /// Forward part of an axis: the share of a force on it that turns the wheel back.
    fn forward(&self, axis: usize) -> f64 {
        self.join(UNITS[axis])[0]
    }

    /// A unit of each axis at `place` as forward, left and turn of the body.
    fn jacobian(&self, place: &Patch) -> [Vector3<f64>; 2] {
        let levers = self.levers(place);
        [0, 1].map(|axis| {
            let [forward, left] = self.join(UNITS[axis]);
            Vector3::new(forward, left, levers[axis])
        })
    }

    /// The lever arm of each axis at `place` about the body's centre, m.
    fn levers(&self, place: &Patch) -> [f64; 2];

    /// The speed with which the contact turns by itself at this slip, m/s.
    fn spin(&self, slip: [f64; 2]) -> f64;
}

/// A tyre: forward and left.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Straight;

impl Contact for Straight {
    const DRIVEN: usize = 1;

    fn split(&self, vector: [f64; 2]) -> [f64; 2] {
        vector
    }

    fn join(&self, parts: [f64; 2]) -> [f64; 2] {
        parts
    }

    fn levers(&self, place: &Patch) -> [f64; 2] {
        [-place.y, place.x]
    }

    fn spin(&self, _slip: [f64; 2]) -> f64 {
        0.0
    }
}

/// A roller under a wheel: along its own axle, and the way in which it turns.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Slanted {
    /// The axle as a unit vector, forward and left.
    axle: [f64; 2],
}

impl Slanted {
    /// A roller whose axle lies `angle` radians counter-clockwise from straight ahead.
    #[must_use]
    pub fn new(angle: f64) -> Self {
        Self {
            axle: [libm::cos(angle), libm::sin(angle)],
        }
    }
}

impl Contact for Slanted {
    const DRIVEN: usize = 2;

    fn split(&self, [forward, left]: [f64; 2]) -> [f64; 2] {
        let [ahead, aside] = self.axle;
        [
            forward * ahead + left * aside,
            left * ahead - forward * aside,
        ]
    }

    fn join(&self, [along, across]: [f64; 2]) -> [f64; 2] {
        let [ahead, aside] = self.axle;
        [
            along * ahead - across * aside,
            along * aside + across * ahead,
        ]
    }

    fn levers(&self, place: &Patch) -> [f64; 2] {
        let [ahead, aside] = self.axle;
        [
            place.x * aside - place.y * ahead,
            place.x * ahead + place.y * aside,
        ]
    }

    fn spin(&self, slip: [f64; 2]) -> f64 {
        slip[1].abs()
    }
}
