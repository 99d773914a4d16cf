//! The linear problem of patches that all grip.
//!
//! Momentum of the body and of each wheel changes by the elastic impulses, which are linear in the
//! velocities at the end of the step. A patch touches one wheel only, so the wheels are eliminated
//! one by one and three equations for the body remain.

use super::super::{Chassis, Traction, Wheel};
use super::Row;

/// A wheel's equation: `momentum · speed + along · vx + turning · yaw rate = right`.
#[derive(Clone, Copy, Default)]
struct WheelEquation {
    momentum: f64,
    along: f64,
    turning: f64,
    right: f64,
}

/// What dry friction and brakes do to a wheel in this step.
#[derive(Clone, Copy, PartialEq)]
enum Hold {
    /// It turns against their full torque; N·m·s.
    Turning(f64),
    /// They hold it still.
    Still,
}

impl<const WHEELS: usize, const PATCHES: usize> Traction<WHEELS, PATCHES> {
    /// Returns whether the solution stands: no patch slides, and every wheel turns or stands as it
    /// did in the last step. Nothing has changed otherwise.
    pub(super) fn solve_directly(
        &mut self,
        chassis: &mut Chassis,
        wheels: &mut [Wheel; WHEELS],
        rows: &[Row; PATCHES],
        hold_limits: &[f64; WHEELS],
    ) -> bool {
        let radius = self.law.radius;
        let holds: [Hold; WHEELS] = std::array::from_fn(|index| {
            if self.hold[index].abs() < self.hold_limit[index] || wheels[index].compliance <= 0.0 {
                Hold::Still
            } else {
                Hold::Turning(hold_limits[index].copysign(self.hold[index]))
            }
        });

        let mut body = self.body_equations(chassis, rows);
        let mut equations = [WheelEquation::default(); WHEELS];
        for (index, equation) in equations.iter_mut().enumerate() {
            let Hold::Turning(held) = holds[index] else {
                continue;
            };
            let wheel = &wheels[index];
            *equation = WheelEquation {
                momentum: wheel.inertia,
                along: 0.0,
                turning: 0.0,
                right: wheel.inertia * wheel.speed + held,
            };
            for (patch, row) in self.patches.iter().zip(rows) {
                if patch.place.wheel == index {
                    let give = radius * row.give[0];
                    equation.momentum += radius * give;
                    equation.along -= give;
                    equation.turning += give * patch.place.y;
                    equation.right += radius * row.bias[0];
                }
            }
            body.eliminate(equation);
        }
        let velocity = body.solve();

        let mut speeds = [0.0; WHEELS];
        for ((speed, equation), hold) in speeds.iter_mut().zip(&equations).zip(holds) {
            let Hold::Turning(held) = hold else { continue };
            *speed =
                (equation.right - equation.along * velocity[0] - equation.turning * velocity[2])
                    / equation.momentum;
            // Friction that would drive the wheel means that the wheel has come to a stand.
            if *speed * held > 0.0 {
                return false;
            }
        }
        self.accept(chassis, wheels, rows, hold_limits, velocity, speeds, &holds)
    }

    fn body_equations(&self, chassis: &Chassis, rows: &[Row; PATCHES]) -> BodyEquations {
        let mut body = BodyEquations {
            ahead: chassis.mass,
            left: chassis.mass,
            turn: chassis.inertia,
            ahead_turn: 0.0,
            left_turn: 0.0,
            right: [
                chassis.mass * chassis.velocity[0],
                chassis.mass * chassis.velocity[1],
                chassis.inertia * chassis.velocity[2],
            ],
        };
        for (patch, row) in self.patches.iter().zip(rows) {
            let (x, y) = (patch.place.x, patch.place.y);
            let ([along, across], [pull, shove]) = (row.give, row.bias);
            body.ahead += along;
            body.left += across;
            body.turn += along * y * y + across * x * x;
            body.ahead_turn -= along * y;
            body.left_turn += across * x;
            body.right[0] -= pull;
            body.right[1] -= shove;
            body.right[2] += pull * y - shove * x;
        }
        body
    }

    #[expect(clippy::too_many_arguments, reason = "the parts of one solution")]
    fn accept(
        &mut self,
        chassis: &mut Chassis,
        wheels: &mut [Wheel; WHEELS],
        rows: &[Row; PATCHES],
        hold_limits: &[f64; WHEELS],
        velocity: [f64; 3],
        speeds: [f64; WHEELS],
        holds: &[Hold; WHEELS],
    ) -> bool {
        let mut impulses = [[0.0; 2]; PATCHES];
        let mut torques = [0.0; WHEELS];
        for ((patch, row), impulse) in self.patches.iter().zip(rows).zip(&mut impulses) {
            let wheel = patch.place.wheel;
            let slip = patch.slip(velocity, speeds[wheel] * self.law.radius);
            *impulse = row.elastic(slip);
            if !row.grips(*impulse) {
                return false;
            }
            torques[wheel] -= self.law.radius * impulse[0];
        }
        let mut held = [0.0; WHEELS];
        for (index, held) in held.iter_mut().enumerate() {
            match holds[index] {
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
        for (wheel, speed) in wheels.iter_mut().zip(speeds) {
            wheel.speed = speed;
        }
        self.hold = held;
        self.hold_limit = *hold_limits;
        chassis.velocity = velocity;
        true
    }
}

/// Symmetric, with no coupling between ahead and left.
struct BodyEquations {
    ahead: f64,
    left: f64,
    turn: f64,
    ahead_turn: f64,
    left_turn: f64,
    right: [f64; 3],
}

impl BodyEquations {
    fn eliminate(&mut self, wheel: &WheelEquation) {
        let inverse = 1.0 / wheel.momentum;
        let along = wheel.along * inverse;
        let turning = wheel.turning * inverse;
        self.ahead -= along * wheel.along;
        self.ahead_turn -= along * wheel.turning;
        self.turn -= turning * wheel.turning;
        self.right[0] -= along * wheel.right;
        self.right[2] -= turning * wheel.right;
    }

    /// Never singular: mass and inertia stand on the diagonal, and what the wheels take away they
    /// added before.
    fn solve(&self) -> [f64; 3] {
        let inverse_left = 1.0 / self.left;
        let turn = self.turn - self.left_turn * self.left_turn * inverse_left;
        let right = self.right[2] - self.left_turn * self.right[1] * inverse_left;
        let inverse = 1.0 / (self.ahead * turn - self.ahead_turn * self.ahead_turn);
        let ahead = (self.right[0] * turn - self.ahead_turn * right) * inverse;
        let yaw_rate = (self.ahead * right - self.ahead_turn * self.right[0]) * inverse;
        let left = (self.right[1] - self.left_turn * yaw_rate) * inverse_left;
        [ahead, left, yaw_rate]
    }
}
