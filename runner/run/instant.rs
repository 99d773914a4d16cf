//! One instant of a run, and when the next one is.

use rigsim_core::SimTime;
use rigsim_core::event::{Event, Level, Role};
use rigsim_core::rig::Rig;

use super::record::Record;
use super::{MOST_ROUNDS, MOST_UNREAD, NANOSECOND, Run, RunError};

impl Run {
    /// When there is next something to look at, be it only the end. That is all that happens only
    /// while every byte is followed. Everything up to the present has happened.
    pub(super) fn next_instant(&self) -> SimTime {
        let now = self.situation.rig.now();
        let watched = self.is_watched().then(|| {
            let step = self.situation.rig.world().step_length();
            now.next_multiple(step)
        });
        let devices = self.follows_bytes.then(|| self.next_of_devices());
        let first = [watched, devices, self.agenda.next()];
        first.into_iter().flatten().fold(self.limit, SimTime::min)
    }

    /// When a device or a line next does something.
    pub(super) fn next_of_devices(&self) -> SimTime {
        let next = self.situation.rig.next_deadline().unwrap_or(SimTime::MAX);
        next.max(self.situation.rig.now() + NANOSECOND)
    }

    /// Does all that belongs to one instant; `act` is what a client does.
    pub(super) fn instant(
        &mut self,
        at: SimTime,
        act: impl FnOnce(&mut Rig),
    ) -> Result<(), RunError> {
        self.situation.rig.approach(at)?;
        let mut look = at.as_nanos().is_multiple_of(self.physics_step());
        look |= self.run_agenda(at);
        act(&mut self.situation.rig);
        self.situation.rig.advance(at)?;
        look |= self.take_events();
        self.read_ports(at);
        if look {
            self.judge(at);
        }
        self.start_due_steps(at, look)
    }

    /// Does all that comes of events that the devices brought about by themselves.
    pub(super) fn process_events(&mut self, at: SimTime) -> Result<(), RunError> {
        self.take_events();
        self.read_ports(at);
        self.judge(at);
        self.start_due_steps(at, true)
    }

    /// Does what steps set off at the same instant.
    fn start_due_steps(&mut self, at: SimTime, mut look: bool) -> Result<(), RunError> {
        let mut rounds = 1;
        while self.agenda.is_due(at) {
            rounds += 1;
            if rounds > MOST_ROUNDS {
                return Err(RunError::Stuck { at });
            }
            look |= self.run_agenda(at);
            self.situation.rig.advance(at)?;
            look |= self.take_events();
            self.read_ports(at);
            if look {
                self.judge(at);
            }
        }
        self.sample(at);
        Ok(())
    }

    pub(super) fn physics_step(&self) -> u64 {
        let step = self.situation.rig.world().step_length().as_nanos();
        u64::try_from(step).unwrap_or(u64::MAX).max(1)
    }

    /// Takes the events of the rig; returns whether there were any.
    fn take_events(&mut self) -> bool {
        let mut any = false;
        while let Some(event) = self.situation.rig.poll_event() {
            any = true;
            if !self.follows_bytes {
                // Before the next reply comes, so that the line does not fill up.
                for index in self.ports.of(event.device) {
                    self.read_port(index, event.at);
                }
            }
            if !self.observed || event.kind.code().role != Role::Reply {
                self.record_event(event);
            }
        }
        any
    }

    /// Takes note of an event.
    pub(super) fn record_event(&mut self, event: Event) {
        let excused = self.is_excused(&event);
        let distance = self.situation.rig.distance_m(event.device);
        if let Some(counters) = self.situation.counters.get_mut(event.device) {
            counters.add_event(&event, distance, excused);
        }
        if event.kind.level() != Level::Traffic {
            self.record(|| Record::Event {
                t: event.at.as_nanos(),
                device: event.device,
                code: event.kind.code().name.into(),
                text: event.kind.to_string(),
            });
        }
        self.failures.recent.push(event.clone());
        self.events.push(event);
    }

    /// Takes what has arrived at the clients' ends.
    fn read_ports(&mut self, at: SimTime) {
        if self.follows_bytes {
            for index in 0..self.ports.ids.len() {
                self.read_port(index, at);
            }
        }
    }

    pub(super) fn read_port(&mut self, index: usize, at: SimTime) {
        let port = self.ports.ids[index];
        let unread = &mut self.ports.unread[index];
        let before = unread.len();
        self.situation.rig.client_reads(port, unread);
        if unread.len() == before {
            return;
        }
        if let Some(recorder) = &mut self.recorder {
            recorder.device_sent(at, port, &unread[before..]);
        }
        if !self.script.has_port(port) {
            unread.truncate(MOST_UNREAD);
        } else {
            let over = self.script.read(at, port, unread);
            unread.clear();
            self.answers_over(over, at);
        }
    }

    fn sample(&mut self, at: SimTime) {
        if let Some(recorder) = &mut self.recorder {
            recorder.sample(at, &self.situation.rig);
        }
    }
}
