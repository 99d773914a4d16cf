mod faults;
mod layers;
mod margins;
mod published;
mod rules;
mod steps;
mod traces;

use super::*;
use rigsim_core::line::ClientLine;
use rigsim_core::settings::SimSettings;

const HEAD: &str = "schema = 1\ntitle = \"t\"\ngood_client = \"g\"\n";
const R150: &str = "[[device]]\nkind = \"r150\"\n";
const CAR: &str = "[[device]]\nkind = \"mecanum\"\nros = true\n";
/// Drives at half power from 100 ms to 2 s and then stops, as a good client does.
const DRIVE: &str = "[[step]]\nname = \"drive\"\nat = \"100ms\"\nevery = \"50ms\"\nfor = \"1.9s\"\n\
    host = { send = { set_motors = { right = 500, left = 500 } } }\n\
    [[step]]\nname = \"stop\"\nafter = \"drive\"\ndelay = \"50ms\"\n\
    host = { send = { set_motors = { right = 0, left = 0 } } }\n";

fn scenario(text: &str) -> Arc<Scenario> {
    let source = Source {
        file: "s.toml",
        text,
    };
    let scenario = Scenario::parse(source, &SimSettings::new(rigsim_core::SHIPPED));
    Arc::new(scenario.unwrap_or_else(|error| panic!("{text}\n{error}")))
}

/// A scenario with one device, of so many seconds.
fn text(device: &str, limit: &str, more: &str) -> String {
    format!("{HEAD}limit = \"{limit}\"\n{device}{more}")
}

fn play(text: &str, seed: u64) -> Outcome {
    let mut run = Run::new(scenario(text), None, RunOptions::scripted(seed)).unwrap();
    run.play(&mut |_| {}).unwrap().clone()
}

fn r150(limit: &str, more: &str) -> Outcome {
    play(&text(R150, limit, more), 1)
}

fn car(limit: &str, more: &str) -> Outcome {
    play(&text(CAR, limit, more), 1)
}

#[track_caller]
fn passes(outcome: &Outcome) {
    assert!(outcome.passed, "{outcome:#?}");
}

/// Fails for this reason and no other.
#[track_caller]
fn fails(outcome: &Outcome, reason: &str) {
    let all: Vec<String> = outcome.failures.iter().map(ToString::to_string).collect();
    assert!(!outcome.passed);
    assert!(
        all.len() == 1 && all[0].contains(reason),
        "{all:#?} {reason}"
    );
}
