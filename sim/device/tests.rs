use super::*;
use crate::r150::R150_SPEC;

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
