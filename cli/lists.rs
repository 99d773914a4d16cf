//! The subcommands that list what files may use: `faults`, `names` and `schema`.

use std::fmt::Write as _;

use anyhow::anyhow;
use clap::ValueEnum;
use rigsim_core::device::{DeviceSpec, Devices};
use rigsim_core::effect;
use rigsim_physics::WorldMap;
use rigsim_runner::{RigPlan, Scenario};

use crate::exit::{Exit, Failure};
use crate::export::dissector;
use crate::print::print;
use crate::reference;

/// Form of a printed schema.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum SchemaFormat {
    /// JSON Schema, for editors.
    Json,
    /// A page for readers, as docs/reference.md is; of scenario files only.
    Markdown,
    /// A dissector for Wireshark; of devices only.
    Lua,
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

/// The `faults` subcommand: the catalogue by level, for one device or for all, as docs/faults.md is.
pub(crate) fn faults(devices: Devices, only: Option<&str>) -> Result<Exit, Failure> {
    let is_wanted = |device: &DeviceSpec| only.is_none_or(|only| device.id == only);
    let mut text = String::from(
        "# Faults and actions\n\nThis page lists what a scenario can break or do. `sim faults` prints it; \
         [scenarios.md](scenarios.md#faults) shows how to use it. A fault without a hit fails its scenario, \
         or skips it with a real client.\n",
    );
    let mut level = None;
    for info in effect::catalogue(devices) {
        let able = devices.iter().filter(|device| effect::has(device, info));
        let able: Vec<&DeviceSpec> = able.copied().collect();
        if !able.iter().any(|device| is_wanted(device)) {
            continue;
        }
        // Writing to a string cannot fail.
        if level.replace(info.level) != Some(info.level) {
            let _ = write!(text, "\n## {:?}: `{}`\n", info.level, info.level.key());
        }
        let able: Vec<&str> = able.iter().map(|device| device.id).collect();
        let (id, summary, able) = (info.id, info.summary, able.join(", "));
        let _ = writeln!(text, "\n### `{id}`\n{summary} Devices: {able}.");
        if !info.client_sees.is_empty() {
            let _ = writeln!(text, "- The client sees: {}", info.client_sees);
        }
        let _ = writeln!(text, "- A hit is: {}", info.counts);
        for parameter in info.parameters {
            let must = if parameter.required { ", required" } else { "" };
            let _ = writeln!(
                text,
                "- `{}`{must}: {}",
                parameter.name, parameter.description
            );
        }
    }
    print(text.trim_end())
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
pub(crate) fn schema(devices: Devices, of: &str, format: SchemaFormat) -> Result<Exit, Failure> {
    let device = devices.iter().find(|device| device.id == of);
    let Ok(kind) = FileKind::from_str(of, false) else {
        return match device.filter(|_| format == SchemaFormat::Lua) {
            Some(device) => print(dissector(device).trim_end()),
            None => Err(Failure::usage(anyhow!(
                "the protocol of a device is printed as a dissector: `sim schema {of} --format lua`"
            ))),
        };
    };
    let text = match kind {
        FileKind::World => WorldMap::json_schema(),
        FileKind::Rig => RigPlan::json_schema(devices),
        FileKind::Scenario => Scenario::json_schema(devices),
    };
    match format {
        SchemaFormat::Json => print(text.trim_end()),
        SchemaFormat::Markdown if kind == FileKind::Scenario => {
            let schema = serde_json::from_str(&text).map_err(Failure::system)?;
            print(reference::page(&schema, devices).trim_end())
        }
        SchemaFormat::Lua => Err(Failure::usage(anyhow!(
            "a dissector is of a device: `sim schema {} --format lua`",
            devices.first().map_or("DEVICE", |device| device.id)
        ))),
        SchemaFormat::Markdown => Err(Failure::usage(anyhow!(
            "only the reference of scenario files is printed as a page: `sim schema scenario --format markdown`"
        ))),
    }
}
