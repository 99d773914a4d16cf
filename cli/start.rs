//! From a plan to a running simulator, and the summary at its end.

use std::collections::hash_map::RandomState;
use std::hash::{BuildHasher as _, Hasher as _};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use anyhow::Context as _;
use serde_json::json;
use sim_core::event::Event;
use sim_core::report::Report;
use sim_core::rig::PortId;
use sim_pty::{Counters, Waiter};
use sim_runner::{DevicePlan, RigPlan, RunOptions};
use sim_settings::show_duration;

use crate::args::{LogFormat, ServeArgs};
use crate::config;
use crate::exit::{Exit, Failure};
use crate::log::{DeviceName, Log, LogOptions};
use crate::plan::{Plan, plan};
use crate::ready_file::ReadyFile;
use crate::run;
use crate::summary::{self, DeviceSummary, RunSummary};
use crate::visible;
use sim_embed::fairness::Fairness;
use sim_embed::ports::{Elsewhere, ShownPort, open_all};
use sim_embed::serve::{Begin, Ended, Server};
use sim_embed::simulation::Simulation;

/// Serves until a signal ends it, or the scenario.
pub(crate) fn serve(args: &ServeArgs) -> Result<Exit, Failure> {
    let plan = plan(args)?;
    let seed = args.seed.or(plan.rig.seed).unwrap_or_else(random_seed);
    let fairness = Arc::new(Mutex::new(Fairness::default()));
    let Some(loaded) = &plan.scenario else {
        let rig = plan.rig.build(plan.map.clone(), args.wire(), seed);
        let reports = vec![Report::default(); rig.devices()];
        let mut session = Session::open(args, &plan, seed, rig, (Begin::Now, fairness))?;
        let (_, reports) = session.serve(reports)?;
        session.finish(&reports, None);
        return Ok(Exit::Clean);
    };
    let mut run = loaded.run(RunOptions {
        seed,
        wire: args.wire(),
        live: true,
        trace: false,
    })?;
    let shared = Arc::clone(&fairness);
    run.excuse_with(Box::new(move |event| lock(&shared).would_excuse(event)));
    let mut session = Session::open(args, &plan, seed, run, (Begin::WithClient, fairness))?;
    // Counted by the run, which knows of its own faults; these only count what is excused.
    let (ended, _) = session.serve(vec![Report::default(); plan.rig.devices.len()])?;
    let broken_off = ended == Ended::Signal;
    if broken_off {
        let run = session.server.simulation_mut();
        run.fail("a signal ended it before the scenario's end".to_owned());
    }
    let outcome = session.server.simulation_mut().end().clone();
    let reports: Vec<Report> = outcome.devices.iter().map(|d| d.report.clone()).collect();
    let verdict = match args.log_format {
        LogFormat::Text => run::verdict_text(&outcome),
        LogFormat::Json => visible::json(&run::verdict_json(&outcome)),
    };
    session.finish(&reports, Some(verdict));
    Ok(if broken_off {
        Exit::System
    } else if outcome.passed {
        Exit::Clean
    } else {
        Exit::Failed
    })
}

fn lock(fairness: &Mutex<Fairness>) -> MutexGuard<'_, Fairness> {
    fairness.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Devices that are served on ports, and the log of it.
struct Session<S> {
    server: Server<S>,
    fairness: Arc<Mutex<Fairness>>,
    log: Log,
    names: Vec<DeviceName>,
    counters: Vec<(PortId, Counters)>,
    ready_file: Option<ReadyFile>,
}

impl<S: Simulation> Session<S> {
    /// Opens the ports and says so.
    fn open(
        args: &ServeArgs,
        plan: &Plan,
        seed: u64,
        simulation: S,
        (begin, fairness): (Begin, Arc<Mutex<Fairness>>),
    ) -> Result<Self, Failure> {
        // Before anything is opened, so that a signal at any time leaves nothing behind.
        let mut waiter = Waiter::new().map_err(Failure::system)?;
        waiter.catch_signals().map_err(Failure::system)?;
        let serial = args.serial.as_deref();
        let ports = open_all(&plan.rig, &plan.folder, serial, &Elsewhere::Unlinked)
            .map_err(Failure::system)?;
        waiter.check_headroom().map_err(Failure::system)?;
        let options = LogOptions {
            format: args.log_format,
            verbose: args.verbose,
            quiet: args.quiet,
        };
        let devices = plan.rig.devices.iter();
        let names: Vec<DeviceName> = devices
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
            .map(|port| ShownPort::new(port, &plan.rig))
            .collect();
        let when = (begin, args.speed);
        let server = Server::new(simulation, ports, waiter, when, Arc::clone(&fairness))
            .map_err(Failure::system)?;
        announce(&log, args, plan, &shown, seed);
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
            LogFormat::Json => visible::json(&ready),
        });
        Ok(Self {
            server,
            fairness,
            log,
            names,
            counters: Vec::new(),
            ready_file,
        })
    }

    /// Serves to the end, and counts what happens at each device.
    fn serve(&mut self, mut reports: Vec<Report>) -> Result<(Ended, Vec<Report>), Failure> {
        let (log, fairness) = (&self.log, &self.fairness);
        let outcome = self.server.run(|simulation| {
            while let Some(event) = simulation.poll_event() {
                note(&mut reports, fairness, &event);
                log.event(event);
            }
        });
        // Whoever looks from here on finds nobody serving, however long the printing takes.
        self.ready_file = None;
        self.counters = self.server.close_ports();
        match outcome {
            Ok(ended) => Ok((ended, reports)),
            Err(error) => {
                self.print_summary(&reports, None);
                Err(Failure::system(error))
            }
        }
    }

    /// Prints the summary, and the verdict if there is one.
    fn finish(mut self, reports: &[Report], verdict: Option<String>) {
        self.print_summary(reports, verdict);
    }

    fn print_summary(&mut self, reports: &[Report], verdict: Option<String>) {
        let rig = self.server.simulation().rig();
        let summary = (!self.log.is_quiet()).then(|| {
            let devices: Vec<DeviceSummary<'_>> = self
                .names
                .iter()
                .zip(reports)
                .enumerate()
                .map(|(device, (named, report))| DeviceSummary {
                    name: &named.name,
                    report,
                    distance_m: rig.distance_m(device),
                    ports: self
                        .counters
                        .iter()
                        .filter(|(id, _)| id.device == device)
                        .map(|(_, counters)| *counters)
                        .collect(),
                })
                .collect();
            let run = RunSummary {
                now: rig.now(),
                events_lost: rig.events_lost(),
                excused: lock(&self.fairness).excused(),
            };
            match self.log.format() {
                LogFormat::Text => summary::text(&run, &devices),
                LogFormat::Json => visible::json(&summary::json(&run, &devices)),
            }
        });
        let last: Vec<String> = summary.into_iter().chain(verdict).collect();
        let last = (!last.is_empty()).then(|| last.join("\n"));
        let server = &mut self.server;
        self.log
            .finish(last, |within| server.is_interrupted(within));
    }
}

fn note(reports: &mut [Report], fairness: &Mutex<Fairness>, event: &Event) {
    if !lock(fairness).excuses(event)
        && let Some(report) = reports.get_mut(event.device)
    {
        report.note(event);
    }
}

fn announce(log: &Log, args: &ServeArgs, plan: &Plan, ports: &[ShownPort], seed: u64) {
    if log.is_quiet() {
        return;
    }
    let scenario = plan.scenario.as_ref();
    let plan: &RigPlan = &plan.rig;
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
                        "\n  {} ({} link) on {} at {} baud 8N{}{}",
                        port.device,
                        port.link,
                        visible::name(&port.path),
                        port.baud,
                        port.stop_bits,
                        start.as_deref().unwrap_or_default(),
                    );
                }
            }
            text += &format!("\n  settings: {changed}");
            if let Some(loaded) = scenario {
                text += &format!(
                    "\n  scenario {}: {}\n  a good client: {}\n  time begins when a client opens a \
                     port, and ends after {}",
                    visible::name(&loaded.path),
                    visible::line(&loaded.scenario.title),
                    visible::line(&loaded.scenario.good_client),
                    show_duration(loaded.scenario.limit),
                );
            }
            text
        }
        LogFormat::Json => visible::json(&json!({
            "code": "start",
            "version": version,
            "ports": ports.iter().map(ShownPort::json).collect::<Vec<_>>(),
            "starts": starts(plan),
            "wire": wire,
            "speed": args.speed,
            "seed": seed,
            "changed": changed,
            "scenario": scenario.map(|loaded| visible::path_value(&loaded.path)),
        })),
    };
    log.text(text);
}

/// In which state each device starts that has a choice, by its name.
fn starts(plan: &RigPlan) -> serde_json::Value {
    let start = |planned: &DevicePlan| Some((planned.name.clone(), json!(planned.start_word()?)));
    serde_json::Value::Object(plan.devices.iter().filter_map(start).collect())
}

/// A seed short enough to type again.
pub(crate) fn random_seed() -> u64 {
    RandomState::new().build_hasher().finish() % 1_000_000_000
}
