//! The whole program in real time, over real pseudo-terminals: `cargo bench --bench served`.
#![allow(
    clippy::unwrap_used,
    clippy::cast_precision_loss,
    reason = "a benchmark ends at the first surprise, and its counts are small"
)]

mod support;

use std::process::Command;
use std::time::{Duration, Instant};

use support::client::{Client, Poller};
use support::process::{Echo, SIM, Server};
use support::serving::{
    Conversation, INSTANT, POLL_PERIOD, PORTS, Polling, echoed, heartbeat, many, median_and_tail,
    motors, polls, system_info,
};
use support::{Aim, Figures, Options, Table, alternate, mebibytes, micros, millis, percent};

fn main() {
    let options = Options::read();
    let table = Table::begin("The whole program in real time", &options);
    if options.wants("latency") {
        latency(&options, &table);
    }
    if options.wants("ports") {
        ports(&options, &table);
    }
    if options.wants("ready") {
        ready(&options, &table);
    }
    if options.wants("memory") {
        memory(&options, &table);
    }
    if options.wants("idle") {
        idle(&options, &table);
    }
}

fn latency(options: &Options, table: &Table) {
    let echo = Echo::start();
    let (poll, drive) = (echoed(&heartbeat()), echoed(&motors()));
    let floor = Conversation::new(Client::open(echo.path()), poll, drive);
    let what = "request to reply, vehicle driving, instant wire, beside an echo thread";
    let aims = [Aim::AtMost(1.3), Aim::AtMost(2.0)];
    latency_beside(what, floor, aims, options, table);
    if let Some(other) = options.beside() {
        let dir = tempfile::tempdir().unwrap();
        let (_sim, floor) = driving(&dir, other);
        let what = "the same, beside the other build";
        latency_beside(what, floor, [Aim::None; 2], options, table);
    }
}

fn latency_beside(
    what: &str,
    mut floor: Conversation,
    [median_aim, tail_aim]: [Aim; 2],
    options: &Options,
    table: &Table,
) {
    let dir = tempfile::tempdir().unwrap();
    let (_sim, mut own) = driving(&dir, SIM);
    let requests = options.count(1000, 20);
    own.ask(requests);
    floor.ask(requests);
    let (mut own_tail, mut floor_tail) = (Figures::default(), Figures::default());
    let [own, floor] = alternate(
        options.count(150, 1),
        [
            &mut || median_and_tail(&own.ask(requests), &mut own_tail),
            &mut || median_and_tail(&floor.ask(requests), &mut floor_tail),
        ],
    );
    table.ratio(&format!("{what}: p50"), &own, &floor, micros, median_aim);
    table.ratio(
        &format!("{what}: p99"),
        &own_tail,
        &floor_tail,
        micros,
        tail_aim,
    );
}

/// A simulator and a client that drives its vehicle.
fn driving(dir: &tempfile::TempDir, program: &str) -> (Server, Conversation) {
    let port = dir.path().join("r150");
    let mut command = Command::new(program);
    command.arg("--pty").arg(&port).args(INSTANT);
    let sim = Server::start(&mut command);
    let client = Client::open(&port);
    (sim, Conversation::new(client, heartbeat(), motors()))
}

fn ports(options: &Options, table: &Table) {
    let dir = tempfile::tempdir().unwrap();
    let (sim, paths) = many(&dir, PORTS, &INSTANT);
    let mut poller = Poller::open(&paths, POLL_PERIOD);
    let mut polling = Polling::default();
    for _ in 0..options.count(10, 1) {
        polls(&sim, &mut poller, options, &mut polling);
    }
    let what = format!("{PORTS} ports polled at 20 Hz, vehicles driving: p99 of reply latency");
    table.figure(&what, &polling.tails, millis, Aim::AtMost(0.005));
    table.figure(
        "the same, processor",
        &polling.shares,
        percent,
        Aim::AtMost(1.0),
    );
}

fn ready(options: &Options, table: &Table) {
    let dir = tempfile::tempdir().unwrap();
    let port = dir.path().join("r150");
    let arguments = ["--pty", port.to_str().unwrap()];
    let [own] = alternate(
        options.count(30, 1),
        [&mut || {
            let start = Instant::now();
            let sim = Server::sim(&arguments);
            let taken = start.elapsed().as_secs_f64();
            drop(sim);
            taken
        }],
    );
    table.figure("start to `ready`", &own, millis, Aim::AtMost(0.020));
}

fn memory(options: &Options, table: &Table) {
    for (devices, mebi) in [(1, 16), (PORTS, 64)] {
        let dir = tempfile::tempdir().unwrap();
        let (sim, paths) = many(&dir, devices, &[]);
        let mut poller = Poller::open(&paths, POLL_PERIOD);
        poller.run(options.count(40, 2), &[system_info()]);
        let resident = Figures(vec![sim.resident_bytes()]);
        let plural = if devices == 1 { "" } else { "s" };
        let what = format!("resident memory with {devices} device{plural} after 2 s of polling");
        let aim = Aim::AtMost(f64::from(mebi << 20));
        table.figure(&what, &resident, mebibytes, aim);
    }
}

fn idle(options: &Options, table: &Table) {
    let dir = tempfile::tempdir().unwrap();
    let (sim, _) = many(&dir, 1, &[]);
    // The vehicle settles on its wheels first.
    std::thread::sleep(Duration::from_secs(u64::from(!options.quick) * 3));
    let mut shares = Figures::default();
    for _ in 0..options.count(5, 1) {
        let (cpu, start) = (sim.cpu_seconds(), Instant::now());
        std::thread::sleep(Duration::from_millis(if options.quick { 50 } else { 2000 }));
        shares
            .0
            .push((sim.cpu_seconds() - cpu) / start.elapsed().as_secs_f64());
    }
    table.figure(
        "idle `sim --pty`, processor",
        &shares,
        percent,
        Aim::AtMost(0.01),
    );
}
