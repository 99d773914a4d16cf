//! Outcome of a run.

use std::fmt;

use rigsim_core::SimTime;
use rigsim_core::report::Report;
use serde::{Deserialize, Serialize, Serializer};

/// How near a rule, a response or an expectation came to being broken.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Margin {
    /// The rule, response or expectation, in words.
    pub what: String,
    /// Smallest slack of the run, as a share of the limit: 0 if it was broken, and only then.
    pub margin: f64,
    /// Time of the smallest slack.
    #[serde(rename = "time_s", serialize_with = "seconds")]
    pub at: SimTime,
}

/// Outcome of a run.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Outcome {
    /// Set if everything was as the file says, and the client was put to the test.
    pub passed: bool,
    /// The scenario's title.
    pub title: String,
    /// From which everything random was derived.
    pub seed: u64,
    /// Time at which it ended.
    pub ended_at: SimTime,
    /// Failures: causes first, each kind in the order of time.
    pub failures: Vec<Failure>,
    /// Number of further failures.
    pub more_failures: u64,
    /// The faults of the file that were injected.
    pub faults: Vec<FaultRecord>,
    /// Counts of what happened at each device; the client report is in it.
    pub devices: Vec<DeviceReport>,
    /// How near rules, responses and expectations came to being broken, of those that were judged.
    pub margins: Vec<Margin>,
    /// Rules and responses of which nothing was asked, with the reason, in words.
    pub not_judged: Vec<String>,
    /// Parts of the scenario for which a real client gave no occasion, with the reason, in words.
    /// Without failures, the run is then skipped: it says nothing about the client.
    pub not_applicable: Vec<String>,
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

/// What a failure is about. Causes come before their consequences.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum FailureKind {
    /// A rule, a response, an expectation or a demand of the file.
    Rule,
    /// The end of the client, or of the time that it had.
    Client,
    /// What did not come because the run ended, or because something before it did not come.
    Consequence,
}

/// Something that was not as the file says.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Failure {
    /// What it is about.
    pub kind: FailureKind,
    /// Time at which it was found.
    #[serde(rename = "time_s", serialize_with = "seconds")]
    pub at: SimTime,
    /// The step that it is about, if it is about one.
    pub step: Option<String>,
    /// Description, and the values that it was found by.
    pub what: String,
    /// The description without these values: the same in each run that breaks this rule.
    #[serde(skip)]
    pub rule: String,
    /// What surrounds it in the run.
    #[serde(flatten)]
    pub context: Context,
}

impl Outcome {
    /// Something turned out to be wrong after the end.
    pub fn fail(&mut self, what: String) {
        self.passed = false;
        let after = |failure: &Failure| failure.kind <= FailureKind::Client;
        let at = self.failures.partition_point(after);
        let failure = Failure {
            kind: FailureKind::Client,
            at: self.ended_at,
            step: None,
            rule: what.clone(),
            what,
            context: std::mem::take(&mut self.last),
        };
        self.failures.insert(at, failure);
    }

    /// Returns `true` if nothing failed and the client gave no occasion for a part of the scenario.
    #[must_use]
    pub fn is_skipped(&self) -> bool {
        self.failures.is_empty() && !self.not_applicable.is_empty()
    }
}

/// A fault of the file.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct FaultRecord {
    /// The step that injected it.
    pub step: String,
    /// Time at which it was injected first.
    #[serde(rename = "from_s", serialize_with = "seconds")]
    pub from: SimTime,
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

/// What failed: a rule, and what was found instead.
#[derive(Debug, Clone)]
pub(super) struct What {
    pub rule: String,
    pub found: String,
}

impl What {
    /// A rule, with the message that the file has for it.
    pub(super) fn of(message: Option<&str>, rule: &str, found: String) -> Self {
        let rule = message.map_or_else(|| rule.to_owned(), |message| format!("{message}: {rule}"));
        Self { rule, found }
    }
}

impl From<String> for What {
    fn from(rule: String) -> Self {
        Self {
            rule,
            found: String::new(),
        }
    }
}

impl fmt::Display for What {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}{}", self.rule, self.found)
    }
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
