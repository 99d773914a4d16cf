//! The whole program beside sinstruments 1.5.0, a simulator of serial instruments in Python that
//! serves a comparable device on pseudo-terminals: `cargo bench --bench sinstruments -- --python`.
//!
//! It needs Python 3 with `venv`, and installs sinstruments from PyPI into a virtual environment
//! that is gone afterwards; so it does nothing unless `--python` asks for it.
#![allow(
    clippy::unwrap_used,
    clippy::print_stdout,
    reason = "a benchmark prints its results and ends at the first surprise"
)]

mod support;

use std::path::{Path, PathBuf};
use std::process::Command;

use support::client::{Client, Poller};
use support::process::{Echo, Server};
use support::serving::{
    Conversation, INSTANT, POLL_PERIOD, PORTS, Polling, echoed, heartbeat, many, median_and_tail,
    motors, polls,
};
use support::{Aim, Figures, Options, Table, alternate, micros, millis, percent};

const DEVICE: &str = concat!(
    env!("CARGO_MANIFEST_DIR"),
    "/benches/sinstruments_device.py"
);
const RELEASE: &str = "sinstruments==1.5.0";

fn main() {
    let options = Options::read();
    if !options.has("--python") {
        println!("sinstruments: left out; `cargo bench --bench sinstruments -- --python` runs it");
        return;
    }
    let venv = tempfile::tempdir().unwrap();
    let python = install(venv.path());
    let table = Table::begin("Beside sinstruments 1.5.0", &options);
    if options.wants("latency") {
        latency(&python, &options, &table);
    }
    if options.wants("ports") {
        ports(&python, &options, &table);
    }
}

/// Makes a virtual environment with sinstruments in it; gives its Python.
fn install(folder: &Path) -> PathBuf {
    let run = |command: &mut Command| {
        let status = command.status().unwrap();
        assert!(status.success(), "{command:?} failed");
    };
    run(Command::new("python3").args(["-m", "venv"]).arg(folder));
    let pip = [
        "-m",
        "pip",
        "install",
        "--quiet",
        "--disable-pip-version-check",
    ];
    let python = folder.join("bin/python");
    run(Command::new(&python).args(pip).arg(RELEASE));
    python
}

/// So many devices in one process of sinstruments, and the paths of their ports.
fn peers(python: &Path, dir: &tempfile::TempDir, devices: usize) -> (Server, Vec<PathBuf>) {
    let mut command = Command::new(python);
    command.arg(DEVICE).arg(dir.path()).arg(devices.to_string());
    let paths = (0..devices).map(|device| dir.path().join(format!("r150-{device}")));
    let paths = paths.collect();
    (Server::start(&mut command), paths)
}

fn latency(python: &Path, options: &Options, table: &Table) {
    let (own_dir, peer_dir) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let (_sim, own) = many(&own_dir, 1, &INSTANT);
    let (_peer, peer) = peers(python, &peer_dir, 1);
    let echo = Echo::start();
    let mut own = Conversation::new(Client::open(&own[0]), heartbeat(), motors());
    let mut peer = Conversation::new(Client::open(&peer[0]), heartbeat(), motors());
    let (poll, drive) = (echoed(&heartbeat()), echoed(&motors()));
    let mut floor = Conversation::new(Client::open(echo.path()), poll, drive);
    let requests = options.count(1000, 20);
    for conversation in [&mut own, &mut peer, &mut floor] {
        conversation.ask(requests);
    }
    let mut tails = [const { Figures(Vec::new()) }; 3];
    let [own_tail, peer_tail, floor_tail] = &mut tails;
    let [own, peer, floor] = alternate(
        options.count(80, 1),
        [
            &mut || median_and_tail(&own.ask(requests), own_tail),
            &mut || median_and_tail(&peer.ask(requests), peer_tail),
            &mut || median_and_tail(&floor.ask(requests), floor_tail),
        ],
    );
    let what = "request to reply, vehicle driving, instant wire, beside sinstruments: p50";
    table.ratio(what, &own, &peer, micros, Aim::AtMost(0.6));
    table.ratio("the same, p99", own_tail, peer_tail, micros, Aim::None);
    let what = "for comparison, the echo thread beside sinstruments: p50";
    table.ratio(what, &floor, &peer, micros, Aim::None);
}

fn ports(python: &Path, options: &Options, table: &Table) {
    let (own_dir, peer_dir) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let (sim, own) = many(&own_dir, PORTS, &INSTANT);
    let (server, peer) = peers(python, &peer_dir, PORTS);
    let mut own_poller = Poller::open(&own, POLL_PERIOD);
    let mut peer_poller = Poller::open(&peer, POLL_PERIOD);
    let (mut own, mut peer) = (Polling::default(), Polling::default());
    for _ in 0..options.count(10, 1) {
        polls(&sim, &mut own_poller, options, &mut own);
        polls(&server, &mut peer_poller, options, &mut peer);
    }
    let what = format!("{PORTS} ports polled at 20 Hz, beside as many of sinstruments: p99");
    table.ratio(&what, &own.tails, &peer.tails, millis, Aim::None);
    table.ratio(
        "the same, processor",
        &own.shares,
        &peer.shares,
        percent,
        Aim::None,
    );
}
