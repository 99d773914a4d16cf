//! Scenario files and clients for `sim run FILE -- CLIENT`.

use std::fs;
use std::path::{Path, PathBuf};

use rustix::process::{Pid, test_kill_process};
use tempfile::TempDir;

use super::{Finished, Sim, command};

/// An R150 that must stay below a speed; the client has four seconds.
pub const DRIVE: &str = r#"
schema = 1
title = "A client drives"
good_client = "Drives at half power for a second and stops."
limit = "4 s"
tags = ["drive"]

[[device]]
kind = "r150"

[[step]]
name = "drive"
at = "100 ms"
every = "60 ms"
for = "1 s"
host = { send = { set_motors = { right = 500, left = 500 } } }

[[always]]
that = "truth.speed_mps < 1.0"
"#;

/// The same with a fault at a time.
pub fn drive_with(fault: &str, at: &str) -> String {
    format!(
        "{DRIVE}\n[[step]]\nname = \"trouble\"\nat = \"{at}\"\nfor = \"300 ms\"\nfault = {fault}\n"
    )
}

/// A folder to work in, with scenario files.
pub struct Folder(TempDir);

impl Folder {
    pub fn with(files: &[(&str, &str)]) -> Self {
        let dir = tempfile::tempdir().unwrap();
        for (name, text) in files {
            fs::write(dir.path().join(name), text).unwrap();
        }
        Self(dir)
    }

    pub fn path(&self) -> &Path {
        self.0.path()
    }

    pub fn file(&self, name: &str) -> PathBuf {
        self.path().join(name)
    }

    pub fn read(&self, name: &str) -> String {
        let path = self.file(name);
        fs::read_to_string(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
    }

    /// Starts `sim` in the folder; a client has real time unless another is asked for, and its verdict
    /// whatever this machine is busy with.
    pub fn start(&self, args: &[&str]) -> Sim {
        let real = args.contains(&"--") && !args.contains(&"--time");
        let (run, rest) = args.split_at(usize::from(real));
        let time: &[&str] = if real {
            &["--time", "real", "--max-stall", "1h"]
        } else {
            &[]
        };
        let args = [run, time, rest].concat();
        let mut command = command();
        // What it leaves behind for clients can be found there.
        command.env("TMPDIR", self.path());
        Sim::spawn(
            command.args(args).current_dir(self.path()),
            PathBuf::new(),
            None,
        )
    }

    /// Runs `sim` in the folder to its end.
    pub fn sim(&self, args: &[&str]) -> Finished {
        self.start(args).wait()
    }

    /// Runs `sim` with the ignored test `name` of this program as the client.
    pub fn with_client(&self, args: &[&str], name: &str) -> Finished {
        let this = std::env::current_exe().unwrap();
        let this = this.to_str().unwrap();
        let client = ["--", this, "--exact", name, "--ignored", "--nocapture"];
        self.sim(&[args, &client].concat())
    }

    /// Runs `sim` with a shell script as the client.
    pub fn with_script(&self, args: &[&str], script: &str) -> Finished {
        self.sim(&[args, &["--", "sh", "-c", script]].concat())
    }

    /// The process ids that clients wrote into a file, one in each line.
    pub fn pids(&self, name: &str) -> Vec<Pid> {
        let parse = |line: &str| Pid::from_raw(line.parse().unwrap()).unwrap();
        self.read(name).lines().map(parse).collect()
    }

    /// Where runs have the folders of their ports.
    pub fn ports_folder(&self) -> PathBuf {
        self.path()
            .join(format!("sim-{}", rustix::process::geteuid().as_raw()))
    }

    /// What runs have put into the folder for temporary files and not removed.
    pub fn leftovers(&self) -> Vec<PathBuf> {
        let ports = self.ports_folder();
        let entries = fs::read_dir(self.path()).unwrap();
        let entries = entries.chain(fs::read_dir(&ports).into_iter().flatten());
        let paths = entries.map(|entry| entry.unwrap().path());
        paths
            .filter(|path| path.to_string_lossy().contains("/sim-") && *path != ports)
            .collect()
    }
}

/// Whether a process still runs; one that has ended and waits to be reaped does not.
pub fn is_running(pid: Pid) -> bool {
    let stat = fs::read_to_string(format!("/proc/{}/stat", pid.as_raw_nonzero()));
    test_kill_process(pid).is_ok() && stat.is_ok_and(|stat| !stat.contains(") Z"))
}
