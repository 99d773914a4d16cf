//! Plan of what to serve: from a rig file, or from the flags that are the short form for one
//! device.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context as _, anyhow};
use rigsim_core::device::{DeviceSpec, Devices};
use rigsim_core::settings::SimSettings;
use rigsim_physics::Pose;
use rigsim_pty::ListenAddress;
use rigsim_runner::{DevicePlan, RigPlan};
use rigsim_settings::Source;

use crate::args::ServeArgs;
use crate::config;
use crate::exit::{Failure, refuse};
use crate::scenario_files::{self, Given, Loaded};
use crate::visible;

/// Makes the plan that the flags ask for.
pub(crate) fn plan(devices: Devices, args: &ServeArgs) -> Result<Loaded, Failure> {
    if let Some(file) = &args.scenario {
        return from_scenario(devices, file, args);
    }
    let (rig, path) = match &args.rig {
        Some(file) => (from_file(devices, file, args)?, file.clone()),
        None => (from_flags(devices, args)?, PathBuf::new()),
    };
    // A flag is relative to where it was typed, a file's path to the file.
    let folder = path.parent().unwrap_or(Path::new(""));
    let named = || rig.world.as_ref().map(|path| folder.join(path));
    let world = args.world.clone().or_else(named);
    Loaded::serving(rig, path, world.as_deref())
}

/// The scenario's devices, the first of which is served where the flags say.
fn from_scenario(devices: Devices, file: &Path, args: &ServeArgs) -> Result<Loaded, Failure> {
    let given = Given {
        set: &args.settings.set,
        ..Given::plain(config::load_file(devices, &args.settings)?)
    };
    let mut loaded = scenario_files::load(file, &given)?;
    let scenario = Arc::make_mut(&mut loaded.scenario);
    gather_ptys(&mut scenario.rig, args);
    let Some(first) = scenario.rig.devices.first_mut() else {
        refuse!("the scenario has no device");
    };
    // A flag is relative to where it was typed, a file's path to the file.
    if let Some(pty) = args.port() {
        first.ports[0] = Some(absolute(pty)?);
    }
    for (id, pty) in &args.link_ptys {
        let link = first.device.link(id).unwrap_or(usize::MAX);
        let Some(port) = first.ports.get_mut(link) else {
            refuse!("--{id}-pty: the scenario's first device has no such link");
        };
        *port = Some(absolute(pty)?);
    }
    Ok(loaded)
}

/// Place of a port or a file, for a program that may be elsewhere: a URL, or a path from the root.
pub(crate) fn absolute(path: &Path) -> Result<PathBuf, Failure> {
    if ListenAddress::is_url(path) {
        return Ok(path.to_owned());
    }
    std::path::absolute(path)
        .with_context(|| format!("cannot tell where {} is", visible::name(path)))
        .map_err(Failure::system)
}

fn from_file(devices: Devices, file: &Path, args: &ServeArgs) -> Result<RigPlan, Failure> {
    let base = config::load_file(devices, &args.settings)?;
    let text = config::read(file, "rig file")?;
    let shown = visible::name(file);
    let source = Source {
        file: &shown,
        text: &text,
    };
    let mut rig = RigPlan::parse(source, &base).map_err(Failure::usage)?;
    // Flags win over files, for each device.
    config::apply_flags(&args.settings, &mut rig.settings)?;
    for device in &mut rig.devices {
        config::apply_flags(&args.settings, &mut device.settings)?;
    }
    gather_ptys(&mut rig, args);
    Ok(rig)
}

/// Forgets where a file places pseudo-terminals that are all to be in the folder of `--pty-folder`.
fn gather_ptys(rig: &mut RigPlan, args: &ServeArgs) {
    if args.pty_folder.is_some() {
        let ports = rig.devices.iter_mut().flat_map(|device| &mut device.ports);
        for port in ports {
            port.take_if(|path| !ListenAddress::is_url(path));
        }
    }
}

fn from_flags(devices: Devices, args: &ServeArgs) -> Result<RigPlan, Failure> {
    if args.port().is_none() && args.serial.is_none() {
        refuse!(
            "say where to serve: --pty PATH for a pseudo-terminal, as in `sim --pty /tmp/r150`, \
             --listen URL for the network, --serial DEVICE for a real serial port, or --rig FILE for \
             several devices \
             (`sim --help` shows more)"
        );
    }
    let find = || devices.iter().find(|device| device.id == args.device);
    let spec: &'static DeviceSpec =
        find().ok_or_else(|| Failure::usage(anyhow!("no device is a `{}`", args.device)))?;
    let able = |can: &dyn Fn(&DeviceSpec) -> bool| {
        let able = devices.iter().filter(|device| can(device));
        able.map(|device| format!("--device {}", device.id))
            .collect::<Vec<_>>()
            .join(" or ")
    };
    let mut ports = vec![args.port().cloned()];
    for (id, pty) in &args.link_ptys {
        let Some(link) = spec.link(id) else {
            let able = able(&|device| device.link(id).is_some());
            let why = format!("--{id}-pty: {} has no such link: add {able}", spec.title);
            refuse!(why);
        };
        ports.resize(ports.len().max(link + 1), None);
        ports[link] = Some(pty.clone());
    }
    let start = match &args.start {
        Some(word) => spec.starts.iter().position(|start| start.id == *word),
        None => Some(0),
    };
    let start = start.ok_or_else(|| {
        let able = able(&|device| !device.starts.is_empty());
        Failure::usage(anyhow!("--start: {} has no choice; {able} has", spec.title))
    })?;
    let settings = config::load(devices, &args.settings)?;
    Ok(of_device(spec, start, settings, ports))
}

/// One device at the origin, with these ports.
pub(crate) fn of_device(
    device: &'static DeviceSpec,
    start: usize,
    settings: SimSettings,
    ports: Vec<Option<PathBuf>>,
) -> RigPlan {
    let device = DevicePlan {
        name: device.id.to_owned(),
        device,
        start,
        pose: Pose::default(),
        settings: settings.clone(),
        ports,
    };
    RigPlan {
        world: None,
        seed: None,
        settings,
        devices: vec![device],
    }
}
