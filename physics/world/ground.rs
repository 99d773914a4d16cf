//! Ground under the wheels.

/// The ground under one point.
///
/// The world is seen from above, so a slope does not tilt anything: it shows as a force downhill
/// and as lighter wheels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ground {
    friction: f64,
    sin_slope: f64,
    cos_slope: f64,
    uphill: [f64; 2],
}

impl Ground {
    /// Ground with a friction coefficient, a slope in radians, and the world direction in which it
    /// rises, in radians counter-clockwise from x.
    ///
    /// The friction is held within 0..=10 and the slope within ±1.5 rad; a value that is not a
    /// number counts as 0, so that no call can put one into the world.
    #[must_use]
    pub fn new(friction: f64, slope: f64, uphill: f64) -> Self {
        let slope = finite(slope).clamp(-1.5, 1.5);
        let uphill = finite(uphill);
        Self {
            friction: finite(friction).clamp(0.0, 10.0),
            sin_slope: libm::sin(slope),
            cos_slope: libm::cos(slope),
            uphill: [libm::cos(uphill), libm::sin(uphill)],
        }
    }

    /// Flat ground.
    #[must_use]
    pub fn flat(friction: f64) -> Self {
        Self::new(friction, 0.0, 0.0)
    }

    /// This ground with the slope of another.
    #[must_use]
    pub fn with_slope_of(self, other: &Self) -> Self {
        Self {
            friction: self.friction,
            ..*other
        }
    }

    /// This ground with the friction of another.
    #[must_use]
    pub fn with_friction_of(self, other: &Self) -> Self {
        Self {
            friction: other.friction,
            ..self
        }
    }

    /// Coefficient of friction between tyre and ground.
    #[must_use]
    pub fn friction(&self) -> f64 {
        self.friction
    }

    /// The share of gravity that presses the wheels down.
    #[must_use]
    pub fn cos_slope(&self) -> f64 {
        self.cos_slope
    }

    /// The share of gravity that pulls along the ground, as a vector of the world.
    #[must_use]
    pub fn downhill(&self) -> [f64; 2] {
        self.uphill.map(|axis| -axis * self.sin_slope)
    }
}

fn finite(value: f64) -> f64 {
    if value.is_finite() { value } else { 0.0 }
}
