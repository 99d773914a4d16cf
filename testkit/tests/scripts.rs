//! The scripts of `fuzz/` say why, where they cannot build anything.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::fs;
use std::os::unix::fs::symlink;
use std::path::Path;
use std::process::{Command, Output};

/// Runs a script where there are these programs and no others.
fn script(name: &str, programs: &[&str]) -> Output {
    let places = std::env::var_os("PATH").unwrap();
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("only-for-{name}"));
    let _ = fs::remove_dir_all(&folder);
    fs::create_dir_all(&folder).unwrap();
    for program in programs {
        let mut found = std::env::split_paths(&places).map(|place| place.join(program));
        let found = found.find(|path| path.exists()).unwrap();
        symlink(found, folder.join(program)).unwrap();
    }
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap();
    let script = root.join("fuzz").join(name);
    let output = Command::new(script).env("PATH", &folder).output();
    fs::remove_dir_all(&folder).unwrap();
    output.unwrap()
}

#[test]
fn without_a_cpp_compiler_nothing_is_built_and_the_check_is_passed_over() {
    let programs = ["bash", "dirname", "uname"];
    for (name, code) in [("build", 3), ("check", 0)] {
        let output = script(name, &programs);
        let reported = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(code), "{name}: {reported}");
        assert!(reported.contains("cannot be built"), "{name}: {reported}");
        assert!(reported.contains("there is no `c++`"), "{name}: {reported}");
        assert_eq!(reported.lines().count(), 1, "{name}: {reported}");
    }
}
