//! The real-time loop: it supplies a run with the time and the clients' bytes, and the clients
//! with the devices' bytes.
//!
//! # When the machine is busy
//!
//! The system may not run the simulator for a while, although something was due. If it then went
//! on to the clock's present, deadlines such as a watchdog's would pass before the bytes that a
//! client had sent in time, and the client would seem to be late. No time stamp could mend that: what
//! was sent in half a second of regular commands arrives as one burst, and then half a second is
//! missing. So simulated time stands still from the last time the simulator ran; the clients'
//! bytes come next, and are dated then. A client sees what it would see of a device that was slow
//! to answer, every notice of it is a `simulator_stalled`, and what a client does in rhythm but
//! arrives in a burst is not its error.
//!
//! When the simulator was late by less, what it reads is dated when it reads it, although it may
//! have been sent as much earlier.
//!
//! In the same way simulated time stands still when there is more to compute than there is time,
//! and in a pause. Devices are informed of all this ([`Run::late`]), and judge how fast a client
//! sends by the client's own clock.

use std::time::{Duration, Instant};

use rigsim_core::SimTime;
use rigsim_core::line::UART_FIFO;
use rigsim_core::rig::PortId;
use rigsim_pty::{Counters, Event, Waiter, Wake};
use rigsim_runner::{Run, RunError};

use crate::clock::Clock;
use crate::error::Error;
use crate::served::Served;
pub use crate::slowness::Stalls;
use crate::slowness::{RunQueue, Slowness};

/// Shortest sleep. A byte takes 87 µs at 115200 baud; waking for each one would cost more than it
/// is worth, since a client cannot tell.
const SHORTEST_SLEEP: Duration = Duration::from_micros(100);
/// Lateness of the simulator from which on simulated time stands still. Schedulers of
/// desktops are late by a few milliseconds now and then, and deadlines of half a second do not
/// mind.
const MOST_LATE: Duration = Duration::from_millis(20);
/// Longest sleep after the machine has stalled the simulator, or a client has sent something; from
/// then on twice as long each time that it is woken when it asked to be. Only a sleep that ends too
/// late shows that the machine stood still: while a client is at work, none may be longer than what
/// is to be noticed. Simulated time stands still from the beginning of such a sleep, so a simulator
/// that is stopped again and again would sleep through the same span for ever.
const FIRST_SLEEP: Duration = MOST_LATE;
/// A sleep that may be as long as this may have any length.
const LONG_SLEEP: Duration = Duration::from_secs(1);
/// Lateness from which on what clients send may come up to that much closer together than they were
/// sent.
const LITTLE_LATE: Duration = Duration::from_millis(1);
/// Time to compute before looking at signals and ports again.
const BUDGET: Duration = Duration::from_millis(10);
/// Simulated time to compute before looking at the clock again.
const SLICE: Duration = Duration::from_millis(1);
/// Reads of one port before the others have their turn.
const MOST_READS: usize = 16;
/// A port whose line was full is read again when it has room for so many bytes.
const RESUME_ROOM: usize = UART_FIFO / 2;

/// Moment at which simulated time begins.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Begin {
    /// At once.
    Now,
    /// First opening of a port by a client: whatever is planned waits for clients that are slow to
    /// start.
    WithClient,
    /// When it is resumed: a run that has come to some time already stands still there.
    Paused,
}

/// What the attendant of a run wants.
#[derive(Debug, Clone, Copy, Default)]
pub struct Wants {
    /// To be called again after so much real time at most.
    pub again: Option<Duration>,
    /// Time to begin even if no client has opened a port: a request waits for something that comes only with
    /// time.
    pub time: bool,
}

/// Reason for which the loop came to its end.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Ended {
    /// A signal asked for it.
    Signal,
    /// Nothing happens any more in the simulation.
    Over,
    /// Something that is watched has something to tell.
    Watched,
    /// The time allowed has passed.
    Timeout,
}

/// A run and the ports on which its devices are served.
pub struct Server {
    run: Run,
    ports: Vec<Served>,
    waiter: Waiter,
    clock: Clock,
    /// Simulated time has not begun.
    waiting: bool,
    /// Time to stop at in any case.
    until: Option<Instant>,
    slowness: Slowness,
    stalled: Stalls,
    outgoing: Vec<u8>,
}

impl Server {
    /// Serves `run`, whose time runs `speed` times as fast as real time.
    ///
    /// # Errors
    /// When a port cannot be waited for.
    pub fn new(
        run: Run,
        mut ports: Vec<Served>,
        mut waiter: Waiter,
        begin: Begin,
        speed: f64,
    ) -> Result<Self, Error> {
        // Without it Linux may wake us 50 µs late; with it refused, it does.
        let _ = rigsim_pty::sharpen_timers();
        for (token, served) in ports.iter_mut().enumerate() {
            if let Some(port) = &mut served.port {
                waiter.add(token, port)?;
            }
        }
        let mut clock = Clock::start(speed);
        if begin == Begin::Paused {
            clock.stop(run.rig().now());
        }
        Ok(Self {
            run,
            ports,
            waiter,
            clock,
            waiting: begin == Begin::WithClient,
            until: None,
            slowness: Slowness::default(),
            stalled: Stalls::default(),
            outgoing: Vec::new(),
        })
    }

    /// Returns what is served, to look at.
    pub fn run(&self) -> &Run {
        &self.run
    }

    /// The same, to change.
    pub fn run_mut(&mut self) -> &mut Run {
        &mut self.run
    }

    /// For how long simulated time stood still so far.
    pub fn stalled(&self) -> Stalls {
        self.stalled
    }

    /// Ends the loop when `source` can be read or has come to its end.
    ///
    /// # Errors
    /// When it cannot be waited for.
    pub fn watch(&mut self, source: impl std::os::fd::AsFd) -> Result<(), Error> {
        Ok(self.waiter.watch(self.watched(), source)?)
    }

    /// Reports to the attendant when `source` can be read.
    ///
    /// # Errors
    /// When it cannot be waited for.
    pub fn wake_from(&mut self, source: impl std::os::fd::AsFd) -> Result<(), Error> {
        Ok(self.waiter.watch(self.waking(), source)?)
    }

    /// Ends the loop after so much real time.
    pub fn stop_after(&mut self, allowed: Duration) {
        self.until = Instant::now().checked_add(allowed);
    }

    /// Closes the ports; returns their totals by device.
    pub fn close_ports(&mut self) -> Vec<(PortId, Counters)> {
        let ports = self.ports.drain(..);
        ports.map(|s| (s.id, s.counters())).collect()
    }

    /// Waits so long for a further signal, once the ports are closed.
    pub fn is_interrupted(&mut self, within: Duration) -> bool {
        let wake = self.waiter.wait(Some(within));
        // Without a way to wait there is none to be interrupted either; the end comes anyway.
        wake.is_ok_and(Wake::is_signalled)
    }

    /// Serves to the end. Each round, between two steps of the run, `attend` may change what happens in it and
    /// how its time passes; its last argument says that there is something to read where it is to be woken
    /// from.
    ///
    /// # Errors
    /// When a port or the simulation fails.
    pub fn serve(
        &mut self,
        mut attend: impl FnMut(&mut Run, &mut Clock, bool) -> Result<Wants, RunError>,
    ) -> Result<Ended, Error> {
        let mut sleep_asked = Some(Duration::ZERO);
        let mut longest_sleep = LONG_SLEEP;
        let queue = RunQueue::of_this_thread();
        loop {
            let is_long = sleep_asked.is_none_or(|sleep| sleep > MOST_LATE);
            let queued = is_long.then(|| queue.waited());
            let asleep_at = Instant::now();
            let wake = self.waiter.wait(sleep_asked)?;
            if wake.is_signalled() {
                return Ok(Ended::Signal);
            }
            let ready: Vec<usize> = wake.ready().to_vec();
            let sleep = sleep_asked.unwrap_or(Duration::MAX);
            // Since the last look at the clock: at work, or in its sleep.
            let late = self.behind().saturating_sub(sleep);
            // A client may have wanted to wake us long before the end of the sleep.
            let unseen = queued.map(|before| queue.waited().saturating_sub(before));
            let mut uneven = unseen.unwrap_or_default();
            longest_sleep = LONG_SLEEP.min(2 * longest_sleep);
            if asleep_at.elapsed().saturating_sub(sleep) > MOST_LATE {
                longest_sleep = FIRST_SLEEP;
                self.was_stalled(late);
            } else if late > MOST_LATE {
                // Not in its sleep but at its work, which may have been too much.
                self.fell_behind(late);
            } else {
                uneven = uneven.max(late);
            }
            self.advance()?;
            if uneven > LITTLE_LATE {
                self.was_late(uneven);
            }
            self.update_cables()?;
            for token in &ready {
                self.take_input(*token, false)?;
                // A stop of the machine is seen by a sleep that it outlasts. Who is driving needs that.
                longest_sleep = FIRST_SLEEP;
            }
            for token in 0..self.ports.len() {
                self.deliver(token)?;
            }
            let woken = ready.contains(&self.waking());
            let wants = attend(&mut self.run, &mut self.clock, woken)?;
            if wants.time {
                self.begin();
            }
            if self.run.finished().is_some() {
                return Ok(Ended::Over);
            }
            if ready.contains(&self.watched()) {
                return Ok(Ended::Watched);
            }
            let left = match self.until {
                Some(until) => until.saturating_duration_since(Instant::now()),
                None => Duration::MAX,
            };
            if left.is_zero() {
                return Ok(Ended::Timeout);
            }
            let next = self.run.next_deadline();
            // What may go on goes on as soon as there is a later time for it.
            let may_resume = (0..self.ports.len()).any(|token| self.may_resume(token));
            let due = if may_resume { Some(self.now()) } else { next };
            let due = due.filter(|_| !self.waiting);
            sleep_asked = due.and_then(|due| self.clock.until(due));
            sleep_asked = sleep_asked.map(|sleep| sleep.max(SHORTEST_SLEEP));
            for other in [wants.again, self.until.map(|_| left)]
                .into_iter()
                .flatten()
            {
                sleep_asked = Some(sleep_asked.map_or(other, |sleep| sleep.min(other)));
            }
            if longest_sleep < LONG_SLEEP {
                sleep_asked = sleep_asked.map(|sleep| sleep.min(longest_sleep));
            }
        }
    }

    /// Returns whether simulated time has begun.
    pub fn has_begun(&self) -> bool {
        !self.waiting
    }

    /// Takes what clients that have left had still sent, as far as the lines have room for it; says
    /// whether all of them are found to have left. No client reads any replies.
    ///
    /// # Errors
    /// When a port or the simulation fails.
    pub fn take_the_rest(&mut self) -> Result<bool, Error> {
        for token in 0..self.ports.len() {
            self.take_input(token, true)?;
        }
        Ok(!self.ports.iter().any(Served::is_attached))
    }

    /// The token of the watched descriptor, which differs from those of ports.
    fn watched(&self) -> usize {
        self.ports.len()
    }

    /// The token of what wakes the attendant.
    fn waking(&self) -> usize {
        self.ports.len() + 1
    }

    /// Hangs ports up whose cable has been pulled, and makes those again whose cable is back.
    fn update_cables(&mut self) -> Result<(), Error> {
        for (token, served) in self.ports.iter_mut().enumerate() {
            let pulled = self.run.rig().cable_pulled(served.id);
            if !pulled {
                served.reopen(&mut self.waiter, token)?;
            } else if served.hang_up() {
                self.run.detach(served.id, self.run.rig().now())?;
            }
        }
        Ok(())
    }

    /// Real time since the present of the simulation.
    fn behind(&self) -> Duration {
        match self.waiting {
            true => Duration::ZERO,
            false => self.clock.since(self.now()),
        }
    }

    fn was_stalled(&mut self, by: Duration) {
        if self.waiting {
            return;
        }
        let stood = self.clock.set_back(self.now());
        self.stalled.add(by);
        self.run.stalled(by, stood);
    }

    /// Too little to stop simulated time for.
    fn was_late(&mut self, by: Duration) {
        if !self.waiting {
            self.run.late(self.clock.simulated(by), Duration::ZERO);
        }
    }

    /// Simulated time stood still while the clients went on.
    fn stood_still(&mut self, stood: Duration) {
        if !self.waiting && !stood.is_zero() {
            self.run.late(stood, stood);
        }
    }

    /// Advances the run to the present, or as far as it comes before ports and signals are due
    /// for a look.
    fn advance(&mut self) -> Result<(), Error> {
        if self.waiting {
            return Ok(());
        }
        if !self.clock.is_stopped() {
            let stood = self.clock.take_stood();
            self.stood_still(stood);
        }
        let to = self.clock.now();
        self.set_lines(to)?;
        let begun = Instant::now();
        while self.now() < to && self.run.finished().is_none() {
            let slice = to.min(self.now() + SLICE);
            while self.run.step(slice)? && begun.elapsed() <= BUDGET {}
            self.resume()?;
            if begun.elapsed() > BUDGET && self.now() < to {
                self.fell_behind(self.behind());
                return Ok(());
            }
        }
        self.clock.arrive(self.now());
        Ok(())
    }

    /// There was more to do than time to do it. A machine that is too slow does not come to be far
    /// behind, since time is set back at each turn; one that was busy elsewhere does.
    fn fell_behind(&mut self, by: Duration) {
        if self.slowness.count_overrun() {
            self.run.too_slow();
        }
        if by > MOST_LATE && !self.slowness.is_slow() {
            self.was_stalled(by);
        } else {
            let stood = self.clock.set_back(self.now());
            self.stalled.add(by);
            self.stood_still(stood);
        }
    }

    /// Advances to the time of what has just been read: now, unless the simulator was stalled so that it
    /// may have come long before. A machine that is too slow has no time to advance for each read.
    fn catch_up(&mut self) -> Result<(), Error> {
        let behind = self.behind();
        if !self.waiting && !self.slowness.is_slow() {
            if behind > MOST_LATE {
                self.was_stalled(behind);
            } else {
                if behind > LITTLE_LATE {
                    self.was_late(behind);
                }
                self.advance()?;
            }
        }
        Ok(())
    }

    /// Takes what a port has to tell, but bytes that wait for a later time only if that has come. What one
    /// poll finds has the time of the first of it: the time that a poll takes is not a pause between bytes.
    fn take_input(&mut self, token: usize, resumes: bool) -> Result<(), Error> {
        let mut buffer = [0; 4096];
        let Some(served) = self.ports.get_mut(token) else {
            return Ok(());
        };
        let id = served.id;
        // Nothing of it is read on the way to the present while what it tells is still to be done.
        let mut is_dated = std::mem::take(&mut served.paused);
        let mut room = match is_dated && !resumes {
            true => 0,
            false => self.run.rig().room(id).min(buffer.len()),
        };
        for _ in 0..MOST_READS {
            let Some(port) = &mut self.ports[token].port else {
                return Ok(());
            };
            // Without room a port still reports clients that have left.
            let event = port.read(&mut buffer[..room])?;
            match event {
                Event::Idle => {
                    self.ports[token].paused = room == 0;
                    return Ok(());
                }
                Event::Attached => self.begin(),
                Event::Data(_) => self.set_line(token)?,
                Event::Detached => {}
            }
            if !std::mem::replace(&mut is_dated, true) {
                self.catch_up()?;
            }
            let now = self.now();
            match event {
                Event::Idle => {}
                Event::Attached => {
                    self.run.attach(id, now)?;
                    self.set_line(token)?;
                }
                Event::Detached => {
                    // Another may have taken its place already, and hears what has arrived.
                    if self.ports[token].is_attached() {
                        self.deliver(token)?;
                    }
                    self.run.detach(id, now)?;
                    room = self.run.rig().room(id).min(buffer.len());
                }
                Event::Data(count) => {
                    room -= count;
                    let stood = self.clock.take_stood();
                    self.stood_still(stood);
                    self.run.send(id, now, &buffer[..count])?;
                    // Before another look at the port, for which a client need not wait.
                    self.deliver(token)?;
                }
            }
        }
        self.ports[token].paused = true;
        Ok(())
    }

    /// Hands the client of a port what has arrived for it.
    fn deliver(&mut self, token: usize) -> Result<(), Error> {
        let Some(served) = self.ports.get_mut(token) else {
            return Ok(());
        };
        let (id, Some(port)) = (served.id, &mut served.port) else {
            return Ok(());
        };
        self.outgoing.clear();
        self.run.read(id, &mut self.outgoing);
        if self.outgoing.is_empty() {
            return Ok(());
        }
        let lost = port.counters().dropped_full_bytes;
        let _ = port.write(&self.outgoing)?;
        // A client that has left cannot read.
        let lost = port.counters().dropped_full_bytes - lost;
        if lost > 0 {
            self.run.client_lost(id, lost);
        }
        Ok(())
    }

    /// Reads those ports again whose line has room again. What waited for that goes out without a pause,
    /// however late the simulator is.
    fn resume(&mut self) -> Result<(), Error> {
        for token in 0..self.ports.len() {
            if self.may_resume(token) {
                self.take_input(token, true)?;
            }
        }
        Ok(())
    }

    fn may_resume(&self, token: usize) -> bool {
        let served = &self.ports[token];
        served.paused && self.run.rig().room(served.id) >= RESUME_ROOM
    }

    /// Passes on how clients have set their ends of lines on which bytes move until `to`.
    /// The system reports no change of them.
    fn set_lines(&mut self, to: SimTime) -> Result<(), Error> {
        for token in 0..self.ports.len() {
            let served = &self.ports[token];
            if served.is_attached() && self.run.rig().is_due(served.id, to) {
                self.set_line(token)?;
            }
        }
        Ok(())
    }

    /// Passes on how the client of a port has set its end.
    fn set_line(&mut self, token: usize) -> Result<(), Error> {
        let served = &self.ports[token];
        if let Some(port) = &served.port
            && let Some(line) = port.client_line()?
        {
            self.run.set_line(served.id, line);
        }
        Ok(())
    }

    /// A client has come; simulated time begins if it has not.
    fn begin(&mut self) {
        if std::mem::take(&mut self.waiting) {
            self.clock.restart();
        }
    }

    fn now(&self) -> SimTime {
        self.run.rig().now()
    }
}
