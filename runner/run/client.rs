//! Deeds of a real client.

use std::time::Duration;

use sim_core::SimTime;
use sim_core::line::{ClientLine, LineEvent};
use sim_core::rig::PortId;

use super::lateness::burst_end;
use super::{NANOSECOND, Run, RunError};
use crate::trace::{Hexed, Record};

/// Deeds of a real client. Each of these is dated a nanosecond after the present at least; after
/// the end nothing happens any more.
impl Run {
    /// A client opened the port.
    ///
    /// # Errors
    /// When the simulation cannot go on.
    pub fn attach(&mut self, port: PortId, now: SimTime) -> Result<(), RunError> {
        let Some(at) = self.go_before(now)? else {
            return Ok(());
        };
        self.record(|| Record::Attach {
            t: at.as_nanos(),
            port: port.into(),
        });
        let mut outcome = Ok(());
        self.instant(at, |rig| outcome = rig.attach(port, at))?;
        Ok(outcome?)
    }

    /// The client closed the port.
    ///
    /// # Errors
    /// When the simulation cannot go on.
    pub fn detach(&mut self, port: PortId, now: SimTime) -> Result<(), RunError> {
        let Some(at) = self.go_before(now)? else {
            return Ok(());
        };
        self.record(|| Record::Detach {
            t: at.as_nanos(),
            port: port.into(),
        });
        if let Some(index) = self.port_at(port) {
            self.unread[index].clear();
        }
        let mut outcome = Ok(());
        self.instant(at, |rig| outcome = rig.detach(port, at))?;
        Ok(outcome?)
    }

    /// The client sends.
    ///
    /// # Errors
    /// When the simulation cannot go on.
    pub fn send(&mut self, port: PortId, now: SimTime, bytes: &[u8]) -> Result<(), RunError> {
        let Some(at) = self.go_before(now)? else {
            return Ok(());
        };
        self.record(|| Record::In {
            t: at.as_nanos(),
            port: port.into(),
            bytes: Hexed(bytes.to_vec()),
        });
        self.instant(at, |rig| rig.client_puts(port, bytes))
    }

    /// The client has set its end of the line, at the present time; after the end of the run that
    /// is no part of it.
    pub fn set_line(&mut self, port: PortId, line: ClientLine) {
        if self.outcome.is_some() || self.lines.insert(port, line) == Some(line) {
            return;
        }
        let t = self.rig.now().as_nanos();
        self.record(|| Record::Line {
            t,
            port: port.into(),
            line,
        });
        self.rig.set_client_line(port, line);
    }

    /// Adds to `bytes` what has arrived at the client.
    pub fn read(&mut self, port: PortId, bytes: &mut Vec<u8>) {
        if let Some(index) = self.port_at(port) {
            self.read_port(index, self.rig.now());
            bytes.append(&mut self.unread[index]);
        }
    }

    /// The client has set the modem lines of its end, at the present time.
    pub fn set_modem_lines(&mut self, port: PortId, dtr: bool, rts: bool) {
        self.rig.tell(port, LineEvent::ModemLines { dtr, rts });
    }

    /// Has [`step`](Self::step) stop at every byte that arrives, for a client that is to have it
    /// then.
    pub fn follow_bytes(&mut self) {
        self.follows_bytes = true;
    }

    /// Notes whose time a real client has, for the trace: `lockstep` or `real`.
    pub fn name_time(&mut self, client: &'static str) {
        self.record(|| Record::Time {
            client: client.into(),
        });
    }

    /// The client did not read, and `bytes` of what it should have got were lost.
    pub fn client_lost(&mut self, port: PortId, bytes: u64) {
        self.rig.tell(port, LineEvent::Overrun { bytes });
    }

    /// The machine was late to run the simulator by so much simulated time, little as it may be:
    /// what clients send next may come up to `by` closer together than they were sent, which does
    /// not count as too soon.
    pub fn late(&mut self, by: Duration) {
        self.expect_burst(by, burst_end(self.rig.now(), by));
    }

    /// The machine held the simulator up for so long that simulated time stood still: for `real`,
    /// in which `by` of simulated time would have passed. What that may look like is not held
    /// against the clients.
    pub fn held_up(&mut self, real: Duration, by: Duration) {
        self.lateness.note(self.rig.now(), by);
        self.rig.tell_all(LineEvent::SimulatorLate { by: real });
        self.late(by);
    }

    /// The machine is too slow for what it is to compute.
    pub fn too_slow(&mut self) {
        self.rig.tell_all(LineEvent::SimulatorTooSlow);
    }

    /// Up to and including `until`, what clients send may come up to `by` closer together than they
    /// sent it; after the end of the run that is no part of it.
    pub fn expect_burst(&mut self, by: Duration, until: SimTime) {
        if self.outcome.is_some() {
            return;
        }
        let t = self.rig.now().as_nanos();
        self.record(|| Record::Late {
            t,
            by: u64::try_from(by.as_nanos()).unwrap_or(u64::MAX),
            until: until.as_nanos(),
        });
        self.rig.expect_burst(by, until);
    }

    /// Does whatever comes before what a client does at `now`, and says when that is; `None` if the
    /// run is over by then.
    pub(super) fn go_before(&mut self, now: SimTime) -> Result<Option<SimTime>, RunError> {
        let at = now.max(self.rig.now() + NANOSECOND);
        // The end belongs to the run alone.
        let last = self.limit - NANOSECOND;
        if at > last {
            self.advance(self.limit)?;
            return Ok(None);
        }
        self.advance(at - NANOSECOND)?;
        Ok(self.outcome.is_none().then_some(at))
    }
}
