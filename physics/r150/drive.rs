//! Motors, gears and brakes: from bridge voltage to the torque of the wheels.

use super::R150Plant;
use super::driver::Driver;
use super::settings::R150PlantSettings;
use super::signals::Side;
use crate::running_gear::{Changes, RunningGear, Span, WheelDrive};
use crate::tolerance::Draw;
use crate::traction::Straight;
use crate::twist::Wrench;
use crate::world::World;

/// Share of a motor's torque that is lost in its gear; assumed: two or three planetary stages.
const GEAR_LOSS: f64 = 0.1;
/// Speed below which a motor's shaft stands, rad/s.
const STANDS: f64 = 0.1;
/// Rolling speed above which a tyre damps no longer, m/s: below walking speed.
const DAMPING_FADE_SPEED: f64 = 0.3;
/// Moment of inertia of a rotor, kg·m²: a motor of about 1 kW. At the wheel it adds to the wheel's
/// own.
const ROTOR_INERTIA: f64 = 0.0015;

/// The moving parts; arrays are by [`Side::index`].
#[derive(Debug, Clone)]
pub(super) struct Drive {
    /// The wheels of a side are geared together.
    pub(super) gear: RunningGear<2>,
    pub(super) drivers: [Driver; 2],
    /// Duty of each bridge in the last step, if it was on.
    duty: [Option<f64>; 2],
    /// Of each side; a smaller wheel is a shorter gear.
    gear_ratio: [f64; 2],
    torque_constant: [f64; 2],
    winding_resistance: f64,
    gear_friction: f64,
    stiction: f64,
    brake_torque: f64,
}

/// What drives the wheels of a side over a step, and by how much the impulse rises in the course of
/// it, N·m·s.
struct SideDrive {
    whole: WheelDrive,
    rise: f64,
}

impl SideDrive {
    /// The part over a span of a step of so many seconds.
    fn over(&self, span: Span, step: f64) -> WheelDrive {
        let share = span.seconds() / step;
        let ahead = 1.0 - span.to / step;
        WheelDrive {
            impulse: (self.whole.impulse - self.rise * ahead) * share,
            opposed: self.whole.opposed * share,
            ..self.whole
        }
    }
}

impl Drive {
    pub(super) fn new(name: &str, world: &World, settings: &R150PlantSettings) -> Self {
        let mut draw = Draw::of(name, world.tolerance_seed());
        let tolerance = &settings.tolerance;
        let body = &settings.body;
        let motor = &settings.motor;
        let ratio = motor.gear_ratio;
        let contacts = [Side::Left, Side::Right, Side::Left, Side::Right];
        Self {
            gear: RunningGear::new(
                (&settings.tyre, DAMPING_FADE_SPEED),
                [body.wheelbase / 2.0, body.track / 2.0],
                ROTOR_INERTIA * ratio * ratio + 2.0 * motor.wheel_inertia,
                contacts.map(|side| (side.index(), Straight)),
            ),
            drivers: [Driver::new(motor); 2],
            duty: [None; 2],
            gear_ratio: Side::ALL.map(|_| ratio / draw.factor(tolerance.wheel)),
            torque_constant: Side::ALL
                .map(|_| motor.back_emf_constant * draw.factor(tolerance.motor)),
            winding_resistance: motor.resistance,
            gear_friction: motor.gear_friction,
            stiction: motor.stiction,
            brake_torque: motor.brake_torque,
        }
    }

    /// Speed of a motor shaft, rad/s.
    pub(super) fn motor_speed(&self, side: Side) -> f64 {
        self.gear.wheel_speed[side.index()] * self.gear_ratio[side.index()]
    }

    pub(super) fn back_emf(&self, side: Side) -> f64 {
        self.motor_speed(side) * self.torque_constant[side.index()]
    }
}

impl R150Plant {
    /// Drive and brake of the wheels of a side over a step of `dt` seconds. The motor's back-EMF
    /// answers to the speed at the end of the step: its time constant is near the step itself.
    fn side_drive(&self, side: Side, dt: f64) -> SideDrive {
        let drive = &self.drive;
        let index = side.index();
        let port = self.motor_port(side);
        let faults = &self.side_faults[side];
        let (ratio, constant) = (drive.gear_ratio[index], drive.torque_constant[index]);
        let brakes =
            (self.commands.parking_brake && !faults.brake_stuck_open) || faults.brake_stuck_on;
        let motor_torque = self.flow.motor_current[index] * constant;
        let stands = self.drive.motor_speed(side).abs() < STANDS;
        let stiction = if stands { drive.stiction } else { 1.0 };
        let friction = drive.gear_friction * stiction + GEAR_LOSS * motor_torque.abs();
        let (mut impulse, mut rise, mut opposed) = (0.0, 0.0, 0.0);
        if port.connected {
            let torque_per_volt = ratio * constant / drive.winding_resistance;
            let full = dt * torque_per_volt * self.flow.bus;
            impulse = full * port.duty;
            rise = full * drive.duty[index].map_or(0.0, |before| port.duty - before);
            opposed = dt * torque_per_volt * ratio * constant;
        }
        let whole = WheelDrive {
            impulse,
            opposed,
            gear: friction * ratio,
            brake: if brakes { drive.brake_torque } else { 0.0 },
            drag: faults.drag_torque,
            blocked: faults.blocked,
        };
        SideDrive { whole, rise }
    }

    /// Counts how long the vehicle has been slow enough, and then brings it to a full stop.
    pub(super) fn stop_when_slow(&mut self, world: &mut World, seconds: f64) {
        let could_stand = self.drive.gear.is_slow(&self.body) && !self.is_driven();
        let (gear, body) = (&mut self.drive.gear, &mut self.body);
        if gear.stop_when_slow(body, world, seconds, could_stand) {
            self.update_encoders();
            self.solve_network();
        }
    }

    /// Returns whether something is trying to move the vehicle. A motor against a blocked wheel
    /// counts: its current must go on being integrated.
    fn is_driven(&self) -> bool {
        let motors = Side::ALL.iter().any(|side| {
            let port = self.motor_port(*side);
            let driven = self.commands.propulsion_power && self.wanted_duty(*side) != 0.0;
            port.connected && (port.duty != 0.0 || driven)
        });
        motors || self.body.push() != Wrench::default()
    }
}

/// Computes the forces of one step and sets the body's velocity.
pub(super) fn step(plant: &mut R150Plant, world: &mut World) {
    let dt = world.step_length().as_secs_f64();
    plant.ramp_duties(dt);
    let drives = Side::ALL.map(|side| plant.side_drive(side, dt));
    plant.drive.duty = Side::ALL.map(|side| {
        let port = plant.motor_port(side);
        port.connected.then_some(port.duty)
    });
    let changes = Changes {
        gradual: drives.iter().any(|drive| drive.rise != 0.0),
        sudden: Vec::new(),
    };
    (plant.drive.gear).step(world, &plant.body, &changes, |span, _| {
        drives.each_ref().map(|drive| drive.over(span, dt))
    });
}
