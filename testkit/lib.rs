//! Things that may be done to the simulator, and promises that hold whatever is done.
//!
//! Each function takes an input, plays it, and panics if a promise is broken. Two things call them:
//! the property tests in `tests/` of this crate, which shrink what fails, and the fuzz targets in
//! `fuzz/`, which are guided by what code an input reaches. Both make the same types of bytes, so an
//! operation that is added to [`operation::Operation`] is played by both.
//!
//! | module | input | promises |
//! |---|---|---|
//! | [`stream`] | bytes and pauses, for each decoder | what an independent reading of the stream finds, however it is split |
//! | [`network`] | bytes of a client on the network | all taken, in any pieces, and nothing lost |
//! | [`request`] | bytes of a client of the control socket | a request, its beginning, or refused, however they are split |
//! | [`operation`], [`choice`] | one thing that a client, an operator, a fault or the world does, in the forms that the rows of the devices declare | – |
//! | [`setting`] | any setting with any value that its schema names | – |
//! | [`session`] | a sequence of operations on devices in a world, with any settings | finite physics, time forward, bounded output, right frames |
//! | [`text`] | settings, world, rig and scenario files | refused in words, or built and run for a while |
//! | [`document`] | the repository's scenario, rig and world files, mutated | refused in words, or played to their end, the same again |
//! | [`trace`] | any text in the place of a trace | replayed, or refused in words |

#![expect(
    clippy::panic,
    clippy::missing_panics_doc,
    reason = "a broken promise is reported by panicking, to proptest and to libFuzzer alike"
)]

pub mod choice;
pub mod document;
pub mod network;
pub mod operation;
pub mod request;
pub mod schema;
pub mod session;
pub mod setting;
pub mod stream;
pub mod text;
pub mod trace;

pub use rigsim_core::SHIPPED;
use rigsim_core::device::Devices;

/// Each device alone, and all of them.
pub fn groups() -> impl Iterator<Item = Devices> {
    SHIPPED.chunks(1).chain([SHIPPED])
}

/// The device with this id alone.
#[must_use]
pub fn alone(id: &str) -> Devices {
    let mut groups = groups();
    groups
        .find(|devices| devices[0].id == id)
        .unwrap_or_else(|| panic!("there is no {id}"))
}
