//! A run: the devices, what happens to them, and what is made of it.
//!
//! A [`Run`] is driven by a loop in real time that serves ports, by scripted
//! clients and clients in simulated time, and by a trace that is played again. Devices that are
//! only served are a run without steps ([`Scenario::serving`]).
//!
//! # How to drive it
//!
//! 1. Say what a client does, and when: [`Run::attach`], [`Run::detach`], [`Run::send`],
//!    [`Run::set_line`]. Never send more than there is [`Rig::space`] for; the rest would be lost.
//! 2. Let time pass with [`Run::advance`], at the latest up to [`Run::next_deadline`] if what comes of it
//!    is wanted at once. A time that has passed already does nothing.
//! 3. Drain it: [`Run::read`] for each port, [`Run::poll_event`] and, if there is a trace,
//!    [`Run::poll_trace`], until each returns nothing. What is not taken is kept up to a bound: 1 MiB of
//!    bytes for each port, 16384 events (the oldest go first and are counted), a million lines of the
//!    trace.
//! 4. Hang clients up whose cable is out ([`Rig::cable_pulled`]).
//! 5. Go on until [`Run::finished`] says what came of it; a run without steps has no end but
//!    [`Run::end`].
//!
//! # The order of things
//!
//! At one instant the file's steps come first, in the order of the file; then what a client does;
//! then arrivals, deadlines and the physics, as [`Rig`] has them; then conditions are looked at. A
//! step that begins because of that happens at the same instant, after all that.
//!
//! # When conditions are looked at
//!
//! At every instant at which a step or a window of the file begins or ends, at which an event
//! happens, and at every step of the physics (5 ms unless set), also while nothing moves. What is
//! true only in between is not seen.
//!
//! When a run neither writes a trace nor plays scripted clients, nothing is looked at in between:
//! it costs what its devices cost.
//!
//! # Clients
//!
//! What a client does always has its own instant: it is dated a nanosecond later than
//! whatever has been done already. So a recorded run can be repeated exactly.

mod agenda;
mod client;
mod context;
mod direct;
mod excuses;
mod expectations;
mod host;
mod instant;
mod judge;
mod margin;
mod outcome;
mod plan;
mod ports;
mod probe;
mod published;
pub(crate) mod record;
mod recorder;
mod responses;
mod rules;
mod steps;
mod verdict;

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;

use rigsim_core::SimTime;
use rigsim_core::device::Counters;
use rigsim_core::event::Event;
use rigsim_core::line::Wire;
use rigsim_core::newest::Newest;
use rigsim_core::report::Report;
use rigsim_core::rig::{PortId, Rig, RigError};
use rigsim_physics::WorldMap;
use rigsim_settings::Source;

pub use direct::{StepError, StepReport};
pub use outcome::{Context, DeviceReport, Failure, FailureKind, FaultRecord, Margin, Outcome};
pub use probe::Probe;
pub use published::{MOST_LINE, PublishError, published};

use crate::condition::Situation;
use crate::scenario::Scenario;
use agenda::Agenda;
use excuses::Excuses;
use expectations::Expectations;
use host::Script;
use plan::Plan;
use ports::Ports;
use published::Published;
use record::Record;
use recorder::Recorder;
use steps::StepState;

/// Rounds at one instant after which a scenario is given up: its steps set one another off.
const MOST_ROUNDS: u32 = 10_000;
/// Most events that are kept until they are taken; the oldest go first.
const MOST_EVENTS: usize = 1 << 14;
/// How many of the last things that happened a failure shows.
const MOST_RECENT: usize = 60;
/// Most bytes kept for a client that does not read; further ones are lost.
const MOST_UNREAD: usize = 1 << 20;
/// How much simulated time is played before the trace is taken.
const SLICE: Duration = Duration::from_millis(500);
const NANOSECOND: Duration = Duration::from_nanos(1);

/// Reason for which a run cannot go on.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum RunError {
    /// The simulation has broken down.
    #[error(transparent)]
    Rig(#[from] RigError),
    /// The scenario goes round in circles.
    #[error("at {at} s the scenario's steps set one another off without end")]
    Stuck {
        /// When.
        at: SimTime,
    },
    /// The world file is wrong.
    #[error("{0}")]
    World(String),
}

/// Options of a run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RunOptions {
    /// From which everything random is derived.
    pub seed: u64,
    /// Pace of bytes on the lines.
    pub wire: Wire,
    /// A real client stands in the place of the scripted one.
    pub live: bool,
    /// Set if a trace is to be written.
    pub trace: bool,
}

impl RunOptions {
    /// Simulated time with the scripted client, and no trace.
    #[must_use]
    pub fn scripted(seed: u64) -> Self {
        Self {
            seed,
            wire: Wire::Paced,
            live: false,
            trace: false,
        }
    }
}

/// A scenario that is being played, or devices that are being served.
pub struct Run {
    plan: Plan,
    situation: Situation,
    ports: Ports,
    agenda: Agenda,
    steps: Vec<StepState>,
    expectations: Expectations,
    published: Published,
    excuses: Excuses,
    script: Script,
    recorder: Option<Recorder>,
    /// Set if every byte is looked at when it arrives: for a trace, a scripted client, or one whose
    /// time is the run's.
    follows_bytes: bool,
    events: Newest<Event>,
    /// Set if the replies are those of real devices.
    observed: bool,
    failures: Failures,
    limit: SimTime,
    outcome: Option<Outcome>,
}

/// What has failed, and what happened before.
struct Failures {
    list: Vec<Failure>,
    /// How many more there were.
    more: u64,
    /// Things that happened since the last failure.
    recent: Newest<Event>,
    /// What was in effect at the end.
    last_in_effect: Option<(Vec<String>, Vec<String>)>,
}

impl Run {
    /// A run that has not begun. `world` is the world file that the scenario names, if it does.
    ///
    /// # Errors
    /// When the world file is wrong, or lacks an obstacle that a step moves or removes.
    pub fn new(
        scenario: Arc<Scenario>,
        world: Option<Source<'_>>,
        options: RunOptions,
    ) -> Result<Self, RunError> {
        let map = match world {
            Some(source) => WorldMap::from_toml(source.text, source.file)
                .map_err(|error| RunError::World(error.to_string()))?,
            None => WorldMap::default(),
        };
        scenario.check_obstacles(&map).map_err(RunError::World)?;
        let rig = scenario.rig.build(map, options.wire, options.seed);
        let devices = scenario.rig.devices.len();
        let ids = scenario.rig.links().map(|link| link.id).collect();
        let recorder = options
            .trace
            .then(|| Recorder::new(&scenario, world, options));
        let mut run = Self {
            ports: Ports::new(ids),
            agenda: Agenda::default(),
            steps: StepState::all(&scenario, options.seed),
            expectations: Expectations::new(&scenario),
            situation: Situation {
                rig,
                counters: (0..devices).map(|_| Counters::default()).collect(),
                saved: vec![None; scenario.saved.len()],
                published: BTreeMap::new(),
            },
            published: Published::default(),
            excuses: Excuses::new(devices),
            script: Script::default(),
            recorder,
            follows_bytes: options.trace || !options.live || scenario.scripted.contains(&true),
            events: Newest::new(MOST_EVENTS),
            observed: false,
            failures: Failures {
                list: Vec::new(),
                more: 0,
                recent: Newest::new(MOST_RECENT),
                last_in_effect: None,
            },
            limit: SimTime::ZERO + scenario.limit,
            outcome: None,
            plan: Plan { scenario, options },
        };
        run.open_script()?;
        run.schedule();
        Ok(run)
    }

    /// Plays it to its end in simulated time; `trace` takes the lines of the trace.
    ///
    /// # Errors
    /// When the simulation or the scenario cannot go on.
    pub fn play(&mut self, trace: &mut dyn FnMut(&str)) -> Result<&Outcome, RunError> {
        let mut to = self.situation.rig.now();
        while self.outcome.is_none() {
            to += SLICE;
            self.advance(to)?;
            while let Some(line) = self.poll_trace() {
                trace(&line);
            }
        }
        Ok(self.end())
    }

    /// Goes on to `to`, or to the end.
    ///
    /// # Errors
    /// When the simulation or the scenario cannot go on.
    pub fn advance(&mut self, to: SimTime) -> Result<(), RunError> {
        while self.step(to)? {}
        Ok(())
    }

    /// Goes on by one instant, but not beyond `to`; says whether more happens until then. A file
    /// may ask for a thousand million instants a second, so this is for callers that read a clock in
    /// between.
    ///
    /// # Errors
    /// When the simulation or the scenario cannot go on.
    pub fn step(&mut self, to: SimTime) -> Result<bool, RunError> {
        if self.outcome.is_some() {
            return Ok(false);
        }
        let to = to.min(self.limit);
        let next = self.next_instant();
        let before = (next - NANOSECOND).min(to);
        if next > self.situation.rig.now() && self.situation.rig.advance_to_event(before)? {
            self.process_events(self.situation.rig.now())?;
        } else if next > to {
            return Ok(false);
        } else {
            self.instant(next, |_| {})?;
            if next >= self.limit {
                self.finish();
            }
        }
        Ok(self.outcome.is_none())
    }

    /// Time at which something next happens by itself; `None` when the run is over.
    #[must_use]
    pub fn next_deadline(&self) -> Option<SimTime> {
        let next = || self.next_instant().min(self.next_of_devices());
        self.outcome.is_none().then(next)
    }

    /// The devices and the world, to look at.
    #[must_use]
    pub fn rig(&self) -> &Rig {
        &self.situation.rig
    }

    /// The same, for tests that install observers before the run begins.
    #[doc(hidden)]
    pub fn rig_mut(&mut self) -> &mut Rig {
        &mut self.situation.rig
    }

    /// The ports of all devices.
    #[must_use]
    pub fn ports(&self) -> &[PortId] {
        &self.ports.ids
    }

    /// The scenario.
    #[must_use]
    pub fn scenario(&self) -> &Scenario {
        &self.plan.scenario
    }

    /// From which everything random is derived.
    #[must_use]
    pub fn seed(&self) -> u64 {
        self.plan.options.seed
    }

    /// Returns whether a real client stands in the place of the scripted one.
    #[must_use]
    pub fn is_live(&self) -> bool {
        self.plan.options.live
    }

    /// Outcome of it; `None` while it goes on.
    #[must_use]
    pub fn finished(&self) -> Option<&Outcome> {
        self.outcome.as_ref()
    }

    /// Ends it now, as when a real client has ended, and says what came of it.
    pub fn end(&mut self) -> &Outcome {
        if self.outcome.is_none() {
            self.finish();
        }
        self.outcome.get_or_insert_default()
    }

    /// Something outside of the simulation went wrong, as a real client that ended with an error;
    /// the run does not pass.
    pub fn fail(&mut self, what: String) {
        let at = self.situation.rig.now();
        self.add_failure(FailureKind::Client, at, None, what.into());
    }

    /// Counts of what happened at each device so far, and of what is attributed to its client.
    pub fn reports(&self) -> impl Iterator<Item = &Report> {
        self.situation
            .counters
            .iter()
            .map(|counters| &counters.report)
    }

    /// Number of events that were lost because they were not taken.
    #[must_use]
    pub fn events_lost(&self) -> u64 {
        self.events.lost + self.situation.rig.events_lost()
    }

    /// Number of events that are attributed to no party because the simulator was late.
    #[must_use]
    pub fn excused(&self) -> u64 {
        self.excuses.excused()
    }

    /// The next event.
    pub fn poll_event(&mut self) -> Option<Event> {
        self.events.pop()
    }

    /// Writes a line of the trace, if there is one.
    fn record(&mut self, record: impl FnOnce() -> Record) {
        if let Some(recorder) = &mut self.recorder {
            recorder.write(&record());
        }
    }

    /// The next line of the trace, without its line feed.
    pub fn poll_trace(&mut self) -> Option<String> {
        self.recorder.as_mut()?.poll()
    }
}

#[cfg(test)]
mod tests;
