//! Files, names and clients that are as bad as they can be: none of them costs another's result.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "a test fails by panicking, and clippy takes helpers for production code"
)]

mod harness;

use std::ffi::OsStr;
use std::fs;
use std::os::unix::ffi::OsStrExt as _;
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use rustix::process::{Pid, Signal};

use harness::live::is_running;
use harness::wire::frame;
use harness::{Finished, PATIENCE, Sim, command, until};

/// A scenario of an hour with these steps.
fn scenario(title: &str, steps: &str) -> String {
    format!(
        "schema = 1\ntitle = \"{title}\"\ngood_client = \"Any.\"\nlimit = \"1 h\"\n\n\
         [[device]]\nkind = \"r150\"\n\n{steps}"
    )
}

const HEARTBEATS: &str = r#"
[[step]]
at = "0 s"
every = "1 ns"
host = { send = "heartbeat" }
"#;

const BOXES: &str = r#"
[[step]]
at = "0 s"
world = { add = { box = [{ at_m = [3, 0], length = "1 m", width = "1 m", name = "box" }] } }

[[step]]
at = "0 s"
every = "1 us"
world = { move = { obstacle = "box", x = "3 m", y = "0 m" } }

[[step]]
at = "0 s"
count = 3000
every = "1 ns"
world = { add = { box = [{ at_m = [3, 0], length = "1 m", width = "1 m" }] } }
"#;

/// Runs the binary in a folder.
fn start(folder: &Path, args: &[&str]) -> Sim {
    Sim::spawn(
        command().current_dir(folder).args(args),
        PathBuf::new(),
        None,
    )
}

#[test]
fn the_time_allowed_and_signals_hold_in_files_that_have_something_every_nanosecond() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    fs::write(folder.join("beats.toml"), scenario("Beats", HEARTBEATS)).unwrap();
    fs::write(folder.join("boxes.toml"), scenario("Boxes", BOXES)).unwrap();
    let client = ["--", "sh", "-c", "exec 3<>$SIM_R150_PORT; sleep 0.1"];
    for file in ["beats.toml", "boxes.toml"] {
        for client in [&[] as &[&str], &client] {
            let ended = start(
                folder,
                &[&["run", "--timeout", "1s", file], client].concat(),
            )
            .wait();
            // In real time it may well be the machine's fault that there is so much to compute.
            let code = ended.code();
            let is_live = !client.is_empty();
            assert!(
                code == Some(3) || is_live && code == Some(1),
                "{}{}",
                ended.out,
                ended.err
            );
            // In lockstep the time of the processor counts, with real time behind it.
            let whys = ["1s of real time", "1s of processor time"];
            let is_why = |why: &&str| ended.out.contains(why);
            assert!(ended.out.contains("still running after"), "{}", ended.out);
            assert!(whys.iter().any(is_why), "{}", ended.out);
        }
        let sim = start(folder, &["run", "--output", "out", file]);
        harness::until("it has begun", || {
            folder
                .join(format!("out/{}", file.replace(".toml", ".trace.jsonl")))
                .exists()
        });
        sim.signal(Signal::INT);
        let ended = sim.wait();
        assert_eq!(ended.code(), Some(3), "{}{}", ended.out, ended.err);
        assert!(ended.out.contains("1 aborted"), "{}", ended.out);
        fs::remove_dir_all(folder.join("out")).unwrap();
    }
}

/// To play a recording again takes longer than what was recorded, where so much happens.
#[test]
fn a_report_takes_no_longer_than_its_scenario_may() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    fs::write(folder.join("beats.toml"), scenario("Beats", HEARTBEATS)).unwrap();
    harness::until("its picture is given up", || {
        let args = ["run", "--timeout", "1s", "--report", "r.html", "beats.toml"];
        let ended = start(folder, &args).wait();
        assert_eq!(ended.code(), Some(3), "{}{}", ended.out, ended.err);
        let page = fs::read_to_string(folder.join("r.html")).unwrap();
        assert!(page.contains("still running after the 1s"), "{page}");
        page.contains("which took too long")
    });
}

/// Bytes for the client whose loss is in the log.
fn reported_lost(log: &str) -> usize {
    let lines = harness::json_lines(log);
    let events = ["line_full", "overrun"].map(|code| harness::with_code(&lines, code));
    let bytes = |event: &serde_json::Value| {
        let mut words = event["text"].as_str()?.split(' ');
        words.find_map(|word| word.parse::<usize>().ok())
    };
    events.iter().flatten().filter_map(bytes).sum()
}

#[test]
fn what_comes_all_at_once_is_counted_to_the_last() {
    const REQUESTS: u64 = 3000;
    let sim = Sim::start(&["--wire", "instant", "--log-format", "json"]);
    let mut client = sim.client();
    let request = frame(0x07, &[]);
    let mut sent = 0;
    let mut received = 0;
    let all = request.repeat(usize::try_from(REQUESTS).unwrap());
    harness::until("every reply has come, or its loss was reported", || {
        if sent < all.len() {
            sent += client.send_some(&all[sent..]);
        }
        received += client.read_for(Duration::from_millis(1)).len();
        received + reported_lost(&sim.printed()) == all.len() / 6 * 7
    });
    drop(client);
    sim.wait_event("client_detached");
    let finished = sim.stop();
    let summary = finished.expect_clean().summary();
    assert_eq!(summary["requests"].as_u64(), Some(REQUESTS), "{summary}");
    assert_eq!(summary["replies"].as_u64(), Some(REQUESTS), "{summary}");
}

/// A scenario of half a second that passes.
fn short(title: &str) -> String {
    scenario(title, "").replace("1 h", "500 ms")
}

/// A JUnit file, which must be well-formed.
fn junit(path: &Path) -> String {
    let text = fs::read_to_string(path).unwrap();
    let mut reader = quick_xml::Reader::from_str(&text);
    loop {
        match reader.read_event().unwrap() {
            quick_xml::events::Event::Eof => break,
            quick_xml::events::Event::Text(text) => {
                text.xml10_content().unwrap();
            }
            _ => {}
        }
    }
    let forbidden = |c: char| {
        c < ' ' && !matches!(c, '\t' | '\n' | '\r') || matches!(c, '\u{fffe}' | '\u{ffff}')
    };
    assert!(!text.contains(forbidden), "{text}");
    text
}

#[test]
fn names_that_are_no_text_are_names() {
    let folder = tempfile::tempdir().unwrap();
    let odd = OsStr::from_bytes(b"o\xffdd");
    let folder = folder.path().join(odd);
    fs::create_dir(&folder).unwrap();
    let file = OsStr::from_bytes(b"s\xfe.toml");
    fs::write(folder.join(file), short("Odd")).unwrap();
    fs::write(folder.join("plain.toml"), short("Plain")).unwrap();
    let rig = "schema = 1\n[[device]]\nkind = \"r150\"\nport = \"port\"\n";
    fs::write(folder.join("rig.toml"), rig).unwrap();

    let mut run = command();
    run.arg("run").arg("--output").arg(folder.join(odd));
    run.arg("--junit")
        .arg(folder.join(OsStr::from_bytes(b"\xff.xml")));
    run.arg(folder.join(file)).arg(folder.join("plain.toml"));
    let client = "case \"$SIM_SCENARIO\" in *.toml) exec 3<>\"$SIM_R150_PORT\";; esac";
    for client in [&[] as &[&str], &["--", "sh", "-c", client]] {
        let ended = Sim::spawn(run.args(client), PathBuf::new(), None).wait();
        assert_eq!(ended.code(), Some(0), "{}{}", ended.out, ended.err);
        assert!(ended.out.contains("s\\xfe.toml: Odd"), "{}", ended.out);
        let results = junit(&folder.join(OsStr::from_bytes(b"\xff.xml")));
        assert!(
            results.contains("tests=\"2\" failures=\"0\" errors=\"0\""),
            "{results}"
        );
        let reports = fs::read_dir(folder.join(odd)).unwrap();
        assert_eq!(reports.count(), if client.is_empty() { 4 } else { 6 });
    }

    for args in [["--pty", "p\u{e9}"], ["--rig", "rig.toml"]] {
        let mut serve = command();
        serve.arg(args[0]).arg(folder.join(args[1]));
        serve
            .arg("--ready-file")
            .arg(folder.join(odd).join("ready"));
        let sim = Sim::spawn(&mut serve, PathBuf::new(), None);
        sim.wait_line(&["o\\xffdd/p"]);
        sim.wait_ready();
        sim.stop().expect_clean();
    }
}

#[test]
fn what_goes_wrong_in_one_scenario_is_its_error_alone() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    for name in ["a", "b", "c"] {
        fs::write(folder.join(format!("{name}.toml")), short(name)).unwrap();
    }
    // Something that no report can replace.
    fs::create_dir_all(folder.join("out/b.report.json/full")).unwrap();
    let args = ["run", "--junit", "r.xml", "--output", "out", "."];
    let ended = start(folder, &args).wait();
    assert_eq!(ended.code(), Some(3), "{}{}", ended.out, ended.err);
    assert!(
        ended
            .out
            .contains("ERROR   ./b.toml: cannot write the report"),
        "{}",
        ended.out
    );
    assert!(
        ended.out.contains("2 passed, 0 failed, 0 skipped, 1 error"),
        "{}",
        ended.out
    );
    let results = junit(&folder.join("r.xml"));
    assert!(
        results.contains("tests=\"3\" failures=\"0\" errors=\"1\""),
        "{results}"
    );
}

#[test]
fn a_killed_run_leaves_the_results_that_it_had() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    fs::write(folder.join("a.toml"), short("Known")).unwrap();
    fs::write(folder.join("b.toml"), scenario("Endless", HEARTBEATS)).unwrap();
    let sim = start(
        folder,
        &["run", "-j", "1", "--junit", "r.xml", "a.toml", "b.toml"],
    );
    sim.wait_line(&["passed", "a.toml"]);
    // Before it, both count as missing.
    let known = "tests=\"2\" failures=\"0\" errors=\"1\"";
    harness::until("it is in the file", || {
        junit(&folder.join("r.xml")).contains(known)
    });
    sim.signal(Signal::KILL);
    sim.wait();
    let results = junit(&folder.join("r.xml"));
    let missing = results.matches("type=\"missing\"").count();
    assert!(results.contains(known) && missing == 1, "{results}");
    assert_eq!(fs::read_dir(folder).unwrap().count(), 3);
}

/// An option that names a path to be written.
struct Written {
    /// `@` stands for the folder in which it is.
    args: &'static [&'static str],
    name: &'static str,
    refused: i32,
    /// It goes with the simulator, unless that is killed.
    goes: bool,
}

const WRITTEN: [Written; 8] = [
    Written {
        args: &["--pty", "@x"],
        name: "x",
        refused: 3,
        goes: true,
    },
    Written {
        args: &["--pty", "port", "--ready-file", "@x"],
        name: "x",
        refused: 2,
        goes: true,
    },
    Written {
        args: &["--pty", "port", "--trace", "@x"],
        name: "x",
        refused: 2,
        goes: false,
    },
    Written {
        args: &["run", "--junit", "@x", "a.toml"],
        name: "x",
        refused: 2,
        goes: false,
    },
    Written {
        args: &["run", "--report", "@x", "a.toml"],
        name: "x",
        refused: 2,
        goes: false,
    },
    Written {
        args: &["run", "--output", "@", "a.toml"],
        name: "a.trace.jsonl",
        refused: 3,
        goes: false,
    },
    Written {
        args: &["run", "--output", "@", "a.toml"],
        name: "a.report.json",
        refused: 3,
        goes: false,
    },
    Written {
        args: &[
            "run", "--output", "@", "--time", "real", "a.toml", "--", "true",
        ],
        name: "a.client.log",
        refused: 3,
        goes: false,
    },
];

impl Written {
    /// Runs the program, and ends it if it serves.
    fn play(&self, folder: &Path, place: &str, end: Signal) -> Finished {
        let args: Vec<String> = self
            .args
            .iter()
            .map(|arg| arg.replace('@', place))
            .collect();
        let args: Vec<&str> = args.iter().map(String::as_str).collect();
        let sim = start(folder, &args);
        if self.args[0] != "run" {
            until("it serves or has ended", || {
                let pid = Pid::from_raw(sim.pid().cast_signed()).unwrap();
                sim.printed().lines().any(|line| line == "ready") || !is_running(pid)
            });
            sim.signal(end);
        }
        sim.wait()
    }

    /// It must be made.
    fn expect_made(&self, folder: &Path, before: &str) {
        let path = folder.join("place").join(self.name);
        let ended = self.play(folder, "place/", Signal::INT);
        let said = format!("{:?} {before}: {}{}", self.args, ended.out, ended.err);
        // The client of one of them opens no port, for which there is no verdict.
        let code = if self.args.contains(&"true") { 3 } else { 0 };
        assert_eq!(ended.code(), Some(code), "{said}");
        assert!(!said.contains("left alone"), "{said}");
        assert_eq!(path.exists(), !self.goes, "{said}");
        let hidden: Vec<_> = names(&folder.join("place"))
            .into_iter()
            .filter(|name| name.starts_with('.'))
            .collect();
        assert!(hidden.is_empty(), "{said}{hidden:?}");
    }

    /// What is there must be left as it is.
    fn expect_refused(&self, folder: &Path, found: &str, part: &str) {
        let path = folder.join("place").join(self.name);
        let state = || {
            (
                names(&folder.join("place")),
                fs::read(&path).ok(),
                fs::read_link(&path).ok(),
            )
        };
        let before = state();
        let ended = self.play(folder, "place/", Signal::INT);
        let said = format!("{:?} on {found}: {}{}", self.args, ended.out, ended.err);
        assert_eq!(ended.code(), Some(self.refused), "{said}");
        assert!(said.contains(part), "{said}");
        assert_eq!(state(), before, "{said}");
    }
}

fn names(folder: &Path) -> Vec<String> {
    let entries = fs::read_dir(folder).unwrap();
    let mut names: Vec<String> = entries
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .collect();
    names.sort();
    names
}

#[test]
fn what_is_written_replaces_only_what_an_earlier_run_has_left() {
    for written in WRITTEN {
        let folder = tempfile::tempdir().unwrap();
        let folder = folder.path();
        let place = folder.join("place");
        let path = place.join(written.name);
        fs::write(folder.join("a.toml"), short("A")).unwrap();
        fs::create_dir(&place).unwrap();
        written.expect_made(folder, "where nothing is");

        let end = if written.goes {
            Signal::KILL
        } else {
            Signal::INT
        };
        written.play(folder, "place/", end);
        assert!(fs::symlink_metadata(&path).is_ok(), "{:?}", written.args);
        written.expect_made(folder, "in place of an earlier one");

        let is_link = written.args == ["--pty", "@x"];
        if !is_link {
            // As mktemp makes it.
            fs::write(&path, "").unwrap();
            written.expect_made(folder, "in place of an empty file");
        }
        let empty = || {
            fs::remove_dir_all(&place).unwrap();
            fs::create_dir(&place).unwrap();
        };
        if !written.goes {
            let earlier = folder.join("earlier");
            fs::rename(&path, &earlier).unwrap();
            empty();
            symlink(&earlier, &path).unwrap();
            written.expect_refused(folder, "a link to an earlier one", "a symbolic link");
        }
        empty();
        fs::write(&path, "precious").unwrap();
        written.expect_refused(folder, "a file", "a regular file");
        fs::write(folder.join("precious"), "precious").unwrap();
        for target in ["precious", "missing"] {
            empty();
            symlink(folder.join(target), &path).unwrap();
            written.expect_refused(folder, "a link", "a symbolic link");
            assert!(!folder.join("missing").exists());
            assert_eq!(fs::read(folder.join("precious")).unwrap(), b"precious");
        }
        empty();
        fs::create_dir(&path).unwrap();
        written.expect_refused(folder, "a folder", "a directory");

        // The kernel's own file systems take nothing from any user.
        let ended = written.play(folder, "/sys/kernel/", Signal::INT);
        let said = format!("{:?}: {}{}", written.args, ended.out, ended.err);
        assert!([2, 3].map(Some).contains(&ended.code()), "{said}");
        assert!(
            said.contains("cannot ") && said.contains("/sys/kernel"),
            "{said}"
        );
    }
}

/// Ports of a run that was killed are removed by the next one.
#[test]
fn a_killed_run_s_ports_go_with_the_next_run() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    fs::write(folder.join("a.toml"), scenario("A", "")).unwrap();
    fs::write(folder.join("b.toml"), short("B")).unwrap();
    let ports = folder.join(format!("sim-{}", rustix::process::geteuid().as_raw()));
    let with = |args: &[&str]| {
        let mut command = command();
        command.current_dir(folder).env("TMPDIR", folder);
        Sim::spawn(command.args(args), PathBuf::new(), None)
    };
    for time in ["real", "lockstep"] {
        let client = "exec 3<>$SIM_R150_PORT; echo > there; sleep 1000";
        let run = with(&["run", "--time", time, "a.toml", "--", "sh", "-c", client]);
        until("the client is there", || folder.join("there").exists());
        assert_eq!(names(&ports).len(), 2, "{:?}", names(&ports));
        run.signal(Signal::KILL);
        run.wait();
        assert_eq!(names(&ports).len(), 2);
        let ended = with(&["run", "b.toml"]).wait();
        assert_eq!(ended.code(), Some(0), "{}{}", ended.out, ended.err);
        assert!(names(&ports).is_empty(), "{:?}", names(&ports));
        fs::remove_file(folder.join("there")).unwrap();
    }
}

#[test]
fn results_go_into_pipes() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    fs::write(folder.join("a.toml"), short("A")).unwrap();
    // A pipe without a reader is an error, and standard output is a pipe here.
    rustix::fs::mknodat(
        rustix::fs::CWD,
        folder.join("pipe"),
        rustix::fs::FileType::Fifo,
        rustix::fs::Mode::RUSR | rustix::fs::Mode::WUSR,
        0,
    )
    .unwrap();
    let ended = start(folder, &["run", "--junit", "pipe", "a.toml"]).wait();
    ended.expect_refusal(2, &["cannot write pipe"]);
    let ended = start(folder, &["run", "--report", "pipe", "a.toml"]).wait();
    ended.expect_refusal(2, &["cannot write pipe"]);
    let ended = start(folder, &["--pty", "port", "--trace", "pipe"]).wait();
    ended.expect_refusal(2, &["cannot write the trace pipe"]);
    for (flag, end) in [("--junit", "</testsuites>"), ("--report", "</html>")] {
        let ended = start(folder, &["run", flag, "/dev/stdout", "a.toml"]).wait();
        assert!(ended.out.contains(end), "{}", ended.out);
    }
}

#[test]
fn nothing_that_is_written_or_printed_commands_a_terminal_or_breaks_a_document() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let bad = "\u{1b}]0;x\u{7}\u{1b}[2J\u{9b}2J\u{202e}\u{fffe}\u{ffff}";
    let escaped: String = bad
        .chars()
        .map(|c| format!("\\U{:08x}", c as u32))
        .collect();
    let steps = format!(
        "[[step]]\nname = \"s{escaped}\"\nat = \"1 ms\"\nexpect = {{ that = \"false\", message = \
         \"m\\n{escaped}\" }}\n[[step]]\nname = \"f{escaped}\"\nat = \"0 s\"\noptional = true\n\
         fault = {{ kind = \"mute\" }}\n"
    );
    let file = folder.join(format!("a{}.toml", bad.replace('/', "")));
    fs::write(&file, short(&format!("t\\n{escaped}")) + &steps).unwrap();
    fs::write(folder.join("client"), bad).unwrap();
    let client = "exec 3<>\"$SIM_R150_PORT\"; cat client; sleep 0.2; exit 1";
    let name = file.file_name().unwrap().to_str().unwrap();
    let safe = |text: &str| {
        let found = text
            .chars()
            .find(|c| !c.is_ascii_graphic() && bad.contains(*c));
        assert!(found.is_none(), "{found:?} in {text}");
        text.to_owned()
    };
    for client in [&[] as &[&str], &["--", "sh", "-c", client]] {
        for args in [
            ["run", "--list"],
            ["run", "--dry-run"],
            ["run", "--junit=r.xml"],
            ["run", "--report=r.html"],
        ] {
            let ended = start(folder, &[&args as &[&str], &[name], client].concat()).wait();
            let out = safe(&ended.out);
            assert!(out.contains("t\\n\\u{1b}]0;x"), "{out}");
            assert_eq!(
                out.lines().filter(|line| line.contains("t\\n")).count(),
                1,
                "{out}"
            );
            safe(&ended.err);
        }
        safe(&fs::read_to_string(folder.join("r.html")).unwrap());
        let results = safe(&junit(&folder.join("r.xml")));
        assert!(results.contains("m\\n\\u{1b}]0;x") || results.contains("\\u{1b}]0;x"));
    }
    let sim = start(folder, &["--scenario", name, "--pty", "p"]);
    sim.wait_ready();
    safe(&sim.stop().out);
    let sim = start(
        folder,
        &["--scenario", name, "--pty", "p", "--log-format", "json"],
    );
    sim.wait_ready();
    safe(&sim.stop().out);
    fs::write(&file, "schema = 1\n\"\u{202e}\" = 1").unwrap();
    let ended = start(folder, &["check", name]).wait();
    assert_eq!(ended.code(), Some(2));
    safe(&ended.err);
}

#[test]
fn words_of_the_command_line_are_shown_and_not_obeyed() {
    let folder = tempfile::tempdir().unwrap();
    let bad = "\u{1b}]0;x\u{7}\u{9b}2J\u{202e}";
    for args in [
        &["BAD"] as &[&str],
        &["--BAD"],
        &["-BAD"],
        &["--seed=BAD"],
        &["--pty", "p", "--wire", "BAD"],
        &["--pty", "p", "--set", "BAD=1"],
        &["--pty", "p", "--set", "r150.over_rate=BAD"],
        &["--pty", "p", "--config", "BAD"],
        &["--pty", "BAD/p"],
        &["--listen", "tcp://BAD"],
        &["--rig", "BAD"],
        &["faults", "--device", "BAD"],
        &["schema", "BAD"],
        &["run", "BAD"],
        &["run", "--jobs=BAD", "x"],
        &["run", "--timeout", "BAD", "x"],
        &["run", "--tag", "BAD", "x"],
        &["check", "BAD"],
        &["replay", "BAD"],
        &["trace", "BAD"],
    ] {
        let words: Vec<String> = args.iter().map(|word| word.replace("BAD", bad)).collect();
        let words: Vec<&str> = words.iter().map(String::as_str).collect();
        let ended = start(folder.path(), &words).wait();
        assert!(matches!(ended.code(), Some(2 | 3)), "{args:?}");
        let all = ended.out + &ended.err;
        let obeyed = |c: char| !c.is_ascii_graphic() && bad.contains(c);
        assert!(!all.is_empty() && !all.contains(obeyed), "{args:?}: {all}");
    }
    let ended = start(folder.path(), &["--\u{1b}[2J"]).wait();
    ended.expect_refusal(2, &["'--\\u{1b}[2J'"]);
}

#[test]
fn errors_and_ends_of_what_is_no_file_no_path_or_too_long() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let fifo = folder.join("pipe");
    let mode = rustix::fs::Mode::RUSR | rustix::fs::Mode::WUSR;
    rustix::fs::mknodat(rustix::fs::CWD, &fifo, rustix::fs::FileType::Fifo, mode, 0).unwrap();
    // No program writes to it.
    let waiting = [
        (&["check", "pipe"][..], "scenario file pipe"),
        (&["--pty", "p", "--world", "pipe"], "world file pipe"),
        (&["replay", "pipe"], "the trace pipe"),
        (&["trace", "pipe"], "the trace pipe"),
    ]
    .map(|(args, what)| (start(folder, args), what));
    for (started, what) in waiting {
        started.wait().expect_refusal(2, &[what, "nothing more"]);
    }
    // One does, as a shell's <(…).
    let text = short("Piped");
    let writer = std::thread::spawn(move || fs::write(fifo, text).unwrap());
    let ended = start(folder, &["check", "pipe"]).wait();
    assert_eq!(ended.code(), Some(0), "{}{}", ended.out, ended.err);
    writer.join().unwrap();
    // Names of results begin with a digest where the path is too long for one, and no character is cut.
    let long = ["\u{8f66}".repeat(78), "a".repeat(2)].concat();
    for name in [&long, &format!("b{long}"), &format!("bb{long}")] {
        fs::write(folder.join(format!("{name}.toml")), short("Long")).unwrap();
        let args = ["run", "--output", "long", &format!("{name}.toml")];
        let ended = start(folder, &args).wait();
        assert_eq!(ended.code(), Some(0), "{}{}", ended.out, ended.err);
    }
    let names = fs::read_dir(folder.join("long")).unwrap();
    let names: Vec<_> = names.map(|entry| entry.unwrap().file_name()).collect();
    assert_eq!(names.len(), 6, "{names:?}");
    assert!(
        names.iter().all(|name| name.to_str().is_some()),
        "{names:?}"
    );

    start(folder, &["--pty", "new/"])
        .wait()
        .expect_refusal(3, &["does not name a file"]);
    let mut long = folder.to_owned();
    while long.as_os_str().len() < 4080 {
        long.push("x");
    }
    fs::create_dir_all(&long).unwrap();
    let long = long.join("y".repeat(100));
    let ended = start(folder, &["--pty", long.to_str().unwrap()]).wait();
    ended.expect_refusal(3, &["longer than"]);

    // A link that another program has made, to a terminal that is gone.
    symlink("/dev/pts/4294967", folder.join("theirs")).unwrap();
    start(folder, &["--pty", "theirs"])
        .wait()
        .expect_refusal(3, &["left alone"]);
    assert!(fs::read_link(folder.join("theirs")).is_ok());

    let set = format!("r150.{}=1", "x".repeat(10_000));
    let ended = start(folder, &["--pty", "p", "--set", &set]).wait();
    assert!(ended.err.len() < 1000, "{}", ended.err);
    let bytes = format!("host = {{ bytes = \"{}\" }}", "AA".repeat(1025));
    fs::write(
        folder.join("b.toml"),
        short("B") + "[[step]]\nat = \"0 s\"\n" + &bytes,
    )
    .unwrap();
    start(folder, &["check", "b.toml"])
        .wait()
        .expect_refusal(2, &["1025 bytes", "1024"]);
}

/// Stops it again and again, as a system that is too busy does, until it has ended.
fn stop_and_go(sim: &Sim) {
    let state = format!("/proc/{}/stat", sim.pid());
    let begun = Instant::now();
    while !fs::read_to_string(&state).unwrap().contains(") Z ") {
        assert!(begun.elapsed() < PATIENCE, "{}", sim.printed());
        sim.signal(Signal::STOP);
        std::thread::sleep(Duration::from_millis(80));
        sim.signal(Signal::CONT);
        std::thread::sleep(Duration::from_millis(80));
    }
}

#[test]
fn a_failure_while_the_machine_held_the_simulator_up_is_the_machine_s() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    fs::write(folder.join("good.toml"), short("Good")).unwrap();
    let fails = "[[step]]\nat = \"100 ms\"\nexpect = { that = \"false\" }\n";
    fs::write(folder.join("bad.toml"), short("Bad") + fails).unwrap();
    let client = ["--", "sh", "-c", "exec 3<>\"$SIM_R150_PORT\"; sleep 1"];
    for (file, code) in [("good.toml", 0), ("bad.toml", 3)] {
        let options = [
            "run",
            "--max-stall",
            "1ms",
            "--time=real",
            "--junit",
            "r.xml",
            file,
        ];
        let sim = start(folder, &[&options as &[&str], &client].concat());
        stop_and_go(&sim);
        let ended = sim.wait();
        assert_eq!(ended.code(), Some(code), "{}{}", ended.out, ended.err);
        assert!(ended.out.contains("the machine was busy"), "{}", ended.out);
        let results = junit(&folder.join("r.xml"));
        assert!(results.contains("sim.stalled_s"), "{results}");
        assert_eq!(results.contains("type=\"error\""), code == 3, "{results}");
        assert_eq!(ended.out.contains("1 error"), code == 3, "{}", ended.out);
    }
}

#[test]
fn the_same_is_said_of_a_scenario_against_whatever_client_comes() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let fails = "[[step]]\nat = \"100 ms\"\nexpect = { that = \"false\" }\n";
    fs::write(folder.join("bad.toml"), short("Bad") + fails).unwrap();
    for (format, said) in [("text", "ERROR: Bad"), ("json", "\"verdict\":\"error\"")] {
        let sim = start(
            folder,
            &[
                "--scenario",
                "bad.toml",
                "--pty",
                "p",
                "--max-stall",
                "1ms",
                "--log-format",
                format,
            ],
        );
        sim.wait_ready();
        let _client = harness::client::Client::open(&folder.join("p"));
        stop_and_go(&sim);
        let ended = sim.wait();
        assert_eq!(ended.code(), Some(3), "{}{}", ended.out, ended.err);
        for part in [
            said,
            if format == "text" {
                "the machine was busy"
            } else {
                "\"stalled\":{"
            },
        ] {
            assert!(ended.out.contains(part), "{}", ended.out);
        }
    }
}
