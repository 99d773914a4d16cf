//! Projected Gauss–Seidel iteration over the impulses, for when a patch slides.

use super::super::{Chassis, Contact, PatchState, Traction, Wheel};
use super::Row;
use crate::twist::Twist;

/// Rounds of the iteration at most. The default vehicle needs one to seven; the bound makes the
/// cost of a step bounded for any settings.
const MAX_ROUNDS: usize = 24;

/// The iteration ends when no impulse changes by more than this share of the weight's impulse. What
/// is left changes a velocity by about 1e-7 m/s, far less than any tyre slips; it does not
/// add up, since the next step starts from it and goes on.
const TOLERANCE: f64 = 2e-6;

/// Effect of impulses on the body.
#[derive(Clone, Copy)]
pub(super) struct Mobility {
    /// 1/kg
    push: f64,
    /// 1/(kg·m²)
    turn: f64,
    /// Of the wheels, m.
    radius: f64,
}

/// The share of a difference between impulses that is left once the patch gives way to it: of the
/// same axis, and of the other. The axes of a tyre hardly know of one another and are taken one by
/// one; those of a roller both turn the wheel.
#[derive(Clone, Copy, Default)]
struct Share {
    own: [f64; 2],
    other: [f64; 2],
}

impl<const WHEELS: usize, const PATCHES: usize, C: Contact> Traction<WHEELS, PATCHES, C> {
    pub(super) fn iterate(
        &mut self,
        chassis: &mut Chassis,
        wheels: &mut [Wheel; WHEELS],
        rows: &[Row; PATCHES],
        hold_limits: &[f64; WHEELS],
        mobility: &Mobility,
        weight_impulse: f64,
    ) {
        let mut shares = [Share::default(); PATCHES];
        for ((patch, row), share) in self.patches.iter_mut().zip(rows).zip(&mut shares) {
            let wheel = &mut wheels[patch.place.wheel];
            *share = Share::new(patch, row, mobility, wheel);
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
                // What slides is held by what its own deflection says and no more, so that the way in
                // which it is held does not depend on the length of a step.
                let elastic = row.within_limit(row.elastic(slip));
                let now = patch.impulse;
                // The elastic impulse goes with the slip that `now` leads to; only this share of the
                // difference is left once the patch gives way to it.
                let step = share.of::<C>([elastic[0] - now[0], elastic[1] - now[1]]);
                patch.impulse = row.within_limit([now[0] + step[0], now[1] + step[1]]);
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

    fn apply<C: Contact>(
        &self,
        patch: &PatchState<C>,
        impulse: [f64; 2],
        velocity: &mut Twist,
        wheel: &mut Wheel,
    ) {
        let [ahead, left] = patch.contact.join(impulse);
        velocity.ahead += ahead * self.push;
        velocity.left += left * self.push;
        velocity.turn += (patch.place.x * left - patch.place.y * ahead) * self.turn;
        wheel.speed -= self.radius * ahead * wheel.compliance;
    }
}

impl Share {
    fn new<C: Contact>(
        patch: &PatchState<C>,
        row: &Row,
        mobility: &Mobility,
        wheel: &Wheel,
    ) -> Self {
        let levers = patch.contact.levers(&patch.place);
        // What one N·s along and across changes of the slip, 1/kg.
        let compliance = |axis: usize| {
            let forward = patch.contact.forward(axis);
            mobility.push
                + levers[axis] * levers[axis] * mobility.turn
                + mobility.radius * mobility.radius * (forward * forward) * wheel.compliance
        };
        let own = [0, 1].map(|axis| 1.0 + row.give[axis] * compliance(axis));
        if C::DRIVEN < 2 {
            return Self {
                own: own.map(|part| 1.0 / part),
                other: [0.0; 2],
            };
        }
        let shared = levers[0] * levers[1] * mobility.turn
            + mobility.radius
                * mobility.radius
                * (patch.contact.forward(0) * patch.contact.forward(1))
                * wheel.compliance;
        let other = row.give.map(|give| give * shared);
        let determinant = own[0] * own[1] - other[0] * other[1];
        Self {
            own: [own[1] / determinant, own[0] / determinant],
            other: other.map(|part| -part / determinant),
        }
    }

    fn of<C: Contact>(&self, difference: [f64; 2]) -> [f64; 2] {
        let own = [difference[0] * self.own[0], difference[1] * self.own[1]];
        if C::DRIVEN < 2 {
            return own;
        }
        [
            own[0] + difference[1] * self.other[0],
            own[1] + difference[0] * self.other[1],
        ]
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
