//! Files that are made of choices, from the vocabulary of the schemas: most of them are played.

#![expect(
    clippy::print_stdout,
    reason = "a test fails by panicking, and says how many were played"
)]

use std::collections::BTreeMap;

use proptest::prelude::*;
use sim_core::noise::Noise;
use sim_core::settings::SimSettings;
use sim_physics::WorldMap;
use sim_runner::{RigPlan, Scenario};
use sim_settings::Source;
use sim_testkit::document::play::{self, Became};
use sim_testkit::document::{rig, scenario, world};

fn choices() -> impl Strategy<Value = Vec<u8>> {
    prop::collection::vec(any::<u8>(), 0..500)
}

/// Of 300 documents of random choices, why some are refused.
fn refusals(check: impl Fn(&[u8]) -> Result<(), String>) -> BTreeMap<String, usize> {
    let mut noise = Noise::new(1, "documents");
    let mut refused = BTreeMap::new();
    for _ in 0..300 {
        let bytes: Vec<u8> = (0..500).map(|_| noise.byte()).collect();
        if let Err(why) = check(&bytes) {
            *refused.entry(why).or_insert(0) += 1;
        }
    }
    refused
}

/// At least a third have to be sound.
fn expect_a_third(refused: &BTreeMap<String, usize>) {
    let count: usize = refused.values().sum();
    println!("{count} of 300 are refused: {refused:#?}");
    assert!(count <= 200, "{count} of 300 are refused: {refused:#?}");
    assert!(count >= 10, "hardly anything is wrong with any of them");
}

#[test]
fn a_third_of_the_scenarios_is_sound() {
    expect_a_third(&refusals(|bytes| {
        let text = scenario(bytes);
        let source = Source {
            file: "s",
            text: &text,
        };
        let read = Scenario::parse(source, &SimSettings::new(sim_core::SHIPPED));
        read.map(drop).map_err(|error| error.to_string())
    }));
}

#[test]
fn a_third_of_the_rigs_is_sound() {
    expect_a_third(&refusals(|bytes| {
        let text = rig(bytes);
        let source = Source {
            file: "r",
            text: &text,
        };
        let read = RigPlan::parse(source, &SimSettings::new(sim_core::SHIPPED));
        read.map(drop).map_err(|error| error.to_string())
    }));
}

#[test]
fn a_third_of_the_worlds_is_sound() {
    expect_a_third(&refusals(|bytes| {
        let read = WorldMap::from_toml(&world(bytes), "w");
        read.map(drop).map_err(|error| error.to_string())
    }));
}

#[test]
fn without_choices_each_is_sound() {
    assert_eq!(play::scenario(&[]), Became::Played);
    WorldMap::from_toml(&world(&[]), "w").unwrap();
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(400))]

    #[test]
    fn any_document_is_refused_in_words_or_played(choices in choices()) {
        play::any(&choices);
    }
}
