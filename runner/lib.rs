//! Files that say what to simulate: rigs, and in time scenarios.
//!
//! Pure: text goes in, plans come out; whoever calls reads the files.

#![warn(clippy::disallowed_methods, clippy::disallowed_types)]

mod assemble;
pub mod condition;
mod forgiving;
mod problems;
pub mod report;
pub mod rig_file;
pub mod run;
pub mod scenario;
mod schema;
mod sources;
mod suggest;
mod tables;
pub mod trace;

pub use assemble::PlannedLink;
pub use rig_file::{DevicePlan, RigFileError, RigPlan};
pub use run::{Outcome, Run, RunError, RunOptions};
pub use scenario::Scenario;
