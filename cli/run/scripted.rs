//! A scenario with its scripted client, in simulated time.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use sim_core::SimTime;

use crate::exit::Failure;

use super::case::{Case, CaseResult, Played};

/// Plays it as fast as the machine goes.
pub(crate) fn play(case: &Case<'_>, stop: &AtomicBool) -> Result<CaseResult, Failure> {
    let begun = Instant::now();
    let (mut run, mut trace) = case.begin()?;
    let mut broken_off = false;
    while run.finished().is_none() {
        broken_off = stop.load(Ordering::Relaxed);
        if broken_off {
            run.fail("a signal ended it".to_owned());
            break;
        }
        if begun.elapsed() > case.allowed {
            run.fail(super::live::over_time(case.allowed));
            break;
        }
        // One instant at a time, since a file may have any number of them.
        run.step(SimTime::MAX).map_err(Failure::system)?;
        super::live::take(&mut run, &mut trace);
    }
    let outcome = run.end().clone();
    super::live::take(&mut run, &mut trace);
    trace.map_or(Ok(()), super::trace_file::TraceFile::finish)?;
    if broken_off {
        return Ok(CaseResult::BrokenOff);
    }
    Ok(CaseResult::Played(Box::new(Played {
        outcome,
        client: None,
        took: begun.elapsed(),
        held_up: None,
        is_spoilt: false,
    })))
}
