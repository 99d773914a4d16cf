//! Words that are printed of scenarios.

use std::fmt::Write as _;

use rigsim_runner::Outcome;
use rigsim_runner::run::{Context, Failure};
use rigsim_settings::show_duration;

use crate::scenario_files::Loaded;
use crate::visible;

use super::case::{Case, CaseResult, PlayedClient};
use super::view::View;

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

/// Result of a case in words, in full if it failed.
pub(crate) fn result(case: &Case<'_>, result: &CaseResult) -> String {
    let view = View::new(&case.loaded.scenario, result, case.is_live());
    let Some(played) = &result.played else {
        return brief(&case.name(), &view);
    };
    let outcome = &played.outcome;
    let heading = view.verdict.heading();
    let mut text = format!("{heading:<7} {}: {}", case.name(), simulated(outcome));
    if case.is_live() {
        let (took, time) = (played.took.as_secs_f64(), case.time_word());
        let _ = write!(text, " in {took:.1} s, {time} time");
    }
    text += ")";
    if let Some(summary) = view.summary.as_ref().filter(|_| outcome.passed) {
        let _ = write!(text, ", {summary}");
        if case.repeat.is_some() {
            let _ = write!(text, ", seed {}", outcome.seed);
        }
    }
    text += &body(&view, result);
    if outcome.passed || outcome.is_skipped() && result.why.is_none() {
        return text;
    }
    if let Some(client) = view.client {
        text += &written(client);
    }
    if let Some(trace) = case.file("trace.jsonl") {
        let _ = write!(text, "\n  trace: {}", visible::name(&trace));
    }
    let _ = write!(text, "\n  again: {}", case.command());
    text
}

/// The end of what a client wrote.
pub(crate) fn written(client: &PlayedClient) -> String {
    let lines: Vec<String> = client.output.lines().map(shortened).collect();
    let mut text = match lines.is_empty() {
        true => "\n  the client wrote nothing",
        false => "\n  the last that the client wrote:",
    }
    .to_owned();
    for line in &lines[lines.len().saturating_sub(OUTPUT)..] {
        let _ = write!(text, "\n    {line}");
    }
    text
}

/// Verdict and reason, and notes below them.
pub(crate) fn brief(name: &str, view: &View<'_>) -> String {
    let (heading, name) = (view.verdict.heading(), visible::line(name));
    let reason = view.reason().unwrap_or_default();
    let mut text = format!("{heading:<7} {name}: {}", visible::line(&reason));
    for note in &view.notes {
        let _ = write!(text, "\n  {}", visible::line(&note.to_string()));
    }
    text
}

/// The verdict of a scenario that was played against whatever client came.
pub(crate) fn verdict(view: &View<'_>, result: &CaseResult) -> String {
    let heading = view.verdict.heading();
    let Some(played) = &result.played else {
        return heading;
    };
    let (simulated, seed) = (simulated(&played.outcome), played.outcome.seed);
    format!("{heading}: {simulated}, seed {seed})") + &body(view, result)
}

/// Title and time, with an open parenthesis.
fn simulated(outcome: &Outcome) -> String {
    let (title, time) = (
        visible::line(&outcome.title),
        outcome.ended_at.as_secs_f64(),
    );
    format!("{title} ({time:.1} s simulated")
}

/// What is below the first line: failures with what was expected and what happened before, and notes.
fn body(view: &View<'_>, result: &CaseResult) -> String {
    let mut text = String::new();
    let mut line = |indent: &str, line: &str| {
        let _ = write!(text, "\n{indent}{}", visible::line(line));
    };
    if let Some(why) = &result.why {
        line("  ", why);
    }
    for premise in view.premises() {
        line("  ", &premise);
    }
    let (causes, consequences) = view.causes();
    for (index, failure) in causes.iter().enumerate() {
        line("  ", &failure.to_string());
        // What is found at one instant has the same surroundings.
        let next = causes.get(index + 1);
        let shared = next.is_some_and(|next| next.at == failure.at);
        if index < CONTEXTS && !shared {
            let same = |one: &&Failure| one.at == failure.at;
            let same = causes[..=index].iter().rev().take_while(same).count();
            context(&causes[index + 1 - same..=index], &mut line);
        }
    }
    if !consequences.is_empty() {
        line("  ", "in consequence:");
    }
    for failure in consequences {
        line("    ", &failure.to_string());
    }
    let more = result
        .played
        .as_ref()
        .map(|played| played.outcome.more_failures);
    if let Some(more) = more.filter(|more| *more > 0) {
        line("  ", &format!("and {more} more"));
    }
    for note in &view.notes {
        line("  ", &note.to_string());
    }
    text
}

/// The surroundings of failures at one instant.
fn context(failures: &[Failure], line: &mut impl FnMut(&str, &str)) {
    let Some(Failure {
        context: Context {
            armed, in_effect, ..
        },
        ..
    }) = failures.last()
    else {
        return;
    };
    for fault in armed {
        line("  ", &format!("armed then: {fault}"));
    }
    for action in in_effect {
        line("  ", &format!("in effect then: {action}"));
    }
    let before = failures.iter().flat_map(|failure| &failure.context.before);
    let before: Vec<&String> = before.collect();
    if !before.is_empty() {
        line("  ", "the last that happened before:");
    }
    for recent in &before[before.len().saturating_sub(TRAFFIC)..] {
        line("    ", recent);
    }
}

/// A line that may be of any length.
pub(crate) fn shortened(line: &str) -> String {
    match line.char_indices().nth(MOST_CHARACTERS) {
        Some((end, _)) => format!("{} ({} bytes)", visible::line(&line[..end]), line.len()),
        None => visible::line(line).into_owned(),
    }
}
