//! The real-time loop: it supplies the rig with the time and the clients' bytes, and the clients
//! with the devices' bytes.

use std::time::{Duration, Instant};

use anyhow::Context as _;
use sim_core::SimTime;
use sim_core::line::ClientLine;
use sim_core::report::Report;
use sim_core::rig::{PortId, Rig};
use sim_pty::{Event, Port, Waiter};

use crate::log::Log;

/// Shortest sleep. A byte takes 87 µs at 115200 baud; waking for each one would cost more than it
/// is worth, since a client cannot tell.
const SHORTEST_SLEEP: Duration = Duration::from_micros(100);
/// Longest sleep while a client sends more than its line can take.
const CROWDED_SLEEP: Duration = Duration::from_millis(1);

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
    buffer: Vec<u8>,
    outgoing: Vec<u8>,
}

impl Server {
    /// Simulated time begins now, and runs `speed` times as fast as real time.
    pub(crate) fn new(rig: Rig, mut ports: Vec<Served>, speed: f64) -> anyhow::Result<Self> {
        // Without it Linux may wake us 50 µs late; with it refused, it does.
        let _ = sim_pty::sharpen_timers();
        let mut waiter = Waiter::new()?;
        waiter.catch_signals()?;
        for (token, served) in ports.iter_mut().enumerate() {
            waiter.add(token, &mut served.port)?;
        }
        let reports = vec![Report::default(); rig.devices()];
        Ok(Self {
            rig,
            ports,
            waiter,
            clock: Clock {
                start: Instant::now(),
                speed,
            },
            reports,
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

    /// Serves until a signal asks for the end.
    pub(crate) fn run(&mut self, log: &Log) -> anyhow::Result<()> {
        let mut crowded = false;
        loop {
            self.rig
                .advance(self.clock.now())
                .context("the simulation cannot go on")?;
            self.deliver()?;
            self.pass_events(log);
            let sleep = if crowded {
                std::thread::sleep(CROWDED_SLEEP);
                Some(Duration::ZERO)
            } else {
                self.rig
                    .next_deadline()
                    .map(|due| self.clock.until(due).max(SHORTEST_SLEEP))
            };
            let wake = self.waiter.wait(sleep)?;
            if wake.signal().is_some() {
                return Ok(());
            }
            let ready: Vec<usize> = wake.ready().to_vec();
            crowded = false;
            for token in ready {
                crowded |= self.receive(token)?;
            }
        }
    }

    /// Takes what a port has to tell; says whether its line is full.
    fn receive(&mut self, token: usize) -> anyhow::Result<bool> {
        let Some(Served { id, port }) = self.ports.get_mut(token) else {
            return Ok(false);
        };
        let id = *id;
        // Each round but the last takes bytes off a bounded line.
        loop {
            let room = self.rig.room(id).min(self.buffer.len());
            if room == 0 {
                return Ok(true);
            }
            match port.read(&mut self.buffer[..room])? {
                Event::Idle => return Ok(false),
                Event::Attached => self.rig.attach(id, self.clock.now())?,
                Event::Detached => self.rig.detach(id, self.clock.now())?,
                Event::Data(count) => {
                    if let Some(line) = port.client_line()? {
                        self.rig.set_client_line(
                            id,
                            ClientLine {
                                baud: line.baud,
                                stop_bits: line.stop_bits,
                                raw: line.raw,
                            },
                        );
                    }
                    let now = self.clock.now();
                    self.rig
                        .client_sends(id, now, &self.buffer[..count])
                        .context("the simulation cannot go on")?;
                }
            }
        }
    }

    /// Hands the clients what has arrived for them.
    fn deliver(&mut self) -> anyhow::Result<()> {
        for Served { id, port } in &mut self.ports {
            self.outgoing.clear();
            self.rig.client_reads(*id, &mut self.outgoing);
            if self.outgoing.is_empty() {
                continue;
            }
            let written = port.write(&self.outgoing)?;
            if written.dropped > 0 && port.is_attached() {
                self.rig.client_lost(*id, written.dropped as u64);
            }
        }
        Ok(())
    }

    fn pass_events(&mut self, log: &Log) {
        while let Some(event) = self.rig.poll_event() {
            if let Some(report) = self.reports.get_mut(event.device) {
                report.note(&event);
            }
            log.event(event);
        }
    }
}

/// Simulated time by the system's monotonic clock.
struct Clock {
    start: Instant,
    speed: f64,
}

impl Clock {
    fn now(&self) -> SimTime {
        SimTime::ZERO + self.start.elapsed().mul_f64(self.speed)
    }

    fn until(&self, due: SimTime) -> Duration {
        due.since(self.now()).div_f64(self.speed)
    }
}
