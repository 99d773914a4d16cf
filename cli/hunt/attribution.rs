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

use super::player::{broken, records};
use super::space::step_name;

/// Time between two stops of the ideal operator.
const EVERY: Duration = Duration::from_millis(100);

/// What replaces the client from the beginning of a fault on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Then {
    /// An operator stops it again and again, and opens the port when it is there.
    Stops,
    /// Nothing is sent any more.
    Silence,
}

/// Returns whether a fault of a case leaves no client a way to keep the rule of the key, so that no client is
/// responsible: from its beginning on, both an ideal operator and silence break the rule. For a further fault,
/// this counts only if one of them keeps the rule without it.
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
            let (mut run, open, _) =
                recording::part(devices, &trace, SimTime::from_nanos(at), None)?;
            if let Some(step) = without.and_then(|name| run.step_named(name)) {
                run.clear_step(step).map_err(Failure::system)?;
            }
            let outcome = play_rest(&mut run, open, &records, then).map_err(Failure::system)?;
            if !broken(&outcome).contains_key(key) {
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

fn play_rest(
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

/// The message that stops each device that declares one.
fn stops(run: &Run) -> Vec<(PortId, Message)> {
    let devices = run.scenario().rig.devices.iter().enumerate();
    let stops = devices.filter_map(|(device, plan)| {
        let table = DeTable::parse(plan.device.host.stop).ok()?;
        let value = Spanned::new(table.span(), DeValue::Table(table.into_inner()));
        let message = (plan.device.host.read)(&value, plan.own_settings()?).ok()?;
        let link = message.link;
        Some((PortId { device, link }, message))
    });
    stops.collect()
}
