//! A scenario against a real client, in real time.

use std::ffi::OsString;
use std::fs::File;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use anyhow::{Context as _, anyhow};
use sim_pty::Waiter;

use crate::client::Client;
use crate::control::Desk;
use crate::exit::Failure;
use crate::looking::Looking;
use crate::plan::absolute;
use crate::supervise::ClientEnd;
use crate::visible;
use sim_core::SimTime;
use sim_embed::ports::{Elsewhere, ShownPort, open_all};
use sim_embed::serve::{Begin, Ended, Server};
use sim_pty::PtySetup;

use super::case::{Case, CaseResult, PlayedClient};
use super::play::{BROKEN_OFF, Playing, over_time};

/// Simulated time between looks at the ports while bytes of a client that has ended are still to be
/// taken: as many as arrive in this have room on the line again.
const SLICE: Duration = Duration::from_millis(5);

/// Plays it. The client ends before this returns, whatever happens.
pub(crate) fn play(case: &Case<'_>, stop: &AtomicBool) -> Result<CaseResult, Failure> {
    // Before anything is opened, so that a signal at any time leaves nothing behind.
    let mut waiter = Waiter::new().map_err(Failure::system)?;
    waiter.catch_signals().map_err(Failure::system)?;
    if stop.load(Ordering::Relaxed) {
        return Ok(CaseResult::BrokenOff);
    }
    let (run, playing) = Playing::begin(case, stop)?;
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
    let shown = ShownPort::all(&ports, &case.loaded.scenario.rig);
    let mut environment = environment(case, &shown)?;
    let desk = case.desk(&run, shown, &mut environment)?;
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
    let client = Client::start(&case.args.client, &environment, links.path(), log)
        .map_err(Failure::system)?;
    server.watch(client.status()).map_err(Failure::system)?;
    if let Some(desk) = &desk {
        server.wake_from(&desk.control).map_err(Failure::system)?;
    }
    server.stop_after(case.allowed);
    let mut play = LivePlay {
        server,
        client,
        playing,
        desk,
    };
    let played = play.play(case).map_err(Failure::system)?;
    if let Some(client) = &played
        && let ClientEnd::NotStarted(why) = &client.end
    {
        let shown = visible::name(&case.args.client[0]);
        return Err(Failure::usage(anyhow!(
            "cannot start the client {shown}: {why}"
        )));
    }
    let held_up = play.server.held_up();
    let run = play.server.run_mut();
    play.playing
        .conclude(run, played.is_none(), played, Some(held_up))
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
    ports: &[ShownPort],
) -> Result<Vec<(String, OsString)>, Failure> {
    let mut environment: Vec<(String, OsString)> = Vec::new();
    for port in ports {
        let variable = port.link.variable();
        if environment.iter().any(|(other, _)| *other == variable) {
            return Err(Failure::usage(anyhow!(
                "{}: two ports would both be found in ${variable}; give the devices names that \
                 differ in more than -, _ and the case of letters",
                visible::name(&case.loaded.path)
            )));
        }
        environment.push((variable, absolute(&port.path)?.into()));
    }
    environment.push(("SIM_SEED".to_owned(), case.seed.to_string().into()));
    environment.push((
        "SIM_SCENARIO".to_owned(),
        absolute(&case.loaded.path)?.into(),
    ));
    Ok(environment)
}

struct LivePlay<'a> {
    server: Server,
    client: Client,
    playing: Playing<'a>,
    desk: Option<Desk>,
}

impl LivePlay<'_> {
    /// Plays until the scenario or the client ends; `None` if a signal came first. The client has
    /// ended then.
    fn play(&mut self, case: &Case<'_>) -> anyhow::Result<Option<PlayedClient>> {
        let ended = self.server.serve(&mut Looking {
            log: None,
            desk: self.desk.as_mut(),
            trace: &mut self.playing.trace,
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
            Ended::Signal => {
                self.fail(BROKEN_OFF.to_owned());
                return Ok(None);
            }
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
                if !self.play_the_rest()? {
                    return Ok(None);
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
    fn play_the_rest(&mut self) -> anyhow::Result<bool> {
        while self.server.run().finished().is_none() {
            let to = match self.server.take_the_rest()? {
                true => SimTime::MAX,
                false => self.server.run().rig().now() + SLICE,
            };
            if !self.playing.on(self.server.run_mut(), to)? {
                return Ok(false);
            }
        }
        Ok(true)
    }

    fn fail(&mut self, what: String) {
        self.server.run_mut().fail(what);
    }
}
