//! Firmware emulators, the serial line, and the rig that ties them to the world.
//!
//! Nothing here does input or output, reads a clock, or has a thread. The driver of a [`rig::Rig`]
//! passes time and the client's bytes in, and takes the device's bytes and the events out; the
//! same calls give the same results on every run.
//!
//! | module | what it is |
//! |---|---|
//! | [`device`] | what a device is to all other code: a row of a table, and a trait |
//! | [`r150_device`] | firmware of the XAG R150's IO module: bytes and pins |
//! | [`r150`] | that firmware with the hardware around it |
//! | [`mecanum_device`] | firmware of the mecanum car's board: bytes on two links, and pins |
//! | [`mecanum`] | that firmware with the hardware around it |
//! | [`firmware`] | what every firmware has around its program |
//! | [`effect`], [`defects`] | what can be done to a device: faults at every level, actions |
//! | [`mod@line`], [`uart`] | the serial line: pacing, baud mismatch |
//! | [`rig`] | any number of devices in one world, advanced from event to event |
//! | [`scanner`] | frames in a stream of bytes |
//! | [`message`] | declarations of messages, and what follows from them |
//! | [`event`], [`report`], [`newest`] | what is reported, its counts, and queues of it |
//! | [`settings`] | every setting of a run, in one tree |

#![warn(clippy::disallowed_methods, clippy::disallowed_types)]

pub mod defects;
pub mod device;
pub mod effect;
pub mod event;
pub mod firmware;
mod injection;
pub mod line;
pub mod mecanum;
pub mod mecanum_device;
pub mod message;
pub mod newest;
pub mod r150;
pub mod r150_device;
pub mod report;
pub mod rig;
mod rounding;
pub mod scanner;
pub mod settings;
pub mod uart;

pub use rigsim_physics::noise;
pub use rigsim_settings::SimTime;

/// The devices that the program `sim` has.
pub const SHIPPED: device::Devices = &[&r150::R150_SPEC, &mecanum::MECANUM_SPEC];
