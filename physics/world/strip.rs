//! The course of a magnetic strip, cut into straight pieces.

use super::area::{Band, dot, from, square};
use super::map::Strip;

/// Largest turn between two pieces of a rounded corner, rad. At a radius of one metre the pieces
/// are then within a millimetre of the arc.
const MOST_TURN: f64 = 0.08;

impl Strip {
    /// Its middle line as bands without width.
    pub(super) fn bands(&self) -> Vec<Band> {
        let line = self.line();
        let piece = |start: &[f64; 2], end: &[f64; 2]| Band {
            ends: [*start, *end],
            radius: 0.0,
        };
        let mut bands: Vec<Band> = line
            .windows(2)
            .map(|pair| piece(&pair[0], &pair[1]))
            .collect();
        if let ([first, .., last], true) = (line.as_slice(), self.closed) {
            bands.push(piece(last, first));
        }
        bands
    }

    /// The points with every corner rounded.
    fn line(&self) -> Vec<[f64; 2]> {
        let count = self.points.len();
        let mut line = Vec::new();
        for (index, point) in self.points.iter().enumerate() {
            let is_end = !self.closed && (index == 0 || index + 1 == count);
            if is_end || count < 3 || self.corner_radius <= 0.0 {
                line.push(*point);
            } else {
                let before = self.points[(index + count - 1) % count];
                let after = self.points[(index + 1) % count];
                round(&mut line, before, *point, after, self.corner_radius);
            }
        }
        line
    }
}

/// Goes around a corner on an arc that touches both sides, at most up to their middles, so that
/// neighbouring arcs do not overlap.
fn round(
    line: &mut Vec<[f64; 2]>,
    before: [f64; 2],
    corner: [f64; 2],
    after: [f64; 2],
    radius: f64,
) {
    let (back, ahead) = (from(corner, before), from(corner, after));
    let lengths = [square(back).sqrt(), square(ahead).sqrt()];
    if lengths[0] <= 0.0 || lengths[1] <= 0.0 {
        line.push(corner);
        return;
    }
    let back = back.map(|part| part / lengths[0]);
    let ahead = ahead.map(|part| part / lengths[1]);
    // Half the angle between the two sides.
    let half = libm::acos(dot(back, ahead).clamp(-1.0, 1.0)) / 2.0;
    let turn = std::f64::consts::PI - 2.0 * half;
    let tangent = libm::tan(half);
    if turn < 1e-6 || tangent < 1e-6 {
        // Straight on, or straight back.
        line.push(corner);
        return;
    }
    let reach = (radius / tangent)
        .min(lengths[0] / 2.0)
        .min(lengths[1] / 2.0);
    let radius = reach * tangent;
    let inward = [back[0] + ahead[0], back[1] + ahead[1]];
    let length = square(inward).sqrt();
    let distance = radius / libm::sin(half);
    let centre = [
        corner[0] + inward[0] / length * distance,
        corner[1] + inward[1] / length * distance,
    ];
    let start = [corner[0] + back[0] * reach, corner[1] + back[1] * reach];
    let spoke = from(centre, start);
    let left = ahead[0] * back[1] - ahead[1] * back[0];
    let turn = turn.copysign(left);
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "between 1 and 40"
    )]
    let pieces = (turn.abs() / MOST_TURN).ceil() as u32;
    for piece in 0..=pieces {
        let angle = turn * f64::from(piece) / f64::from(pieces);
        let (sin, cos) = (libm::sin(angle), libm::cos(angle));
        line.push([
            centre[0] + cos * spoke[0] - sin * spoke[1],
            centre[1] + sin * spoke[0] + cos * spoke[1],
        ]);
    }
}

#[cfg(test)]
mod tests;
