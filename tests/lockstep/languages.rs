//! Clients in other languages, which lose the cable and come back.

use std::process::Command;

use super::harness::live::{Folder, drive_with};
use super::harness::python;
use super::{built, folder, has, run};

fn client(name: &str) -> String {
    format!("{}/tests/clients/{name}", env!("CARGO_MANIFEST_DIR"))
}

/// Plays a client whose cable is pulled and comes back; what it writes, and the trace. It writes down
/// for how many processors its language has threads.
fn pulled(folder: &Folder, client: &[&str]) -> (String, String) {
    let pulled = drive_with("{ kind = \"cable-pulled\" }", "1 s");
    std::fs::write(folder.file("pulled.toml"), pulled).unwrap();
    let args = ["--twice", "--output", "out", "pulled.toml"];
    run(folder, &args, client).expect_clean();
    let output = folder.read("out/pulled.client.log");
    for wanted in ["came back", "processors 1\n"] {
        assert!(output.contains(wanted), "{output}");
    }
    let trace = folder.read("out/pulled.trace.jsonl");
    assert!(trace.contains("\"kind\":\"time\",\"client\":\"lockstep\""));
    (output, trace)
}

/// What every client does: two threads or tasks, waits with timeouts, a cable that is pulled and comes
/// back.
fn drives(folder: &Folder, client: &[&str]) {
    let (output, trace) = pulled(folder, client);
    assert_eq!(trace.matches("\"kind\":\"attach\"").count(), 2, "{output}");
}

#[test]
fn a_client_in_python_with_threads() {
    let Some(python) = python() else { return };
    drives(&folder(), &[python, &client("threads.py")]);
}

#[test]
fn a_client_in_python_with_asyncio() {
    let Some(python) = python() else { return };
    drives(&folder(), &[python, &client("with_asyncio.py")]);
}

#[test]
fn a_client_in_python_with_processes() {
    let Some(python) = python() else { return };
    for kind in ["multiprocessing", "subprocess"] {
        drives(&folder(), &[python, &client("with_processes.py"), kind]);
    }
}

#[test]
fn a_client_in_c_with_poll() {
    if !has("cc", &["--version"]) {
        return;
    }
    let folder = folder();
    let binary = built(&folder, "cc", &[&client("with_poll.c")]);
    drives(&folder, &[&binary]);
}

#[test]
fn a_client_in_cpp_with_threads_and_conditions() {
    if !has("c++", &["--version"]) {
        return;
    }
    let folder = folder();
    let source = client("threads.cc");
    let binary = built(&folder, "c++", &["-std=c++17", "-pthread", &source]);
    drives(&folder, &[&binary]);
}

#[test]
fn a_client_in_cpp_with_asio() {
    let header = "/usr/include/asio.hpp";
    if !has("c++", &["--version"]) || !has("test", &["-e", header]) {
        return;
    }
    let folder = folder();
    let source = client("with_asio.cc");
    let binary = built(&folder, "c++", &["-std=c++17", "-pthread", &source]);
    drives(&folder, &[&binary]);
}

#[test]
fn a_client_in_cpp_with_asio_of_boost() {
    let header = "/usr/include/boost/asio.hpp";
    if !has("c++", &["--version"]) || !has("test", &["-e", header]) {
        return;
    }
    let folder = folder();
    let source = client("with_asio.cc");
    let flags = ["-std=c++17", "-pthread", "-DWITH_BOOST", &source];
    let binary = built(&folder, "c++", &flags);
    drives(&folder, &[&binary]);
}

#[test]
fn a_client_in_rust_with_tokio() {
    let Some(clients) = std::env::var_os("SIM_TEST_CLIENTS") else {
        eprintln!("skipped: SIM_TEST_CLIENTS does not say where tests/clients/rust has been built");
        return;
    };
    let binary = std::path::Path::new(&clients).join("with_tokio");
    drives(&folder(), &[binary.to_str().unwrap()]);
}

#[test]
fn a_client_in_rust_with_threads() {
    if !has("rustc", &["--version"]) {
        return;
    }
    let folder = folder();
    let binary = built(
        &folder,
        "rustc",
        &["--edition", "2024", &client("threads.rs")],
    );
    drives(&folder, &[&binary]);
}

#[test]
fn a_client_in_go_is_static() {
    if !has("go", &["version"]) {
        return;
    }
    let folder = folder();
    let binary = folder.file("client");
    let output = Command::new("go")
        .args(["build", "-o"])
        .arg(&binary)
        .arg(client("threads.go"))
        .env("CGO_ENABLED", "0")
        .output()
        .unwrap();
    let errors = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success(), "{errors}");
    drives(&folder, &[binary.to_str().unwrap()]);
}

#[test]
fn a_client_in_node_with_serialport() {
    if !has("node", &["-e", "require('serialport')"]) {
        return;
    }
    drives(&folder(), &["node", &client("with_serialport.js")]);
}

#[test]
fn several_tests_of_pytest_are_one_client() {
    let Some(python) = python() else { return };
    if !has(python, &["-m", "pytest", "--version"]) {
        return;
    }
    let suite = client("pytest_suite.py");
    let options = ["-m", "pytest", "-q", "-s", "-p", "no:cacheprovider", &suite];
    let (output, _) = pulled(&folder(), &[&[python], &options[..]].concat());
    assert!(output.contains("6 passed"), "{output}");
}

#[test]
fn a_client_in_shell() {
    drives(&folder(), &["bash", &client("script.sh")]);
}

#[test]
fn a_client_in_shell_with_socat() {
    if has("socat", &["-V"]) {
        drives(&folder(), &["bash", &client("with_socat.sh")]);
    }
}

/// By default it shares files in `/tmp` with all others that run.
#[test]
fn a_client_in_java_with_threads() {
    if has("java", &["-version"]) {
        let flag = "-XX:-UsePerfData";
        drives(&folder(), &["java", flag, &client("Client.java")]);
    }
}

/// Clients that one program of the system plays.
macro_rules! played {
    ($($name:ident: $program:literal $file:literal;)+) => {$(
        #[test]
        fn $name() {
            // Not all of them can be asked for their version.
            if has("sh", &["-c", concat!("command -v ", $program)]) {
                drives(&folder(), &[$program, &client($file)]);
            }
        }
    )+};
}

played! {
    a_client_in_ruby_with_timeouts: "ruby" "client.rb";
    a_client_in_erlang_with_processes: "escript" "client.escript";
    a_client_in_perl_with_select: "perl" "client.pl";
    a_client_in_php_with_stream_select: "php" "client.php";
    a_client_in_tcl_with_events: "tclsh" "client.tcl";
    a_client_in_lua_with_children: "lua5.4" "client.lua";
}
