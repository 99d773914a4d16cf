//! Rig and scenario files, and runs of them: conditions, verdicts and traces.
//!
//! Pure: text goes in; plans, outcomes and lines of traces come out; the caller reads and writes
//! the files.

#![warn(clippy::disallowed_methods, clippy::disallowed_types)]

mod assemble;
pub mod condition;
mod error;
mod forgiving;
mod problems;
pub mod renamed;
pub mod rig_file;
pub mod run;
pub mod scenario;
mod schema;
mod sources;
pub mod trace;

pub use assemble::PlannedLink;
pub use error::{FileError, FileErrorKind, FileErrors};
pub use rig_file::{DevicePlan, RigPlan};
pub use run::{Outcome, Run, RunError, RunOptions};
pub use scenario::Scenario;
