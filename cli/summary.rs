//! Summary that is printed at the end of a run.

use std::fmt::Write as _;

use rigsim_core::event::Hex;
use rigsim_core::report::{Report, Tally};
use rigsim_core::rig::PortId;
use rigsim_pty::Counters;
use rigsim_runner::Run;
use serde::Serialize;
use serde_json::{Value, json};

/// For people; the counters are those of all ports.
pub(crate) fn text(run: &Run, counters: &[(PortId, Counters)]) -> String {
    let mut text = format!(
        "summary after {:.1} s of simulated time",
        run.rig().now().as_secs_f64()
    );
    for (device, name, report) in reports(run) {
        let distance_m = run.rig().distance_m(device);
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
            .filter(|(_, tally)| tally.count > tally.client_errors)
            .map(|(code, tally)| format!("{code} {}", tally.count - tally.client_errors))
            .collect();
        if !other.is_empty() {
            let _ = write!(text, "\n    events: {}", other.join(", "));
        }
        for (code, tally) in report.damage() {
            let _ = write!(text, "\n    damage: {}", counted(code, tally.count, tally));
        }
        for port in ports_of(counters, device) {
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
        let mut errors = report.client_errors().peekable();
        if errors.peek().is_none() {
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
        for (code, tally) in errors {
            let line = counted(code, tally.client_errors, tally);
            let _ = write!(text, "\n      {line}");
            if tally.count > 1 && tally.lost_bytes > 0 {
                let _ = write!(text, "; {} bytes in all", tally.lost_bytes);
            }
        }
    }
    if run.excused() > 0 {
        let _ = write!(
            text,
            "\n  {} events are attributed to no party: the machine was busy, and delivered at once \
             what clients may have sent in time",
            run.excused()
        );
    }
    if run.events_lost() > 0 {
        let _ = write!(
            text,
            "\n  {} events were lost before they were counted",
            run.events_lost()
        );
    }
    text
}

/// Events of one kind, of which these count, in words.
pub(crate) fn counted(code: &str, count: u64, tally: &Tally) -> String {
    format!(
        "{code} {count}x, first at {} s: {}",
        tally.first_at, tally.first
    )
}

/// Index, name and report of each device.
fn reports(run: &Run) -> impl Iterator<Item = (usize, &str, &Report)> {
    let plans = run.scenario().rig.devices.iter();
    let reports = plans.zip(run.reports()).enumerate();
    reports.map(|(device, (plan, report))| (device, plan.name.as_str(), report))
}

fn ports_of(counters: &[(PortId, Counters)], device: usize) -> impl Iterator<Item = &Counters> {
    let of_device = counters.iter().filter(move |(id, _)| id.device == device);
    of_device.map(|(_, counters)| counters)
}

/// For programs.
pub(crate) fn json(run: &Run, counters: &[(PortId, Counters)]) -> Value {
    let port = |port: &Counters| {
        json!({
            "received_bytes": port.received_bytes,
            "sent_bytes": port.sent_bytes,
            "dropped_full_bytes": port.dropped_full_bytes,
            "dropped_detached_bytes": port.dropped_detached_bytes,
            "attached": port.attached,
        })
    };
    let devices = reports(run).map(|(device, name, report)| {
        let mut value = device_json(name, report, run.rig().distance_m(device));
        value["ports"] = ports_of(counters, device).map(port).collect();
        value
    });
    json!({
        "code": "summary",
        "time_s": run.rig().now().as_secs_f64(),
        "events_lost": run.events_lost(),
        "excused": run.excused(),
        "devices": devices.collect::<Vec<_>>(),
    })
}

/// Counts of a device for programs.
pub(crate) fn device_json(name: &str, report: &Report, distance_m: f64) -> Value {
    let event = |(code, tally): (_, &Tally)| {
        let mut value = tally_json(code, tally, tally.count);
        value["client_faults"] = json!(tally.client_errors);
        value["lost_bytes"] = json!(tally.lost_bytes);
        value
    };
    json!({
        "device": name,
        "requests": report.requests,
        "replies": report.replies,
        "distance_m": distance_m,
        "events": report.events.iter().map(event).collect::<Vec<_>>(),
    })
}

/// What a client has done that is forbidden or risky, for programs.
pub(crate) fn client_report(report: &Report) -> impl Iterator<Item = Value> {
    let errors = report.client_errors();
    errors.map(|(code, tally)| tally_json(code, tally, tally.client_errors))
}

/// Events of one kind, of which these count.
fn tally_json(code: impl Serialize, tally: &Tally, count: u64) -> Value {
    json!({
        "code": code,
        "count": count,
        "first_s": tally.first_at.as_secs_f64(),
        "first": tally.first,
        "bytes": tally.bytes.as_ref().map(|bytes| Hex(bytes).to_string()),
    })
}
