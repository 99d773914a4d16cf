//! Requests in the words of files.

use rigsim_control::Refusal;
use rigsim_core::event::{Event, Level, Role};
use rigsim_embed::clock::Clock;
use rigsim_runner::run::StepError;
use rigsim_runner::{Run, RunError};
use rigsim_settings::Span;
use schemars::JsonSchema;
use serde::Deserialize;
use serde_json::Value;

/// Slowest and fastest.
const SPEEDS: std::ops::RangeInclusive<f64> = 0.01..=100.0;

/// Reason for which a step is not added.
pub(super) enum Trouble {
    /// It is of no use.
    Refused(Refusal),
    /// The run cannot go on.
    Broken(RunError),
}

/// Change of how simulated time passes.
#[derive(Debug, Clone, Copy, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub(super) enum TimeChange {
    /// It stands still. Bytes of clients arrive at the instant at which it does.
    Pause,
    /// It goes on.
    Resume,
    /// It goes on for so long and then stands still; the answer comes then.
    Step(Span),
    /// Simulated seconds for each second of real time, 0.01 to 100.
    Speed(f64),
}

/// Adds a step, in the form of a scenario file; returns its index.
pub(super) fn add(run: &mut Run, step: &Value) -> Result<usize, Trouble> {
    let refused = |why: String| Trouble::Refused(Refusal::new(422, why));
    if !step.is_object() {
        return Err(refused(
            "a step is an object, as {\"fault\": {…}}".to_owned(),
        ));
    }
    if step.get("host").is_some() && run.is_live() {
        return Err(refused(
            "`host` steps are for scripted clients; here the client is a real one".to_owned(),
        ));
    }
    // By way of the text of a file, so that both say the same in the same words.
    let text = toml::to_string(step)
        .map_err(|error| refused(format!("a step has the form of a scenario file's: {error}")))?;
    run.add_step(&text).map_err(|error| match error {
        StepError::Text(error) => refused(without_places(&error.to_string())),
        StepError::Run(error) => Trouble::Broken(error),
        why => Trouble::Refused(Refusal::new(409, why.to_string())),
    })
}

/// Errors without the lines and columns of a text that no user has written.
fn without_places(errors: &str) -> String {
    let lines = errors.lines().map(|line| {
        let mut parts = line.splitn(4, ':');
        match (parts.next(), parts.next(), parts.next(), parts.next()) {
            (Some("step"), Some(_), Some(_), Some(rest)) => rest.trim_start(),
            _ => line,
        }
    });
    lines.collect::<Vec<_>>().join("\n")
}

/// Index of the step of this name.
pub(super) fn index(run: &Run, name: &str) -> Result<usize, Refusal> {
    let shown: String = name.chars().take(80).collect();
    run.step_named(name)
        .ok_or_else(|| Refusal::new(404, format!("no step is named \"{shown}\"")))
}

/// Changes how time passes; says whether the answer has to wait until it stands still.
pub(super) fn time(
    run: &mut Run,
    clock: Option<&mut Clock>,
    change: &Value,
) -> Result<bool, Refusal> {
    let read = TimeChange::deserialize(change).map_err(|error| {
        let why = format!(
            "{error}; allowed: \"pause\", \"resume\", {{\"step\": \"5 ms\"}}, {{\"speed\": 2}}"
        );
        Refusal::new(422, why)
    })?;
    let Some(clock) = clock else {
        let why = "in lockstep time is the client's: it goes on while the client waits";
        return Err(Refusal::new(409, why));
    };
    let now = run.rig().now();
    match read {
        TimeChange::Pause => clock.stop(now),
        TimeChange::Resume => clock.resume(now, None),
        TimeChange::Step(span) => clock.resume(now, Some(span.0)),
        TimeChange::Speed(speed) if SPEEDS.contains(&speed) => clock.set_speed(now, speed),
        TimeChange::Speed(speed) => {
            let why = format!("speed {speed} is out of range; allowed: 0.01 to 100");
            return Err(Refusal::new(422, why));
        }
    }
    run.record_pace(&change.to_string());
    Ok(matches!(read, TimeChange::Step(_)))
}

/// Part of an event in a log, for its colour.
pub(super) fn role(event: &Event) -> &'static str {
    match (event.kind.level(), event.kind.code().role) {
        (Level::Warning, _) => "warning",
        (Level::Traffic, Role::Request) => "request",
        (Level::Traffic, _) => "reply",
        (Level::Notice, _) => "notice",
    }
}

#[cfg(test)]
mod tests;
