//! A client that `sim run` starts: its environment, its output, its end.

use std::collections::{BTreeSet, VecDeque};
use std::ffi::OsString;
use std::fmt;
use std::fs::File;
use std::io::{Read, Write as _};
use std::os::fd::{AsFd, BorrowedFd};
use std::os::unix::process::CommandExt as _;
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use anyhow::Context as _;
use rustix::event::{PollFd, PollFlags, Timespec};

use crate::supervise::{ClientEnd, GRACE, end_orphans};
use crate::visible;

/// Most bytes of it that go into a file.
const MOST_FILED: usize = 1 << 26;
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
    output: Arc<Mutex<Output>>,
    reader: Option<JoinHandle<()>>,
}

/// Output of a client, or the end of it.
#[derive(Debug, Clone, Default)]
pub(crate) struct Output {
    last: VecDeque<u8>,
    total: usize,
}

impl Output {
    /// Size of the end that is kept.
    pub(crate) const MOST: usize = 1 << 16;

    fn add(&mut self, bytes: &[u8]) {
        self.total += bytes.len();
        self.last.extend(bytes);
        let excess = self.last.len().saturating_sub(Self::MOST);
        self.last.drain(..excess);
    }

    /// As text, with a first line that says what is left out.
    pub(crate) fn text(&self) -> String {
        let bytes: Vec<u8> = self.last.iter().copied().collect();
        let left_out = self.total.saturating_sub(bytes.len()) as u64;
        Self::left_out(left_out) + &visible::bytes(&bytes)
    }

    /// The first line of an output of which so many bytes are left out.
    pub(crate) fn left_out(bytes: u64) -> String {
        match bytes {
            0 => String::new(),
            bytes => format!("({bytes} bytes before this are left out)\n"),
        }
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
    /// Starts `command` with these variables in its environment; what it writes goes into `file`,
    /// too.
    pub(crate) fn start(
        command: &[OsString],
        environment: &[(String, OsString)],
        file: Option<File>,
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
            .stderr(Stdio::piped())
            // Ctrl-C is for the simulator, which then ends it.
            .process_group(0)
            .spawn()
            .context("cannot start a process for the client")?;
        known.insert(supervisor.id());
        drop(known);
        let pipes = supervisor
            .stdin
            .take()
            .zip(supervisor.stdout.take())
            .zip(supervisor.stderr.take());
        let ((leash, status), written) = pipes.context("a pipe to the client is missing")?;
        let output = Arc::new(Mutex::new(Output::default()));
        let shared = Arc::clone(&output);
        let reader = std::thread::Builder::new()
            .name("client output".to_owned())
            .spawn(move || collect(written, &shared, file))
            .context("cannot start a thread for the client's output")?;
        Ok(Self {
            supervisor,
            leash,
            status,
            output,
            reader: Some(reader),
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
        self.end_of_output();
        end.context("the process that looks after the client was killed, and so was the client")
    }

    /// Waits until all that the client wrote has been read, which takes no longer than a moment
    /// once no process is left that can write.
    fn end_of_output(&mut self) {
        let Some(reader) = self.reader.take() else {
            return;
        };
        let begun = Instant::now();
        while !reader.is_finished() && begun.elapsed() < GRACE {
            std::thread::sleep(Duration::from_millis(1));
        }
        if reader.is_finished() {
            // A panic has been printed by its own hook, and costs only output.
            let _ = reader.join();
        }
    }

    /// Output so far.
    pub(crate) fn output(&self) -> Output {
        self.output
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .clone()
    }
}

impl Drop for Client {
    fn drop(&mut self) {
        if self.reader.is_some() {
            // On the way out because of another error, which is reported.
            let _ = self.stop();
        }
    }
}

/// Takes what the client writes until no process can write any more.
fn collect(mut from: impl Read, output: &Mutex<Output>, mut file: Option<File>) {
    let mut buffer = [0; 8192];
    let mut filed = 0;
    // An error ends it as the end does.
    while let Ok(count) = from.read(&mut buffer) {
        if count == 0 {
            return;
        }
        let bytes = &buffer[..count];
        output
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .add(bytes);
        filed += count;
        if filed > MOST_FILED
            && let Some(mut file) = file.take()
        {
            // The file shows the beginning; the end is kept in any case.
            let _ = writeln!(
                file,
                "\n(more than {MOST_FILED} bytes; the rest is left out)"
            );
        }
        if let Some(open) = &mut file
            && open.write_all(bytes).is_err()
        {
            file = None;
        }
    }
}
