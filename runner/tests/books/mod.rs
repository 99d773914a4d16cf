//! Books of the energy of a drive, and a look at its wheels after each step of the physics.

use std::time::Duration;

use rigsim_core::mecanum::Mecanum;
use rigsim_core::r150::R150;
use rigsim_physics::mecanum::WHEELS;
use rigsim_physics::traction::GroundForce;
use rigsim_physics::{Energy, R150PlantSettings};
use rigsim_runner::Run;

/// A step of the physics.
pub const STEP: Duration = Duration::from_millis(5);

/// What has been seen so far, J.
#[derive(Debug, Default)]
pub struct Books {
    /// Of an R150, out of its battery.
    battery: f64,
    /// Of it, into the module with its outputs, and into the small modules.
    electronics: f64,
    /// Into the motors; of a car, which has no battery, what these give by torque and speed.
    motors: f64,
    /// Heat of the windings.
    windings: f64,
    /// What went through the motors either way.
    moved: f64,
    wheel_speed: [f64; WHEELS],
}

impl Books {
    /// Before a run, whose device keeps the balance of its energy from then on.
    pub fn open(run: &mut Run) {
        let rig = run.rig_mut();
        rig.with_any_device(0, |device, _, _| {
            if let Some(r150) = device.get_mut::<R150>() {
                r150.plant.gear_mut().energy = Some(Energy::default());
            }
            if let Some(car) = device.get_mut::<Mecanum>() {
                car.plant.gear_mut().energy = Some(Energy::default());
            }
        });
    }

    /// After a step.
    pub fn look(&mut self, run: &Run) {
        let rig = run.rig();
        let seconds = STEP.as_secs_f64();
        if let Some(r150) = rig.device::<R150>(0) {
            let truth = r150.truth();
            let power = truth.battery_voltage * truth.battery_current;
            let resistance = R150PlantSettings::default().motor.resistance;
            let (mut motors, mut windings) = (0.0, 0.0);
            for (supply, current) in [
                (truth.motor_supply_current.right, truth.motor_current.right),
                (truth.motor_supply_current.left, truth.motor_current.left),
            ] {
                motors += truth.battery_voltage * supply;
                windings += current * current * resistance;
            }
            let module = truth.battery_voltage * r150.plant.measurements().supply_current;
            let small_modules = R150PlantSettings::default().rails.small_modules_power;
            self.battery += power * seconds;
            self.electronics += (module + small_modules) * seconds;
            self.motors += motors * seconds;
            self.windings += windings * seconds;
            self.moved += motors.abs() * seconds;
            check_friction(r150.plant.gear().on_ground());
        } else if let Some(car) = rig.device::<Mecanum>(0) {
            let truth = car.truth();
            for wheel in 0..WHEELS {
                let turning = (self.wheel_speed[wheel] + truth.wheel_speed[wheel]) / 2.0;
                let work = truth.motor_torque[wheel] * turning * seconds;
                self.motors += work;
                self.moved += work.abs();
            }
            self.wheel_speed = truth.wheel_speed;
            check_friction(car.plant.gear().on_ground());
        }
    }

    /// At the end of a drive, which stands: everything that was given is heat.
    pub fn close(&self, run: &Run) -> Result<(), String> {
        let rig = run.rig();
        let r150 = rig.device::<R150>(0).map(|r150| &r150.plant);
        let car = rig.device::<Mecanum>(0).map(|car| &car.plant);
        let (energy, motor_heat) = match (r150, car) {
            (Some(plant), _) => (plant.gear().energy, self.windings),
            (_, Some(plant)) => (plant.gear().energy, 0.0),
            _ => return Err("no such device".to_owned()),
        };
        let energy = energy.ok_or("its balance was not kept")?;
        let speed = rig.motion(0).map_or(0.0, |motion| {
            motion.forward_speed.hypot(motion.leftward_speed)
        });
        if speed > 0.01 {
            return Err(format!("it still drives at {speed} m/s"));
        }
        let Energy {
            motors,
            outside,
            held,
            tyres,
        } = energy;
        let size = self.moved + outside.abs() + 0.1;
        let heat = held + tyres;
        let mut missing = vec![
            ("of the motors", 0.02, self.motors - motor_heat - motors),
            ("of the wheels", 0.001, motors + outside - heat),
        ];
        if r150.is_some() {
            let left = self.battery - self.electronics - self.motors;
            missing.push(("of the battery", 0.001, left));
        }
        for (what, share, missing) in missing {
            if missing.abs() > share * size {
                return Err(format!(
                    "{missing:.3} J {what} are missing: {self:?} {energy:?}"
                ));
            }
        }
        if held < 0.0 || tyres < -1e-3 * size {
            return Err(format!("heat came back: {energy:?}"));
        }
        Ok(())
    }
}

/// No wheel pushes harder than friction allows under its load.
fn check_friction(wheels: [GroundForce; 4]) {
    for wheel in wheels {
        let [along, across] = wheel.force;
        let most = wheel.most * (1.0 + 1e-9) + 1e-9;
        assert!(along.hypot(across) <= most, "{wheel:?}");
    }
}
