//! From a plan to a running simulator, and the summary at its end.

use std::collections::hash_map::RandomState;
use std::hash::{BuildHasher as _, Hasher as _};
use std::path::Path;

use anyhow::Context as _;
use serde_json::json;
use sim_core::rig::PortId;
use sim_pty::{Port, PtyPort, SerialPort, Waiter};
use sim_scenarios::RigPlan;

use crate::args::{LogFormat, ServeArgs};
use crate::config;
use crate::exit::{Exit, Failure};
use crate::log::{DeviceName, Log, LogOptions};
use crate::plan::{Plan, plan};
use crate::ready_file::ReadyFile;
use crate::serve::{Served, Server};
use crate::summary::{self, DeviceSummary, RunSummary};

/// Serves until a signal ends it.
pub(crate) fn serve(args: &ServeArgs) -> Result<Exit, Failure> {
    let Plan {
        rig: plan,
        map,
        folder,
    } = plan(args)?;
    let seed = args.seed.or(plan.seed).unwrap_or_else(random_seed);
    let rig = plan.build(map, args.wire(), seed);
    // Before anything is opened, so that a signal at any time leaves nothing behind.
    let mut waiter = Waiter::new().map_err(Failure::system)?;
    waiter.catch_signals().map_err(Failure::system)?;
    let ports = open_all(args, &plan, &folder)?;

    let options = LogOptions {
        format: args.log_format,
        verbose: args.verbose,
        quiet: args.quiet,
    };
    let names: Vec<DeviceName> = plan
        .devices
        .iter()
        .map(|device| DeviceName {
            name: device.name.clone(),
            links: device.links().iter().map(|link| link.name).collect(),
        })
        .collect();
    let log = Log::start(options, names.clone())
        .context("cannot start the thread that prints")
        .map_err(Failure::system)?;
    let shown: Vec<ShownPort> = ports
        .iter()
        .map(|port| ShownPort::new(port, &plan))
        .collect();
    let mut server = Server::new(rig, ports, waiter, args.speed).map_err(Failure::system)?;

    announce(&log, args, &plan, &shown, seed);
    let ready = json!({
        "code": "ready",
        "pid": std::process::id(),
        "seed": seed,
        "ports": shown.iter().map(ShownPort::json).collect::<Vec<_>>(),
    });
    let ready_file = args
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
    // Whoever looks from here on finds nobody serving, however long the printing takes.
    drop(ready_file);
    let counters = server.close_ports();
    let summary = (!log.is_quiet()).then(|| {
        let devices: Vec<DeviceSummary<'_>> = names
            .iter()
            .enumerate()
            .map(|(device, named)| DeviceSummary {
                name: &named.name,
                report: server.report(device),
                distance_m: server.rig().distance_m(device),
                ports: counters
                    .iter()
                    .filter(|(id, _)| id.device == device)
                    .map(|(_, counters)| *counters)
                    .collect(),
            })
            .collect();
        let run = RunSummary {
            now: server.rig().now(),
            events_lost: server.rig().events_lost(),
            excused: server.excused(),
        };
        match log.format() {
            LogFormat::Text => summary::text(&run, &devices),
            LogFormat::Json => summary::json(&run, &devices).to_string(),
        }
    });
    log.finish(summary, |within| server.is_interrupted(within));
    outcome.map(|()| Exit::Clean)
}

/// Opens every port of the plan; relative paths are relative to `folder`.
fn open_all(args: &ServeArgs, plan: &RigPlan, folder: &Path) -> Result<Vec<Served>, Failure> {
    let mut ports = Vec::new();
    for (device, planned) in plan.devices.iter().enumerate() {
        for link in planned.links() {
            let id = PortId {
                device,
                link: link.index,
            };
            let port = match (&args.serial, &link.path) {
                (Some(serial), _) if link.index == 0 => {
                    SerialPort::open(serial, link.baud).map(Port::from)
                }
                (_, Some(path)) => PtyPort::open_at(folder.join(path), link.baud).map(Port::from),
                (_, None) => PtyPort::open_unlinked(link.baud).map(Port::from),
            };
            ports.push(Served {
                id,
                port: port.map_err(Failure::system)?,
            });
        }
    }
    Ok(ports)
}

/// A port as the user is told of it.
struct ShownPort {
    device: String,
    link: &'static str,
    path: std::path::PathBuf,
    baud: u32,
}

impl ShownPort {
    fn new(served: &Served, plan: &RigPlan) -> Self {
        let device = &plan.devices[served.id.device];
        let link = device
            .links()
            .into_iter()
            .find(|link| link.index == served.id.link);
        let (link, baud) = link.map_or(("", 0), |link| (link.name, link.baud));
        Self {
            device: device.name.clone(),
            link,
            path: served.port.path().to_owned(),
            baud,
        }
    }

    fn json(&self) -> serde_json::Value {
        json!({"device": self.device, "link": self.link, "path": self.path, "baud": self.baud})
    }
}

fn announce(log: &Log, args: &ServeArgs, plan: &RigPlan, ports: &[ShownPort], seed: u64) {
    if log.is_quiet() {
        return;
    }
    let version = env!("CARGO_PKG_VERSION");
    let wire = args.wire().word();
    let mut changed: Vec<String> = plan
        .devices
        .iter()
        .flat_map(|device| config::changed(&device.settings))
        .collect();
    changed.sort();
    changed.dedup();
    let text = match log.format() {
        LogFormat::Text => {
            let changed = match changed.as_slice() {
                [] => "all default (`sim config` lists them)".to_owned(),
                changed => format!("default but for {}", changed.join(", ")),
            };
            let mut text = format!(
                "sim {version}: wire {wire}, speed {}, seed {seed}",
                args.speed
            );
            for (device, planned) in plan.devices.iter().enumerate() {
                let start = planned.start_word().map(|word| format!(", start {word}"));
                for port in ports
                    .iter()
                    .filter(|port| port.device == plan.devices[device].name)
                {
                    text += &format!(
                        "\n  {} ({} link) on {} at {} baud 8N1{}",
                        port.device,
                        port.link,
                        port.path.display(),
                        port.baud,
                        start.as_deref().unwrap_or_default(),
                    );
                }
            }
            format!("{text}\n  settings: {changed}")
        }
        LogFormat::Json => json!({
            "code": "start",
            "version": version,
            "ports": ports.iter().map(ShownPort::json).collect::<Vec<_>>(),
            "wire": wire,
            "speed": args.speed,
            "seed": seed,
            "changed": changed,
        })
        .to_string(),
    };
    log.text(text);
}

/// A seed short enough to type again.
pub(crate) fn random_seed() -> u64 {
    RandomState::new().build_hasher().finish() % 1_000_000_000
}
