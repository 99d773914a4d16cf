//! Text of each kind of file but traces: refused in words, or built and run for a while.

use std::sync::Arc;
use std::time::Duration;

use rigsim_core::line::Wire;
use rigsim_core::settings::SimSettings;
use rigsim_core::{SHIPPED, SimTime};
use rigsim_physics::WorldMap;
use rigsim_runner::trace::Record;
use rigsim_runner::{RigPlan, Run, RunError, RunOptions, Scenario};
use rigsim_settings::{Source, load_toml};

use crate::session::{Player, Setup, truth};

/// Most devices that are driven, since each makes every step dearer.
pub(crate) const MOST_DRIVEN: usize = 12;
/// Most simulated time of a scenario.
const MOST_TIME: Duration = Duration::from_millis(200);

/// A refusal must say something, and not everything.
pub(crate) fn is_reported(error: &str) {
    assert!(!error.is_empty(), "an error without words");
    let begins: String = error.chars().take(300).collect();
    let length = error.len();
    assert!(length < 20_000, "an error of {length} bytes: {begins}");
}

/// A settings file: both devices are driven with it for some steps of the physics.
pub fn settings(text: &str) {
    let mut settings = SimSettings::new(SHIPPED);
    match load_toml(text, "settings.toml", &mut settings) {
        Ok(()) => drive(&settings, WorldMap::default(), None, 40),
        Err(errors) => errors
            .iter()
            .for_each(|error| is_reported(&error.to_string())),
    }
}

/// A world file: both devices are driven in it for some steps.
pub fn world(text: &str) {
    match WorldMap::from_toml(text, "world.toml") {
        Ok(map) => drive(&SimSettings::new(SHIPPED), map, None, 40),
        Err(error) => is_reported(&error.to_string()),
    }
}

/// A rig file: its devices are driven for some steps, in the empty plane.
pub fn rig(text: &str) {
    let file = "rig.toml";
    match RigPlan::parse(Source { file, text }, &SimSettings::new(SHIPPED)) {
        Ok(plan) => {
            if plan.devices.len() <= MOST_DRIVEN {
                Player::new(plan, WorldMap::default(), Wire::Paced, 1).drive(None, 20);
            }
        }
        Err(error) => is_reported(&error.to_string()),
    }
}

/// A scenario file: it is played for a while.
pub fn scenario(text: &str) {
    if let Some(scenario) = parse(text)
        && scenario.rig.devices.len() <= MOST_DRIVEN
    {
        drop(play(&scenario, MOST_TIME));
    }
}

/// The scenario in a text, if it is not refused.
pub(crate) fn parse(text: &str) -> Option<Arc<Scenario>> {
    let file = "scenario.toml";
    let scenario = Scenario::parse(Source { file, text }, &SimSettings::new(SHIPPED));
    scenario
        .map_err(|error| is_reported(&error.to_string()))
        .ok()
        .map(Arc::new)
}

/// Plays a scenario for so long, and returns its trace; `None` where it could not be played on.
pub(crate) fn play(scenario: &Arc<Scenario>, most: Duration) -> Option<Vec<String>> {
    let options = RunOptions {
        trace: true,
        ..RunOptions::scripted(1)
    };
    let run = Run::new(Arc::clone(scenario), None, options);
    let played = run.and_then(|mut run| {
        run.advance(SimTime::ZERO + scenario.limit.min(most))?;
        Ok(run)
    });
    let mut run = played.map_err(|error| goes_on(&error)).ok()?;
    let outcome = run.end().clone();
    while run.poll_event().is_some() {}
    let lines: Vec<String> = std::iter::from_fn(|| run.poll_trace()).collect();
    assert!(outcome.ended_at.since(SimTime::ZERO) <= scenario.limit);
    assert_eq!(outcome.passed, outcome.failures.is_empty());
    for failure in &outcome.failures {
        // It may say what the file wants it to say.
        let length = failure.to_string().len();
        assert!(0 < length && length < 20_000 + scenario.source.text.len());
    }
    for device in 0..run.rig().devices() {
        truth(run.rig(), device);
    }
    for line in &lines {
        // A number that is not finite could not be read back.
        let read: Result<Record, _> = serde_json::from_str(line);
        assert!(read.is_ok(), "{line}: {read:?}");
    }
    Some(lines)
}

/// A scenario may ask for what has no end, which is reported; the simulation itself never gives up.
pub(crate) fn goes_on(error: &RunError) {
    is_reported(&error.to_string());
    assert!(!matches!(error, RunError::Rig(_)), "{error}");
}

/// Drives one device of each kind side by side, and keeps every promise of a session.
///
/// # Panics
/// When a promise is broken.
pub fn drive(settings: &SimSettings, map: WorldMap, pace: Option<Duration>, rounds: usize) {
    let setup = Setup {
        all_links: true,
        ..Setup::default()
    };
    let plan = setup.plan(SHIPPED, settings, [0.0, 1.5]);
    Player::new(plan, map, Wire::Paced, 1).drive(pace, rounds);
}
