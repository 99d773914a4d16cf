//! A scenario against a real client, in real time.

use std::ffi::OsString;
use std::fs::File;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use anyhow::{Context as _, anyhow};
use sim_pty::Waiter;
use sim_runner::Run;
use sim_settings::show_duration;

use crate::client::Client;
use crate::control::Desk;
use crate::exit::Failure;
use crate::looking::Looking;
use crate::plan::absolute;
use crate::supervise::ClientEnd;
use crate::visible;
use sim_core::rig::PortId;
use sim_embed::ports::{Elsewhere, ShownPort, open_all, variable};
use sim_embed::serve::{Begin, Ended, Server};
use sim_pty::PtySetup;

use super::case::{Case, CaseResult, Played, PlayedClient};
use super::trace_file::TraceFile;

/// Simulated time between looks at the ports, once the client has ended.
const SLICE: Duration = Duration::from_millis(500);

/// The same while bytes of the client are still to be taken: as many as arrive in this have room
/// on the line again.
const SHORT_SLICE: Duration = Duration::from_millis(5);

/// The reason of a scenario that took too long.
pub(crate) fn over_time(allowed: Duration) -> String {
    format!(
        "it was still going on after the {} of real time that are allowed (--timeout, or \
         `wall_limit` in the file)",
        show_duration(allowed)
    )
}

/// Plays it. The client ends before this returns, whatever happens.
pub(crate) fn play(case: &Case<'_>, stop: &AtomicBool) -> Result<CaseResult, Failure> {
    let begun = Instant::now();
    // Before anything is opened, so that a signal at any time leaves nothing behind.
    let mut waiter = Waiter::new().map_err(Failure::system)?;
    waiter.catch_signals().map_err(Failure::system)?;
    if stop.load(Ordering::Relaxed) {
        return Ok(CaseResult::BrokenOff);
    }
    let (run, trace) = case.begin()?;
    let links = tempfile::Builder::new()
        .prefix("sim-")
        .tempdir()
        .context("cannot make a folder for the ports")
        .map_err(Failure::system)?;
    let elsewhere = Elsewhere::In(links.path());
    let ports = open_all(
        &case.loaded.scenario,
        &case.loaded.folder(),
        None,
        &elsewhere,
        PtySetup::raw(0),
    )
    .map_err(Failure::system)?;
    let paths = ports.iter().map(|served| (served.id, served.path.clone()));
    let mut environment = environment(case, paths)?;
    let shown = || {
        ports
            .iter()
            .map(|port| ShownPort::new(port, &case.loaded.scenario.rig))
    };
    let desk = case.desk(&run, || shown().collect(), &mut environment)?;
    let log = case.file("client.log").map(|path| {
        File::create(&path).with_context(|| {
            format!(
                "cannot write the client's output to {}",
                visible::name(&path)
            )
        })
    });
    let log = log.transpose().map_err(Failure::system)?;
    let when = (Begin::WithClient, case.speed);
    let mut server = Server::new(run, ports, waiter, when).map_err(Failure::system)?;
    let client =
        Client::start(case.client, &environment, links.path(), log).map_err(Failure::system)?;
    server.watch(client.status()).map_err(Failure::system)?;
    if let Some(desk) = &desk {
        server.wake_from(desk.wakes()).map_err(Failure::system)?;
    }
    server.stop_after(case.allowed);
    let mut play = LivePlay {
        server,
        client,
        trace,
        desk,
        begun,
    };
    let played = play.play(case, stop).map_err(Failure::system)?;
    if let Some(client) = &played
        && let ClientEnd::NotStarted(why) = &client.end
    {
        let shown = visible::name(&case.client[0]);
        return Err(Failure::usage(anyhow!(
            "cannot start the client {shown}: {why}"
        )));
    }
    // The trace has its end in any case, so that it can be played again.
    let outcome = play.server.run_mut().end().clone();
    take(play.server.run_mut(), &mut play.trace);
    play.trace.map_or(Ok(()), TraceFile::finish)?;
    let passed = outcome.passed;
    let held_up = play.server.held_up();
    Ok(match played {
        None => CaseResult::BrokenOff,
        Some(client) => CaseResult::Played(Box::new(Played {
            outcome,
            client: Some(client),
            took: begun.elapsed(),
            held_up: Some(held_up),
            is_spoilt: !passed && held_up.total > case.most_held_up,
        })),
    })
}

/// The reason of a scenario whose client has opened no port.
pub(crate) const NO_PORT_OPENED: &str = "the client ended without having opened a port";

/// The same of a client that was started here.
pub(crate) fn no_port_opened(case: &Case<'_>) -> String {
    let variables = super::tell::variables(&case.loaded.scenario).join(", ");
    format!("{NO_PORT_OPENED}; it finds the paths of all in its environment: {variables}")
}

/// Environment of the client.
pub(crate) fn environment(
    case: &Case<'_>,
    ports: impl Iterator<Item = (PortId, PathBuf)>,
) -> Result<Vec<(String, OsString)>, Failure> {
    let plan = &case.loaded.scenario.rig;
    let mut environment: Vec<(String, OsString)> = Vec::new();
    for (id, path) in ports {
        let device = &plan.devices[id.device];
        let links = device.links();
        let link = links.iter().find(|link| link.index == id.link);
        let variable = variable(&device.name, id.link, link.map_or("", |link| link.name));
        if environment.iter().any(|(other, _)| *other == variable) {
            return Err(Failure::usage(anyhow!(
                "{}: two ports would both be found in ${variable}; give the devices names that \
                 differ in more than -, _ and the case of letters",
                visible::name(&case.loaded.path)
            )));
        }
        environment.push((variable, absolute(&path)?.into()));
    }
    environment.push(("SIM_SEED".to_owned(), case.seed.to_string().into()));
    environment.push((
        "SIM_SCENARIO".to_owned(),
        absolute(&case.loaded.path)?.into(),
    ));
    Ok(environment)
}

struct LivePlay {
    server: Server,
    client: Client,
    trace: Option<TraceFile>,
    desk: Option<Desk>,
    begun: Instant,
}

impl LivePlay {
    /// Plays until the scenario or the client ends; `None` if a signal came first. The client has
    /// ended then.
    fn play(&mut self, case: &Case<'_>, stop: &AtomicBool) -> anyhow::Result<Option<PlayedClient>> {
        let ended = self.server.serve(&mut Looking {
            log: None,
            desk: self.desk.as_mut(),
            trace: &mut self.trace,
        })?;
        // Nobody is left to be answered.
        self.desk = None;
        let stopped = ended != Ended::Watched;
        let end = if stopped {
            self.client.stop()?
        } else {
            self.client.wait()?
        };
        match ended {
            Ended::Signal => return Ok(self.broken_off()),
            Ended::Over => {}
            Ended::Timeout => self.fail(over_time(case.allowed)),
            Ended::Watched if end != ClientEnd::Exited(0) => {
                self.server.take_the_rest()?;
                self.fail(format!("the client {end}"));
            }
            Ended::Watched if !self.server.has_begun() => {
                self.fail(no_port_opened(case));
            }
            Ended::Watched => {
                if !self.play_the_rest(case, stop)? {
                    return Ok(self.broken_off());
                }
            }
        }
        Ok(Some(PlayedClient {
            end,
            stopped,
            output: self.client.output().text(),
            outside: Vec::new(),
            refused: Vec::new(),
        }))
    }

    /// The client has done its work and left. What it had still sent is on its way, and the rest of
    /// the scenario shows what becomes of the vehicle. `false` if a signal came first.
    fn play_the_rest(&mut self, case: &Case<'_>, stop: &AtomicBool) -> anyhow::Result<bool> {
        let mut gone = false;
        while self.server.run().finished().is_none() {
            gone = gone || self.server.take_the_rest()?;
            let to = self.server.run().rig().now() + if gone { SLICE } else { SHORT_SLICE };
            loop {
                if stop.load(Ordering::Relaxed) {
                    return Ok(false);
                }
                if self.begun.elapsed() > case.allowed {
                    self.fail(over_time(case.allowed));
                    return Ok(true);
                }
                let run = self.server.run_mut();
                let more = run.step(to)?;
                take(run, &mut self.trace);
                if !more {
                    break;
                }
            }
        }
        Ok(true)
    }

    fn broken_off(&mut self) -> Option<PlayedClient> {
        self.fail("a signal ended it".to_owned());
        None
    }

    fn fail(&mut self, what: String) {
        self.server.run_mut().fail(what);
    }
}

/// Takes what the run has to tell.
pub(crate) fn take(run: &mut Run, trace: &mut Option<TraceFile>) {
    while run.poll_event().is_some() {}
    if let Some(trace) = trace {
        trace.take(run);
    }
}
