//! Attendant of a run in real time: prints and records it, and has what is asked answered.

use std::time::Duration;

use sim_embed::clock::Clock;
use sim_embed::serve::Attendant;
use sim_runner::{Run, RunError};

use crate::control::Desk;
use crate::log::Log;
use crate::recording::TraceFile;

/// Tells what happens to all who want to know.
pub(crate) struct Looking<'a> {
    pub(crate) log: Option<&'a Log>,
    pub(crate) desk: Option<&'a mut Desk>,
    pub(crate) trace: &'a mut Option<TraceFile>,
}

impl Attendant for Looking<'_> {
    fn attend(
        &mut self,
        run: &mut Run,
        clock: &mut Clock,
        woken: bool,
    ) -> Result<Option<Duration>, RunError> {
        let mut answered = true;
        if let Some(desk) = &mut self.desk {
            answered = desk.answer_some(run, clock, woken)?;
        }
        while let Some(event) = run.poll_event() {
            if let Some(desk) = &mut self.desk {
                desk.event(&event);
            }
            if let Some(log) = self.log {
                log.event(event);
            }
        }
        if let Some(trace) = self.trace {
            trace.take(run);
        }
        match &mut self.desk {
            Some(_) if !answered => Ok(Some(Duration::ZERO)),
            Some(desk) => Ok(desk.tell_what_is_due(run)),
            None => Ok(None),
        }
    }

    fn wants_time(&self) -> bool {
        self.desk.as_ref().is_some_and(|desk| desk.wants_time())
    }
}
