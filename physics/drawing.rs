//! Outlines of vehicles from above.

/// Width of a wheel as it is drawn, as a share of its diameter; of no effect on anything else.
const WIDTH: f64 = 0.4;

/// Outline of a vehicle from above, in its own axes: m ahead and left of its middle.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Drawing {
    /// Its wheels.
    pub wheels: Vec<WheelDrawing>,
    /// Its sensors that measure distances.
    pub echoes: Vec<EchoDrawing>,
}

/// A wheel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WheelDrawing {
    /// Its middle.
    pub place: [f64; 2],
    /// Its diameter, m.
    pub length: f64,
    /// m
    pub width: f64,
    /// Speed at which it turns, rad/s, positive ahead.
    pub speed: f64,
}

/// A sensor that measures distances.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EchoDrawing {
    /// x and y, m.
    pub place: [f64; 2],
    /// Direction in which it looks, rad.
    pub heading: f64,
    /// From side to side of what it sees, rad.
    pub opening: f64,
    /// Range, m.
    pub range: f64,
    /// Distance that it has seen last, m.
    pub distance: Option<f64>,
}

impl WheelDrawing {
    /// A wheel of this radius at a place, m, and the speed at which it turns, rad/s.
    pub(crate) fn new(place: [f64; 2], radius: f64, speed: f64) -> Self {
        Self {
            place,
            length: 2.0 * radius,
            width: 2.0 * radius * WIDTH,
            speed,
        }
    }
}

#[cfg(test)]
mod tests;
