//! Programs against a small device: it answers each line after a while, in capitals.

#![allow(dead_code, reason = "each test program uses a part of it")]
#![allow(
    clippy::expect_used,
    clippy::print_stderr,
    reason = "clippy takes it for no test; what is skipped is named"
)]

use std::collections::VecDeque;
use std::ffi::OsString;
use std::fs;
use std::io::{Read as _, Seek as _};
use std::os::fd::OwnedFd;
use std::os::unix::ffi::OsStrExt as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::atomic::AtomicBool;
use std::time::{Duration, Instant};

use rigsim_lockstep::{
    Broken, ClientLine, End, Ending, Error, Options, Port, Program, Step, World,
};
use rustix::process::{PidfdFlags, PidfdGetfdFlags};

/// How long the device takes to answer.
pub const ANSWER: u64 = 50_000_000;
/// When it comes to its end, after the program began.
pub const END: u64 = 100_000_000_000;
/// The date on which programs begin: 2030-01-01.
pub const DATE: Duration = Duration::from_secs(1_893_456_000);

/// The device and its cable.
#[derive(Default)]
pub struct Device {
    pub line: Vec<u8>,
    pub answers: VecDeque<(u64, Vec<u8>)>,
    /// When the cable is pulled, and when it is back.
    pub cable: Option<(u64, u64)>,
    /// How long another thread keeps the other end of the port when the cable is pulled.
    pub kept: Option<Duration>,
    /// Keeps the client's own end open: the line that it sends says its process and descriptor.
    pub keeps: bool,
    pub kept_end: Option<OwnedFd>,
    /// Real time in which the machine does nothing for it, each time something happens.
    pub stalls: Duration,
    /// What it does besides, each time that something happens.
    pub besides: Option<fn()>,
    /// Bytes that there is room for at a time; all of them if that is 0.
    pub room: usize,
    /// Everything that has happened.
    pub trace: Vec<String>,
}

impl Device {
    fn note(&mut self, now: u64, what: &str) {
        self.trace.push(format!("{now} {what}"));
    }
}

impl World for Device {
    fn opened(&mut self, port: usize, now: u64) -> Result<(), Broken> {
        self.note(now, &format!("opened {port}"));
        Ok(())
    }

    fn closed(&mut self, port: usize, now: u64) -> Result<(), Broken> {
        self.note(now, &format!("closed {port}"));
        Ok(())
    }

    fn sent(
        &mut self,
        _port: usize,
        line: ClientLine,
        now: u64,
        bytes: &[u8],
    ) -> Result<usize, Broken> {
        let count = match self.room {
            0 => bytes.len(),
            room => bytes.len().min(room),
        };
        let bytes = &bytes[..count];
        let shown = String::from_utf8_lossy(bytes).into_owned();
        self.note(now, &format!("sent {shown:?} at {} baud", line.baud));
        if self.keeps {
            self.kept_end = client_s_end(&shown);
        }
        for &byte in bytes {
            self.line.push(byte.to_ascii_uppercase());
            if byte == b'\n' {
                let line = std::mem::take(&mut self.line);
                self.answers.push_back((now + ANSWER, line));
            }
        }
        Ok(count)
    }

    fn modem_lines(&mut self, _port: usize, now: u64, lines: u32) -> Result<(), Broken> {
        self.note(now, &format!("modem lines {lines:#x}"));
        Ok(())
    }

    fn advance(
        &mut self,
        ports: &mut [Port],
        now: u64,
        until: Option<u64>,
        _ran: bool,
    ) -> Result<Step, Broken> {
        let cable = self
            .cable
            .map(|(pulled, back)| if ports[0].is_plugged() { pulled } else { back });
        let cable = cable.filter(|at| *at >= now || !ports[0].is_plugged());
        let answer = self.answers.front().map(|answer| answer.0);
        // A client that waits for room is asked again after a while.
        let next = [cable, answer, until].into_iter().flatten().min();
        let Some(next) = next else {
            return Ok(Step::Never);
        };
        std::thread::sleep(self.stalls);
        if let Some(besides) = self.besides {
            besides();
        }
        let next = next.max(now);
        if next >= END {
            return Ok(Step::Over);
        }
        if cable == Some(next) {
            if ports[0].is_plugged() {
                self.note(next, "cable pulled");
                if let Some(time) = self.kept {
                    let other_end = other_end_of(&ports[0]);
                    std::thread::spawn(move || {
                        std::thread::sleep(time);
                        drop(other_end);
                    });
                }
                ports[0].unplug()?;
                self.answers.clear();
            } else {
                self.note(next, "cable back");
                ports[0].plug()?;
                self.cable = None;
            }
        } else if answer == Some(next)
            && let Some((_, line)) = self.answers.pop_front()
        {
            self.note(
                next,
                &format!("answered {:?}", String::from_utf8_lossy(&line)),
            );
            ports[0].deliver(&line)?;
        }
        Ok(Step::To(next))
    }
}

/// A duplicate of this program's end of a port.
fn other_end_of(port: &Port) -> OwnedFd {
    let node = fs::read_link(port.path()).expect("its link");
    let this = rustix::process::getpid();
    let this = rustix::process::pidfd_open(this, PidfdFlags::empty()).expect("itself");
    let mut files = fs::read_dir("/proc/self/fd").expect("its files");
    let other = files.find_map(|file| {
        let file = file.ok()?.path();
        let is_master = fs::read_link(&file).ok()?.ends_with("ptmx");
        let number = file.file_name()?.to_str()?.parse().ok()?;
        let flags = PidfdGetfdFlags::empty();
        let end = is_master.then(|| rustix::process::pidfd_getfd(&this, number, flags).ok())??;
        let name = rustix::pty::ptsname(&end, Vec::new()).ok()?;
        (name.to_bytes() == node.as_os_str().as_bytes()).then_some(end)
    });
    other.expect("this program has it open")
}

/// A duplicate of the descriptor that a line names: number of the process, number there.
fn client_s_end(line: &str) -> Option<OwnedFd> {
    let (process, number) = line.trim().split_once(' ')?;
    let process = rustix::process::Pid::from_raw(process.parse().ok()?)?;
    let process = rustix::process::pidfd_open(process, PidfdFlags::empty()).ok()?;
    let flags = PidfdGetfdFlags::empty();
    rustix::process::pidfd_getfd(process, number.parse().ok()?, flags).ok()
}

/// What came of a program.
#[derive(Debug)]
pub struct Played {
    pub ending: Ending,
    pub output: String,
    pub trace: Vec<String>,
    pub took: Duration,
    pub kept_end: Option<OwnedFd>,
}

/// Options of a run in a test.
pub struct Setup {
    pub seed: Option<u64>,
    pub schedule: Option<u64>,
    pub device: Device,
    pub environment: Vec<(String, OsString)>,
    /// Processor time, and real time.
    pub allowed: [Option<Duration>; 2],
}

impl Default for Setup {
    fn default() -> Self {
        Self {
            seed: Some(7),
            schedule: None,
            device: Device::default(),
            environment: Vec::new(),
            allowed: [60, 600].map(|seconds| Some(Duration::from_secs(seconds))),
        }
    }
}

/// Runs a program with the device at `$PORT`.
pub fn play_on(setup: Setup, words: &[&str]) -> Result<Played, Error> {
    // The same name each time in one test, whose thread it is named by.
    let (process, thread) = (std::process::id(), std::thread::current().id());
    let link = std::env::temp_dir().join(format!("lockstep-{process}-{thread:?}"));
    let mut ports = vec![Port::new(link.clone(), 115_200).expect("a port")];
    let mut output = tempfile::tempfile().expect("a file");
    let words: Vec<OsString> = words.iter().map(OsString::from).collect();
    let mut environment = setup.environment;
    environment.push(("PORT".to_owned(), link.into_os_string()));
    let program = Program {
        words: &words,
        environment: &environment,
        output: output.try_clone().expect("the same file"),
    };
    let begun = Instant::now();
    let stop = AtomicBool::new(false);
    let options = Options {
        seed: setup.seed,
        schedule: setup.schedule,
        date: DATE,
        allowed: setup.allowed[0],
        until: setup.allowed[1].map(|allowed| begun + allowed),
        stop: &stop,
    };
    let mut device = setup.device;
    let ending = rigsim_lockstep::run(program, &options, &mut ports, &mut device)?;
    let took = begun.elapsed();
    let mut text = Vec::new();
    output.rewind().expect("the beginning");
    output.read_to_end(&mut text).expect("what it wrote");
    Ok(Played {
        ending,
        output: String::from_utf8_lossy(&text).into_owned(),
        trace: device.trace,
        took,
        kept_end: device.kept_end,
    })
}

/// The same on the usual setup.
pub fn play(words: &[&str]) -> Played {
    play_on(Setup::default(), words).expect("it can be run")
}

/// A program in Python; `None` where there is none, which is said.
pub fn python(code: &str) -> Option<Played> {
    python_on(Setup::default(), code)
}

/// The same on this setup.
pub fn python_on(setup: Setup, code: &str) -> Option<Played> {
    let python = program("python3")?;
    let python = python.to_str().expect("a path of letters");
    Some(play_on(setup, &[python, "-c", code]).expect("it can be run"))
}

/// Runs a program to its end beside the clients of other tests.
pub fn finished(command: &mut Command) -> std::io::Result<std::process::Output> {
    let command = command.stdout(Stdio::piped()).stderr(Stdio::piped());
    rigsim_lockstep::spawn(command)?.wait_with_output()
}

/// A program of this machine.
pub fn program(name: &str) -> Option<PathBuf> {
    let found = finished(Command::new(name).arg("--version")).is_ok();
    if !found {
        eprintln!("skipped: there is no {name} here");
        return None;
    }
    Some(PathBuf::from(name))
}

/// What several clients in C begin with.
pub const CLIENT: &str = include_str!("client.h");

/// Compiles C; `None` where there is no compiler, which is said.
pub fn c(code: &str, flags: &[&str]) -> Option<(tempfile::TempDir, PathBuf)> {
    compiled("cc", "c", code, flags)
}

/// Compiles C++ likewise.
pub fn cpp(code: &str, flags: &[&str]) -> Option<(tempfile::TempDir, PathBuf)> {
    compiled("c++", "cc", code, flags)
}

fn compiled(
    compiler: &str,
    ending: &str,
    code: &str,
    flags: &[&str],
) -> Option<(tempfile::TempDir, PathBuf)> {
    program(compiler)?;
    let folder = tempfile::tempdir().expect("a folder");
    let source = folder.path().join("client").with_extension(ending);
    fs::write(&source, code).expect("a source file");
    let binary = folder.path().join("client");
    let mut command = Command::new(compiler);
    command.args(["-O1", "-pthread", "-o"]);
    command.arg(&binary).arg(&source).args(flags);
    let built = finished(&mut command).expect("a compiler that runs");
    assert!(
        built.status.success(),
        "{}",
        String::from_utf8_lossy(&built.stderr)
    );
    Some((folder, binary))
}

/// Compiles and plays.
pub fn c_played(code: &str) -> Option<Played> {
    let (_folder, binary) = c(code, &["-lrt"])?;
    Some(play(&[text(&binary)]))
}

/// Plays a program in Python that prints what is expected.
#[track_caller]
pub fn prints(code: &str, expected: &str) {
    let Some(played) = python(code) else {
        return;
    };
    assert_eq!(played.output, expected, "{:?}", played.ending);
    assert_eq!(played.ending.end, End::Exited(0));
    assert!(played.ending.outside.is_empty(), "{:?}", played.ending);
}

/// Plays a program in C likewise.
#[track_caller]
pub fn c_prints(code: &str, expected: &str) {
    let Some(played) = c_played(code) else {
        return;
    };
    assert_eq!(played.output, expected, "{:?}", played.ending);
    assert_eq!(played.ending.end, End::Exited(0));
    assert!(played.ending.outside.is_empty(), "{:?}", played.ending);
}

pub fn text(path: &Path) -> &str {
    path.to_str().expect("a path of letters")
}
