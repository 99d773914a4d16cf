//! Weight of a vehicle on four wheels.

/// Places of four wheels under the centre of mass.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stance {
    /// Half the distance between front and rear axle, m.
    pub half_wheelbase: f64,
    /// Half the distance between left and right wheels, m.
    pub half_track: f64,
    /// Height of the centre of mass above the ground, m.
    pub centre_height: f64,
    /// Place of the centre of mass, ahead and left of the middle, m.
    pub centre: [f64; 2],
    /// Force that the tyres hold against by the loads as they are, ahead and left, N; `None` before
    /// the first step.
    pub carried: Option<[f64; 2]>,
}

/// Time in which a vehicle leans on its tyres, s.
const LEANING: f64 = 0.05;

impl Stance {
    /// Places of the wheels, front left, front right, rear left, rear right: metres ahead and left
    /// of the body's middle.
    #[must_use]
    pub fn places(&self) -> [[f64; 2]; 4] {
        let (x, y) = (self.half_wheelbase, self.half_track);
        [[x, y], [x, -y], [-x, y], [-x, -y]]
    }

    /// Load of each wheel over a step of `dt` seconds, front left, front right, rear left, rear
    /// right, N, and whether one would lift: its share of the weight, shifted by what the tyres do
    /// at the ground below the centre of mass. So loads shift backward in acceleration and to the
    /// lower side of a slope; the tyres take a moment to follow.
    ///
    /// `pull` is the downhill pull ahead and to the left, which the tyres of a vehicle that stands
    /// hold; `on_tyres` is the force of the tyres on the body in the last step.
    pub fn carry(
        &mut self,
        pull: [f64; 2],
        on_tyres: [f64; 2],
        weight: f64,
        dt: f64,
    ) -> ([f64; 4], bool) {
        let carried = self.carried.unwrap_or(pull);
        let share = dt / (LEANING + dt);
        let carried =
            std::array::from_fn(|axis| carried[axis] + (-on_tyres[axis] - carried[axis]) * share);
        self.carried = Some(carried);
        self.loads(carried, weight)
    }

    /// The loads, front left, front right, rear left, rear right, N, and whether a wheel would
    /// lift, when the tyres hold against a pull ahead and to the left.
    #[must_use]
    pub fn loads(&self, pull: [f64; 2], weight: f64) -> ([f64; 4], bool) {
        let moments: [f64; 2] = std::array::from_fn(|axis| {
            pull[axis] * self.centre_height + weight * self.centre[axis]
        });
        let ahead = moments[0] / (4.0 * self.half_wheelbase);
        let left = moments[1] / (4.0 * self.half_track);
        let quarter = weight / 4.0;
        let raw = [
            quarter + ahead + left,
            quarter + ahead - left,
            quarter - ahead + left,
            quarter - ahead - left,
        ];
        // An axle or a side that lifts is more than a wheel that is lightened on a diagonal.
        let lifts = ahead.abs() > quarter || left.abs() > quarter;
        let loads = raw.map(|load| load.max(0.0));
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

    const STANCE: Stance = Stance {
        half_wheelbase: 0.325,
        half_track: 0.3,
        centre_height: 0.5375,
        centre: [0.0; 2],
        carried: None,
    };

    /// The loaded R150 tips where its centre of mass stands above its rear axle: at 31.2°.
    #[test]
    fn a_vehicle_tips_where_its_centre_of_mass_is_above_its_axle() {
        for (degrees, tips) in [(0.0_f64, false), (31.0, false), (31.3, true)] {
            let (sin, cos) = degrees.to_radians().sin_cos();
            let (loads, lifts) = STANCE.loads([-2747.0 * sin, 0.0], 2747.0 * cos);
            assert_eq!(lifts, tips, "{degrees}");
            assert!((loads.iter().sum::<f64>() - 2747.0 * cos).abs() < 1e-6);
            assert!(loads[0] <= loads[2]);
        }
    }

    #[test]
    fn a_payload_to_the_left_presses_the_left_wheels() {
        let stance = Stance {
            centre: [0.0, 0.03],
            ..STANCE
        };
        let ([front_left, front_right, ..], _) = stance.loads([0.0; 2], 1000.0);
        assert!((front_left - 275.0).abs() < 1e-9 && (front_right - 225.0).abs() < 1e-9);
    }

    #[test]
    fn loads_follow_the_tyres_after_a_moment() {
        let mut stance = STANCE;
        let push = [500.0, 0.0];
        let (first, _) = stance.carry([0.0; 2], push, 1000.0, 0.005);
        let mut last = first;
        for _ in 0..100 {
            (last, _) = stance.carry([0.0; 2], push, 1000.0, 0.005);
        }
        // Accelerating it leans on its rear wheels: 500 N on 0.5375 m over a wheelbase of 0.65 m.
        assert!(first[2] > 250.0 && first[2] < last[2]);
        assert!(
            (last[2] - (250.0 + 500.0 * 0.5375 / 1.3)).abs() < 0.1,
            "{last:?}"
        );
    }
}
