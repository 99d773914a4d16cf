//! The simulator and other programs that serve, and what the system knows of them; and the floor
//! below which no server on a pseudo-terminal comes: a thread that echoes.

use std::io::{BufRead as _, BufReader};
use std::os::fd::OwnedFd;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::thread::JoinHandle;

use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::{OptionalActions, tcgetattr, tcsetattr};

/// The simulator as it is built with the benchmarks.
pub const SIM: &str = env!("CARGO_BIN_EXE_sim");

/// A program that serves until it is dropped.
pub struct Server {
    child: Child,
    output: Option<JoinHandle<()>>,
}

impl Server {
    /// Starts a program, and waits until it prints `ready` on its own line.
    pub fn start(command: &mut Command) -> Self {
        let mut child = command
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .spawn()
            .expect("the program starts");
        let mut output = BufReader::new(child.stdout.take().unwrap());
        let mut line = String::new();
        while line.trim_end() != "ready" {
            line.clear();
            let count = output.read_line(&mut line).unwrap();
            assert!(count > 0, "{command:?} ended before it was ready");
        }
        // What it prints later must go somewhere.
        let output = std::thread::spawn(move || {
            let _ = std::io::copy(&mut output, &mut std::io::sink());
        });
        Self {
            child,
            output: Some(output),
        }
    }

    /// The simulator with these arguments.
    pub fn sim(arguments: &[&str]) -> Self {
        Self::start(Command::new(SIM).args(arguments))
    }

    /// Processor time of all of its threads so far, s.
    pub fn cpu_seconds(&self) -> f64 {
        let tasks = format!("/proc/{}/task", self.child.id());
        let tasks = std::fs::read_dir(tasks).unwrap().flatten();
        tasks
            .map(|task| {
                let path = task.path().join("schedstat");
                let text = std::fs::read_to_string(path).unwrap_or_default();
                let nanoseconds: f64 = text
                    .split(' ')
                    .next()
                    .and_then(|word| word.parse().ok())
                    .unwrap_or(0.0);
                nanoseconds * 1e-9
            })
            .sum()
    }

    /// Resident memory, bytes.
    pub fn resident_bytes(&self) -> f64 {
        let path = format!("/proc/{}/status", self.child.id());
        let text = std::fs::read_to_string(path).unwrap();
        let line = text.lines().find(|line| line.starts_with("VmRSS:"));
        let kibibytes = line.and_then(|line| line.split_whitespace().nth(1));
        kibibytes.unwrap().parse::<f64>().unwrap() * 1024.0
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        let pid = rustix::process::Pid::from_child(&self.child);
        let _ = rustix::process::kill_process(pid, rustix::process::Signal::TERM);
        let _ = self.child.wait();
        if let Some(output) = self.output.take() {
            let _ = output.join();
        }
    }
}

/// A thread that sends back whatever comes.
pub struct Echo {
    path: PathBuf,
}

impl Echo {
    /// The thread ends when the last client has closed the port.
    pub fn start() -> Self {
        let master = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY).unwrap();
        grantpt(&master).unwrap();
        unlockpt(&master).unwrap();
        let path = PathBuf::from(ptsname(&master, Vec::new()).unwrap().into_string().unwrap());
        let mut line = tcgetattr(&master).unwrap();
        line.make_raw();
        tcsetattr(&master, OptionalActions::Now, &line).unwrap();
        // Without a client a read would fail.
        let client = std::fs::File::open(&path).unwrap();
        std::thread::spawn(move || echo(&master, client));
        Self { path }
    }

    pub fn path(&self) -> &Path {
        &self.path
    }
}

fn echo(master: &OwnedFd, client: std::fs::File) {
    let mut placeholder = Some(client);
    let mut buffer = [0; 512];
    while let Ok(count) = rustix::io::read(master, &mut buffer) {
        placeholder = None;
        let mut rest = &buffer[..count];
        while let Ok(written @ 1..) = rustix::io::write(master, rest) {
            rest = &rest[written..];
        }
    }
    drop(placeholder);
}
