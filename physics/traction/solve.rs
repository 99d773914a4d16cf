//! The impulses of one step.

use super::{Chassis, PatchState, Traction, TyreLaw, Wheel};

/// Rounds of the iteration at most. The default vehicle needs three to six; the bound makes the
/// cost of a step bounded for any settings.
const MAX_ROUNDS: usize = 24;

/// The iteration ends when no impulse changes by more than this share of the load's impulse.
const TOLERANCE: f64 = 1e-7;

/// A patch in this step, both axes.
#[derive(Clone, Copy)]
struct Row {
    /// Soft constraint per axis: impulse = −(bias + give · slip).
    give: [f64; 2],
    bias: [f64; 2],
    /// 1 / (1 + give · what one N·s changes of the slip).
    share: [f64; 2],
    /// Largest impulse, N·s.
    limit: f64,
}

impl<const WHEELS: usize, const PATCHES: usize> Traction<WHEELS, PATCHES> {
    /// Finds the impulses of all patches over a step of `dt` seconds and applies them.
    ///
    /// `rolling` holds the wheel speeds at the start of the step (rad/s), `loads` the force with
    /// which each patch is pressed down (N).
    pub fn solve(
        &mut self,
        chassis: &mut Chassis,
        wheels: &mut [Wheel; WHEELS],
        rolling: [f64; WHEELS],
        loads: [f64; PATCHES],
        friction: f64,
        dt: f64,
    ) {
        let law = self.law;
        let inverse_mass = 1.0 / chassis.mass;
        let inverse_inertia = 1.0 / chassis.inertia;
        let mut smallest_change = f64::INFINITY;

        let mut rows = [Row::IDLE; PATCHES];
        for (index, patch) in self.patches.iter_mut().enumerate() {
            let wheel = patch.place.wheel;
            let compliance = [
                inverse_mass
                    + patch.place.y * patch.place.y * inverse_inertia
                    + law.radius * law.radius * wheels[wheel].compliance,
                inverse_mass + patch.place.x * patch.place.x * inverse_inertia,
            ];
            let load = loads[index];
            let speed = (rolling[wheel] * law.radius).abs();
            rows[index] = patch.prepare(&law, compliance, load, speed, friction, dt);
            smallest_change = smallest_change.min(load * dt);
        }
        // A patch without load must not ask for infinite precision of the others.
        let tolerance = TOLERANCE * smallest_change.max(chassis.mass * dt * 0.1);

        self.start_from_last_step(chassis, wheels, &rows, dt);
        for _ in 0..MAX_ROUNDS {
            let mut change: f64 = 0.0;
            for (patch, row) in self.patches.iter_mut().zip(&rows) {
                let wheel = &mut wheels[patch.place.wheel];
                let slip = patch.slip(chassis.velocity, wheel.speed * law.radius);
                let wanted = row.impulse(patch.impulse, slip);
                let delta = [wanted[0] - patch.impulse[0], wanted[1] - patch.impulse[1]];
                patch.impulse = wanted;
                change = change.max(delta[0].abs()).max(delta[1].abs());
                apply(patch, delta, chassis, wheel, law.radius);
            }
            for (held, wheel) in self.hold.iter_mut().zip(wheels.iter_mut()) {
                change = change.max(hold(held, wheel, dt) / law.radius);
            }
            if change <= tolerance {
                break;
            }
        }
    }

    fn start_from_last_step(
        &mut self,
        chassis: &mut Chassis,
        wheels: &mut [Wheel; WHEELS],
        rows: &[Row; PATCHES],
        dt: f64,
    ) {
        for (patch, row) in self.patches.iter_mut().zip(rows) {
            patch.impulse = row.within_limit(patch.impulse);
            let wheel = &mut wheels[patch.place.wheel];
            apply(patch, patch.impulse, chassis, wheel, self.law.radius);
        }
        for (held, wheel) in self.hold.iter_mut().zip(wheels.iter_mut()) {
            let limit = wheel.hold_torque * dt;
            *held = held.clamp(-limit, limit);
            wheel.speed += *held * wheel.compliance;
        }
    }
}

impl PatchState {
    fn prepare(
        &mut self,
        law: &TyreLaw,
        compliance: [f64; 2],
        load: f64,
        speed: f64,
        friction: f64,
        dt: f64,
    ) -> Row {
        self.shed = 1.0 / (1.0 + dt * speed / law.relaxation_length);
        self.limit = friction * load;
        let damping = law.damping_time * (1.0 - speed / law.damping_fade_speed).max(0.0);
        let mut row = Row {
            limit: self.limit * dt,
            ..Row::IDLE
        };
        for axis in 0..2 {
            let stiffness = law.stiffness_per_load[axis] * load;
            self.stiffness[axis] = stiffness;
            row.give[axis] = stiffness * dt * (self.shed * dt + damping);
            row.bias[axis] = stiffness * dt * self.shed * self.deflection[axis];
            row.share[axis] = 1.0 / (1.0 + row.give[axis] * compliance[axis]);
        }
        row
    }
}

impl Row {
    const IDLE: Self = Self {
        give: [0.0; 2],
        bias: [0.0; 2],
        share: [1.0; 2],
        limit: 0.0,
    };

    /// The impulse that agrees with the slip it leads to, given the slip that `now` led to.
    fn impulse(&self, now: [f64; 2], slip: [f64; 2]) -> [f64; 2] {
        let mut wanted = now;
        for axis in 0..2 {
            let missing = self.give[axis] * slip[axis] + now[axis] + self.bias[axis];
            wanted[axis] -= missing * self.share[axis];
        }
        self.within_limit(wanted)
    }

    fn within_limit(&self, impulse: [f64; 2]) -> [f64; 2] {
        let square = impulse[0] * impulse[0] + impulse[1] * impulse[1];
        if square <= self.limit * self.limit {
            impulse
        } else {
            let kept = self.limit / square.sqrt();
            [impulse[0] * kept, impulse[1] * kept]
        }
    }
}

fn apply(
    patch: &PatchState,
    [along, across]: [f64; 2],
    chassis: &mut Chassis,
    wheel: &mut Wheel,
    radius: f64,
) {
    let velocity = &mut chassis.velocity;
    velocity[0] += along / chassis.mass;
    velocity[1] += across / chassis.mass;
    velocity[2] += (patch.place.x * across - patch.place.y * along) / chassis.inertia;
    wheel.speed -= radius * along * wheel.compliance;
}

/// Dry friction and brakes: as much torque as it takes to stop the wheel, up to what they can hold.
/// Returns the change, N·m·s.
fn hold(held: &mut f64, wheel: &mut Wheel, dt: f64) -> f64 {
    if wheel.compliance <= 0.0 {
        return 0.0;
    }
    let limit = wheel.hold_torque * dt;
    let wanted = (*held - wheel.speed / wheel.compliance).clamp(-limit, limit);
    let delta = wanted - *held;
    *held = wanted;
    wheel.speed += delta * wheel.compliance;
    delta.abs()
}
