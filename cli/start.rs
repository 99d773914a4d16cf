//! From a plan to a running simulator, and the summary at its end.

use std::collections::hash_map::RandomState;
use std::hash::{BuildHasher as _, Hasher as _};

use anyhow::Context as _;
use serde_json::{Value, json};
use sim_core::device::Devices;
use sim_core::rig::PortId;
use sim_pty::{Counters, Waiter};
use sim_runner::{DevicePlan, RigPlan, Run, RunOptions};
use sim_settings::show_duration;

use crate::args::{LogFormat, ServeArgs};
use crate::config;
use crate::control::Desk;
use crate::exit::{Exit, Failure};
use crate::log::{Log, LogOptions, Words};
use crate::looking::Looking;
use crate::plan::plan;
use crate::ready_file::ReadyFile;
use crate::recording::TraceFile;
use crate::run;
use crate::scenario_files::Loaded;
use crate::summary;
use crate::visible;
use sim_embed::ports::{Elsewhere, ShownPort, open_all};
use sim_embed::serve::{Begin, Ended, Server};

/// Serves until a signal ends it, or the scenario.
pub(crate) fn serve(devices: Devices, args: &ServeArgs) -> Result<Exit, Failure> {
    let loaded = plan(devices, args)?;
    let seed = args.seed.or(loaded.scenario.rig.seed);
    let run = loaded.run(RunOptions {
        seed: seed.unwrap_or_else(random_seed),
        wire: args.wire(),
        live: true,
        trace: args.trace.is_some(),
    })?;
    let mut session = Session::open(args, &loaded, run)?;
    let ended = session.serve()?;
    if args.scenario.is_none() {
        session.finish(None)?;
        return Ok(Exit::Clean);
    }
    let broken_off = ended == Ended::Signal;
    let nobody_came = session.nobody_came();
    let run = session.server.run_mut();
    if nobody_came {
        run.fail(run::NO_PORT_OPENED.to_owned());
    }
    if broken_off {
        run.fail("a signal ended it before the scenario's end".to_owned());
    }
    let outcome = run.end().clone();
    let held_up = session.server.held_up();
    let is_spoilt = !outcome.passed && held_up.total > args.max_hold_up.0;
    let verdict = match args.log_format {
        LogFormat::Text => run::verdict_text(&outcome, held_up, is_spoilt),
        LogFormat::Json => visible::json(&run::verdict_json(&outcome, held_up, is_spoilt)),
    };
    session.finish(Some(verdict))?;
    Ok(if broken_off || is_spoilt {
        Exit::System
    } else if outcome.passed {
        Exit::Clean
    } else {
        Exit::Failed
    })
}

/// Devices that are served on ports, and the log of it.
struct Session {
    server: Server,
    log: Log,
    counters: Vec<(PortId, Counters)>,
    ready_file: Option<ReadyFile>,
    desk: Option<Desk>,
    trace: Option<TraceFile>,
}

impl Session {
    /// Opens the ports and says so.
    fn open(args: &ServeArgs, loaded: &Loaded, run: Run) -> Result<Self, Failure> {
        let (plan, seed) = (&loaded.scenario.rig, run.seed());
        let begin = match args.scenario {
            Some(_) => Begin::WithClient,
            None => Begin::Now,
        };
        // Before anything is opened, so that a signal at any time leaves nothing behind.
        let mut waiter = Waiter::new().map_err(Failure::system)?;
        waiter.catch_signals().map_err(Failure::system)?;
        let serial = args.serial.as_deref();
        let elsewhere = match &args.pty_folder {
            Some(folder) => Elsewhere::In(folder),
            None => Elsewhere::Unlinked,
        };
        let ports = open_all(
            &loaded.scenario,
            &loaded.folder(),
            serial,
            &elsewhere,
            args.pty_setup(),
        )
        .map_err(Failure::system)?;
        waiter.check_headroom().map_err(Failure::system)?;
        let options = LogOptions {
            format: args.log_format,
            verbose: args.verbose,
            quiet: args.quiet,
        };
        let log = Log::start(options, Words::new(plan))
            .context("cannot start the thread that prints")
            .map_err(Failure::system)?;
        let shown = ShownPort::all(&ports, plan);
        let when = (begin, args.speed);
        let mut server = Server::new(run, ports, waiter, when).map_err(Failure::system)?;
        announce(&log, args, loaded, &shown, seed);
        let ports: Vec<Value> = shown.iter().map(ShownPort::json).collect();
        let desk = args
            .control
            .map(|listen| Desk::open(listen, server.run(), shown))
            .transpose()?;
        if let Some(desk) = &desk {
            server.wake_from(&desk.control).map_err(Failure::system)?;
            announce_control(
                &log,
                desk,
                args.control
                    .is_some_and(|listen| !listen.ip().is_loopback()),
            );
        }
        let trace = args.trace.clone().map(TraceFile::create).transpose()?;
        let ready = json!({
            "code": "ready",
            "pid": std::process::id(),
            "seed": seed,
            "ports": ports,
        });
        let ready_file = args
            .ready_file
            .as_ref()
            .map(|path| ReadyFile::write(path, &format!("{ready}\n")))
            .transpose()
            .map_err(Failure::usage)?;
        log.text(match log.options.format {
            LogFormat::Text => "ready".to_owned(),
            LogFormat::Json => visible::json(&ready),
        });
        Ok(Self {
            server,
            log,
            counters: Vec::new(),
            ready_file,
            desk,
            trace,
        })
    }

    /// Serves to the end.
    fn serve(&mut self) -> Result<Ended, Failure> {
        let outcome = self.server.serve(&mut Looking {
            log: Some(&self.log),
            desk: self.desk.as_mut(),
            trace: &mut self.trace,
        });
        // Nobody is left to be answered.
        self.desk = None;
        // Whoever looks from here on finds nobody serving, however long the printing takes.
        self.ready_file = None;
        self.counters = self.server.close_ports();
        outcome.map_err(|error| {
            self.print_summary(None);
            Failure::system(error)
        })
    }

    /// Tells whether there were ports and no client has opened any; they are closed by now.
    fn nobody_came(&self) -> bool {
        let mut counters = self.counters.iter();
        !self.counters.is_empty() && counters.all(|(_, port)| port.attached == 0)
    }

    /// Prints the summary, and the verdict if there is one; ends the trace.
    fn finish(mut self, verdict: Option<String>) -> Result<(), Failure> {
        self.print_summary(verdict);
        let Some(mut trace) = self.trace.take() else {
            return Ok(());
        };
        let run = self.server.run_mut();
        run.end();
        trace.take(run);
        trace.finish()
    }

    fn print_summary(&mut self, verdict: Option<String>) {
        let run = self.server.run();
        let summary = (!self.log.options.quiet).then(|| match self.log.options.format {
            LogFormat::Text => summary::text(run, &self.counters),
            LogFormat::Json => visible::json(&summary::json(run, &self.counters)),
        });
        let last: Vec<String> = summary.into_iter().chain(verdict).collect();
        let last = (!last.is_empty()).then(|| last.join("\n"));
        let server = &mut self.server;
        self.log
            .finish(last, |within| server.is_interrupted(within));
    }
}

/// Says where the simulator is controlled, and warns if others can reach that.
fn announce_control(log: &Log, desk: &Desk, is_public: bool) {
    log.text(match log.options.format {
        LogFormat::Text => {
            let mut text = format!("  control on {}", desk.control.url());
            if is_public {
                text += "\n  warning: other machines can reach this address, and whoever has the token \
                         controls the simulator; nothing is encrypted";
            }
            text
        }
        LogFormat::Json => {
            visible::json(&json!({"code": "control", "url": desk.control.url(), "public": is_public}))
        }
    });
}

fn announce(log: &Log, args: &ServeArgs, loaded: &Loaded, ports: &[ShownPort], seed: u64) {
    if log.options.quiet {
        return;
    }
    let scenario = args.scenario.is_some().then_some(loaded);
    let plan: &RigPlan = &loaded.scenario.rig;
    let version = env!("CARGO_PKG_VERSION");
    let wire = args.wire().as_str();
    let mut changed: Vec<String> = plan
        .devices
        .iter()
        .flat_map(|device| config::changed(&device.settings))
        .collect();
    changed.sort();
    changed.dedup();
    let text = match log.options.format {
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
                for port in ports.iter().filter(|port| port.link.id.device == device) {
                    text += &format!(
                        "\n  {} ({} link) on {} at {} baud 8N{}{}",
                        port.link.device,
                        port.link.name,
                        visible::name(&port.path),
                        port.link.baud,
                        port.link.stop_bits,
                        start.as_deref().unwrap_or_default(),
                    );
                }
            }
            for port in ports.iter().filter(|port| port.is_public) {
                text += &format!(
                    "\n  warning: any machine that reaches this one can open {}; 127.0.0.1 keeps them \
                     out",
                    port.path.display()
                );
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
