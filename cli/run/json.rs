//! Outcomes as JSON: the report of a scenario, and the verdict of one that was served.

use anyhow::Context as _;
use rigsim_runner::Scenario;
use serde_json::{Value, json};

use crate::exit::Failure;
use crate::summary::{client_report, device_json};
use crate::supervise::ClientEnd;
use crate::visible;

use super::case::{Case, CaseResult, Played};
use super::view::View;

/// Writes it beside the trace, if anything is to be written.
pub(crate) fn write(case: &Case<'_>, result: &CaseResult) -> Result<(), Failure> {
    let Some(played) = &result.played else {
        return Ok(());
    };
    let Some(file) = case.report_file().map_err(Failure::system)? else {
        return Ok(());
    };
    let mut report = verdict(&case.loaded.scenario, result);
    report["scenario"] = json!(visible::path_value(&case.loaded.path));
    let given = case.loaded.parameters.iter();
    report["parameters"] = given
        .map(|(name, value)| (name.clone(), json!(value)))
        .collect();
    report["version"] = json!(env!("CARGO_PKG_VERSION"));
    report["took_s"] = json!(played.took.as_secs_f64());
    report["time"] = json!(case.time_word());
    report["command"] = json!(case.command());
    let trace = case.file("trace.jsonl");
    report["trace"] = json!(trace.map(|path| visible::path_value(&path)));
    report["client"] = client(case, played);
    let devices = played.outcome.devices.iter();
    let devices =
        devices.map(|device| device_json(&device.name, &device.report, device.distance_m));
    report["devices"] = devices.collect();
    file.write(format!("{report:#}\n").as_bytes())
        .with_context(|| format!("cannot write the report of {}", case.name()))
        .map_err(Failure::system)
}

fn client(case: &Case<'_>, played: &Played) -> Value {
    let Some(client) = &played.client else {
        return Value::Null;
    };
    let (exit_code, signal) = match client.end {
        ClientEnd::Exited(code) => (Some(code), None),
        ClientEnd::Killed(signal) => (None, Some(signal)),
        ClientEnd::NotStarted(_) => (None, None),
    };
    json!({
        "exit_code": exit_code,
        "signal": signal,
        "stopped": client.stopped,
        "output": case.file("client.log").map(|path| visible::path_value(&path)),
        "outside": client.outside,
        "random_addresses": client.random_addresses,
        "refused": client.refused,
        "missing": client.missing,
        "left": client.left,
    })
}

/// A result, without what was only counted.
pub(crate) fn verdict(scenario: &Scenario, result: &CaseResult) -> Value {
    let view = View::new(scenario, result, true);
    let mut value = json!({
        "code": "verdict",
        "verdict": view.verdict.as_str(),
        "why": view.why,
        "title": scenario.title,
        "description": scenario.description,
        "good_client": scenario.good_client,
    });
    let Some(played) = &result.played else {
        return value;
    };
    let outcome = &played.outcome;
    let devices = outcome.devices.iter();
    let report = devices.flat_map(|device| {
        client_report(&device.report).map(|mut error| {
            error["device"] = json!(device.name);
            error
        })
    });
    value["client_report"] = report.collect();
    value["seed"] = json!(outcome.seed);
    value["time_s"] = json!(outcome.ended_at.as_secs_f64());
    value["failures"] = json!(view.failures);
    value["more_failures"] = json!(outcome.more_failures);
    value["faults"] = json!(outcome.faults);
    let first = view.failures.first();
    value["armed"] = json!(first.map_or(&[][..], |failure| &failure.context.armed));
    value["margins"] = json!(outcome.margins);
    value["not_judged"] = json!(view.not_judged);
    value["not_applicable"] = json!(view.not_applicable);
    value["stalled"] = view.stalled.map_or(Value::Null, |stalled| {
        json!({
            "times": stalled.times,
            "total_s": stalled.total.as_secs_f64(),
            "longest_s": stalled.longest.as_secs_f64(),
        })
    });
    value
}
