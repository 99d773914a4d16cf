//! What is printed at the end of a run.

use std::fmt::Write as _;

use serde_json::{Value, json};
use sim_core::SimTime;
use sim_core::event::Hex;
use sim_core::report::Report;

/// One device's part of the summary.
pub(crate) struct DeviceSummary<'a> {
    pub(crate) name: &'a str,
    pub(crate) report: &'a Report,
    pub(crate) distance_m: f64,
}

/// For people.
pub(crate) fn text(now: SimTime, devices: &[DeviceSummary<'_>]) -> String {
    let mut text = format!("summary after {:.1} s of simulated time", now.as_secs_f64());
    for DeviceSummary {
        name,
        report,
        distance_m,
    } in devices
    {
        let Report {
            requests,
            replies,
            events,
            ..
        } = report;
        // Writing to a string cannot fail.
        let _ = write!(
            text,
            "\n  {name}: {requests} requests, {replies} replies, {distance_m:.2} m driven"
        );
        let other: Vec<String> = events
            .iter()
            .filter(|(_, tally)| tally.count > tally.client_faults)
            .map(|(code, tally)| format!("{code} {}", tally.count - tally.client_faults))
            .collect();
        if !other.is_empty() {
            let _ = write!(text, "\n    events: {}", other.join(", "));
        }
        let mut faults = report.client_faults().peekable();
        if faults.peek().is_none() {
            let _ = write!(
                text,
                "\n    the client did nothing that the protocol forbids"
            );
        } else {
            let _ = write!(
                text,
                "\n    what the client did that is forbidden or risky:"
            );
        }
        for (code, tally) in faults {
            let _ = write!(
                text,
                "\n      {code} {}x, first at {} s: {}",
                tally.client_faults, tally.first_at, tally.first
            );
        }
    }
    text
}

/// For programs.
pub(crate) fn json(now: SimTime, devices: &[DeviceSummary<'_>]) -> Value {
    let devices: Vec<Value> = devices
        .iter()
        .map(
            |DeviceSummary {
                 name,
                 report,
                 distance_m,
             }| {
                let events: Vec<Value> = report
                    .events
                    .iter()
                    .map(|(code, tally)| {
                        json!({
                            "code": code,
                            "count": tally.count,
                            "first_s": tally.first_at.as_secs_f64(),
                            "first": tally.first,
                            "bytes": tally.bytes.as_ref().map(|bytes| Hex(bytes).to_string()),
                            "client_faults": tally.client_faults,
                        })
                    })
                    .collect();
                json!({
                    "device": name,
                    "requests": report.requests,
                    "replies": report.replies,
                    "distance_m": distance_m,
                    "events": events,
                })
            },
        )
        .collect();
    json!({"code": "summary", "time_s": now.as_secs_f64(), "devices": devices})
}
