//! Findings of sensors in the world: echoes, tags, magnetic strips.
//!
//! Distances are exact for the shapes: an echo comes from the nearest point of an obstacle that
//! lies within the cone and faces the sensor well enough; ends and corners face every way. Nothing
//! is too thin to be seen.

use super::area::{Band, Disc, Rectangle, Shape, dot, from, square};
use super::{BodyId, World};

/// The cone of an ultrasonic sensor, or with no width the beam of an infrared one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cone {
    /// Place of the sensor, m.
    pub origin: [f64; 2],
    /// Direction in which it looks: a unit vector.
    pub direction: [f64; 2],
    /// Cosine and sine of half its opening, under 90°.
    pub half_opening: [f64; 2],
    /// Cosine of the greatest angle from its normal at which a surface sends an echo back.
    pub grazing: f64,
    /// Range, m.
    pub range: f64,
}

/// An RFID tag on the ground.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tag {
    /// Where the sensor is, m.
    pub at: [f64; 2],
    /// Number that a reader reads, not 0, which means none.
    pub number: u32,
}

impl World {
    /// Distance of the nearest echo of obstacles and bodies other than `own`, m.
    #[must_use]
    pub fn nearest_echo(&self, cone: &Cone, own: Option<BodyId>) -> Option<f64> {
        let mut nearest = Nearest::new(cone);
        for solid in self.solids() {
            nearest.look_at(solid);
        }
        for (index, body) in self.bodies.iter().enumerate() {
            let id = BodyId(index);
            if Some(id) == own {
                continue;
            }
            let motion = self.motion(id);
            nearest.look_at(&Shape::Rectangle(Rectangle {
                centre: [motion.x, motion.y],
                direction: [motion.cos, motion.sin],
                half: body.half,
            }));
        }
        nearest.found
    }

    /// The tag nearest to a point, if one lies within `radius` metres.
    #[must_use]
    pub fn tag_near(&self, point: [f64; 2], radius: f64) -> Option<Tag> {
        let mut nearest: Option<(f64, Tag)> = None;
        for tag in &self.tags {
            let distance = square(from(tag.at, point));
            if distance <= radius * radius && nearest.is_none_or(|(best, _)| distance < best) {
                nearest = Some((distance, *tag));
            }
        }
        nearest.map(|(_, tag)| tag)
    }

    /// Points that have the middle line of a magnetic strip within `reach` metres, the first as
    /// bit 0.
    #[must_use]
    pub fn strips_under(&self, points: &[[f64; 2]; 16], reach: f64) -> u16 {
        if self.strips.is_empty() {
            return 0;
        }
        // The points lie on one line, so a strip far from its middle is far from all of them.
        let middle = [
            (points[0][0] + points[15][0]) / 2.0,
            (points[0][1] + points[15][1]) / 2.0,
        ];
        let radius = reach + square(from(points[0], points[15])).sqrt() / 2.0;
        let mut bits = 0;
        for strip in &self.strips {
            if strip.square_distance(middle) > radius * radius {
                continue;
            }
            for (bit, point) in points.iter().enumerate() {
                if strip.square_distance(*point) <= reach * reach {
                    bits |= 1 << bit;
                }
            }
        }
        bits
    }
}

/// The search for the nearest point of several shapes within a cone.
///
/// Seen from the origin, the distance of an edge falls and rises again at most once. So the nearest
/// point of a shape within a cone is the nearest of all where that lies within, an end of an edge,
/// or a point on the rim of the cone.
struct Nearest<'c> {
    cone: &'c Cone,
    found: Option<f64>,
}

impl<'c> Nearest<'c> {
    fn new(cone: &'c Cone) -> Self {
        Self { cone, found: None }
    }

    fn look_at(&mut self, solid: &Shape) {
        let (centre, radius) = solid.bounds();
        let limit = self.limit() + radius;
        if square(from(self.cone.origin, centre)) > limit * limit {
            return;
        }
        match solid {
            Shape::Rectangle(rectangle) if rectangle.contains(self.cone.origin) => {
                self.add_hit(0.0)
            }
            Shape::Rectangle(rectangle) => {
                let corners = rectangle.corners();
                for (index, corner) in corners.iter().enumerate() {
                    self.look_at_edge(*corner, corners[(index + 1) % 4]);
                }
            }
            Shape::Disc(disc) => self.look_at_disc(disc),
            Shape::Band(band) => self.look_at_band(band),
        }
    }

    fn look_at_band(&mut self, band: &Band) {
        if band.contains(self.cone.origin) {
            self.add_hit(0.0);
            return;
        }
        let [start, end] = band.ends;
        for centre in band.ends {
            self.look_at_disc(&Disc {
                centre,
                radius: band.radius,
            });
        }
        let along = from(start, end);
        let length = square(along).sqrt();
        if length > 0.0 {
            let aside = [-along[1], along[0]].map(|part| part / length * band.radius);
            for side in [1.0, -1.0] {
                let shift =
                    |point: [f64; 2]| [point[0] + side * aside[0], point[1] + side * aside[1]];
                self.look_at_edge(shift(start), shift(end));
            }
        }
    }

    fn look_at_disc(&mut self, disc: &Disc) {
        if disc.contains(self.cone.origin) {
            self.add_hit(0.0);
            return;
        }
        let centre = self.seen(disc.centre);
        if self.within(centre) {
            self.add_hit(square(centre).sqrt() - disc.radius);
            return;
        }
        for rim in self.rims() {
            let (ahead, aside) = (dot(rim, centre), cross(rim, centre));
            let rest = disc.radius * disc.radius - aside * aside;
            let cosine_radius = self.cone.grazing * disc.radius;
            if ahead > 0.0 && rest >= cosine_radius * cosine_radius {
                self.add_hit(ahead - rest.sqrt());
            }
        }
    }

    fn look_at_edge(&mut self, start: [f64; 2], end: [f64; 2]) {
        let (start, end) = (self.seen(start), self.seen(end));
        for point in [start, end] {
            if self.within(point) {
                self.add_hit(square(point).sqrt());
            }
        }
        let along = from(start, end);
        let share = -dot(start, along) / square(along);
        if share > 0.0 && share < 1.0 {
            let foot = [start[0] + share * along[0], start[1] + share * along[1]];
            if self.within(foot) {
                self.add_hit(square(foot).sqrt());
            }
        }
        for rim in self.rims() {
            let slant = cross(rim, along);
            let share = -cross(rim, start) / slant;
            // Along the rim itself, the only crossings are at the ends.
            let faces = slant.abs() >= self.cone.grazing * square(along).sqrt();
            if slant != 0.0 && faces && (0.0..=1.0).contains(&share) {
                let distance = dot(rim, start) + share * dot(rim, along);
                if distance >= 0.0 {
                    self.add_hit(distance);
                }
            }
        }
    }

    /// A point of the world as the sensor sees it: ahead, left.
    fn seen(&self, point: [f64; 2]) -> [f64; 2] {
        let to = from(self.cone.origin, point);
        [dot(self.cone.direction, to), cross(self.cone.direction, to)]
    }

    fn within(&self, [ahead, left]: [f64; 2]) -> bool {
        let [cos, sin] = self.cone.half_opening;
        ahead > 0.0 && left.abs() * cos <= ahead * sin
    }

    fn rims(&self) -> [[f64; 2]; 2] {
        let [cos, sin] = self.cone.half_opening;
        [[cos, sin], [cos, -sin]]
    }

    fn limit(&self) -> f64 {
        self.found.unwrap_or(self.cone.range)
    }

    fn add_hit(&mut self, distance: f64) {
        if distance <= self.limit() {
            self.found = Some(distance);
        }
    }
}

fn cross([x0, y0]: [f64; 2], [x1, y1]: [f64; 2]) -> f64 {
    x0 * y1 - y0 * x1
}

#[cfg(test)]
mod tests;
