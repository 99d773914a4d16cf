//! Playing a run to its end: what there is for every client, and the scripted one.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use rigsim_core::SimTime;
use rigsim_core::line::Wire;
use rigsim_embed::serve::Stalls;
use rigsim_runner::{Outcome, Run, RunError, RunOptions};
use rigsim_settings::show_duration;

use crate::exit::Failure;
use crate::recording::TraceFile;

use super::case::{Case, CaseResult, Played, PlayedClient};

/// Most simulated time between two looks at the clock and for signals.
const SLICE: Duration = Duration::from_millis(500);

/// How many times what is allowed a run may take in real time where processor time is counted.
const REAL_TIME_FACTOR: u32 = 10;

/// The reason of a scenario that took too long; `real` if that was real time.
pub(super) fn over_time(case: &Case<'_>, real: bool) -> String {
    let allowed = show_duration(case.allowed);
    match (case.is_lockstep(), real) {
        (true, true) => {
            let real = show_duration(case.allowed.saturating_mul(REAL_TIME_FACTOR));
            format!(
                "it was still running after {real} of real time, before it had used the {allowed} of processor \
                 time that --timeout allows"
            )
        }
        (is_lockstep, _) => {
            let kind = if is_lockstep { "processor" } else { "real" };
            format!("it was still running after the {allowed} of {kind} time that --timeout allows")
        }
    }
}

/// End of a run for which there was not enough real time: no verdict, unless a rule was broken before.
pub(super) fn out_of_real_time(run: &mut Run, why: String) -> Ended {
    if run.failures().is_empty() {
        return Ended::NoVerdict(format!("the machine is too busy for a verdict: {why}"));
    }
    run.fail(why);
    Ended::Played
}

/// Plays a scenario with its scripted client, as fast as the machine goes.
pub(super) fn scripted(case: &Case<'_>, stop: &AtomicBool) -> Result<CaseResult, Failure> {
    let (mut run, mut playing) = Playing::begin(case, stop)?;
    let ended = playing.on(&mut run, SimTime::MAX);
    let ended = ended.map_err(Failure::system)?.unwrap_or(Ended::Played);
    playing.conclude(&mut run, ended, None, None)
}

/// End of a run.
pub(super) enum Ended {
    /// There is a verdict.
    Played,
    /// There is none, for this reason: the client never began, or the machine was too busy.
    NoVerdict(String),
    /// A signal came.
    Aborted,
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
        case.check_files().map_err(Failure::system)?;
        let recording = case.recording();
        let mut run = case.loaded.run_as(
            &case.scenario(),
            RunOptions {
                seed: case.seed,
                wire: Wire::Paced,
                live: case.is_live(),
                trace: recording.is_some(),
            },
        )?;
        if case.is_live() {
            run.name_time(case.time_word(), case.date().as_secs());
        }
        let trace = recording.map(TraceFile::create).transpose();
        let playing = Self {
            case,
            stop,
            begun,
            trace: trace.map_err(Failure::system)?,
        };
        Ok((run, playing))
    }

    /// When its real time is over.
    pub(super) fn until(&self) -> Option<Instant> {
        let allowed = self.case.allowed;
        let factor = if self.case.is_lockstep() {
            REAL_TIME_FACTOR
        } else {
            1
        };
        self.begun.checked_add(allowed.saturating_mul(factor))
    }

    /// Takes what the run has to tell.
    pub(super) fn take(&mut self, run: &mut Run) {
        while run.poll_event().is_some() {}
        if let Some(trace) = &mut self.trace {
            trace.take(run);
        }
    }

    /// Plays on to `to`, or to the end, without a real client; returns how the run ended if it was before.
    pub(super) fn on(&mut self, run: &mut Run, to: SimTime) -> Result<Option<Ended>, RunError> {
        while run.finished().is_none() && run.rig().now() < to {
            if self.stop.load(Ordering::Relaxed) {
                return Ok(Some(Ended::Aborted));
            }
            if self.until().is_some_and(|until| Instant::now() > until) {
                return Ok(Some(out_of_real_time(run, over_time(self.case, true))));
            }
            // One instant at a time, since a file may have any number of them.
            run.step(to.min(run.rig().now() + SLICE))?;
            self.take(run);
        }
        Ok(None)
    }

    /// Ends it and returns its result. The trace is complete in any case, so that it can be played
    /// again.
    pub(super) fn conclude(
        mut self,
        run: &mut Run,
        ended: Ended,
        client: Option<PlayedClient>,
        stalled: Option<Stalls>,
    ) -> Result<CaseResult, Failure> {
        match &ended {
            Ended::Played => {}
            Ended::NoVerdict(why) => run.fail(why.clone()),
            Ended::Aborted => run.fail("a signal ended it".to_owned()),
        }
        let mut outcome = run.end().clone();
        self.take(run);
        let trace = self.trace.map(TraceFile::finish).transpose()?;
        let why = match ended {
            Ended::Played => None,
            Ended::NoVerdict(why) => {
                // What did not come of it needs no further reason.
                outcome = Outcome {
                    title: outcome.title,
                    seed: outcome.seed,
                    ..Outcome::default()
                };
                Some(why)
            }
            Ended::Aborted => return Ok(CaseResult::aborted()),
        };
        let played = Played {
            outcome,
            client,
            took: self.begun.elapsed(),
            trace,
            stalled,
        };
        Ok(CaseResult::of(played, why, self.case.args.max_stall.0))
    }
}
