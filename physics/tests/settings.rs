//! Every setting of the hardware and of its world matters: with another value than its default, something else happens
//! in at least one of a few stories.
#![allow(clippy::unwrap_used, reason = "a failed step fails the test")]

#[path = "common/car.rs"]
mod car;
mod common;

use std::time::Duration;

use car::Car;
use common::Bench;
use rigsim_physics::Wrench;
use rigsim_physics::faults::MotorFaults;
use rigsim_physics::noise::Noise;
use rigsim_physics::r150::{Load, PwmSource, R150Faults, Rail, Side};
use rigsim_physics::world::{Obstacle, Strip, Tag};
use rigsim_physics::{
    Ground, MecanumPlantSettings, Plant as _, R150Commands, R150Plant, R150PlantSettings, World,
    WorldMap, WorldSettings,
};
use rigsim_settings::{Entry, Settings, parse_assignment};

/// Literals of values that a setting might take, beside its default.
fn others(entry: &Entry) -> Vec<String> {
    let literal = entry.default.as_str();
    if let Some(choices) = entry.allowed.words.strip_prefix('"') {
        let others = choices
            .split('"')
            .step_by(2)
            .filter(|word| !word.is_empty());
        return others.map(|word| format!("{word:?}")).collect();
    }
    let changes: [fn(f64) -> f64; 9] = [
        |x| 2.0 * x,
        |x| 0.5 * x,
        |x| x + 1.0,
        |x| 0.9 * x,
        |x| 1.1 * x,
        |x| 10.0 * x,
        |x| 0.1 * x,
        |x| x + 0.05,
        |x| x + 50.0,
    ];
    changes.map(|change| with_numbers(literal, change)).to_vec()
}

/// A literal whose numbers have been changed.
fn with_numbers(literal: &str, change: fn(f64) -> f64) -> String {
    let is_part = |c: char| c.is_ascii_digit() || c == '.' || c == '-';
    let mut text = String::new();
    let mut rest = literal;
    while let Some(begin) = rest.find(is_part) {
        let tail = &rest[begin..];
        let (number, behind) = tail.split_at(tail.find(|c| !is_part(c)).unwrap_or(tail.len()));
        // Digits of a name or of a unit are none.
        let is_number =
            !rest[..begin].ends_with(char::is_alphabetic) && !rest[..begin].ends_with('^');
        let changed = number.parse().ok().filter(|_| is_number).map(change);
        text += &rest[..begin];
        text += &match changed {
            Some(changed) if number.contains('.') => format!("{changed:?}"),
            Some(changed) => changed.to_string(),
            None => number.to_owned(),
        };
        rest = behind;
    }
    text + rest
}

/// Names of the settings that change no story.
fn unnoticed<S: Settings + Default>(stories: &[fn(&S) -> Vec<String>]) -> Vec<String> {
    let usual: Vec<_> = stories.iter().map(|story| story(&S::default())).collect();
    let matters = |entry: &Entry| {
        others(entry).into_iter().any(|literal| {
            let assignment = format!("{}={literal}", entry.key);
            let mut settings = S::default();
            let assigned = parse_assignment("--set", &assignment)
                .is_ok_and(|(key, value)| settings.assign(&key, &value).is_ok());
            assigned
                && stories
                    .iter()
                    .zip(&usual)
                    .any(|(story, usual)| story(&settings) != *usual)
        })
    };
    let dead = S::default()
        .entries()
        .into_iter()
        .filter(|entry| !matters(entry));
    dead.map(|entry| entry.key).collect()
}

/// A bench that notes everything that can be seen.
struct Story {
    bench: Bench,
    seen: Vec<String>,
}

impl Story {
    fn new(settings: &R150PlantSettings) -> Self {
        let (world, plant) = within(&WorldSettings::default(), settings);
        Self {
            bench: Bench {
                world,
                plant,
                commands: R150Commands::default(),
            },
            seen: Vec::new(),
        }
    }

    fn record(&mut self) {
        let plant = &self.bench.plant;
        self.seen
            .push(format!("{:?} {:?}", plant.truth(), plant.measurements()));
    }

    fn run(&mut self, seconds: f64) {
        for _ in 0..10 {
            self.bench.run(seconds / 10.0);
            self.record();
        }
    }

    fn drive(&mut self, right: f64, left: f64, seconds: f64) {
        self.bench.drive(right, left);
        self.run(seconds);
    }
}

fn within(world: &WorldSettings, settings: &R150PlantSettings) -> (World, R150Plant) {
    let mut world = World::new(world);
    world.set_seed(1);
    // Another body, to run into.
    world
        .add_obstacle(Obstacle::wall([4.0, -9.0], [4.0, 9.0], 0.02))
        .unwrap();
    let plant = R150Plant::new(
        "r150",
        settings,
        &mut world,
        rigsim_physics::Pose::default(),
    );
    (world, plant)
}

/// Drives with all rails loaded, over a slope, with a payload and brakes, into a wall, and pushed.
fn drives(settings: &R150PlantSettings) -> Vec<String> {
    let mut story = Story::new(settings);
    story.bench.command(|commands| commands.rail_on = [true; 6]);
    for (rail, watts) in [(Rail::V12A, 90.0), (Rail::V12C, 60.0), (Rail::V5, 4.0)] {
        story.bench.plant.set_load(rail, Load::Power(watts));
    }
    story.bench.plant.set_load(Rail::V48, Load::Resistance(6.0));
    story.drive(0.5, 0.6, 1.0);
    story.drive(1.0, -0.4, 1.0);
    story.bench.load(80.0);
    story.bench.plant.set_load(Rail::V12B, Load::Short);
    story.drive(-1.0, -0.8, 1.0);
    story.bench.plant.set_load(Rail::V12B, Load::Open);
    story.drive(0.0, 0.0, 1.5);
    story
        .bench
        .world
        .set_ground(Ground::new(0.8, -20.0_f64.to_radians(), 0.3));
    story.drive(0.05, 0.1, 1.0);
    story
        .bench
        .command(|commands| commands.parking_brake = true);
    story.bench.push(Wrench {
        ahead: 2000.0,
        left: 900.0,
        ..Wrench::default()
    });
    story.drive(0.0, 0.0, 1.0);
    story.bench.push(Wrench::default());
    story.bench.world.set_ground(Ground::flat(0.8));
    story
        .bench
        .command(|commands| commands.parking_brake = false);
    story.drive(1.0, 1.0, 4.0);
    // Pushed on while no output takes what it feeds back.
    story
        .bench
        .command(|commands| commands.rail_on = [false; 6]);
    story.bench.push(Wrench {
        ahead: -900.0,
        ..Wrench::default()
    });
    story.drive(-0.5, -0.5, 1.0);
    story.bench.push(Wrench::default());
    story.bench.command(|commands| {
        commands.rail_on = [true; 6];
        commands.propulsion_power = false;
    });
    story.run(3.0);
    let starved = R150Faults {
        supply_drop: 40.0,
        ..R150Faults::default()
    };
    story.bench.plant.set_faults(&starved);
    story.run(0.1);
    story.seen
}

/// Stands blocked for long, on a hot day.
fn heats_up(settings: &R150PlantSettings) -> Vec<String> {
    let mut settings = settings.clone();
    settings.thermal.ambient += 45.0;
    let mut story = Story::new(&settings);
    for side in Side::ALL {
        let blocked = MotorFaults {
            blocked: true,
            ..MotorFaults::default()
        };
        story.bench.plant.set_side_faults(side, blocked);
    }
    story.bench.drive(1.0, 1.0);
    // A motor's time constant is a quarter of an hour.
    for _ in 0..60 {
        story.bench.run(0.05);
        story.bench.plant.rest(Duration::from_secs(5));
        story.record();
    }
    story.seen
}

/// Draws more than the fuses carry.
fn blows_fuses(settings: &R150PlantSettings) -> Vec<String> {
    let mut settings = settings.clone();
    settings.motor.current_limit = None;
    settings.rails.small_modules_power *= 18.0;
    let mut story = Story::new(&settings);
    story.bench.command(|commands| commands.rail_on = [true; 6]);
    story.bench.plant.set_load(Rail::V48, Load::Power(4500.0));
    let blocked = MotorFaults {
        blocked: true,
        ..MotorFaults::default()
    };
    story.bench.plant.set_side_faults(Side::Right, blocked);
    story.bench.drive(1.0, 0.0);
    for _ in 0..40 {
        story.run(0.1);
        story.bench.plant.rest(Duration::from_secs(1));
    }
    story.seen
}

/// Reads the PWM inputs.
fn reads_inputs(settings: &R150PlantSettings) -> Vec<String> {
    let mut story = Story::new(settings);
    story
        .bench
        .command(|commands| commands.pwm_out_duty = [0.3; 4]);
    for (frequency, duty, high_voltage) in [
        (100.0, 0.4, 3.0),
        (15.0, 0.4, 10.0),
        (15_000.0, 0.4, 5.0),
        (100.0, 1.0, 5.0),
        (100.0, 0.4, 1.5),
    ] {
        let generator = PwmSource::Generator {
            frequency,
            duty,
            high_voltage,
        };
        story.bench.plant.set_pwm_source(0, generator);
        story.bench.plant.set_pwm_source(1, PwmSource::OwnOutput(1));
        story.record();
    }
    story.seen
}

#[test]
fn every_setting_of_the_r150_matters() {
    let dead = unnoticed::<R150PlantSettings>(&[drives, reads_inputs, blows_fuses, heats_up]);
    assert!(dead.is_empty(), "{dead:#?}");
}

/// Rolls every way between walls, over a strip and tags, with a payload, and stands.
fn rolls(settings: &MecanumPlantSettings) -> Vec<String> {
    let map = WorldMap {
        tags: vec![Tag {
            at: [0.12, 0.03],
            number: 7,
        }],
        strips: vec![Strip {
            points: vec![[-5.0, 0.0], [5.0, 0.1]],
            ..Strip::default()
        }],
        ..WorldMap::default()
    };
    let mut world = World::with_map(&WorldSettings::default(), &map);
    world
        .add_obstacle(Obstacle::wall([0.6, -9.0], [0.6, 9.0], 0.02))
        .unwrap();
    world
        .add_obstacle(Obstacle::wall([-9.0, 2.0], [9.0, 3.0], 0.02))
        .unwrap();
    world
        .add_obstacle(Obstacle::circle([-3.0, -0.3], 0.1))
        .unwrap();
    let mut car = Car::within(world, settings);
    car.plant.set_chance(Noise::new(1, "car"));
    let mut seen = Vec::new();
    let mut run = |car: &mut Car, seconds: f64| {
        for _ in 0..20 {
            car.run(seconds / 20.0);
            seen.push(format!(
                "{:?} {:?}",
                car.plant.truth(),
                car.plant.measurements()
            ));
        }
    };
    car.turn([1; 4], 1.0);
    run(&mut car, 1.0);
    car.turn([-1, 1, 1, -1], 0.7);
    run(&mut car, 1.0);
    car.load(5.0);
    car.turn([1, -1, 1, -1], 0.5);
    run(&mut car, 0.5);
    car.turn([1; 4], 0.0);
    run(&mut car, 0.5);
    car.brake();
    run(&mut car, 1.0);
    car.turn([-1; 4], 1.0);
    run(&mut car, 1.0);
    car.brake();
    car.push(Wrench {
        ahead: 90.0,
        left: 20.0,
        ..Wrench::default()
    });
    run(&mut car, 1.0);
    car.turn([1; 4], 1.0);
    run(&mut car, 5.0);
    seen
}

#[test]
fn every_setting_of_the_car_matters() {
    let dead = unnoticed::<MecanumPlantSettings>(&[rolls]);
    assert!(dead.is_empty(), "{dead:#?}");
}

/// Drives aslant up a slope and into a wall, and back.
fn meets_a_wall(settings: &WorldSettings) -> Vec<String> {
    let mut settings = settings.clone();
    settings.slope += 5.0;
    let (world, plant) = within(&settings, &R150PlantSettings::default());
    let bench = Bench {
        world,
        plant,
        commands: R150Commands::default(),
    };
    let mut story = Story {
        bench,
        seen: Vec::new(),
    };
    story.drive(1.0, 0.9, 4.0);
    story.drive(-1.0, -1.0, 1.0);
    story.seen
}

#[test]
fn every_setting_of_the_world_matters() {
    let dead = unnoticed::<WorldSettings>(&[meets_a_wall]);
    assert!(dead.is_empty(), "{dead:#?}");
}
