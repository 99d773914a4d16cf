//! The linear problem of patches that all grip.
//!
//! Momentum of the body and of each wheel changes by the elastic impulses, which are linear in the
//! velocities at the end of the step. A patch touches one wheel only, so the wheels are eliminated
//! one by one and three equations for the body remain.

use nalgebra::{Matrix3, Vector3};

use super::super::{Chassis, Contact, PatchState, Traction, Wheel};
use super::Row;
use crate::twist::Twist;

/// The body's momentum balance, `matrix · velocity = right`, for forward, left and yaw rate.
struct BodyEquations {
    matrix: Matrix3<f64>,
    right: Vector3<f64>,
}

/// A wheel's balance: `momentum · speed + coupling · velocity of the body = right`.
#[derive(Clone, Copy)]
struct WheelEquation {
    momentum: f64,
    coupling: Vector3<f64>,
    right: f64,
}

/// Effect of dry friction and brakes on a wheel in this step.
#[derive(Clone, Copy, PartialEq)]
enum Hold {
    /// It turns against their full torque; N·m·s.
    Turning(f64),
    /// They hold it still.
    Still,
}

/// A solution that has yet to prove itself.
struct Candidate<const WHEELS: usize> {
    velocity: Twist,
    speeds: [f64; WHEELS],
    holds: [Hold; WHEELS],
}

impl<const WHEELS: usize, const PATCHES: usize, C: Contact> Traction<WHEELS, PATCHES, C> {
    /// Returns whether the solution stands: no patch slides, and every wheel turns or stands as it
    /// did in the last step. Nothing has changed otherwise.
    pub(super) fn solve_directly(
        &mut self,
        chassis: &mut Chassis,
        wheels: &mut [Wheel; WHEELS],
        rows: &[Row; PATCHES],
        hold_limits: &[f64; WHEELS],
    ) -> bool {
        let holds: [Hold; WHEELS] = std::array::from_fn(|index| {
            if self.hold[index].abs() < self.hold_limit[index] || wheels[index].compliance <= 0.0 {
                Hold::Still
            } else {
                Hold::Turning(hold_limits[index].copysign(self.hold[index]))
            }
        });
        let mut body = BodyEquations::new(chassis);
        let mut equations: [WheelEquation; WHEELS] = std::array::from_fn(|index| {
            let held = if let Hold::Turning(held) = holds[index] {
                held
            } else {
                0.0
            };
            WheelEquation::new(&wheels[index], held)
        });
        for (patch, row) in self.patches.iter().zip(rows) {
            let axes = patch.contact.jacobian(&patch.place);
            body.add(row.give[0], row.bias[0], axes[0]);
            body.add(row.give[1], row.bias[1], axes[1]);
            equations[patch.place.wheel].add(patch, row, &axes, self.law.radius);
        }
        for (equation, hold) in equations.iter().zip(&holds) {
            if *hold != Hold::Still {
                body.eliminate(equation);
            }
        }
        // Always there: mass and inertia stand on the diagonal, and what the wheels take away their
        // patches added before.
        let Some(inverse) = body.matrix.try_inverse() else {
            return false;
        };
        let velocity = inverse * body.right;

        let mut speeds = [0.0; WHEELS];
        for ((speed, equation), hold) in speeds.iter_mut().zip(&equations).zip(holds) {
            let Hold::Turning(held) = hold else { continue };
            *speed = (equation.right - equation.coupling.dot(&velocity)) / equation.momentum;
            // Friction that would drive the wheel means that the wheel has come to a stand.
            if *speed * held > 0.0 {
                return false;
            }
        }
        let candidate = Candidate {
            velocity: Twist {
                ahead: velocity.x,
                left: velocity.y,
                turn: velocity.z,
            },
            speeds,
            holds,
        };
        self.accept(candidate, chassis, wheels, rows, hold_limits)
    }

    fn accept(
        &mut self,
        candidate: Candidate<WHEELS>,
        chassis: &mut Chassis,
        wheels: &mut [Wheel; WHEELS],
        rows: &[Row; PATCHES],
        hold_limits: &[f64; WHEELS],
    ) -> bool {
        let mut impulses = [[0.0; 2]; PATCHES];
        let mut torques = [0.0; WHEELS];
        for ((patch, row), impulse) in self.patches.iter().zip(rows).zip(&mut impulses) {
            let wheel = patch.place.wheel;
            let rolling = candidate.speeds[wheel] * self.law.radius;
            *impulse = row.elastic(patch.slip(candidate.velocity, rolling));
            if !row.grips(*impulse) {
                return false;
            }
            torques[wheel] -= self.law.radius * patch.ahead(*impulse);
        }
        let mut held = [0.0; WHEELS];
        for (index, held) in held.iter_mut().enumerate() {
            match candidate.holds[index] {
                Hold::Turning(full) => *held = full,
                Hold::Still if wheels[index].compliance <= 0.0 => {}
                Hold::Still => {
                    *held = -wheels[index].inertia * wheels[index].speed - torques[index];
                    if held.abs() >= hold_limits[index] {
                        return false;
                    }
                }
            }
        }
        for (patch, impulse) in self.patches.iter_mut().zip(impulses) {
            patch.impulse = impulse;
        }
        for (wheel, speed) in wheels.iter_mut().zip(candidate.speeds) {
            wheel.speed = speed;
        }
        self.hold = held;
        self.hold_limit = *hold_limits;
        chassis.velocity = candidate.velocity;
        true
    }
}

impl BodyEquations {
    fn new(chassis: &Chassis) -> Self {
        let inertia = Vector3::new(chassis.mass, chassis.mass, chassis.inertia);
        let Twist { ahead, left, turn } = chassis.velocity;
        Self {
            matrix: Matrix3::from_diagonal(&inertia),
            right: inertia.component_mul(&Vector3::new(ahead, left, turn)),
        }
    }

    /// An elastic impulse along one axis of a patch.
    fn add(&mut self, give: f64, bias: f64, axis: Vector3<f64>) {
        self.matrix += axis * (give * axis).transpose();
        self.right -= bias * axis;
    }

    fn eliminate(&mut self, wheel: &WheelEquation) {
        let scaled = wheel.coupling / wheel.momentum;
        self.matrix -= wheel.coupling * scaled.transpose();
        self.right -= scaled * wheel.right;
    }
}

impl WheelEquation {
    fn new(wheel: &Wheel, held: f64) -> Self {
        Self {
            momentum: wheel.inertia,
            coupling: Vector3::zeros(),
            right: wheel.inertia * wheel.speed + held,
        }
    }

    /// The reaction of a patch that pushes the body along `axes`.
    fn add<C: Contact>(
        &mut self,
        patch: &PatchState<C>,
        row: &Row,
        axes: &[Vector3<f64>; 2],
        radius: f64,
    ) {
        for (axis, direction) in axes.iter().enumerate().take(C::DRIVEN) {
            let arm = radius * patch.contact.forward(axis);
            let give = arm * row.give[axis];
            self.momentum += arm * give;
            self.coupling -= give * direction;
            self.right += arm * row.bias[axis];
        }
    }
}
