//! Outcome of a run.

use std::fmt;

use serde::{Serialize, Serializer};
use sim_core::SimTime;
use sim_core::report::Report;

/// Outcome of a run.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Outcome {
    /// Set if everything was as the file says.
    pub passed: bool,
    /// The scenario's title.
    pub title: String,
    /// From which everything random was derived.
    pub seed: u64,
    /// Time at which it ended.
    pub ended_at: SimTime,
    /// Failures, in the order in which they were found.
    pub failures: Vec<Failure>,
    /// Number of further failures.
    pub more_failures: u64,
    /// The faults of the file that were injected.
    pub faults: Vec<FaultRecord>,
    /// Counts of what happened at each device; the client report is in it.
    pub devices: Vec<DeviceReport>,
    /// Rules and responses of which nothing was asked, with the reason, in words.
    pub not_judged: Vec<String>,
    /// Surroundings of the end.
    pub last: Context,
}

/// Surroundings of a failure, in words.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize)]
pub struct Context {
    /// The last that happened before, since the failure before.
    pub before: Vec<String>,
    /// The faults that were armed.
    pub armed: Vec<String>,
    /// Whatever else steps had changed and not undone.
    pub in_effect: Vec<String>,
}

/// Something that was not as the file says.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Failure {
    /// Time at which it was found.
    #[serde(rename = "time_s", serialize_with = "seconds")]
    pub at: SimTime,
    /// The step that it is about, if it is about one.
    pub step: Option<String>,
    /// Description, and the values that it was found by.
    pub what: String,
    /// Surroundings of it.
    #[serde(flatten)]
    pub context: Context,
}

impl Outcome {
    /// Something turned out to be wrong after the end.
    pub fn fail(&mut self, what: String) {
        self.passed = false;
        self.failures.push(Failure {
            at: self.ended_at,
            step: None,
            what,
            context: std::mem::take(&mut self.last),
        });
    }
}

/// A fault of the file.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct FaultRecord {
    /// The step that injected it.
    pub step: String,
    /// Code of the fault.
    #[serde(rename = "fault")]
    pub id: &'static str,
    /// Number of times that it was injected.
    pub armed: u64,
    /// Number of these times at which it hit anything.
    pub hit: u64,
    /// Number of hits, all times together.
    pub hits: u64,
}

/// Counts of what happened at a device.
#[derive(Debug, Clone, PartialEq)]
pub struct DeviceReport {
    /// The device.
    pub name: String,
    /// Counts of events.
    pub report: Report,
    /// Distance that it has driven, m.
    pub distance_m: f64,
}

fn seconds<S: Serializer>(at: &SimTime, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.serialize_f64(at.as_secs_f64())
}

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} s", self.at)?;
        if let Some(step) = &self.step {
            write!(f, ", \"{step}\"")?;
        }
        write!(f, ": {}", self.what)
    }
}
