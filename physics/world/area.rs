//! Parts of the plane: what stands on it, and where the ground is another.

/// A part of the plane.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Shape {
    /// A rectangle.
    Rectangle(Rectangle),
    /// A disc.
    Disc(Disc),
    /// A band with round ends.
    Band(Band),
}

/// A rectangle that may be turned.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rectangle {
    /// Middle, m.
    pub centre: [f64; 2],
    /// Cosine and sine of the direction of its length.
    pub direction: [f64; 2],
    /// Half its length and half its width, m.
    pub half: [f64; 2],
}

/// A disc.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Disc {
    /// Middle, m.
    pub centre: [f64; 2],
    /// m
    pub radius: f64,
}

/// A band with round ends.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Band {
    /// Ends of its middle line, m.
    pub ends: [[f64; 2]; 2],
    /// Half its thickness, m.
    pub radius: f64,
}

impl Shape {
    /// Returns whether a point lies in it or on its rim.
    #[must_use]
    pub fn contains(&self, point: [f64; 2]) -> bool {
        match self {
            Self::Rectangle(rectangle) => rectangle.contains(point),
            Self::Disc(disc) => disc.contains(point),
            Self::Band(band) => band.contains(point),
        }
    }

    /// A disc that holds it.
    pub(super) fn bounds(&self) -> ([f64; 2], f64) {
        match self {
            Self::Rectangle(Rectangle { centre, half, .. }) => (*centre, half[0] + half[1]),
            Self::Disc(Disc { centre, radius }) => (*centre, *radius),
            Self::Band(Band { ends, radius }) => {
                let [start, end] = *ends;
                let middle = [(start[0] + end[0]) / 2.0, (start[1] + end[1]) / 2.0];
                (middle, square(from(middle, end)).sqrt() + radius)
            }
        }
    }
}

impl Rectangle {
    /// A rectangle whose length points `heading` radians counter-clockwise from x.
    #[must_use]
    pub fn new(centre: [f64; 2], heading: f64, length: f64, width: f64) -> Self {
        Self {
            centre,
            direction: [libm::cos(heading), libm::sin(heading)],
            half: [length / 2.0, width / 2.0],
        }
    }

    /// Returns whether a point lies in it or on its rim.
    #[must_use]
    pub fn contains(&self, point: [f64; 2]) -> bool {
        let [x, y] = from(self.centre, point);
        let [cos, sin] = self.direction;
        (cos * x + sin * y).abs() <= self.half[0] && (cos * y - sin * x).abs() <= self.half[1]
    }

    /// Its corners, one after the other around it.
    #[must_use]
    pub fn corners(&self) -> [[f64; 2]; 4] {
        let [cos, sin] = self.direction;
        [[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]].map(|[length, width]| {
            let (along, across) = (length * self.half[0], width * self.half[1]);
            [
                self.centre[0] + cos * along - sin * across,
                self.centre[1] + sin * along + cos * across,
            ]
        })
    }
}

impl Disc {
    /// Returns whether a point lies in it or on its rim.
    #[must_use]
    pub fn contains(&self, point: [f64; 2]) -> bool {
        square(from(self.centre, point)) <= self.radius * self.radius
    }
}

impl Band {
    /// Returns whether a point lies in it or on its rim.
    #[must_use]
    pub fn contains(&self, point: [f64; 2]) -> bool {
        self.square_distance(point) <= self.radius * self.radius
    }

    /// Square of the distance of a point from the middle line, m².
    #[must_use]
    pub fn square_distance(&self, point: [f64; 2]) -> f64 {
        let [start, end] = self.ends;
        let (along, to) = (from(start, end), from(start, point));
        let length = square(along);
        let share = if length > 0.0 {
            (dot(along, to) / length).clamp(0.0, 1.0)
        } else {
            0.0
        };
        square([to[0] - share * along[0], to[1] - share * along[1]])
    }
}

pub(super) fn from([x0, y0]: [f64; 2], [x1, y1]: [f64; 2]) -> [f64; 2] {
    [x1 - x0, y1 - y0]
}

pub(super) fn dot([x0, y0]: [f64; 2], [x1, y1]: [f64; 2]) -> f64 {
    x0 * x1 + y0 * y1
}

pub(super) fn square(vector: [f64; 2]) -> f64 {
    dot(vector, vector)
}
