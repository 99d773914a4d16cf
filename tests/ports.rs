//! Where and how ports are served: on the network, with permissions, set as the kernel sets them.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "a test fails by panicking, and clippy takes helpers for production code"
)]

mod harness;

use std::io::{Read as _, Write as _};
use std::net::TcpStream;
use std::os::unix::fs::{MetadataExt as _, PermissionsExt as _};
use std::path::PathBuf;

use harness::wire::frame;
use harness::{PATIENCE, Sim, command, run};
use rustix::fs::{Mode, OFlags};
use rustix::termios::{ControlModes, OptionalActions, tcgetattr, tcsetattr};

const JSON: [&str; 2] = ["--log-format", "json"];

/// Serves with these arguments alone; returns the first port's URL, too.
fn serve(args: &[&str]) -> (Sim, String) {
    let mut command = command();
    command.args(["--seed", "1"]).args(JSON).args(args);
    let sim = Sim::spawn(&mut command, PathBuf::new(), None);
    sim.wait_ready();
    let ready = sim.wait_event("ready");
    let path = ready["ports"][0]["path"].as_str().unwrap().to_owned();
    (sim, path)
}

fn connect(url: &str) -> TcpStream {
    let (_, address) = url.split_once("://").unwrap();
    let client = TcpStream::connect(address).unwrap();
    client.set_read_timeout(Some(PATIENCE)).unwrap();
    client
}

fn ask(client: &mut TcpStream) {
    client.write_all(&frame(0x07, &[])).unwrap();
    let mut reply = [0; 7];
    client.read_exact(&mut reply).unwrap();
    assert_eq!(reply[..], frame(0x07, &[1]));
}

#[test]
fn clients_reach_it_over_the_network_one_after_another() {
    let (sim, url) = serve(&["--listen", "tcp://127.0.0.1:0"]);
    assert!(
        url.starts_with("tcp://127.0.0.1:") && !url.ends_with(":0"),
        "{url}"
    );
    for _ in 0..20 {
        ask(&mut connect(&url));
    }
    let summary = sim.stop().expect_clean().summary();
    assert_eq!(summary["requests"], 20);
    assert_eq!(summary["ports"][0]["attached"], 20);
}

#[test]
fn a_rig_may_listen_for_any_link() {
    let dir = tempfile::tempdir().unwrap();
    let file = dir.path().join("rig.toml");
    let rig = "schema = 1\n[[device]]\nkind = \"r150\"\nport = \"tcp://127.0.0.1:0\"\n\
               [[device]]\nkind = \"mecanum\"\nport = \"rfc2217://127.0.0.1:0\"\n";
    std::fs::write(&file, rig).unwrap();
    let (sim, url) = serve(&["--rig", file.to_str().unwrap()]);
    ask(&mut connect(&url));
    let ready = sim.wait_event("ready");
    let car = ready["ports"][1]["path"].as_str().unwrap();
    assert!(car.starts_with("rfc2217://"), "{car}");
    let mut heard = [0; 64];
    // Telnet's opening, and then a status.
    connect(car).read_exact(&mut heard).unwrap();
    assert_eq!(heard[0], 255);
    sim.stop().expect_clean();
}

#[test]
fn a_scenario_may_listen_and_its_client_finds_where() {
    let dir = tempfile::tempdir().unwrap();
    let scenario = "schema = 1\ntitle = \"T\"\ngood_client = \"Any.\"\nlimit = \"1 s\"\n\
                    [[device]]\nkind = \"r150\"\nport = \"tcp://127.0.0.1:0\"\n";
    std::fs::write(dir.path().join("s.toml"), scenario).unwrap();
    // Asks for a sign of life.
    let client = "exec 3<>/dev/tcp/${SIM_R150_PORT#tcp://127.0.0.1:} && \
                  printf '\\252\\125\\000\\007\\307\\204' >&3 && head -c 7 <&3 | od -An -tx1; exit 1"
        .replace("/dev/tcp/", "/dev/tcp/127.0.0.1/");
    let run = |time| {
        let mut command = command();
        let args = ["run", "--time", time, "s.toml", "--", "bash", "-c", &client];
        command.args(args).current_dir(dir.path());
        Sim::spawn(&mut command, PathBuf::new(), None).wait()
    };
    let real = run("real");
    assert!(real.out.contains("aa 55 01 07 01 c6 53"), "{}", real.out);
    let lockstep = run("lockstep");
    assert_eq!(lockstep.code(), Some(3), "{}", lockstep.out);
    for part in ["tcp://127.0.0.1:0", "--time real"] {
        assert!(lockstep.out.contains(part), "{}", lockstep.out);
    }

    let file = dir.path().join("s.toml");
    let (sim, url) = serve(&["--scenario", file.to_str().unwrap()]);
    assert!(url.starts_with("tcp://127.0.0.1:"), "{url}");
    ask(&mut connect(&url));
    // It ends by itself.
    sim.wait();
}

#[test]
fn an_address_that_others_reach_is_warned_of_and_a_wrong_one_refused() {
    let mut command = command();
    command.args(["--listen", "tcp://0.0.0.0:0"]);
    let sim = Sim::spawn(&mut command, PathBuf::new(), None);
    sim.wait_ready();
    sim.wait_line(&["warning", "127.0.0.1"]);
    sim.stop().expect_clean();
    for url in ["/tmp/r150", "tcp://127.0.0.1", "http://127.0.0.1:80"] {
        run(&["--listen", url]).expect_refusal(2, &["--listen", "://"]);
    }
    let dir = tempfile::tempdir().unwrap();
    let file = dir.path().join("rig.toml");
    let rig = "schema = 1\n[[device]]\nkind = \"r150\"\nport = \"tcp://127.0.0.1\"\n";
    std::fs::write(&file, rig).unwrap();
    let refused = run(&["--rig", file.to_str().unwrap()]);
    refused.expect_refusal(3, &["lacks a host or a port"]);
}

#[test]
fn who_may_open_it_can_be_said() {
    let group = rustix::process::getegid().as_raw().to_string();
    let sim = Sim::start(&["--mode", "660", "--group", &group]);
    let found = std::fs::metadata(sim.port()).unwrap();
    assert_eq!(found.permissions().mode() & 0o777, 0o660);
    assert_eq!(found.gid().to_string(), group);
    sim.stop().expect_clean();
    run(&["--pty", "/tmp/x", "--mode", "999"]).expect_refusal(2, &["--mode", "octal"]);
    run(&["--pty", "/tmp/x", "--group", "no such"]).expect_refusal(2, &["--group", "/etc/group"]);
}

#[test]
fn a_client_that_forgets_to_set_the_port_up_fails_as_on_a_serial_port() {
    let sim = Sim::start(&[&JSON[..], &["--tty-defaults", "kernel"]].concat());
    let flags = OFlags::RDWR | OFlags::NOCTTY;
    let client = rustix::fs::open(sim.port(), flags, Mode::empty()).unwrap();
    assert_eq!(tcgetattr(&client).unwrap().output_speed(), 9_600);
    rustix::io::write(&client, &frame(0x07, &[])).unwrap();
    sim.wait_event("line_not_raw");
    sim.wait_event("baud_mismatch");
    drop(client);
    sim.wait_event("client_detached");
    // One that does set it up is served.
    assert_eq!(sim.client().ask(0x07, &[]), [1]);
    sim.stop().expect_clean();
}

#[test]
fn what_the_cable_would_spoil_is_reported() {
    let sim = Sim::start(&JSON);
    let flags = OFlags::RDWR | OFlags::NOCTTY;
    let client = rustix::fs::open(sim.port(), flags, Mode::empty()).unwrap();
    let mut termios = tcgetattr(&client).unwrap();
    termios.control_modes |= ControlModes::PARENB | ControlModes::PARODD | ControlModes::CRTSCTS;
    tcsetattr(&client, OptionalActions::Now, &termios).unwrap();
    rustix::io::write(&client, &frame(0x07, &[])).unwrap();
    for (code, word) in [("parity", "8N1"), ("flow_control", "CRTSCTS")] {
        let said = sim.wait_event(code);
        assert!(said["text"].as_str().unwrap().contains(word), "{said}");
    }
    drop(client);
    let summary = sim.stop().expect_clean().summary();
    let events = summary["events"].as_array().unwrap();
    for code in ["parity", "flow_control"] {
        assert_eq!(harness::with_code(events, code)[0]["client_faults"], 1);
    }
}
