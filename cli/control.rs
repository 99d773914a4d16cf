//! Requests of the control socket, done to a run.

mod ask;
pub(crate) mod ctl;
mod told;

use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};

use anyhow::Context as _;
use serde_json::{Value, json};
use sim_control::session::{Session, SessionFile};
use sim_control::{Answer, Ask, Control, Listen, Listener, Refusal, Reply, Request};
use sim_core::SimTime;
use sim_core::event::{Event, Level};
use sim_embed::clock::Clock;
use sim_embed::ports::ShownPort;
use sim_runner::condition::Probe;
use sim_runner::run::StepReport;
use sim_runner::{Run, RunError};

use crate::exit::Failure;
use crate::log::Words;
use crate::visible;

/// Requests that are answered before clients of the ports have their turn again.
const MOST_AT_ONCE: usize = 16;
/// How often to look whether steps have begun or ended, while anybody listens.
const LOOK_AT_STEPS: Duration = Duration::from_millis(50);
/// How long a client in the simulator's time may be kept waiting for what is asked and told
/// meanwhile.
const SETTLE: Duration = Duration::from_secs(2);

/// Answers requests between two steps of a run.
///
/// Where a method takes a clock, there is none if time is the client's, as in lockstep.
pub(crate) struct Desk {
    words: Words,
    ports: Vec<ShownPort>,
    listening: Vec<Listening>,
    /// Answers to be given when a step is over.
    waiting: Vec<(usize, Answer)>,
    /// Answers to be given when time stands still again.
    stepping: Vec<Answer>,
    steps: Vec<Progress>,
    steps_next: Option<Instant>,
    /// Goes behind those that listen and wait, who are told that it is over.
    control: Control,
    /// Goes when this does.
    _session: SessionFile,
}

/// Whoever is told what happens, and when next.
struct Listening {
    listener: Listener,
    probes: Vec<Probe>,
    values_next: Option<Instant>,
    picture_next: Option<Instant>,
    gone: bool,
}

/// What of a step may change: when it began and was done, how often it has hit, whether it lasts
/// and has failed.
type Progress = (Option<SimTime>, Option<SimTime>, u64, bool, bool);

fn progress(step: &StepReport<'_>) -> Progress {
    let failed = step.failure.is_some();
    (step.begun, step.done, step.hits, step.lasting, failed)
}

impl Desk {
    /// Opens the socket and writes the file by which it is found. The ports are those of the run.
    pub(crate) fn open(listen: &Listen, run: &Run, ports: Vec<ShownPort>) -> Result<Self, Failure> {
        let table = run.scenario().rig.settings.table();
        let control = Control::open(listen, Box::new(|| told::schema(table)))
            .with_context(|| format!("cannot listen on {listen} for --control"))
            .map_err(Failure::usage)?;
        let paths = ports.iter().map(|port| std::path::absolute(&port.path));
        let session = Session {
            pid: std::process::id(),
            url: control.url(),
            ports: paths.filter_map(Result::ok).collect::<Vec<PathBuf>>(),
        };
        let session = session
            .publish()
            .context("cannot write the file by which --control is found")
            .map_err(Failure::system)?;
        Ok(Self {
            control,
            _session: session,
            words: Words::new(&run.scenario().rig),
            ports,
            listening: Vec::new(),
            waiting: Vec::new(),
            stepping: Vec::new(),
            steps: Vec::new(),
            steps_next: None,
        })
    }

    /// URL of it, with the token.
    pub(crate) fn url(&self) -> String {
        self.control.url()
    }

    /// Control that wakes it.
    pub(crate) fn wakes(&self) -> &Control {
        &self.control
    }

    /// Tells whether somebody waits for something that comes only with time.
    pub(crate) fn wants_time(&self) -> bool {
        !self.waiting.is_empty() || !self.stepping.is_empty()
    }

    /// Something has happened.
    pub(crate) fn event(&mut self, event: &Event) {
        if self.listening.is_empty() {
            return;
        }
        let level = event.kind.level();
        let mut message = None;
        for one in &mut self.listening {
            if level == Level::Traffic && !one.listener.wants.traffic {
                continue;
            }
            let message = message.get_or_insert_with(|| self.words.message(event));
            one.tell(message);
        }
    }

    /// Does what is asked, and tells who listens what is due. Says when it has to be called again.
    pub(crate) fn attend(
        &mut self,
        run: &mut Run,
        mut clock: Option<&mut Clock>,
        woken: bool,
    ) -> Result<Option<Duration>, RunError> {
        if woken {
            self.control.quiet();
        }
        self.answer_waiting(run, clock.as_deref());
        for turn in 0.. {
            if turn == MOST_AT_ONCE {
                return Ok(Some(Duration::ZERO));
            }
            let Some(request) = self.control.poll() else {
                break;
            };
            self.answer(run, clock.as_deref_mut(), request)?;
            self.answer_waiting(run, clock.as_deref());
        }
        Ok(self.tell_what_is_due(run))
    }

    /// Does all that is asked, also what is on its way, until everybody waits for an answer that
    /// only time brings: for a client that has nothing else to do until then. Says whether anybody
    /// asked or was told anything.
    pub(crate) fn settle(&mut self, run: &mut Run) -> Result<bool, RunError> {
        let begun = Instant::now();
        let mut any = self.answer_waiting(run, None);
        self.tell_what_is_due(run);
        if self.control.settle(Duration::ZERO) {
            return Ok(any);
        }
        any = true;
        while !self.control.settle(SETTLE) && begun.elapsed() < SETTLE {
            while let Some(request) = self.control.poll() {
                self.answer(run, None, request)?;
                self.answer_waiting(run, None);
            }
        }
        Ok(any)
    }

    fn answer(
        &mut self,
        run: &mut Run,
        clock: Option<&mut Clock>,
        request: Request,
    ) -> Result<(), RunError> {
        let (ask, answer) = request.split();
        let reply = match ask {
            Ask::Add { step, wait } => match ask::add(run, &step) {
                Ok(index) if wait => {
                    self.waiting.push((index, answer.later()));
                    return Ok(());
                }
                Ok(index) => told::step(run, index),
                Err(ask::Trouble::Refused(refusal)) => Err(refusal),
                Err(ask::Trouble::Broken(error)) => return Err(error),
            },
            Ask::Steps(None) => Ok(json!({ "steps": told::steps(run) })),
            Ask::Steps(Some(name)) => {
                ask::index(run, &name).and_then(|index| told::step(run, index))
            }
            Ask::Clear(None) => Ok(json!({ "cleared": clear_added(run)? })),
            Ask::Clear(Some(name)) => match ask::index(run, &name) {
                Ok(index) => {
                    run.clear_step(index)?;
                    told::step(run, index)
                }
                Err(refusal) => Err(refusal),
            },
            Ask::Names(names) if names.is_empty() => Ok(told::names(run)),
            Ask::Names(names) => told::values_of(run, &names),
            Ask::State => Ok(told::state(run, clock.as_deref(), &self.ports)),
            Ask::Time(change) => {
                let mut clock = clock;
                match ask::time(run, clock.as_deref_mut(), &change) {
                    Ok(true) => {
                        self.stepping.push(answer.later());
                        return Ok(());
                    }
                    Ok(false) => {
                        let now = told::time(run, clock.as_deref());
                        self.tell_all(&Listener::message("time", &now));
                        Ok(now)
                    }
                    Err(refusal) => Err(refusal),
                }
            }
            Ask::Listen(listener) => self.listen(run, listener),
        };
        answer.give(reply);
        Ok(())
    }

    fn listen(&mut self, run: &Run, listener: Listener) -> Reply {
        let names = listener.wants.names.iter();
        let probes: Result<Vec<Probe>, String> = names.map(|name| run.probe(name)).collect();
        let probes = probes.map_err(|why| Refusal::new(422, why))?;
        let now = Instant::now();
        self.listening.push(Listening {
            values_next: listener.wants.values_every.map(|_| now),
            picture_next: listener.wants.picture_every.map(|_| now),
            listener,
            probes,
            gone: false,
        });
        self.steps = run.steps().map(|step| progress(&step)).collect();
        self.steps_next = Some(now + LOOK_AT_STEPS);
        Ok(Value::Null)
    }

    /// Answers those who waited for what has come; says whether that was anybody.
    fn answer_waiting(&mut self, run: &Run, clock: Option<&Clock>) -> bool {
        let over = |(index, _): &mut (usize, Answer)| {
            let report = run.step_report(*index);
            report.is_none_or(|step| step.done.is_some() || step.failure.is_some())
        };
        let mut any = false;
        for (index, answer) in self.waiting.extract_if(.., over) {
            answer.give(told::step(run, index));
            any = true;
        }
        if clock.is_some_and(Clock::is_stopped) && !self.stepping.is_empty() {
            let now = told::time(run, clock);
            for answer in std::mem::take(&mut self.stepping) {
                answer.give(Ok(now.clone()));
            }
            self.tell_all(&Listener::message("time", &now));
            any = true;
        }
        any
    }

    fn tell_all(&mut self, message: &Arc<str>) {
        for one in &mut self.listening {
            one.tell(message);
        }
    }

    /// Tells who listens what is due by now; says after what time more is.
    fn tell_what_is_due(&mut self, run: &Run) -> Option<Duration> {
        self.listening.retain(|one| !one.gone);
        if self.listening.is_empty() {
            return None;
        }
        let now = Instant::now();
        let mut picture = None;
        for one in &mut self.listening {
            if let Some(every) = one.listener.wants.picture_every
                && is_due(&mut one.picture_next, every, now)
            {
                let picture = picture
                    .get_or_insert_with(|| Listener::message("picture", &told::picture(run)));
                one.tell(picture);
            }
            if let Some(every) = one.listener.wants.values_every
                && is_due(&mut one.values_next, every, now)
            {
                let values = told::values(run, &one.probes);
                one.tell(&Listener::message("values", &values));
            }
        }
        if is_due(&mut self.steps_next, LOOK_AT_STEPS, now) {
            self.tell_steps(run);
        }
        let next = self
            .listening
            .iter()
            .flat_map(|one| [one.values_next, one.picture_next])
            .chain([self.steps_next])
            .flatten()
            .min();
        next.map(|next| next.saturating_duration_since(now))
    }

    /// Tells which steps have come further.
    fn tell_steps(&mut self, run: &Run) {
        let mut messages = Vec::new();
        let mut now = Vec::with_capacity(self.steps.len());
        for (index, step) in run.steps().enumerate() {
            let own = progress(&step);
            if self.steps.get(index) != Some(&own) {
                messages.push(Listener::message("step", &told::step_json(&step)));
            }
            now.push(own);
        }
        self.steps = now;
        for message in &messages {
            self.tell_all(message);
        }
    }
}

/// Ends all that was asked for and goes on; gives the names.
fn clear_added(run: &mut Run) -> Result<Vec<String>, RunError> {
    let added = run.steps().filter(|step| step.added && step.lasting);
    let names: Vec<String> = added.map(|step| step.name.to_owned()).collect();
    for name in &names {
        if let Some(index) = run.step_named(name) {
            run.clear_step(index)?;
        }
    }
    Ok(names)
}

impl Listening {
    fn tell(&mut self, message: &Arc<str>) {
        self.gone |= !self.listener.tell(message);
    }
}

impl Words {
    /// An event as who listens is told it: what the log has for programs, and its line for people.
    fn message(&self, event: &Event) -> Arc<str> {
        let mut told = self.json(event);
        told["line"] = json!(visible::line(&self.plain(event)));
        told["role"] = json!(ask::role(event));
        Listener::message("log", &told)
    }
}

/// Tells whether something is due by now, which then is due again later; what was missed is left
/// out.
fn is_due(next: &mut Option<Instant>, every: Duration, now: Instant) -> bool {
    match next {
        Some(at) if *at <= now => {
            *at = (*at + every).max(now);
            true
        }
        _ => false,
    }
}
