//! The declarations, the types and the schema say the same.

use std::collections::BTreeSet;

use schemars::SchemaGenerator;
use serde_json::Value;

use super::*;
use crate::device::{DeviceSpec, Level};
use crate::mecanum::MECANUM_SPEC;
use crate::r150::R150_SPEC;

/// Variants of a schema: their names, their properties, and which of them must be given.
fn variants(effects: &Effects) -> Vec<(String, BTreeSet<String>, BTreeSet<String>)> {
    let schema = (effects.schema)(&mut SchemaGenerator::default()).to_value();
    let variants = match schema["oneOf"].as_array() {
        Some(variants) => variants.clone(),
        None => vec![schema],
    };
    let read = |variant: &Value| {
        assert!(variant["description"].as_str().is_some(), "{variant}");
        let names = |list: Vec<&str>| {
            let own = list.into_iter().filter(|name| *name != "kind");
            own.map(str::to_owned).collect::<BTreeSet<String>>()
        };
        if let Some(word) = variant["const"].as_str() {
            return (word.to_owned(), names(vec![]), names(vec![]));
        }
        assert_eq!(variant["additionalProperties"], Value::Bool(false));
        let properties = variant["properties"].as_object().unwrap();
        let Some(kind) = properties.get("kind") else {
            let name = properties.keys().next().unwrap();
            return (name.clone(), names(vec![]), names(vec![]));
        };
        let required = variant["required"].as_array().unwrap().iter();
        (
            kind["const"].as_str().unwrap().to_owned(),
            names(properties.keys().map(String::as_str).collect()),
            names(required.map(|name| name.as_str().unwrap()).collect()),
        )
    };
    variants.iter().map(read).collect()
}

#[test]
fn every_variant_and_parameter_is_declared() {
    let keys = ["fault", "operator", "world"];
    for effects in keys.iter().flat_map(|key| kinds(crate::SHIPPED, key)) {
        let variants = variants(effects);
        assert_eq!(variants.len(), effects.kinds.len());
        for ((kind, names, required), info) in variants.iter().zip(effects.kinds) {
            assert_eq!(kind, info.id);
            let listed = info.parameters.iter();
            let all: BTreeSet<String> = listed.clone().map(|p| p.name.to_owned()).collect();
            let must = listed.clone().filter(|p| p.required);
            let must: BTreeSet<String> = must.map(|p| p.name.to_owned()).collect();
            assert_eq!((&all, &must), (names, required), "{kind}");
            let texts = listed
                .map(|p| p.description)
                .chain([info.summary, info.counts]);
            let sees = info.is_fault().then_some(info.client_sees);
            for text in texts.chain(sees) {
                assert!(
                    text.ends_with('.') && !text.starts_with(' '),
                    "{kind}: {text}"
                );
            }
        }
    }
    let all = catalogue(crate::SHIPPED);
    let levels: Vec<Level> = all.iter().map(|info| info.level).collect();
    assert!(levels.is_sorted());
    assert!(Level::ALL.iter().all(|level| levels.contains(level)));
}

#[test]
fn no_device_has_two_effects_of_one_name() {
    for device in crate::SHIPPED {
        for key in ["fault", "operator", "world"] {
            let names = names(device, key);
            let unique: BTreeSet<&str> = names.iter().copied().collect();
            assert_eq!(unique.len(), names.len(), "{device:?} {key}");
        }
    }
}

#[test]
fn what_is_wrong_is_refused_when_it_is_read() {
    let refused = |text: &str, why: &str| {
        let error = read(&R150_SPEC, text).unwrap_err();
        assert!(error.contains(why), "{text}: {error}");
    };
    refused("kind = \"bit-flip\"", "an R150 has no fault `bit-flip`");
    refused("kind = \"bit-flips\"\nchance = 0.1", "chance");
    refused("kind = \"hang\"\nfor = \"1s\"", "for");
    refused("kind = \"bit-flips\"\nprobability = 1.5", "0 to 1");
    refused("kind = \"late-reply\"\nby = 5", "250ms");
    refused("kind = \"rail-short\"\nrail = \"24v\"", "12v-a");
    refused("kind = \"rail-short\"", "rail");
}

#[test]
fn a_device_refuses_what_it_cannot_have_in_a_sentence() {
    for info in faults() {
        for device in crate::SHIPPED {
            let is_read = checked(device, 1, &sample(info.id)).is_ok();
            let has_it = names(device, "fault").contains(&info.id);
            assert_eq!(is_read, has_it, "{}", info.id);
        }
    }
    let strip = read(&MECANUM_SPEC, "kind = \"strip-lost\"").unwrap();
    let refused = Checked::new(strip, &R150_SPEC, 1).unwrap_err();
    assert_eq!(refused, "an R150 cannot have `strip-lost`");
    let refused = |text: &str, device: &DeviceSpec, why: &str| {
        let error = checked(device, 2, text).unwrap_err();
        assert!(error.contains(why), "{text}: {error}");
    };
    let (r150, car) = (&R150_SPEC, &MECANUM_SPEC);
    refused("kind = \"bad-crc\"", car, "a mecanum car has no fault");
    refused(
        "kind = \"mute\"\nlink = \"ros\"",
        r150,
        "an R150 has no ros link",
    );
    refused("kind = \"bad-crc\"\ncommand = 0x13", r150, "0x13");
    refused("kind = \"late-reply\"\ncommand = 1", car, "type 0");
    refused(
        "kind = \"late-reply\"\ncommand = 0\nlink = \"ros\"",
        car,
        "ROS link",
    );
    refused(
        "kind = \"blocked\"\nmotors = \"left-front\"",
        r150,
        "geared together",
    );
    refused("kind = \"rail-load\"\nrail = \"5v\"", r150, "one of");
    refused(
        "kind = \"ports-swapped\"\nport = \"x\"\nwith = \"x\"",
        car,
        "both",
    );
    refused("kind = \"wrong-length\"\nby = 0", r150, "right length");
}

#[test]
fn a_rig_refuses_what_this_device_cannot_have() {
    let mut rig = car(false);
    let ros = "kind = \"mute\"\nlink = \"ros\"";
    let refused = rig.inject(0, "a", ros).unwrap_err();
    assert!(refused.to_string().contains("`ros = true`"), "{refused}");
    let mute = checked(&MECANUM_SPEC, 1, "kind = \"mute\"").unwrap();
    assert_eq!(rig.apply(7, "a", &mute), Err(EffectError::NoDevice(7)));
    let mut plain = super::rig(WorldMap::default(), 1);
    let settings = MecanumSettings::default();
    plain.add(&MECANUM_SPEC, &Setup::new("car", &settings));
    let refused = plain.inject(0, "a", &sample("watchdog-off")).unwrap_err();
    assert!(refused.to_string().contains("link_timeout"), "{refused}");
    assert_eq!(phases(&mut rig), []);
    assert_eq!(phases(&mut plain), []);
}

#[test]
fn an_action_hits_when_it_changes_something() {
    let mut rig = r150();
    let [first, again] = [(); 2].map(|()| inject(&mut rig, "operator = \"lock\""));
    assert_eq!([rig.hits(first), rig.hits(again)], [1, 0]);
}

#[test]
fn what_a_search_tries_exists() {
    let all = catalogue(crate::SHIPPED);
    for info in all.iter().filter(|info| info.is_fault()) {
        let tries = if info.tries.is_empty() {
            &[""]
        } else {
            info.tries
        };
        let can_have = |device: &DeviceSpec, set: &str| {
            let links = device.links.len();
            let set = set.replace(", ", "\n");
            checked(device, links, &format!("kind = \"{}\"\n{set}", info.id)).is_ok()
        };
        for set in tries {
            let fits = crate::SHIPPED.iter().any(|device| can_have(device, set));
            assert!(fits, "{}: {set}", info.id);
        }
        let with_it = crate::SHIPPED.iter().filter(|device| has(device, info));
        for device in with_it {
            assert!(
                tries.iter().any(|set| can_have(device, set)),
                "{} {}",
                info.id,
                device.id
            );
        }
    }
    // From each kind, weaker ones lead to an end.
    for info in &all {
        let mut these = vec![info.id];
        for _ in 0..all.len() {
            let weaker = |id: &&str| {
                let known = all.iter().filter(|one| one.id == *id);
                let weaker: Vec<&str> = known.flat_map(|one| one.weaker).copied().collect();
                weaker
            };
            these = these.iter().flat_map(weaker).collect();
            these.sort_unstable();
            these.dedup();
            assert!(
                these.iter().all(|id| all.iter().any(|one| one.id == *id)),
                "{these:?}"
            );
        }
        assert!(these.is_empty(), "{}", info.id);
    }
}
