//! Words that are printed of scenarios.

use std::fmt::Write as _;

use serde_json::{Value, json};
use sim_core::event::Hex;
use sim_embed::serve::HeldUp;
use sim_runner::run::Failure;
use sim_runner::{Outcome, Scenario};
use sim_settings::show_duration;

use crate::args::RunArgs;
use crate::scenario_files::Loaded;
use crate::summary::counted;
use crate::visible;

use super::case::{Case, CaseResult, Played, Verdict};

/// Number of the last lines of traffic that are shown before a failure.
const TRAFFIC: usize = 12;
/// Of how many failures what came before them is shown.
const CONTEXTS: usize = 5;
/// Number of the last lines of the client's output that are shown of a scenario that failed.
const OUTPUT: usize = 30;
/// Most characters that are shown of one of them.
const MOST_CHARACTERS: usize = 300;

/// A scenario in the list.
pub(crate) fn listed(loaded: &Loaded) -> String {
    let scenario = &loaded.scenario;
    let mut text = format!("{}: {}", loaded.name(), visible::line(&scenario.title));
    if !scenario.tags.is_empty() {
        let _ = write!(text, " [{}]", scenario.tags.join(", "));
    }
    text
}

/// Words for what would be played.
pub(crate) fn planned(case: &Case<'_>) -> String {
    let scenario = &case.loaded.scenario;
    let mut text = format!(
        "{}: {}\n  seed {}, {} simulated, {} time",
        case.name(),
        visible::line(&scenario.title),
        case.seed,
        show_duration(scenario.limit),
        case.time_word()
    );
    for (index, device) in scenario.rig.devices.iter().enumerate() {
        let _ = write!(text, "\n  device {} ({})", device.name, device.device.id);
        if scenario.is_scripted(index) {
            text += ", scripted";
        } else if case.is_live() {
            let links = scenario.rig.links().filter(|link| link.id.device == index);
            let variables: Vec<String> = links.map(|link| link.variable()).collect();
            let _ = write!(text, ", served at ${}", variables.join(" and $"));
        }
    }
    let _ = write!(text, "\n  {}", case.command());
    text
}

/// The variables of the environment in which a client finds the ports.
pub(crate) fn variables(scenario: &Scenario) -> Vec<String> {
    scenario
        .client_links()
        .map(|link| link.variable())
        .collect()
}

/// Result of a case in words, in full if it failed.
pub(crate) fn told(args: &RunArgs, case: &Case<'_>, result: &CaseResult) -> String {
    let name = case.name();
    match result {
        CaseResult::Played(played) => told_played(args, case, played, result.verdict()),
        CaseResult::BrokenOff => format!("broken off  {name}"),
        CaseResult::Broken(why) => format!("BROKEN  {name}: {}", visible::line(why)),
    }
}

fn told_played(args: &RunArgs, case: &Case<'_>, played: &Played, verdict: Verdict) -> String {
    let outcome = &played.outcome;
    let word = match verdict {
        Verdict::Passed => "ok    ",
        Verdict::Spoilt => "SPOILT",
        _ => "FAILED",
    };
    let mut text = format!(
        "{word}  {}: {} ({:.1} s simulated",
        case.name(),
        visible::line(&outcome.title),
        outcome.ended_at.as_secs_f64()
    );
    if case.is_live() {
        let _ = write!(
            text,
            " in {:.1} s, {} time",
            played.took.as_secs_f64(),
            case.time_word()
        );
    }
    text += ")";
    if outcome.passed {
        let _ = write!(text, ", {}", worth(outcome));
    }
    if args.repeat > 1 && outcome.passed {
        let _ = write!(text, ", seed {}", outcome.seed);
    }
    for what in played.client.iter().flat_map(|client| &client.outside) {
        let _ = write!(text, "\n  not repeatable: it waited for {what}");
    }
    for what in played.client.iter().flat_map(|client| &client.refused) {
        let _ = write!(text, "\n  refused: {what}");
    }
    for device in &outcome.devices {
        for (code, tally) in device.report.damage() {
            let told = counted(code, tally.count, tally);
            let _ = write!(text, "\n  damage: {}: {told}", device.name);
        }
    }
    // What a scripted client does wrong, it was told to do.
    if case.is_live() || !outcome.passed {
        for line in client_report(outcome) {
            let _ = write!(text, "\n  client report: {}", visible::line(&line));
        }
    }
    text += &not_judged(outcome);
    if let Some(held_up) = played.held_up.and_then(machines_part) {
        let _ = write!(text, "\n  {held_up}");
    }
    if outcome.passed {
        return text;
    }
    if played.is_spoilt {
        text +=
            "\n  what follows may be the machine's doing (--max-hold-up), also in a second try:";
    }
    text += &failures(outcome);
    if let Some(client) = &played.client {
        let lines: Vec<String> = client.output.lines().map(shortened).collect();
        if lines.is_empty() {
            text += "\n  the client wrote nothing";
        } else {
            text += "\n  the last that the client wrote:";
        }
        for line in last(&lines, OUTPUT) {
            let _ = write!(text, "\n    {line}");
        }
    }
    if let Some(trace) = case.file("trace.jsonl") {
        let _ = write!(text, "\n  trace: {}", visible::name(&trace));
    }
    let _ = write!(text, "\n  again: {}", case.command());
    text
}

fn last(lines: &[String], count: usize) -> &[String] {
    &lines[lines.len().saturating_sub(count)..]
}

/// A line that may be of any length.
pub(crate) fn shortened(line: &str) -> String {
    match line.char_indices().nth(MOST_CHARACTERS) {
        Some((end, _)) => format!("{} ({} bytes)", visible::line(&line[..end]), line.len()),
        None => visible::line(line).into_owned(),
    }
}

fn failures(outcome: &Outcome) -> String {
    let mut text = String::new();
    for (index, failure) in outcome.failures.iter().enumerate() {
        let _ = write!(text, "\n  {}", visible::line(&failure.to_string()));
        // What is found at one instant has the same surroundings.
        let next = outcome.failures.get(index + 1);
        let told = next.is_some_and(|next| next.at == failure.at);
        if index < CONTEXTS && !told {
            text += &context(&outcome.failures[..=index]);
        }
    }
    if outcome.more_failures > 0 {
        let _ = write!(text, "\n  and {} more", outcome.more_failures);
    }
    text
}

/// The surroundings of the last of these failures, which it may share with others before it.
fn context(failures: &[Failure]) -> String {
    let mut text = String::new();
    let Some(Failure { at, context, .. }) = failures.last() else {
        return text;
    };
    for fault in &context.armed {
        let _ = write!(text, "\n  armed then: {}", visible::line(fault));
    }
    for deed in &context.in_effect {
        let _ = write!(text, "\n  in effect then: {}", visible::line(deed));
    }
    let same = failures
        .iter()
        .rev()
        .take_while(|failure| failure.at == *at);
    let before: Vec<&[String]> = same
        .map(|failure| failure.context.before.as_slice())
        .collect();
    let before: Vec<&String> = before.into_iter().rev().flatten().collect();
    if !before.is_empty() {
        text += "\n  the last that happened before:";
    }
    for line in &before[before.len().saturating_sub(TRAFFIC)..] {
        let _ = write!(text, "\n    {}", visible::line(line));
    }
    text
}

/// Rules and responses that had no occasion to be broken.
pub(crate) fn not_judged(outcome: &Outcome) -> String {
    let line = |what: &String| format!("\n  not judged: {}", visible::line(what));
    outcome.not_judged.iter().map(line).collect()
}

/// Worth of an outcome: `3 of 3 faults hit, 214 requests, 9.3 m`.
pub(crate) fn worth(outcome: &Outcome) -> String {
    let faults = outcome.faults.iter();
    let armed: u64 = faults.clone().map(|fault| fault.armed).sum();
    let hit: u64 = faults.map(|fault| fault.hit).sum();
    let devices = outcome.devices.iter();
    let requests: u64 = devices.clone().map(|device| device.report.requests).sum();
    let distance: f64 = devices.map(|device| device.distance_m).sum();
    let mut words = Vec::new();
    if armed > 0 {
        let plural = if armed == 1 { "" } else { "s" };
        words.push(format!("{hit} of {armed} fault{plural} hit"));
    }
    let plural = if requests == 1 { "" } else { "s" };
    words.push(format!("{requests} request{plural}"));
    words.push(format!("{distance:.1} m"));
    words.join(", ")
}

/// The client report for people: a line for each kind.
pub(crate) fn client_report(outcome: &Outcome) -> Vec<String> {
    let mut lines = Vec::new();
    for device in &outcome.devices {
        for (code, tally) in device.report.held_against_client() {
            let told = counted(code, tally.held_against_client, tally);
            lines.push(format!("{}: {told}", device.name));
        }
    }
    lines
}

/// For how long the machine held a run up, in words; `None` if it did not.
pub(crate) fn machines_part(held_up: HeldUp) -> Option<String> {
    let HeldUp {
        times,
        total,
        longest,
    } = held_up;
    (times > 0).then(|| {
        format!(
            "the machine was busy: simulated time stood still for {:.2} s in all, {:.2} s at the \
             longest, while the client's clock went on",
            total.as_secs_f64(),
            longest.as_secs_f64()
        )
    })
}

/// The same for programs; null for a run in simulated time.
pub(crate) fn machines_part_json(held_up: Option<HeldUp>) -> Value {
    held_up.map_or(Value::Null, |held_up| {
        json!({
            "times": held_up.times,
            "total_s": held_up.total.as_secs_f64(),
            "longest_s": held_up.longest.as_secs_f64(),
        })
    })
}

/// The verdict of a scenario that was played against whatever client came, for people. `is_spoilt` says
/// that the machine is to blame.
pub(crate) fn verdict_text(outcome: &Outcome, held_up: HeldUp, is_spoilt: bool) -> String {
    let word = match (outcome.passed, is_spoilt) {
        (true, _) => "passed",
        (false, true) => "SPOILT",
        (false, false) => "FAILED",
    };
    let time = outcome.ended_at.as_secs_f64();
    let mut text = format!(
        "{word}: {} ({time:.1} s simulated, seed {})",
        visible::line(&outcome.title),
        outcome.seed,
    );
    if let Some(held_up) = machines_part(held_up) {
        let _ = write!(text, "\n  {held_up}");
    }
    if is_spoilt {
        text += "\n  what follows may be the machine's doing (--max-hold-up):";
    }
    text + &not_judged(outcome) + &failures(outcome)
}

/// The same for programs.
pub(crate) fn verdict_json(outcome: &Outcome, held_up: HeldUp, is_spoilt: bool) -> Value {
    let mut value = outcome_json(outcome);
    value["code"] = json!("verdict");
    value["held_up"] = machines_part_json(Some(held_up));
    value["spoilt"] = json!(is_spoilt);
    value
}

/// An outcome for programs, without what was only counted.
pub(crate) fn outcome_json(outcome: &Outcome) -> Value {
    let report: Vec<Value> = outcome
        .devices
        .iter()
        .flat_map(|device| {
            device.report.held_against_client().map(|(code, tally)| {
                json!({
                    "device": device.name,
                    "code": code,
                    "count": tally.held_against_client,
                    "first_s": tally.first_at.as_secs_f64(),
                    "first": tally.first,
                    "bytes": tally.bytes.as_ref().map(|bytes| Hex(bytes).to_string()),
                })
            })
        })
        .collect();
    json!({
        "title": outcome.title,
        "passed": outcome.passed,
        "seed": outcome.seed,
        "time_s": outcome.ended_at.as_secs_f64(),
        "failures": outcome.failures,
        "more_failures": outcome.more_failures,
        "faults": outcome.faults,
        "armed": outcome.failures.first().map_or(&[][..], |failure| &failure.context.armed),
        "not_judged": outcome.not_judged,
        "client_report": report,
    })
}
