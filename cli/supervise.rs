//! The hidden subcommand in which a client of `sim run` runs: it ends with everything that the
//! client has started, whatever becomes of the client or of the simulator.
//!
//! Its standard input is a pipe that the simulator holds open; a byte in it asks for the client's
//! end, and the end of it does so, too, for then the simulator was killed. So do the signals that
//! ask a program to end, as from `killall sim`. Standard error is where the client writes both of
//! its streams. Standard output carries one line that says how the client ended, when no process is
//! left.
//!
//! It is a child subreaper: a process whose parent has ended becomes its child, also one that has
//! gone into its own session. So when it has no child left, no process is left.

use std::ffi::OsString;
use std::fs;
use std::io::{self, Read as _, Write as _};
use std::os::unix::net::UnixStream;
use std::os::unix::process::CommandExt as _;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use anyhow::{Context as _, anyhow};
use rustix::event::{PollFd, PollFlags, Timespec};
use rustix::io::Errno;
use rustix::process::{Pid, Signal, WaitOptions, WaitStatus};
use serde::{Deserialize, Serialize};
use serde_json::json;
use signal_hook::consts::{SIGCHLD, SIGHUP, SIGINT, SIGTERM};
use signal_hook::low_level::pipe;

use crate::exit::{Exit, Failure};

/// Time that those who were asked to end may take before they are killed.
pub(crate) const GRACE: Duration = Duration::from_secs(2);
/// Interval at which a process that has become a child meanwhile is killed.
const ROUND: Duration = Duration::from_millis(10);
/// Rounds after which orphans are given up that even SIGKILL does not end.
const MOST_ROUNDS: u32 = 200;

/// End of a client.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) enum ClientEnd {
    /// With this exit code.
    Exited(i32),
    /// Killed by this signal.
    Killed(i32),
    /// It could not be started; why.
    NotStarted(String),
}

/// The subcommand.
pub(crate) fn supervise(command: &[OsString]) -> Result<Exit, Failure> {
    let end = run(command).map_err(Failure::system)?;
    // A simulator that has been killed reads no more.
    let _ = writeln!(io::stdout(), "{}", json!(end));
    Ok(Exit::Clean)
}

/// Runs the client to its end.
fn run(command: &[OsString]) -> anyhow::Result<ClientEnd> {
    let (program, args) = command.split_first().context("no client is named")?;
    adopt_orphans()?;
    // Before there is a child, whose end might be missed.
    let asked = catch(&[SIGINT, SIGTERM, SIGHUP]).context("cannot catch signals")?;
    let ended = catch(&[SIGCHLD]).context("cannot catch signals")?;
    let spawned = Command::new(program)
        .args(args)
        .stdin(Stdio::null())
        .stdout(Stdio::from(io::stderr()))
        // Its own group can be signalled as a whole.
        .process_group(0)
        .spawn();
    let client = match spawned {
        Ok(client) => client,
        Err(error) => return Ok(ClientEnd::NotStarted(error.to_string())),
    };
    attend(Pid::from_child(&client), &asked, &ended)
}

/// What can be read once one of the signals has arrived.
fn catch(signals: &[i32]) -> io::Result<UnixStream> {
    let (caught, sender) = UnixStream::pair()?;
    caught.set_nonblocking(true)?;
    for signal in signals {
        pipe::register(*signal, sender.try_clone()?)?;
    }
    Ok(caught)
}

/// Waits until no process is left, and sees to it once the client has ended or is to end.
fn attend(client: Pid, asked: &UnixStream, mut ended: &UnixStream) -> anyhow::Result<ClientEnd> {
    let mut end = None;
    // When to stop asking and to kill.
    let mut patience: Option<Instant> = None;
    loop {
        match rustix::process::wait(WaitOptions::NOHANG) {
            Ok(Some((pid, status))) => {
                if pid == client {
                    end = end_of(status);
                    ask(client, &mut patience);
                }
                continue;
            }
            Ok(None) => {}
            Err(Errno::INTR) => continue,
            Err(_) => return end.ok_or_else(|| anyhow!("the client vanished")),
        }
        let left = patience.map(|until| until.saturating_duration_since(Instant::now()));
        if left.is_some_and(|left| left.is_zero()) {
            signal_children(Signal::KILL);
        }
        let left = left.and_then(|left| Timespec::try_from(left.max(ROUND)).ok());
        // The simulator asks for the end, or has been killed.
        let stdin = rustix::stdio::stdin();
        let mut files = vec![PollFd::new(&ended, PollFlags::IN)];
        if patience.is_none() {
            files.extend([
                PollFd::new(&stdin, PollFlags::IN),
                PollFd::new(asked, PollFlags::IN),
            ]);
        }
        match rustix::event::poll(&mut files, left.as_ref()) {
            Ok(_) | Err(Errno::INTR) => {}
            Err(errno) => return Err(anyhow!(errno).context("cannot wait for the client")),
        }
        if files.iter().skip(1).any(|file| !file.revents().is_empty()) {
            ask(client, &mut patience);
        }
        while matches!(ended.read(&mut [0; 64]), Ok(1..)) {}
    }
}

fn end_of(status: WaitStatus) -> Option<ClientEnd> {
    let code = status.exit_status().map(ClientEnd::Exited);
    code.or_else(|| status.terminating_signal().map(ClientEnd::Killed))
}

/// Asks all processes to end, once.
fn ask(client: Pid, patience: &mut Option<Instant>) {
    if patience.is_none() {
        *patience = Some(Instant::now() + GRACE);
        // Both may be gone already.
        let _ = rustix::process::kill_process_group(client, Signal::TERM);
        signal_children(Signal::TERM);
    }
}

/// Makes this process the parent of those whose supervisor is killed.
pub(crate) fn adopt_orphans() -> anyhow::Result<()> {
    let this = rustix::process::getpid();
    rustix::process::set_child_subreaper(Some(this)).context("cannot adopt orphans")
}

/// Kills those whose supervisor was killed: every child that is none of the supervisors.
pub(crate) fn end_orphans(is_supervisor: impl Fn(u32) -> bool) {
    for _ in 0..MOST_ROUNDS {
        let orphans: Vec<Pid> = children()
            .into_iter()
            .filter(|pid| !is_supervisor(pid.as_raw_nonzero().get().unsigned_abs()))
            .collect();
        if orphans.is_empty() {
            return;
        }
        for orphan in orphans {
            // It may have ended just now.
            let _ = rustix::process::kill_process(orphan, Signal::KILL);
            let _ = rustix::process::waitpid(Some(orphan), WaitOptions::NOHANG);
        }
        std::thread::sleep(ROUND);
    }
}

/// Signals every child. Grandchildren become children when their parents are dead.
fn signal_children(signal: Signal) {
    for child in children() {
        // It may have ended just now.
        let _ = rustix::process::kill_process(child, signal);
    }
}

fn children() -> Vec<Pid> {
    let this = rustix::process::getpid();
    let Ok(entries) = fs::read_dir("/proc") else {
        return Vec::new();
    };
    entries
        .flatten()
        .filter_map(|entry| entry.file_name().to_str()?.parse().ok())
        .filter_map(Pid::from_raw)
        .filter(|pid| parent(*pid) == Some(this))
        .collect()
}

fn parent(pid: Pid) -> Option<Pid> {
    let stat = fs::read_to_string(format!("/proc/{}/stat", pid.as_raw_nonzero())).ok()?;
    // The name in parentheses may itself have some.
    let after_name = &stat[stat.rfind(')')? + 1..];
    Pid::from_raw(after_name.split_whitespace().nth(1)?.parse().ok()?)
}

#[cfg(test)]
mod tests;
