//! The report of a scenario as JSON.

use anyhow::Context as _;
use serde_json::{Value, json};

use crate::exit::Failure;
use crate::supervise::ClientEnd;
use crate::{visible, whole_file};

use super::case::{Case, Played};
use super::tell::{machines_part_json, outcome_json};

/// Writes it beside the trace, if anything is to be written.
pub(crate) fn write(case: &Case<'_>, played: &Played) -> Result<(), Failure> {
    let Some(path) = case.file("report.json") else {
        return Ok(());
    };
    let mut report = outcome_json(&played.outcome);
    report["scenario"] = json!(visible::path_value(&case.loaded.path));
    let given = case.loaded.parameters.iter();
    report["parameters"] = given
        .map(|(name, value)| (name.clone(), json!(value)))
        .collect();
    report["version"] = json!(env!("CARGO_PKG_VERSION"));
    report["took_s"] = json!(played.took.as_secs_f64());
    report["time"] = json!(case.time_word());
    report["command"] = json!(case.command());
    report["trace"] = json!(
        case.file("trace.jsonl")
            .map(|path| visible::path_value(&path))
    );
    report["client"] = client(case, played);
    report["held_up"] = machines_part_json(played.held_up);
    report["spoilt"] = json!(played.is_spoilt);
    let devices: Vec<Value> = played
        .outcome
        .devices
        .iter()
        .map(|device| {
            json!({
                "device": device.name,
                "requests": device.report.requests,
                "replies": device.report.replies,
                "distance_m": device.distance_m,
                "events": crate::summary::events_json(&device.report),
            })
        })
        .collect();
    report["devices"] = json!(devices);
    whole_file::write(&path, format!("{report:#}\n").as_bytes())
        .with_context(|| format!("cannot write the report {}", visible::name(&path)))
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
        "refused": client.refused,
    })
}
