//! One case in a report.

use std::sync::atomic::AtomicBool;
use std::time::Instant;

use maud::{Markup, html};
use sim_core::SimTime;
use sim_core::device::Devices;
use sim_runner::Outcome;
use sim_runner::run::Context;

use super::film::{Film, Wanted};
use super::{map, plots};
use crate::exit::Failure;
use crate::recording;
use crate::run::{Case, PlayedCase, client_report};
use crate::visible::lines as readable;

/// Number of looks that make the way of a case that passed.
const FEW: u32 = 96;
/// Number of looks that make the plots of one that failed.
const MANY: u32 = 480;
/// Most lines that are shown of what the client wrote.
const MOST_OUTPUT: usize = 200;

/// Detail in which a case is shown.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Detail {
    /// The verdict alone.
    Words,
    /// The map as well.
    Map,
    /// The plots and the traffic as well.
    Full,
}

/// Shows a case.
pub(super) fn shown(
    devices: Devices,
    case: &Case<'_>,
    played: &PlayedCase,
    detail: Detail,
    stop: &AtomicBool,
) -> Result<Markup, Failure> {
    let outcome = &played.outcome;
    let film = match detail {
        Detail::Words => None,
        Detail::Map => Some(film(devices, case, outcome, stop, false)?),
        Detail::Full => Some(film(devices, case, outcome, stop, true)?),
    };
    let title = readable(&outcome.title);
    let inside = html! {
        p.about { code { (readable(&case.command())) } }
        @if case.is_live() { p.about { "The client had " (case.time_word()) " time." } }
        @if !outcome.failures.is_empty() { (failures(outcome, detail)) }
        @if let Some(Ok(film)) = &film {
            figure.world {
                (map::map(film, &format!("{title}, from above")))
                figcaption { (map::legend(film)) }
            }
        }
        @if let Some(Err(why)) = &film {
            p.note { "No picture: the recording could not be played again, " (readable(why)) }
        }
        (faults(outcome))
        @for what in &outcome.not_judged { p.note { "Not judged: " (readable(what)) } }
        (report(outcome))
        @if let Some(Ok(film)) = film.as_ref().filter(|_| detail == Detail::Full) {
            (plots::plots(film).map_err(Failure::system)?)
            (traffic(film))
            @if let Some(client) = &played.client { (output(&client.output)) }
        }
        @if detail == Detail::Words {
            p.note { "Too many cases have a picture already; played alone, this one has one, too." }
        }
    };
    Ok(inside)
}

/// The run again, as far as it is shown; or why it could not be played again.
fn film<'a>(
    devices: Devices,
    case: &Case<'_>,
    outcome: &Outcome,
    stop: &'a AtomicBool,
    full: bool,
) -> Result<Result<Film<'a>, String>, Failure> {
    let wanted = Wanted {
        ended_at: outcome.ended_at,
        failed_at: outcome.failures.first().map(|failure| failure.at),
        looks: if full { MANY } else { FEW },
        values: full,
        // As long as the run itself was allowed to take.
        patience: Instant::now().checked_add(case.allowed),
        stop,
    };
    let Some(trace) = case.recording() else {
        return Ok(Err("there is none".to_owned()));
    };
    match recording::view(devices, &trace, |run| Ok(Film::new(run, wanted))) {
        Ok((film, Ok(()))) if film.is_cut.get() => Ok(Err("which took too long".to_owned())),
        Ok((film, Ok(()))) => Ok(Ok(film)),
        Ok((_, Err(why))) => Ok(Err(why.to_string())),
        Err(failure) => Ok(Err(format!("{:#}", failure.error))),
    }
}

fn failures(outcome: &Outcome, detail: Detail) -> Markup {
    html! {
        ul.failures {
            @for (index, failure) in outcome.failures.iter().enumerate() {
                li {
                    b { (seconds(failure.at)) }
                    @if let Some(step) = &failure.step { " “" (readable(step)) "”" }
                    ": " (readable(&failure.what))
                    // The traffic around the first is shown with the plots.
                    @if detail == Detail::Full { (context(&failure.context, index > 0)) }
                }
            }
            @if outcome.more_failures > 0 { li { "and " (outcome.more_failures) " more" } }
        }
    }
}

/// Circumstances of a failure and, if it is wanted, what came before it.
fn context(context: &Context, wants_before: bool) -> Markup {
    let before = context.before.iter().filter(|_| wants_before);
    let before: Vec<&String> = before.collect();
    html! {
        @for fault in &context.armed { p.note { "armed then: " (readable(fault)) } }
        @for deed in &context.in_effect { p.note { "in effect then: " (readable(deed)) } }
        @if !before.is_empty() {
            details {
                summary { "What happened before, since the failure above" }
                pre { @for line in before { (readable(line)) "\n" } }
            }
        }
    }
}

fn seconds(at: SimTime) -> String {
    format!("{:.3} s", at.as_secs_f64())
}

fn faults(outcome: &Outcome) -> Markup {
    html! {
        @if !outcome.faults.is_empty() {
            table.faults {
                thead { tr { th { "fault" } th { "step" } th { "armed" } th { "hit" } } }
                @for fault in &outcome.faults {
                    tr {
                        td { (fault.id) }
                        td { (readable(&fault.step)) }
                        td.number { (fault.armed) }
                        td.number { (fault.hit) @if fault.hits > fault.hit { " (" (fault.hits) "×)" } }
                    }
                }
            }
        }
    }
}

fn report(outcome: &Outcome) -> Markup {
    let lines = client_report(outcome);
    html! {
        @if !lines.is_empty() {
            p.head { "What the client did that is forbidden or risky" }
            ul { @for line in lines { li { (readable(&line)) } } }
        }
    }
}

fn traffic(film: &Film) -> Markup {
    html! {
        @let lines = film.lines();
        @if !lines.is_empty() {
            details {
                summary {
                    "Traffic and events around " (format!("{:.2} s", film.failed_at().unwrap_or(0.0)))
                }
                pre { @for line in lines { (readable(line)) "\n" } }
                @if film.more_lines > 0 { p.note { (film.more_lines) " lines more" } }
            }
        }
    }
}

fn output(text: &str) -> Markup {
    let lines: Vec<&str> = text.lines().collect();
    let last = &lines[lines.len().saturating_sub(MOST_OUTPUT)..];
    html! {
        @if !last.is_empty() {
            details {
                summary { "What the client wrote last" }
                pre { @for line in last { (readable(line)) "\n" } }
            }
        }
    }
}
