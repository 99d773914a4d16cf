//! A scenario against a real client, in real time.

use std::ffi::OsString;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use anyhow::Context as _;
use rigsim_pty::Waiter;

use crate::attendant::LogAttendant;
use crate::client::{Client, Written};
use crate::control::RequestQueue;
use crate::exit::{Failure, refuse};
use crate::plan::absolute;
use crate::published::Published;
use crate::supervise::ClientEnd;
use crate::visible;
use rigsim_core::SimTime;
use rigsim_embed::ports::{ShownPort, open_all};
use rigsim_embed::serve::{Begin, Ended, Server};
use rigsim_pty::PtySetup;
use rigsim_runner::Scenario;

use super::case::{Case, CaseResult, PlayedClient};
use super::folder;
use super::play::{self, Playing, over_time};

/// Simulated time between looks at the ports while bytes of a client that has ended are still to be
/// taken: as many as arrive in this have room on the line again.
const SLICE: Duration = Duration::from_millis(5);

/// Plays it. The client ends before this returns, whatever happens.
pub(crate) fn play(case: &Case<'_>, stop: &AtomicBool) -> Result<CaseResult, Failure> {
    // Before anything is opened, so that a signal at any time leaves nothing behind.
    let mut waiter = Waiter::new().map_err(Failure::system)?;
    waiter.catch_signals().map_err(Failure::system)?;
    if stop.load(Ordering::Relaxed) {
        return Ok(CaseResult::aborted());
    }
    let (run, playing) = Playing::begin(case, stop)?;
    let folder = folder::take(case).map_err(Failure::system)?;
    let ports = open_all(
        &case.loaded.scenario,
        &case.loaded.folder(),
        None,
        Some(folder.path()),
        PtySetup::raw(0),
    )
    .map_err(Failure::system)?;
    let shown = ShownPort::all(&ports, &case.loaded.scenario.rig);
    let mut environment = environment(case, &shown)?;
    let published = Published::create(folder.path(), &mut environment).map_err(Failure::system)?;
    let requests = case.requests(&run, shown, &mut environment)?;
    let output = case.client_output().map_err(Failure::system)?;
    let written = output.try_clone();
    let written = written
        .context("cannot share the client's output")
        .map_err(Failure::system)?;
    let mut server =
        Server::new(run, ports, waiter, Begin::WithClient, case.speed).map_err(Failure::system)?;
    let client = Client::start(&case.args.client, &environment, output).map_err(Failure::system)?;
    server.watch(client.status()).map_err(Failure::system)?;
    if let Some(requests) = &requests {
        server
            .wake_from(&requests.control)
            .map_err(Failure::system)?;
    }
    server.stop_after(case.allowed);
    let mut play = LivePlay {
        server,
        client,
        playing,
        requests,
        written: Written::new(written),
        published,
    };
    let (ended, client) = play.play(case).map_err(Failure::system)?;
    if let ClientEnd::NotStarted(why) = &client.end {
        let shown = visible::name(&case.args.client[0]);
        refuse!("cannot start the client {shown}: {why}");
    }
    let stalled = play.server.stalled();
    let run = play.server.run_mut();
    play.playing
        .conclude(run, ended, Some(client), Some(stalled))
}

/// The reason of a scenario whose client has opened no port.
pub(crate) const NO_PORT_OPENED: &str = "the client ended without having opened a port";

/// The same of a client that was started here, which ended so.
pub(crate) fn no_port_opened(case: &Case<'_>, end: &ClientEnd) -> String {
    let variables = variables(&case.loaded.scenario).join(", ");
    format!(
        "the client could not be played: it {end} without having opened a port; their paths are in its \
         environment: {variables}"
    )
}

/// The variables of the environment in which a client finds the ports.
fn variables(scenario: &Scenario) -> Vec<String> {
    let links = scenario.client_links();
    links.map(|link| link.variable()).collect()
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
            refuse!(
                "{}: two ports would both be found in ${variable}; give the devices names that \
                 differ in more than -, _ and the case of letters",
                visible::name(&case.loaded.path)
            );
        }
        environment.push((variable, absolute(&port.path)?.into()));
    }
    // The first of each kind also by its kind, for clients that know one vehicle, whatever its name.
    for port in ports {
        let mut of_kind = port.link.clone();
        let plan = &case.loaded.scenario.rig.devices[of_kind.id.device];
        plan.device.id.clone_into(&mut of_kind.device);
        let variable = of_kind.variable();
        if !environment.iter().any(|(other, _)| *other == variable) {
            environment.push((variable, absolute(&port.path)?.into()));
        }
    }
    if std::env::var_os("PYTHONUNBUFFERED").is_none() {
        // What Python has not written when it is killed, or writes late, explains no failure.
        environment.push(("PYTHONUNBUFFERED".to_owned(), "1".into()));
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
    requests: Option<RequestQueue>,
    written: Written,
    published: Published,
}

impl LivePlay<'_> {
    /// Plays until the scenario or the client ends. The client has ended then.
    fn play(&mut self, case: &Case<'_>) -> anyhow::Result<(play::Ended, PlayedClient)> {
        let mut attendant = LogAttendant {
            log: None,
            requests: self.requests.as_mut(),
            client: Some((&mut self.published, &mut self.written)),
            trace: &mut self.playing.trace,
        };
        let ended = (self.server).serve(|run, clock, woken| attendant.attend(run, clock, woken))?;
        // No request is left to be answered.
        self.requests = None;
        let stopped = ended != Ended::Watched;
        let end = if stopped {
            self.client.stop()?
        } else {
            self.client.wait()?
        };
        let has_begun = self.server.has_begun();
        let ended = match ended {
            Ended::Signal => play::Ended::Aborted,
            Ended::Over => play::Ended::Played,
            Ended::Timeout if !has_begun => {
                play::Ended::NoVerdict(format!("{}: {}", over_time(case, true), NO_PORT_OPENED))
            }
            Ended::Timeout => {
                self.fail(over_time(case, true));
                play::Ended::Played
            }
            Ended::Watched if !has_begun => play::Ended::NoVerdict(no_port_opened(case, &end)),
            Ended::Watched if end != ClientEnd::Exited(0) => {
                self.server.take_the_rest()?;
                self.fail(format!("the client {end}"));
                play::Ended::Played
            }
            Ended::Watched => self.play_the_rest()?,
        };
        let client = PlayedClient {
            end,
            stopped,
            output: self.written.text(),
            outside: Vec::new(),
            random_addresses: false,
            refused: Vec::new(),
            missing: Vec::new(),
            left: Vec::new(),
            lost: 0,
        };
        Ok((ended, client))
    }

    /// The client has ended well. What it had still sent is on its way, and the rest of the scenario
    /// shows what becomes of the vehicle.
    fn play_the_rest(&mut self) -> anyhow::Result<play::Ended> {
        while self.server.run().finished().is_none() {
            let to = match self.server.take_the_rest()? {
                true => SimTime::MAX,
                false => self.server.run().rig().now() + SLICE,
            };
            if let Some(ended) = self.playing.on(self.server.run_mut(), to)? {
                return Ok(ended);
            }
        }
        Ok(play::Ended::Played)
    }

    fn fail(&mut self, what: String) {
        self.server.run_mut().fail(what);
    }
}
