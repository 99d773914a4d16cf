//! One test for each scenario of the library: it passes with its scripted client, is the same to
//! the last byte on a second run, and is repeated from its trace.

#![expect(
    clippy::unwrap_used,
    clippy::disallowed_methods,
    reason = "a test, and it reads the files for the pure library"
)]

mod common;

use std::path::Path;
use std::process::ExitCode;

use libtest_mimic::{Arguments, Failed, Trial};
use rigsim_runner::trace::Replay;
use rigsim_runner::{Outcome, RunOptions};

use common::Loaded;

fn main() -> ExitCode {
    let trials = common::files()
        .into_iter()
        .map(|file| Trial::test(common::name(&file), move || check(&file)).with_kind("scenario"))
        .collect();
    libtest_mimic::run(&Arguments::from_args(), trials).exit_code()
}

fn check(file: &Path) -> Result<(), Failed> {
    let loaded = Loaded::read(file)?;
    let first = loaded.scenario.source.text.lines().next();
    let depth = common::name(file).matches('/').count();
    let schema = format!("#:schema {}scenario.schema.json", "../".repeat(depth));
    if first != Some(schema.as_str()) {
        return Err("its first line does not name the schema for editors".into());
    }
    let (outcome, lines) = play(&loaded);
    if !outcome.passed {
        let failures: Vec<String> = outcome.failures.iter().map(ToString::to_string).collect();
        return Err(failures.join("\n").into());
    }
    // Within other jobs it may hit nothing, within the shipped one it has to.
    let is_fault = file.parent().is_some_and(|own| own.ends_with("faults"));
    let faults = &outcome.faults;
    if is_fault && !faults.is_empty() && faults.iter().all(|fault| fault.hit == 0) {
        return Err("its faults hit nothing".into());
    }
    let (_, again) = play(&loaded);
    let differs = lines.iter().zip(&again).position(|(one, two)| one != two);
    if let Some(line) = differs {
        let (one, two) = (&lines[line], &again[line]);
        return Err(format!("a second run differs:\n  {one}\n  {two}").into());
    }
    if lines.len() != again.len() {
        return Err("a second run has another number of lines".into());
    }
    Replay::all(rigsim_core::SHIPPED, lines.iter().map(String::as_str))?;
    Ok(())
}

fn play(loaded: &Loaded) -> (Outcome, Vec<String>) {
    let options = RunOptions {
        trace: true,
        ..RunOptions::scripted(1)
    };
    let mut run = loaded.run(options);
    let mut lines = Vec::new();
    let outcome = run.play(&mut |line| lines.push(line.to_owned())).unwrap();
    (outcome.clone(), lines)
}
