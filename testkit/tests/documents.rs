//! Mutated files: most of them are played. Every key of their schemas stands in one of them.

#![expect(
    clippy::print_stdout,
    reason = "a test fails by panicking, and says how many were played"
)]

use std::collections::{BTreeMap, BTreeSet};
use std::time::Duration;

use proptest::prelude::*;
use rigsim_core::noise::Noise;
use rigsim_core::settings::SimSettings;
use rigsim_physics::WorldMap;
use rigsim_runner::{RigPlan, Scenario};
use rigsim_settings::{Source, show_toml};
use rigsim_testkit::document::corpus::{Kind, documents};
use rigsim_testkit::document::{play, scenario, text};
use rigsim_testkit::schema;
use serde_json::Value as Json;
use toml::{Table, Value};

fn check(kind: Kind, text: &str) -> Result<(), String> {
    let settings = SimSettings::new(rigsim_core::SHIPPED);
    let source = Source { file: "f", text };
    match kind {
        Kind::Scenario => Scenario::parse(source, &settings)
            .map(drop)
            .map_err(|e| e.to_string()),
        Kind::Rig => RigPlan::parse(source, &settings)
            .map(drop)
            .map_err(|e| e.to_string()),
        Kind::World => WorldMap::from_toml(text, "f")
            .map(drop)
            .map_err(|e| e.to_string()),
    }
}

/// Of 300 mutants at least a third have to be sound, and some are not.
fn expect_a_third(kind: Kind) {
    let mut noise = Noise::new(1, "documents");
    let mut refused = BTreeMap::new();
    for _ in 0..300 {
        let bytes: Vec<u8> = (0..500).map(|_| noise.byte()).collect();
        if let Err(why) = check(kind, &text(kind, &bytes)) {
            *refused
                .entry(why.chars().take(200).collect::<String>())
                .or_insert(0) += 1;
        }
    }
    let count: usize = refused.values().sum();
    println!("{count} of 300 are refused: {refused:#?}");
    assert!(count <= 200, "{count} of 300 are refused: {refused:#?}");
    assert!(count >= 10, "hardly anything is wrong with any of them");
}

#[test]
fn a_third_of_the_scenarios_is_sound() {
    expect_a_third(Kind::Scenario);
}

#[test]
fn a_third_of_the_rigs_is_sound() {
    expect_a_third(Kind::Rig);
}

#[test]
fn a_third_of_the_worlds_is_sound() {
    expect_a_third(Kind::World);
}

#[test]
fn documents_are_sound_as_they_are() {
    for kind in [Kind::Scenario, Kind::Rig, Kind::World] {
        for document in documents(kind) {
            let text = toml::to_string(&document).unwrap();
            assert_eq!(check(kind, &text), Ok(()), "{text}");
        }
    }
    let first = text(Kind::Scenario, &[]);
    assert!(scenario(&first, Duration::from_secs(1)));
}

/// The keys of a document by the key of the table in which they stand, as in `step.fault`.
fn keys(value: &Value, key: &str, found: &mut BTreeSet<String>) {
    for (inner, value) in value.as_table().into_iter().flatten() {
        found.insert(format!("{key}.{inner}"));
        keys(value, inner, found);
    }
    for value in value.as_array().into_iter().flatten() {
        keys(value, key, found);
    }
}

/// Those of a schema.
fn schema_keys(root: &Json, schema: &Json, key: &str, found: &mut BTreeSet<String>) {
    for (inner, schema) in schema::properties(root, schema) {
        if found.insert(format!("{key}.{inner}")) {
            for part in schema::parts(root, schema) {
                schema_keys(root, part, inner, found);
                schema_keys(root, &part["items"], inner, found);
            }
        }
    }
}

#[test]
fn every_key_of_the_schemas_stands_in_a_document() {
    let settings: Table = show_toml(&SimSettings::new(rigsim_core::SHIPPED))
        .parse()
        .unwrap();
    for kind in [Kind::Scenario, Kind::Rig, Kind::World] {
        let mut found = BTreeSet::from([".base".to_owned()]);
        for document in documents(kind) {
            keys(&Value::Table(document), "", &mut found);
        }
        keys(&Value::Table(settings.clone()), "settings", &mut found);
        for group in settings.values() {
            keys(group, "settings", &mut found);
        }
        let schema = kind.schema(rigsim_core::SHIPPED);
        let mut wanted = BTreeSet::new();
        schema_keys(&schema, &schema, "", &mut wanted);
        assert!(wanted.len() > 30, "{kind:?}: {wanted:?}");
        let missing: Vec<&String> = wanted.difference(&found).collect();
        assert!(
            missing.is_empty(),
            "{kind:?}: put these into testkit/corpus: {missing:?}"
        );
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(400))]

    #[test]
    fn any_document_is_refused_in_words_or_played(
        choices in prop::collection::vec(any::<u8>(), 0..200),
    ) {
        play(&choices);
    }
}
