//! Projected Gauss–Seidel iteration over the impulses, for when a patch slides.

use super::super::{Chassis, PatchState, Traction, Wheel};
use super::Row;

/// Rounds of the iteration at most. The default vehicle needs one to seven; the bound makes the cost
/// of a step bounded for any settings.
const MAX_ROUNDS: usize = 24;

/// The iteration ends when no impulse changes by more than this share of the weight's impulse. What
/// is left changes a velocity by about 1e-7 m/s, which is the rounding of rapier's `f32`; it does not
/// add up, since the next step starts from it and goes on.
const TOLERANCE: f64 = 2e-6;

/// What impulses do to the body.
#[derive(Clone, Copy)]
pub(super) struct Mobility {
    /// 1/kg
    push: f64,
    /// 1/(kg·m²)
    turn: f64,
    /// Of the wheels, m.
    radius: f64,
}

impl<const WHEELS: usize, const PATCHES: usize> Traction<WHEELS, PATCHES> {
    pub(super) fn iterate(
        &mut self,
        chassis: &mut Chassis,
        wheels: &mut [Wheel; WHEELS],
        rows: &[Row; PATCHES],
        hold_limits: &[f64; WHEELS],
        mobility: &Mobility,
        weight_impulse: f64,
    ) {
        let mut shares = [[0.0; 2]; PATCHES];
        for ((patch, row), share) in self.patches.iter_mut().zip(rows).zip(&mut shares) {
            let wheel = &mut wheels[patch.place.wheel];
            let compliance = mobility.compliance(patch, wheel);
            for axis in 0..2 {
                share[axis] = 1.0 / (1.0 + row.give[axis] * compliance[axis]);
            }
            patch.impulse = row.within_limit(patch.impulse);
            mobility.apply(patch, patch.impulse, &mut chassis.velocity, wheel);
        }
        for ((held, limit), wheel) in self.hold.iter_mut().zip(hold_limits).zip(&mut *wheels) {
            *held = held.clamp(-limit, *limit);
            wheel.speed += *held * wheel.compliance;
        }

        for _ in 0..MAX_ROUNDS {
            let mut change: f64 = 0.0;
            for ((patch, row), share) in self.patches.iter_mut().zip(rows).zip(&shares) {
                let wheel = &mut wheels[patch.place.wheel];
                let slip = patch.slip(chassis.velocity, wheel.speed * mobility.radius);
                let elastic = row.elastic(slip);
                let now = patch.impulse;
                // The elastic impulse goes with the slip that `now` leads to; only this share of the
                // difference is left once the patch gives way to it.
                patch.impulse = row.within_limit([
                    now[0] + (elastic[0] - now[0]) * share[0],
                    now[1] + (elastic[1] - now[1]) * share[1],
                ]);
                let delta = [patch.impulse[0] - now[0], patch.impulse[1] - now[1]];
                change = change.max(delta[0].abs()).max(delta[1].abs());
                mobility.apply(patch, delta, &mut chassis.velocity, wheel);
            }
            for ((held, limit), wheel) in self.hold.iter_mut().zip(hold_limits).zip(&mut *wheels) {
                change = change.max(hold(held, *limit, wheel));
            }
            if change <= TOLERANCE * weight_impulse {
                break;
            }
        }
    }
}

impl Mobility {
    pub(super) fn new(chassis: &Chassis, radius: f64) -> Self {
        Self {
            push: 1.0 / chassis.mass,
            turn: 1.0 / chassis.inertia,
            radius,
        }
    }

    /// What one N·s along and across changes of the slip, 1/kg.
    fn compliance(&self, patch: &PatchState, wheel: &Wheel) -> [f64; 2] {
        let (x, y) = (patch.place.x, patch.place.y);
        [
            self.push + y * y * self.turn + self.radius * self.radius * wheel.compliance,
            self.push + x * x * self.turn,
        ]
    }

    fn apply(
        &self,
        patch: &PatchState,
        [along, across]: [f64; 2],
        velocity: &mut [f64; 3],
        wheel: &mut Wheel,
    ) {
        velocity[0] += along * self.push;
        velocity[1] += across * self.push;
        velocity[2] += (patch.place.x * across - patch.place.y * along) * self.turn;
        wheel.speed -= self.radius * along * wheel.compliance;
    }
}

/// Dry friction and brakes: as much torque as it takes to stop the wheel, up to what they can hold.
/// Returns by how much the impulse changed, N·m·s.
fn hold(held: &mut f64, limit: f64, wheel: &mut Wheel) -> f64 {
    let wanted = (*held - wheel.speed * wheel.inertia).clamp(-limit, limit);
    let delta = wanted - *held;
    *held = wanted;
    wheel.speed += delta * wheel.compliance;
    delta.abs()
}
