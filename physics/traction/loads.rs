//! How the weight of a vehicle rests on four wheels.

/// Where four wheels stand under the centre of mass.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stance {
    /// Half the distance between front and rear axle, m.
    pub half_wheelbase: f64,
    /// Half the distance between left and right wheels, m.
    pub half_track: f64,
    /// Height of the centre of mass above the ground, m.
    pub centre_height: f64,
}

impl Stance {
    /// Where the wheels stand, front left, front right, rear left, rear right: metres ahead and left
    /// of the body's middle.
    #[must_use]
    pub fn places(&self) -> [[f64; 2]; 4] {
        let (x, y) = (self.half_wheelbase, self.half_track);
        [[x, y], [x, -y], [-x, y], [-x, -y]]
    }

    /// How each wheel is pressed down, front left, front right, rear left, rear right, N, and whether
    /// an axle or a side would lift: its share of the weight, shifted towards the lower side of a slope by the height of the centre of mass.
    ///
    /// `pull` is the downhill pull ahead and to the left. Acceleration shifts nothing; at the speeds
    /// of these vehicles that is under a tenth of the load.
    #[must_use]
    pub fn loads(&self, pull: [f64; 2], weight: f64) -> ([f64; 4], bool) {
        let ahead = pull[0] * self.centre_height / (4.0 * self.half_wheelbase);
        let left = pull[1] * self.centre_height / (4.0 * self.half_track);
        let quarter = weight / 4.0;
        let lifts = ahead.abs() > quarter || left.abs() > quarter;
        let loads = [
            quarter + ahead + left,
            quarter + ahead - left,
            quarter - ahead + left,
            quarter - ahead - left,
        ]
        .map(|load| load.max(0.0));
        let sum: f64 = loads.iter().sum();
        // A wheel that lifts leaves its share to the others; together they carry the weight.
        if sum > weight {
            (loads.map(|load| load * weight / sum), lifts)
        } else {
            (loads, lifts)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The centre of mass of an R150 with 150 kg stands above its axle at 31.2°.
    #[test]
    fn a_vehicle_tips_where_its_centre_of_mass_is_above_its_axle() {
        let stance = Stance {
            half_wheelbase: 0.325,
            half_track: 0.3,
            centre_height: 0.5375,
        };
        for (degrees, tips) in [(0.0_f64, false), (31.0, false), (31.3, true)] {
            let (sin, cos) = degrees.to_radians().sin_cos();
            let (loads, lifts) = stance.loads([-2747.0 * sin, 0.0], 2747.0 * cos);
            assert_eq!(lifts, tips, "{degrees}");
            assert!((loads.iter().sum::<f64>() - 2747.0 * cos).abs() < 1e-6);
            assert!(loads[0] <= loads[2]);
        }
    }
}
