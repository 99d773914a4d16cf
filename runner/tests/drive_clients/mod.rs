//! Clients for the drives, a naive and a careful one for each kind of device.

pub(crate) mod car;
pub(crate) mod r150;

use std::sync::mpsc::{Receiver, Sender, channel};
use std::time::Duration;

use rigsim_core::SimTime;

use crate::{Answer, Ask};

const fn millis(millis: u64) -> Duration {
    Duration::from_millis(millis)
}

/// A client's end of its port. Whatever needs a port gives `None` when it has hung up,
/// and everything when the run is over.
pub(crate) struct Client {
    asks: Sender<Ask>,
    answers: Receiver<Answer>,
}

impl Client {
    pub(crate) fn new() -> (Self, Receiver<Ask>, Sender<Answer>) {
        let (asks, asked) = channel();
        let (answered, answers) = channel();
        (Self { asks, answers }, asked, answered)
    }

    fn ask(&self, ask: Ask) -> Answer {
        self.asks.send(ask).ok()?;
        self.answers.recv().ok()?
    }

    fn write(&self, link: usize, bytes: Vec<u8>) -> Option<()> {
        self.ask(Ask::Write(link, bytes)).map(drop)
    }

    fn sleep(&self, time: Duration) -> Option<SimTime> {
        self.ask(Ask::Sleep(time)).map(|(now, _)| now)
    }

    /// Waits without end, as a read without a timeout does.
    fn read(&self, link: usize, count: usize) -> Option<Vec<u8>> {
        self.ask(Ask::Read(link, count, None))
            .map(|(_, bytes)| bytes)
    }
}

/// Opens the port and does nothing more.
pub(crate) fn idle(client: &Client) -> Option<()> {
    client.ask(Ask::Open(0))?;
    client.read(0, usize::MAX).map(drop)
}
