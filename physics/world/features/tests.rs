use super::super::{BodyShape, Obstacle, WorldMap, WorldSettings};
use super::*;
use crate::pose::Pose;

#[test]
fn everything_of_a_map_is_among_them_and_obstacles_lie_on_top() {
    for text in [
        include_str!("../../../worlds/yard.toml"),
        include_str!("../../../worlds/line-loop.toml"),
        include_str!("../../../worlds/slope.toml"),
    ] {
        let mut map = WorldMap::from_toml(text, "map").unwrap();
        let post = Obstacle::circle([4.0, 4.0], 0.5);
        map.obstacles.add(post).unwrap();
        let world = World::with_map(&WorldSettings::default(), &map);
        let features: Vec<Feature> = world.features().collect();
        assert_eq!(features.len(), map.parts());
        let first = features
            .iter()
            .position(|one| one.kind == FeatureKind::Obstacle);
        let top = &features[first.unwrap()..];
        assert!(top.iter().all(|one| one.kind == FeatureKind::Obstacle));
    }
}

#[test]
fn a_body_has_its_name_and_its_size() {
    let mut world = World::new(&WorldSettings::default());
    let shape = BodyShape {
        length: 1.5,
        width: 0.5,
        mass: 1.0,
        inertia: 1.0,
    };
    world.add_body("box", shape, Pose::default());
    let bodies: Vec<_> = world.bodies().collect();
    assert_eq!(bodies, [("box", [1.5, 0.5])]);
}
