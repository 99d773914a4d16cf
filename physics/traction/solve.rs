//! The impulses of one step.
//!
//! With every patch inside its friction limit the problem is a small linear one, which is solved
//! directly; where one slides, iteration takes over from the impulses of the last step.

mod direct;
mod iterate;

use super::{Chassis, Contact, PatchState, Traction, TyreLaw, Wheel};
use iterate::Mobility;

/// A patch in this step, both axes.
#[derive(Clone, Copy)]
struct Row {
    /// Soft constraint per axis: impulse = −(bias + give · slip).
    give: [f64; 2],
    bias: [f64; 2],
    /// Largest impulse, N·s.
    limit: f64,
}

impl<const WHEELS: usize, const PATCHES: usize, C: Contact> Traction<WHEELS, PATCHES, C> {
    /// Finds the impulses of all patches over a step of `dt` seconds and applies them.
    ///
    /// `rolling` holds the wheel speeds at the start of the step (rad/s), `loads` the force with
    /// which each patch is pressed down (N), `friction` the coefficient under each.
    pub fn solve(
        &mut self,
        chassis: &mut Chassis,
        wheels: &mut [Wheel; WHEELS],
        rolling: [f64; WHEELS],
        loads: [f64; PATCHES],
        friction: [f64; PATCHES],
        dt: f64,
    ) {
        self.begin(dt);
        let law = self.law;
        let mut tread = rolling.map(|speed| (speed * law.radius).abs());
        if C::DRIVEN > 1 {
            for patch in &self.patches {
                tread[patch.place.wheel] += patch.spin;
            }
        }
        let shed = tread.map(|speed| law.shed(speed, dt));
        let damping = tread.map(|speed| law.damping(speed));
        let mut rows = [Row::IDLE; PATCHES];
        let grounds = loads.iter().zip(&friction);
        for ((patch, row), (load, friction)) in self.patches.iter_mut().zip(&mut rows).zip(grounds)
        {
            let wheel = patch.place.wheel;
            *row = patch.prepare(&law, shed[wheel], damping[wheel], *load, *friction, dt);
        }
        let hold_limits = wheels.map(|wheel| wheel.hold_torque * dt);

        if !self.slides && self.solve_directly(chassis, wheels, &rows, &hold_limits) {
            return;
        }
        let weight: f64 = loads.iter().sum();
        let mobility = Mobility::new(chassis, law.radius);
        self.iterate(chassis, wheels, &rows, &hold_limits, &mobility, weight * dt);
        self.hold_limit = hold_limits;
        self.slides = self
            .patches
            .iter()
            .zip(&rows)
            .any(|(patch, row)| !row.grips(patch.impulse));
    }
}

impl<const WHEELS: usize, const PATCHES: usize, C> Traction<WHEELS, PATCHES, C> {
    /// Takes the impulses of the last step, from which the solution starts, for one of `dt` seconds.
    fn begin(&mut self, dt: f64) {
        let last = std::mem::replace(&mut self.dt, dt);
        if last == dt || last == 0.0 {
            return;
        }
        let longer = dt / last;
        for patch in &mut self.patches {
            patch.impulse = patch.impulse.map(|impulse| impulse * longer);
        }
        for impulse in self.hold.iter_mut().chain(&mut self.hold_limit) {
            *impulse *= longer;
        }
    }
}

impl TyreLaw {
    /// The share of a deflection that is still there after the step's rolling.
    fn shed(&self, speed: f64, dt: f64) -> f64 {
        let rolled = dt * speed;
        self.relaxation_length / (self.relaxation_length + rolled)
    }

    /// The carcass damping time at this rolling speed, s.
    fn damping(&self, speed: f64) -> f64 {
        self.damping_time * (1.0 - speed * self.inverse_fade_speed).max(0.0)
    }
}

impl<C> PatchState<C> {
    fn prepare(
        &mut self,
        law: &TyreLaw,
        shed: f64,
        damping: f64,
        load: f64,
        friction: f64,
        dt: f64,
    ) -> Row {
        self.shed = shed;
        self.load = load;
        self.limit = friction * load;
        let mut row = Row {
            limit: self.limit * dt,
            ..Row::IDLE
        };
        for axis in 0..2 {
            let factor = if axis == 0 { 1.0 } else { self.across };
            let stiffness = law.stiffness_per_load[axis] * factor * load;
            self.stiffness[axis] = stiffness;
            row.give[axis] = stiffness * dt * (shed * dt + damping);
            row.bias[axis] = stiffness * dt * shed * self.deflection[axis];
        }
        row
    }
}

impl Row {
    const IDLE: Self = Self {
        give: [0.0; 2],
        bias: [0.0; 2],
        limit: 0.0,
    };

    /// The impulse that goes with a slip, friction aside.
    fn elastic(&self, slip: [f64; 2]) -> [f64; 2] {
        [
            -(self.bias[0] + self.give[0] * slip[0]),
            -(self.bias[1] + self.give[1] * slip[1]),
        ]
    }

    /// Tells whether an impulse is less than the ground can take.
    fn grips(&self, impulse: [f64; 2]) -> bool {
        square(impulse) < self.limit * self.limit * GRIP_MARGIN
    }

    fn within_limit(&self, impulse: [f64; 2]) -> [f64; 2] {
        let square = square(impulse);
        if square <= self.limit * self.limit {
            impulse
        } else {
            let kept = self.limit / square.sqrt();
            [impulse[0] * kept, impulse[1] * kept]
        }
    }
}

/// An impulse scaled to the limit is a rounding error beside it; this keeps it from counting as
/// grip.
const GRIP_MARGIN: f64 = 1.0 - 1e-12;

fn square([along, across]: [f64; 2]) -> f64 {
    along * along + across * across
}
