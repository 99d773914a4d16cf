//! Signals between the plant and everything around it.

use std::ops::{Index, IndexMut};

use crate::faults::number;
use crate::plant::Motion;

rigsim_settings::words! {
    /// One of the two sides of the vehicle, in the order of the wire format; front and rear wheel of a
    /// side are geared together.
    pub enum Side {
        /// Right.
        Right = "right",
        /// Left.
        Left = "left",
    }
}

/// A value for each side.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Sides<T> {
    /// Right.
    pub right: T,
    /// Left.
    pub left: T,
}

impl<T> From<[T; 2]> for Sides<T> {
    fn from([right, left]: [T; 2]) -> Self {
        Self { right, left }
    }
}

impl<T> Index<Side> for Sides<T> {
    type Output = T;
    fn index(&self, side: Side) -> &T {
        match side {
            Side::Right => &self.right,
            Side::Left => &self.left,
        }
    }
}

impl<T> IndexMut<Side> for Sides<T> {
    fn index_mut(&mut self, side: Side) -> &mut T {
        match side {
            Side::Right => &mut self.right,
            Side::Left => &mut self.left,
        }
    }
}

rigsim_settings::file_words! {
    /// One of the module's switched outputs; the number is its bit in the power status. Its name in
    /// conditions stands for it in files as well: `v12a`.
    pub enum Rail {
        /// 12 V output A.
        #[serde(alias = "v12a")]
        V12A = "12v-a",
        /// 12 V output B.
        #[serde(alias = "v12b")]
        V12B = "12v-b",
        /// 12 V output C.
        #[serde(alias = "v12c")]
        V12C = "12v-c",
        /// 12 V output D.
        #[serde(alias = "v12d")]
        V12D = "12v-d",
        /// The 48 V output.
        #[serde(alias = "v48")]
        V48 = "48v",
        /// The 5 V outputs.
        #[serde(alias = "v5")]
        V5 = "5v",
    }

    /// A pair of 12 V outputs, which share a converter.
    pub enum Pair {
        /// A and B.
        Ab = "ab",
        /// C and D.
        Cd = "cd",
    }
}

/// Number of rails.
pub const RAILS: usize = 6;

/// Load on a rail.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Load {
    /// Nothing.
    #[default]
    Open,
    /// A device that draws this much power at any voltage, W.
    Power(f64),
    /// A resistor, Ω.
    Resistance(f64),
    /// A dead short at the end of its wires.
    Short,
}

/// Source at a PWM input.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum PwmSource {
    /// Nothing.
    #[default]
    None,
    /// A signal generator.
    Generator {
        /// Hz
        frequency: f64,
        /// Share of the period at the high level, 0–1.
        duty: f64,
        /// Voltage of the high level, V.
        high_voltage: f64,
    },
    /// One of the module's own PWM outputs, 0–3, with a pull-up.
    OwnOutput(usize),
}

/// Reading of an input capture unit; zeros if it makes nothing of its signal.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct PwmReading {
    /// Hz
    pub frequency: f64,
    /// Share of the period at the high level, 0–1.
    pub duty: f64,
}

/// The pins that the firmware drives.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct R150Commands {
    /// Duty of the motor bridges, −1 (backward) to 1. Zero shorts the motor.
    pub motor_duty: Sides<f64>,
    /// Set if the bridges have their supply; the emergency stop cuts it and the motors turn freely.
    pub propulsion_power: bool,
    /// Set if the parking brake holds.
    pub parking_brake: bool,
    /// Set if the tail supply, which feeds the module and its outputs, is connected.
    pub tail_power: bool,
    /// Outputs that are switched on, by [`Rail::index`].
    pub rail_on: [bool; RAILS],
    /// Duty of the PWM outputs, 0–1.
    pub pwm_out_duty: [f64; 4],
}

impl Default for R150Commands {
    /// Powered, brake released, nothing on.
    fn default() -> Self {
        Self {
            motor_duty: Sides::default(),
            propulsion_power: true,
            parking_brake: false,
            tail_power: true,
            rail_on: [false; RAILS],
            pwm_out_duty: [0.0; 4],
        }
    }
}

/// Readings of the firmware's sensors; by default those of a module without a supply.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct R150Measurements {
    /// Set if the module has a supply at all. If not, everything else reads zero.
    pub module_powered: bool,
    /// Speed of the motor shafts by their encoders, rpm, positive is forward.
    pub motor_rpm: Sides<f64>,
    /// Count of the encoders, turns of the motor shafts, positive is forward.
    pub motor_turns: Sides<f64>,
    /// State of charge, 0–1.
    pub soc: f64,
    /// Voltage of the supply bus, V.
    pub bus_voltage: f64,
    /// Voltage at the terminals of each output, V, by [`Rail::index`].
    pub rail_voltage: [f64; RAILS],
    /// Current out of each output, A, by [`Rail::index`].
    pub rail_current: [f64; RAILS],
    /// Voltage of the 12 V converters without load, V, whether or not an output is on.
    pub converter_12v: f64,
    /// Current that the module and its outputs draw from their supply, A.
    pub supply_current: f64,
    /// Temperature of the 12 V converters A+B and C+D, °C.
    pub temperature: [f64; 2],
    /// The PWM inputs.
    pub pwm_in: [PwmReading; 4],
    /// Set if the power module reports a fault in itself.
    pub power_module_fault: bool,
}

/// Things that are broken or too hot.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct R150Health {
    /// Fuses that have blown, in the order of [`FuseId::ALL`](super::FuseId::ALL).
    pub fuse_blown: [bool; 4],
    /// Sides of which the driver allows less current because of heat.
    pub derated: Sides<bool>,
    /// Sides of which the driver has shut off because of heat.
    pub shut_off: Sides<bool>,
}

/// True state, for verdicts and summaries. No firmware sees this.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct R150Truth {
    /// Pose and motion in the world.
    pub motion: Motion,
    /// Speed of the wheels of each side, rad/s.
    pub wheel_speed: Sides<f64>,
    /// Current through the windings, A.
    pub motor_current: Sides<f64>,
    /// Current that each bridge takes from the bus, A; negative when it feeds back.
    pub motor_supply_current: Sides<f64>,
    /// Voltage at the battery's terminals, V.
    pub battery_voltage: f64,
    /// Current out of the battery, A; negative while charging.
    pub battery_current: f64,
    /// State of charge, 0–1.
    pub soc: f64,
    /// Things that are broken or too hot.
    pub health: R150Health,
    /// Temperature of the motors, °C.
    pub motor_celsius: Sides<f64>,
    /// Temperature of the motor drivers, °C.
    pub driver_celsius: Sides<f64>,
}

impl R150Commands {
    /// A bridge cannot do more than follow its supply; anything that is not a number is off.
    pub(super) fn within_limits(&self) -> Self {
        let within = |duty: f64, low: f64| number(duty).clamp(low, 1.0);
        Self {
            motor_duty: Sides {
                right: within(self.motor_duty.right, -1.0),
                left: within(self.motor_duty.left, -1.0),
            },
            pwm_out_duty: self.pwm_out_duty.map(|duty| within(duty, 0.0)),
            ..*self
        }
    }
}
