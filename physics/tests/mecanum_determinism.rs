//! The same inputs give the same bits, in debug and release builds alike.
//!
//! The digest covers two cars and an R150 in the shipped yard that drive, strafe, turn, collide,
//! fail and rest. It has to be renewed whenever the model, a default or the yard changes on purpose;
//! the test prints the new one.
#![allow(clippy::unwrap_used, reason = "a failed step fails the test")]

#[path = "common/car.rs"]
mod car;

use car::MOTIONS;
use rigsim_physics::faults::{EncoderState, MotorFaults};
use rigsim_physics::mecanum::{MecanumFaults, PlugSwaps, Port, Wheel};
use rigsim_physics::{
    MecanumCommands, MecanumPlant, MecanumPlantSettings, Plant as _, Pose, R150Commands, R150Plant,
    R150PlantSettings, World, WorldMap, WorldSettings,
};

const GOLDEN: u64 = 0x2893_4f6d_ce68_63f9;

/// FNV-1a over the bits of every number.
struct Digest(u64);

impl Digest {
    fn add(&mut self, bits: u64) {
        for byte in bits.to_le_bytes() {
            self.0 = (self.0 ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3);
        }
    }

    fn add_car(&mut self, plant: &MecanumPlant) {
        let truth = plant.truth();
        let read = plant.measurements();
        let numbers = [
            truth.motion.pose.x,
            truth.motion.pose.y,
            truth.motion.pose.heading,
            truth.motion.forward_speed,
            truth.motion.leftward_speed,
            truth.motion.yaw_rate,
            truth.motion.distance,
        ];
        let wheels = truth.wheel_speed.into_iter().chain(truth.motor_torque);
        let echoes = read.echoes.map(|echo| echo.unwrap_or(-1.0));
        for number in numbers.into_iter().chain(wheels).chain(echoes) {
            self.add(number.to_bits());
        }
        for pulses in read.pulses {
            self.add(pulses.into());
        }
        self.add(u64::from(read.obstacle_ahead) << 16 | u64::from(read.magnetic_bar));
    }
}

struct Scene {
    world: World,
    cars: [MecanumPlant; 2],
    r150: R150Plant,
    digest: Digest,
}

impl Scene {
    fn new() -> Self {
        let text = include_str!("../../worlds/yard.toml");
        let map = WorldMap::from_toml(text, "yard.toml").unwrap();
        let mut world = World::with_map(&WorldSettings::default(), &map);
        let settings = MecanumPlantSettings::default();
        let at = |x, y, heading| Pose { x, y, heading };
        let mut cars = [
            MecanumPlant::new("first", &settings, &mut world, at(0.0, 0.0, 0.2)),
            MecanumPlant::new("second", &settings, &mut world, at(0.9, 0.3, 2.9)),
        ];
        cars[1].set_faults(&MecanumFaults {
            swaps: PlugSwaps::default()
                .and(Port::E0, Port::Z)
                .and(Port::E1, Port::E0),
            ..MecanumFaults::default()
        });
        let r150 = R150Plant::new(
            "r150",
            &R150PlantSettings::default(),
            &mut world,
            at(-2.5, -0.5, 0.1),
        );
        Self {
            world,
            cars,
            r150,
            digest: Digest(0xcbf2_9ce4_8422_2325),
        }
    }

    fn motions(&mut self, motions: [usize; 2], speed_voltage: f64, steps: u32) {
        for (car, motion) in self.cars.iter_mut().zip(motions) {
            let mut commands = MecanumCommands {
                speed_voltage,
                ..MecanumCommands::default()
            };
            for wheel in Wheel::ALL {
                let rotation = MOTIONS[motion].1[wheel.index()];
                let port = &mut commands.ports[car.faults().swaps.port(wheel).index()];
                port.brake = rotation == 0;
                port.reverse = rotation < 0;
            }
            car.set_commands(&commands);
        }
        self.steps(steps);
    }

    fn steps(&mut self, steps: u32) {
        for _ in 0..steps {
            for car in &mut self.cars {
                car.before_step(&mut self.world);
            }
            self.r150.before_step(&mut self.world);
            self.world.step().unwrap();
            for car in &mut self.cars {
                car.after_step(&mut self.world);
                self.digest.add_car(car);
            }
            self.r150.after_step(&mut self.world);
        }
    }
}

fn digest() -> u64 {
    let mut scene = Scene::new();
    for (round, speed_voltage) in [1.0, 0.7, 0.35].into_iter().enumerate() {
        for motion in 0..MOTIONS.len() {
            scene.motions(
                [motion, (3 * motion + round) % MOTIONS.len()],
                speed_voltage,
                60,
            );
        }
    }
    let mut commands = R150Commands::default();
    commands.motor_duty.right = 0.6;
    commands.motor_duty.left = 0.6;
    scene.r150.set_commands(&commands);
    scene.cars[0].set_wheel_faults(
        Wheel::LeftRear,
        MotorFaults {
            blocked: true,
            encoder: EncoderState::Stuck,
            ..MotorFaults::default()
        },
    );
    scene.motions([0, 5], 1.0, 600);
    scene.r150.set_commands(&R150Commands::default());
    for car in &mut scene.cars {
        car.set_commands(&MecanumCommands::default());
    }
    scene.steps(800);
    for car in &mut scene.cars {
        assert!(car.at_rest(), "{:?}", car.truth());
        for _ in 0..100 {
            car.rest(std::time::Duration::from_millis(100));
            scene.digest.add_car(car);
        }
    }
    scene.motions([4, 6], 0.5, 200);
    scene.digest.0
}

#[test]
fn a_drive_has_its_golden_digest() {
    let found = digest();
    assert_eq!(found, digest(), "two runs in one process differ");
    assert_eq!(
        found, GOLDEN,
        "the model, a default or the yard changed; if that was meant, the new digest is {found:#018x}"
    );
}
