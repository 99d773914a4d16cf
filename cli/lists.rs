//! The subcommands that list what scenarios may use: `faults` and `names`.

use std::fmt::Write as _;

use clap::ValueEnum;
use sim_core::fault::{FaultInfo, ParameterInfo, catalogue};
use sim_runner::condition::names;

use crate::args::Device;
use crate::exit::{Exit, Failure};
use crate::print::print;

/// How to print a list.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum ListFormat {
    /// Lines for people.
    Text,
    /// A document with tables, as docs/faults.md is.
    Markdown,
}

/// The `faults` subcommand: the catalogue, for one device or for all.
pub(crate) fn faults(device: Option<Device>, format: ListFormat) -> Result<Exit, Failure> {
    let faults: Vec<&FaultInfo> = catalogue()
        .iter()
        .filter(|fault| device.is_none_or(|device| words(fault).contains(&device.kind().word())))
        .collect();
    let text: String = match format {
        ListFormat::Text => faults.into_iter().map(as_text).collect(),
        ListFormat::Markdown => markdown(&faults),
    };
    print(text.trim_end())
}

fn words(fault: &FaultInfo) -> Vec<&'static str> {
    fault.devices.iter().map(|kind| kind.word()).collect()
}

fn as_text(fault: &FaultInfo) -> String {
    let mut text = String::new();
    let devices = words(fault).join(", ");
    // Writing to a string cannot fail.
    let _ = writeln!(text, "{} [{:?}; {devices}]", fault.id, fault.level);
    let _ = writeln!(text, "  {}", fault.summary);
    let _ = writeln!(text, "  the client sees: {}", fault.client_sees);
    let _ = writeln!(text, "  a trigger is: {}", fault.counts);
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
fn markdown(faults: &[&FaultInfo]) -> String {
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
            words(fault).join(", "),
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
pub(crate) fn list_names(device: Device) -> Result<Exit, Failure> {
    let mut text = String::from(
        "write each after the device's name, as in `r150.truth.speed_mps`; with one device, alone\n",
    );
    for info in names(device.kind()) {
        let _ = writeln!(text, "{:<36} {:<11} {}", info.name, info.unit, info.meaning);
    }
    print(text.trim_end())
}
