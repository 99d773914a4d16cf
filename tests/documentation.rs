//! The documentation for users: its scenario files are played, and its commands print what it says.
//!
//! A block of TOML that is a whole scenario begins with its name as a comment, as in `# first.toml`;
//! so does a block of Python that is a client. They are files for the commands. Other blocks of TOML
//! are parts of scenarios. A block of the kind `console` has commands behind `$ ` and what they
//! print; `...` stands for anything, on its own line for any number of lines. In blocks of the
//! kind `console python`, Python and pyserial are needed. Commands end with 0 unless they say
//! otherwise.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "a test fails by panicking, and clippy takes helpers for production code"
)]

mod harness;

use std::collections::BTreeSet;
use std::fs;
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::LazyLock;

use tempfile::TempDir;

use harness::{Sim, command, report_skipped, run};

/// Set where Python clients must not be passed over.
const PYTHON_IS_THERE: &str = "SIM_TEST_PYTHON";

/// Pages whose blocks are files and commands, in the order in which a reader meets them.
static PAGES: LazyLock<[String; 6]> = LazyLock::new(|| {
    [
        "docs/scenarios.md",
        "docs/jobs.md",
        "docs/results.md",
        "docs/ci.md",
        "docs/campaigns.md",
        "README.md",
    ]
    .map(document)
});

/// What a part of a scenario is put behind, for each kind of device.
const AROUND_PARTS: [&str; 2] = [
    r#"
schema = 1
title = "A part"
good_client = "Is not there."
limit = "60 s"
device = [{ kind = "r150" }]
[[step]]
name = "drive"
at = "100 ms"
host = { send = { set_motors = { right = 300, left = 300 } } }
"#,
    r#"
schema = 1
title = "A part"
good_client = "Is not there."
limit = "60 s"
device = [{ kind = "mecanum", ros = true }]
[[step]]
name = "drive"
at = "100 ms"
host = { send = { motion = { moving_idx = 0, s = 10, v = 100 } } }
"#,
];

fn document(name: &str) -> String {
    fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join(name)).unwrap()
}

/// A fenced block.
struct Block<'a> {
    info: &'a str,
    text: String,
}

fn blocks(document: &str) -> Vec<Block<'_>> {
    let mut blocks = Vec::new();
    let mut lines = document.lines();
    while let Some(line) = lines.next() {
        if let Some(info) = line.strip_prefix("```") {
            let inside = lines.by_ref().take_while(|line| *line != "```");
            let text = inside.map(|line| format!("{line}\n")).collect();
            blocks.push(Block { info, text });
        }
    }
    blocks
}

impl Block<'_> {
    /// The name of the file that it is.
    fn file(&self) -> Option<&str> {
        let name = self.text.lines().next()?.strip_prefix("# ")?;
        let ending = Path::new(name).extension()?;
        (ending == "toml" || ending == "py").then_some(name)
    }

    /// Commands and what they print.
    fn commands(&self) -> Vec<(&str, Vec<&str>)> {
        let mut commands: Vec<(&str, Vec<&str>)> = Vec::new();
        for line in self.text.lines() {
            match (line.strip_prefix("$ "), commands.last_mut()) {
                (Some(command), _) => commands.push((command, Vec::new())),
                (None, Some((_, printed))) => printed.push(line),
                (None, None) => panic!("no command is before {line:?}"),
            }
        }
        commands
    }
}

/// A folder with what the repository has and the files of the documents.
fn folder() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    for name in ["scenarios", "worlds", "docs", "python"] {
        symlink(root.join(name), folder.path().join(name)).unwrap();
    }
    for block in PAGES.iter().flat_map(|text| blocks(text)) {
        if let Some(name) = block.file() {
            fs::write(folder.path().join(name), &block.text).unwrap();
        }
    }
    folder
}

/// A shell's command with this `sim` first on its path.
fn shell(folder: &Path, script: &str) -> Command {
    let binary = Path::new(env!("CARGO_BIN_EXE_sim"));
    let path = std::env::var("PATH").unwrap();
    let path = format!("{}:{path}", binary.parent().unwrap().display());
    let mut command = Command::new("sh");
    command
        .args(["-c", script])
        .current_dir(folder)
        .env("PATH", path)
        .env("NO_COLOR", "1");
    command
}

/// Whether `line` is as shown.
fn matches(shown: &str, line: &str) -> bool {
    let mut parts = shown.split("...");
    let first = parts.next().unwrap_or_default();
    let Some(mut rest) = line.strip_prefix(first) else {
        return false;
    };
    let mut open_end = false;
    for part in parts {
        open_end = part.is_empty();
        match rest.find(part) {
            Some(at) => rest = &rest[at + part.len()..],
            None => return false,
        }
    }
    open_end || rest.is_empty()
}

/// Whether what is printed is as shown.
fn all_match(shown: &[&str], printed: &[&str]) -> bool {
    match (shown.split_first(), printed.split_first()) {
        (None, None) => true,
        (Some((&"...", shown)), _) => {
            (0..=printed.len()).any(|skipped| all_match(shown, &printed[skipped..]))
        }
        (Some((first, shown)), Some((line, printed))) => {
            matches(first, line) && all_match(shown, printed)
        }
        _ => false,
    }
}

/// A real client meets a busy machine now and then, on which neither it nor the bytes on their way
/// to it may get any time for a second. Three times in a row that does not happen by chance.
const LIVE_TRIES: usize = 3;

fn run_blocks(document: &str, info: &str, folder: &Path, tries: usize) {
    for block in blocks(document).iter().filter(|block| block.info == info) {
        for (script, shown) in block.commands() {
            let wrong = (0..tries).map_while(|_| try_command(folder, script, &shown).err());
            let wrong: Vec<String> = wrong.collect();
            assert!(wrong.len() < tries, "{}", wrong.join("\n"));
        }
    }
}

/// Runs a command; what it printed if that is not as shown.
fn try_command(folder: &Path, script: &str, shown: &[&str]) -> Result<(), String> {
    let output = shell(folder, script).output().unwrap();
    let text = String::from_utf8(output.stdout).unwrap();
    let wrong = String::from_utf8(output.stderr).unwrap();
    let printed: Vec<&str> = text.lines().chain(wrong.lines()).collect();
    if !all_match(shown, &printed) {
        return Err(format!("$ {script}\nprints\n{text}{wrong}"));
    }
    if !output.status.success() {
        return Err(format!("$ {script}: {}", output.status));
    }
    Ok(())
}

#[test]
fn commands_print_what_is_shown() {
    let folder = folder();
    for document in PAGES.iter() {
        run_blocks(document, "console", folder.path(), 1);
    }
}

#[test]
fn commands_with_python_clients_print_what_is_shown() {
    let folder = folder();
    let probe = shell(folder.path(), "python3 -c 'import serial'").output();
    if !probe.unwrap().status.success() && std::env::var_os(PYTHON_IS_THERE).is_none() {
        report_skipped("clients in the documentation", "no python3 with pyserial");
        return;
    }
    for document in PAGES.iter() {
        run_blocks(document, "console python", folder.path(), LIVE_TRIES);
    }
}

#[test]
fn every_whole_scenario_has_a_name_and_is_played() {
    let all: Vec<Block<'_>> = PAGES.iter().flat_map(|text| blocks(text)).collect();
    let played: Vec<String> = all
        .iter()
        .filter(|block| block.info.starts_with("console"))
        .flat_map(|block| block.commands())
        .map(|(command, _)| command.to_owned())
        .collect();
    let whole = all
        .iter()
        .filter(|block| block.info == "toml" && block.text.contains("schema = 1"));
    let mut count = 0;
    for block in whole {
        let name = block.file().expect("a whole scenario begins with its name");
        let is_run = |command: &String| command.contains("sim run") && command.contains(name);
        assert!(played.iter().any(is_run), "no command plays {name}");
        count += 1;
    }
    assert!(count >= 5);
}

#[test]
fn parts_of_scenarios_are_well_formed() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("part.toml");
    for block in PAGES.iter().flat_map(|text| blocks(text)) {
        if block.info != "toml" || block.text.contains("schema = 1") {
            continue;
        }
        // Keys of the whole file come before its tables.
        let is_key = !block.text.trim_start().starts_with(['[', '#']);
        let errors: Vec<String> = AROUND_PARTS
            .iter()
            .map(|around| match is_key {
                true => around.replacen('\n', &format!("\n{}", block.text), 1),
                false => format!("{around}{}", block.text),
            })
            .map(|text| {
                fs::write(&file, text).unwrap();
                run(&["check", file.to_str().unwrap()])
            })
            .map(|checked| checked.err)
            .collect();
        let fits = errors.iter().any(String::is_empty);
        assert!(fits, "{}\n{}", block.text, errors.join("\n"));
    }
}

/// Commands that are shown without what they print: files and flags exist, and ports are served.
#[test]
fn further_commands_are_understood() {
    let folder = folder();
    let here = format!("{}/", folder.path().display());
    // The last pages have commands for other shells and programs, too.
    for document in &PAGES[..4] {
        for block in blocks(document).iter().filter(|block| block.info == "sh") {
            for line in block.text.lines() {
                let line = line.split(" #").next().unwrap_or_default();
                if line.starts_with("sim run ") {
                    let script = line.replacen("sim run", "sim run --dry-run", 1);
                    let output = shell(folder.path(), &script).output().unwrap();
                    assert!(output.status.success(), "{script}: {output:?}");
                } else if let Some(arguments) = line.strip_prefix("sim --") {
                    let line = format!("--{arguments}").replace("/tmp/", &here);
                    let mut sim = command();
                    sim.args(line.split_whitespace()).current_dir(folder.path());
                    let sim = Sim::spawn(&mut sim, PathBuf::new(), None);
                    sim.wait_ready();
                    sim.stop();
                } else {
                    let known = ["pip ", "cargo ", "sim ", "python3 ", "pytest", "robot "];
                    let is_known = known.iter().any(|known| line.starts_with(known));
                    assert!(is_known, "what is {line:?}?");
                }
            }
        }
    }
}

#[test]
fn the_reference_is_what_the_program_prints() {
    let printed = run(&["schema", "scenario", "--format", "markdown"])
        .expect_clean()
        .out;
    let why = "sim schema scenario --format markdown > docs/reference.md";
    assert!(printed == document("docs/reference.md"), "stale: {why}");
    for code in rigsim_core::device::client_report_codes(rigsim_core::SHIPPED) {
        assert!(printed.contains(code), "the reference lacks `{code}`");
    }
    run(&["schema", "world", "--format", "markdown"])
        .expect_refusal(2, &["only the reference of scenario files"]);
}

#[test]
fn the_catalogue_of_faults_is_what_the_program_prints() {
    let printed = run(&["faults"]).expect_clean().out;
    assert!(printed == document("docs/faults.md"), "./regenerate");
    let text = run(&["faults", "--device", "mecanum"]).expect_clean().out;
    assert!(text.contains("### `tag-misread`") && !text.contains("Devices: r150."));
}

/// A heading as links call it.
fn anchor(heading: &str) -> String {
    let kept = |c: &char| c.is_alphanumeric() || " -_".contains(*c);
    let kept: String = heading.to_lowercase().chars().filter(kept).collect();
    kept.replace(' ', "-")
}

#[test]
fn links_lead_to_files_and_headings() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let docs = fs::read_dir(root.join("docs")).unwrap();
    let docs = docs.map(|entry| format!("docs/{}", entry.unwrap().file_name().display()));
    let docs = docs.filter(|name| name.ends_with(".md"));
    let others = ["README.md", "ARCHITECTURE.md"].map(str::to_owned);
    for name in docs.chain(others) {
        let text = document(&name);
        let links = text.split("](").skip(1);
        let links = links.filter_map(|rest| rest.split_once(')').map(|(link, _)| link));
        for link in links.filter(|link| !link.starts_with("http")) {
            let (path, heading) = link.split_once('#').unwrap_or((link, ""));
            let target = match path {
                "" => root.join(&name),
                path => root.join(&name).with_file_name(path),
            };
            assert!(target.exists(), "{name}: {link} leads nowhere");
            if !heading.is_empty() {
                let text = fs::read_to_string(&target).unwrap();
                let mut headings = text.lines().filter_map(|line| line.split_once("# "));
                let found = headings.any(|(_, words)| anchor(words) == heading);
                assert!(found, "{name}: {link} has no such heading");
            }
        }
    }
}

/// All Rust sources under a folder, one after the other.
fn sources(folder: &Path, text: &mut String) {
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            sources(&path, text);
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            text.push_str(&fs::read_to_string(path).unwrap());
        }
    }
}

/// Each sentence of a manual has its own number, and is held by tests that exist or assumed or
/// left out.
#[test]
fn every_sentence_of_a_manual_is_held_by_a_test_or_said_not_to_be() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut code = String::new();
    for folder in ["sim", "physics"] {
        sources(&root.join(folder), &mut code);
    }
    for page in ["docs/r150.md", "docs/mecanum.md"] {
        let text = fs::read_to_string(root.join(page)).unwrap();
        let (_, table) = text.split_once("sentence by sentence").unwrap();
        let mut numbers = BTreeSet::new();
        for row in table.lines().filter(|row| row.starts_with("| ")).skip(1) {
            let cells: Vec<&str> = row.split(" | ").collect();
            assert_eq!(cells.len(), 3, "{page}: {row}");
            assert!(numbers.insert(cells[0]), "{page} has {} twice", cells[0]);
            let tests: Vec<&str> = cells[2].split('`').skip(1).step_by(2).collect();
            let open = cells[2].contains("assumed") || cells[2].contains("not modelled");
            assert!(open || !tests.is_empty(), "{page}: {row}");
            for test in tests {
                let named = code.contains(&format!("fn {test}("));
                assert!(named, "{page}, {}: there is no test {test}", cells[0]);
            }
        }
        assert!(numbers.len() > 20, "{page}");
    }
}
