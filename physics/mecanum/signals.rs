//! Signals between the mecanum board's pins and the car around it.
//!
//! The board drives motor *ports*; which wheel turns is a matter of how the motors are plugged in:
//! as the firmware expects, but for [`PlugSwaps`].

/// Number of motor ports of the board.
pub const PORTS: usize = 5;
/// Number of wheels of the car.
pub const WHEELS: usize = 4;
/// Number of ultrasonic sensors of the car.
pub const ECHOES: usize = 8;

rigsim_settings::file_words! {
    /// A motor port of the board, by its name there in lower case; in the order of the arrays of
    /// [`MecanumCommands`] and [`MecanumMeasurements`].
    pub enum Port {
        /// X.
        X = "x",
        /// Y.
        Y = "y",
        /// Z, at which no motor is.
        Z = "z",
        /// E0.
        E0 = "e0",
        /// E1.
        E1 = "e1",
    }
}

rigsim_settings::words! {
    /// A wheel of the car, in the order in which every array of wheels has them.
    pub enum Wheel {
        /// Left front.
        LeftFront = "LF",
        /// Right front.
        RightFront = "RF",
        /// Left rear.
        LeftRear = "LR",
        /// Right rear.
        RightRear = "RR",
    }
}

impl Wheel {
    /// Returns whether it is on the left side.
    #[must_use]
    pub const fn is_left(self) -> bool {
        matches!(self, Self::LeftFront | Self::LeftRear)
    }

    /// The port of its motor, by the article's table.
    #[must_use]
    pub const fn port(self) -> Port {
        match self {
            Self::LeftFront => Port::X,
            Self::RightFront => Port::Y,
            Self::LeftRear => Port::E0,
            Self::RightRear => Port::E1,
        }
    }
}

/// Plugs that have changed places, pair by pair: for each port where its own plug is now.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PlugSwaps([Port; PORTS]);

impl PlugSwaps {
    /// After these, the plugs that are in two ports change places, too; either port may be empty.
    #[must_use]
    pub fn and(self, one: Port, other: Port) -> Self {
        Self(self.0.map(|port| match port {
            port if port == one => other,
            port if port == other => one,
            port => port,
        }))
    }

    /// Port in which a wheel's plug is now.
    #[must_use]
    pub fn port(self, wheel: Wheel) -> Port {
        self.0[wheel.port().index()]
    }
}

impl Default for PlugSwaps {
    fn default() -> Self {
        Self(Port::ALL)
    }
}

/// The two pins by which the board drives the motor at one port.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PortCommand {
    /// FR: a motor plugged in straight rolls its wheel backward.
    pub reverse: bool,
    /// BK: the motor holds, whatever the speed voltage.
    pub brake: bool,
}

impl Default for PortCommand {
    /// Holding.
    fn default() -> Self {
        Self {
            reverse: false,
            brake: true,
        }
    }
}

/// The pins that the board drives.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct MecanumCommands {
    /// FR and BK, by [`Port::index`].
    pub ports: [PortCommand; PORTS],
    /// SV, one wire shared by all motors: speed as a share of the motors' full speed, 0–1.
    pub speed_voltage: f64,
}

/// Readings of the board's inputs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MecanumMeasurements {
    /// Set if the board has a supply. If not, everything else means nothing.
    pub board_powered: bool,
    /// PG: pulses since the car was built, by [`Port::index`], wrapping. The one wire carries no
    /// direction: a wheel that is rolled back counts up too.
    pub pulses: [u32; PORTS],
    /// Distance of the nearest echo in each ultrasonic cone, m: four in front from left to right,
    /// then four in the rear from left to right. `None` without an echo.
    pub echoes: [Option<f64>; ECHOES],
    /// Set if the infrared sensor sees something ahead.
    pub obstacle_ahead: bool,
    /// Number of the RFID tag under the reader, 0 when there is none.
    pub tag: u32,
    /// The magnetic bar's 16 channels, bit 0 leftmost, 1 over a strip.
    pub magnetic_bar: u16,
}

impl Default for MecanumMeasurements {
    /// Powered, standing, nothing near.
    fn default() -> Self {
        Self {
            board_powered: true,
            pulses: [0; PORTS],
            echoes: [None; ECHOES],
            obstacle_ahead: false,
            tag: 0,
            magnetic_bar: 0,
        }
    }
}
