//! What to serve: from a rig file, or from the flags that are the short form for one device.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context as _, anyhow};
use sim_physics::Pose;
use sim_runner::{DevicePlan, RigPlan};
use sim_settings::Source;

use crate::args::{Device, ServeArgs};
use crate::config;
use crate::exit::Failure;
use crate::scenario_files::{self, Loaded};
use crate::visible;

/// Makes the plan that the flags ask for.
pub(crate) fn plan(args: &ServeArgs) -> Result<Loaded, Failure> {
    if let Some(file) = &args.scenario {
        return from_scenario(file, args);
    }
    let (rig, path) = match &args.rig {
        Some(file) => (from_file(file, args)?, file.clone()),
        None => (from_flags(args)?, PathBuf::new()),
    };
    // A flag is relative to where it was typed, a file's path to the file.
    let folder = path.parent().unwrap_or(Path::new(""));
    let named = || rig.world.as_ref().map(|path| folder.join(path));
    let world = args.world.clone().or_else(named);
    Loaded::serving(rig, path, world.as_deref())
}

/// The scenario's devices, the first of which is served where the flags say.
fn from_scenario(file: &Path, args: &ServeArgs) -> Result<Loaded, Failure> {
    let base = config::load_file(&args.settings)?;
    let mut loaded = scenario_files::load(file, &base)?;
    let scenario = Arc::make_mut(&mut loaded.scenario);
    // Flags win over files, for each device.
    config::apply_flags(&args.settings, &mut scenario.rig.settings)?;
    for device in &mut scenario.rig.devices {
        config::apply_flags(&args.settings, &mut device.settings)?;
        config::check(&device.settings)?;
    }
    let Some(first) = scenario.rig.devices.first_mut() else {
        return Err(Failure::usage(anyhow!("the scenario has no device")));
    };
    // A flag is relative to where it was typed, a file's path to the file.
    let here = |path: &PathBuf| {
        if args.listens_at(path) {
            return Ok(path.clone());
        }
        std::path::absolute(path)
            .with_context(|| format!("cannot tell where {} is", visible::name(&path)))
            .map_err(Failure::system)
    };
    if let Some(pty) = args.port() {
        first.port = Some(here(pty)?);
    }
    if let Some(pty) = args.ros_port() {
        if !first.ros {
            return Err(Failure::usage(anyhow!(
                "--ros-pty, --ros-listen: the scenario's first device has no ROS link"
            )));
        }
        first.ros_port = Some(here(pty)?);
    }
    Ok(loaded)
}

fn from_file(file: &Path, args: &ServeArgs) -> Result<RigPlan, Failure> {
    let base = config::load_file(&args.settings)?;
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
        config::check(&device.settings)?;
    }
    Ok(rig)
}

fn from_flags(args: &ServeArgs) -> Result<RigPlan, Failure> {
    if args.port().is_none() && args.serial.is_none() {
        return Err(Failure::usage(anyhow!(
            "say where to serve: --pty PATH for a pseudo-terminal, as in `sim --pty /tmp/r150`, \
             --listen URL for the network, --serial DEVICE for a real serial port, or --rig FILE for several devices \
             (`sim --help` shows more)"
        )));
    }
    if args.device == Device::R150 && args.ros_port().is_some() {
        let why = "--ros-pty and --ros-listen are the mecanum car's: add --device mecanum";
        return Err(Failure::usage(anyhow!(why)));
    }
    let settings = config::load(&args.settings)?;
    let device = DevicePlan {
        name: args.device.kind().word().to_owned(),
        kind: args.device.kind(),
        start: args.start.into(),
        pose: Pose::default(),
        settings: settings.clone(),
        port: args.port().cloned(),
        ros: args.ros_port().is_some(),
        ros_port: args.ros_port().cloned(),
    };
    Ok(RigPlan {
        world: None,
        seed: None,
        settings,
        devices: vec![device],
    })
}
