//! Text of each kind of file but traces: refused in words, or built and run for a while.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;

use rigsim_core::device::DeviceSpec;
use rigsim_core::line::Wire;
use rigsim_core::rig::{PortId, Rig, RigError, RigSettings};
use rigsim_core::settings::SimSettings;
use rigsim_core::{SHIPPED, SimTime};
use rigsim_physics::WorldMap;
use rigsim_runner::trace::Record;
use rigsim_runner::{RigPlan, Run, RunError, RunOptions, Scenario};
use rigsim_settings::{Source, load_toml};
use toml::de::DeValue;
use toml::{Table, Value};

use crate::session::{setup, truth};

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
        Ok(()) => drive(&settings, WorldMap::default(), Steps(40)),
        Err(errors) => errors
            .iter()
            .for_each(|error| is_reported(&error.to_string())),
    }
}

/// A world file: both devices are driven in it for some steps.
pub fn world(text: &str) {
    match WorldMap::from_toml(text, "world.toml") {
        Ok(map) => drive(&SimSettings::new(SHIPPED), map, Steps(40)),
        Err(error) => is_reported(&error.to_string()),
    }
}

/// A rig file: its devices are driven for some steps, in the empty plane.
pub fn rig(text: &str) {
    let file = "rig.toml";
    match RigPlan::parse(Source { file, text }, &SimSettings::new(SHIPPED)) {
        Ok(plan) => {
            if plan.devices.len() <= MOST_DRIVEN {
                let map = WorldMap::default();
                drive_rig(plan.build(map, Wire::Paced, 1), Steps(20));
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

/// For how long to drive.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum HowLong {
    /// In steps of the physics, of whatever length.
    Steps(u32),
    /// In simulated time.
    For(Duration),
}
use HowLong::Steps;

/// Drives one device of each kind, and checks its numbers.
///
/// # Panics
/// When a number is not finite, or the simulation gives up.
pub fn drive(settings: &SimSettings, map: WorldMap, how_long: HowLong) {
    let mut rig = Rig::new(RigSettings {
        world: settings.world.clone(),
        map,
        wire: Wire::Paced,
        seed: 1,
    });
    for (device, y) in SHIPPED.iter().zip([0.0, 1.5, 3.0]) {
        let links = device.links.len();
        setup::add(&mut rig, (device, settings), [0.0, y], 0, links);
    }
    drive_rig(rig, how_long);
}

/// Commands that drive, one after another: of what the plan of the device sends, the kind that it sends
/// most often.
fn driving(device: &DeviceSpec) -> Vec<Vec<u8>> {
    let plan = device.host.plan.parse::<Table>();
    let plan = Value::Table(plan.unwrap_or_else(|error| panic!("{error}")));
    let list = |value: &Value, key| value.get(key).and_then(Value::as_array).cloned();
    let parts = list(&plan, "manoeuvre").into_iter().flatten();
    let parts = parts.flat_map(|part| list(&part, "do").into_iter().flatten());
    let mut kinds: BTreeMap<String, Vec<String>> = BTreeMap::new();
    for command in parts.flat_map(|part| list(&part, "send").into_iter().flatten()) {
        let kind = command.as_table().and_then(|command| command.keys().next());
        // What stops it is sent often, too.
        let text = command.to_string();
        if let Some(kind) = kind.filter(|_| text.contains(|digit| matches!(digit, '1'..='9'))) {
            kinds.entry(kind.clone()).or_default().push(text);
        }
    }
    let most = kinds.into_values().max_by_key(Vec::len).unwrap_or_default();
    assert!(!most.is_empty(), "nothing is known to drive {device:?}");
    most.iter().map(|text| command(device, text)).collect()
}

/// A command as it is on the wire, by the settings as they are by default.
fn command(device: &DeviceSpec, text: &str) -> Vec<u8> {
    let value = DeValue::parse(text).unwrap_or_else(|error| panic!("{text}: {error}"));
    let read = (device.host.read)(&value, &*(device.settings)());
    read.unwrap_or_else(|error| panic!("{text}: {error}")).bytes
}

fn drive_rig(mut rig: Rig, how_long: HowLong) {
    let step = rig.world().step_length();
    let (pace, count) = match how_long {
        HowLong::Steps(count) => (step, count),
        HowLong::For(span) => (Duration::from_millis(50), {
            u32::try_from(span.as_millis() / 50).unwrap_or(u32::MAX)
        }),
    };
    let gone_on = |went: Result<(), RigError>| went.unwrap_or_else(|error| panic!("{error}"));
    let ports: Vec<PortId> = (0..rig.devices())
        .flat_map(|device| [0, 1].map(|link| PortId { device, link }))
        .collect();
    for port in &ports {
        gone_on(rig.attach(*port, SimTime::ZERO));
    }
    let mut now = SimTime::ZERO;
    let mut bytes = Vec::new();
    for round in 0..count {
        if round % 10 == 0 {
            for device in 0..rig.devices() {
                let port = PortId { device, link: 0 };
                let Some(spec) = rig.spec(device) else {
                    continue;
                };
                let requests = driving(spec);
                let which = usize::try_from(round / 10).unwrap_or(0) % requests.len();
                rig.client_puts(port, &requests[which]);
            }
        }
        now += pace;
        gone_on(rig.advance(now));
        for device in 0..rig.devices() {
            truth(&rig, device);
        }
        for port in &ports {
            bytes.clear();
            rig.client_reads(*port, &mut bytes);
        }
        while let Some(event) = rig.poll_event() {
            assert!(!event.kind.to_string().is_empty());
        }
    }
}
