//! Work with a real vehicle.

mod capture;
mod compare;
mod guide;
mod knob;
mod live;
mod model;
mod page;
mod plan;
mod poses;
mod recording;
mod report;
mod search;
mod tap;

pub(crate) use compare::{compare, fit};
pub(crate) use tap::tap;

use anyhow::anyhow;
use rigsim_core::device::Devices;
use rigsim_core::settings::SimSettings;
use rigsim_runner::RigPlan;
use rigsim_runner::scenario::ScenarioText;
use rigsim_runner::trace::{FORMAT, Header, Record};

use crate::config;
use crate::exit::{Failure, refuse};
use crate::plan::of_device;
use crate::recording::OF_VEHICLE;

/// One device of this kind with this number of links, at rest and ready.
fn plan_of(
    devices: Devices,
    kind: &str,
    links: usize,
    settings: SimSettings,
) -> Result<RigPlan, Failure> {
    let found = devices.iter().find(|device| device.id == kind);
    let device = found.ok_or_else(|| Failure::usage(anyhow!("no device is a `{kind}`")))?;
    let most = device.links.len();
    if !(1..=most).contains(&links) {
        let some = match most {
            1 => "one link".to_owned(),
            most => format!("1 to {most} links"),
        };
        refuse!("{} has {some}, not {links}", device.title);
    }
    Ok(of_device(device, 0, settings, vec![None; links]))
}

/// First line of a recording of a vehicle.
fn header(plan: &RigPlan) -> Header {
    Header {
        format: FORMAT,
        program: env!("CARGO_PKG_VERSION").to_owned(),
        seed: 0,
        paced: true,
        adapters: false,
        live: true,
        serving: true,
        source: ScenarioText {
            file: OF_VEHICLE.to_owned(),
            text: plan.to_toml(),
            ..ScenarioText::default()
        },
        settings: config::changed(&plan.settings).join("\n"),
        world: None,
    }
}

/// Last line of a recording.
fn end(t: u64) -> Record {
    Record::End {
        t,
        passed: true,
        not_applicable: Vec::new(),
        dropped: 0,
    }
}

#[cfg(test)]
mod tests;
