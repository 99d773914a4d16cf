//! Every scenario that is shipped is read, passes with its scripted client, is the same on a second
//! run, and is repeated from its trace.

#![expect(
    clippy::unwrap_used,
    clippy::panic,
    clippy::disallowed_methods,
    reason = "a test, and it reads the files for the pure library"
)]

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use sim_core::settings::SimSettings;
use sim_scenarios::trace::Replay;
use sim_scenarios::{Outcome, Run, RunOptions, Scenario};
use sim_settings::Source;

/// The scenario files of this crate, in the order of their names.
fn files() -> Vec<PathBuf> {
    let mut files = Vec::new();
    for folder in ["r150", "mecanum"] {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join(folder);
        for entry in fs::read_dir(folder).unwrap() {
            files.push(entry.unwrap().path());
        }
    }
    files.retain(|file| file.extension().is_some_and(|ending| ending == "toml"));
    files.sort();
    files
}

fn play(file: &Path, seed: u64) -> (Outcome, Vec<String>) {
    let text = fs::read_to_string(file).unwrap();
    let name = file.display().to_string();
    let source = Source {
        file: &name,
        text: &text,
    };
    let scenario =
        Scenario::parse(source, &SimSettings::default()).unwrap_or_else(|error| panic!("{error}"));
    let world = scenario
        .world()
        .map(|world| file.parent().unwrap().join(world));
    let world = world.map(|path| {
        (
            path.display().to_string(),
            fs::read_to_string(path).unwrap(),
        )
    });
    let world = world.as_ref().map(|(file, text)| Source { file, text });
    let options = RunOptions {
        trace: true,
        ..RunOptions::scripted(scenario.rig.seed.unwrap_or(seed))
    };
    let mut run = Run::new(Arc::new(scenario), world, options).unwrap();
    let mut lines = Vec::new();
    let outcome = run.play(&mut |line| lines.push(line.to_owned())).unwrap();
    (outcome.clone(), lines)
}

#[test]
fn every_file_passes_and_is_the_same_again() {
    let files = files();
    assert!(files.len() >= 10);
    let mut wrong = Vec::new();
    for file in &files {
        let (outcome, lines) = play(file, 1);
        let failures: Vec<String> = outcome.failures.iter().map(ToString::to_string).collect();
        if !outcome.passed {
            wrong.push(format!("{}:\n  {}", file.display(), failures.join("\n  ")));
        }
        assert_eq!(play(file, 1).1, lines, "{} differs", file.display());
        Replay::all(lines.iter().map(String::as_str))
            .unwrap_or_else(|error| panic!("{}: {error}", file.display()));
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn every_file_says_what_a_good_client_does() {
    for file in files() {
        let text = fs::read_to_string(&file).unwrap();
        let first = text.lines().next().unwrap();
        assert_eq!(
            first,
            "#:schema ../scenario.schema.json",
            "{}",
            file.display()
        );
    }
}
