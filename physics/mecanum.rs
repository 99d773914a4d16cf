//! The hardware of the mecanum car, as its firmware sees it.
//!
//! The firmware sets [`MecanumCommands`] and reads [`MecanumMeasurements`].

pub mod signals;

pub use signals::{
    ECHOES, MecanumCommands, MecanumMeasurements, PORTS, Plugs, Port, PortCommand, WHEELS, Wheel,
    Wiring,
};
