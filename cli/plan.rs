//! What to serve: from a rig file, or from the flags that are the short form for one device.

use std::path::{Path, PathBuf};

use anyhow::anyhow;
use sim_physics::{Pose, WorldMap};
use sim_scenarios::{DevicePlan, RigPlan};
use sim_settings::Source;

use crate::args::{Device, ServeArgs};
use crate::config;
use crate::exit::Failure;

/// A plan, what is in its world, and the folder that its paths are relative to.
pub(crate) struct Plan {
    pub(crate) rig: RigPlan,
    pub(crate) map: WorldMap,
    pub(crate) folder: PathBuf,
}

/// Makes the plan that the flags ask for.
pub(crate) fn plan(args: &ServeArgs) -> Result<Plan, Failure> {
    let (rig, folder) = match &args.rig {
        Some(file) => from_file(file, args)?,
        None => (from_flags(args)?, PathBuf::new()),
    };
    // A flag is relative to where it was typed, a file's path to the file.
    let world = args
        .world
        .clone()
        .or_else(|| rig.world.as_ref().map(|path| folder.join(path)));
    let map = match world {
        Some(path) => {
            let text = config::read(&path, "world file")?;
            WorldMap::from_toml(&text, &path.display().to_string()).map_err(Failure::usage)?
        }
        None => WorldMap::default(),
    };
    Ok(Plan { rig, map, folder })
}

fn from_file(file: &Path, args: &ServeArgs) -> Result<(RigPlan, PathBuf), Failure> {
    let base = config::load_file(&args.settings)?;
    let text = config::read(file, "rig file")?;
    let shown = file.display().to_string();
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
    let folder = file.parent().map(Path::to_owned).unwrap_or_default();
    Ok((rig, folder))
}

fn from_flags(args: &ServeArgs) -> Result<RigPlan, Failure> {
    if args.pty.is_none() && args.serial.is_none() {
        return Err(Failure::usage(anyhow!(
            "say where to serve: --pty PATH for a pseudo-terminal, as in `sim --pty /tmp/r150`, \
             --serial DEVICE for a real serial port, or --rig FILE for several devices \
             (`sim --help` shows more)"
        )));
    }
    if args.device == Device::R150 && args.ros_pty.is_some() {
        let why = "--ros-pty is the mecanum car's: add --device mecanum";
        return Err(Failure::usage(anyhow!(why)));
    }
    let settings = config::load(&args.settings)?;
    let device = DevicePlan {
        name: args.device.kind().word().to_owned(),
        kind: args.device.kind(),
        start: args.start.into(),
        pose: Pose::default(),
        settings: settings.clone(),
        port: args.pty.clone(),
        ros: args.ros_pty.is_some(),
        ros_port: args.ros_pty.clone(),
    };
    Ok(RigPlan {
        world: None,
        seed: None,
        settings,
        devices: vec![device],
    })
}
