//! What there is to say of a case, for everything that shows its outcome: terminal, JUnit, JSON, page.
//! [`summary`](crate::summary) is of devices that are served, which need not have one.

use std::fmt;

use rigsim_embed::serve::Stalls;
use rigsim_runner::run::{Failure, FailureKind};
use rigsim_runner::{Outcome, Scenario};

use crate::summary::counted;

use super::case::{CaseResult, PlayedClient, Verdict};

/// A case, or cases that have something in common.
pub(crate) struct View<'a> {
    pub(crate) verdict: Verdict,
    /// Reason other than failures, in a line.
    pub(crate) why: Option<String>,
    /// What the scenario is about, of a failure.
    pub(crate) about: Option<&'a str>,
    /// Behaviour of a good client, of a failure.
    pub(crate) expected: Option<&'a str>,
    /// Failures, causes first.
    pub(crate) failures: &'a [Failure],
    pub(crate) not_applicable: &'a [String],
    pub(crate) not_judged: &'a [String],
    pub(crate) stalled: Option<Stalls>,
    /// What is so besides.
    pub(crate) notes: Vec<Note>,
    /// Counts of what happened, of what was played.
    pub(crate) summary: Option<String>,
    pub(crate) client: Option<&'a PlayedClient>,
}

/// Something that is so besides the failures.
pub(crate) struct Note {
    pub(crate) label: &'static str,
    pub(crate) text: String,
}

impl fmt::Display for Note {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.label, self.text)
    }
}

impl<'a> View<'a> {
    /// Nothing but a verdict and its reason.
    pub(crate) fn bare(verdict: Verdict, why: Option<String>) -> Self {
        Self {
            verdict,
            why,
            about: None,
            expected: None,
            failures: &[],
            not_applicable: &[],
            not_judged: &[],
            stalled: None,
            notes: Vec::new(),
            summary: None,
            client: None,
        }
    }

    /// So many cases that were not played. `is_clean` says that all others passed.
    pub(crate) fn unplayed(count: usize, is_clean: bool) -> Self {
        let what = match count {
            1 => "this was".to_owned(),
            count => format!("{count} cases were"),
        };
        let reason = format!("the run ended before {what} played");
        Self::bare(Verdict::of_unplayed(is_clean), Some(reason))
    }

    /// `is_live` says that there is a real client.
    pub(crate) fn new(scenario: &'a Scenario, result: &'a CaseResult, is_live: bool) -> Self {
        let mut view = Self::bare(result.verdict, result.why.clone());
        let Some(played) = &result.played else {
            return view;
        };
        let outcome = &played.outcome;
        view.client = played.client.as_ref();
        view.summary = Some(summary(outcome));
        if !outcome.failures.is_empty() {
            view.failures = &outcome.failures;
            view.about = scenario.description.as_deref();
            view.expected = Some(scenario.good_client.as_str());
        }
        view.not_applicable = &outcome.not_applicable;
        view.not_judged = &outcome.not_judged;
        view.stalled = played.stalled;
        view.add_notes("not applicable", view.not_applicable.iter().cloned());
        if let Some(client) = view.client {
            let outside = client.outside.iter();
            let addresses = client.random_addresses.then_some("addresses are random");
            view.add_notes(
                "not repeatable",
                outside
                    .map(|what| format!("it waited for {what}"))
                    .chain(addresses.map(str::to_owned)),
            );
            view.add_notes("refused", client.refused.iter().map(String::clone));
            // A client that passes did without them, and may leave helpers behind.
            let failed = |names: &[String]| {
                let names = Some(names.join(", ")).filter(|names| !names.is_empty());
                names.filter(|_| !outcome.passed).into_iter()
            };
            view.add_notes(
                "missing",
                failed(&client.missing).map(|calls| {
                    format!("lockstep answers {calls} with ENOSYS, as an older system does")
                }),
            );
            let left = failed(&client.left);
            let left = left
                .map(|names| format!("{names} still ran when the client ended, and ended with it"));
            view.add_notes("left behind", left);
            let lost = Some(client.lost).filter(|lost| *lost > 0);
            view.add_notes(
                "output",
                lost.into_iter().map(|lost| {
                    format!(
                        "{lost} bytes of it are lost: the client has emptied the file, as \
                         `> /dev/stderr` does and `>&2` does not, or the disk is full"
                    )
                }),
            );
        }
        for device in &outcome.devices {
            let name = &device.name;
            let damage = device.report.damage();
            let words = damage
                .map(|(code, tally)| format!("{name}: {}", counted(code, tally.count, tally)));
            view.add_notes("damage", words);
            // What a scripted client does wrong, its file says.
            let errors = device.report.client_errors();
            let errors = errors.filter(|_| is_live || !outcome.passed);
            let words = errors.map(|(code, tally)| {
                format!("{name}: {}", counted(code, tally.client_errors, tally))
            });
            view.add_notes("client report", words);
        }
        view.add_notes("not judged", view.not_judged.iter().cloned());
        view.add_notes("stalled", view.stalled.and_then(stall).into_iter());
        view
    }

    /// Reason for a verdict other than `passed`, in a line: the first cause, if there are several.
    pub(crate) fn reason(&self) -> Option<String> {
        let failure = self.failures.first().map(ToString::to_string);
        let first = failure.or_else(|| self.not_applicable.first().cloned());
        self.why.clone().or(first)
    }

    pub(crate) fn add_notes(&mut self, label: &'static str, texts: impl Iterator<Item = String>) {
        self.notes.extend(texts.map(|text| Note { label, text }));
    }

    /// Failures by whether they are causes, or consequences of these.
    pub(crate) fn causes(&self) -> (&'a [Failure], &'a [Failure]) {
        let is_cause = |failure: &Failure| failure.kind < FailureKind::Consequence;
        let causes = self.failures.partition_point(is_cause);
        match causes {
            0 => (self.failures, &[]),
            causes => self.failures.split_at(causes),
        }
    }

    /// What stands above failures, in lines.
    pub(crate) fn premises(&self) -> impl Iterator<Item = String> {
        let premises = [("about", self.about), ("expected", self.expected)];
        premises.into_iter().filter_map(|(label, text)| {
            let words: Vec<&str> = text?.split_whitespace().collect();
            Some(format!("{label}: {}", words.join(" ")))
        })
    }

    /// The failures in lines, without what happened before them.
    pub(crate) fn lines(&self) -> Vec<String> {
        let (causes, consequences) = self.causes();
        let causes = causes.iter().map(ToString::to_string);
        let consequences = consequences
            .iter()
            .map(|one| format!("in consequence: {one}"));
        self.premises().chain(causes).chain(consequences).collect()
    }
}

/// What failed, without numbers outside of conditions, so that the same failure of two seeds has the same.
pub(crate) fn signature(what: &str) -> String {
    let mut parts: Vec<String> = what.split('`').map(str::to_owned).collect();
    for part in parts.iter_mut().step_by(2) {
        while let Some(from) = part.find(|c: char| c.is_ascii_digit()) {
            let number = part[from..].find(|c: char| !c.is_ascii_digit() && c != '.');
            let to = number.map_or(part.len(), |length| from + length);
            part.replace_range(from..to, "#");
        }
    }
    parts.join("`")
}

/// Counts of an outcome: `3 of 3 faults hit, 214 requests, 9.3 m`.
fn summary(outcome: &Outcome) -> String {
    let faults = outcome.faults.iter();
    let armed: u64 = faults.clone().map(|fault| fault.armed).sum();
    let hit: u64 = faults.map(|fault| fault.hit).sum();
    let devices = outcome.devices.iter();
    let requests: u64 = devices.clone().map(|device| device.report.requests).sum();
    let distance: f64 = devices.map(|device| device.distance_m).sum();
    let plural = |count: u64| if count == 1 { "" } else { "s" };
    let faults = match armed {
        0 => String::new(),
        armed => format!("{hit} of {armed} fault{} hit, ", plural(armed)),
    };
    format!(
        "{faults}{requests} request{}, {distance:.1} m",
        plural(requests)
    )
}

/// For how long the machine stalled the run, in words; `None` if it did not.
fn stall(stalled: Stalls) -> Option<String> {
    let seconds = |time: std::time::Duration| time.as_secs_f64();
    (stalled.times > 0).then(|| {
        format!(
            "the machine was busy: simulated time stood still for {:.2} s in all, {:.2} s at the \
             longest, while the client's clock went on",
            seconds(stalled.total),
            seconds(stalled.longest)
        )
    })
}

#[cfg(test)]
mod tests;
