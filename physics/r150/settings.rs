//! Settings of the R150 outside its firmware.

use std::time::Duration;

use crate::faults::Bounds;
use crate::tolerance::ToleranceSettings;
use crate::traction::TyreSettings;
use crate::vehicle_body::Build;
use crate::world::BodyShape;

rigsim_settings::settings! {
    /// The vehicle around the module.
    pub struct R150PlantSettings {}
    groups {
        /// Chassis and payload.
        body: BodySettings,
        /// Wheels and tyres.
        tyre: TyreSettings,
        /// Motors, gears and brakes.
        motor: MotorSettings,
        /// Warming of the motors.
        motor_thermal: MotorThermalSettings,
        /// Spread of its parts.
        tolerance: ToleranceSettings,
        /// The two packs.
        battery: BatterySettings,
        /// The module's outputs.
        rails: RailSettings,
        /// Fuses of the junction box.
        fuses: FuseSettings,
        /// Warming of the 12 V converters.
        thermal: ThermalSettings,
    }

    /// Chassis and payload.
    pub struct BodySettings {
        /// Length of the chassis.
        length: f64 = 0.98, unit "m", range 0.1..=5.0, assumed "public pictures and dimensions";
        /// Width of the chassis.
        width: f64 = 0.66, unit "m", range 0.1..=5.0, assumed "public pictures and dimensions";
        /// Distance between front and rear axle.
        wheelbase: f64 = 0.65, unit "m", range 0.05..=5.0, assumed "public pictures and dimensions";
        /// Distance between the wheels of both sides.
        track: f64 = 0.60, unit "m", range 0.05..=5.0, assumed "public pictures and dimensions";
        /// Mass without payload.
        mass: f64 = 130.0, unit "kg", range 1.0..=2000.0, assumed "public figure for the empty vehicle";
        /// Moment of inertia about the vertical, without payload.
        yaw_inertia: f64 = 16.0, unit "kg*m^2", range 0.01..=5000.0,
            assumed "a uniform box of that mass and size, a little more for the wheels";
        /// Height of the centre of mass above the ground, without payload.
        centre_of_mass_height: f64 = 0.35, unit "m", range 0.0..=2.0, assumed "batteries sit low";
        /// Height of the payload's centre of mass above the ground.
        payload_height: f64 = 0.7, unit "m", range 0.0..=3.0, assumed "on the deck";
        /// Place of the payload ahead of the middle.
        payload_ahead: f64 = 0.0, unit "m", range -2.5..=2.5, assumed "on the middle of the deck";
        /// Place of the payload to the left of the middle.
        payload_left: f64 = 0.005, unit "m", range -2.5..=2.5,
            assumed "no load is placed to the millimetre";
    }
}

rigsim_settings::words! {
    /// State of a motor at PWM 0.
    pub enum AtZeroPwm {
        /// Its bridge shorts it: the vehicle brakes.
        Brake = "brake",
        /// Its bridge is open: the vehicle rolls on.
        Coast = "coast",
    }
}

rigsim_settings::settings! {
    /// Motors, gears and brakes.
    pub struct MotorSettings {
        /// Turns of the motor for one turn of the wheel.
        gear_ratio: f64 = 28.3, range 1.0..=500.0, documented "manual section 4.3.8";
        /// Back-EMF per motor speed, which is also torque per current.
        back_emf_constant: f64 = 0.3188, unit "V*s/rad", range 0.001..=10.0,
            assumed "gives the manual's 1.4 m/s at full PWM and 80 % charge";
        /// Resistance of the windings, the bridge and the wiring.
        resistance: f64 = 0.5, unit "ohm", range 0.01..=100.0,
            assumed "rated 7 N*m then draws 22 A; stall is about twice the fuse";
        /// Moment of inertia of one wheel.
        wheel_inertia: f64 = 0.15, unit "kg*m^2", range 0.0001..=10.0, assumed "5 kg near the rim";
        /// Dry friction of a gear, at the motor shaft.
        gear_friction: f64 = 0.15, unit "N*m", range 0.0..=100.0, assumed "2 % of the rated torque";
        /// Friction of a gear that stands, as a multiple of that of one that turns.
        stiction: f64 = 1.5, range 1.0..=10.0,
            assumed "lubricated steel holds 1.3 to 2 times as much as it drags in textbooks";
        /// Duty below which a driver gives nothing.
        dead_band: f64 = 2.5, unit "%", range 0.0..=50.0,
            assumed "drivers for such motors have a band of 1 to 5 % around zero unless configured";
        /// State of a motor at PWM 0.
        at_zero_pwm: AtZeroPwm = AtZeroPwm::Brake,
            assumed "a bridge at duty 0 that keeps both its lower switches closed";
        /// Most current that a driver allows through a motor; above it, the driver lowers the voltage.
        current_limit: Option<f64> = Some(45.0), unit "A", range 1.0..=1000.0,
            assumed "three quarters of a 60 A driver, as Roboteq sets its own (ALIM in its manual); \
                     twice what the rated 7 N*m need, and under the 50 A fuse";
        /// Time in which a driver raises the duty from none to full.
        ramp_up: Duration = Duration::from_millis(500),
            range Duration::ZERO..=Duration::from_secs(60),
            assumed "half of the second that Roboteq's drivers take unless configured (MAC in its manual)";
        /// Time in which a driver lowers the duty from full to none.
        ramp_down: Duration = Duration::from_millis(250),
            range Duration::ZERO..=Duration::from_secs(60),
            assumed "a vehicle should stop faster than it starts, and its tyres hold 5.6 m/s^2";
        /// Torque that the parking brake holds at the wheels of one side.
        brake_torque: f64 = 200.0, unit "N*m", range 0.0..=10000.0,
            assumed "holds the loaded vehicle on its steepest slope with a margin of two";
    }

    /// Warming of the motors with the square of their current. Above a temperature a motor's driver
    /// allows less current, and none above another.
    pub struct MotorThermalSettings {
        /// Rise of a motor at the rated current.
        motor_rise: f64 = 80.0, unit "K", range 0.0..=1000.0,
            assumed "insulation class B allows 80 K above 40 degC";
        /// Time constant of a motor's warming.
        motor_time_constant: Duration = Duration::from_secs(900),
            range Duration::from_millis(100)..=Duration::from_secs(36000),
            assumed "some kilograms of iron and copper";
        /// Temperature of a motor above which its driver allows less current.
        motor_derating: f64 = 110.0, unit "degC", range -60.0..=500.0,
            assumed "insulation class B lives to 130 degC";
        /// Temperature of a motor at which its driver shuts off.
        motor_shut_off: f64 = 130.0, unit "degC", range -60.0..=500.0,
            assumed "insulation class B lives to 130 degC";
    }

    /// Two packs of 13 cells in parallel.
    pub struct BatterySettings {
        /// Charge at the start.
        initial_soc: f64 = 80.0, unit "%", range 0.0..=100.0, assumed "typical working charge";
        /// Capacity of all packs.
        capacity: f64 = 40.0, unit "Ah", range 0.1..=8000.0,
            assumed "public figures of the vehicle's two packs";
        /// Resistance of the packs and their wiring.
        resistance: f64 = 0.02, unit "ohm", range 0.0005..=10.0,
            assumed "two packs of 13 cells with 2.3 mohm each; short thick cables and a connector";
        /// Voltage of a cell without current, from empty to full in steps of 10 %.
        cell_voltage: [f64; 11] =
            [3.00, 3.45, 3.55, 3.60, 3.64, 3.70, 3.77, 3.86, 3.95, 4.06, 4.18],
            unit "V", range 0.5..=6.0, assumed "typical lithium cell with 3.7 V nominal";
    }

    /// The module's outputs and what it draws itself.
    pub struct RailSettings {
        /// Power of the vehicle's small modules behind their own fuse.
        small_modules_power: f64 = 20.0, unit "W", range 0.0..=500.0,
            assumed "controller, lights and sounder";
    }

    /// Fuses of the junction box.
    pub struct FuseSettings {
        /// Fuse of each motor's supply.
        motor: f64 = 50.0, unit "A", range 0.1..=1000.0, documented "manual section 1";
        /// Fuse of the tail supply, which feeds the module and its outputs.
        tail: f64 = 60.0, unit "A", range 0.1..=1000.0, documented "manual section 1";
    }

    /// Warming of the 12 V converters, motors and drivers.
    pub struct ThermalSettings {
        /// Temperature around the vehicle.
        ambient: f64 = 25.0, unit "degC", range -60.0..=100.0, assumed "a mild day";
    }
}

impl BodySettings {
    pub(super) fn build(&self) -> Build {
        Build {
            shape: BodyShape {
                length: self.length,
                width: self.width,
                mass: self.mass,
                inertia: self.yaw_inertia,
            },
            height: self.centre_of_mass_height,
            payload_height: self.payload_height,
            payload_place: [self.payload_ahead, self.payload_left],
            bounds: Bounds {
                payload: 1000.0,
                push: 1e5,
            },
        }
    }
}
