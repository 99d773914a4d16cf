//! Settings are found again: the model with other settings, by another chance, is the vehicle.

use std::path::Path;

use rigsim_core::SHIPPED;
use rigsim_core::event::read_hex;
use rigsim_core::settings::SimSettings;
use rigsim_runner::trace::{Hexed, PortRecord, Record, Replay};
use rigsim_settings::{Settings as _, SimTime, parse_assignment};

use super::knob::Knob;
use super::plan::manoeuvres;
use super::recording::Recording;
use super::report::Report;
use super::search::{Findings, Search, Verdict};
use super::{header, plan_of};

fn with(changes: &[String]) -> SimSettings {
    let mut settings = SimSettings::new(SHIPPED);
    for change in changes {
        let (key, value) = parse_assignment("--set", change).unwrap();
        settings
            .assign(&key, &value)
            .unwrap_or_else(|why| panic!("{change}: {why:?}"));
    }
    settings
}

/// The manoeuvres of an R150 whose names have one of these parts, driven with some settings.
fn drive(parts: &[&str], changes: &[String], seed: u64) -> Recording {
    let settings = with(changes);
    let device = SHIPPED.iter().find(|device| device.id == "r150").unwrap();
    let own = settings.of_device(device).unwrap();
    let mut all = manoeuvres(device, own).unwrap();
    all.retain(|one| parts.iter().any(|part| one.name.contains(part)));
    assert!(!all.is_empty());
    let port = PortRecord(0, 0);
    let client = "lockstep".into();
    let mut records = vec![Record::Time { client }, Record::Attach { t: 1, port }];
    let mut t = 1_000_000;
    for frame in all.iter().flat_map(|one| &one.frames) {
        let bytes = Hexed(read_hex(frame.bytes.chars()).unwrap());
        records.push(Record::In { t, port, bytes });
        t += frame.wait_ms * 1_000_000;
    }
    let mut header = header(&plan_of(SHIPPED, "r150", 1, settings.clone()).unwrap());
    header.seed = seed;
    let sent = Replay::play(
        SHIPPED,
        &header,
        &records,
        SimTime::from_nanos(t + 1_000_000_000),
        None,
    );
    for (t, byte) in sent.unwrap().into_values().flatten() {
        records.push(Record::Out {
            t,
            dt: 0,
            port,
            bytes: Hexed(vec![byte]),
        });
    }
    Recording::of(SHIPPED, header, records, &with(&[])).unwrap()
}

fn search<'a>(recordings: &'a [Recording], only: &[&str]) -> (Search<'a>, Findings) {
    let only: Vec<String> = only.iter().map(|key| (*key).to_owned()).collect();
    let search = Search::new(recordings, with(&[]), &only);
    let findings = search.run().unwrap();
    (search, findings)
}

/// Name, value, number with the ends of its interval, and what may be instead.
type Claim = (String, String, Option<(f64, [Option<f64>; 2])>, Vec<String>);

/// What was claimed, as `key=value`; what may be others instead has them behind it.
fn claims(search: &Search<'_>, findings: &Findings) -> Vec<Claim> {
    let found = findings.found.iter();
    let claim = |one: &super::search::Found| {
        (
            search.knobs[one.knob].name(),
            one.literal.clone(),
            one.number,
            one.or.clone(),
        )
    };
    found.map(claim).collect()
}

/// Judges what was found where one setting was changed: `Ok` with the error of a number, or what is wrong.
fn judge(
    change: &str,
    search: &Search<'_>,
    findings: &Findings,
    tolerance: f64,
) -> Result<f64, String> {
    let claims = claims(search, findings);
    let settings = with(&[change.to_owned()]);
    let key = change.split('=').next().unwrap();
    let knob = search.knobs.iter().find(|knob| knob.key == key).unwrap();
    let [(name, literal, number, or)] = &*claims else {
        return Err(format!("claims {claims:?}"));
    };
    if name != key && !or.contains(&knob.name()) {
        return Err(format!("claims {claims:?}"));
    }
    if !or.is_empty() {
        return Err(format!("not decided: {name} or {or:?}"));
    }
    match number {
        None if *literal == knob.literal_in(&settings) => Ok(0.0),
        None => Err(format!("claims {claims:?}")),
        Some((value, [low, high])) => {
            let truth = knob.number_in(&settings);
            let error = (value - truth).abs();
            let is_inside =
                low.is_some_and(|low| low <= truth) && high.is_some_and(|high| truth <= high);
            let fine = is_inside && error <= tolerance * truth.abs();
            fine.then_some(error / truth.abs())
                .ok_or_else(|| format!("claims {claims:?}, is {truth}"))
        }
    }
}

/// A drive in which a setting is changed, the settings among which it is searched, and the most error.
const ONE_AT_A_TIME: &[(&str, &str, &[&str], f64)] = &[
    (
        "malformed",
        "r150.on_bad_crc=false",
        &["r150.on_", "r150.inter"],
        0.0,
    ),
    (
        "malformed",
        "r150.on_motors_out_of_range=refuse",
        &["r150.on_", "r150.inter"],
        0.0,
    ),
    (
        "too many",
        "r150.over_rate=silent",
        &["r150.over", "r150.motor_reply"],
        0.0,
    ),
];

#[test]
fn a_changed_setting_is_found() {
    let mut wrong = Vec::new();
    for (parts, change, only, tolerance) in ONE_AT_A_TIME {
        let recordings = [drive(&[parts], &[(*change).to_owned()], 77)];
        let (search, findings) = search(&recordings, only);
        let [by_default, fitted] =
            [&findings.assumed, &findings.model].map(|model| search.cost(model, true));
        if let Err(why) = judge(change, &search, &findings, *tolerance) {
            wrong.push(format!(
                "{change}: {why}\n{}",
                Report::of(&search, &findings).text()
            ));
        } else if fitted >= by_default {
            wrong.push(format!(
                "{change}: held out {by_default} by default, {fitted} fitted"
            ));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n\n"));
}

#[test]
fn nothing_is_claimed_of_a_vehicle_that_is_as_assumed() {
    for (seed, parts) in [(31, "malformed"), (32, "too many"), (33, "small")] {
        let recordings = [drive(&[parts], &[], seed)];
        let (search, findings) = search(
            &recordings,
            &["r150.on_", "r150.over", "r150.motor", "r150.inter"],
        );
        assert_eq!(claims(&search, &findings), [], "{parts}");
        assert!(
            !findings.verdicts.contains(&Verdict::Contradicted),
            "{parts}"
        );
        assert!(findings.verdicts.contains(&Verdict::Supported), "{parts}");
        assert_eq!(search.unexplained(&findings.model), [""; 0], "{parts}");
    }
}

#[test]
fn what_has_no_end_is_no_value_that_is_written() {
    // Longer than any silence of the drive, and between two of them.
    for (truth, is_closed) in [("20s", false), ("3500ms", true)] {
        let change = format!("r150.heartbeat_timeout={truth}");
        let recordings = [drive(&["rails"], std::slice::from_ref(&change), 77)];
        let (search, findings) = search(&recordings, &["r150.heartbeat_timeout"]);
        let claims = claims(&search, &findings);
        let [(_, _, Some((_, [Some(low), high])), _)] = &*claims else {
            panic!("{truth}: {claims:?}");
        };
        assert_eq!(high.is_some(), is_closed, "{truth}: {claims:?}");
        assert!((3.0..3.5).contains(low) || !is_closed, "{truth}: {low}");
        assert!(high.is_none_or(|high| high > 3.5), "{truth}: {claims:?}");
        let report = Report::of(&search, &findings);
        let (text, toml) = (report.text(), report.toml());
        assert_eq!(toml.contains("\nr150."), is_closed, "{toml}");
        let words = format!("more than {}", format!("{low:.2e}").parse::<f64>().unwrap());
        let is_said = text.contains(&words) && toml.contains(&words);
        assert!(is_said || is_closed, "{text}\n{toml}");
    }
}

#[test]
fn a_time_far_from_the_documented_one_is_found() {
    let changes = ["r150.heartbeat_timeout=1s".to_owned()];
    let recordings = [drive(&["rails"], &changes, 77)];
    let (search, findings) = search(&recordings, &["r150.heartbeat_timeout", "r150.reply"]);
    let report = Report::of(&search, &findings);
    assert!(!report.is_as_documented, "{}", report.text());
    // With no setting that could explain it.
    let (search, findings) = self::search(&recordings, &["r150.reply"]);
    let report = Report::of(&search, &findings);
    assert!(!report.unexplained.is_empty(), "{}", report.text());
    assert!(!report.is_as_documented);
}

#[test]
fn the_file_keeps_what_was_set_before_and_the_decided_parts_of_a_version() {
    let changes = ["r150.hardware_version=\"40.0.0.0\"".to_owned()];
    let recordings = [drive(&["questions"], &changes, 77)];
    let only = ["r150.hardware_version".to_owned()];
    let before = with(&["r150.on_bad_crc=false".to_owned()]);
    let search = Search::new(&recordings, before, &only);
    let report = Report::of(&search, &search.run().unwrap());
    let toml = report.toml();
    for line in [
        "r150.on_bad_crc = \"false\"",
        "r150.hardware_version = \"40.0.0.0\"",
    ] {
        assert!(toml.lines().any(|one| one == line), "{toml}");
    }
}

/// Every setting, one at a time, over the whole drive; prints what is found.
#[test]
#[ignore = "takes an hour; prints what is found"]
fn campaign_of_single_changes() {
    let (mut wrong, mut right) = (0, 0);
    let only = std::env::var("ONLY").unwrap_or_default();
    for knob in Knob::all(&with(&[]), "r150", &[])
        .iter()
        .filter(|knob| knob.key.contains(&only))
    {
        let mut values = knob.choices.clone();
        values.retain(|one| *one != knob.default);
        if knob.choices.is_empty() {
            let value = knob.number_in(&with(&[]));
            values.push(knob.literal(&with(&[]), value + 1.3 * knob.step));
        }
        for value in values {
            let change = format!("{}={value}", knob.key);
            if knob.set(&with(&[]), &value).is_none() {
                continue;
            }
            let recordings = [drive(&[""], std::slice::from_ref(&change), 99)];
            let (search, findings) = search(&recordings, &[]);
            let result = match judge(&change, &search, &findings, 0.1) {
                Ok(error) => format!("found, error {:.2} %", 100.0 * error),
                Err(why) if why == "claims []" => "nothing claimed".to_owned(),
                Err(why) => why,
            };
            right += usize::from(result.starts_with("found"));
            wrong += usize::from(result.starts_with("claims"));
            println!("{change}: {result}");
        }
    }
    println!("{right} found, {wrong} wrong");
}

/// Random vehicles with eight settings changed each.
#[test]
#[ignore = "takes an hour; prints what is found"]
fn campaign_of_eight_changes() {
    let knobs = Knob::all(&with(&[]), "r150", &[]);
    let mut state = 5u64;
    let mut next = |below: usize| {
        state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        usize::try_from(state >> 33).unwrap() % below
    };
    for vehicle in 0..10 {
        let mut changes: Vec<(String, String)> = Vec::new();
        while changes.len() < 8 {
            let knob = &knobs[next(knobs.len())];
            let value = match knob.choices.len() {
                0 => {
                    let part = [-1.3, 1.3, 1.8][next(3)];
                    let value = knob.number_in(&with(&[]));
                    knob.literal(&with(&[]), value + part * knob.step)
                }
                count => knob.choices[next(count)].clone(),
            };
            let is_new = changes.iter().all(|(key, _)| *key != knob.key) && value != knob.default;
            if is_new && knob.set(&with(&[]), &value).is_some() {
                changes.push((knob.key.clone(), value));
            }
        }
        let texts: Vec<String> = changes
            .iter()
            .map(|(key, value)| format!("{key}={value}"))
            .collect();
        let recordings = [drive(&[""], &texts, 1000 + vehicle)];
        let (search, findings) = search(&recordings, &[]);
        let [before, after] =
            [&findings.assumed, &findings.model].map(|model| search.cost(model, true));
        println!(
            "vehicle {vehicle}: {texts:?}\n  held out: {before:.0} by default, {after:.0} fitted"
        );
        for (name, literal, number, or) in claims(&search, &findings) {
            let truth = changes
                .iter()
                .find(|(key, _)| name.starts_with(key))
                .map(|(_, value)| value);
            println!("  {name} = {literal} {number:?}, is {truth:?}, or {or:?}");
        }
    }
}

#[test]
fn every_manoeuvre_of_every_plan_can_be_read_and_names_settings() {
    for device in SHIPPED {
        let settings = with(&[]);
        let all = manoeuvres(device, settings.of_device(device).unwrap()).unwrap();
        let known: Vec<String> = settings
            .entries()
            .into_iter()
            .map(|entry| entry.key)
            .collect();
        for touched in all.iter().flat_map(|one| &one.touches) {
            let key = format!("{}.{touched}", device.id);
            let group = format!("{key}.");
            let is_known = known
                .iter()
                .any(|known| *known == key || known.starts_with(&group));
            assert!(is_known, "{key}");
        }
        let times = all
            .iter()
            .flat_map(|one| &one.frames)
            .map(|frame| frame.wait_ms);
        assert!(times.sum::<u64>() < 300_000);
    }
    assert!(Path::new("docs/examples/identify.py").exists());
}
