//! Attendant of a run in real time: prints and records it, and has what is asked answered.

use std::time::Duration;

use rigsim_embed::clock::Clock;
use rigsim_embed::serve::Attendant;
use rigsim_runner::{Run, RunError};
use rigsim_settings::SimTime;

use crate::control::RequestQueue;
use crate::log::Log;
use crate::published::Published;
use crate::recording::TraceFile;

/// Passes on what happens to log, listeners and trace.
pub(crate) struct Looking<'a> {
    pub(crate) log: Option<&'a Log>,
    pub(crate) requests: Option<&'a mut RequestQueue>,
    /// Where the client publishes numbers.
    pub(crate) published: Option<&'a mut Published>,
    pub(crate) trace: &'a mut Option<TraceFile>,
}

impl Attendant for Looking<'_> {
    fn attend(
        &mut self,
        run: &mut Run,
        clock: &mut Clock,
        woken: bool,
    ) -> Result<Option<Duration>, RunError> {
        if let Some(published) = &mut self.published
            && run.rig().now() > SimTime::ZERO
        {
            published.take(run, run.rig().now())?;
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
        match &mut self.requests {
            Some(_) if !answered => Ok(Some(Duration::ZERO)),
            Some(requests) => Ok(requests.tell_what_is_due(run)),
            None => Ok(None),
        }
    }

    fn wants_time(&self) -> bool {
        self.requests
            .as_ref()
            .is_some_and(|requests| requests.wants_time())
    }
}
