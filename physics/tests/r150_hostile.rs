//! Whatever is done to a vehicle, its numbers stay numbers, and no wheel has more grip than friction
//! gives.

#[path = "common/anything.rs"]
mod anything;
mod common;
#[path = "common/ground.rs"]
mod ground;

use std::time::Duration;

use anything::{any_body_faults, any_motor_faults};
use common::{Bench, FRICTION};
use proptest::prelude::*;
use rigsim_physics::faults::{BodyFaults, MotorFaults};
use rigsim_physics::r150::{Load, PwmSource, R150Faults, Rail, Side, Sides};
use rigsim_physics::world::Obstacle;
use rigsim_physics::{Energy, Ground, Plant as _, Pose, R150PlantSettings, Wrench};

/// Something that a client, an operator or a scenario may do.
#[derive(Debug, Clone)]
enum Action {
    Drive(f64, f64),
    Switches(bool, bool, [bool; 6]),
    Wire(usize, Load),
    Push(f64, f64, f64),
    Place(f64, f64, f64),
    Faults(bool, MotorFaults),
    Whole(Box<R150Faults>),
    Body(BodyFaults),
    Ground(f64, f64, f64),
    Pwm(usize, f64, f64),
    Rest(u64),
    Steps(u32),
}

/// Largest of most numbers.
const USUAL: f64 = 1000.0;

fn any_number() -> impl Strategy<Value = f64> {
    anything::any_number(USUAL)
}

fn any_load() -> impl Strategy<Value = Load> {
    prop_oneof![
        Just(Load::Open),
        Just(Load::Short),
        any_number().prop_map(Load::Power),
        any_number().prop_map(Load::Resistance),
    ]
}

fn any_whole() -> impl Strategy<Value = R150Faults> {
    use any_number as n;
    (any::<[bool; 6]>(), (n(), n(), n(), n(), n()), any_load()).prop_map(
        |(broken, electrical, load)| {
            let (supply_drop, supply_resistance, missing_charge, celsius, error) = electrical;
            let [power_module, sides_swapped, loaded, fuses_out @ ..] = broken;
            R150Faults {
                loads: [loaded.then_some(load); 6],
                supply_drop,
                supply_resistance,
                missing_charge,
                temperature: [Some(celsius), None],
                power_module,
                fuses_out: [fuses_out[0], fuses_out[1], fuses_out[2], false],
                sides_swapped,
                encoder_error: Sides::from([error, -error]),
            }
        },
    )
}

fn any_action() -> impl Strategy<Value = Action> {
    use any_number as n;
    prop_oneof![
        4 => (n(), n()).prop_map(|(right, left)| Action::Drive(right, left)),
        2 => any::<(bool, bool, [bool; 6])>().prop_map(|(power, brake, rails)| Action::Switches(power, brake, rails)),
        2 => (0_usize..6, any_load()).prop_map(|(rail, load)| Action::Wire(rail, load)),
        1 => (n(), n(), n()).prop_map(|(ahead, left, turn)| Action::Push(ahead, left, turn)),
        1 => (-50.0..50.0, -50.0..50.0, -7.0..7.0).prop_map(|(x, y, heading)| Action::Place(x, y, heading)),
        2 => (any::<bool>(), any_motor_faults(USUAL)).prop_map(|(left, faults)| Action::Faults(left, faults)),
        2 => any_whole().prop_map(|faults| Action::Whole(Box::new(faults))),
        2 => any_body_faults(USUAL).prop_map(Action::Body),
        1 => (n(), n(), n()).prop_map(|(friction, slope, uphill)| Action::Ground(friction, slope, uphill)),
        1 => (0_usize..6, n(), n()).prop_map(|(input, frequency, duty)| Action::Pwm(input, frequency, duty)),
        1 => (0_u64..10_000_000).prop_map(Action::Rest),
        6 => (1_u32..80).prop_map(Action::Steps),
    ]
}

fn apply(bench: &mut Bench, action: &Action) {
    let Bench { world, plant, .. } = bench;
    match action.clone() {
        Action::Drive(right, left) => bench.drive(right, left),
        Action::Switches(propulsion_power, parking_brake, rail_on) => bench.command(|commands| {
            commands.propulsion_power = propulsion_power;
            commands.parking_brake = parking_brake;
            commands.rail_on = rail_on;
        }),
        Action::Wire(rail, load) => plant.set_load(Rail::ALL[rail], load),
        Action::Push(ahead, left, turn) => bench.push(Wrench { ahead, left, turn }),
        Action::Place(x, y, heading) => plant.place(world, Pose { x, y, heading }),
        Action::Faults(left, faults) => {
            plant.set_side_faults(if left { Side::Left } else { Side::Right }, faults);
        }
        Action::Whole(faults) => plant.set_faults(&faults),
        Action::Body(faults) => plant.set_body_faults(world, &faults),
        Action::Ground(friction, slope, uphill) => {
            world.set_ground(Ground::new(friction, slope, uphill));
            plant.wake();
        }
        Action::Pwm(input, frequency, duty) => plant.set_pwm_source(
            input,
            PwmSource::Generator {
                frequency,
                duty,
                high_voltage: 5.0,
            },
        ),
        Action::Rest(millis) => plant.rest(Duration::from_millis(millis)),
        Action::Steps(steps) => {
            for _ in 0..steps {
                bench.step();
                check(bench);
                ground::check_friction(bench.plant.gear().on_ground());
            }
        }
    }
    check(bench);
}

fn check(bench: &Bench) {
    let truth = bench.plant.truth();
    let read = bench.plant.measurements();
    let Sides { right, left } = read.motor_rpm;
    let numbers = [
        truth.motion.pose.x,
        truth.motion.pose.y,
        truth.motion.pose.heading,
        truth.motion.forward_speed,
        truth.motion.leftward_speed,
        truth.motion.yaw_rate,
        truth.motion.distance,
        truth.wheel_speed.right,
        truth.wheel_speed.left,
        truth.motor_current.right,
        truth.motor_current.left,
        truth.motor_supply_current.right,
        truth.battery_voltage,
        truth.battery_current,
        right,
        left,
        read.bus_voltage,
    ];
    let mut all = numbers
        .into_iter()
        .chain(read.rail_voltage)
        .chain(read.rail_current)
        .chain(read.temperature);
    assert!(all.all(f64::is_finite), "{truth:?} {read:?}");
    assert!((0.0..=1.0).contains(&truth.soc));
    assert!(truth.battery_voltage > 0.0);
    assert!(read.rail_voltage.iter().all(|volts| *volts >= 0.0));
    assert!(
        read.rail_current
            .iter()
            .all(|amps| (0.0..1e5).contains(amps))
    );
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    #[test]
    fn numbers_stay_finite_and_bounded(actions in prop::collection::vec(any_action(), 1..40)) {
        let mut bench = Bench::new();
        bench.world.add_obstacle(Obstacle::wall([3.0, -60.0], [3.0, 60.0], 0.2)).unwrap();
        for action in &actions {
            apply(&mut bench, action);
        }
    }

    #[test]
    fn any_settings_within_their_ranges_drive(
        stiffness in 0.5..100.0_f64,
        relaxation in 0.005..2.0_f64,
        resistance in 0.01..10.0_f64,
        mass in 1.0..2000.0_f64,
        inertia in 0.01..5000.0_f64,
        gear_ratio in 1.0..500.0_f64,
        resistance_of_packs in 0.0005..10.0_f64,
        duties in prop::collection::vec((-1.0..1.0_f64, -1.0..1.0_f64), 1..8),
    ) {
        let mut settings = R150PlantSettings::default();
        settings.tyre.longitudinal_stiffness = stiffness;
        settings.tyre.relaxation_length = relaxation;
        settings.motor.resistance = resistance;
        settings.motor.gear_ratio = gear_ratio;
        settings.body.mass = mass;
        settings.body.yaw_inertia = inertia;
        settings.battery.resistance = resistance_of_packs;
        let mut bench = Bench::with(&settings);
        bench.plant.gear_mut().energy = Some(Energy::default());
        for (right, left) in duties {
            bench.drive(right, left);
            for _ in 0..100 {
                bench.step();
                check(&bench);
                if !bench.plant.at_rest() {
                    let wheels = bench.plant.gear().on_ground();
                    ground::check_wheels(wheels, FRICTION, mass * 9.81);
                }
            }
            // The wheels cannot outrun their motors: no energy comes out of the solver.
            let fastest = 55.0 / settings.motor.back_emf_constant / gear_ratio;
            let truth = bench.plant.truth();
            prop_assert!(truth.wheel_speed.right.abs() < fastest * 1.5 + 1.0, "{truth:?}");
            prop_assert!(truth.motion.forward_speed.abs() < fastest * 0.25 * 1.5 + 1.0, "{truth:?}");
            let wheel_inertia = 0.0015 * gear_ratio.powi(2) + 2.0 * settings.motor.wheel_inertia;
            let Sides { right, left } = truth.wheel_speed;
            let motion = mass * (truth.motion.forward_speed.powi(2) + truth.motion.leftward_speed.powi(2))
                + inertia * truth.motion.yaw_rate.powi(2)
                + wheel_inertia * (right.powi(2) + left.powi(2));
            let stiffness = [stiffness, settings.tyre.lateral_stiffness];
            let strain = ground::most_strain(mass * 9.81, FRICTION, stiffness, relaxation);
            ground::check_energy(bench.plant.gear().energy.unwrap(), motion / 2.0, strain);
        }
    }
}
