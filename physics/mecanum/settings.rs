//! Settings of the mecanum car outside its firmware.

use std::time::Duration;

use rigsim_settings::settings;

use super::signals::Wheel;
use crate::faults::Bounds;
use crate::tolerance::ToleranceSettings;
use crate::traction::TyreSettings;
use crate::vehicle_body::Build;
use crate::world::BodyShape;

const MS: fn(u64) -> Duration = Duration::from_millis;
const S: fn(u64) -> Duration = Duration::from_secs;

settings! {
    /// The car around the board.
    pub struct MecanumPlantSettings {}
    groups {
        /// Chassis and payload.
        body: CarBodySettings,
        /// Wheels and rollers.
        wheel: MecanumWheelSettings,
        /// Motors, gears and brakes.
        motor: CarMotorSettings,
        /// Spread of its parts.
        tolerance: ToleranceSettings,
        /// Encoders.
        encoder: EncoderSettings,
        /// Ultrasonic sensors.
        ultrasonic: UltrasonicSettings,
    }

    /// Chassis and payload.
    pub struct CarBodySettings {
        /// Length of the car.
        length: f64 = 0.34, unit "m", range 0.05..=5.0, assumed "a small car";
        /// Width of the car.
        width: f64 = 0.30, unit "m", range 0.05..=5.0, assumed "a small car";
        /// Half the distance between front and rear axle.
        half_wheelbase: f64 = 0.10, unit "m", range 0.005..=2.5, assumed "a small car";
        /// Half the distance between left and right wheels.
        half_track: f64 = 0.12, unit "m", range 0.005..=2.5, assumed "a small car";
        /// Mass without payload.
        mass: f64 = 8.0, unit "kg", range 0.1..=500.0, assumed "four gear motors, a battery and a frame";
        /// Moment of inertia about the vertical, without payload.
        yaw_inertia: f64 = 0.14, unit "kg*m^2", range 0.0005..=500.0,
            assumed "a uniform box of that mass and size";
        /// Height of the centre of mass above the ground, without payload.
        centre_of_mass_height: f64 = 0.08, unit "m", range 0.0..=2.0, assumed "motors and battery sit low";
        /// Height of the payload's centre of mass above the ground.
        payload_height: f64 = 0.2, unit "m", range 0.0..=3.0, assumed "on the deck";
        /// Place of the payload ahead of the middle.
        payload_ahead: f64 = 0.0, unit "m", range -2.5..=2.5, assumed "on the middle of the deck";
        /// Place of the payload to the left of the middle.
        payload_left: f64 = 0.002, unit "m", range -2.5..=2.5,
            assumed "no load is placed to the millimetre";
    }

    /// Wheels and rollers.
    pub struct MecanumWheelSettings {
        /// Radius of a wheel over its rollers.
        radius: f64 = 0.05, unit "m", range 0.005..=1.0, assumed "a common size, 100 mm";
        /// Force of a roller that does not turn per unit of slip, as a multiple of the load.
        roller_stiffness: f64 = 4.0, range 0.1..=100.0,
            assumed "with the roller drag a strafe then moves 0.85 of what the wheels turn; \
                     published cars 0.74 to 0.92";
        /// Drag of a turning roller, as a share of the load.
        roller_drag: f64 = 0.18, range 0.0..=2.0,
            assumed "plain bearings and a small rubber roller on a hard floor";
        /// Most by which the rollers of a wheel drag more or less than `roller_drag`.
        roller_spread: f64 = 10.0, unit "%", range 0.0..=50.0,
            assumed "bearings with more or less dirt; a strafing car then turns a little";
        /// By what share the drag grows for each empty weight of payload.
        roller_drag_growth: f64 = 0.3, range 0.0..=10.0,
            assumed "loaded rollers press into the floor and their bearings; builders report that \
                     heavy robots strafe worse";
        /// Distance rolled in which a roller takes up most of a change of slip.
        relaxation_length: f64 = 0.01, unit "m", range 0.0005..=1.0,
            assumed "a fraction of the radius of a roller";
        /// Rolling resistance of a wheel, as a share of the load.
        rolling_resistance: f64 = 0.02, range 0.0..=0.5,
            assumed "rubber on a hard floor, 0.01 to 0.03 in textbooks";
    }

    /// Brushless gear motors with speed control; speeds and torques are those of the wheel.
    pub struct CarMotorSettings {
        /// Speed at full speed voltage.
        full_speed: f64 = 50.0, unit "rpm", range 0.1..=10000.0,
            assumed "the highest speed that a motion packet can ask for";
        /// Time in which the speed control goes from zero to full speed.
        ramp_time: Duration = MS(200), range MS(1)..=S(60),
            assumed "the ramp that the same authors published for another vehicle";
        /// The most torque that a motor gives.
        torque_limit: f64 = 1.5, unit "N*m", range 0.001..=1000.0,
            assumed "about twice what makes a wheel of the empty car slip";
        /// Torque per lack of speed of the control, N·m for 1 rad/s.
        speed_gain: f64 = 10.0, range 0.001..=10000.0,
            assumed "a load of half the limit then costs 1.5 % of full speed at first";
        /// Time in which the control makes up for a lack of speed; 0 for a control that does not.
        speed_integral: Duration = MS(100), range Duration::ZERO..=S(60),
            assumed "the control of such a board has an integral part; without it, gear and rollers \
                     cost a tenth of the speed at 1 r/min";
        /// Moment of inertia of rotor, gear and wheel at the wheel.
        inertia: f64 = 0.0028, unit "kg*m^2", range 0.00001..=10.0,
            assumed "a rotor of 10 g*cm^2 behind a gear of 1:50, and a wheel of 250 g";
        /// Dry friction of the gear at the wheel.
        gear_friction: f64 = 0.12, unit "N*m", range 0.0..=100.0,
            assumed "coasting, the car then loses 0.9 m/s^2 forward and 2.2 sideways; robots of \
                     8 to 14 kg that were tuned with Pedro Pathing lose 0.9 and 1.4 to 2.5";
        /// Torque that BK holds.
        brake_torque: f64 = 1.5, unit "N*m", range 0.0..=1000.0,
            assumed "as much as the motor gives";
    }

    /// Encoders.
    pub struct EncoderSettings {
        /// Pulses of PG for one revolution of a wheel.
        pulses_per_revolution: u32 = 60, range 1..=100_000,
            assumed "the article does not name the motors";
    }

    /// Ultrasonic sensors; lists are four in front from left to right, then four in the rear from
    /// left to right, where left is the car's left.
    pub struct UltrasonicSettings {
        /// Places of the sensors ahead of the car's middle.
        x: [f64; 8] = [0.17, 0.17, 0.17, 0.17, -0.17, -0.17, -0.17, -0.17],
            unit "m", range -5.0..=5.0, assumed "on the front and rear edge";
        /// Places of the sensors left of the car's middle.
        y: [f64; 8] = [0.12, 0.04, -0.04, -0.12, 0.12, 0.04, -0.04, -0.12],
            unit "m", range -5.0..=5.0, assumed "evenly spread over the width";
        /// Directions of the sensors, counter-clockwise from straight ahead.
        angle: [f64; 8] = [20.0, 0.0, 0.0, -20.0, 160.0, 180.0, 180.0, -160.0],
            unit "deg", range -360.0..=360.0, assumed "the outer ones look a little aside";
        /// Half the opening of a cone.
        half_angle: f64 = 15.0, unit "deg", range 0.0..=80.0, assumed "common sensors, 30 degrees in all";
        /// Angle from a surface's normal beyond which it sends no echo back; its edges always do.
        incidence: f64 = 60.0, unit "deg", range 0.0..=90.0,
            assumed "smooth walls throw sound that comes aslant away, rough ones do not";
        /// Random error of a distance, one standard deviation.
        noise: f64 = 0.001, unit "m", range 0.0..=1.0,
            assumed "the data sheet of the HC-SR04 promises 3 mm";
        /// Probability that a sensor hears the echo of its neighbour's ping, if that is the nearer
        /// one.
        crosstalk: f64 = 0.5, unit "%", range 0.0..=100.0,
            assumed "sensors that ping in turn seldom hear one another";
        /// Range of the sensors.
        range: f64 = 4.5, unit "m", range 0.01..=100.0, assumed "common sensors, 4500 mm";
        /// Time between two pings of a sensor.
        period: Duration = MS(60), range MS(1)..=S(10),
            assumed "common advice, so that no echo of the ping before is heard";
    }
}

impl MecanumWheelSettings {
    /// The axle of the roller that a wheel stands on, radians counter-clockwise from straight
    /// ahead. Seen from above it is the mirror image of the upper rollers.
    pub(super) fn axle_on_ground(&self, wheel: Wheel) -> f64 {
        // At 45 degrees, as on nearly all mecanum wheels; the firmware's dead reckoning takes it for
        // granted.
        let from_ahead = 45.0_f64.to_radians();
        match wheel {
            Wheel::LeftFront | Wheel::RightRear => -from_ahead,
            Wheel::RightFront | Wheel::LeftRear => from_ahead,
        }
    }

    /// A roller as the traction law has it: along its axle, and across.
    pub(super) fn tyre(&self) -> TyreSettings {
        TyreSettings {
            wheel_radius: self.radius,
            longitudinal_stiffness: self.roller_stiffness,
            lateral_stiffness: self.roller_stiffness,
            relaxation_length: self.relaxation_length,
            rolling_resistance: self.rolling_resistance,
        }
    }
}

impl CarBodySettings {
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
                payload: 100.0,
                push: 1e4,
            },
        }
    }
}
