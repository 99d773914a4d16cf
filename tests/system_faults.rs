//! What the system does to the program: full disks, missing directories, limits, closed outputs.
//! `docs/reliability.md` lists what is promised of each, and where the rest is tested.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "a test fails by panicking, and clippy takes helpers for production code"
)]

mod harness;

use std::fs;
use std::os::unix::fs::{PermissionsExt as _, symlink};
use std::os::unix::process::CommandExt as _;
use std::path::{Path, PathBuf};
use std::process::Command;

use harness::{Finished, Sim, command, run, until};

const SCENARIO: &str = r#"
schema = 1
title = "Nothing happens"
good_client = "Does nothing."
limit = "5 s"
seed = 5

[[device]]
kind = "r150"

[[step]]
at = "10 ms"
every = "20 ms"
host = { send = "heartbeat" }
"#;

/// The binary's command line in the hands of a shell, which sets it up as `how` says and then
/// becomes it.
fn shell(how: &str, args: &[&str]) -> Command {
    let sim = command();
    let mut shell = Command::new("sh");
    shell
        .arg("-c")
        .arg(format!("exec 3>&- 4>&- 5>&- 6>&-; {how}"))
        .arg(sim.get_program())
        .args(args);
    shell
}

fn ended(command: &mut Command) -> Finished {
    Sim::spawn(command, PathBuf::new(), None).wait()
}

/// What stands in a folder.
fn names(folder: &Path) -> Vec<String> {
    let names = fs::read_dir(folder).unwrap();
    names
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .collect()
}

/// A folder with a scenario, and the path of the trace that a run of it makes in there.
fn scenario() -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("idle.toml"), SCENARIO).unwrap();
    let trace = folder.path().join("traces/idle.trace.jsonl");
    fs::create_dir(folder.path().join("traces")).unwrap();
    (folder, trace)
}

fn run_with_trace(folder: &Path) -> Finished {
    let args = ["run", "idle.toml", "--output", "traces"];
    ended(command().args(args).current_dir(folder))
}

/// Fails unless it ended as a system error, with these words beside the scenario's name.
fn expect_said(finished: &Finished, parts: &[&str]) {
    assert_eq!(finished.code(), Some(3), "{}{}", finished.out, finished.err);
    for part in parts {
        assert!(
            finished.out.contains(part),
            "no {part:?} in {}",
            finished.out
        );
    }
}

#[test]
fn a_trace_that_does_not_fit_on_the_disk_is_an_error() {
    let (folder, trace) = scenario();
    run_with_trace(folder.path()).expect_clean();
    assert!(fs::metadata(&trace).unwrap().len() > 10_000);
    fs::remove_file(&trace).unwrap();
    symlink("/dev/full", &trace).unwrap();
    let name = "idle.trace.jsonl; it is not complete";
    expect_said(&run_with_trace(folder.path()), &[name, "No space left"]);
}

#[test]
fn a_place_where_no_trace_can_be_written_is_an_error() {
    let (folder, trace) = scenario();
    fs::create_dir(&trace).unwrap();
    expect_said(
        &run_with_trace(folder.path()),
        &["cannot write the trace", "idle.trace.jsonl"],
    );
    // The kernel's own file systems take nothing from any user, as one that is mounted read-only.
    let idle = folder.path().join("idle.toml");
    let args = ["run", idle.to_str().unwrap(), "--output", "/proc/traces"];
    run(&args).expect_refusal(2, &["cannot make the folder /proc/traces"]);
    // A folder that is there, and in which no user can make a file.
    let args = ["run", idle.to_str().unwrap(), "--output", "/sys/kernel"];
    run(&args).expect_refusal(2, &["cannot write into the folder /sys/kernel"]);
    let report = [
        "run",
        idle.to_str().unwrap(),
        "--junit",
        "/sys/kernel/report.xml",
    ];
    run(&report).expect_refusal(2, &["cannot write /sys/kernel/report.xml"]);
}

#[test]
fn a_folder_that_takes_no_link_is_an_error() {
    let says = ["/proc/r150"];
    run(&["--pty", "/proc/r150"]).expect_refusal(3, &says);
}

#[test]
fn a_link_that_is_removed_stays_removed_and_its_client_is_served() {
    let sim = Sim::start(&[]);
    let mut client = sim.client();
    fs::remove_file(sim.port()).unwrap();
    for _ in 0..3 {
        assert_eq!(client.ask(0x07, &[]), [1]);
    }
    assert!(fs::symlink_metadata(sim.port()).is_err());
    sim.stop().expect_clean();
}

#[test]
fn a_folder_that_is_removed_with_its_link_harms_no_client() {
    let above = tempfile::tempdir().unwrap();
    let folder = above.path().join("ports");
    fs::create_dir(&folder).unwrap();
    let sim = Sim::start_at(&folder.join("r150"), &[]);
    let mut client = sim.client();
    fs::remove_dir_all(&folder).unwrap();
    assert_eq!(client.ask(0x07, &[]), [1]);
    drop(client);
    sim.wait_line(&["client detached"]);
    sim.stop().expect_clean();
    assert!(names(above.path()).is_empty());
}

#[test]
fn what_is_made_in_the_place_of_the_link_stays() {
    let folder = tempfile::tempdir().unwrap();
    let port = folder.path().join("r150");
    let sim = Sim::start_at(&port, &[]);
    fs::remove_file(&port).unwrap();
    fs::write(&port, "precious").unwrap();
    sim.stop().expect_clean();
    assert_eq!(fs::read_to_string(&port).unwrap(), "precious");
}

#[test]
fn with_any_limit_of_file_descriptors_it_serves_or_says_why_not() {
    let folder = tempfile::tempdir().unwrap();
    let port = folder.path().join("r150");
    let path = port.to_str().unwrap();
    let mut served = 0;
    let mut refused = 0;
    for limit in 4..24 {
        let how = format!("ulimit -n {limit} && exec \"$0\" \"$@\"");
        let args = ["--pty", path, "--seed", "1"];
        let sim = Sim::spawn(&mut shell(&how, &args), port.clone(), None);
        let mut said = String::new();
        until("it is ready or ends", || {
            said = sim.printed();
            said.contains("ready\n") || fs::read_to_string(stat(sim.pid())).is_ok_and(is_zombie)
        });
        if said.contains("ready\n") {
            served += 1;
            for _ in 0..3 {
                assert_eq!(sim.client().ask(0x07, &[]), [1]);
            }
            sim.stop().expect_clean();
        } else {
            refused += 1;
            let finished = sim.wait();
            // So few that the program cannot even be loaded is the loader's to tell.
            if finished.code() != Some(127) {
                finished.expect_refusal(3, &["Too many open files"]);
            }
        }
        assert!(
            names(folder.path()).is_empty(),
            "{:?}",
            names(folder.path())
        );
    }
    assert!(
        served > 0 && refused > 0,
        "{served} served, {refused} refused"
    );
}

fn stat(pid: u32) -> PathBuf {
    PathBuf::from(format!("/proc/{pid}/stat"))
}

fn is_zombie(stat: String) -> bool {
    stat.rsplit_once(") ")
        .is_some_and(|(_, rest)| rest.starts_with('Z'))
}

#[test]
fn with_its_outputs_closed_it_serves() {
    let folder = tempfile::tempdir().unwrap();
    let port = folder.path().join("r150");
    let ready = folder.path().join("ready");
    let args = [
        "--pty",
        port.to_str().unwrap(),
        "--ready-file",
        ready.to_str().unwrap(),
        "-v",
    ];
    let how = "exec \"$0\" \"$@\" 0<&- 1>&- 2>&-";
    let sim = Sim::spawn(&mut shell(how, &args), port.clone(), None);
    until("it is ready", || ready.exists());
    // Were a port to take the place of an output, the log would come to the client.
    let mut client = sim.client();
    for _ in 0..20 {
        assert_eq!(client.ask(0x07, &[]), [1]);
    }
    assert_eq!(sim.stop().code(), Some(0));
    assert!(names(folder.path()).is_empty());
}

#[test]
fn with_its_log_on_a_full_disk_it_serves_and_says_so_at_the_end() {
    let folder = tempfile::tempdir().unwrap();
    let port = folder.path().join("r150");
    let ready = folder.path().join("ready");
    let args = [
        "--pty",
        port.to_str().unwrap(),
        "--ready-file",
        ready.to_str().unwrap(),
    ];
    let how = "exec \"$0\" \"$@\" >/dev/full";
    let sim = Sim::spawn(&mut shell(how, &args), port.clone(), None);
    until("it is ready", || ready.exists());
    assert_eq!(sim.client().ask(0x07, &[]), [1]);
    let finished = sim.stop();
    assert_eq!(finished.code(), Some(0), "{}", finished.err);
    assert!(finished.err.contains("No space left"), "{}", finished.err);
}

#[test]
fn what_cannot_be_printed_is_an_error_where_printing_is_the_point() {
    let (folder, _) = scenario();
    for args in [
        &["config"][..],
        &["run", "idle.toml"],
        &["faults"],
        &["schema", "world"],
    ] {
        let how = "exec \"$0\" \"$@\" >/dev/full";
        let finished = ended(shell(how, args).current_dir(folder.path()));
        finished.expect_refusal(3, &["cannot print", "No space left"]);
    }
}

#[test]
fn an_endless_file_is_refused() {
    for args in [
        &["config", "--config", "/dev/zero"][..],
        &["check", "/dev/zero"],
        &["replay", "/dev/zero"],
        &["--rig", "/dev/zero"],
        &["--pty", "/tmp/never-made", "--world", "/dev/zero"],
    ] {
        run(args).expect_refusal(2, &["/dev/zero", "too long"]);
    }
}

#[test]
fn a_file_that_is_no_text_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("picture.toml");
    std::fs::write(&path, b"\x89PNG\r\n\x1a\n\xFF\xFE\n").unwrap();
    let file = path.to_str().unwrap();
    for args in [
        &["config", "--config", file][..],
        &["check", file],
        &["run", file],
        &["replay", file],
        &["--rig", file],
        &["--pty", "/tmp/never-made", "--world", file],
    ] {
        run(args).expect_refusal(2, &[file, "UTF-8"]);
    }
}

/// A shell's words before the program: its standard output goes to a file beside.
const QUIETLY: &str = "exec \"$0\" \"$@\" > out.txt";

#[test]
fn a_limit_of_file_sizes_is_a_full_disk() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("s.toml"), SCENARIO).unwrap();
    let args = ["run", "--output", "o", "--junit", "r.xml", "s.toml"];
    let how = format!("ulimit -f 4 && {QUIETLY}");
    let ended = ended(shell(&how, &args).current_dir(folder.path()));
    ended.expect_refusal(3, &[]);
    let said = fs::read_to_string(folder.path().join("out.txt")).unwrap();
    assert!(said.contains("cannot write the trace"), "{said}");
    assert!(said.contains("File too large"), "{said}");
    // The client has the limit, too, and the usual end of it.
    let client = [
        "--",
        "sh",
        "-c",
        "exec 3<>\"$SIM_R150_PORT\"; head -c 99999 /dev/zero > big",
    ];
    let args = [&["run", "s.toml"] as &[&str], &client].concat();
    let ended = Sim::spawn(
        shell(&how, &args).current_dir(folder.path()),
        PathBuf::new(),
        None,
    );
    assert_eq!(ended.wait().code(), Some(1));
}

#[test]
fn a_limit_of_threads_means_fewer_at_a_time_or_an_error() {
    if !rustix::process::geteuid().is_root() {
        // The limit counts all that a user runs, and root alone can become one who runs nothing.
        harness::report_skipped("limits of threads", "only root can become another user");
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("s.toml"), SCENARIO).unwrap();
    let sim = harness::unprivileged::copy_of_sim(folder.path());
    fs::set_permissions(folder.path(), fs::Permissions::from_mode(0o777)).unwrap();
    let user = 1_000_000 + std::process::id();
    let limited = |threads: u32, args: &[&str]| {
        let mut bash = Command::new("bash");
        let how = format!("ulimit -u {threads} && exec \"$0\" \"$@\"");
        bash.args(["-c", &how]).arg(&sim).args(args).uid(user);
        ended(bash.current_dir(folder.path()))
    };
    let run = ["run", "-j", "8", "--repeat", "200", "s.toml"];
    let fewer = limited(4, &run);
    assert_eq!(fewer.code(), Some(0), "{}{}", fewer.out, fewer.err);
    assert!(fewer.out.contains("200 passed, 0 failed"), "{}", fewer.out);
    let said = "2 at a time instead of 8: the system makes no more threads";
    assert!(fewer.err.contains(said), "{}", fewer.err);
    for (threads, args, why) in [
        (2, &run[..], "cannot start a thread to play in"),
        (1, &run, "cannot start the thread that waits for signals"),
        (1, &["--pty", "p"], "cannot start the thread that prints"),
    ] {
        limited(threads, args).expect_refusal(3, &[why]);
    }
    assert_eq!(names(folder.path()).len(), 2);
}

#[test]
fn the_limit_of_processor_time_ends_it_well() {
    let folder = tempfile::tempdir().unwrap();
    let sim = Sim::start_at(&folder.path().join("r150"), &[]);
    // What the system sends when the limit is reached.
    sim.signal(rustix::process::Signal::XCPU);
    sim.wait().expect_clean();
    assert!(names(folder.path()).is_empty());
}

#[test]
fn a_soft_limit_of_descriptors_does_not_stop_many_ports() {
    let folder = tempfile::tempdir().unwrap();
    let device = "[[device]]\nkind = \"r150\"\n";
    let far = |n: usize| {
        format!("{device}name = \"v{n}\"\npose = {{ x = \"{n} m\" }}\nport = \"p{n}\"\n")
    };
    let devices: String = (0..120).map(|n| far(3 * n)).collect();
    fs::write(
        folder.path().join("rig.toml"),
        format!("schema = 1\n{devices}"),
    )
    .unwrap();
    let how = "ulimit -Sn 64 && exec \"$0\" \"$@\"";
    let mut command = shell(how, &["--rig", "rig.toml"]);
    let sim = Sim::spawn(command.current_dir(folder.path()), PathBuf::new(), None);
    sim.wait_ready();
    sim.stop().expect_clean();
}
