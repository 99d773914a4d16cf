use super::*;

const CART: BodyShape = BodyShape {
    length: 1.0,
    width: 0.6,
    mass: 100.0,
    inertia: 12.0,
};

fn world() -> World {
    World::new(&WorldSettings::default())
}

fn at(x: f64, y: f64) -> Pose {
    Pose { x, y, heading: 0.0 }
}

#[test]
fn a_body_coasts_without_gravity_or_drag() {
    let mut world = world();
    let cart = world.add_body("cart", CART, at(0.0, 0.0));
    world.set_velocity(cart, [1.0, 0.5], 0.0);
    for _ in 0..200 {
        world.step().unwrap();
    }
    let motion = world.motion(cart);
    assert!((motion.x - 1.0).abs() < 1e-4 && (motion.y - 0.5).abs() < 1e-4);
    assert!(!world.is_touching(cart));
}

#[test]
fn the_error_names_the_body_that_is_no_longer_finite() {
    for poison in [[f64::NAN, 0.0], [0.0, f64::INFINITY]] {
        let mut world = world();
        let well = world.add_body("well", CART, at(0.0, 0.0));
        let ill = world.add_body("ill", CART, at(5.0, 0.0));
        world.set_velocity(well, [1.0, 0.0], 0.0);
        world.step().unwrap();
        world.set_velocity(ill, poison, 0.0);
        let error = world.step().unwrap_err();
        assert_eq!(error, PhysicsError::NotFinite { body: "ill".into() });
        assert!(error.to_string().contains("`ill`"));
    }
}

#[test]
fn obstacles_stop_even_a_fast_body_and_count_as_one_collision() {
    let block = ObstacleShape::Box(Rectangle::new([3.5, 0.0], 0.0, 1.0, 2.0));
    let obstacles = [
        Obstacle::wall([3.0, -1.0], [3.0, 1.0], 0.1),
        Obstacle::new(block),
        Obstacle::circle([3.5, 0.0], 0.5),
    ];
    for obstacle in obstacles {
        let mut world = world();
        world.add_obstacle(obstacle).unwrap();
        let cart = world.add_body("cart", CART, at(0.0, 0.0));
        for _ in 0..400 {
            let motion = world.motion(cart);
            world.set_velocity(cart, [motion.vx + 0.05, motion.vy], motion.yaw_rate);
            world.step().unwrap();
        }
        assert!(world.motion(cart).x < 2.6, "{:?}", world.motion(cart));
        assert!(world.is_touching(cart));
        assert_eq!(world.collisions(cart), 1);
    }
}

#[test]
fn passing_close_by_is_no_collision() {
    let mut world = world();
    world
        .add_obstacle(Obstacle::wall([-5.0, 0.0], [5.0, 0.0], 0.02))
        .unwrap();
    // Its flank passes five millimetres from the wall.
    let cart = world.add_body("cart", CART, at(-1.0, 0.315));
    world.set_velocity(cart, [1.0, 0.0], 0.0);
    for _ in 0..200 {
        world.step().unwrap();
    }
    assert_eq!(world.collisions(cart), 0);
    assert!((world.motion(cart).y - 0.315).abs() < 1e-4);
}

#[test]
fn bodies_of_all_kinds_collide_with_each_other() {
    let mut world = world();
    let heavy = world.add_body("heavy", CART, at(0.0, 0.0));
    let light = world.add_body(
        "light",
        BodyShape {
            length: 0.34,
            width: 0.3,
            mass: 8.0,
            inertia: 0.14,
        },
        at(2.0, 0.0),
    );
    world.set_velocity(heavy, [1.0, 0.0], 0.0);
    for _ in 0..400 {
        world.step().unwrap();
    }
    assert!(world.motion(light).vx > world.motion(heavy).vx - 1e-3);
    assert!(world.motion(light).x - world.motion(heavy).x > 0.66);
    assert_eq!(world.collisions(heavy), 1);
    assert_eq!(world.collisions(light), 1);
}

#[test]
fn a_change_of_mass_shows_in_the_next_collision() {
    let push_on = |mass: Option<f64>| {
        let mut world = world();
        let first = world.add_body("first", CART, at(0.0, 0.0));
        let second = world.add_body("second", CART, at(1.2, 0.0));
        if let Some(mass) = mass {
            world.set_mass(second, mass, 12.0);
        }
        world.set_velocity(first, [1.0, 0.0], 0.0);
        for _ in 0..200 {
            world.step().unwrap();
        }
        world.motion(second).vx
    };
    assert!(push_on(Some(400.0)) < 0.6 * push_on(None));
}

#[test]
fn ground_takes_no_nonsense() {
    let ground = Ground::new(f64::NAN, f64::INFINITY, f64::NAN);
    assert!(ground.friction() == 0.0 && ground.cos_slope() == 1.0);
    let steep = Ground::new(-1.0, 100.0, 0.0);
    assert!(steep.friction() == 0.0 && steep.cos_slope() > 0.0);
    let [x, y] = Ground::new(0.8, 0.1, std::f64::consts::FRAC_PI_2).downhill();
    assert!(x.abs() < 1e-12 && (y + 0.1).abs() < 1e-3);
}
