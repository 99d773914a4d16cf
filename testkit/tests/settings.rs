//! Every setting takes nothing that breaks the simulation: what it refuses is reported with its name
//! and range, and with what it takes both devices drive.

use std::time::Duration;

use proptest::prelude::*;
use rigsim_core::settings::SimSettings;
use rigsim_physics::WorldMap;
use rigsim_settings::load_toml;
use rigsim_testkit::setting::{ends, entries, line};
use rigsim_testkit::text;

/// Time of a round, of which a device gets a command in every tenth.
const PACE: Duration = Duration::from_millis(50);
/// Numbers that no setting means. Some are in a range all the same.
const ABSURD: &[&str] = &[
    "nan", "-nan", "inf", "-inf", "1e308", "-1e308", "1e39", "-1e39", "1e-308", "0", "-0.0", "-1",
    "1", "1e9", "1e18",
];
/// Values of other types, and numbers that TOML cannot hold.
const FOREIGN: &[&str] = &[
    "\"\"",
    "\"nan\"",
    "\"off\"",
    "\"1 parsec\"",
    "\"1e400 m\"",
    "\"٣ m\"",
    "true",
    "[]",
    "[[[]]]",
    "{}",
    "{ a = 1 }",
    "1979-05-27",
    "99999999999999999999999",
    "9223372036854775807",
    "-9223372036854775808",
];

/// The end of a setting's range, or its default, with these numbers in place of those in it.
fn absurd(entry: &rigsim_settings::Entry) -> Vec<String> {
    let template = ends(entry).pop().unwrap_or_else(|| entry.default.clone());
    let is_number = |c: char| c.is_ascii_digit() || "+-.".contains(c);
    let with = |number: &&str| {
        let mut parts = Vec::new();
        for part in template.split(", ") {
            let start = part.find(is_number);
            let end = part.rfind(is_number).map(|at| at + 1);
            let (start, end) = start.zip(end)?;
            parts.push([&part[..start], number, &part[end..]].concat());
        }
        Some(parts.join(", "))
    };
    ABSURD.iter().filter_map(with).collect()
}

#[test]
fn absurd_values_are_refused_by_name_or_do_no_harm() {
    let mut refused = 0;
    let mut driven = 0;
    for entry in entries() {
        let absurd = absurd(&entry);
        let foreign = FOREIGN.iter().map(|&literal| literal.to_owned());
        for literal in absurd.into_iter().chain(foreign) {
            let mut settings = SimSettings::new(rigsim_core::SHIPPED);
            let text = line(&entry.key, &literal);
            match load_toml(&text, "my.toml", &mut settings) {
                Err(errors) => {
                    refused += 1;
                    let reported = errors[0].to_string();
                    for part in ["my.toml:1", &entry.key, &entry.allowed.words] {
                        // A syntax error is reported by the parser, which knows no settings.
                        let has = reported.contains(part)
                            || literal.contains("nan") && part != "my.toml:1";
                        assert!(has || literal == "{ a = 1 }", "{text}: {reported}");
                    }
                }
                Ok(()) => {
                    driven += 1;
                    text::drive(&settings, WorldMap::default(), Some(PACE), 20);
                }
            }
            for not_finite in ["nan", "inf", "1e308", "1e400"] {
                assert!(
                    !literal.contains(not_finite)
                        || settings == SimSettings::new(rigsim_core::SHIPPED),
                    "{text} is taken"
                );
            }
        }
    }
    assert!(
        refused > 2000 && driven > 100,
        "{refused} refused, {driven} driven"
    );
}

#[test]
fn both_ends_of_every_range_drive() {
    let mut tried = 0;
    for entry in entries() {
        for literal in ends(&entry) {
            let mut settings = SimSettings::new(rigsim_core::SHIPPED);
            let text = line(&entry.key, &literal);
            let loaded = load_toml(&text, "my.toml", &mut settings);
            assert_eq!(loaded, Ok(()), "{text}");
            tried += 1;
            println!("{text}");
            text::drive(&settings, WorldMap::default(), Some(PACE), 20);
        }
    }
    assert!(tried > 200, "{tried}");
}

#[test]
fn a_range_without_end_has_a_reason() {
    // What has no range must be a word, a switch, or something whose type is its range.
    for entry in entries() {
        let is_number =
            entry.allowed.words.contains("number") || entry.allowed.words.contains("a time");
        assert!(
            !is_number || entry.allowed.range.is_some(),
            "{}: {}",
            entry.key,
            entry.allowed.words
        );
    }
}

/// A choice for each setting: what it is, or an end of its range.
fn any_extremes() -> impl Strategy<Value = String> {
    let choices = entries().into_iter().filter_map(|entry| {
        let literals = ends(&entry).into_iter();
        let lines: Vec<String> = literals.map(|literal| line(&entry.key, &literal)).collect();
        (!lines.is_empty())
            .then(|| prop_oneof![6 => Just(String::new()), 1 => prop::sample::select(lines)])
    });
    choices.collect::<Vec<_>>().prop_map(|lines| lines.concat())
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    #[test]
    fn any_extremes_together_drive(text in any_extremes()) {
        let mut settings = SimSettings::new(rigsim_core::SHIPPED);
        prop_assert_eq!(load_toml(&text, "my.toml", &mut settings), Ok(()));
        text::drive(&settings, WorldMap::default(), Some(PACE), 10);
    }
}
