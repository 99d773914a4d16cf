//! A scenario against a real client whose time is the simulator's.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use anyhow::{Context as _, anyhow};
use rigsim_core::SimTime;
use rigsim_core::rig::PortId;
use rigsim_embed::ports::ShownPort;
use rigsim_lockstep::{
    Broken, ClientLine, End, Ending, Error, Options, Port, Program, Reason, Step, ThreadWait,
    World, modem,
};
use rigsim_pty::ListenAddress;
use rigsim_pty::paths::Held;
use rigsim_runner::Run;
use rigsim_runner::trace::Record;
use rigsim_settings::show_duration;

use crate::args::{RandomArg, ScheduleArg};
use crate::client::Written;
use crate::control::RequestQueue;
use crate::exit::Failure;
use crate::published::Published;
use crate::supervise::ClientEnd;
use crate::visible;

use super::case::{Case, CaseResult, PlayedClient};
use super::folder;
use super::live::no_port_opened;
use super::play::{Ended, Playing, out_of_real_time, over_time};

/// Instants of the simulation between looks at the real clock.
const MOST_INSTANTS: u32 = 10_000;
/// Simulated time after which a client that waits for room is asked again.
const ROOM: Duration = Duration::from_millis(5);

/// Plays it. The client ends before this returns, whatever happens.
pub(crate) fn play(case: &Case<'_>, stop: &AtomicBool) -> Result<CaseResult, Failure> {
    if stop.load(Ordering::Relaxed) {
        return Ok(CaseResult::aborted());
    }
    let (mut run, playing) = Playing::begin(case, stop)?;
    run.stop_at_bytes();
    let folder = folder::take(case).map_err(Failure::system)?;
    let (shown, mut ports) = open_ports(case, &folder)?;
    let ids = shown.iter().map(|port| port.link.id).collect();
    let mut environment = super::live::environment(case, &shown)?;
    let published = Published::create(folder.path(), &mut environment).map_err(Failure::system)?;
    let requests = case.requests(&run, shown, &mut environment)?;
    let output = case.client_output().map_err(Failure::system)?;
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
        schedule: (case.args.schedule == ScheduleArg::Random).then_some(case.seed),
        date: case.args.date,
        allowed: Some(case.allowed),
        until: playing.until(),
        stop,
    };
    let mut world = LockstepWorld {
        run,
        playing,
        requests,
        ids,
        begun_at: None,
        wants_room: false,
        patience: nanoseconds(case.allowed),
        written: Written::new(output),
        published,
        waits: case.records_waits().then(BTreeMap::new),
        folder: format!("{}/", folder.path().display()),
    };
    let ending = rigsim_lockstep::run(program, &options, &mut ports, &mut world);
    let ending = ending.map_err(|error| failure(case, error))?;
    // No client is left to be answered.
    world.requests = None;
    world.date_output(world.now());
    world.waits(ending.at.max(world.now()), Vec::new());
    let ended = world.conclude(case, &ending)?;
    let client = PlayedClient {
        end: client_end(ending.end),
        stopped: ending.reason != Reason::Itself,
        output: world.written.text(),
        outside: ending.outside.into_iter().collect(),
        random_addresses: ending.random_addresses,
        refused: ending.refused.into_iter().collect(),
        // The C library tries the others in every client, and does without.
        missing: (ending.missing.into_iter())
            .filter(|call| !["clone3", "rseq"].contains(&call.as_str()))
            .collect(),
        left: ending.left.into_iter().collect(),
        lost: world.written.lost(ending.written),
    };
    // The machine has no part in it.
    let playing = world.playing;
    playing.conclude(&mut world.run, ended, Some(client), None)
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
fn open_ports(case: &Case<'_>, folder: &Held) -> Result<(Vec<ShownPort>, Vec<Port>), Failure> {
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
            None => folder.path().join(link.file_name()),
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

fn nanoseconds(span: Duration) -> u64 {
    u64::try_from(span.as_nanos()).unwrap_or(u64::MAX)
}

/// The devices, as a client's world.
struct LockstepWorld<'a> {
    run: Run,
    playing: Playing<'a>,
    requests: Option<RequestQueue>,
    ids: Vec<PortId>,
    /// The client's time when it first opened a port, at which the scenario begins.
    begun_at: Option<u64>,
    /// A client waits for room on a line.
    wants_room: bool,
    /// The client's time until which it must have opened a port.
    patience: u64,
    written: Written,
    published: Published,
    /// Numbers of the threads' waits that were recorded last, if they are recorded.
    waits: Option<BTreeMap<u64, u64>>,
    /// Folder of the ports, which is another one in each run.
    folder: String,
}

impl LockstepWorld<'_> {
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

    /// Reports what has happened to those that listen, and answers requests of the control socket; says
    /// whether that may be what the client waits for. It may have asked something itself if it `ran`.
    fn answer_requests(&mut self, now: u64, ran: bool) -> Result<bool, Broken> {
        let Some(requests) = &mut self.requests else {
            self.playing.take(&mut self.run);
            return Ok(false);
        };
        while let Some(event) = self.run.poll_event() {
            requests.event(&event);
        }
        let any = requests.answer_until_quiet(&mut self.run, ran)?;
        if requests.wants_time() {
            self.begun_at.get_or_insert(now);
        }
        self.playing.take(&mut self.run);
        Ok(any)
    }

    /// Does what the run has brought about at the ports; says whether it was anything.
    fn update_ports(&mut self, ports: &mut [Port]) -> Result<bool, Broken> {
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
                self.run.set_line(id, line);
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

    /// Says what the client's end means, and plays what is left of the scenario.
    fn conclude(&mut self, case: &Case<'_>, ending: &Ending) -> Result<Ended, Failure> {
        let end = client_end(ending.end);
        let begun = self.begun_at.is_some();
        let why = match &ending.reason {
            Reason::Stopped => return Ok(Ended::Aborted),
            Reason::Over => return Ok(Ended::Played),
            Reason::OutOfTime { real, doing } => {
                let why = format!("{}; {doing}", over_time(case, *real));
                if *real {
                    return Ok(out_of_real_time(&mut self.run, why));
                }
                why
            }
            // It has done all that it was to do; or this program was to answer it.
            Reason::Deadlock(_)
                if case.args.control.is_some()
                    || self.run.finished().is_some_and(|outcome| outcome.passed) =>
            {
                return Ok(Ended::Played);
            }
            Reason::Deadlock(waits) if !begun => format!(
                "the client has opened no port within {} of its time: {waits}",
                show_duration(case.allowed)
            ),
            Reason::Deadlock(waits) => {
                format!("the client waited for what never comes: {waits}")
            }
            Reason::Itself if !begun => no_port_opened(case, &end),
            Reason::Itself if end != ClientEnd::Exited(0) => format!("the client {end}"),
            // The rest of the scenario shows what becomes of the vehicle.
            Reason::Itself => {
                let played = self.playing.on(&mut self.run, SimTime::MAX);
                return Ok(played.map_err(Failure::system)?.unwrap_or(Ended::Played));
            }
        };
        if !begun {
            return Ok(Ended::NoVerdict(why));
        }
        self.run.fail(why);
        Ok(Ended::Played)
    }

    /// Notes when the client has written what is new.
    fn date_output(&mut self, now: u64) {
        let at = self.begun_at.map(|_| self.at(now));
        self.written.date_output(at);
    }
}

impl World for LockstepWorld<'_> {
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
        line: ClientLine,
        now: u64,
        bytes: &[u8],
    ) -> Result<usize, Broken> {
        let id = self.id(port)?;
        if self.run.finished().is_some() {
            return Ok(bytes.len());
        }
        self.run.set_line(id, line);
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

    fn wants_waits(&self) -> bool {
        self.waits.is_some() && self.begun_at.is_some()
    }

    fn waits(&mut self, now: u64, waits: Vec<ThreadWait>) {
        let t = self.at(now).as_nanos();
        let (Some(known), Some(trace)) = (&mut self.waits, &mut self.playing.trace) else {
            return;
        };
        trace.take(&mut self.run);
        let mut before = std::mem::take(known);
        for ThreadWait {
            thread,
            name,
            number,
            wait,
        } in waits
        {
            known.insert(thread, number);
            if before.remove(&thread) != Some(number) {
                let wait = wait.replace(&self.folder, "");
                trace.record(&Record::Wait {
                    t,
                    thread,
                    name,
                    wait,
                });
            }
        }
        for thread in before.into_keys() {
            let (name, wait) = Default::default();
            trace.record(&Record::Wait {
                t,
                thread,
                name,
                wait,
            });
        }
    }

    fn advance(
        &mut self,
        ports: &mut [Port],
        now: u64,
        until: Option<u64>,
        ran: bool,
    ) -> Result<Step, Broken> {
        // A client that has not run has written nothing.
        if ran {
            self.date_output(now);
        }
        if ran && self.begun_at.is_some() {
            let at = self.at(now);
            self.published.take(&mut self.run, at)?;
        }
        if self.answer_requests(now, ran)? {
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
            let any = self.update_ports(ports)? | self.answer_requests(now, false)?;
            if self.run.finished().is_some() {
                return Ok(Step::Over);
            }
            if any {
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
