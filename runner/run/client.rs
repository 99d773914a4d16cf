//! What a real client does.

use std::time::Duration;

use sim_core::SimTime;
use sim_core::line::ClientLine;
use sim_core::rig::PortId;

use super::{NANOSECOND, Run, RunError};

/// What a real client does. Each of these is dated a nanosecond after the present at least; after
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
        if let Some(recorder) = &mut self.recorder {
            recorder.attached(at, port);
        }
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
        if let Some(recorder) = &mut self.recorder {
            recorder.detached(at, port);
        }
        self.unread.remove(&port);
        let mut outcome = Ok(());
        self.instant(at, |rig| outcome = rig.detach(port, at))?;
        Ok(outcome?)
    }

    /// The client sends.
    ///
    /// # Errors
    /// When the simulation cannot go on.
    pub fn client_sends(
        &mut self,
        port: PortId,
        now: SimTime,
        bytes: &[u8],
    ) -> Result<(), RunError> {
        let Some(at) = self.go_before(now)? else {
            return Ok(());
        };
        if let Some(recorder) = &mut self.recorder {
            recorder.client_sent(at, port, bytes);
        }
        self.instant(at, |rig| rig.client_puts(port, bytes))
    }

    /// The client has set its end of the line, at the present time; after the end of the run that is
    /// no part of it.
    pub fn set_client_line(&mut self, port: PortId, line: ClientLine) {
        if self.outcome.is_some() || self.lines.insert(port, line) == Some(line) {
            return;
        }
        if let Some(recorder) = &mut self.recorder {
            recorder.line_set(self.rig.now(), port, line);
        }
        self.rig.set_client_line(port, line);
    }

    /// Adds to `bytes` what has arrived at the client.
    pub fn client_reads(&mut self, port: PortId, bytes: &mut Vec<u8>) {
        if let Some(unread) = self.unread.get_mut(&port) {
            bytes.append(unread);
        }
    }

    /// How many bytes the client may send now without filling the line.
    #[must_use]
    pub fn room(&self, port: PortId) -> usize {
        self.rig.room(port)
    }

    /// The client did not read, and `bytes` of what it should have got were lost.
    pub fn client_lost(&mut self, port: PortId, bytes: u64) {
        self.rig.client_lost(port, bytes);
    }

    /// As [`sim_core::rig::Rig::simulator_late`].
    pub fn simulator_late(&mut self, by: Duration) {
        self.rig.simulator_late(by);
    }

    /// As [`sim_core::rig::Rig::expect_burst`], at the present time; after the end of the run that is
    /// no part of it.
    pub fn expect_burst(&mut self, by: Duration, until: SimTime) {
        if self.outcome.is_some() {
            return;
        }
        if let Some(recorder) = &mut self.recorder {
            recorder.late(self.rig.now(), by, until);
        }
        self.rig.expect_burst(by, until);
    }

    /// As [`sim_core::rig::Rig::simulator_too_slow`].
    pub fn simulator_too_slow(&mut self) {
        self.rig.simulator_too_slow();
    }

    /// Does whatever comes before what a client does at `now`, and says when that is; `None` if the
    /// run is over by then.
    fn go_before(&mut self, now: SimTime) -> Result<Option<SimTime>, RunError> {
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
