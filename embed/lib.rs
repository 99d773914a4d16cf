//! Virtual devices inside your own Rust tests and programs.
//!
//! In simulated time a test of ten seconds takes milliseconds. The client's end of a port is a
//! [`ClientPort`], which is [`Read`](std::io::Read), [`Write`](std::io::Write) and
//! [`SerialPort`](serialport::SerialPort): code that takes a `Box<dyn SerialPort>` is tested as it is,
//! without a pseudo-terminal and without waiting. A read advances simulated time until a byte is there
//! or its timeout is over.
//!
//! ```
//! use std::io::Write;
//! use std::time::Duration;
//! use rigsim_embed::Simulation;
//!
//! let sim = Simulation::of("r150")?;
//! let r150 = sim.device("r150")?;
//! let mut port: Box<dyn serialport::SerialPort> = Box::new(r150.open()?);
//! // Half power ahead, on both sides.
//! port.write_all(&[0xAA, 0x55, 0x04, 0x12, 0xF4, 0x01, 0xF4, 0x01, 0x45, 0x38])?;
//! sim.advance(Duration::from_millis(400))?;
//! assert!(r150.number("truth.speed_mps")? > 0.1);
//! // The motor watchdog stops it half a second after the last command.
//! sim.wait_until("truth.at_rest", Duration::from_secs(10))?;
//! // Which is attributed to the client.
//! assert!(r150.report().client_errors().any(|(code, _)| code == "watchdog_fired"));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! | to | use |
//! |---|---|
//! | build one device, or several with settings in a world | [`Simulation::of`], [`Simulation::builder`] |
//! | play a scenario file with your client | [`Builder::scenario_file`], [`Simulation::finish`] |
//! | talk to a device | [`Device::open`] |
//! | let time pass | [`Simulation::advance`], [`Simulation::wait_until`] |
//! | see what is really so | [`Device::number`], [`Device::flag`], [`Device::look`], [`Simulation::look`] |
//! | break something, work a button, change the world | [`Device::fault`], [`Device::operator`], [`Simulation::step`] |
//! | see what the client did wrong | [`Device::report`], [`Simulation::events`] |
//! | serve a client that opens a path | [`Builder::spawn`] |
//!
//! The modules [`serve`], [`served`] and [`ports`] are what the `sim` command serves real ports with.

mod builder;
pub mod clock;
mod error;
mod port;
mod port_state;
pub mod ports;
pub mod serve;
pub mod served;
mod simulation;
mod slowness;
mod spawn;

pub use rigsim_core;

pub use builder::{Builder, NewDevice};
pub use error::Error;
pub use port::ClientPort;
pub use rigsim_runner::condition::ExpressionError;
pub use simulation::{Device, Simulation, Step};
pub use spawn::Spawned;

/// The examples of the guide are tests, too.
#[cfg(doctest)]
#[doc = include_str!("../docs/rust.md")]
struct Guide;
