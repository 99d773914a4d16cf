use toml::Spanned;
use toml::de::{DeTable, DeValue};

use super::*;
use crate::mecanum::MECANUM_SPEC;
use crate::r150::R150_SPEC;

impl<'a> Setup<'a> {
    /// A device at the origin in its usual state, with its first link.
    pub(crate) fn new(name: &'a str, settings: &'a dyn DeviceSettings) -> Self {
        Self {
            name,
            settings,
            start: 0,
            links: 1,
            pose: Pose::default(),
            seed: 0,
        }
    }
}

#[test]
#[should_panic(expected = "a row builds its device from")]
fn a_row_whose_settings_have_another_type_builds_nothing() {
    let mut world = World::new(&rigsim_physics::WorldSettings::default());
    let settings = (crate::mecanum::MECANUM_SPEC.settings)();
    let setup = Setup {
        name: "r150",
        settings: &*settings,
        start: 0,
        links: 1,
        pose: Pose::default(),
        seed: 1,
    };
    let _ = (R150_SPEC.build)(&setup, &mut world);
}

#[test]
fn what_stops_a_device_is_a_command_of_it() {
    for spec in [&R150_SPEC, &MECANUM_SPEC] {
        let table = DeTable::parse(spec.host.stop).unwrap();
        let value = Spanned::new(table.span(), DeValue::Table(table.into_inner()));
        let message = (spec.host.read)(&value, &*(spec.settings)());
        assert!(!message.unwrap().bytes.is_empty(), "{}", spec.id);
    }
}
