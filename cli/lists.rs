//! The subcommands that list what scenarios may use: `faults` and `names`.

use std::fmt::Write as _;

use sim_core::fault::catalogue;
use sim_scenarios::condition::names;

use crate::args::Device;
use crate::exit::{Exit, Failure};
use crate::print::print;

/// The `faults` subcommand: the catalogue, for one device or for all.
pub(crate) fn faults(device: Option<Device>) -> Result<Exit, Failure> {
    let mut text = String::new();
    for fault in catalogue() {
        let devices: Vec<&str> = fault.devices.iter().map(|kind| kind.word()).collect();
        if device.is_some_and(|device| !devices.contains(&device.kind().word())) {
            continue;
        }
        // Writing to a string cannot fail.
        let _ = writeln!(
            text,
            "{} [{:?}; {}]",
            fault.id,
            fault.level,
            devices.join(", ")
        );
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
    }
    print(text.trim_end())
}

/// The `names` subcommand: what conditions can say.
pub(crate) fn list_names(device: Device) -> Result<Exit, Failure> {
    let mut text = String::from("write each after the device's name, as in `r150.speed`\n");
    for info in names(device.kind()) {
        let _ = writeln!(text, "{:<36} {:<11} {}", info.name, info.unit, info.meaning);
    }
    print(text.trim_end())
}
