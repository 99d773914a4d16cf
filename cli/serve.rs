//! The real-time loop: it supplies the rig with the time and the clients' bytes, and the clients
//! with the devices' bytes.
//!
//! # When the machine is busy
//!
//! The system may not run the simulator for a while, although something was due. If it then went
//! on to the clock's present, deadlines such as a watchdog's would pass before the bytes that a
//! client had sent in time, and the client would be blamed. No time stamp could mend that: what
//! was sent in half a second of regular commands arrives as one burst, and then half a second is
//! missing. So simulated time stands still from the last time the simulator ran; the clients'
//! bytes come next, and are dated then. A client sees what it would see of a device that was slow
//! to answer, every notice of it is a `simulator_late`, and what a client does in rhythm but
//! arrives in a burst is not counted as its fault.
//!
//! In the same way simulated time stands still when there is more to compute than there is time.

use std::time::{Duration, Instant};

use anyhow::Context as _;
use sim_core::SimTime;
use sim_core::line::ClientLine;
use sim_core::report::Report;
use sim_core::rig::{PortId, Rig};
use sim_pty::{Counters, Event, Port, Waiter};

use crate::clock::Clock;
use crate::fairness::Fairness;
use crate::log::Log;

/// Shortest sleep. A byte takes 87 µs at 115200 baud; waking for each one would cost more than it
/// is worth, since a client cannot tell.
const SHORTEST_SLEEP: Duration = Duration::from_micros(100);
/// How late the system may run the simulator before simulated time stands still. Schedulers of
/// desktops are late by a few milliseconds now and then, and protocols with deadlines of half a
/// second do not mind.
const MOST_LATE: Duration = Duration::from_millis(20);
/// How long to compute before looking at signals and ports again.
const BUDGET: Duration = Duration::from_millis(10);
/// How much simulated time to compute before looking at the clock again.
const SLICE: Duration = Duration::from_millis(1);
/// So many used-up budgets within a second mean that the machine is too slow for good.
const TOO_MANY_BUDGETS: u32 = 10;
/// Reads of one port before the others have their turn.
const MOST_READS: usize = 16;
/// A port whose line was full is read again when it has room for so many bytes.
const RESUME_ROOM: usize = 1024;

/// A port and whose it is.
pub(crate) struct Served {
    pub(crate) id: PortId,
    pub(crate) port: Port,
}

/// Devices and the ports on which they are served.
pub(crate) struct Server {
    rig: Rig,
    ports: Vec<Served>,
    waiter: Waiter,
    clock: Clock,
    reports: Vec<Report>,
    fairness: Fairness,
    slowness: Slowness,
    /// Ports whose line is full, by token.
    paused: Vec<bool>,
    buffer: Vec<u8>,
    outgoing: Vec<u8>,
}

impl Server {
    /// Simulated time begins now, and runs `speed` times as fast as real time.
    pub(crate) fn new(
        rig: Rig,
        mut ports: Vec<Served>,
        mut waiter: Waiter,
        speed: f64,
    ) -> anyhow::Result<Self> {
        // Without it Linux may wake us 50 µs late; with it refused, it does.
        let _ = sim_pty::sharpen_timers();
        for (token, served) in ports.iter_mut().enumerate() {
            waiter.add(token, &mut served.port)?;
        }
        let reports = vec![Report::default(); rig.devices()];
        Ok(Self {
            rig,
            paused: vec![false; ports.len()],
            ports,
            waiter,
            clock: Clock::start(speed),
            reports,
            fairness: Fairness::default(),
            slowness: Slowness::default(),
            buffer: vec![0; 4096],
            outgoing: Vec::new(),
        })
    }

    pub(crate) fn rig(&self) -> &Rig {
        &self.rig
    }

    pub(crate) fn report(&self, device: usize) -> &Report {
        &self.reports[device]
    }

    /// How many events were not held against a client.
    pub(crate) fn excused(&self) -> u64 {
        self.fairness.excused()
    }

    /// Closes the ports, and gives their totals by the device they belonged to.
    pub(crate) fn close_ports(&mut self) -> Vec<(PortId, Counters)> {
        let ports = self.ports.drain(..);
        ports.map(|s| (s.id, s.port.counters())).collect()
    }

    /// Waits so long for a further signal, once the ports are closed.
    pub(crate) fn is_interrupted(&mut self, within: Duration) -> bool {
        let wake = self.waiter.wait(Some(within));
        // Without a way to wait there is none to be interrupted either; the end comes anyway.
        wake.is_ok_and(|wake| wake.signal().is_some())
    }

    /// Serves until a signal asks for the end.
    pub(crate) fn run(&mut self, log: &Log) -> anyhow::Result<()> {
        let mut sleep_asked = Some(Duration::ZERO);
        let mut awake_at = Instant::now();
        loop {
            let asleep_at = Instant::now();
            let wake = self.waiter.wait(sleep_asked)?;
            if wake.signal().is_some() {
                return Ok(());
            }
            let ready: Vec<usize> = wake.ready().to_vec();
            let sleep = sleep_asked.unwrap_or(Duration::MAX);
            let late = awake_at.elapsed().saturating_sub(sleep);
            if asleep_at.elapsed().saturating_sub(sleep) > MOST_LATE {
                self.was_held_up(late);
            } else if late > MOST_LATE {
                // Not in its sleep but at its work, which may have been too much.
                self.fell_behind(late);
            }
            self.advance()?;
            // From here to the end of the next sleep nothing takes long, unless the system makes
            // it so.
            awake_at = Instant::now();
            for token in ready {
                self.receive(token)?;
            }
            self.deliver()?;
            self.resume()?;
            self.pass_events(log);
            let due = self.rig.next_deadline();
            sleep_asked = due.map(|due| self.clock.until(due).max(SHORTEST_SLEEP));
        }
    }

    fn was_held_up(&mut self, by: Duration) {
        let now = self.rig.now();
        self.clock.set_back(now);
        self.fairness.late(now, self.clock.simulated(by));
        self.rig.simulator_late(by);
    }

    /// Advances the rig to the present, or as far as it comes before ports and signals are due
    /// for a look.
    fn advance(&mut self) -> anyhow::Result<()> {
        let to = self.clock.now();
        let begun = Instant::now();
        while self.rig.now() < to {
            let slice = to.min(self.rig.now() + SLICE);
            self.rig
                .advance(slice)
                .context("the simulation cannot go on")?;
            if begun.elapsed() > BUDGET && self.rig.now() < to {
                self.fell_behind(self.clock.since(self.rig.now()));
                return Ok(());
            }
        }
        Ok(())
    }

    /// There was more to do than time to do it. A machine that is too slow does not come to be far
    /// behind, since time is set back at each turn; one that was busy elsewhere does.
    fn fell_behind(&mut self, by: Duration) {
        if self.slowness.note() {
            self.rig.simulator_too_slow();
        }
        if by > MOST_LATE && !self.slowness.told {
            self.was_held_up(by);
        } else {
            self.clock.set_back(self.rig.now());
        }
    }

    /// The time of what has just been read: now, unless the simulator was held up so that it may
    /// have come long before; the next round finds that out too. A machine that is too slow has
    /// no time to advance for each read.
    fn present(&self) -> SimTime {
        if self.slowness.told || self.clock.since(self.rig.now()) > MOST_LATE {
            return self.rig.now();
        }
        self.clock.now()
    }

    /// Takes what a port has to tell.
    fn receive(&mut self, token: usize) -> anyhow::Result<()> {
        for _ in 0..MOST_READS {
            let Some(Served { id, port }) = self.ports.get_mut(token) else {
                return Ok(());
            };
            let id = *id;
            // Without room a port still tells of clients that have left.
            let room = self.rig.room(id).min(self.buffer.len());
            let event = port.read(&mut self.buffer[..room])?;
            match event {
                Event::Idle => {
                    if room == 0 {
                        port.set_paused(true)?;
                        self.paused[token] = true;
                    }
                    return Ok(());
                }
                Event::Attached => self.rig.attach(id, self.present())?,
                Event::Detached => self.rig.detach(id, self.present())?,
                Event::Data(count) => {
                    set_line(&mut self.rig, id, port)?;
                    let now = self.present();
                    self.rig
                        .client_sends(id, now, &self.buffer[..count])
                        .context("the simulation cannot go on")?;
                }
            }
        }
        Ok(())
    }

    /// Hands the clients what has arrived for them.
    fn deliver(&mut self) -> anyhow::Result<()> {
        for Served { id, port } in &mut self.ports {
            self.outgoing.clear();
            self.rig.client_reads(*id, &mut self.outgoing);
            if self.outgoing.is_empty() {
                continue;
            }
            // A client that only listens would else never be found to listen at a wrong speed.
            set_line(&mut self.rig, *id, port)?;
            let written = port.write(&self.outgoing)?;
            if written.dropped > 0 && port.is_attached() {
                self.rig.client_lost(*id, written.dropped as u64);
            }
        }
        Ok(())
    }

    /// Reads those ports again whose line has room again.
    fn resume(&mut self) -> anyhow::Result<()> {
        for (served, paused) in self.ports.iter_mut().zip(&mut self.paused) {
            if *paused && self.rig.room(served.id) >= RESUME_ROOM {
                served.port.set_paused(false)?;
                *paused = false;
            }
        }
        Ok(())
    }

    fn pass_events(&mut self, log: &Log) {
        while let Some(event) = self.rig.poll_event() {
            if !self.fairness.excuses(&event)
                && let Some(report) = self.reports.get_mut(event.device)
            {
                report.note(&event);
            }
            log.event(event);
        }
    }
}

/// Tells the rig how the client has set its end.
fn set_line(rig: &mut Rig, id: PortId, port: &Port) -> anyhow::Result<()> {
    if let Some(line) = port.client_line()? {
        rig.set_client_line(
            id,
            ClientLine {
                baud: line.baud,
                stop_bits: line.stop_bits,
                raw: line.raw,
            },
        );
    }
    Ok(())
}

/// Notices when a machine is too slow for what is asked of it.
#[derive(Default)]
struct Slowness {
    /// Since when budgets are counted, and how many were used up.
    count: Option<(Instant, u32)>,
    told: bool,
}

impl Slowness {
    /// A budget was used up; says whether this is to be told.
    fn note(&mut self) -> bool {
        let now = Instant::now();
        let (since, count) = self.count.unwrap_or((now, 0));
        let is_old = now - since > Duration::from_secs(1);
        let (since, count) = if is_old { (now, 1) } else { (since, count + 1) };
        self.count = Some((since, count));
        count >= TOO_MANY_BUDGETS && !std::mem::replace(&mut self.told, true)
    }
}
