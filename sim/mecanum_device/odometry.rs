//! The board's own dead reckoning: where the wheels' pulses say that the car is.
//!
//! It knows nothing but pulses, so where wheels slip it drifts from the truth.

use rigsim_physics::mecanum::WHEELS;

use super::kinematics::{Movement, body_speed};
use super::settings::{Mileage, OdometrySettings};

/// Position, heading and mileage by pulses.
#[derive(Debug, Clone)]
pub struct Odometry {
    settings: OdometrySettings,
    /// Position in revolutions of a wheel along both axes of the frame.
    pub position: [f64; 2],
    /// Heading in radians when `turn_pulses` was 0.
    heading_from: f64,
    /// Pulses of right wheels less pulses of left ones; kept whole, so that the heading of a car
    /// that turns there and back is exactly what it was.
    turn_pulses: i64,
    /// Mileage in revolutions of a wheel.
    pub mileage: f64,
    /// The same with negative motions counted down.
    pub net_mileage: f64,
    /// Mileage when the last motion began.
    motion_from: f64,
}

impl Odometry {
    /// At the origin, heading along x.
    #[must_use]
    pub fn new(settings: OdometrySettings) -> Self {
        Self {
            settings,
            position: [0.0; 2],
            heading_from: 0.0,
            turn_pulses: 0,
            mileage: 0.0,
            net_mileage: 0.0,
            motion_from: 0.0,
        }
    }

    /// Sets the frame: this is where the car is now.
    pub fn set_pose(&mut self, position: [f64; 2], heading: f64) {
        self.position = position;
        self.heading_from = heading;
        self.turn_pulses = 0;
        if self.settings.set_pose_clears_mileage {
            (self.mileage, self.net_mileage, self.motion_from) = (0.0, 0.0, 0.0);
        }
    }

    /// A motion begins.
    pub fn begin_motion(&mut self) {
        self.motion_from = self.mileage;
    }

    /// Adds pulses of the four wheels, backward ones negative. `movement` is that which the mileage
    /// is about: of the wheels that it turns.
    pub fn add(&mut self, pulses: [i64; WHEELS], movement: Option<Movement>) {
        let counted = movement.map_or([0; WHEELS], Movement::rotations);
        let turned = pulses.map(|pulses| self.revolutions(pulses));
        let [ahead, left, _] = body_speed(turned, 1.0);
        let before = self.heading();
        let [lf, rf, lr, rr] = pulses;
        self.turn_pulses = [-lf, rf, -lr, rr]
            .into_iter()
            .fold(self.turn_pulses, i64::saturating_add);
        // The heading in the middle of the step is right for an arc of constant curvature.
        let [cos, sin] = cos_sin((before + self.heading()) / 2.0);
        self.position[0] += cos * ahead - sin * left;
        self.position[1] += sin * ahead + cos * left;
        let travel = match self.settings.mileage {
            Mileage::Path => (ahead * ahead + left * left).sqrt(),
            Mileage::Wheels => mean_travel(turned, counted),
        };
        self.mileage += travel;
        self.net_mileage += travel * f64::from(movement.map_or(1, Movement::sign));
    }

    /// Heading in radians, counter-clockwise; full turns add up.
    #[must_use]
    pub fn heading(&self) -> f64 {
        let travel = self.revolutions(self.turn_pulses) * self.circumference_m();
        self.heading_from + travel / (4.0 * self.arm_m())
    }

    /// Mileage of the last motion in revolutions of a wheel.
    #[must_use]
    pub fn motion_mileage(&self) -> f64 {
        self.mileage - self.motion_from
    }

    /// Mileage in metres.
    #[must_use]
    pub fn mileage_m(&self) -> f64 {
        self.mileage * self.circumference_m()
    }

    /// A velocity in the body's axes, ahead and left, in those of the frame.
    #[must_use]
    pub fn to_frame(&self, [ahead, left]: [f64; 2]) -> [f64; 2] {
        let [cos, sin] = cos_sin(self.heading());
        [cos * ahead - sin * left, sin * ahead + cos * left]
    }

    #[expect(clippy::cast_precision_loss, reason = "2^53 pulses are not driven")]
    fn revolutions(&self, pulses: i64) -> f64 {
        pulses as f64 / f64::from(self.settings.pulses_per_revolution)
    }

    fn circumference_m(&self) -> f64 {
        std::f64::consts::TAU * self.settings.wheel_radius
    }

    fn arm_m(&self) -> f64 {
        self.settings.half_wheelbase + self.settings.half_track
    }
}

/// From `libm`, because the platform's own may differ in the last bit.
fn cos_sin(angle: f64) -> [f64; 2] {
    [libm::cos(angle), libm::sin(angle)]
}

/// Mean of what the counted wheels have turned, whichever way.
fn mean_travel(turned: [f64; WHEELS], counted: [i8; WHEELS]) -> f64 {
    let travel = turned
        .into_iter()
        .zip(counted)
        .filter(|(_, counted)| *counted != 0);
    let (sum, wheels) = travel.fold((0.0, 0.0), |(sum, wheels), (turned, _)| {
        (sum + turned.abs(), wheels + 1.0)
    });
    if wheels > 0.0 { sum / wheels } else { 0.0 }
}

#[cfg(test)]
mod tests;
