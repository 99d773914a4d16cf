//! The table, the types and the schema say the same.

use std::collections::BTreeSet;

use serde_json::Value;

use super::*;
use crate::device::DeviceSpec;
use crate::mecanum::MECANUM_SPEC;
use crate::r150::R150_SPEC;

/// Variants of the schema: `kind`, its properties, and which of them must be given.
fn variants() -> Vec<(String, BTreeSet<String>, BTreeSet<String>)> {
    let schema = schemars::schema_for!(Fault);
    let variants = schema.get("oneOf").and_then(Value::as_array).unwrap();
    let read = |variant: &Value| {
        let properties = variant["properties"].as_object().unwrap();
        let kind = properties["kind"]["const"].as_str().unwrap().to_owned();
        assert!(variant["description"].as_str().is_some(), "{kind}");
        assert_eq!(variant["additionalProperties"], Value::Bool(false));
        let own = |name: &&String| *name != "kind";
        let names = properties.keys().filter(own).cloned().collect();
        let required = variant["required"].as_array().unwrap().iter();
        let required = required.map(|name| name.as_str().unwrap().to_owned());
        (
            kind,
            names,
            required.filter(|name| name != "kind").collect(),
        )
    };
    variants.iter().map(read).collect()
}

#[test]
fn every_variant_and_parameter_is_in_the_catalogue() {
    let variants = variants();
    assert_eq!(variants.len(), catalogue().len());
    for ((kind, names, required), info) in variants.iter().zip(catalogue()) {
        assert_eq!(kind, info.id);
        let listed = info.parameters.iter();
        let all: BTreeSet<String> = listed.clone().map(|p| p.name.to_owned()).collect();
        let must = listed.clone().filter(|p| p.required);
        let must: BTreeSet<String> = must.map(|p| p.name.to_owned()).collect();
        assert_eq!((&all, &must), (names, required), "{kind}");
        for parameter in listed {
            let text = parameter.description;
            assert!(text.ends_with('.') && !text.starts_with(' '), "{text}");
        }
        for text in [info.summary, info.client_sees, info.counts] {
            assert!(text.ends_with('.') && text.len() > 10, "{kind}: {text}");
        }
        assert!(crate::SHIPPED.iter().any(|device| device.has_fault(info)));
    }
    let levels: Vec<FaultLevel> = catalogue().iter().map(|info| info.level).collect();
    assert!(levels.is_sorted());
    assert!(FaultLevel::ALL.iter().all(|level| levels.contains(level)));
}

#[test]
fn what_is_written_reads_back() {
    for info in catalogue() {
        let fault = sample(info.id);
        assert_eq!(fault.info(), info);
        let text = toml::to_string(&fault).unwrap();
        assert_eq!(read(&text), fault, "{text}");
    }
    let full = "kind = \"unsolicited-frame\"\nbytes = \"AA 55 00\"\nevery = \"20ms\"\n\
                count = 3\nlink = \"ros\"\n";
    assert_eq!(toml::to_string(&read(full)).unwrap(), full);
}

#[test]
fn what_is_wrong_is_refused_when_it_is_read() {
    let refused = |text: &str, why: &str| {
        let error = toml::from_str::<Fault>(text).unwrap_err().to_string();
        assert!(error.contains(why), "{text}: {error}");
    };
    refused("kind = \"bit-flip\"", "bit-flips");
    refused("kind = \"bit-flips\"\nchance = 0.1", "chance");
    refused("kind = \"hang\"\nfor = \"1s\"", "for");
    refused("kind = \"bit-flips\"\nprobability = 1.5", "0 to 1");
    refused("kind = \"late-reply\"\nby = 5", "250ms");
    refused("kind = \"rail-short\"\nrail = \"24v\"", "12v-a");
    refused("kind = \"rail-short\"", "rail");
    refused(
        "kind = \"unsolicited-frame\"\nbytes = \"AA 5\"",
        "two digits",
    );
    refused(
        "kind = \"unsolicited-frame\"\nbytes = \"AX\"",
        "hexadecimal",
    );
}

#[test]
fn a_device_refuses_what_it_cannot_have_in_a_sentence() {
    for info in catalogue() {
        for device in crate::SHIPPED {
            let checked = device.check(&sample(info.id));
            assert_eq!(checked.is_ok(), device.has_fault(info), "{}", info.id);
        }
    }
    let refused = |text: &str, device: &DeviceSpec, why: &str| {
        let error = device.check(&read(text)).unwrap_err();
        assert!(error.contains(why), "{text}: {error}");
    };
    let (r150, car) = (&R150_SPEC, &MECANUM_SPEC);
    refused("kind = \"bad-crc\"", car, "no checksum");
    refused(
        "kind = \"strip-lost\"",
        r150,
        "an R150 cannot have `strip-lost`",
    );
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
    let ros = read("kind = \"mute\"\nlink = \"ros\"");
    let refused = rig.inject(0, "a", &ros).unwrap_err();
    assert!(refused.to_string().contains("not configured"), "{refused}");
    assert_eq!(rig.inject(7, "a", &ros), Err(FaultError::NoDevice(7)));
    let mut plain = super::rig(WorldMap::default(), 1);
    crate::mecanum::add(
        &mut plain,
        "car",
        &MecanumSettings::default(),
        false,
        Pose::default(),
    );
    let refused = plain.inject(0, "a", &sample("watchdog-off")).unwrap_err();
    assert!(refused.to_string().contains("link_timeout"), "{refused}");
    let refused = rig.inject(0, "a", &sample("locked")).unwrap_err();
    assert!(matches!(refused, FaultError::Impossible(_)));
    assert_eq!(phases(&mut rig), []);
}
