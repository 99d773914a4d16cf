//! Playing a run to its end: what there is for every client, and the scripted one.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use sim_core::SimTime;
use sim_core::line::Wire;
use sim_embed::serve::HeldUp;
use sim_runner::{Run, RunError, RunOptions};
use sim_settings::show_duration;

use crate::exit::Failure;
use crate::recording::TraceFile;

use super::case::{Case, CaseResult, Played, PlayedClient};

/// Most simulated time between two looks at the clock and for signals.
const SLICE: Duration = Duration::from_millis(500);

/// The reason of a scenario that a signal ended.
pub(super) const BROKEN_OFF: &str = "a signal ended it";

/// The reason of a scenario that took too long.
pub(super) fn over_time(allowed: Duration) -> String {
    format!(
        "it was still going on after the {} of real time that are allowed (--timeout, or \
         `wall_limit` in the file)",
        show_duration(allowed)
    )
}

/// Plays a scenario with its scripted client, as fast as the machine goes.
pub(super) fn scripted(case: &Case<'_>, stop: &AtomicBool) -> Result<CaseResult, Failure> {
    let (mut run, mut playing) = Playing::begin(case, stop)?;
    let goes_on = playing.on(&mut run, SimTime::MAX);
    let broken_off = !goes_on.map_err(Failure::system)?;
    playing.conclude(&mut run, broken_off, None, None)
}

/// A case whose run is on its way.
pub(super) struct Playing<'a> {
    case: &'a Case<'a>,
    stop: &'a AtomicBool,
    begun: Instant,
    pub(super) trace: Option<TraceFile>,
}

impl<'a> Playing<'a> {
    /// A run of a case, which ends soon after `stop` has become true.
    pub(super) fn begin(case: &'a Case<'a>, stop: &'a AtomicBool) -> Result<(Run, Self), Failure> {
        let begun = Instant::now();
        let recording = case.recording();
        let mut run = case.loaded.run(RunOptions {
            seed: case.seed,
            wire: Wire::Paced,
            live: case.is_live(),
            trace: recording.is_some(),
        })?;
        if case.is_live() {
            run.name_time(case.time_word());
        }
        let playing = Self {
            case,
            stop,
            begun,
            trace: recording.map(TraceFile::create).transpose()?,
        };
        Ok((run, playing))
    }

    /// When its real time is over.
    pub(super) fn until(&self) -> Option<Instant> {
        self.begun.checked_add(self.case.allowed)
    }

    /// Takes what the run has to tell.
    pub(super) fn take(&mut self, run: &mut Run) {
        while run.poll_event().is_some() {}
        if let Some(trace) = &mut self.trace {
            trace.take(run);
        }
    }

    /// Plays on to `to`, or to the end, without a real client; `false` if a signal came first.
    pub(super) fn on(&mut self, run: &mut Run, to: SimTime) -> Result<bool, RunError> {
        while run.finished().is_none() && run.rig().now() < to {
            if self.stop.load(Ordering::Relaxed) {
                run.fail(BROKEN_OFF.to_owned());
                return Ok(false);
            }
            if self.begun.elapsed() > self.case.allowed {
                run.fail(over_time(self.case.allowed));
                run.end();
                break;
            }
            // One instant at a time, since a file may have any number of them.
            run.step(to.min(run.rig().now() + SLICE))?;
            self.take(run);
        }
        Ok(true)
    }

    /// Ends it and gives its result. The trace has its end in any case, so that it can be played again.
    pub(super) fn conclude(
        mut self,
        run: &mut Run,
        broken_off: bool,
        client: Option<PlayedClient>,
        held_up: Option<HeldUp>,
    ) -> Result<CaseResult, Failure> {
        let outcome = run.end().clone();
        self.take(run);
        self.trace.map_or(Ok(()), TraceFile::finish)?;
        if broken_off {
            return Ok(CaseResult::BrokenOff);
        }
        let most = self.case.args.max_hold_up.0;
        let was_busy = held_up.is_some_and(|held_up| held_up.total > most);
        Ok(CaseResult::Played(Box::new(Played {
            is_spoilt: !outcome.passed && was_busy,
            outcome,
            client,
            took: self.begun.elapsed(),
            held_up,
        })))
    }
}
