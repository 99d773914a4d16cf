//! The page of a tap: a model gets what the client sends, and the vehicle's replies stand for its own.

use std::net::SocketAddr;
use std::path::PathBuf;
use std::thread::JoinHandle;
use std::time::Duration;

use crossbeam_channel::{Receiver, RecvTimeoutError, Sender as Channel, bounded};
use rigsim_core::SimTime;
use rigsim_core::device::host::{FrameReader, Sender};
use rigsim_core::event::{EventKind, code};
use rigsim_embed::clock::Clock;
use rigsim_embed::ports::ShownPort;
use rigsim_runner::run::RunOptions;
use rigsim_runner::trace::Record;
use rigsim_runner::{RigPlan, Run, RunError};

use crate::control::RequestQueue;
use crate::exit::Failure;
use crate::log::Log;
use crate::print::complain;
use crate::scenario_files::Loaded;
use crate::start::announce_control;

/// Most pieces of the recording in the queue; further ones are not shown.
const MOST_WAITING: usize = 1 << 12;
/// Pieces that are shown between two rounds of requests.
const MOST_AT_ONCE: usize = 64;
/// Interval at which the model advances and requests are answered.
const LOOK: Duration = Duration::from_millis(10);

/// Something to show.
pub(super) enum Piece {
    /// A line of the recording.
    Record(Record),
    /// Something happened at this time, in ns.
    Event(u64, EventKind),
}

/// A thread that shows the traffic. Bytes never wait for it.
pub(super) struct Live {
    pieces: Option<Channel<Piece>>,
    missed: u64,
    thread: Option<JoinHandle<()>>,
}

impl Live {
    /// Starts it.
    pub(super) fn start(
        listen: SocketAddr,
        plan: RigPlan,
        paths: Vec<PathBuf>,
        log: &Log,
    ) -> Result<Self, Failure> {
        let links = plan.links().zip(paths);
        let ports = links.map(|(link, path)| ShownPort {
            link,
            path,
            is_public: false,
        });
        let ports: Vec<ShownPort> = ports.collect();
        let planned = &plan.devices[0];
        let readers = planned.own_settings().map(|settings| {
            let reader = |link| (planned.device.host.frames)(link, Sender::Device, settings);
            (0..ports.len()).map(reader).collect()
        });
        let readers = readers.unwrap_or_default();
        let loaded = Loaded::serving(plan, PathBuf::new(), None)?;
        let mut run = loaded.run(RunOptions {
            live: true,
            ..RunOptions::scripted(0)
        })?;
        run.stand_in();
        let requests = RequestQueue::open(listen, loaded.beginning(), &run, ports)?;
        announce_control(log, &requests);
        let (pieces, shown) = bounded(MOST_WAITING);
        let mut page = Page {
            run,
            clock: Clock::start(1.0),
            requests,
            readers,
        };
        let show = move || {
            if let Err(error) = page.show(&shown) {
                complain(&format!("the page has ended: {error}"));
            }
        };
        let thread = std::thread::Builder::new().name("page".to_owned());
        Ok(Self {
            pieces: Some(pieces),
            missed: 0,
            thread: Some(thread.spawn(show).map_err(Failure::system)?),
        })
    }

    /// Shows this, unless the queue is full.
    pub(super) fn show(&mut self, piece: Piece) {
        let pieces = self.pieces.as_ref();
        self.missed += u64::from(pieces.is_some_and(|pieces| pieces.try_send(piece).is_err()));
    }
}

impl Drop for Live {
    fn drop(&mut self) {
        self.pieces = None;
        // A panic has been reported already.
        let _ = self.thread.take().map(JoinHandle::join);
        if self.missed > 0 {
            let missed = self.missed;
            complain(&format!(
                "the page was too slow and did not show {missed} pieces; the trace has all"
            ));
        }
    }
}

struct Page {
    run: Run,
    clock: Clock,
    requests: RequestQueue,
    /// Of the vehicle's replies, by link.
    readers: Vec<Box<dyn FrameReader>>,
}

impl Page {
    /// Shows all that comes.
    fn show(&mut self, pieces: &Receiver<Piece>) -> Result<(), RunError> {
        loop {
            match pieces.recv_timeout(LOOK) {
                Ok(piece) => self.take(piece)?,
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => return Ok(()),
            }
            for piece in pieces.try_iter().take(MOST_AT_ONCE) {
                self.take(piece)?;
            }
            self.run.advance(self.clock.now())?;
            for port in self.run.ports().to_vec() {
                self.run.read(port, &mut Vec::new());
            }
            while let Some(event) = self.run.poll_event() {
                self.requests.event(&event);
            }
            self.requests
                .answer_some(&mut self.run, &mut self.clock, true)?;
            self.requests.send_due(&self.run);
        }
    }

    fn take(&mut self, piece: Piece) -> Result<(), RunError> {
        match piece {
            Piece::Event(t, kind) => self.run.observe(0, SimTime::from_nanos(t), kind),
            Piece::Record(Record::Attach { t, port }) => {
                self.run.attach(port.into(), SimTime::from_nanos(t))
            }
            Piece::Record(Record::Detach { t, port }) => {
                self.run.detach(port.into(), SimTime::from_nanos(t))
            }
            Piece::Record(Record::Line { port, line, .. }) => {
                self.run.set_line(port.into(), line);
                Ok(())
            }
            Piece::Record(Record::In { t, port, bytes }) => {
                self.run.send(port.into(), SimTime::from_nanos(t), &bytes.0)
            }
            Piece::Record(Record::Out { t, port, bytes, .. }) => {
                let at = SimTime::from_nanos(t);
                let link = port.1;
                for byte in bytes.0 {
                    let found = self
                        .readers
                        .get_mut(link)
                        .map(|reader| reader.push(at, byte));
                    for frame in found.into_iter().flatten() {
                        self.run.observe(0, at, frame.event(code::REPLY, link))?;
                    }
                }
                Ok(())
            }
            Piece::Record(_) => Ok(()),
        }
    }
}
