//! Settings are found again: the model with other settings, by another chance, is the vehicle.

use std::path::Path;

use rigsim_core::SHIPPED;
use rigsim_core::event::read_hex;
use rigsim_core::settings::SimSettings;
use rigsim_runner::trace::{Header, Hexed, PortRecord, Record, Replay};
use rigsim_settings::{ClientLine, Settings as _, SimTime, parse_assignment, parse_quantity};

use super::knob::Knob;
use super::page::page;
use super::plan::{manoeuvres, parts, touching};
use super::poses::{APART, TimedPose, Track};
use super::recording::Recording;
use super::report::{FieldRow, Report};
use super::search::{Doubt, Findings, Search, Verdict, read_best};
use super::{header, plan_of};

pub(super) fn with(changes: &[String]) -> SimSettings {
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
pub(super) fn drive(parts: &[&str], settings: &SimSettings, seed: u64) -> Recording {
    drive_of("r150", parts, settings, seed, false)
}

/// The same for a device, with poses beside it.
fn drive_of(
    id: &str,
    parts: &[&str],
    settings: &SimSettings,
    seed: u64,
    has_poses: bool,
) -> Recording {
    let (header, records, poses) = records_of(id, parts, settings, seed, 0);
    let mut recording = Recording::of(SHIPPED, header, records, &with(&[])).unwrap();
    read_best(std::slice::from_mut(&mut recording), &with(&[])).unwrap();
    if has_poses {
        let added = recording.add_poses(&poses, Some(0.0), &with(&[]));
        added.unwrap();
    }
    recording
}

/// What is recorded of a drive that begins so many ns after the vehicle was switched on, and its poses.
fn records_of(
    id: &str,
    parts: &[&str],
    settings: &SimSettings,
    seed: u64,
    begins: u64,
) -> (Header, Vec<Record>, Vec<TimedPose>) {
    let device = SHIPPED.iter().find(|device| device.id == id).unwrap();
    let own = settings.of_device(device).unwrap();
    let mut all = manoeuvres(device, own).unwrap();
    all.retain(|one| parts.iter().any(|part| one.name.contains(part)));
    assert!(!all.is_empty());
    let client = "lockstep".into();
    let mut records = vec![Record::Time { client, date: None }];
    for link in 0..device.links.len() {
        let (t, port, line) = (
            begins + 1,
            PortRecord(0, link),
            ClientLine::at(own.baud(link)),
        );
        records.extend([Record::Attach { t, port }, Record::Line { t, port, line }]);
    }
    let mut t = begins + 1_000_000;
    for frame in all.iter().flat_map(|one| &one.frames) {
        let bytes = Hexed(read_hex(frame.bytes.chars()).unwrap());
        let port = PortRecord(0, frame.link);
        records.push(Record::In { t, port, bytes });
        t += frame.wait_ms * 1_000_000;
    }
    let mut header = header(&plan_of(SHIPPED, id, device.links.len(), settings.clone()).unwrap());
    header.seed = seed;
    let end = t + 1_000_000_000;
    let times: Vec<u64> = (1..end / APART).map(|at| at * APART).collect();
    let mut track = Track {
        times: &times,
        poses: Vec::new(),
    };
    let sent = Replay::play(
        SHIPPED,
        &header,
        &records,
        SimTime::from_nanos(end),
        Some(&mut track),
    );
    for (port, bytes) in sent.unwrap() {
        let port = PortRecord::from(port);
        records.extend(bytes.into_iter().map(|(t, byte)| {
            let bytes = Hexed(vec![byte]);
            Record::Out {
                t,
                dt: 0,
                port,
                bytes,
            }
        }));
    }
    (header, records, track.poses)
}

/// The records from a time on, as of real time.
fn in_real_time(records: Vec<Record>, begins: u64) -> Vec<Record> {
    let later = records
        .into_iter()
        .filter_map(|mut record| match &mut record {
            Record::In { t, .. }
            | Record::Out { t, .. }
            | Record::Attach { t, .. }
            | Record::Line { t, .. } => {
                *t = t.checked_sub(begins)?;
                Some(record)
            }
            // It names simulated time.
            _ => None,
        });
    later.collect()
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
    // Of a version, the part that differs.
    let differs = |knob: &&Knob| {
        let is_other = knob.number_in(&settings) != knob.number_in(&search.base);
        knob.key == key && (is_other || !knob.choices.is_empty())
    };
    let knob = search.knobs.iter().find(differs).unwrap();
    let [(name, literal, number, or)] = &*claims else {
        return Err(format!("claims {claims:?}"));
    };
    if *name != knob.name() && !or.contains(&knob.name()) {
        return Err(format!("claims {claims:?}"));
    }
    if !or.is_empty() {
        return Err(format!("not decided: {name} or {or:?}"));
    }
    if let Some(doubt) = search.doubt(&findings.found[0]) {
        return Err(format!("not decided: {name} {number:?}, {doubt:?}"));
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

#[test]
fn a_beginning_is_played_as_the_whole() {
    let whole = drive(&["malformed"], &with(&[]), 5);
    let beginning = whole.beginning(1, 2);
    let [long, short] = [&whole, &beginning].map(|one| one.play(&with(&[]), 3).unwrap());
    assert_eq!(short.len(), whole.slots.len() / 2);
    // What comes behind the end may change the last replies.
    let same = short.len() - 4;
    assert!(same > 20);
    assert_eq!(short[..same], long[..same]);
    assert_eq!(beginning.seen, whole.seen[..short.len()]);
}

#[test]
fn a_car_is_played_as_long_as_it_sends() {
    let recording = drive_of("mecanum", &["coordinates"], &with(&[]), 5, false);
    let last = recording.seen.last().unwrap().as_ref();
    let played = recording.play(&with(&[]), 5).unwrap();
    assert_eq!(played.last().unwrap().as_ref(), last);
    assert!(last.is_some());
}

#[test]
fn a_model_reports_when_a_car_does_that_was_on_before() {
    // Neither of the car's periods divides it.
    const BEGINS: u64 = 1_030_000_000;
    let settings = with(&["mecanum.status_period=126ms".to_owned()]);
    let (header, records, _) = records_of("mecanum", &["turns"], &settings, 5, BEGINS);
    let recorded = in_real_time(records, BEGINS);
    let recorded = Recording::of(SHIPPED, header, recorded, &settings).unwrap();
    let played = recorded.play(&settings, 0).unwrap();
    let pairs = recorded.seen.iter().flatten().zip(played.iter().flatten());
    // The length of a report differs by some bytes, and so the time at which it ends.
    let late = pairs.filter(|(vehicle, model)| vehicle.at.abs_diff(model.at) > 1_500_000);
    assert_eq!(late.count(), 0);
    assert!(played.iter().all(Option::is_some));
}

/// No message of an R150 tells when it was switched on.
#[test]
fn a_vehicle_anywhere_in_its_cycle_does_what_its_settings_say() {
    let changes = ["r150.battery.resistance=0.05 ohm".to_owned()];
    for begins in [1_003_000_000, 1_008_000_000, 1_014_000_000] {
        let (header, records, _) = records_of("r150", &["turns"], &with(&changes), 5, begins);
        let recorded = in_real_time(records, begins);
        let recordings = [Recording::of(SHIPPED, header, recorded, &with(&[])).unwrap()];
        let search = Search::new(&recordings, with(&[]), &[]);
        let costs = [with(&changes), with(&[])].map(|settings| {
            let model = search.model(&settings, 1.0).unwrap();
            search.cost(&model, false) / search.by_chance(&model, false)
        });
        assert!(costs[0] < 1.1 && costs[1] > 1.5, "{begins}: {costs:?}");
    }
}

#[test]
fn a_number_that_leaves_no_reply_has_no_close_interval() {
    let whole = drive(
        &["questions"],
        &with(&["r150.boot_time=40ms".to_owned()]),
        3,
    );
    let recordings = [whole.beginning(1, whole.slots.len())];
    let (search, findings) = search(&recordings, &["r150.boot_time"]);
    let [found] = &*findings.found else {
        panic!("{:?}", claims(&search, &findings));
    };
    assert_eq!(recordings[0].seen, [None]);
    assert_eq!(search.doubt(found), Some(Doubt::OneEnd));
}

/// A machine passes all bytes of the vehicle on 1.6 ms late. Some replies then come after the next request.
#[test]
fn replies_that_a_machine_delays_are_of_the_same_requests() {
    for (delay, doubt) in [(0, None), (3, Some(Doubt::Rough)), (12, None)] {
        let changes = [format!("r150.reply_delay={delay}ms")];
        let parts = ["questions", "too many commands"];
        let (header, records, _) = records_of("r150", &parts, &with(&changes), 3, 0);
        let mut records = in_real_time(records, 0);
        for record in &mut records {
            if let Record::Out { t, .. } = record {
                *t += 1_600_000;
            }
        }
        let recordings = [Recording::of(SHIPPED, header, records, &with(&[])).unwrap()];
        assert!(recordings[0].is_real);
        let keys = [
            "r150.reply_delay",
            "r150.over_rate",
            "r150.motor_reply_interval",
        ];
        let (search, findings) = search(&recordings, &keys);
        let claims = claims(&search, &findings);
        if delay == 0 {
            assert!(findings.found.is_empty(), "{claims:?}");
            continue;
        }
        let [found] = &*findings.found else {
            panic!("{delay} ms: {claims:?}");
        };
        let Some((_, [Some(low), Some(high)])) = found.number else {
            panic!("{:?}", found.number);
        };
        let is_inside = (low..=high).contains(&(f64::from(delay) / 1e3));
        assert!(
            is_inside && search.doubt(found) == doubt,
            "{delay} ms: {low} to {high}"
        );
    }
}

/// A timeout of 16 ms refuses pauses of 17 to 19 ms. In real time, the machine may have been late.
#[test]
fn one_late_byte_of_a_real_recording_decides_nothing() {
    for (time, is_real, doubt) in [
        ("16ms", false, None),
        ("16ms", true, Some(Doubt::Before)),
        ("30ms", true, None),
    ] {
        let changes = [format!("r150.inter_byte_timeout={time}")];
        let mut recordings = [drive(&["malformed"], &with(&changes), 3)];
        recordings[0].is_real = is_real;
        let (search, findings) = search(&recordings, &["r150.inter_byte_timeout"]);
        let [found] = &*findings.found else {
            panic!("{time}: {:?}", claims(&search, &findings));
        };
        assert_eq!(search.doubt(found), doubt, "{time}: {:?}", found.number);
    }
}

#[test]
fn numbers_are_changed_by_steps_and_back() {
    for knob in Knob::all(&with(&[]), "r150", &[]) {
        let number = knob.number_in(&with(&[]));
        for steps in [-2.0, 0.5, 3.0]
            .into_iter()
            .filter(|_| knob.choices.is_empty())
        {
            let back = knob.steps_between(number, knob.beyond(number, steps));
            assert!((back - steps).abs() < 1e-9, "{}: {back}", knob.key);
        }
    }
}

#[test]
fn a_number_is_known_well_by_the_ratio_of_its_ends_or_by_steps() {
    for (key, low, high, is_close) in [
        ("r150.motor.dead_band", 3.0, 6.0, true),
        ("r150.motor.dead_band", 3.0, 6.1, false),
        ("r150.boot_time", 0.0, 0.006, false),
        ("r150.boot_time", 0.0, 0.005, true),
        ("r150.boot_time", 2.0, 2.9, true),
        ("r150.reply_delay", 0.0028, 0.0052, true),
        ("r150.reply_delay", 0.00001, 0.00005, false),
        ("world.slope", -9.0, -7.0, true),
        ("world.slope", -0.3, 0.3, false),
        ("r150.thermal.ambient", 15.0, 17.5, true),
        ("r150.thermal.ambient", 15.0, 17.6, false),
    ] {
        let all = Knob::all(&with(&[]), "r150", &[]);
        let knob = all.iter().find(|knob| knob.key == key).unwrap();
        assert_eq!(knob.is_close(low, high), is_close, "{key} {low} {high}");
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
        "r150.over_rate=answer",
        &["r150.over", "r150.motor_reply"],
        0.0,
    ),
    (
        "too many",
        "r150.baud=57600 baud",
        &["r150.baud", "r150.reply_delay"],
        0.0,
    ),
    (
        "coordinates",
        "mecanum.byte_order=big",
        &["mecanum.status_", "mecanum.byte_order", "mecanum.baud"],
        0.0,
    ),
    (
        "coordinates",
        "mecanum.status_period=130ms",
        &["mecanum.status_", "mecanum.byte_order", "mecanum.baud"],
        0.001,
    ),
];

#[test]
fn a_changed_setting_is_found() {
    let mut wrong = Vec::new();
    for (parts, change, only, tolerance) in ONE_AT_A_TIME {
        let device = change.split('.').next().unwrap();
        let changed = with(&[(*change).to_owned()]);
        let recordings = [drive_of(device, &[parts], &changed, 77, false)];
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
fn choices_that_a_drive_does_not_tell_apart_are_not_decided() {
    // Nothing moves, so a command that is ignored does the same as one without a reply.
    let changes = ["r150.over_rate=silent".to_owned()];
    let recordings = [drive(&["too many"], &with(&changes), 77)];
    let (search, findings) = search(&recordings, &["r150.over", "r150.motor_reply"]);
    let claims = claims(&search, &findings);
    let [(name, _, None, or)] = &*claims else {
        panic!("{claims:?}");
    };
    assert_eq!((&**name, or.len()), ("r150.over_rate", 1), "{claims:?}");
    assert!(!findings.verdicts.contains(&Verdict::Contradicted));
    let text = Report::of(&search, &findings).fit_text();
    let since = "not written   r150.over_rate, since it may be one of these instead: ";
    assert!(text.contains(since), "{text}");
    assert!(
        text.contains("(nothing is certain enough: nothing is written but as a comment)"),
        "{text}"
    );
}

#[test]
fn nothing_is_claimed_of_a_vehicle_that_is_as_assumed() {
    for (seed, parts) in [(31, "malformed"), (32, "too many"), (33, "small")] {
        let recordings = [drive(&[parts], &with(&[]), seed)];
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
        let recordings = [drive(&["rails"], &with(std::slice::from_ref(&change)), 77)];
        let (search, findings) = search(&recordings, &["r150.heartbeat_timeout"]);
        let claims = claims(&search, &findings);
        let [(_, _, Some((_, [Some(low), high])), _)] = &*claims else {
            panic!("{truth}: {claims:?}");
        };
        assert_eq!(high.is_some(), is_closed, "{truth}: {claims:?}");
        assert!((3.0..3.5).contains(low) || !is_closed, "{truth}: {low}");
        assert!(high.is_none_or(|high| high > 3.5), "{truth}: {claims:?}");
        let report = Report::of(&search, &findings);
        let (text, toml) = (report.text(), report.toml(&with(&[])));
        assert_eq!(toml.contains("\nr150."), is_closed, "{toml}");
        let words = format!("more than {}", format!("{low:.2e}").parse::<f64>().unwrap());
        let since = "\n# Not written, since the recording shows one end of it only\n";
        assert_eq!(toml.contains(since), !is_closed, "{toml}");
        let is_said = text.contains(&words) && toml.contains(&words);
        assert!(is_said || is_closed, "{text}\n{toml}");
    }
}

#[test]
fn a_time_far_from_the_documented_one_is_found() {
    let changes = ["r150.heartbeat_timeout=1s".to_owned()];
    let recordings = [drive(&["rails"], &with(&changes), 77)];
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
fn missing_replies_are_unexplained_where_hardly_two_requests_are_the_same() {
    let mut recordings = [drive(&["small"], &with(&[]), 34)];
    let mut dropped = std::collections::BTreeMap::new();
    let Recording { slots, seen, .. } = &mut recordings[0];
    for (slot, seen) in slots.iter().zip(seen) {
        let count = dropped.entry(&slot.text).or_insert(0);
        *count += 1;
        *seen = seen.take().filter(|_| *count > 2);
    }
    let (search, findings) = search(&recordings, &["r150.version_order"]);
    let mut report = Report::of(&search, &findings);
    let [one] = &*report.unexplained else {
        panic!("{}", report.text());
    };
    assert!(one.starts_with("set_motors: "), "{one}");
    // What moves in the model only has a plot, too.
    let field = |name: &str, model| FieldRow {
        name: name.to_owned(),
        range: [2.0, 2.0],
        rms: model - 2.0,
        series: vec![[0.0, 2.0, 2.0], [1.0, 2.0, model]],
        ..FieldRow::default()
    };
    report.fields = vec![field("moves", 3.0), field("stands", 2.0)];
    let captions = page(&report).matches("<figcaption>moves").count();
    assert_eq!(
        (captions, page(&report).matches("<figure>").count()),
        (1, 1)
    );
}

#[test]
fn replies_of_another_form_and_order_are_counted_by_command() {
    let mut recordings = [drive(&["questions"], &with(&[]), 35)];
    let Recording { slots, seen, .. } = &mut recordings[0];
    let place = |name: &str| slots.iter().position(|slot| slot.name == name).unwrap();
    let [version, heartbeat] = ["version", "heartbeat"].map(place);
    seen[version].as_mut().unwrap().form.2 += 1;
    let before = seen[heartbeat - 1].as_ref().unwrap().at;
    seen[heartbeat].as_mut().unwrap().at = before - 1;
    let (search, findings) = search(&recordings, &["r150.version_order"]);
    let report = Report::of(&search, &findings);
    let (text, json) = (report.text(), serde_json::to_value(&report).unwrap());
    let rows = json["commands"].as_array().unwrap();
    assert_eq!(rows.len(), 5, "{json:#}");
    for row in rows {
        let name = row["name"].as_str().unwrap();
        let is = |other| u8::from(name == other);
        assert_eq!(row["other_form"], is("version"), "{row}");
        assert_eq!(
            row["out_of_order"],
            serde_json::json!([is("heartbeat"), 0]),
            "{row}"
        );
        let line = text.lines().find(|line| line.starts_with(name)).unwrap();
        assert_eq!(
            line.contains("; 1 of another form"),
            name == "version",
            "{line}"
        );
        assert_eq!(
            line.contains("; out of order 1 / 0"),
            name == "heartbeat",
            "{line}"
        );
    }
}

#[test]
fn a_wider_spread_of_reply_times_is_not_taken_for_a_delay() {
    const DELAY: &str = "r150.reply_delay";
    const SPREAD: &str = "r150.reply_spread";
    let find = |part: &str, base: &str, changes: &[(&str, &str)], only: &str| {
        let set = |(key, value): &(&str, &str)| format!("{key}=\"{value}\"");
        let changed = with(&changes.iter().map(set).collect::<Vec<_>>());
        let has_poses = part == "step";
        let recordings = [drive_of("r150", &[part], &changed, 99, has_poses)];
        let base = with(&[set(&(DELAY, base))]);
        let search = Search::new(&recordings, base, &[only.to_owned()]);
        let findings = search.run().unwrap();
        let claims = claims(&search, &findings);
        let [(.., Some((_, [Some(low), Some(high)])), or)] = &*claims else {
            panic!("{changes:?}: {claims:?}");
        };
        let truth = search.knobs[findings.found[0].knob].number_in(&changed);
        let is_inside = (low..=high).contains(&&truth);
        (or.clone(), findings.written != search.base, is_inside)
    };
    for (part, spread, only) in [
        ("", "252us", "r150.reply"),
        ("", "252us", DELAY),
        ("step", "600us", "r150.reply"),
        ("small", "3ms", "r150.reply"),
    ] {
        let (or, is_written, _) = find(part, "0ms", &[(SPREAD, spread)], only);
        assert_eq!(
            (or, is_written),
            (vec![SPREAD.to_owned()], false),
            "{part} {spread}"
        );
    }
    // A delay makes replies later, and they scatter as before.
    for (part, base, changes, is_certain) in [
        ("", "0ms", &[(DELAY, "60us")][..], false),
        ("small", "0ms", &[(DELAY, "1ms")], true),
        ("small", "1.1ms", &[(DELAY, "1ms")], true),
        ("small", "0ms", &[(DELAY, "1ms"), (SPREAD, "350us")], true),
        ("small", "0ms", &[(DELAY, "1ms"), (SPREAD, "50us")], true),
    ] {
        let found = find(part, base, changes, "r150.reply");
        assert_eq!(found, (vec![], is_certain, true), "{base} {changes:?}");
    }
}

#[test]
fn an_interval_includes_the_values_in_models_that_are_as_good() {
    let all = Knob::all(&with(&[]), "r150", &[]);
    let knob = all.iter().find(|knob| knob.key == "r150.reply_delay");
    let knob = knob.unwrap();
    let with_delay = |ms: f64| with(&[format!("r150.reply_delay=\"{ms}ms\"")]);
    let moves = |models: &[&[f64]]| {
        let models = models.iter();
        let models = models.map(|one| one.iter().map(|ms| with_delay(*ms)).collect());
        let models: Vec<Vec<_>> = models.collect();
        let moves = knob.moves(0.01, models.iter().map(|one| &**one));
        moves.map(|steps| 1000.0 * knob.beyond(0.01, steps))
    };
    for (models, [low, high]) in [
        (&[&[][..], &[10.0]][..], [10.0, 10.0]),
        (&[&[8.0, 9.0]], [8.0, 10.0]),
        (&[&[8.0, 12.5]], [8.0, 12.5]),
        // Of each change that may be another, and so of all.
        (&[&[8.0], &[12.5], &[5.0, 20.0]], [3.0, 22.5]),
    ] {
        let [least, most] = moves(models);
        assert!(
            (least - low).abs() < 1e-6 && (most - high).abs() < 1e-6,
            "{least} {most}"
        );
    }
}

#[test]
fn the_file_keeps_what_its_file_had_and_the_decided_parts_of_a_version() {
    for version in ["\"40.0.0.0\"", "\"1.0.0.1\""] {
        let changes = [format!("r150.hardware_version={version}")];
        let recordings = [drive(&["questions"], &with(&changes), 77)];
        let only = ["r150.hardware_version".to_owned()];
        let before = ["r150.on_bad_crc=false", "world.friction=0"].map(str::to_owned);
        let search = Search::new(&recordings, with(&before), &only);
        let report = Report::of(&search, &search.run().unwrap());
        let toml = report.toml(&with(&before[..1]));
        assert!(!toml.contains("friction"), "{toml}");
        for line in [
            "r150.on_bad_crc = \"false\"",
            &*format!("r150.hardware_version = {version}"),
        ] {
            assert!(toml.lines().any(|one| one == line), "{toml}");
        }
    }
}

/// Every setting, one at a time, over the whole drive; prints what is found. `DEVICE=mecanum` is the car, `ONLY` is
/// a part of the settings' names, and `STEPS` is by how many steps a number changes.
#[test]
#[ignore = "takes an hour; prints what is found"]
fn campaign_of_single_changes() {
    let (mut wrong, mut right) = (0, 0);
    let only = std::env::var("ONLY").unwrap_or_default();
    let device = std::env::var("DEVICE").unwrap_or("r150".to_owned());
    let steps: f64 = std::env::var("STEPS").map_or(1.3, |steps| steps.parse().unwrap());
    for knob in Knob::all(&with(&[]), &device, &[])
        .iter()
        .filter(|knob| knob.key.contains(&only))
    {
        let mut values = knob.choices.clone();
        values.retain(|one| *one != knob.default);
        if knob.choices.is_empty() {
            let value = knob.number_in(&with(&[]));
            values.push(knob.literal(&with(&[]), value + steps * knob.step));
        }
        for value in values {
            let change = format!("{}={value}", knob.key);
            if knob.set(&with(&[]), &value).is_none() {
                continue;
            }
            let changed = with(std::slice::from_ref(&change));
            let recordings = [drive_of(&device, &[""], &changed, 99, false)];
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

/// Random vehicles with eight settings changed each. `VEHICLES=20..40` are others, `CHANGES=0` are as assumed, and
/// `POSES=1` gives poses.
#[test]
#[ignore = "takes hours; prints what is found"]
fn campaign_of_many_changes() {
    let changes = std::env::var("CHANGES").map_or(8, |count| count.parse().unwrap());
    let vehicles = std::env::var("VEHICLES").unwrap_or("0..10".to_owned());
    let (first, end) = vehicles.split_once("..").unwrap();
    let mut counts = std::collections::BTreeMap::new();
    for vehicle in first.parse().unwrap()..end.parse().unwrap() {
        let (changed, recordings) = vehicle_with_changes(vehicle, changes);
        let begun = std::time::Instant::now();
        let (search, findings) = search(&recordings, &[]);
        println!("vehicle {vehicle}: {:.0?}", begun.elapsed());
        tally(&search, &findings, &changed, &mut counts);
    }
    println!("{counts:?}");
}

/// The recording `TRACE` of a vehicle with the settings in `CONFIG`, a line for each, searched among `ONLY`.
#[test]
#[ignore = "takes a recording; prints what is found"]
fn campaign_of_a_recording() {
    let text = |name| std::fs::read_to_string(std::env::var(name).unwrap()).unwrap();
    let changes: Vec<String> = text("CONFIG").lines().map(str::to_owned).collect();
    let trace = std::env::var("TRACE").unwrap();
    let mut recording = Recording::read(SHIPPED, trace.as_ref(), &with(&[]));
    let recordings = recording.as_mut().map(std::slice::from_mut).unwrap();
    read_best(recordings, &with(&[])).unwrap();
    let only = std::env::var("ONLY").unwrap_or_default();
    let (search, findings) = search(recordings, &only.split(' ').collect::<Vec<_>>());
    tally(&search, &findings, &with(&changes), &mut Default::default());
}

/// Counts what was found of a vehicle with these settings, and prints it.
fn tally(
    search: &Search<'_>,
    findings: &Findings,
    changed: &SimSettings,
    counts: &mut std::collections::BTreeMap<&str, usize>,
) {
    println!("  held out {:.0?}", findings.held_out);
    let truth = search.model(changed, 1.0).unwrap();
    for (name, model) in [("found", &findings.model), ("truth", &truth)] {
        let (cost, chance) = (search.cost(model, false), search.by_chance(model, false));
        println!("  {name}: cost {cost:.0}, chance {chance:.0}");
    }
    for (at, knob) in search.knobs.iter().enumerate() {
        let found = findings.found.iter().find(|one| one.knob == at);
        // Of a version, one part at a time.
        let value = |settings: &SimSettings| match knob.choices.len() {
            0 => knob.number_in(settings).to_string(),
            _ => knob.literal_in(settings),
        };
        let [truth, base, written] = [changed, &search.base, &findings.written].map(value);
        let numbers = [changed, &findings.written].map(|settings| knob.number_in(settings));
        let error = (numbers[1] / numbers[0] - 1.0).abs();
        let is_time = parse_quantity(&format!("1 {}", knob.unit()), "s").is_ok();
        let most = if is_time { 0.1 } else { 0.05 };
        let is_inside = found
            .and_then(|found| found.number)
            .is_none_or(|(_, ends)| {
                let [low, high] = ends.map(Option::unwrap_or_default);
                (low..=high).contains(&numbers[0])
            });
        // Also one of two that explain it together.
        let mut instead = findings.found.iter().flat_map(|one| &one.or);
        let is_named =
            found.is_some() || instead.any(|or| or.split(" with ").any(|one| one == knob.name()));
        let is_rough = |one| search.doubt(one) == Some(Doubt::Rough) && is_inside;
        let class = match (truth != base, written != base) {
            (false, false) if found.is_none() => continue,
            (false, false) => "not written",
            (false, true) => "FALSE",
            (true, true) if !knob.choices.is_empty() && written != truth => "WRONG",
            (true, true) if !is_inside => "outside its interval",
            // What only shows in which replies are there has a wide interval.
            (true, true) if knob.choices.is_empty() && error > most => "found, wide",
            (true, true) => "found",
            (true, false) if found.is_some_and(is_rough) => "roughly",
            (true, false) if is_named => "named",
            (true, false) => "missed",
        };
        *counts.entry(class).or_insert(0) += 1;
        let found = found.map(|found| (&found.literal, found.number, &found.or));
        println!("  {class}: {} = {truth}, {found:?}", knob.name());
    }
}

/// Settings of a random vehicle, and a recording of it. Each change shows in it: without it, the model with
/// the others does something else.
fn vehicle_with_changes(vehicle: u64, changes: usize) -> (SimSettings, Vec<Recording>) {
    let mut knobs = Knob::all(&with(&[]), "r150", &[]);
    knobs.retain(|knob| !knob.is_chance);
    let mut state = vehicle.wrapping_add(5).wrapping_mul(0x9E37_79B9_7F4A_7C15);
    let mut next = |below: usize| {
        state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        usize::try_from(state >> 33).unwrap() % below
    };
    let mut settings = with(&[]);
    let mut changed = std::collections::BTreeSet::new();
    let mut recordings = vec![drive(&[""], &settings, 1000 + vehicle)];
    while changed.len() < changes {
        let knob = &knobs[next(knobs.len())];
        let value = match knob.choices.len() {
            0 => {
                let part = [-1.3, 1.3, 1.8][next(3)];
                knob.literal(&settings, knob.number_in(&with(&[])) + part * knob.step)
            }
            count => knob.choices[next(count)].clone(),
        };
        let more = knob
            .set(&settings, &value)
            .filter(|_| value != knob.default);
        let Some(more) = more.filter(|_| !changed.contains(&knob.name())) else {
            continue;
        };
        let with_it = vec![drive(&[""], &more, 1000 + vehicle)];
        let search = Search::new(&with_it, with(&[]), &[]);
        let cost = |one| search.costs(&search.model(one, 1.0).unwrap()).unwrap();
        let [before, after] = [&settings, &more].map(|one| cost(one).each.iter().sum::<f64>());
        if before > after + 100.0 {
            changed.insert(knob.name());
            (settings, recordings) = (more, with_it);
        }
    }
    if std::env::var_os("POSES").is_some() {
        recordings = vec![drive_of("r150", &[""], &settings, 1000 + vehicle, true)];
    }
    (settings, recordings)
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
        let by_hand = parts("by_hand", device, settings.of_device(device).unwrap()).unwrap();
        assert!(by_hand.iter().all(|one| !one.name.is_empty()));
        for touched in all.iter().chain(&by_hand).flat_map(|one| &one.touches) {
            let key = format!("{}.{touched}", device.id);
            let group = format!("{key}.");
            let is_known = known
                .iter()
                .any(|known| *known == key || known.starts_with(&group));
            assert!(is_known, "{key}");
            let is_shown = !["noise", "adapter", "boot_time"]
                .iter()
                .any(|part| key.contains(part));
            assert!(is_shown, "no recording tells {key}");
        }
        let times = all
            .iter()
            .flat_map(|one| &one.frames)
            .map(|frame| frame.wait_ms);
        assert!(times.sum::<u64>() < 300_000);
    }
    for (key, words) in [
        (
            "r150.tyre.wheel_radius",
            "the manoeuvre \"turns on the spot and with one side\" of",
        ),
        ("r150.baud", "the manoeuvre \"too many commands\" of"),
        (
            "r150.protection.limit_5v",
            "model does not follow: load an output",
        ),
        (
            "r150.protection.undervoltage",
            "model does not follow: drive until the battery",
        ),
        (
            "world.uphill",
            "no manoeuvre of `sim fit --plan` touches it",
        ),
    ] {
        let device = SHIPPED.iter().find(|device| device.id == "r150").unwrap();
        assert!(
            touching(device, key).contains(words),
            "{key}: {}",
            touching(device, key)
        );
    }
    assert!(Path::new("docs/examples/identify.py").exists());
}
