//! Files that say what to simulate: rigs, and in time scenarios.
//!
//! Pure: text goes in, plans come out; whoever calls reads the files.

mod assemble;
pub mod condition;
pub mod rig_file;
mod suggest;

pub use assemble::Link;
pub use rig_file::{DevicePlan, Kind, RigFileError, RigPlan};
