//! From flags to a running simulator, and the summary at its end.

use std::collections::hash_map::RandomState;
use std::hash::{BuildHasher as _, Hasher as _};
use std::path::Path;

use anyhow::{Context as _, anyhow};
use serde_json::json;
use sim_core::rig::{PortId, Rig, RigSettings};
use sim_core::settings::SimSettings;
use sim_physics::Pose;
use sim_pty::{Port, PtyPort, SerialPort};

use crate::args::{Device, LogFormat, ServeArgs};
use crate::config;
use crate::exit::{Exit, Failure};
use crate::log::{Log, LogOptions};
use crate::ready_file::ReadyFile;
use crate::serve::{Served, Server};
use crate::summary::{self, DeviceSummary};

/// Serves one device until a signal ends it.
pub(crate) fn serve(args: &ServeArgs) -> Result<Exit, Failure> {
    let settings = config::load(&args.settings)?;
    let seed = args.seed.unwrap_or_else(random_seed);
    let name = args.device.name();
    let Device::R150 = args.device;
    let mut rig = Rig::new(RigSettings {
        world: settings.world.clone(),
        wire: args.wire.into(),
        seed,
    });
    let device = rig.add_r150(name, &settings.r150, args.start.into(), Pose::default());
    let id = PortId { device, link: 0 };

    let port = open(args, settings.r150.firmware.baud)?;
    let options = LogOptions {
        format: args.log_format,
        verbose: args.verbose,
        quiet: args.quiet,
    };
    let log = Log::start(options, vec![name.to_owned()])
        .context("cannot start the thread that prints")
        .map_err(Failure::system)?;
    let path = port.path().to_owned();
    let mut server =
        Server::new(rig, vec![Served { id, port }], args.speed).map_err(Failure::system)?;

    announce(&log, args, &settings, &path, seed);
    let ready = json!({
        "code": "ready",
        "pid": std::process::id(),
        "seed": seed,
        "ports": [{"device": name, "path": path}],
    });
    let _ready_file = args
        .ready_file
        .as_ref()
        .map(|path| ReadyFile::write(path, &format!("{ready}\n")))
        .transpose()
        .map_err(Failure::usage)?;
    log.text(match log.format() {
        LogFormat::Text => "ready".to_owned(),
        LogFormat::Json => ready.to_string(),
    });

    let outcome = server.run(&log).map_err(Failure::system);
    if !log.is_quiet() {
        let devices = [DeviceSummary {
            name,
            report: server.report(device),
            distance_m: server
                .rig()
                .r150(device)
                .map_or(0.0, |r150| r150.truth().distance),
        }];
        let now = server.rig().now();
        log.text(match log.format() {
            LogFormat::Text => summary::text(now, &devices),
            LogFormat::Json => summary::json(now, &devices).to_string(),
        });
    }
    outcome.map(|()| Exit::Clean)
}

fn open(args: &ServeArgs, baud: u32) -> Result<Port, Failure> {
    match (&args.pty, &args.serial) {
        (Some(path), _) => PtyPort::open_at(path, baud)
            .map(Port::from)
            .map_err(Failure::system),
        (None, Some(path)) => SerialPort::open(path, baud)
            .map(Port::from)
            .map_err(Failure::system),
        (None, None) => Err(Failure::usage(anyhow!(
            "say where to serve: --pty PATH for a pseudo-terminal, as in `sim --pty /tmp/r150`, \
             or --serial DEVICE for a real serial port (`sim --help` shows more)"
        ))),
    }
}

fn announce(log: &Log, args: &ServeArgs, settings: &SimSettings, path: &Path, seed: u64) {
    if log.is_quiet() {
        return;
    }
    let version = env!("CARGO_PKG_VERSION");
    let name = args.device.name();
    let baud = settings.r150.firmware.baud;
    let wire = sim_core::line::Wire::from(args.wire).word();
    let start = args.start.word();
    let changed = config::changed(settings);
    log.text(match log.format() {
        LogFormat::Text => {
            let changed = match changed.as_slice() {
                [] => "all default (`sim config` lists them)".to_owned(),
                changed => format!("default but for {}", changed.join(", ")),
            };
            format!(
                "sim {version}: {name} on {} at {baud} baud 8N1, wire {wire}, start {start}, \
                 speed {}, seed {seed}\nsettings: {changed}",
                path.display(),
                args.speed,
            )
        }
        LogFormat::Json => json!({
            "code": "start",
            "version": version,
            "device": name,
            "path": path,
            "baud": baud,
            "wire": wire,
            "start": start,
            "speed": args.speed,
            "seed": seed,
            "changed": changed,
        })
        .to_string(),
    });
}

/// A seed short enough to type again.
fn random_seed() -> u64 {
    RandomState::new().build_hasher().finish() % 1_000_000_000
}
