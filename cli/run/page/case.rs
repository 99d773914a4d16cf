//! One case in a report.

use std::sync::atomic::AtomicBool;
use std::time::Instant;

use maud::{Markup, html};
use rigsim_core::SimTime;
use rigsim_core::device::Devices;
use rigsim_runner::Outcome;
use rigsim_runner::run::{Context, Failure as Failed};

use super::super::case::{Case, CaseResult, Played};
use super::super::view::{Note, View};
use super::frames::{Frames, Wanted, Window};
use super::map;
use super::plots;
use crate::recording;
use crate::visible::lines as readable;

/// Number of looks that make the path of a case that passed.
const FEW: u32 = 96;
/// Number of looks that make the plots of one that failed.
const MANY: u32 = 480;
/// Time before and after a failure that its plots show, s.
const BEFORE: f64 = 4.0;
const AFTER: f64 = 2.0;
/// Time after which a fault is no longer what a failure is about, s.
const LONG_AGO: f64 = 20.0;
/// Part of a run that is as good as all of it.
const MOSTLY: f64 = 0.6;
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
    result: &CaseResult,
    played: &Played,
    detail: Detail,
    stop: &AtomicBool,
) -> Markup {
    let outcome = &played.outcome;
    let whole = Window {
        from: 0.0,
        to: outcome.ended_at.as_secs_f64(),
    };
    let focus = focus(outcome, whole);
    let wanted = Wanted {
        ended_at: outcome.ended_at,
        failed_at: outcome.failures.first().map(|failure| failure.at),
        looks: if detail == Detail::Full { MANY } else { FEW },
        focus: focus.filter(|_| detail == Detail::Full),
        values: detail == Detail::Full,
        // As long as the run itself was allowed to take.
        patience: Instant::now().checked_add(case.allowed),
        stop,
    };
    let frames = (detail != Detail::Words).then(|| frames(devices, case, wanted));
    let title = readable(&outcome.title);
    let view = View::new(&case.loaded.scenario, result, case.is_live());
    html! {
        div.overview {
            @if let Some(Ok(frames)) = &frames {
                figure.world {
                    (map::map(frames, &format!("{title}, from above")))
                    figcaption { (map::legend(frames)) }
                }
            }
            div {
                @if let Some(why) = &result.why { p { (readable(why)) } }
                @if !view.failures.is_empty() { (failures(&view, outcome.more_failures, detail)) }
                @if let Some(expected) = view.expected { p { b { "Expected: " } (readable(expected)) } }
                @if let Some(text) = &case.loaded.scenario.description { p.about { (readable(text)) } }
                (faults(outcome))
                (margins(outcome))
                @for one in &view.notes { (render_note(one)) }
                @if let Some(Err(why)) = &frames {
                    p.note { "No picture: the recording could not be played again, " (readable(why)) }
                }
                p.about { "Again: " code { (readable(&case.command())) } }
            }
        }
        @if let Some(Ok(frames)) = frames.as_ref().filter(|_| detail == Detail::Full) {
            @match focus {
                Some(focus) => {
                    (plots::plots(frames, focus))
                    (traffic(frames))
                    details { summary { "The whole run over time" } (plots::plots(frames, whole)) }
                }
                None => { (plots::plots(frames, whole)) (traffic(frames)) }
            }
            @if let Some(client) = &played.client { (output(&client.output)) }
        }
        @if detail == Detail::Words {
            p.note { "Too many cases have a picture already; played alone, this one has one, too." }
        }
    }
}

/// The times around a failure, from before the last fault if that is not long ago; `None` if that is
/// nearly all.
fn focus(outcome: &Outcome, whole: Window) -> Option<Window> {
    let at = outcome.failures.first()?.at.as_secs_f64();
    let begun = outcome.faults.iter().map(|fault| fault.from.as_secs_f64());
    let begun = begun.filter(|from| (at - LONG_AGO..=at).contains(from));
    let from = begun.reduce(f64::max).unwrap_or(at).min(at - BEFORE) - BEFORE / 4.0;
    let focus = Window {
        from: from.max(0.0),
        to: (at + AFTER).min(whole.to),
    };
    (focus.to - focus.from < MOSTLY * whole.to).then_some(focus)
}

/// The run again, as far as it is shown; or why it could not be played again.
fn frames<'a>(devices: Devices, case: &Case<'_>, wanted: Wanted<'a>) -> Result<Frames<'a>, String> {
    let Some(trace) = case.recording() else {
        return Err("there is none".to_owned());
    };
    match recording::view(devices, &trace, |run| Ok(Frames::new(run, wanted))) {
        Ok((frames, Ok(()))) if frames.is_cut.get() => Err("which took too long".to_owned()),
        Ok((frames, Ok(()))) => Ok(frames),
        Ok((_, Err(why))) => Err(why.to_string()),
        Err(failure) => Err(format!("{:#}", failure.error)),
    }
}

fn failures(view: &View<'_>, more: u64, detail: Detail) -> Markup {
    let (causes, consequences) = view.causes();
    let one = |failure: &Failed| {
        html! {
            b { (seconds(failure.at)) }
            @if let Some(step) = &failure.step { " “" (readable(step)) "”" }
            ": " (readable(&failure.what))
        }
    };
    html! {
        ul.failures {
            @for (index, failure) in causes.iter().enumerate() {
                li {
                    (one(failure))
                    // The traffic around the first is shown with the plots.
                    @if detail == Detail::Full { (context(&failure.context, index > 0)) }
                }
            }
        }
        @if !consequences.is_empty() { p.head { "In consequence" } }
        ul { @for failure in consequences { li { (one(failure)) } } }
        @if more > 0 { p.note { "and " (more) " more" } }
    }
}

/// Circumstances of a failure and, if it is wanted, what came before it.
fn context(context: &Context, wants_before: bool) -> Markup {
    let before = context.before.iter().filter(|_| wants_before);
    let before: Vec<&String> = before.collect();
    html! {
        @for fault in &context.armed { p.note { "armed then: " (readable(fault)) } }
        @for action in &context.in_effect { p.note { "in effect then: " (readable(action)) } }
        @if !before.is_empty() {
            details {
                summary { "What happened before, since the failure above" }
                pre { @for line in before { (readable(line)) "\n" } }
            }
        }
    }
}

pub(super) fn render_note(note: &Note) -> Markup {
    html! { p.note { (readable(&note.to_string())) } }
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

/// How near each rule came to being broken, the nearest first.
fn margins(outcome: &Outcome) -> Markup {
    let mut margins: Vec<_> = outcome.margins.iter().collect();
    margins.sort_by(|one, other| one.margin.total_cmp(&other.margin));
    html! {
        @if !margins.is_empty() {
            details {
                summary { "Margins of the rules" }
                table.faults {
                    thead { tr { th { "margin" } th { "at" } th { "rule" } } }
                    @for rule in margins {
                        tr {
                            td.number { (format!("{:.4}", rule.margin)) }
                            td.number { (seconds(rule.at)) }
                            td { (readable(&rule.what)) }
                        }
                    }
                }
            }
        }
    }
}

fn traffic(frames: &Frames) -> Markup {
    html! {
        @let lines = frames.lines();
        @if !lines.is_empty() {
            details {
                summary {
                    "Traffic and events around " (format!("{:.2} s", frames.failed_at().unwrap_or(0.0)))
                }
                pre { @for line in lines { (readable(line)) "\n" } }
                @if frames.more_lines > 0 { p.note { (frames.more_lines) " lines more" } }
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
