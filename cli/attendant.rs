//! Attendant of a run in real time: prints and records it, and has what is asked answered.

use std::time::Duration;

use rigsim_embed::clock::Clock;
use rigsim_embed::serve::Wants;
use rigsim_runner::{Run, RunError};
use rigsim_settings::SimTime;

use crate::client::Written;
use crate::control::RequestQueue;
use crate::log::Log;
use crate::published::Published;
use crate::recording::TraceFile;

/// Time after which the size of a client's output is looked at again.
const GLANCE: Duration = Duration::from_millis(100);

/// Passes on what happens to log, listeners and trace.
pub(crate) struct LogAttendant<'a> {
    pub(crate) log: Option<&'a Log>,
    pub(crate) requests: Option<&'a mut RequestQueue>,
    /// Where a client that was started here publishes numbers, and what it writes.
    pub(crate) client: Option<(&'a mut Published, &'a mut Written)>,
    pub(crate) trace: &'a mut Option<TraceFile>,
}

impl LogAttendant<'_> {
    pub(crate) fn attend(
        &mut self,
        run: &mut Run,
        clock: &mut Clock,
        woken: bool,
    ) -> Result<Wants, RunError> {
        if let Some((published, written)) = &mut self.client {
            written.cut();
            if run.rig().now() > SimTime::ZERO {
                published.take(run, run.rig().now())?;
            }
        }
        let mut answered = true;
        if let Some(requests) = &mut self.requests {
            answered = requests.answer_some(run, clock, woken)?;
        }
        while let Some(event) = run.poll_event() {
            if let Some(requests) = &mut self.requests {
                requests.event(&event);
            }
            if let Some(log) = self.log {
                log.event(event);
            }
        }
        if let Some(trace) = self.trace {
            trace.take(run);
        } else {
            while run.poll_trace().is_some() {}
        }
        let again = match &mut self.requests {
            Some(_) if !answered => Some(Duration::ZERO),
            Some(requests) => requests.send_due(run),
            None => None,
        };
        // A client also writes while nothing else happens.
        let look = self.client.as_ref().map(|_| GLANCE);
        let requests = self.requests.as_ref();
        Ok(Wants {
            again: [again, look].into_iter().flatten().min(),
            time: requests.is_some_and(|requests| requests.wants_time()),
        })
    }
}
