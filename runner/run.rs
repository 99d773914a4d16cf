//! A run of a scenario: the devices, what happens to them, and what is made of it.
//!
//! One [`Run`] serves both kinds of time. Without a client it goes from instant to instant as fast
//! as the machine allows; with a real client whoever drives it says up to when it may go and what
//! the client sends.
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
//! # Clients
//!
//! What a client does always has an instant of its own: it is dated a nanosecond later than
//! whatever has been done already. So a recorded run can be repeated exactly.

mod agenda;
mod client;
mod effects;
mod host;
mod judge;
mod outcome;
mod steps;

use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;
use std::time::Duration;

use sim_core::SimTime;
use sim_core::event::Event;
use sim_core::line::{ClientLine, Wire};
use sim_core::rig::{PortId, Rig, RigError};
use sim_physics::{Ground, WorldMap};
use sim_settings::Source;

pub use outcome::{DeviceReport, Failure, FaultRecord, Outcome};

use crate::condition::Seen;
use crate::scenario::Scenario;
use crate::trace::Recorder;
use agenda::Agenda;
use host::HostPort;
use judge::{Expected, RuleState};
use steps::StepState;

/// Rounds at one instant after which a scenario is given up: its steps set one another off.
const MOST_ROUNDS: u32 = 10_000;
/// Most events kept for whoever takes them; the oldest go first.
const MOST_EVENTS: usize = 1 << 14;
/// How many of the last events an outcome shows.
const MOST_RECENT: usize = 60;
/// Most bytes kept for a client that does not read; further ones are lost.
const MOST_UNREAD: usize = 1 << 20;
/// How much simulated time is played before the trace is taken.
const SLICE: Duration = Duration::from_millis(500);
const NANOSECOND: Duration = Duration::from_nanos(1);

/// Why a run cannot go on.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
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

/// How to run a scenario.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RunOptions {
    /// From which everything random is derived.
    pub seed: u64,
    /// Whether bytes take time on the lines.
    pub wire: Wire,
    /// A real client stands in the place of the scripted one.
    pub live: bool,
    /// Whether to write a trace.
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

/// Decides what is not held against a client.
pub type Excuse = Box<dyn FnMut(&Event) -> bool + Send>;

/// A scenario that is being played.
pub struct Run {
    scenario: Arc<Scenario>,
    options: RunOptions,
    rig: Rig,
    ports: Vec<PortId>,
    seen: Vec<Seen>,
    agenda: Agenda,
    steps: Vec<StepState>,
    rules: Vec<RuleState>,
    expected: Vec<Expected>,
    hosts: BTreeMap<PortId, HostPort>,
    /// Up to when what a disturbed line looks like is not the client's fault, by device.
    excused_until: Vec<SimTime>,
    excuse: Option<Excuse>,
    lines: BTreeMap<PortId, ClientLine>,
    unread: BTreeMap<PortId, Vec<u8>>,
    recorder: Option<Recorder>,
    events: VecDeque<Event>,
    recent: VecDeque<Event>,
    failures: Vec<Failure>,
    more_failures: u64,
    /// The ground as the settings have it.
    ground: Ground,
    limit: SimTime,
    outcome: Option<Outcome>,
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
        let ports: Vec<PortId> = scenario
            .rig
            .devices
            .iter()
            .enumerate()
            .flat_map(|(device, plan)| {
                let links = plan.links().into_iter();
                links.map(move |link| PortId {
                    device,
                    link: link.index,
                })
            })
            .collect();
        let settings = &scenario.rig.settings.world;
        let ground = Ground::new(
            settings.friction,
            settings.slope.to_radians(),
            settings.uphill.to_radians(),
        );
        let recorder = options
            .trace
            .then(|| Recorder::new(&scenario, world, options));
        let mut run = Self {
            seen: vec![Seen::default(); scenario.rig.devices.len()],
            agenda: Agenda::default(),
            steps: StepState::all(&scenario, options.seed),
            rules: judge::rule_states(&scenario),
            expected: Vec::new(),
            hosts: BTreeMap::new(),
            excused_until: vec![SimTime::ZERO; scenario.rig.devices.len()],
            excuse: None,
            lines: BTreeMap::new(),
            unread: BTreeMap::new(),
            recorder,
            events: VecDeque::new(),
            recent: VecDeque::new(),
            failures: Vec::new(),
            more_failures: 0,
            ground,
            limit: SimTime::ZERO + scenario.limit,
            outcome: None,
            scenario,
            options,
            rig,
            ports,
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
        let mut to = self.rig.now();
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

    /// Goes on by one instant, but not beyond `to`; says whether more happens until then. A file may
    /// ask for a thousand million instants a second, so this is for whoever has to look at a clock in
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
        if next > to {
            self.rig.advance(to)?;
            return Ok(false);
        }
        self.instant(next, |_| {})?;
        if next >= self.limit {
            self.finish();
        }
        Ok(self.outcome.is_none())
    }

    /// When something next happens by itself; `None` when the run is over.
    #[must_use]
    pub fn next_deadline(&self) -> Option<SimTime> {
        self.outcome.is_none().then(|| self.next_instant())
    }

    /// The devices and the world, to look at.
    #[must_use]
    pub fn rig(&self) -> &Rig {
        &self.rig
    }

    /// The ports of all devices.
    #[must_use]
    pub fn ports(&self) -> &[PortId] {
        &self.ports
    }

    /// The scenario.
    #[must_use]
    pub fn scenario(&self) -> &Scenario {
        &self.scenario
    }

    /// How it is run.
    #[must_use]
    pub fn options(&self) -> RunOptions {
        self.options
    }

    /// What came of it; `None` while it goes on.
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
        let at = self.rig.now();
        self.note_failure(Failure {
            at,
            step: None,
            what,
        });
    }

    /// Has `excuse` say which events are not to be held against the client, as those that a busy
    /// machine brought about.
    pub fn excuse_with(&mut self, excuse: Excuse) {
        self.excuse = Some(excuse);
    }

    /// The next event.
    pub fn poll_event(&mut self) -> Option<Event> {
        self.events.pop_front()
    }

    /// The next line of the trace, without its line feed.
    pub fn poll_trace(&mut self) -> Option<String> {
        self.recorder.as_mut()?.poll()
    }

    /// When something next happens. Everything up to the present has happened.
    fn next_instant(&self) -> SimTime {
        let now = self.rig.now();
        let watched = self.is_watched().then(|| {
            let step = self.rig.world().step_length();
            now.next_multiple(step)
        });
        let by_itself = [self.rig.next_deadline(), watched];
        let by_itself = by_itself.into_iter().flatten().min();
        let by_itself = by_itself.map(|at| at.max(now + NANOSECOND));
        let planned = self.agenda.next();
        let first = [by_itself, planned, Some(self.limit)];
        first.into_iter().flatten().min().unwrap_or(self.limit)
    }

    /// Does all that belongs to one instant; `act` is what a client does.
    fn instant(&mut self, at: SimTime, act: impl FnOnce(&mut Rig)) -> Result<(), RunError> {
        self.rig.approach(at)?;
        let mut looked_at = at.as_nanos().is_multiple_of(self.physics_step());
        let mut act = Some(act);
        for _ in 0..MOST_ROUNDS {
            looked_at |= self.run_agenda(at);
            if let Some(act) = act.take() {
                act(&mut self.rig);
            }
            self.rig.advance(at)?;
            looked_at |= self.take_events();
            self.read_ports(at);
            if looked_at {
                self.judge(at);
            }
            if !self.agenda.is_due(at) {
                self.sample(at);
                return Ok(());
            }
        }
        Err(RunError::Stuck { at })
    }

    fn physics_step(&self) -> u64 {
        let step = self.rig.world().step_length().as_nanos();
        u64::try_from(step).unwrap_or(u64::MAX).max(1)
    }

    /// Takes note of what the rig tells; says whether it told anything.
    fn take_events(&mut self) -> bool {
        let mut any = false;
        while let Some(event) = self.rig.poll_event() {
            any = true;
            let excused = self.is_excused(&event);
            let distance = self.rig.distance_m(event.device);
            if let Some(seen) = self.seen.get_mut(event.device) {
                seen.note(&event, distance, excused);
            }
            if let Some(recorder) = &mut self.recorder {
                recorder.event(&event);
            }
            if self.recent.len() >= MOST_RECENT {
                self.recent.pop_front();
            }
            self.recent.push_back(event.clone());
            if self.events.len() >= MOST_EVENTS {
                self.events.pop_front();
            }
            self.events.push_back(event);
        }
        any
    }

    /// Takes what has arrived at the clients' ends.
    fn read_ports(&mut self, at: SimTime) {
        for index in 0..self.ports.len() {
            let port = self.ports[index];
            let mut bytes = Vec::new();
            self.rig.client_reads(port, &mut bytes);
            if bytes.is_empty() {
                continue;
            }
            if let Some(recorder) = &mut self.recorder {
                recorder.device_sent(at, port, &bytes);
            }
            if self.options.live {
                let unread = self.unread.entry(port).or_default();
                let room = MOST_UNREAD.saturating_sub(unread.len());
                unread.extend(bytes.iter().take(room));
            } else {
                self.host_reads(at, port, &bytes);
            }
        }
    }

    fn sample(&mut self, at: SimTime) {
        if let Some(recorder) = &mut self.recorder {
            recorder.sample(at, &self.rig);
        }
    }
}

#[cfg(test)]
mod tests;
