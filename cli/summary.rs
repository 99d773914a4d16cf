//! Summary that is printed at the end of a run.

use std::fmt::Write as _;

use serde_json::{Value, json};
use sim_core::SimTime;
use sim_core::event::Hex;
use sim_core::report::Report;
use sim_pty::Counters;

/// One device's part of the summary.
pub(crate) struct DeviceSummary<'a> {
    pub(crate) name: &'a str,
    pub(crate) report: &'a Report,
    pub(crate) distance_m: f64,
    /// Totals of its ports, by link.
    pub(crate) ports: Vec<Counters>,
}

/// Facts that concern all devices.
pub(crate) struct RunSummary {
    pub(crate) now: SimTime,
    /// Events that nobody took in time.
    pub(crate) events_lost: u64,
    /// Events that were not held against a client since the simulator was late.
    pub(crate) excused: u64,
}

/// For people.
pub(crate) fn text(run: &RunSummary, devices: &[DeviceSummary<'_>]) -> String {
    let mut text = format!(
        "summary after {:.1} s of simulated time",
        run.now.as_secs_f64()
    );
    for DeviceSummary {
        name,
        report,
        distance_m,
        ports,
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
            .filter(|(_, tally)| tally.count > tally.held_against_client)
            .map(|(code, tally)| format!("{code} {}", tally.count - tally.held_against_client))
            .collect();
        if !other.is_empty() {
            let _ = write!(text, "\n    events: {}", other.join(", "));
        }
        for (code, tally) in report.damage() {
            let _ = write!(
                text,
                "\n    damage: {code} {}x, first at {} s: {}",
                tally.count, tally.first_at, tally.first
            );
        }
        for port in ports {
            let full = port.dropped_full_bytes;
            let alone = port.dropped_detached_bytes;
            if full > 0 || alone > 0 {
                let _ = write!(
                    text,
                    "\n    bytes lost at the port: {full} that the client did not read, {alone} \
                     when it had gone"
                );
            }
        }
        let mut blamed = report.held_against_client().peekable();
        if blamed.peek().is_none() {
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
        for (code, tally) in blamed {
            let _ = write!(
                text,
                "\n      {code} {}x, first at {} s: {}",
                tally.held_against_client, tally.first_at, tally.first
            );
            if tally.count > 1 && tally.lost_bytes > 0 {
                let _ = write!(text, "; {} bytes in all", tally.lost_bytes);
            }
        }
    }
    if run.excused > 0 {
        let _ = write!(
            text,
            "\n  {} events are held against nobody: the machine was busy, and delivered at once \
             what clients may have sent in time",
            run.excused
        );
    }
    if run.events_lost > 0 {
        let _ = write!(
            text,
            "\n  {} events were lost before they were counted",
            run.events_lost
        );
    }
    text
}

/// For programs.
pub(crate) fn json(run: &RunSummary, devices: &[DeviceSummary<'_>]) -> Value {
    let devices: Vec<Value> = devices
        .iter()
        .map(
            |DeviceSummary {
                 name,
                 report,
                 distance_m,
                 ports,
             }| {
                let ports: Vec<Value> = ports
                    .iter()
                    .map(|port| {
                        json!({
                            "received_bytes": port.received_bytes,
                            "sent_bytes": port.sent_bytes,
                            "dropped_full_bytes": port.dropped_full_bytes,
                            "dropped_detached_bytes": port.dropped_detached_bytes,
                            "attached": port.attached,
                        })
                    })
                    .collect();
                json!({
                    "device": name,
                    "requests": report.requests,
                    "replies": report.replies,
                    "distance_m": distance_m,
                    "events": events_json(report),
                    "ports": ports,
                })
            },
        )
        .collect();
    json!({
        "code": "summary",
        "time_s": run.now.as_secs_f64(),
        "events_lost": run.events_lost,
        "excused": run.excused,
        "devices": devices,
    })
}

/// Counted events for programs.
pub(crate) fn events_json(report: &Report) -> Vec<Value> {
    let events = report.events.iter();
    events
        .map(|(code, tally)| {
            json!({
                "code": code,
                "count": tally.count,
                "first_s": tally.first_at.as_secs_f64(),
                "first": tally.first,
                "bytes": tally.bytes.as_ref().map(|bytes| Hex(bytes).to_string()),
                "client_faults": tally.held_against_client,
                "lost_bytes": tally.lost_bytes,
            })
        })
        .collect()
}
