//! Attribution: whether any client could have kept the rule.

use std::collections::BTreeSet;
use std::time::Duration;

use rigsim_core::SimTime;
use rigsim_core::device::Devices;
use rigsim_core::device::host::Message;
use rigsim_core::rig::PortId;
use rigsim_runner::Outcome;
use rigsim_runner::trace::Record;
use rigsim_runner::{Run, RunError};
use toml::Spanned;
use toml::de::{DeTable, DeValue};

use crate::exit::Failure;
use crate::recording;
use crate::run::Case;

use super::player::{keys, records};
use super::space::step_name;

/// Time between two stops of the ideal operator.
const EVERY: Duration = Duration::from_millis(100);

/// What becomes of the vehicle after what the client did until a fault began.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Then {
    /// An operator stops it again and again, and opens the port when it is there.
    Stops,
    /// Nothing is sent any more.
    Silence,
}

/// Returns whether a fault of a case that was played leaves no client a way to keep the rule of the key, so
/// that it is attributed to no client: from its beginning on, both an ideal operator and silence break the
/// rule. Of a further fault, this counts only if one of them keeps the rule without it.
///
/// # Errors
/// When the simulation cannot go on.
pub(super) fn is_unavoidable(
    devices: Devices,
    case: &Case<'_>,
    faults: usize,
    key: &str,
) -> Result<bool, Failure> {
    let records = records(case);
    let trace = case.recording().unwrap_or_default();
    let breaks = |at: u64, without: Option<&str>| -> Result<bool, Failure> {
        for then in [Then::Silence, Then::Stops] {
            let (mut run, open, _) = recording::part(devices, &trace, SimTime::from_nanos(at))?;
            if let Some(step) = without.and_then(|name| run.step_named(name)) {
                run.clear_step(step).map_err(Failure::system)?;
            }
            let outcome = go_on(&mut run, open, &records, then).map_err(Failure::system)?;
            if !keys(&outcome).contains_key(key) {
                return Ok(false);
            }
        }
        Ok(true)
    };
    let names: Vec<String> = (0..faults).map(step_name).collect();
    let begun = records.iter().filter_map(|record| match record {
        Record::Step { t, step, what } if names.contains(step) && what == "begun" => {
            Some((*t, step.as_str()))
        }
        _ => None,
    });
    for (index, (at, step)) in begun.enumerate() {
        if breaks(at, None)? && (index == 0 || !breaks(at.saturating_sub(1), Some(step))?) {
            return Ok(true);
        }
    }
    Ok(false)
}

fn go_on(
    run: &mut Run,
    mut open: BTreeSet<PortId>,
    records: &[Record],
    then: Then,
) -> Result<Outcome, RunError> {
    let stops = stops(run);
    let mut now = run.rig().now();
    let begun = now.as_nanos();
    while run.finished().is_none() {
        run.advance(now)?;
        for port in run.ports().to_vec() {
            run.read(port, &mut Vec::new());
            let pulled = run.rig().cable_pulled(port);
            if pulled && open.remove(&port) {
                run.detach(port, now)?;
            } else if !pulled && then == Then::Stops && open.insert(port) {
                run.attach(port, now)?;
                let last = records.iter().rev().find_map(|record| match record {
                    Record::Line { t, port: of, line } if *t <= begun => {
                        (PortId::from(*of) == port).then_some(*line)
                    }
                    _ => None,
                });
                if let Some(line) = last {
                    run.set_line(port, line);
                }
            }
        }
        while run.poll_event().is_some() {}
        if then == Then::Stops {
            for (port, stop) in stops.iter().filter(|(port, _)| open.contains(port)) {
                if run.rig().space(*port) >= stop.bytes.len() {
                    run.send(*port, now, &stop.bytes)?;
                }
            }
        }
        now += EVERY;
    }
    Ok(run.end().clone())
}

/// The messages that stop each device: those that ask for motion, for none.
fn stops(run: &Run) -> Vec<(PortId, Message)> {
    let mut stops = Vec::new();
    for (device, plan) in run.scenario().rig.devices.iter().enumerate() {
        let Some(settings) = plan.own_settings() else {
            continue;
        };
        for info in plan.device.all_messages().filter(|info| info.motion) {
            let names: Vec<&str> = info.fields.iter().map(|field| field.name).collect();
            let read = |fields: &[&str]| {
                let fields: Vec<String> = fields.iter().map(|name| format!("{name} = 0")).collect();
                let text = format!("{} = {{ {} }}", info.name, fields.join(", "));
                let table = DeTable::parse(&text).ok()?;
                let span = table.span();
                let value = Spanned::new(span, DeValue::Table(table.into_inner()));
                (plan.device.host.read)(&value, settings).ok()
            };
            // What has a default keeps it: it may say that a motion takes the place of others.
            let is_needed = |name: &&str| {
                let others = names.iter().copied().filter(|other| other != name);
                read(&others.collect::<Vec<_>>()).is_none()
            };
            let needed: Vec<&str> = names.iter().copied().filter(is_needed).collect();
            if let Some(message) = read(&needed) {
                let link = message.link;
                stops.push((PortId { device, link }, message));
            }
        }
    }
    stops
}
