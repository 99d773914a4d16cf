//! A scenario against a real client whose time is the simulator's.

use std::fs::File;
use std::io::{Read as _, Seek as _, SeekFrom};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use anyhow::{Context as _, anyhow};
use sim_core::SimTime;
use sim_core::line::ClientLine;
use sim_core::rig::PortId;
use sim_embed::ports::ShownPort;
use sim_lockstep::{
    Broken, End, Ending, Error, LineSettings, Options, Port, Program, Reason, Step, World, modem,
};
use sim_pty::ListenAddress;
use sim_runner::Run;
use sim_settings::show_duration;

use crate::args::RandomArg;
use crate::client::Output;
use crate::control::Desk;
use crate::exit::Failure;
use crate::supervise::ClientEnd;
use crate::visible;

use super::case::{Case, CaseResult, PlayedClient};
use super::folder::Folder;
use super::live::no_port_opened;
use super::play::{BROKEN_OFF, Playing, over_time};

/// Instants of the simulation between looks at the real clock.
const MOST_INSTANTS: u32 = 10_000;
/// Simulated time after which a client that waits for room is asked again.
const ROOM: Duration = Duration::from_millis(5);
/// Most bytes of a client's output that are kept in its file.
const MOST_FILED: u64 = 1 << 26;

/// Plays it. The client ends before this returns, whatever happens.
pub(crate) fn play(case: &Case<'_>, stop: &AtomicBool) -> Result<CaseResult, Failure> {
    if stop.load(Ordering::Relaxed) {
        return Ok(CaseResult::BrokenOff);
    }
    let (mut run, playing) = Playing::begin(case, stop)?;
    run.follow_bytes();
    let folder = Folder::take(case).map_err(Failure::system)?;
    let (shown, mut ports) = open_ports(case, &folder)?;
    let ids = shown.iter().map(|port| port.link.id).collect();
    let mut environment = super::live::environment(case, &shown)?;
    let desk = case.desk(&run, shown, &mut environment)?;
    let mut output = open_output(case).map_err(Failure::system)?;
    let program = Program {
        words: &case.args.client,
        environment: &environment,
        output: output
            .try_clone()
            .context("cannot share the client's output")
            .map_err(Failure::system)?,
    };
    let options = Options {
        seed: (case.args.random == RandomArg::Seed).then_some(case.seed),
        date: case.args.date,
        until: playing.until(),
        stop,
    };
    let mut stage = Stage {
        run,
        playing,
        desk,
        ids,
        begun_at: None,
        wants_room: false,
        patience: nanoseconds(case.allowed),
        output: output.try_clone().ok(),
    };
    let ending = sim_lockstep::run(program, &options, &mut ports, &mut stage);
    let ending = ending.map_err(|error| failure(case, error))?;
    // Nobody is left to be answered.
    stage.desk = None;
    let broken_off = !stage.conclude(case, &ending)?;
    let output = read_output(&mut output).map_err(Failure::system);
    let client = PlayedClient {
        end: client_end(ending.end),
        stopped: ending.reason != Reason::Itself,
        output: output.as_ref().map(Clone::clone).unwrap_or_default(),
        outside: ending.outside.into_iter().collect(),
        refused: ending.refused.into_iter().collect(),
    };
    // The machine has no part in it.
    let playing = stage.playing;
    let concluded = playing.conclude(&mut stage.run, broken_off, Some(client), None)?;
    // The trace has its end by now, which it needs to be played again.
    output.map(|_| concluded)
}

fn client_end(end: End) -> ClientEnd {
    match end {
        End::Exited(code) => ClientEnd::Exited(code),
        End::Killed(signal) => ClientEnd::Killed(signal),
    }
}

fn failure(case: &Case<'_>, error: Error) -> Failure {
    let client = case.args.client.first().map(visible::name);
    let client = client.unwrap_or_default();
    match error {
        Error::NotStarted(why) => {
            Failure::usage(anyhow!("cannot start the client {client}: {why}"))
        }
        Error::Unsupported(why) => Failure::system(anyhow!(
            "{why}, so the client cannot run in the simulator's time; --time real runs it in real \
             time"
        )),
        Error::Refused(why) => Failure::usage(anyhow!("{why}; --time real runs it in real time")),
        Error::World(why) => Failure::system(anyhow!(why)),
        error => Failure::system(error),
    }
}

/// A port for each link of each device, in the folder or where the rig has it.
fn open_ports(case: &Case<'_>, folder: &Folder) -> Result<(Vec<ShownPort>, Vec<Port>), Failure> {
    let mut shown = Vec::new();
    let mut ports = Vec::new();
    for link in case.loaded.scenario.client_links() {
        let path = match &link.path {
            Some(path) if ListenAddress::is_url(path) => {
                return Err(Failure::system(anyhow!(
                    "the network keeps real time, so no client in the simulator's time can open \
                     {}; --time real runs it in real time",
                    visible::name(path)
                )));
            }
            Some(path) => case.loaded.folder().join(path),
            None => folder.path.join(link.file_name()),
        };
        let port = Port::new(path.clone(), link.baud)
            .with_context(|| format!("cannot serve a port at {}", path.display()))
            .map_err(Failure::system)?;
        shown.push(ShownPort {
            link,
            path: port.path().to_owned(),
            is_public: false,
        });
        ports.push(port);
    }
    Ok((shown, ports))
}

/// Where the client writes: a file, which takes everything at once. A reader of a pipe would be one
/// more whose pace shows.
fn open_output(case: &Case<'_>) -> anyhow::Result<File> {
    let Some(path) = case.file("client.log") else {
        return tempfile::tempfile().context("cannot make a file for the client's output");
    };
    File::create(&path)
        .and_then(|_| File::options().read(true).append(true).open(&path))
        .with_context(|| format!("cannot write the client's output to {}", path.display()))
}

fn read_output(file: &mut File) -> anyhow::Result<String> {
    let what = "cannot read the client's output";
    let length = file.metadata().context(what)?.len();
    let from = length.saturating_sub(Output::MOST as u64);
    file.seek(SeekFrom::Start(from)).context(what)?;
    let mut bytes = Vec::new();
    file.take(Output::MOST as u64)
        .read_to_end(&mut bytes)
        .context(what)?;
    Ok(Output::ended(from, &bytes))
}

fn nanoseconds(span: Duration) -> u64 {
    u64::try_from(span.as_nanos()).unwrap_or(u64::MAX)
}

/// The devices, as a client's world.
struct Stage<'a> {
    run: Run,
    playing: Playing<'a>,
    desk: Option<Desk>,
    ids: Vec<PortId>,
    /// The client's time when it first opened a port, at which the scenario begins.
    begun_at: Option<u64>,
    /// A client waits for room on a line.
    wants_room: bool,
    /// The client's time until which it must have opened a port.
    patience: u64,
    output: Option<File>,
}

impl Stage<'_> {
    /// The scenario's time.
    fn at(&self, now: u64) -> SimTime {
        SimTime::from_nanos(now.saturating_sub(self.begun_at.unwrap_or(now)))
    }

    /// The client's time.
    fn now(&self) -> u64 {
        let run = self.run.rig().now().since(SimTime::ZERO);
        self.begun_at.unwrap_or(0).saturating_add(nanoseconds(run))
    }

    fn id(&self, port: usize) -> Result<PortId, Broken> {
        self.ids
            .get(port)
            .copied()
            .ok_or_else(|| "there is no such port".into())
    }

    /// Tells who listens what has happened, and answers what is asked over the control socket; says
    /// whether that may be what the client waits for. It may have asked something itself if it `ran`.
    fn settle(&mut self, now: u64, ran: bool) -> Result<bool, Broken> {
        let Some(desk) = &mut self.desk else {
            self.playing.take(&mut self.run);
            return Ok(false);
        };
        while let Some(event) = self.run.poll_event() {
            desk.event(&event);
        }
        let any = desk.settle(&mut self.run, ran)?;
        if desk.wants_time() {
            self.begun_at.get_or_insert(now);
        }
        self.playing.take(&mut self.run);
        Ok(any)
    }

    /// Does what the run has brought about at the ports; says whether it was anything.
    fn follow(&mut self, ports: &mut [Port]) -> Result<bool, Broken> {
        let mut any = false;
        let mut bytes = Vec::new();
        for (index, port) in ports.iter_mut().enumerate() {
            let id = self.id(index)?;
            let pulled = self.run.rig().cable_pulled(id);
            if pulled && port.is_plugged() {
                any = true;
                if port.unplug()? {
                    self.run.detach(id, self.run.rig().now())?;
                }
            } else if !pulled && !port.is_plugged() {
                any = true;
                port.plug()?;
            }
            bytes.clear();
            self.run.read(id, &mut bytes);
            if bytes.is_empty() {
                continue;
            }
            // A client that only listens would else never be found to listen at a wrong speed.
            if let Some(line) = port.line()? {
                self.run.set_line(id, client_line(line));
            }
            port.deliver(&bytes)?;
            any = true;
            match port.take_lost() {
                0 => {}
                lost => self.run.client_lost(id, lost),
            }
        }
        Ok(any)
    }

    /// Says what the client's end means, and plays what is left of the scenario; `false` if a signal
    /// came first.
    fn conclude(&mut self, case: &Case<'_>, ending: &Ending) -> Result<bool, Failure> {
        match &ending.reason {
            Reason::Stopped => {
                self.run.fail(BROKEN_OFF.to_owned());
                return Ok(false);
            }
            Reason::Over => {}
            Reason::OutOfTime(doing) => {
                let why = over_time(case.allowed);
                self.run.fail(format!("{why}; {doing}"));
            }
            Reason::Deadlock(waits) if self.begun_at.is_none() => self.run.fail(format!(
                "the client has opened no port within {} of its own time: {waits}",
                show_duration(case.allowed)
            )),
            Reason::Deadlock(waits) => self
                .run
                .fail(format!("the client waited for what never comes: {waits}")),
            Reason::Itself if ending.end != End::Exited(0) => {
                self.run
                    .fail(format!("the client {}", client_end(ending.end)));
            }
            Reason::Itself if self.begun_at.is_none() => {
                self.run.fail(no_port_opened(case));
            }
            // The rest of the scenario shows what becomes of the vehicle.
            Reason::Itself => {
                let played = self.playing.on(&mut self.run, SimTime::MAX);
                return played.map_err(Failure::system);
            }
        }
        Ok(true)
    }

    /// Leaves out what a client writes without end.
    fn bound_output(&mut self) {
        if let Some(output) = &self.output
            && output
                .metadata()
                .is_ok_and(|file| file.len() > 2 * MOST_FILED)
        {
            // The beginning stays, and whatever comes next; a file that cannot be cut is too long.
            let _ = output.set_len(MOST_FILED);
        }
    }
}

fn client_line(line: LineSettings) -> ClientLine {
    ClientLine {
        baud: line.baud,
        stop_bits: u8::try_from(line.stop_bits).unwrap_or(1),
        raw: line.raw,
        parity: line.parity,
        rts_cts: line.rts_cts,
    }
}

impl World for Stage<'_> {
    fn opened(&mut self, port: usize, now: u64) -> Result<(), Broken> {
        self.begun_at.get_or_insert(now);
        let id = self.id(port)?;
        Ok(self.run.attach(id, self.at(now))?)
    }

    fn closed(&mut self, port: usize, now: u64) -> Result<(), Broken> {
        let id = self.id(port)?;
        Ok(self.run.detach(id, self.at(now))?)
    }

    fn sent(
        &mut self,
        port: usize,
        line: LineSettings,
        now: u64,
        bytes: &[u8],
    ) -> Result<usize, Broken> {
        let id = self.id(port)?;
        if self.run.finished().is_some() {
            return Ok(bytes.len());
        }
        self.run.set_line(id, client_line(line));
        let count = self.run.rig().space(id).min(bytes.len());
        self.wants_room = count < bytes.len();
        if let Some(taken) = bytes.get(..count).filter(|taken| !taken.is_empty()) {
            self.run.send(id, self.at(now), taken)?;
        }
        Ok(count)
    }

    fn modem_lines(&mut self, port: usize, _now: u64, lines: u32) -> Result<(), Broken> {
        let id = self.id(port)?;
        let (dtr, rts) = (lines & modem::DTR != 0, lines & modem::RTS != 0);
        self.run.set_modem_lines(id, dtr, rts);
        Ok(())
    }

    fn advance(
        &mut self,
        ports: &mut [Port],
        now: u64,
        until: Option<u64>,
        ran: bool,
    ) -> Result<Step, Broken> {
        self.bound_output();
        if self.settle(now, ran)? {
            return Ok(Step::To(self.now().max(now)));
        }
        if self.begun_at.is_none() {
            // The scenario waits for clients that are slow to begin, but not for ever.
            return Ok(match until {
                Some(until) if until <= self.patience => Step::To(until),
                _ => Step::Never,
            });
        }
        let mut to = until.map_or(SimTime::MAX, |until| self.at(until));
        if self.wants_room {
            to = to.min(self.at(now) + ROOM);
        }
        for _ in 0..MOST_INSTANTS {
            let news = self.follow(ports)? | self.settle(now, false)?;
            if self.run.finished().is_some() {
                return Ok(Step::Over);
            }
            if news {
                break;
            }
            if !self.run.step(to)? && self.run.finished().is_none() {
                // What has arrived with it is found the next time.
                let reached = self.now().max(now);
                let asked = until.filter(|until| self.at(*until) <= to);
                return Ok(Step::To(asked.map_or(reached, |until| until.max(reached))));
            }
        }
        Ok(Step::To(self.now().max(now)))
    }
}
