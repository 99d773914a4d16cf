//! Playing several scenarios at a time.

use std::collections::BTreeMap;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::time::Duration;

use anyhow::{Context as _, anyhow};
use crossbeam_channel::RecvTimeoutError;
use rigsim_pty::Waiter;

use crate::args::{RunArgs, TimeArg};
use crate::exit::{Exit, Failure};
use crate::export::export_beside;
use crate::print::{complain, words_of_panic};

use super::Audience;
use super::case::{Case, CaseResult, Verdict};
use super::page::Page;
use super::{json, live, lockstep, play, twice};

/// Time in which everything has to end after a second signal.
const LAST_PATIENCE: Duration = Duration::from_secs(15);

/// Most cases that are begun before the result of an earlier one is printed: their results wait for it.
const MOST_AHEAD: usize = 1000;

/// Time to wait for a result before looking whether something is left to be done.
const GLANCE: Duration = Duration::from_millis(50);

/// Does `work` for each number below `count`, so many at a time, until it returns `None`. Hands on what
/// it returned as it comes, and `None` when nothing has come for a moment.
///
/// # Errors
/// When the system makes not even one thread.
fn each<T: Send>(
    count: usize,
    at_a_time: usize,
    work: impl Fn(usize) -> Option<T> + Sync,
    mut take: impl FnMut(Option<(usize, T)>),
) -> Result<(), Failure> {
    let next = AtomicUsize::new(0);
    let (sender, receiver) = crossbeam_channel::unbounded();
    std::thread::scope(|scope| {
        let wanted = at_a_time.min(count);
        for started in 0..wanted {
            let (sender, next, work) = (sender.clone(), &next, &work);
            let player = move || {
                let numbers = std::iter::repeat_with(|| next.fetch_add(1, Ordering::Relaxed));
                let numbers = numbers.take_while(|number| *number < count);
                let mut done = numbers.map_while(|number| Some((number, work(number)?)));
                // No receiver is left once the caller has panicked.
                let _ = done.try_for_each(|done| sender.send(done));
            };
            let thread = std::thread::Builder::new().name(format!("player {started}"));
            if let Err(error) = thread.spawn_scoped(scope, player) {
                if started == 0 {
                    let why = anyhow!(error).context("cannot start a thread to play in");
                    return Err(Failure::system(why));
                }
                // Fewer take longer and lose nothing.
                complain(&format!(
                    "{started} at a time instead of {wanted}: the system makes no more threads \
                     ({error})"
                ));
                break;
            }
        }
        drop(sender);
        loop {
            match receiver.recv_timeout(GLANCE) {
                Ok(done) => take(Some(done)),
                Err(RecvTimeoutError::Timeout) => take(None),
                Err(RecvTimeoutError::Disconnected) => return Ok(()),
            }
        }
    })
}

/// Plays all, and keeps nothing of what has been printed. What was not played, since another failed or a
/// signal came, has no result. An error that concerns all is returned, and the first of the audience's,
/// which ends nothing.
pub(crate) fn play_all(
    args: &RunArgs,
    cases: &[Case<'_>],
    audience: &mut Audience<'_>,
    stop: &AtomicBool,
) -> Result<Option<Failure>, Failure> {
    let page = audience.page;
    let (enough, is_aborted) = (AtomicBool::new(false), AtomicBool::new(false));
    let printed = AtomicUsize::new(0);
    let work = |index: usize| {
        // After a signal one is aborted at least, so that the run is not taken for complete.
        let is_over = || enough.load(Ordering::Relaxed) || is_aborted.load(Ordering::Relaxed);
        let is_stopped = || is_over() || stop.load(Ordering::Relaxed);
        while index >= printed.load(Ordering::Relaxed) + MOST_AHEAD && !is_stopped() {
            std::thread::sleep(GLANCE);
        }
        if is_over() {
            return None;
        }
        let result = play(&cases[index], page, stop);
        if matches!(&result, Ok(result) if result.verdict == Verdict::Aborted) {
            is_aborted.store(true, Ordering::Relaxed);
        }
        let is_usage = matches!(&result, Err(failure) if failure.exit == Exit::Usage);
        let fine = |result: &CaseResult| result.verdict.exit() == Exit::Clean;
        if is_usage || args.fail_fast && !result.as_ref().is_ok_and(fine) {
            enough.store(true, Ordering::Relaxed);
        }
        Some(result)
    };
    let mut wrong = None;
    let mut note = |outcome: Result<(), Failure>| {
        if let Err(failure) = outcome {
            wrong.get_or_insert(failure);
        }
    };
    // Those that wait to be printed until the ones before them have been.
    let (mut early, mut next) = (BTreeMap::new(), 0);
    let played = each(cases.len(), threads(args, cases.len()), work, |done| {
        if stop.load(Ordering::Relaxed) {
            note(audience.interrupted());
        }
        let Some((index, result)) = done else {
            return note(audience.idle());
        };
        let result = result.unwrap_or_else(|failure| {
            let why = format!("{:#}", failure.error);
            // The same for all that are left, as when the client does not exist.
            if failure.exit == Exit::Usage {
                note(Err(failure));
            }
            CaseResult::error(why)
        });
        note(audience.known(index, &result));
        early.insert(index, result);
        while let Some(result) = early.remove(&next) {
            note(audience.in_order(next, &result));
            next += 1;
            printed.store(next, Ordering::Relaxed);
        }
    });
    // After a gap that was never played.
    for (index, result) in early {
        note(audience.in_order(index, &result));
    }
    note(played);
    Ok(wrong)
}

/// Plays all and prints nothing; results are in the order of the cases.
///
/// # Errors
/// The first error in that order that concerns more than its case.
pub(crate) fn play_quietly(
    cases: &[Case<'_>],
    threads: usize,
    stop: &AtomicBool,
) -> Result<Vec<CaseResult>, Failure> {
    let mut results = BTreeMap::new();
    let work = |index: usize| Some(play(&cases[index], None, stop));
    each(cases.len(), threads, work, |done| results.extend(done))?;
    results.into_values().collect()
}

/// Number of cases to play at a time.
fn threads(args: &RunArgs, cases: usize) -> usize {
    let asked = args.jobs.and_then(|most| usize::try_from(most).ok());
    let cores = || std::thread::available_parallelism().map_or(1, usize::from);
    // In real time one client must not make another late.
    let is_real = !args.client.is_empty() && args.time == TimeArg::Real;
    // So is a port that all of them would have to have at the same time.
    let shares = args.control.is_some_and(|listen| listen.port() != 0);
    let usual = if is_real || shares { 1 } else { cores() };
    asked.unwrap_or(usual).min(cases)
}

/// Becomes true when a signal asks for the end.
pub(crate) fn stop_by_signals() -> Result<Arc<AtomicBool>, Failure> {
    let mut waiter = Waiter::new().map_err(Failure::system)?;
    waiter.catch_signals().map_err(Failure::system)?;
    let stop = Arc::new(AtomicBool::new(false));
    let seen = Arc::clone(&stop);
    std::thread::Builder::new()
        .name("signals".to_owned())
        .spawn(move || {
            // Without a way to wait, signals do nothing, and the limits of time end the run.
            while let Ok(wake) = waiter.wait(None) {
                if wake.is_signalled() && seen.swap(true, Ordering::Relaxed) {
                    // The user insists; the reader of the output may have stopped.
                    std::thread::sleep(LAST_PATIENCE);
                    std::process::exit(Exit::System as i32);
                }
            }
        })
        .context("cannot start the thread that waits for signals")
        .map_err(Failure::system)?;
    Ok(stop)
}

/// Plays one, and writes its report. Whatever goes wrong is its own failure, a panic included; the
/// others go on.
fn play(case: &Case<'_>, page: Option<&Page>, stop: &AtomicBool) -> Result<CaseResult, Failure> {
    if let Some(why) = &case.loaded.broken {
        return Ok(CaseResult::error(why.clone()));
    }
    catch_unwind(AssertUnwindSafe(|| {
        let mut result = play_once(case, stop)?;
        if result.verdict == Verdict::Error && result.has_stalled() {
            result = play_once(case, stop)?;
        }
        json::write(case, &result)?;
        export(case, &result)?;
        if let Some(page) = page {
            page.add(case, &result, stop);
        }
        Ok(result)
    }))
    .unwrap_or_else(|panic| Ok(CaseResult::error(words_of_panic(&*panic))))
}

/// Writes the trace in the formats of other tools, if that is wanted.
fn export(case: &Case<'_>, result: &CaseResult) -> Result<(), Failure> {
    let is_wanted = case.args.export_all || result.verdict.exit() != Exit::Clean;
    let Some(trace) = case
        .file("trace.jsonl")
        .filter(|trace| is_wanted && trace.exists())
    else {
        return Ok(());
    };
    let devices = case.loaded.scenario.rig.settings.table();
    export_beside(devices, &trace, &case.args.export)
}

fn play_once(case: &Case<'_>, stop: &AtomicBool) -> Result<CaseResult, Failure> {
    if case.args.twice {
        twice::play(case, stop)
    } else if case.is_lockstep() {
        lockstep::play(case, stop)
    } else if case.is_live() {
        live::play(case, stop)
    } else {
        play::scripted(case, stop)
    }
}
