use proptest::prelude::*;

use super::*;
use crate::pose::Pose;
use crate::world::{BodyShape, Obstacle, ObstacleShape, Rectangle, WorldMap, WorldSettings};

fn world() -> World {
    World::new(&WorldSettings::default())
}

fn cone(origin: [f64; 2], degrees: f64, half_degrees: f64, range: f64) -> Cone {
    let (angle, half) = (degrees.to_radians(), half_degrees.to_radians());
    Cone {
        grazing: 0.0,
        origin,
        direction: [libm::cos(angle), libm::sin(angle)],
        half_opening: [libm::cos(half), libm::sin(half)],
        range,
    }
}

fn echo(world: &World, cone: &Cone) -> f64 {
    world.nearest_echo(cone, None).unwrap_or(f64::INFINITY)
}

fn close(found: f64, wanted: f64) -> bool {
    (found - wanted).abs() < 1e-9
}

#[test]
fn a_wall_ahead_is_as_far_as_its_face() {
    let mut world = world();
    world
        .add_obstacle(Obstacle::wall([2.0, -5.0], [2.0, 5.0], 0.1))
        .unwrap();
    assert!(close(echo(&world, &cone([0.0; 2], 0.0, 15.0, 4.5)), 1.95));
    // Looking aside by less than half the opening it still finds the foot of the perpendicular.
    assert!(close(echo(&world, &cone([0.0; 2], 14.0, 15.0, 4.5)), 1.95));
    // Beyond, the nearest point lies on the rim of the cone.
    let rim = 1.95 / 15.0_f64.to_radians().cos();
    assert!(close(echo(&world, &cone([0.0; 2], 30.0, 15.0, 4.5)), rim));
    assert!(echo(&world, &cone([0.0; 2], 180.0, 15.0, 4.5)).is_infinite());
    assert!(echo(&world, &cone([0.0; 2], 0.0, 15.0, 1.9)).is_infinite());
    assert!(echo(&world, &cone([0.0; 2], 0.0, 15.0, 1.951)).is_finite());
}

#[test]
fn the_end_of_a_wall_a_post_and_the_corner_of_a_box_are_seen() {
    let mut wall = world();
    wall.add_obstacle(Obstacle::wall([1.0, 0.0], [1.0, 3.0], 0.2))
        .unwrap();
    assert!(close(echo(&wall, &cone([0.0; 2], 0.0, 1.0, 4.5)), 0.9));
    assert!(close(echo(&wall, &cone([1.0, -1.0], 90.0, 5.0, 4.5)), 0.9));

    let mut post = world();
    post.add_obstacle(Obstacle::circle([1.5, 0.3], 0.2))
        .unwrap();
    let distance = 1.5_f64.hypot(0.3) - 0.2;
    assert!(close(
        echo(&post, &cone([0.0; 2], 0.0, 15.0, 4.5)),
        distance
    ));
    // Its middle is outside the cone, its flank inside.
    let glance = echo(&post, &cone([0.0; 2], 0.0, 5.0, 4.5));
    assert!(glance > distance && glance < 1.5);
    assert!(echo(&post, &cone([0.0; 2], -10.0, 5.0, 4.5)).is_infinite());

    let mut block = world();
    let turned = Rectangle::new([2.0, 0.0], std::f64::consts::FRAC_PI_4, 1.0, 1.0);
    block
        .add_obstacle(Obstacle::new(ObstacleShape::Box(turned)))
        .unwrap();
    let corner = 2.0 - 0.5_f64.sqrt();
    assert!(close(echo(&block, &cone([0.0; 2], 0.0, 15.0, 4.5)), corner));
    assert!(close(echo(&block, &cone([0.0; 2], 0.0, 0.0, 4.5)), corner));
    // From inside everything is at hand.
    assert_eq!(echo(&block, &cone([2.0, 0.1], 90.0, 15.0, 4.5)), 0.0);
}

#[test]
fn of_the_bodies_it_sees_the_others() {
    let mut world = world();
    let shape = BodyShape {
        length: 0.4,
        width: 0.3,
        mass: 8.0,
        inertia: 0.1,
    };
    let at = |x| Pose {
        x,
        ..Pose::default()
    };
    let own = world.add_body("own", shape, at(0.0));
    let other = world.add_body("other", shape, at(2.0));
    let ahead = cone([0.2, 0.0], 0.0, 15.0, 4.5);
    assert!(close(world.nearest_echo(&ahead, Some(own)).unwrap(), 1.6));
    assert_eq!(world.nearest_echo(&ahead, Some(other)), Some(0.0));
    let before = world.changes();
    world.place(other, at(1.0));
    assert!(world.changes() > before);
    assert!(close(world.nearest_echo(&ahead, Some(own)).unwrap(), 0.6));
}

proptest! {
    /// The echo against many beams over the same opening: never farther than any, and hardly nearer
    /// than the nearest.
    #[test]
    fn a_cone_hears_what_the_nearest_of_its_beams_would_see(
        x in -3.0..3.0_f64, y in -3.0..3.0_f64, degrees in -180.0..180.0_f64,
        half in 1.0..60.0_f64,
        kind in 0..3_u8, heading in -3.2..3.2_f64, length in 0.1..3.0_f64, width in 0.05..1.5_f64,
    ) {
        let mut world = world();
        let obstacle = match kind {
            0 => Obstacle::new(ObstacleShape::Box(Rectangle::new([0.0; 2], heading, length, width))),
            1 => Obstacle::circle([0.0; 2], length / 2.0),
            _ => {
                let end = [length * libm::cos(heading), length * libm::sin(heading)];
                Obstacle::wall([0.0; 2], end, width)
            }
        };
        world.add_obstacle(obstacle).unwrap();
        let found = echo(&world, &cone([x, y], degrees, half, 20.0));
        let mut nearest = f64::INFINITY;
        for beam in -500..=500 {
            let angle = degrees + half * f64::from(beam) / 500.0;
            nearest = nearest.min(echo(&world, &cone([x, y], angle, 0.0, 20.0)));
        }
        prop_assert!(found <= nearest + 1e-9, "{found} {nearest}");
        // A glance between two beams may be missed by both, so compare only what a beam hit.
        if nearest.is_finite() {
            prop_assert!(nearest - found < 0.15, "{found} {nearest}");
        }
    }
}

#[test]
fn a_reader_takes_the_nearest_tag_in_reach() {
    let tags = vec![
        Tag {
            at: [1.0, 0.0],
            number: 7,
        },
        Tag {
            at: [1.03, 0.0],
            number: 8,
        },
    ];
    let map = WorldMap {
        tags,
        ..WorldMap::default()
    };
    let world = World::with_map(&WorldSettings::default(), &map);
    let number = |x| world.tag_near([x, 0.0], 0.04).map(|tag| tag.number);
    assert_eq!(number(0.5), None);
    assert_eq!(number(0.97), Some(7));
    assert_eq!(number(1.02), Some(8));
}
