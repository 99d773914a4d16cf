//! A client that `sim run` starts: its environment, its output, its end.

use std::collections::{BTreeSet, VecDeque};
use std::ffi::OsString;
use std::fmt;
use std::fs::File;
use std::io::{self, Read as _, Seek as _, SeekFrom, Write as _};
use std::os::fd::{AsFd, BorrowedFd};
use std::os::unix::process::CommandExt as _;
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use anyhow::Context as _;
use rigsim_settings::SimTime;
use rustix::event::{PollFd, PollFlags, Timespec};

use crate::supervise::{ClientEnd, GRACE, end_orphans};
use crate::visible;

/// Most bytes of its output that are kept; when there are twice as many, those beyond it go.
const MOST_FILED: u64 = 1 << 26;
/// Most bytes of its output that are shown: the last ones.
const MOST_SHOWN: u64 = 1 << 16;
/// Time that the end of a client may take in all, which includes killing it.
const END_PATIENCE: Duration = Duration::from_secs(10);

/// The supervisors of the clients that run now, at most one for each case at a time.
static SUPERVISORS: Mutex<BTreeSet<u32>> = Mutex::new(BTreeSet::new());

fn supervisors() -> MutexGuard<'static, BTreeSet<u32>> {
    SUPERVISORS.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A client and everything that it has started; dropping it ends them.
pub(crate) struct Client {
    supervisor: Child,
    /// Held open for as long as the client may run.
    leash: ChildStdin,
    status: ChildStdout,
}

/// What a client has written so far, and when. It is in a file, which takes everything at once: the
/// pace of a pipe's reader would show.
pub(crate) struct Written {
    file: File,
    length: u64,
    /// Bytes that were left out of the file.
    cut: u64,
    /// From which byte on it was written at which time, `None` before the scenario began; of the end
    /// that is shown. Empty if times are not known.
    times: VecDeque<(u64, Option<SimTime>)>,
}

impl Written {
    /// The output that goes into a file, to which bytes are only appended.
    pub(crate) fn new(file: File) -> Self {
        Self {
            file,
            length: 0,
            cut: 0,
            times: VecDeque::new(),
        }
    }

    /// Keeps the file within its bound, and returns its length.
    pub(crate) fn cut(&mut self) -> u64 {
        let length = self.file.metadata().map_or(0, |file| file.len());
        // The beginning stays, and whatever comes next; a file that cannot be cut is too long.
        if length <= 2 * MOST_FILED || self.file.set_len(MOST_FILED).is_err() {
            return length;
        }
        let cut = length - MOST_FILED;
        // Of no use to a client that has filled the disk.
        let _ = writeln!(self.file, "\n({cut} bytes are left out here)");
        self.cut += cut;
        self.length = MOST_FILED;
        self.times.clear();
        MOST_FILED
    }

    /// Returns how many of so many bytes that the client has written are not there any more.
    pub(crate) fn lost(&self, written: u64) -> u64 {
        let length = self.file.metadata().map_or(0, |file| file.len());
        written.saturating_sub(length + self.cut)
    }

    /// All that is new was written at this time: while the client runs, its time stands still.
    pub(crate) fn date_output(&mut self, at: Option<SimTime>) {
        let length = self.cut();
        if length <= self.length {
            return;
        }
        if self.times.back().is_none_or(|(_, last)| *last != at) {
            self.times.push_back((self.length, at));
        }
        let shown = length.saturating_sub(MOST_SHOWN);
        while self.times.get(1).is_some_and(|(from, _)| *from <= shown) {
            self.times.pop_front();
        }
        self.length = length;
    }

    /// Its end as text, with the time before each line if times are known, and a first line that says
    /// what is left out.
    pub(crate) fn text(&mut self) -> String {
        let (mut from, bytes) = match self.end() {
            Ok(end) => end,
            Err(error) => return format!("(cannot read the client's output: {error})\n"),
        };
        let mut text = match from + self.cut {
            0 => String::new(),
            bytes => format!("({bytes} bytes before this are left out)\n"),
        };
        for line in bytes.split_inclusive(|byte| *byte == b'\n') {
            if !self.times.is_empty() {
                let next = self.times.partition_point(|(begin, _)| *begin <= from);
                let time = next.checked_sub(1).and_then(|last| self.times[last].1);
                let time = time.map_or("-".to_owned(), |time| time.to_string());
                text += &format!("{time:>12} ");
            }
            text += &visible::bytes(line);
            from += line.len() as u64;
        }
        text
    }

    /// The last bytes, and the place of the first of them.
    fn end(&mut self) -> io::Result<(u64, Vec<u8>)> {
        let from = self.file.metadata()?.len().saturating_sub(MOST_SHOWN);
        self.file.seek(SeekFrom::Start(from))?;
        let mut bytes = Vec::new();
        (&self.file).take(MOST_SHOWN).read_to_end(&mut bytes)?;
        Ok((from, bytes))
    }
}

impl fmt::Display for ClientEnd {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Exited(code) => write!(f, "ended with exit code {code}"),
            Self::Killed(signal) => match signal_hook::low_level::signal_name(*signal) {
                Some(name) => write!(f, "was killed by {name}"),
                None => write!(f, "was killed by signal {signal}"),
            },
            Self::NotStarted(why) => write!(f, "could not be started: {why}"),
        }
    }
}

impl Client {
    /// Starts `command` with these variables in its environment; what it writes goes into `output`.
    pub(crate) fn start(
        command: &[OsString],
        environment: &[(String, OsString)],
        output: File,
    ) -> anyhow::Result<Self> {
        let program = std::env::current_exe().context("cannot find the simulator's own program")?;
        // Held until it is noted down, so that it is not taken for an orphan.
        let mut known = supervisors();
        let mut supervisor = Command::new(program)
            .arg("supervise")
            .arg("--")
            .args(command)
            .envs(environment.iter().map(|(name, value)| (name, value)))
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(output)
            // Ctrl-C is for the simulator, which then ends it.
            .process_group(0)
            .spawn()
            .context("cannot start a process for the client")?;
        known.insert(supervisor.id());
        drop(known);
        let pipes = supervisor.stdin.take().zip(supervisor.stdout.take());
        let (leash, status) = pipes.context("a pipe to the client is missing")?;
        Ok(Self {
            supervisor,
            leash,
            status,
        })
    }

    /// Descriptor that can be read once the client has ended.
    pub(crate) fn status(&self) -> BorrowedFd<'_> {
        self.status.as_fd()
    }

    /// Asks it to end, and kills it if it does not.
    pub(crate) fn stop(&mut self) -> anyhow::Result<ClientEnd> {
        // It has ended by itself if it cannot be asked.
        let _ = self.leash.write_all(b".");
        self.wait()
    }

    /// Waits for its end; it has ended, or is about to.
    pub(crate) fn wait(&mut self) -> anyhow::Result<ClientEnd> {
        let patience = Timespec::try_from(GRACE + END_PATIENCE).ok();
        let mut poll = [PollFd::new(&self.status, PollFlags::IN)];
        let ready = rustix::io::retry_on_intr(|| rustix::event::poll(&mut poll, patience.as_ref()))
            .context("cannot wait for the client")?;
        if ready == 0 {
            anyhow::bail!("the client cannot be ended, not even by SIGKILL");
        }
        let mut line = String::new();
        (&mut self.status)
            .take(4096)
            .read_to_string(&mut line)
            .context("cannot read how the client ended")?;
        self.supervisor
            .wait()
            .context("cannot wait for the client")?;
        supervisors().remove(&self.supervisor.id());
        let end = serde_json::from_str(&line).ok();
        if end.is_none() {
            let others = supervisors();
            end_orphans(|pid| others.contains(&pid));
        }
        end.context("the process that looks after the client was killed, and so was the client")
    }
}

impl Drop for Client {
    fn drop(&mut self) {
        if supervisors().contains(&self.supervisor.id()) {
            // On the way out because of another error, which is reported.
            let _ = self.stop();
        }
    }
}

#[cfg(test)]
mod tests;
