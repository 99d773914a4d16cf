//! What an operator, a scenario or bad luck does to the car.

use super::MecanumPlant;
use super::encoder::Encoder;
use super::signals::Wheel;
use crate::pose::Pose;
use crate::world::World;

/// What is wrong with one wheel.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct WheelFaults {
    /// It cannot turn at all. Its rollers still can.
    pub blocked: bool,
    /// Something drags on it, N·m.
    pub drag_torque: f64,
    /// Its motor neither drives nor holds it.
    pub free_wheeling: bool,
    /// Its encoder.
    pub encoder: Encoder,
}

impl MecanumPlant {
    /// Replaces all that is wrong with a wheel. Drag is held within 0–1000 N·m, the pulses of
    /// interference within 0–1 million a second.
    pub fn set_wheel_faults(&mut self, wheel: Wheel, faults: WheelFaults) {
        self.faults[wheel.index()] = WheelFaults {
            drag_torque: number(faults.drag_torque).clamp(0.0, 1e3),
            encoder: match faults.encoder {
                Encoder::Noisy(rate) => Encoder::Noisy(number(rate).clamp(0.0, 1e6)),
                other => other,
            },
            ..faults
        };
        if faults.blocked {
            self.drive.stop(wheel);
        }
        self.wake();
    }

    /// What is wrong with a wheel.
    #[must_use]
    pub fn wheel_faults(&self, wheel: Wheel) -> WheelFaults {
        self.faults[wheel.index()]
    }

    /// Switches the supply of board and motors. Without it the wheels turn freely.
    pub fn set_supply(&mut self, on: bool) {
        self.supplied = on;
        self.wake();
    }

    /// Puts a payload on the deck, kg, within 0–100.
    pub fn set_payload(&mut self, world: &mut World, payload: f64) {
        self.drive
            .set_payload(&self.settings, number(payload).clamp(0.0, 100.0));
        world.set_mass(self.body, self.drive.mass, self.drive.inertia);
        self.wake();
    }

    /// Pushes steadily: ahead and to the left in N, counter-clockwise in N·m, until changed. Each is
    /// held within ±10 kN.
    pub fn set_push(&mut self, ahead: f64, left: f64, turn: f64) {
        self.push = [ahead, left, turn].map(|part| number(part).clamp(-1e4, 1e4));
        self.wake();
    }

    /// Bumps once: ahead and to the left in N·s, counter-clockwise in N·m·s. Each is held within
    /// ±1 kN·s.
    pub fn bump(&mut self, world: &mut World, ahead: f64, left: f64, turn: f64) {
        let [ahead, left, turn] = [ahead, left, turn].map(|part| number(part).clamp(-1e3, 1e3));
        let motion = world.motion(self.body);
        let [x, y] = motion.to_world([ahead / self.drive.mass, left / self.drive.mass]);
        world.set_velocity(
            self.body,
            [motion.vx + x, motion.vy + y],
            motion.yaw_rate + turn / self.drive.inertia,
        );
        self.wake();
    }

    /// Lifts the car and sets it down elsewhere, standing.
    pub fn place(&mut self, world: &mut World, pose: Pose) {
        world.place(self.body, pose);
        self.motion = world.motion(self.body);
        self.drive.traction.relax();
        for wheel in Wheel::ALL {
            self.drive.stop(wheel);
        }
        self.sensors.look(world, self.body, &self.motion);
        self.wake();
    }
}

/// Callers check what they are given; this is the last line that keeps a NaN out of the state.
fn number(value: f64) -> f64 {
    if value.is_nan() { 0.0 } else { value }
}
