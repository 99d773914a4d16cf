//! The subcommands that list what files may use: `faults`, `names` and `schema`.

use std::fmt::Write as _;

use clap::ValueEnum;
use sim_core::device::{DeviceSpec, Devices};
use sim_core::fault::{FaultInfo, ParameterInfo, catalogue};
use sim_physics::WorldMap;
use sim_runner::{RigPlan, Scenario};

use crate::exit::{Exit, Failure};
use crate::print::print;

/// Form of a printed list.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum ListFormat {
    /// Lines for people.
    Text,
    /// A document with tables, as docs/faults.md is.
    Markdown,
}

/// A kind of file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum FileKind {
    /// Files that `--world` reads.
    World,
    /// Files that `--rig` reads.
    Rig,
    /// Files that `sim run` reads.
    Scenario,
}

/// The `faults` subcommand: the catalogue, for one device or for all.
pub(crate) fn faults(
    devices: Devices,
    only: Option<&str>,
    format: ListFormat,
) -> Result<Exit, Failure> {
    let wanted = devices
        .iter()
        .filter(|device| only.is_none_or(|only| device.id == only));
    let wanted: Vec<&DeviceSpec> = wanted.copied().collect();
    let faults = catalogue().iter();
    let faults: Vec<&FaultInfo> = faults
        .filter(|fault| wanted.iter().any(|device| device.has_fault(fault)))
        .collect();
    let text: String = match format {
        ListFormat::Text => faults
            .into_iter()
            .map(|fault| as_text(devices, fault))
            .collect(),
        ListFormat::Markdown => markdown(devices, &faults),
    };
    print(text.trim_end())
}

fn able(devices: Devices, fault: &FaultInfo) -> String {
    let able = devices.iter().filter(|device| device.has_fault(fault));
    able.map(|device| device.id).collect::<Vec<_>>().join(", ")
}

fn as_text(devices: Devices, fault: &FaultInfo) -> String {
    let mut text = String::new();
    let devices = able(devices, fault);
    // Writing to a string cannot fail.
    let _ = writeln!(text, "{} [{:?}; {devices}]", fault.id, fault.level);
    let _ = writeln!(text, "  {}", fault.summary);
    let _ = writeln!(text, "  the client sees: {}", fault.client_sees);
    let _ = writeln!(text, "  a hit is: {}", fault.counts);
    for parameter in fault.parameters {
        let must = if parameter.required {
            " (required)"
        } else {
            ""
        };
        let _ = writeln!(
            text,
            "    {}{must}: {}",
            parameter.name, parameter.description
        );
    }
    text
}

/// A table for each level, in the order of the catalogue.
fn markdown(devices: Devices, faults: &[&FaultInfo]) -> String {
    let mut text = String::from(
        "# Faults\n\nWhat a scenario can break, as `sim faults --format markdown` prints it; \
         [scenarios.md](scenarios.md#faults) says how to use it. A fault that hits nothing while it \
         is there fails its scenario; what counts as a hit is in the table.\n",
    );
    let mut level = None;
    for fault in faults {
        if level.replace(fault.level) != Some(fault.level) {
            let _ = write!(
                text,
                "\n## {:?}\n\n| fault | devices | what breaks | what the client sees | what is a hit \
                 | parameters |\n|---|---|---|---|---|---|\n",
                fault.level
            );
        }
        let parameters: Vec<String> = fault.parameters.iter().map(parameter).collect();
        let _ = writeln!(
            text,
            "| `{}` | {} | {} | {} | {} | {} |",
            fault.id,
            able(devices, fault),
            fault.summary,
            fault.client_sees,
            fault.counts,
            parameters.join("<br>")
        );
    }
    text
}

fn parameter(parameter: &ParameterInfo) -> String {
    let must = if parameter.required { ", required" } else { "" };
    format!("`{}`{must}: {}", parameter.name, parameter.description)
}

/// The `names` subcommand: what conditions can say.
pub(crate) fn list_names(devices: Devices, device: &str) -> Result<Exit, Failure> {
    let mut text = String::from(
        "with several devices, write the name of the device first, as in `r150.truth.speed_mps`\n",
    );
    let device = devices.iter().find(|known| known.id == device);
    for info in device.into_iter().flat_map(|device| device.all_names()) {
        let _ = writeln!(text, "{:<36} {:<11} {}", info.name, info.unit, info.meaning);
    }
    print(text.trim_end())
}

/// The `schema` subcommand: JSON Schemas of the files that users write, for their editors.
pub(crate) fn schema(devices: Devices, kind: FileKind) -> Result<Exit, Failure> {
    let text = match kind {
        FileKind::World => WorldMap::json_schema(),
        FileKind::Rig => RigPlan::json_schema(devices),
        FileKind::Scenario => Scenario::json_schema(devices),
    };
    print(text.trim_end())
}
