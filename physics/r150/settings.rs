//! Settings of the R150 outside its firmware.

use std::time::Duration;

use crate::tolerance::ToleranceSettings;
use crate::traction::TyreSettings;
use crate::vehicle_body::RestSettings;

sim_settings::settings! {
    /// The vehicle around the module.
    pub struct R150PlantSettings {}
    groups {
        /// Chassis and payload.
        body: BodySettings,
        /// Wheels and tyres.
        tyre: TyreSettings,
        /// Motors, gears and brakes.
        motor: MotorSettings,
        /// Warming of the motors and of their drivers.
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
        /// PWM inputs and outputs.
        pwm: PwmSettings,
        /// Limits below which a vehicle counts as standing.
        rest: RestSettings,
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
        /// Payload at the start.
        payload: f64 = 0.0, unit "kg", range 0.0..=1000.0, assumed "empty unless chosen";
        /// Height of the payload's centre of mass above the ground.
        payload_height: f64 = 0.7, unit "m", range 0.0..=3.0, assumed "on the deck";
        /// Place of the payload ahead of the middle.
        payload_ahead: f64 = 0.0, unit "m", range -2.5..=2.5, assumed "on the middle of the deck";
        /// Place of the payload to the left of the middle.
        payload_left: f64 = 0.005, unit "m", range -2.5..=2.5,
            assumed "nobody loads a vehicle to the millimetre";
    }
}

sim_settings::choices! {
    /// State of a motor at PWM 0.
    pub enum AtZeroPwm {
        /// Its bridge shorts it: the vehicle brakes.
        Brake = "brake",
        /// Its bridge is open: the vehicle rolls on.
        Coast = "coast",
    }
}

sim_settings::settings! {
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
        /// Moment of inertia of a rotor.
        rotor_inertia: f64 = 0.0015, unit "kg*m^2", range 0.0..=1.0, assumed "a motor of about 1 kW";
        /// Moment of inertia of one wheel.
        wheel_inertia: f64 = 0.15, unit "kg*m^2", range 0.0001..=10.0, assumed "5 kg near the rim";
        /// Dry friction of a gear, at the motor shaft.
        gear_friction: f64 = 0.15, unit "N*m", range 0.0..=100.0, assumed "2 % of the rated torque";
        /// Share of the motor's torque that is lost in the gear.
        gear_loss: f64 = 0.1, range 0.0..=0.9, assumed "two or three planetary stages";
        /// State of a motor at PWM 0.
        at_zero_pwm: AtZeroPwm = AtZeroPwm::Brake,
            assumed "a bridge at duty 0 that keeps both its lower switches closed";
        /// Most current that a driver lets through a motor; it then gives less voltage.
        current_limit: Option<f64> = Some(45.0), unit "A", range 1.0..=1000.0,
            assumed "three quarters of a 60 A driver, as Roboteq sets its own (ALIM in its manual); \
                     twice what the rated 7 N*m need, and under the 50 A fuse";
        /// Time in which a driver raises the duty from none to full.
        ramp_up: Duration = Duration::from_millis(500),
            range Duration::ZERO..=Duration::from_secs(60),
            assumed "half of the second that Roboteq's drivers take unless told (MAC in its manual)";
        /// Time in which a driver lowers the duty from full to none.
        ramp_down: Duration = Duration::from_millis(250),
            range Duration::ZERO..=Duration::from_secs(60),
            assumed "a vehicle should stop faster than it starts, and its tyres hold 5.6 m/s^2";
        /// Torque that the parking brake holds at the wheels of one side.
        brake_torque: f64 = 200.0, unit "N*m", range 0.0..=10000.0,
            assumed "holds the loaded vehicle on its steepest slope with a margin of two";
    }

    /// Warming of the motors and of their drivers, each with the square of the motor's current. A
    /// driver allows less current above a temperature and none above another.
    pub struct MotorThermalSettings {
        /// Current at which the rises below are reached.
        rated_current: f64 = 22.0, unit "A", range 0.1..=1000.0,
            assumed "what the rated 7 N*m need";
        /// Rise of a motor at the rated current.
        motor_rise: f64 = 80.0, unit "K", range 0.0..=1000.0,
            assumed "insulation class B allows 80 K above 40 degC";
        /// Time constant of a motor's warming.
        motor_time_constant: Duration = Duration::from_secs(900),
            range Duration::from_millis(100)..=Duration::from_secs(36000),
            assumed "some kilograms of iron and copper";
        /// Rise of a driver at the rated current.
        driver_rise: f64 = 30.0, unit "K", range 0.0..=1000.0,
            assumed "a few watts into a plate of aluminium";
        /// Time constant of a driver's warming.
        driver_time_constant: Duration = Duration::from_secs(120),
            range Duration::from_millis(100)..=Duration::from_secs(36000),
            assumed "as the 12 V converters";
        /// Temperature of a motor above which its driver allows less current.
        motor_derating: f64 = 110.0, unit "degC", range -60.0..=500.0,
            assumed "insulation class B lives to 130 degC";
        /// Temperature of a motor at which its driver shuts off.
        motor_shut_off: f64 = 130.0, unit "degC", range -60.0..=500.0,
            assumed "insulation class B lives to 130 degC";
        /// Temperature of a driver above which it allows less current.
        driver_derating: f64 = 80.0, unit "degC", range -60.0..=500.0,
            assumed "drivers begin at 70 to 85 degC at their plate";
        /// Temperature of a driver at which it shuts off.
        driver_shut_off: f64 = 95.0, unit "degC", range -60.0..=500.0,
            assumed "drivers end at 85 to 100 degC at their plate";
    }

    /// Two packs of 13 cells in parallel.
    pub struct BatterySettings {
        /// Charge at the start.
        initial_soc: f64 = 80.0, unit "%", range 0.0..=100.0, assumed "typical working charge";
        /// Capacity of one pack.
        capacity: f64 = 20.0, unit "Ah", range 0.1..=1000.0,
            assumed "public figures of the vehicle's packs";
        /// Packs in parallel.
        packs: u32 = 2, range 1..=8, assumed "public figures of the vehicle's packs";
        /// Cells in series.
        cells: u32 = 13, range 1..=30,
            assumed "48.1 V nominal is 13 cells of 3.7 V, public figures of the vehicle's packs";
        /// Voltage of a cell without current, from empty to full in steps of 10 %.
        cell_voltage: [f64; 11] =
            [3.00, 3.45, 3.55, 3.60, 3.64, 3.70, 3.77, 3.86, 3.95, 4.06, 4.18],
            unit "V", range 0.5..=6.0, assumed "typical lithium cell with 3.7 V nominal";
        /// Internal resistance of one pack.
        pack_resistance: f64 = 0.03, unit "ohm", range 0.0005..=10.0,
            assumed "about 2.3 mohm a cell, a pack for high currents";
        /// Charge from which on the battery takes no more: a brake resistor then turns what
        /// the drivers feed back into heat.
        charge_limit: f64 = 100.0, unit "%", range 0.0..=100.0,
            assumed "its management opens the path to a full battery; a vehicle must brake all the \
                     same, and a resistor with a chopper is the usual way";
        /// Resistance of the wiring from the packs to the bus.
        wiring_resistance: f64 = 0.005, unit "ohm", range 0.0005..=10.0,
            assumed "short thick cables and a connector";
    }

    /// The module's outputs and what it draws itself.
    pub struct RailSettings {
        /// Voltage of the 12 V outputs without load.
        voltage_12v: f64 = 12.0, unit "V", range 1.0..=60.0, documented "manual section 3";
        /// Voltage of the 5 V output without load.
        voltage_5v: f64 = 5.0, unit "V", range 1.0..=60.0, documented "manual section 3";
        /// Source resistance of one 12 V output.
        resistance_12v: f64 = 0.03, unit "ohm", range 0.001..=10.0,
            assumed "a short then draws many times the limit";
        /// Source resistance of the 5 V output.
        resistance_5v: f64 = 0.05, unit "ohm", range 0.001..=10.0,
            assumed "a short then draws many times the limit";
        /// Resistance from the bus to the 48 V output.
        resistance_48v: f64 = 0.01, unit "ohm", range 0.001..=10.0, assumed "a switch and a connector";
        /// Resistance of a short circuit, in its wires.
        short_resistance: f64 = 0.02, unit "ohm", range 0.001..=1.0, assumed "a metre of wire";
        /// Efficiency of the 12 V and 5 V converters.
        converter_efficiency: f64 = 0.92, range 0.1..=1.0, assumed "typical buck converter";
        /// Power of the module itself.
        own_power: f64 = 5.0, unit "W", range 0.0..=200.0, assumed "a controller and idle converters";
        /// Bus voltage under which the module and its converters stop.
        minimum_voltage: f64 = 14.0, unit "V", range 1.0..=40.0,
            assumed "12 V converters need a little more than they give";
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
        /// Fuse of the small modules.
        small_modules: f64 = 5.0, unit "A", range 0.1..=1000.0, documented "manual section 1";
        /// Multiple of the rating that a fuse carries for ever.
        holding_factor: f64 = 1.2, range 1.0..=5.0, assumed "automotive blade and strip fuses";
        /// Time constant of a fuse's warming; at high current it blows after this times
        /// (holding current / current)².
        time_constant: Duration = Duration::from_secs(10),
            range Duration::from_millis(10)..=Duration::from_secs(1000),
            assumed "twice the rating then blows in about five seconds";
    }

    /// Warming of the 12 V converters.
    pub struct ThermalSettings {
        /// Temperature around the vehicle.
        ambient: f64 = 25.0, unit "degC", range -60.0..=100.0, assumed "a mild day";
        /// Temperature by which they are warmer than that at the start.
        initial_rise: f64 = 0.0, unit "K", range 0.0..=500.0, assumed "switched on after a long pause";
        /// Rise of a converter pair at full load.
        full_load_rise: f64 = 45.0, unit "K", range 0.0..=500.0,
            assumed "settles near 70 degC from 25 degC, under the 85 degC limit";
        /// Full load of a converter pair.
        full_load: f64 = 250.0, unit "W", range 1.0..=10000.0, documented "manual section 3";
        /// Time constant of the warming.
        time_constant: Duration = Duration::from_secs(120),
            range Duration::from_millis(100)..=Duration::from_secs(36000),
            assumed "a small heat sink in still air";
    }
}

sim_settings::choices! {
    /// Reading of an input whose signal it cannot measure.
    pub enum Unmeasured {
        /// 0 Hz and 0.
        Zero = "zero",
        /// Last measurement.
        Last = "last",
    }

    /// Reading of an input while its level never changes.
    pub enum SteadyLevel {
        /// The same as of any signal that it cannot measure.
        Unmeasured = "unmeasured",
        /// 0 Hz, and a duty of 0 or 100 % as the level is.
        Level = "level",
    }

    /// Level whose share the duty of an open-drain output is.
    pub enum OutputDuty {
        /// The time in which it lets go of the line, which is then high.
        Released = "released",
        /// The time in which it sinks current, so that the line is low.
        Sinking = "sinking",
    }
}

sim_settings::settings! {
    /// PWM inputs and outputs.
    pub struct PwmSettings {
        /// Lowest voltage that an input takes as high.
        input_high: f64 = 2.0, unit "V", range 0.0..=48.0, documented "manual section 3";
        /// Highest voltage that an input takes.
        input_voltage_max: f64 = 15.0, unit "V", range 0.0..=100.0, documented "manual section 3d";
        /// Lowest frequency that an input measures.
        input_frequency_min: f64 = 10.0, unit "Hz", range 0.001..=1000000.0, documented "manual section 4.3.4";
        /// Highest frequency that an input measures.
        input_frequency_max: f64 = 20000.0, unit "Hz", range 1.0..=1000000.0, documented "manual section 4.3.4";
        /// Reading of an input whose signal it cannot measure: none, too low, too high, too slow or
        /// too fast.
        unmeasured: Unmeasured = Unmeasured::Zero,
            assumed "the manual gives the range that inputs measure, not what they read outside of it";
        /// Reading of an input while its level never changes.
        steady_level: SteadyLevel = SteadyLevel::Unmeasured,
            assumed "a capture unit counts edges, and there are none";
        /// Level whose share the duty of an output is.
        output_duty: OutputDuty = OutputDuty::Released,
            assumed "an input wired to an output then reads the duty that was set";
        /// Frequency of the outputs.
        output_frequency: f64 = 1000.0, unit "Hz", range 0.001..=1000000.0,
            assumed "the manual gives only the limit of 20 kHz";
        /// Voltage to which an output wired to an input is pulled up.
        output_pull_up: f64 = 5.0, unit "V", range 0.0..=48.0, assumed "logic level";
    }
}
