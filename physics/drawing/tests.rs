use crate::mecanum::signals::Wheel;
use crate::{
    MecanumPlant, MecanumPlantSettings, Plant as _, Pose, R150Plant, R150PlantSettings, World,
    WorldSettings,
};

#[test]
fn wheels_are_where_the_settings_have_them_and_in_the_order_of_their_speeds() {
    let mut world = World::new(&WorldSettings::default());
    let settings = R150PlantSettings::default();
    let r150 = R150Plant::new("r150", &settings, &mut world, Pose::default()).drawing();
    assert_eq!(r150.wheels.len(), 4);
    assert_eq!(r150.wheels[0].place[0] * 2.0, settings.body.wheelbase);
    assert_eq!(r150.wheels[1].place[1] * -2.0, settings.body.track);
    // Beside nothing.
    let mut world = World::new(&WorldSettings::default());
    let settings = MecanumPlantSettings::default();
    let car = MecanumPlant::new("mecanum", &settings, &mut world, Pose::default()).drawing();
    for wheel in Wheel::ALL {
        let drawn = car.wheels[wheel.index()];
        assert_eq!(drawn.place[1] > 0.0, wheel.is_left(), "{wheel}");
    }
    assert!(
        car.echoes
            .iter()
            .all(|echo| echo.distance.is_none() && echo.range > 0.0)
    );
}
