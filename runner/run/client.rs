//! Actions of a real client.

use std::time::Duration;

use rigsim_core::SimTime;
use rigsim_core::event::{Event, EventKind};
use rigsim_core::line::{ClientLine, event};
use rigsim_core::rig::PortId;

use super::agenda::Item;
use super::published::{MOST_LINE, MOST_LINES, PublishError, TOO_MANY_LINES, read};
use super::record::{Hexed, Record};
use super::{NANOSECOND, Run, RunError};

/// Actions of a real client. Each of these is dated a nanosecond after the present at least; after
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
        if let Some(index) = self.ports.at(port) {
            self.ports.unread[index].clear();
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

    /// The client publishes numbers: `x=1.2 y=0.4`, or an object as JSON. Conditions know them as
    /// `client.x` and `client.y` from then on. A line that is not used changes nothing and is the
    /// event `bad_publication`; of lines that are too many, only the first of each second.
    ///
    /// # Errors
    /// When the simulation cannot go on. Within that, says why the line is not used.
    pub fn publish(
        &mut self,
        now: SimTime,
        line: &str,
    ) -> Result<Result<(), PublishError>, RunError> {
        let earliest = self.situation.rig.now() + NANOSECOND;
        let lines = self.published.count(now.max(earliest));
        if lines > MOST_LINES + 1 {
            return Ok(Err(TOO_MANY_LINES));
        }
        let Some(at) = self.go_before(now)? else {
            return Ok(Ok(()));
        };
        let known = &self.situation.published;
        let values = match lines {
            ..=MOST_LINES => self.in_scope(|scope| read(line, known, scope)),
            _ => Err(TOO_MANY_LINES),
        };
        self.record(|| Record::Publish {
            t: at.as_nanos(),
            line: line.chars().take(MOST_LINE + 1).collect(),
        });
        let port = self.ports.ids.first().copied();
        let used = values.map(|values| self.situation.published.extend(values));
        self.agenda.plan(at, Item::Judge);
        self.instant(at, |rig| {
            if let (Err(PublishError(why)), Some(port)) = (used, port) {
                rig.emit_line_event(port, event::bad_publication(why));
            }
        })?;
        Ok(used)
    }

    /// The client has set its end of the line, at the present time; after the end of the run that
    /// is not part of it.
    pub fn set_line(&mut self, port: PortId, line: ClientLine) {
        if self.outcome.is_some() || self.ports.lines.insert(port, line) == Some(line) {
            return;
        }
        let t = self.situation.rig.now().as_nanos();
        self.record(|| Record::Line {
            t,
            port: port.into(),
            line,
        });
        self.situation.rig.set_client_line(port, line);
    }

    /// Adds to `bytes` what has arrived at the client.
    pub fn read(&mut self, port: PortId, bytes: &mut Vec<u8>) {
        if let Some(index) = self.ports.at(port) {
            self.read_port(index, self.situation.rig.now());
            bytes.append(&mut self.ports.unread[index]);
        }
    }

    /// The client has set the modem lines of its end, at the present time.
    pub fn set_modem_lines(&mut self, port: PortId, dtr: bool, rts: bool) {
        self.situation
            .rig
            .emit_line_event(port, event::modem_lines(dtr, rts));
    }

    /// The devices stand for real ones: only replies that are [observed](Self::observe) count.
    pub fn stand_in(&mut self) {
        self.observed = true;
    }

    /// Something happened at the real device for which this one stands.
    ///
    /// # Errors
    /// When the simulation cannot go on.
    pub fn observe(
        &mut self,
        device: usize,
        now: SimTime,
        kind: EventKind,
    ) -> Result<(), RunError> {
        if let Some(at) = self.go_before(now)? {
            self.instant(at, |_| {})?;
            self.record_event(Event { at, device, kind });
        }
        Ok(())
    }

    /// Makes [`step`](Self::step) stop at every byte that arrives, so that a client gets it then.
    pub fn stop_at_bytes(&mut self) {
        self.follows_bytes = true;
    }

    /// Notes whose time a real client has, for the trace: `lockstep` or `real`; and the date at which that
    /// begins, in seconds since 1970.
    pub fn name_time(&mut self, client: &'static str, date: u64) {
        self.record(|| Record::Time {
            client: client.into(),
            date: Some(date),
        });
    }

    /// The client did not read, and `bytes` of what it should have got were lost.
    pub fn client_lost(&mut self, port: PortId, bytes: u64) {
        self.situation
            .rig
            .emit_line_event(port, event::overrun(bytes));
    }

    /// The machine stalled the simulator for so long that simulated time stood still: for `real`,
    /// in which `stood` of simulated time would have passed.
    pub fn stalled(&mut self, real: Duration, stood: Duration) {
        self.situation
            .rig
            .emit_at_all(&event::simulator_stalled(real));
        self.late(stood, stood);
    }

    /// The machine is too slow for what it is to compute.
    pub fn too_slow(&mut self) {
        self.situation.rig.emit_at_all(&event::simulator_too_slow());
    }

    /// The simulator was late, or paused: what the clients have sent that was not read yet may be
    /// up to `by` of simulated time old, and simulated time stood still for `stood`. What that may
    /// look like is not attributed to the clients. After the end of the run it has no effect.
    pub fn late(&mut self, by: Duration, stood: Duration) {
        if self.outcome.is_some() {
            return;
        }
        if !stood.is_zero() {
            self.excuses.extend(self.situation.rig.now(), stood);
        }
        let nanos = |span: Duration| u64::try_from(span.as_nanos()).unwrap_or(u64::MAX);
        let t = self.situation.rig.now().as_nanos();
        self.record(|| Record::Late {
            t,
            by: nanos(by),
            stood: nanos(stood),
        });
        self.situation.rig.late(by, stood);
    }

    /// Does whatever comes before what a client does at `now`, and says when that is; `None` if the
    /// run is over by then.
    pub(super) fn go_before(&mut self, now: SimTime) -> Result<Option<SimTime>, RunError> {
        let at = now.max(self.situation.rig.now() + NANOSECOND);
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
