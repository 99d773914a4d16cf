//! Playing several scenarios at a time.

use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::time::Duration;

use anyhow::Context as _;
use sim_pty::Waiter;

use crate::args::RunArgs;
use crate::exit::{Exit, Failure};

use super::job::{Job, JobResult};
use super::{live, report, scripted};

/// How long everything may take to end after a second signal.
const LAST_PATIENCE: Duration = Duration::from_secs(15);

/// Plays all, and hands each result to `tell` in the order of the jobs. What was not played, since
/// another failed or a signal came, has no result. An error that concerns all comes beside.
pub(crate) fn play_all(
    args: &RunArgs,
    jobs: &[Job<'_>],
    mut tell: impl FnMut(&Job<'_>, &JobResult) -> Result<(), Failure>,
) -> Result<(Vec<Option<JobResult>>, Option<Failure>), Failure> {
    let stop = broken_off_by_signals()?;
    let next = AtomicUsize::new(0);
    let enough = AtomicBool::new(false);
    let (sender, receiver) = crossbeam_channel::unbounded();
    let mut results: Vec<Option<JobResult>> = jobs.iter().map(|_| None).collect();
    let mut wrong = None;
    std::thread::scope(|scope| {
        for _ in 0..threads(args, jobs.len()) {
            let sender = sender.clone();
            let (next, enough, stop) = (&next, &enough, &stop);
            scope.spawn(move || {
                while !enough.load(Ordering::Relaxed) && !stop.load(Ordering::Relaxed) {
                    let index = next.fetch_add(1, Ordering::Relaxed);
                    let Some(job) = jobs.get(index) else { return };
                    let result = play(job, stop);
                    let is_usage = matches!(&result, Err(failure) if failure.exit == Exit::Usage);
                    let passed = result.as_ref().is_ok_and(JobResult::passed);
                    if is_usage || args.fail_fast && !passed {
                        enough.store(true, Ordering::Relaxed);
                    }
                    if sender.send((index, result)).is_err() {
                        return;
                    }
                }
            });
        }
        drop(sender);
        let mut told = 0;
        for (index, result) in receiver {
            match result {
                Ok(result) => results[index] = Some(result),
                Err(failure) => {
                    results[index] = Some(JobResult::Broken(format!("{:#}", failure.error)));
                    // The same for all that are left, as when the client does not exist.
                    if failure.exit == Exit::Usage {
                        wrong.get_or_insert(failure);
                    }
                }
            }
            while let Some(Some(result)) = results.get(told) {
                if let Err(failure) = tell(&jobs[told], result) {
                    stop.store(true, Ordering::Relaxed);
                    wrong.get_or_insert(failure);
                }
                told += 1;
            }
        }
        // After a gap that was never played.
        for (job, result) in jobs.iter().zip(&results).skip(told) {
            if let Some(result) = result
                && let Err(failure) = tell(job, result)
            {
                wrong.get_or_insert(failure);
            }
        }
    });
    Ok((results, wrong))
}

/// How many to play at a time.
fn threads(args: &RunArgs, jobs: usize) -> usize {
    let asked = args.jobs.and_then(|jobs| usize::try_from(jobs).ok());
    let cores = || std::thread::available_parallelism().map_or(1, usize::from);
    let usual = if args.client.is_empty() { cores() } else { 1 };
    asked.unwrap_or(usual).min(jobs)
}

/// Becomes true when a signal asks for the end.
fn broken_off_by_signals() -> Result<Arc<AtomicBool>, Failure> {
    let mut waiter = Waiter::new().map_err(Failure::system)?;
    waiter.catch_signals().map_err(Failure::system)?;
    let stop = Arc::new(AtomicBool::new(false));
    let seen = Arc::clone(&stop);
    std::thread::Builder::new()
        .name("signals".to_owned())
        .spawn(move || {
            // Without a way to wait, signals do nothing, and the limits of time end the run.
            while let Ok(wake) = waiter.wait(None) {
                if wake.signal().is_some() && seen.swap(true, Ordering::Relaxed) {
                    // Somebody insists; whoever reads the output may have stopped reading it.
                    std::thread::sleep(LAST_PATIENCE);
                    std::process::exit(Exit::System.code().into());
                }
            }
        })
        .context("cannot start the thread that waits for signals")
        .map_err(Failure::system)?;
    Ok(stop)
}

/// Plays one, and writes its report. A panic is a failure of the simulator; the others go on.
fn play(job: &Job<'_>, stop: &AtomicBool) -> Result<JobResult, Failure> {
    let played = catch_unwind(AssertUnwindSafe(|| {
        if job.is_live() {
            live::play(job, stop)
        } else {
            scripted::play(job, stop)
        }
    }));
    let result = match played {
        Ok(result) => result?,
        Err(panic) => JobResult::Broken(format!("the simulator panicked: {}", text(&*panic))),
    };
    if let JobResult::Played(played) = &result {
        report::write(job, played)?;
        job.show(played)?;
    }
    Ok(result)
}

fn text(panic: &(dyn Any + Send)) -> &str {
    let owned = panic.downcast_ref::<String>().map(String::as_str);
    owned
        .or_else(|| panic.downcast_ref::<&str>().copied())
        .unwrap_or("no reason given")
}
