//! From a plan to a running simulator, and the summary at its end.

use std::ffi::OsString;
use std::time::Duration;

use anyhow::Context as _;
use rigsim_core::SimTime;
use rigsim_core::device::Devices;
use rigsim_core::rig::PortId;
use rigsim_pty::paths::HeldResults;
use rigsim_pty::{Counters, Waiter};
use rigsim_runner::{DevicePlan, RigPlan, Run, RunOptions};
use rigsim_settings::show_duration;
use serde_json::{Value, json};

use crate::args::{Cli, ReplayArgs, ServeArgs};
use crate::attendant::LogAttendant;
use crate::config;
use crate::control::{Past, RequestQueue};
use crate::exit::{Exit, Failure};
use crate::log::{Log, LogFormat, LogOptions, Words};
use crate::plan::plan;
use crate::ready_file;
use crate::recording::{self, TraceFile};
use crate::run;
use crate::scenario_files::Loaded;
use crate::summary;
use crate::visible;
use rigsim_embed::ports::{ShownPort, open_all};
use rigsim_embed::serve::{Begin, Ended, Server};

/// Serves until a signal ends it, or the scenario.
pub(crate) fn serve(devices: Devices, args: &ServeArgs) -> Result<Exit, Failure> {
    let loaded = plan(devices, args)?;
    let seed = args.seed.or(loaded.scenario.rig.seed);
    let run = loaded.run(RunOptions {
        seed: seed.unwrap_or_else(run::random_seed),
        wire: args.wire(),
        live: true,
        trace: args.trace.is_some(),
    })?;
    let begin = match args.scenario {
        Some(_) => Begin::WithClient,
        None => Begin::Now,
    };
    let mut session = Session::open(args, &loaded, run, begin)?;
    let ended = session.serve()?;
    if args.scenario.is_none() {
        session.finish(None)?;
        return Ok(Exit::Clean);
    }
    let no_client_came = session.no_client_came();
    let run = session.server.run_mut();
    if no_client_came {
        run.fail(run::NO_PORT_OPENED.to_owned());
    }
    if ended == Ended::Signal {
        run.fail("a signal ended it before the scenario's end".to_owned());
    }
    let played = run::Played {
        outcome: run.end().clone(),
        client: None,
        took: Duration::ZERO,
        trace: None,
        stalled: Some(session.server.stalled()),
    };
    let why = no_client_came.then(|| run::NO_PORT_OPENED.to_owned());
    let mut result = run::CaseResult::of(played, why, args.max_stall.0);
    if ended == Ended::Signal {
        result.verdict = run::Verdict::Aborted;
    }
    let verdict = match args.log_format {
        LogFormat::Text => run::verdict_text(&loaded.scenario, &result),
        LogFormat::Json => visible::json(&run::verdict_json(&loaded.scenario, &result)),
    };
    session.finish(Some(verdict))?;
    Ok(result.verdict.exit())
}

/// The `replay` subcommand: compares a run with its trace, or stops on the way and goes on live.
pub(crate) fn replay(devices: Devices, args: &ReplayArgs) -> Result<Exit, Failure> {
    let Some(until) = &args.until else {
        return recording::replay(devices, &args.trace);
    };
    let until = SimTime::ZERO + until.0;
    let mut past = Past::before(until);
    let run = recording::until(devices, &args.trace, until, &mut past)?;
    let words = ["sim", "--control", &args.control.to_string()].map(OsString::from);
    let serve = Cli::parse(devices, &words).map_err(Failure::usage)?.serve;
    let header = recording::header(&args.trace)?;
    let loaded = Loaded::replayed(&run, header.and_then(|header| header.world));
    let mut session = Session::open(&serve, &loaded, run, Begin::Paused)?;
    if let Some(requests) = &mut session.requests {
        requests.past = Some(past);
    }
    session.serve()?;
    session.finish(None)?;
    Ok(Exit::Clean)
}

/// Devices that are served on ports, and the log of it.
struct Session {
    server: Server,
    log: Log,
    counters: Vec<(PortId, Counters)>,
    ready_file: Option<HeldResults>,
    requests: Option<RequestQueue>,
    trace: Option<TraceFile>,
}

impl Session {
    /// Opens the ports and says so.
    fn open(args: &ServeArgs, loaded: &Loaded, run: Run, begin: Begin) -> Result<Self, Failure> {
        let (plan, seed) = (&loaded.scenario.rig, run.seed());
        // Before anything is opened, so that a signal at any time leaves nothing behind.
        let mut waiter = Waiter::new().map_err(Failure::system)?;
        waiter.catch_signals().map_err(Failure::system)?;
        let ports = open_all(
            &loaded.scenario,
            &loaded.folder(),
            args.serial.as_deref(),
            args.pty_folder.as_deref(),
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
        let mut server =
            Server::new(run, ports, waiter, begin, args.speed).map_err(Failure::system)?;
        announce(&log, args, loaded, &shown, seed);
        let ports: Vec<Value> = shown.iter().map(ShownPort::json).collect();
        let requests = args
            .control
            .map(|listen| RequestQueue::open(listen, loaded.beginning(), server.run(), shown))
            .transpose()?;
        if let Some(requests) = &requests {
            server
                .wake_from(&requests.control)
                .map_err(Failure::system)?;
            announce_control(&log, requests);
        }
        let trace = args.trace.clone().map(TraceFile::create).transpose();
        let trace = trace.map_err(Failure::usage)?;
        let ready = json!({
            "code": "ready",
            "pid": std::process::id(),
            "seed": seed,
            "ports": ports,
        });
        // A script that finds the ready file finds the address of the control socket in the log.
        log.flush();
        let ready_file = args
            .ready_file
            .as_ref()
            .map(|path| ready_file::hold(path, &format!("{ready}\n")))
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
            requests,
            trace,
        })
    }

    /// Serves to the end.
    fn serve(&mut self) -> Result<Ended, Failure> {
        let mut attendant = LogAttendant {
            log: Some(&self.log),
            requests: self.requests.as_mut(),
            client: None,
            trace: &mut self.trace,
        };
        let outcome = (self.server).serve(|run, clock, woken| attendant.attend(run, clock, woken));
        // No request is left to be answered.
        self.requests = None;
        // From here on there is no ready file, however long the printing takes.
        self.ready_file = None;
        self.counters = self.server.close_ports();
        outcome.map_err(|error| {
            self.print_summary(None);
            Failure::system(error)
        })
    }

    /// Returns whether there were ports and no client has opened any; they are closed by now.
    fn no_client_came(&self) -> bool {
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
        trace.finish().map(|_| ())
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
/// Prints the URL of the control socket.
pub(crate) fn announce_control(log: &Log, requests: &RequestQueue) {
    let is_public = requests.control.is_public();
    log.text(match log.options.format {
        LogFormat::Text => {
            let mut text = format!("  control on {}", requests.control.url());
            if is_public {
                text += "\n  warning: other machines can reach this address, and a client that has the token \
                         controls the simulator; nothing is encrypted";
            }
            text
        }
        LogFormat::Json => {
            visible::json(&json!({"code": "control", "url": requests.control.url(), "public": is_public}))
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
                        "\n  {} ({} link) on {} at {} baud 8N1{}",
                        port.link.device,
                        port.link.name,
                        visible::name(&port.path),
                        port.link.baud,
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
