//! Whatever is done to a car, its numbers stay numbers, and no wheel has more grip than friction gives.
#![allow(clippy::unwrap_used, reason = "a failed step fails the test")]

#[path = "common/anything.rs"]
mod anything;
#[path = "common/car.rs"]
mod car;
#[path = "common/ground.rs"]
mod ground;

use std::time::Duration;

use anything::{any_body_faults, any_motor_faults};
use car::Car;
use proptest::prelude::*;
use rigsim_physics::faults::{BodyFaults, MotorFaults};
use rigsim_physics::mecanum::{
    MecanumFaults, PlugSwaps, Port, PortCommand, Ultrasonic, WHEELS, Wheel,
};
use rigsim_physics::{Energy, Wrench};
use rigsim_physics::{
    Ground, MecanumCommands, MecanumPlantSettings, Plant as _, Pose, World, WorldMap, WorldSettings,
};

/// Something that a client, an operator or a scenario may do.
#[derive(Debug, Clone)]
enum Action {
    Drive([bool; 5], [bool; 5], f64),
    Faults(usize, MotorFaults),
    CarFaults(Box<MecanumFaults>),
    Body(BodyFaults),
    Push(f64, f64, f64),
    Place(f64, f64, f64),
    Ground(f64, f64, f64),
    Rest(u64),
    /// To this share of the step that comes.
    Pass(f64),
    Steps(u32),
}

/// Largest of most numbers.
const USUAL: f64 = 100.0;

fn any_number() -> impl Strategy<Value = f64> {
    anything::any_number(USUAL)
}

fn any_car_faults() -> impl Strategy<Value = MecanumFaults> {
    let swaps = proptest::collection::vec((0..5_usize, 0..5_usize), 0..4);
    (any::<[bool; 3]>(), swaps, any_number()).prop_map(
        |([unsupplied, strip_lost, ghosts], swaps, distance)| MecanumFaults {
            unsupplied,
            swaps: swaps
                .into_iter()
                .fold(PlugSwaps::default(), |swaps, (one, other)| {
                    swaps.and(Port::ALL[one], Port::ALL[other])
                }),
            ultrasonic: [if ghosts {
                Ultrasonic::Ghost(distance)
            } else {
                Ultrasonic::Missing
            }; 8],
            strip_lost,
            ..MecanumFaults::default()
        },
    )
}

fn any_action() -> impl Strategy<Value = Action> {
    use any_number as n;
    prop_oneof![
        6 => (any::<[bool; 5]>(), any::<[bool; 5]>(), n()).prop_map(|(reverse, brake, voltage)| Action::Drive(reverse, brake, voltage)),
        2 => (0..WHEELS, any_motor_faults(USUAL)).prop_map(|(wheel, faults)| Action::Faults(wheel, faults)),
        1 => any_car_faults().prop_map(|faults| Action::CarFaults(Box::new(faults))),
        1 => any_body_faults(USUAL).prop_map(Action::Body),
        1 => (n(), n(), n()).prop_map(|(ahead, left, turn)| Action::Push(ahead, left, turn)),
        1 => (-3.0..7.0, -3.5..3.5, -7.0..7.0).prop_map(|(x, y, heading)| Action::Place(x, y, heading)),
        1 => (n(), n(), n()).prop_map(|(friction, slope, uphill)| Action::Ground(friction, slope, uphill)),
        1 => (0_u64..10_000_000).prop_map(Action::Rest),
        6 => (0.0..1.2).prop_map(Action::Pass),
        6 => (1_u32..80).prop_map(Action::Steps),
    ]
}

fn commands(reverse: [bool; 5], brake: [bool; 5], speed_voltage: f64) -> MecanumCommands {
    MecanumCommands {
        ports: Port::ALL.map(|port| PortCommand {
            reverse: reverse[port.index()],
            brake: brake[port.index()],
        }),
        speed_voltage,
    }
}

fn apply(car: &mut Car, action: &Action) {
    let Car { world, plant } = car;
    match action.clone() {
        Action::Drive(reverse, brake, voltage) => {
            plant.set_commands(&commands(reverse, brake, voltage));
        }
        Action::Faults(wheel, faults) => plant.set_wheel_faults(Wheel::ALL[wheel], faults),
        Action::CarFaults(faults) => plant.set_faults(&faults),
        Action::Body(faults) => plant.set_body_faults(world, &faults),
        Action::Push(ahead, left, turn) => car.push(Wrench { ahead, left, turn }),
        Action::Place(x, y, heading) => plant.place(world, Pose { x, y, heading }),
        Action::Ground(friction, slope, uphill) => {
            world.set_ground(Ground::new(friction, slope, uphill));
            plant.wake();
        }
        Action::Rest(millis) => plant.rest(Duration::from_millis(millis)),
        Action::Pass(share) => plant.pass_to(world.step_length().mul_f64(share)),
        Action::Steps(steps) => {
            for _ in 0..steps {
                car.step();
                check(car);
                ground::check_friction(car.plant.gear().on_ground());
            }
        }
    }
    check(car);
}

fn check(car: &Car) {
    let truth = car.plant.truth();
    let read = car.plant.measurements();
    let numbers = [
        truth.motion.pose.x,
        truth.motion.pose.y,
        truth.motion.pose.heading,
        truth.motion.forward_speed,
        truth.motion.leftward_speed,
        truth.motion.yaw_rate,
        truth.motion.distance,
        truth.motion.mass,
    ];
    let mut all = numbers
        .into_iter()
        .chain(truth.wheel_speed)
        .chain(truth.wheel_angle)
        .chain(truth.motor_torque);
    assert!(all.all(f64::is_finite), "{truth:?}");
    let in_range = |echo: f64| (0.0..=4.5).contains(&echo);
    assert!(read.echoes.into_iter().flatten().all(in_range), "{read:?}");
}

/// The yard, in steps of so many µs.
fn yard(step: u64) -> World {
    let text = include_str!("../../worlds/yard.toml");
    let map = WorldMap::from_toml(text, "yard.toml").unwrap();
    let settings = WorldSettings {
        step: Duration::from_micros(step),
        ..WorldSettings::default()
    };
    World::with_map(&settings, &map)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    #[test]
    fn numbers_stay_finite_and_bounded(
        step in 500_u64..=10_000,
        actions in prop::collection::vec(any_action(), 1..40),
    ) {
        let mut car = Car::within(yard(step), &MecanumPlantSettings::default());
        for action in &actions {
            apply(&mut car, action);
        }
    }

    #[test]
    fn any_settings_within_their_ranges_drive(
        stiffness in 0.1..100.0_f64,
        drag in 0.0..2.0_f64,
        relaxation in 0.0005..1.0_f64,
        gain in 0.001..10_000.0_f64,
        torque in 0.001..1000.0_f64,
        inertia in 0.00001..10.0_f64,
        mass in 0.1..500.0_f64,
        yaw_inertia in 0.0005..500.0_f64,
        friction in 0.0..2.0_f64,
        drives in prop::collection::vec((any::<[bool; 5]>(), any::<[bool; 5]>(), 0.0..1.0_f64), 1..8),
        pass in 0.0..1.0_f64,
    ) {
        let mut settings = MecanumPlantSettings::default();
        settings.wheel.roller_stiffness = stiffness;
        settings.wheel.roller_drag = drag;
        settings.wheel.relaxation_length = relaxation;
        settings.motor.speed_gain = gain;
        settings.motor.torque_limit = torque;
        settings.motor.inertia = inertia;
        settings.body.mass = mass;
        settings.body.yaw_inertia = yaw_inertia;
        let mut car = Car::with(&settings);
        car.plant.gear_mut().energy = Some(Energy::default());
        car.world.set_ground(Ground::flat(friction));
        for (reverse, brake, voltage) in drives {
            car.plant.pass_to(car.world.step_length().mul_f64(pass));
            car.plant.set_commands(&commands(reverse, brake, voltage));
            for _ in 0..100 {
                car.step();
                check(&car);
                if !car.plant.at_rest() {
                    let wheels = car.plant.gear().on_ground();
                    ground::check_wheels(wheels, friction, mass * 9.81);
                }
            }
            // No energy comes out of the solver. Nothing else bounds the speed of a light body on
            // heavy wheels whose rubber holds much.
            let truth = car.plant.truth();
            let turning: f64 = truth.wheel_speed.iter().map(|speed| speed * speed).sum();
            let motion = mass * (truth.motion.forward_speed.powi(2) + truth.motion.leftward_speed.powi(2))
                + yaw_inertia * truth.motion.yaw_rate.powi(2)
                + inertia * turning;
            let strain = ground::most_strain(mass * 9.81, friction, [stiffness, drag], relaxation);
            ground::check_energy(car.plant.gear().energy.unwrap(), motion / 2.0, strain);
        }
    }

    #[test]
    fn left_alone_on_the_flat_it_never_gains_speed(
        ahead in -8.0..8.0_f64, left in -8.0..8.0_f64, turn in -0.5..0.5_f64,
        brake in any::<[bool; 5]>(), supply in any::<bool>(),
    ) {
        let mut car = Car::new();
        car.plant.set_commands(&commands([false; 5], brake, 0.0));
        let faults = MecanumFaults { unsupplied: !supply, ..MecanumFaults::default() };
        car.plant.set_faults(&faults);
        car.world.set_velocity(car.plant.body(), [ahead / 8.0, left / 8.0], turn / 0.14);
        let energy = |car: &Car| {
            let truth = car.plant.truth();
            let speed = truth.motion.forward_speed.powi(2) + truth.motion.leftward_speed.powi(2);
            8.0 * speed / 2.0 + 0.14 * truth.motion.yaw_rate.powi(2) / 2.0
        };
        let mut steps = 0;
        let mut peak = (ahead * ahead + left * left) / 16.0 + turn * turn / 0.28;
        while !car.plant.at_rest() {
            car.run(0.5);
            // Within half a second a roller may give a little of its strain back.
            prop_assert!(energy(&car) <= peak * 1.001 + 1e-3, "{} {peak}", energy(&car));
            peak = energy(&car);
            steps += 100;
            prop_assert!(steps < 20_000);
        }
    }
}
