//! The impulses of one step.
//!
//! With every patch inside its friction limit the problem is a small linear one, which is solved
//! directly; where one slides, iteration takes over from the impulses of the last step.

mod direct;
mod iterate;

use super::{Chassis, Contact, DAMPING_TIME, PatchState, Traction, TyreLaw, Wheel};
use iterate::Mobility;

/// A patch in this step, both axes.
#[derive(Clone, Copy)]
struct Row {
    /// Soft constraint per axis: impulse = −(bias + give · slip).
    give: [f64; 2],
    bias: [f64; 2],
    /// Largest impulse, N·s.
    limit: f64,
    /// See [`PatchState::stuck`].
    stuck: f64,
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
        let tread = rolling.map(|speed| (speed * law.radius).abs());
        let mut rows = [Row::IDLE; PATCHES];
        let grounds = loads.iter().zip(&friction);
        for ((patch, row), (load, friction)) in self.patches.iter_mut().zip(&mut rows).zip(grounds)
        {
            let wheel = patch.place.wheel;
            *row = patch.prepare(&law, tread[wheel], *load, *friction, dt);
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
    /// The share of a deflection that is still there after so much rolling, m.
    fn shed(&self, rolled: f64) -> f64 {
        self.relaxation_length / (self.relaxation_length + rolled)
    }

    /// The carcass damping time at this rolling speed, s.
    fn damping(&self, speed: f64) -> f64 {
        DAMPING_TIME * (1.0 - speed * self.inverse_fade_speed).max(0.0)
    }
}

impl<C> PatchState<C> {
    fn prepare(&mut self, law: &TyreLaw, tread: f64, load: f64, friction: f64, dt: f64) -> Row {
        self.load = load;
        self.limit = friction * load;
        self.shed = [law.shed(dt * tread); 2];
        let mut damping = [law.damping(tread); 2];
        self.stuck = 1.0;
        if self.spin > 0.0 {
            let turned = dt * self.spin;
            let stiffness = law.stiffness_per_load[1];
            let fresh = law.relaxation_length * stiffness / self.drag.max(LEAST_DRAG);
            self.shed = [turned, turned * fresh].map(|turned| law.shed(dt * tread + turned));
            self.stuck = law.shed(dt * tread) / self.shed[1];
            // Rubber damps its own motion, and not that of a roller which gives way.
            let gives_way = self.deflection[1].abs() * stiffness / self.drag.max(LEAST_DRAG);
            damping[1] = law.damping(tread + self.spin) * (1.0 - gives_way).max(0.0);
        }
        let mut row = Row {
            limit: self.limit * dt,
            stuck: self.stuck,
            ..Row::IDLE
        };
        for (axis, damping) in damping.into_iter().enumerate() {
            let stiffness = law.stiffness_per_load[axis] * load;
            let shed = self.shed[axis];
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
        stuck: 1.0,
    };

    /// The impulse that goes with a slip, friction aside.
    fn elastic(&self, slip: [f64; 2]) -> [f64; 2] {
        [
            -(self.bias[0] + self.give[0] * slip[0]),
            -(self.bias[1] + self.give[1] * slip[1]),
        ]
    }

    /// Returns whether an impulse is less than the ground can take.
    fn grips(&self, impulse: [f64; 2]) -> bool {
        square(impulse) < self.limit * self.limit * GRIP_MARGIN
    }

    fn within_limit(&self, impulse: [f64; 2]) -> [f64; 2] {
        let kept = kept(impulse, self.limit, self.stuck);
        [impulse[0] * kept[0], impulse[1] * kept[1]]
    }
}

/// Shares of a force along and across that friction gives. A contact that turned by itself, and
/// would be pushed across by `stuck` times as much if it did not, goes on turning if friction can
/// push it; what is left of friction acts along. Else it slides.
pub(super) fn kept(force: [f64; 2], limit: f64, stuck: f64) -> [f64; 2] {
    if square(force) <= limit * limit {
        return [1.0; 2];
    }
    let kept = limit / square([force[0], force[1] * stuck]).sqrt();
    if kept * stuck <= 1.0 {
        return [kept, kept * stuck];
    }
    let along = (limit * limit - force[1] * force[1]).max(0.0).sqrt();
    [along / force[0].abs(), 1.0]
}

/// Least drag of a contact that turns by itself, as a share of the load; less makes no difference.
const LEAST_DRAG: f64 = 1e-6;

/// An impulse scaled to the limit is a rounding error beside it; this keeps it from counting as
/// grip.
const GRIP_MARGIN: f64 = 1.0 - 1e-12;

fn square([along, across]: [f64; 2]) -> f64 {
    along * along + across * across
}
