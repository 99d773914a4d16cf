//! The same inputs give the same bits, in debug and release builds alike.
//!
//! The digest covers two vehicles that drive, turn, slide, collide, park and rest in one world. It
//! has to be renewed whenever the model or a default changes on purpose; the test prints the new one.
#![allow(clippy::unwrap_used, reason = "a failed step fails the test")]

mod common;

use common::TICK;
use rigsim_physics::faults::{BodyFaults, MotorFaults};
use rigsim_physics::r150::{Load, Rail, Side, Sides};
use rigsim_physics::world::Obstacle;
use rigsim_physics::{
    Ground, Plant as _, Pose, R150Commands, R150Plant, R150PlantSettings, World, WorldSettings,
};

const GOLDEN: u64 = 0x7f79_7efb_6465_1b7c;

/// FNV-1a over the bits of every number.
struct Digest(u64);

impl Digest {
    fn add(&mut self, value: f64) {
        for byte in value.to_bits().to_le_bytes() {
            self.0 = (self.0 ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3);
        }
    }

    fn add_plant(&mut self, plant: &R150Plant) {
        let truth = plant.truth();
        let read = plant.measurements();
        for value in [
            truth.motion.pose.x,
            truth.motion.pose.y,
            truth.motion.pose.heading,
            truth.motion.forward_speed,
            truth.motion.leftward_speed,
            truth.motion.yaw_rate,
            truth.motion.distance,
            truth.wheel_speed.right,
            truth.wheel_speed.left,
            truth.battery_current,
            read.motor_rpm.right,
            read.bus_voltage,
            read.soc,
            read.temperature[0],
            read.rail_current[0],
        ] {
            self.add(value);
        }
    }
}

struct Scene {
    world: World,
    plants: Vec<R150Plant>,
    digest: Digest,
}

impl Scene {
    fn drive(&mut self, duties: [(f64, f64); 2], steps: u32, change: impl Fn(&mut R150Commands)) {
        for (plant, (right, left)) in self.plants.iter_mut().zip(duties) {
            let mut commands = *plant.commands();
            commands.motor_duty = Sides { right, left };
            change(&mut commands);
            plant.set_commands(&commands);
        }
        for _ in 0..steps {
            for plant in &mut self.plants {
                plant.before_step(&mut self.world);
            }
            self.world.step().unwrap();
            for plant in &mut self.plants {
                plant.after_step(&mut self.world);
                self.digest.add_plant(plant);
            }
        }
    }
}

fn digest() -> u64 {
    let mut world = World::new(&WorldSettings::default());
    world
        .add_obstacle(Obstacle::wall([6.0, -4.0], [6.0, 4.0], 0.1))
        .unwrap();
    let settings = R150PlantSettings::default();
    let pose = |x, y, heading| Pose { x, y, heading };
    let plants = vec![
        R150Plant::new("first", &settings, &mut world, pose(0.0, 0.0, 0.3)),
        R150Plant::new("second", &settings, &mut world, pose(2.5, 0.6, 2.8)),
    ];
    let mut scene = Scene {
        world,
        plants,
        digest: Digest(0xcbf2_9ce4_8422_2325),
    };
    scene.plants[0].set_load(Rail::V12A, Load::Power(80.0));
    scene.drive([(1.0, 1.0), (0.4, 0.7)], 600, |commands| {
        commands.rail_on[0] = true;
    });
    scene.drive([(-1.0, 0.6), (1.0, 1.0)], 400, |_| {});
    let slope = Ground::new(0.5, 0.15, 1.0);
    scene.world.set_ground(slope);
    let dragging = MotorFaults {
        drag_torque: 30.0,
        ..MotorFaults::default()
    };
    scene.plants[1].set_side_faults(Side::Left, dragging);
    let loaded = BodyFaults {
        payload: 90.0,
        ..BodyFaults::default()
    };
    scene.plants[0].set_body_faults(&mut scene.world, &loaded);
    scene.drive([(0.8, 0.2), (-0.5, -0.9)], 400, |_| {});
    scene.drive([(0.0, 0.0), (0.0, 0.0)], 600, |commands| {
        commands.parking_brake = true;
    });
    for plant in &mut scene.plants {
        assert!(plant.at_rest());
        for _ in 0..100 {
            plant.rest(TICK);
            scene.digest.add_plant(plant);
        }
    }
    scene.drive([(1.0, 1.0), (1.0, 0.9)], 200, |commands| {
        commands.parking_brake = false;
    });
    scene.digest.0
}

#[test]
fn a_drive_has_its_golden_digest() {
    let found = digest();
    assert_eq!(found, digest(), "two runs in one process differ");
    assert_eq!(
        found, GOLDEN,
        "the model or a default changed; if that was meant, the new digest is {found:#018x}"
    );
}
