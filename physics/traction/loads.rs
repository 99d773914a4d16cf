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
mod tests;
