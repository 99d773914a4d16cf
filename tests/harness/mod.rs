//! The real binary and a client for it, as the whole-program tests need them.
//!
//! Tests wait on conditions with [`PATIENCE`], which is spent only on failure, since the machine
//! may be busy with other things. A time is asserted only in the direction in which a slow machine
//! cannot break it.
#![allow(dead_code, reason = "each test binary uses its own part")]
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "a test fails by panicking, and clippy takes helpers for production code"
)]

pub mod car;
pub mod client;
pub mod live;
pub mod process;
pub mod transcript;
pub mod unprivileged;
pub mod wire;

use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

use rustix::process::Signal;
use serde_json::Value;
use tempfile::TempDir;

use client::Client;
use process::Process;
use transcript::Transcript;

/// How long to wait for what must happen before it counts as a failure. A fit of a debug build takes a minute of
/// processor time, and other tests run beside it.
pub const PATIENCE: Duration = Duration::from_secs(300);

/// Waits until `done`, looking a few hundred times a second.
pub fn until(what: &str, mut done: impl FnMut() -> bool) {
    let start = Instant::now();
    while !done() {
        assert!(start.elapsed() < PATIENCE, "in vain waited until {what}");
        std::thread::sleep(Duration::from_millis(3));
    }
}

/// A command that runs the binary, whatever the caller's terminal and taste in colours.
pub fn command() -> Command {
    // A test that runs as another user works on a copy which that user may execute.
    let binary = std::env::var_os(unprivileged::BINARY)
        .unwrap_or_else(|| OsString::from(env!("CARGO_BIN_EXE_sim")));
    let mut command = Command::new(binary);
    for name in ["NO_COLOR", "CLICOLOR", "CLICOLOR_FORCE"] {
        command.env_remove(name);
    }
    command.stdin(Stdio::null());
    command
}

/// Runs the binary to its end, which must come by itself.
pub fn run(args: &[&str]) -> Finished {
    Sim::spawn(command().args(args), PathBuf::new(), None).wait()
}

/// A running simulator; killed when dropped, so that a failing test leaves no process behind.
pub struct Sim {
    process: Process,
    port: PathBuf,
    out: Transcript,
    err: Transcript,
    // Dropped last: the files go when no process uses them any more.
    dir: Option<TempDir>,
}

/// A simulator that has ended.
pub struct Finished {
    pub status: ExitStatus,
    pub out: String,
    pub err: String,
}

impl Sim {
    /// Serves on its own path, with these further arguments, and waits until it is ready.
    pub fn start(args: &[&str]) -> Self {
        let dir = tempfile::tempdir().unwrap();
        let port = dir.path().join("r150");
        let mut command = command();
        command.arg("--pty").arg(&port).args(["--seed", "1"]);
        let sim = Self::spawn(command.args(args), port, Some(dir));
        sim.wait_ready();
        sim
    }

    /// The same on a path of the caller's.
    pub fn start_at(port: &Path, args: &[&str]) -> Self {
        let mut command = command();
        command.arg("--pty").arg(port).args(["--seed", "1"]);
        let sim = Self::spawn(command.args(args), port.to_owned(), None);
        sim.wait_ready();
        sim
    }

    /// Runs `command` and listens to it. Nothing is waited for.
    pub fn spawn(command: &mut Command, port: PathBuf, dir: Option<TempDir>) -> Self {
        command.stdout(Stdio::piped()).stderr(Stdio::piped());
        let mut process = Process::spawn(command);
        Self {
            out: Transcript::of(process.child().stdout.take().unwrap()),
            err: Transcript::of(process.child().stderr.take().unwrap()),
            process,
            port,
            dir,
        }
    }

    /// Waits for the line that says that clients can connect.
    pub fn wait_ready(&self) {
        let ready = |line: &str| line == "ready" || line.contains(r#""code":"ready""#);
        if self.out.find_line(ready).is_none() {
            panic!("not ready: {}{}", self.out.text(), self.err.text());
        }
    }

    pub fn port(&self) -> &Path {
        &self.port
    }

    pub fn pid(&self) -> u32 {
        self.process.id()
    }

    /// A client at the right speed.
    pub fn client(&self) -> Client {
        Client::open(&self.port)
    }

    /// What it has printed so far.
    pub fn printed(&self) -> String {
        self.out.text()
    }

    /// Waits for a line that contains all of `parts`.
    pub fn wait_line(&self, parts: &[&str]) -> String {
        self.out.wait_line(parts)
    }

    /// The same on standard error.
    pub fn wait_error(&self, parts: &[&str]) -> String {
        self.err.wait_line(parts)
    }

    /// Waits until events with this code have been printed so many times in all; needs
    /// `--log-format json`.
    pub fn wait_events(&self, code: &str, count: usize) -> Vec<Value> {
        let mut found = Vec::new();
        until(&format!("{count} events {code} are printed"), || {
            found = with_code(&json_lines(&self.printed()), code);
            found.len() >= count
        });
        found
    }

    /// Waits for the first event with this code; needs `--log-format json`.
    pub fn wait_event(&self, code: &str) -> Value {
        self.wait_events(code, 1).remove(0)
    }

    pub fn signal(&self, signal: Signal) {
        self.process.signal(signal);
    }

    /// Stops it as Ctrl-C does.
    pub fn stop(self) -> Finished {
        self.signal(Signal::INT);
        self.wait()
    }

    /// Waits until it ends.
    pub fn wait(mut self) -> Finished {
        let status = self.process.wait();
        Finished {
            status,
            out: self.out.whole(),
            err: self.err.whole(),
        }
    }
}

impl Finished {
    pub fn code(&self) -> Option<i32> {
        self.status.code()
    }

    /// Fails unless it ended with `code` and said each of `parts` on standard error.
    pub fn expect_refusal(&self, code: i32, parts: &[&str]) {
        assert_eq!(self.code(), Some(code), "{}{}", self.out, self.err);
        for part in parts {
            assert!(self.err.contains(part), "no {part:?} in {:?}", self.err);
        }
    }

    /// Fails unless it ended well and without complaint.
    pub fn expect_clean(self) -> Self {
        assert_eq!(self.code(), Some(0), "{}{}", self.out, self.err);
        assert_eq!(self.err, "");
        self
    }

    /// The objects printed; needs `--log-format json`.
    pub fn json(&self) -> Vec<Value> {
        json_lines(&self.out)
    }

    /// The one device's part of the summary; needs `--log-format json`.
    pub fn summary(&self) -> Value {
        let last = self.json().pop().unwrap();
        assert_eq!(last["code"], "summary");
        last["devices"][0].clone()
    }
}

/// Every complete line of `text` as an object.
pub fn json_lines(text: &str) -> Vec<Value> {
    let complete = text.rfind('\n').map_or("", |end| &text[..end]);
    let parse = |line: &str| match serde_json::from_str(line) {
        Ok(value @ Value::Object(_)) => value,
        _ => panic!("not a JSON object: {line:?}"),
    };
    complete.lines().map(parse).collect()
}

/// Those of `objects` that have this code.
pub fn with_code(objects: &[Value], code: &str) -> Vec<Value> {
    let has = |object: &&Value| object["code"] == code;
    objects.iter().filter(has).cloned().collect()
}

/// Says on standard error, past the capture of passing tests' output, what was not tested.
pub fn report_skipped(what: &str, why: &str) {
    use std::io::Write as _;
    let _ = writeln!(std::io::stderr(), "SKIPPED {what}: {why}");
}

/// A Python with pyserial, or a word that there is none.
pub fn python() -> Option<&'static str> {
    let found = Command::new("python3")
        .args(["-c", "import serial"])
        .output();
    if found.is_ok_and(|found| found.status.success()) {
        return Some("python3");
    }
    assert!(
        std::env::var_os("SIM_TEST_PYTHON").is_none(),
        "SIM_TEST_PYTHON is set, and there is no Python with pyserial"
    );
    report_skipped("a client in Python", "no python3 with pyserial");
    None
}
