//! What came of a run.

use std::fmt;

use sim_core::SimTime;
use sim_core::report::Report;

/// What came of a run.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Outcome {
    /// Whether everything was as the file says.
    pub passed: bool,
    /// The scenario's title.
    pub title: String,
    /// From which everything random was derived.
    pub seed: u64,
    /// When it ended.
    pub ended_at: SimTime,
    /// What was not as the file says, in the order in which it was found.
    pub failures: Vec<Failure>,
    /// How many more failures there were.
    pub more_failures: u64,
    /// The faults of the file that were injected.
    pub faults: Vec<FaultRecord>,
    /// What happened at each device, counted; the client report is in it.
    pub devices: Vec<DeviceReport>,
    /// The last events before the end, in words.
    pub traffic: Vec<String>,
}

/// Something that was not as the file says.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Failure {
    /// When it was found.
    pub at: SimTime,
    /// The step that it is about, if it is about one.
    pub step: Option<String>,
    /// What was wrong, and the values that it was found by.
    pub what: String,
}

impl Outcome {
    /// Something turned out to be wrong after the end.
    pub fn fail(&mut self, what: String) {
        self.passed = false;
        self.failures.push(Failure {
            at: self.ended_at,
            step: None,
            what,
        });
    }
}

/// A fault of the file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FaultRecord {
    /// The step that injected it.
    pub step: String,
    /// Which.
    pub id: &'static str,
    /// How often it was injected.
    pub armed: u64,
    /// How often it hit something.
    pub hits: u64,
}

/// What happened at a device.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct DeviceReport {
    /// The device.
    pub name: String,
    /// What happened, counted.
    pub report: Report,
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
