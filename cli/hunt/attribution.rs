//! Attribution: whether any client could have kept the rule.

use std::collections::BTreeSet;
use std::time::Duration;

use rigsim_core::SimTime;
use rigsim_core::device::host::Message;
use rigsim_core::line::{ClientLine, Wire};
use rigsim_core::rig::PortId;
use rigsim_runner::Outcome;
use rigsim_runner::trace::Record;
use rigsim_runner::{Run, RunError, RunOptions};
use toml::Spanned;
use toml::de::{DeTable, DeValue};

use crate::exit::Failure;
use crate::scenario_files::Loaded;

use super::player::keys;
use super::space::step_name;

/// Time between two stops of the ideal operator.
const EVERY: Duration = Duration::from_millis(100);

/// What becomes of the vehicle after what the client did until the first fault began.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Then {
    /// An operator stops it again and again, and opens the port when it is there.
    Stops,
    /// Nothing is sent any more.
    Silence,
}

/// Returns whether both an ideal operator and silence break the rule, so that it is attributed to no client.
///
/// # Errors
/// When the simulation cannot go on.
pub(super) fn is_unavoidable(
    loaded: &Loaded,
    records: &[Record],
    faults: usize,
    seed: u64,
    key: &str,
) -> Result<bool, Failure> {
    // The one that begins first, which need not be the first of the schedule.
    let names: Vec<String> = (0..faults).map(step_name).collect();
    let begun = records.iter().find_map(|record| match record {
        Record::Step { t, step, what } if names.contains(step) && what == "begun" => Some(*t),
        _ => None,
    });
    let Some(begun) = begun else {
        return Ok(false);
    };
    for then in [Then::Silence, Then::Stops] {
        let options = RunOptions {
            seed,
            wire: Wire::Paced,
            live: true,
            trace: false,
        };
        let mut run = loaded.run(options)?;
        run.follow_bytes();
        let outcome = play(&mut run, records, begun, then).map_err(Failure::system)?;
        if !keys(&outcome).contains_key(key) {
            return Ok(false);
        }
    }
    Ok(true)
}

fn play(run: &mut Run, records: &[Record], begun: u64, then: Then) -> Result<Outcome, RunError> {
    let mut open = BTreeSet::new();
    let mut lines: Vec<(PortId, ClientLine)> = Vec::new();
    for record in records {
        match record {
            Record::Attach { t, port } if *t <= begun => {
                open.insert(PortId::from(*port));
                run.attach((*port).into(), SimTime::from_nanos(*t))?;
            }
            Record::Detach { t, port } if *t <= begun => {
                open.remove(&PortId::from(*port));
                run.detach((*port).into(), SimTime::from_nanos(*t))?;
            }
            Record::In { t, port, bytes } if *t <= begun => {
                run.send((*port).into(), SimTime::from_nanos(*t), &bytes.0)?;
            }
            Record::Line { t, port, line } if *t <= begun => {
                run.advance(SimTime::from_nanos(*t))?;
                run.set_line((*port).into(), *line);
                lines.push(((*port).into(), *line));
            }
            _ => {}
        }
    }
    let stops = stops(run);
    let mut now = SimTime::from_nanos(begun);
    while run.finished().is_none() {
        run.advance(now)?;
        for port in run.ports().to_vec() {
            run.read(port, &mut Vec::new());
            let pulled = run.rig().cable_pulled(port);
            if pulled && open.remove(&port) {
                run.detach(port, now)?;
            } else if !pulled && then == Then::Stops && open.insert(port) {
                run.attach(port, now)?;
                let last = lines.iter().rev().find(|(of, _)| *of == port);
                if let Some((_, line)) = last {
                    run.set_line(port, *line);
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
            let mut needed = names.clone();
            for name in &names {
                let without: Vec<&str> = needed.iter().copied().filter(|one| one != name).collect();
                if read(&without).is_some() {
                    needed = without;
                }
            }
            if let Some(message) = read(&needed) {
                let link = message.link;
                stops.push((PortId { device, link }, message));
            }
        }
    }
    stops
}
