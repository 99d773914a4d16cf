//! The custom device in `examples/` has what the shipped ones have.

#![expect(clippy::unwrap_used, reason = "a test")]

use std::sync::Arc;

use rigsim_core::settings::SimSettings;
use rigsim_runner::trace::Replay;
use rigsim_runner::{Run, RunOptions, Scenario};
use rigsim_settings::Source;

#[expect(dead_code, reason = "the program's own main")]
#[path = "../examples/robot.rs"]
mod robot;

fn scenario(text: &str) -> Arc<Scenario> {
    let file = "drive.toml";
    let base = SimSettings::new(robot::DEVICES);
    Arc::new(Scenario::parse(Source { file, text }, &base).unwrap())
}

#[test]
fn its_scenario_passes_with_its_fault_and_its_recording_is_the_same_again() {
    let scenario = scenario(include_str!("../examples/robot/drive.toml"));
    let options = RunOptions {
        trace: true,
        ..RunOptions::scripted(3)
    };
    let mut run = Run::new(scenario, None, options).unwrap();
    let mut lines = Vec::new();
    let outcome = run.play(&mut |line| lines.push(line.to_owned())).unwrap();
    assert!(outcome.passed, "{outcome:#?}");
    assert!(outcome.faults[0].hits > 0);
    Replay::all(robot::DEVICES, lines.iter().map(String::as_str)).unwrap();
}

#[test]
fn its_watchdog_stops_it_and_is_held_against_the_client() {
    let scenario = scenario(
        "schema = 1\ntitle = \"t\"\ngood_client = \"g\"\nlimit = \"2 s\"\n\
         [[device]]\nkind = \"robot\"\nsettings = { watchdog = \"300 ms\" }\n\
         [[step]]\nat = \"100 ms\"\n\
         host = { send = { speeds = { left = 300, right = -300 } } }\n\
         [[step]]\nat = \"350 ms\"\nexpect = { that = \"truth.yaw_rate_deg_s < -100\" }\n\
         [[step]]\nat = \"1 s\"\nhost = { bytes = \"58 0A\" }\n\
         [[step]]\nat = \"1.5 s\"\n\
         expect = { that = \"truth.at_rest && count.watchdog_fired == 1\" }\n",
    );
    let mut run = Run::new(scenario, None, RunOptions::scripted(1)).unwrap();
    let outcome = run.play(&mut |_| {}).unwrap();
    assert!(outcome.passed, "{outcome:#?}");
    let errors: Vec<&str> = outcome.devices[0]
        .report
        .client_errors()
        .map(|(code, _)| code)
        .collect();
    assert_eq!(errors, ["bad_line", "watchdog_fired"]);
}

#[test]
fn it_has_faults_of_any_body() {
    let scenario = scenario(
        "schema = 1\ntitle = \"t\"\ngood_client = \"g\"\nlimit = \"9 s\"\n\
         [[device]]\nkind = \"robot\"\nsettings = { watchdog = \"1 s\" }\n\
         [[step]]\nat = \"100 ms\"\nfor = \"5 s\"\nfault = { kind = \"payload\", mass = \"2 kg\" }\n\
         [[step]]\nat = \"200 ms\"\nfor = \"5 s\"\nfault = { kind = \"payload\", mass = \"1 kg\" }\n\
         [[step]]\nat = \"300 ms\"\nexpect = { that = \"truth.mass_kg == 4.5\" }\n\
         [[step]]\nat = \"400 ms\"\nfor = \"2 s\"\nfault = { kind = \"ice\", friction = 0.01 }\n\
         [[step]]\nat = \"500 ms\"\nhost = { send = { speeds = { left = 400, right = 400 } } }\n\
         [[step]]\nat = \"1 s\"\n\
         expect = { that = \"truth.speed_mps > 0.02 && truth.speed_mps < 0.08\" }\n\
         [[step]]\nat = \"4 s\"\nexpect = { that = \"truth.at_rest\" }\n\
         [[step]]\nat = \"5.5 s\"\nexpect = { that = \"truth.mass_kg == 1.5\" }\n\
         [[step]]\nat = \"6 s\"\nfor = \"500 ms\"\nfault = { kind = \"push\", left = \"20 N\" }\n\
         [[step]]\nat = \"6.4 s\"\nexpect = { that = \"truth.leftward_mps > 0.1\" }\n\
         [[step]]\nat = \"8.9 s\"\nexpect = { that = \"truth.at_rest && truth.y_m > 0.1\" }\n",
    );
    let mut run = Run::new(scenario, None, RunOptions::scripted(1)).unwrap();
    let outcome = run.play(&mut |_| {}).unwrap();
    // A fault that hits nothing would fail it.
    assert!(outcome.passed, "{outcome:#?}");
}
