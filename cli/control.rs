//! Requests of the control socket, done to a run.

mod answers;
mod ask;
pub(crate) mod ctl;
mod listening;
mod past;
mod session;

use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};

use anyhow::Context as _;
use rigsim_control::{Answer, Ask, Control, Listener, Message, Refusal, Reply, Request};
use rigsim_core::event::{Event, Level};
use rigsim_embed::clock::Clock;
use rigsim_embed::ports::ShownPort;
use rigsim_pty::ListenAddress;
use rigsim_pty::paths::Held;
use rigsim_runner::run::Probe;
use rigsim_runner::{Run, RunError};
use serde_json::{Value, json};

use crate::exit::Failure;
use crate::log::Words;
use crate::visible;

pub(crate) use answers::{drawing, outline};
use listening::{Listening, Traffic, is_due, progress};
pub(crate) use past::Past;
use session::Session;

/// Requests that are answered before clients of the ports have their turn again.
const MOST_AT_ONCE: usize = 16;
/// Time between two times at which the log is sent, and which steps have begun or ended: a client that
/// asks without a pause is not to wait while others are woken for each of its requests.
const SEND_EVERY: Duration = Duration::from_millis(20);
/// Events of the log that wait until then.
const MOST_UNSENT: usize = 128;
/// Time for which a client in the simulator's time may be kept waiting for what is asked and sent
/// meanwhile. Each time that it was not enough halves it, until it is, so that a flood does not take this
/// much real time at each of the client's waits.
const SETTLE: Duration = Duration::from_secs(2);
/// The least that is left of it: once the flood is over, it is enough for whatever the client asks.
const LEAST_SETTLE: Duration = Duration::from_millis(10);

/// Answers requests between two steps of a run.
///
/// Where a method takes a clock, there is none if time is the client's, as in lockstep.
pub(crate) struct RequestQueue {
    words: Arc<Words>,
    ports: Vec<ShownPort>,
    listening: Vec<Listening>,
    unsent: Vec<Event>,
    traffic: Traffic,
    next_send: Option<Instant>,
    patience: Duration,
    /// Answers to be given when a step is over.
    waiting: Vec<(usize, Answer)>,
    /// Answers to be given when time stands still again.
    stepping: Vec<Answer>,
    /// What was before a run that was played again goes on.
    pub(crate) past: Option<Past>,
    /// Goes behind those that listen and wait, which then get its end.
    pub(crate) control: Control,
    /// Goes when this does.
    _session: Held,
}

impl RequestQueue {
    /// Opens the socket and writes the file by which it is found. The ports are those of the run, and
    /// `file` is the beginning of a scenario file to which steps can be added.
    pub(crate) fn open(
        listen: SocketAddr,
        file: String,
        run: &Run,
        ports: Vec<ShownPort>,
    ) -> Result<Self, Failure> {
        let table = run.scenario().rig.settings.table();
        let control = Control::open(listen, Box::new(move || answers::schema(table, &file)))
            .with_context(|| format!("cannot listen on {listen} for --control"))
            .map_err(Failure::usage)?;
        let paths = ports
            .iter()
            .map(|port| match ListenAddress::is_url(&port.path) {
                true => Ok(port.path.clone()),
                false => std::path::absolute(&port.path),
            });
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
            words: Arc::new(Words::new(&run.scenario().rig)),
            ports,
            listening: Vec::new(),
            unsent: Vec::new(),
            traffic: Traffic::default(),
            next_send: None,
            patience: SETTLE,
            waiting: Vec::new(),
            stepping: Vec::new(),
            past: None,
        })
    }

    /// Returns whether a request waits for something that comes only with time.
    pub(crate) fn wants_time(&self) -> bool {
        !self.waiting.is_empty() || !self.stepping.is_empty()
    }

    /// Something has happened.
    pub(crate) fn event(&mut self, event: &Event) {
        if self.listening.is_empty() {
            return;
        }
        if event.kind.level() == Level::Traffic {
            let mut wanting = self.listening.iter().map(|one| &one.listener);
            if !wanting.any(|listener| listener.wants.traffic) {
                return;
            }
            if !self.traffic.has_room(event.at) {
                let all = self.listening.iter().map(|one| &one.listener);
                all.filter(|listener| listener.wants.traffic)
                    .for_each(Listener::lose);
                return;
            }
        }
        self.unsent.push(event.clone());
        if self.unsent.len() == MOST_UNSENT {
            self.send_log();
        }
    }

    /// Does what is asked; says whether that was all.
    pub(crate) fn answer_some(
        &mut self,
        run: &mut Run,
        clock: &mut Clock,
        woken: bool,
    ) -> Result<bool, RunError> {
        if woken {
            self.control.quiet();
        }
        self.answer_waiting(run, Some(clock));
        self.answer_next(run, Some(clock))
    }

    /// Answers requests; says whether these were all.
    fn answer_next(
        &mut self,
        run: &mut Run,
        mut clock: Option<&mut Clock>,
    ) -> Result<bool, RunError> {
        for _ in 0..MOST_AT_ONCE {
            let Some(request) = self.control.poll() else {
                return Ok(true);
            };
            self.answer(run, clock.as_deref_mut(), request)?;
            self.answer_waiting(run, clock.as_deref());
        }
        Ok(false)
    }

    /// Does what is asked, for a client that has nothing else to do until then. If it may have asked
    /// something, or is sent something, that is all that is on its way, until it waits for an answer
    /// that only time brings. Says whether its wait may be over.
    pub(crate) fn answer_until_quiet(
        &mut self,
        run: &mut Run,
        may_have_asked: bool,
    ) -> Result<bool, RunError> {
        let begun = Instant::now();
        let mut any = self.answer_waiting(run, None) || !self.unsent.is_empty();
        self.send_log();
        self.send_due(run);
        if !any && !may_have_asked {
            // Another client asks.
            self.answer_next(run, None)?;
            return Ok(false);
        }
        let mut settling = self.control.settling();
        while !settling.is_over() {
            any = true;
            let left = self.patience.saturating_sub(begun.elapsed());
            if left.is_zero() {
                self.patience = LEAST_SETTLE.max(self.patience / 2);
                return Ok(true);
            }
            if let Some(request) = settling.request(&self.control, left) {
                self.answer(run, None, request)?;
                if self.answer_waiting(run, None) {
                    settling = self.control.settling();
                }
            }
        }
        self.patience = SETTLE;
        Ok(any)
    }

    fn answer(
        &mut self,
        run: &mut Run,
        clock: Option<&mut Clock>,
        request: Request,
    ) -> Result<(), RunError> {
        let Request { ask, answer } = request;
        let reply = match ask {
            Ask::Add { step, wait } => match ask::add(run, &step) {
                Ok(index) if wait => {
                    self.waiting.push((index, answer.later()));
                    return Ok(());
                }
                Ok(index) => answers::step(run, index),
                Err(ask::Trouble::Refused(refusal)) => Err(refusal),
                Err(ask::Trouble::Broken(error)) => return Err(error),
            },
            Ask::Steps(None) => Ok(json!({ "steps": answers::steps(run) })),
            Ask::Steps(Some(name)) => {
                ask::index(run, &name).and_then(|index| answers::step(run, index))
            }
            Ask::Clear(None) => {
                let names = clear_added(run)?;
                Ok(json!({ "cleared": names, "t": run.rig().now().as_secs_f64() }))
            }
            Ask::Clear(Some(name)) => match ask::index(run, &name) {
                Ok(index) => {
                    run.clear_step(index)?;
                    answers::step(run, index)
                }
                Err(refusal) => Err(refusal),
            },
            Ask::Names(names) if names.is_empty() => Ok(answers::names(run)),
            Ask::Names(names) => answers::values_of(run, &names),
            Ask::State => Ok(answers::state(run, clock.as_deref(), &self.ports)),
            Ask::Time(change) => {
                let mut clock = clock;
                match ask::time(run, clock.as_deref_mut(), &change) {
                    Ok(true) => {
                        self.stepping.push(answer.later());
                        return Ok(());
                    }
                    Ok(false) => {
                        let now = answers::time(run, clock.as_deref());
                        self.send_to_all(&message("time", now.clone()));
                        Ok(now)
                    }
                    Err(refusal) => Err(refusal),
                }
            }
            Ask::Publish(values) => {
                let now = run.rig().now();
                let published = run.publish(now, &values.to_string())?;
                published
                    .map(|()| json!({ "published": values }))
                    .map_err(|why| Refusal::new(422, why.to_string()))
            }
            Ask::Listen(listener) => self.listen(run, listener),
        };
        answer.give(reply);
        Ok(())
    }

    fn listen(&mut self, run: &Run, listener: Listener) -> Reply {
        let names = listener.wants.names.iter();
        let probes: Result<Vec<Probe>, _> = names.map(|name| run.probe(name)).collect();
        let probes = probes.map_err(|why| Refusal::new(422, why.to_string()))?;
        let now = Instant::now();
        self.send_log();
        let steps = run.steps().map(|step| progress(&step)).collect();
        let known = (steps, run.failures().len());
        let past = self
            .past
            .as_ref()
            .filter(|_| listener.wants.picture_every.is_some());
        let past = past.map(|past| message("past", past.shown(&probes, &self.words)));
        let mut one = Listening::new(listener, probes, known, now);
        past.iter().for_each(|past| one.send(past));
        self.listening.push(one);
        self.next_send.get_or_insert(now + SEND_EVERY);
        Ok(Value::Null)
    }

    /// Answers the requests that waited for what has come; returns whether there were any.
    fn answer_waiting(&mut self, run: &Run, clock: Option<&Clock>) -> bool {
        let over = |(index, _): &mut (usize, Answer)| {
            let report = run.step_report(*index);
            report.is_none_or(|step| step.done.is_some() || step.failure.is_some())
        };
        let mut any = false;
        for (index, answer) in self.waiting.extract_if(.., over) {
            answer.give(answers::step(run, index));
            any = true;
        }
        if clock.is_some_and(Clock::is_stopped) && !self.stepping.is_empty() {
            let now = answers::time(run, clock);
            for answer in std::mem::take(&mut self.stepping) {
                answer.give(Ok(now.clone()));
            }
            self.send_to_all(&message("time", now.clone()));
            any = true;
        }
        any
    }

    fn send_to_all(&mut self, message: &Message) {
        for one in &mut self.listening {
            one.send(message);
        }
    }

    /// Sends to listeners what is due by now; returns the time after which more is. What has happened must be
    /// known by then ([`RequestQueue::event`]), so that a step is sent behind the log of what came of it.
    pub(crate) fn send_due(&mut self, run: &Run) -> Option<Duration> {
        self.listening.retain(|one| !one.gone);
        if self.listening.is_empty() {
            self.next_send = None;
            return None;
        }
        let now = Instant::now();
        let mut picture = None;
        for one in &mut self.listening {
            if let Some(every) = one.listener.wants.picture_every
                && is_due(&mut one.picture_next, every, now)
            {
                let picture =
                    picture.get_or_insert_with(|| message("picture", answers::picture(run)));
                one.send(picture);
            }
            if let Some(every) = one.listener.wants.values_every
                && is_due(&mut one.values_next, every, now)
            {
                let values = answers::values(run, &one.probes);
                one.send(&message("values", values));
            }
        }
        if is_due(&mut self.next_send, SEND_EVERY, now) {
            self.send_log();
            self.send_steps(run);
            self.report_failures(run);
        }
        let next = self
            .listening
            .iter()
            .flat_map(|one| [one.values_next, one.picture_next])
            .chain([self.next_send])
            .flatten()
            .min();
        next.map(|next| next.saturating_duration_since(now))
    }

    /// Sends what has happened.
    fn send_log(&mut self) {
        for event in self.unsent.drain(..) {
            let is_traffic = event.kind.level() == Level::Traffic;
            let words = Arc::clone(&self.words);
            let message = Message::new("log", move || log_line(&words, &event));
            for one in &mut self.listening {
                if !is_traffic || one.listener.wants.traffic {
                    one.send(&message);
                }
            }
        }
    }

    /// Sends each listener the failures that it does not know yet.
    fn report_failures(&mut self, run: &Run) {
        let failures = run.failures();
        for one in &mut self.listening {
            for failure in failures.iter().skip(one.failures) {
                one.send(&message("failure", answers::failure(failure)));
            }
            one.failures = failures.len();
        }
    }

    /// Sends to each listener which steps have come further since the last time.
    fn send_steps(&mut self, run: &Run) {
        for (index, step) in run.steps().enumerate() {
            let now = progress(&step);
            let mut shown = None;
            for one in &mut self.listening {
                if one.takes(index, now) {
                    one.send(
                        shown.get_or_insert_with(|| message("step", answers::step_json(&step))),
                    );
                }
            }
        }
    }
}

impl Drop for RequestQueue {
    fn drop(&mut self) {
        self.send_log();
    }
}

/// Ends every added step that lasts; returns their names.
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

/// Something that is known now, as listeners get it.
fn message(kind: &'static str, data: Value) -> Message {
    Message::new(kind, move || data)
}

/// An event as listeners get it: what the log has for programs, and its line for people.
fn log_line(words: &Words, event: &Event) -> Value {
    let mut shown = words.json(event);
    shown["line"] = json!(visible::line(&words.plain(event)));
    shown["role"] = json!(ask::role(event));
    shown
}
