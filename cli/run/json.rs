//! Outcomes as JSON: the report of a scenario, and the verdict of one that was served.

use anyhow::Context as _;
use rigsim_core::event::Hex;
use rigsim_runner::Scenario;
use serde_json::{Value, json};

use crate::exit::Failure;
use crate::summary::events_json;
use crate::supervise::ClientEnd;
use crate::visible;

use super::case::{Case, CaseResult, Played};

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
    let devices = played.outcome.devices.iter().map(|device| {
        json!({
            "device": device.name,
            "requests": device.report.requests,
            "replies": device.report.replies,
            "distance_m": device.distance_m,
            "events": events_json(&device.report),
        })
    });
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
    let mut value = json!({
        "code": "verdict",
        "verdict": result.verdict.word(),
        "why": result.why,
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
        device.report.client_errors().map(|(code, tally)| {
            json!({
                "device": device.name,
                "code": code,
                "count": tally.client_errors,
                "first_s": tally.first_at.as_secs_f64(),
                "first": tally.first,
                "bytes": tally.bytes.as_ref().map(|bytes| Hex(bytes).to_string()),
            })
        })
    });
    value["client_report"] = report.collect();
    value["seed"] = json!(outcome.seed);
    value["time_s"] = json!(outcome.ended_at.as_secs_f64());
    value["failures"] = json!(outcome.failures);
    value["more_failures"] = json!(outcome.more_failures);
    value["faults"] = json!(outcome.faults);
    let first = outcome.failures.first();
    value["armed"] = json!(first.map_or(&[][..], |failure| &failure.context.armed));
    value["margins"] = json!(outcome.margins);
    value["not_judged"] = json!(outcome.not_judged);
    value["not_applicable"] = json!(outcome.not_applicable);
    value["stalled"] = played.stalled.map_or(Value::Null, |stalled| {
        json!({
            "times": stalled.times,
            "total_s": stalled.total.as_secs_f64(),
            "longest_s": stalled.longest.as_secs_f64(),
        })
    });
    value
}
