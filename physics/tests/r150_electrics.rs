//! The electrics of the R150, on default settings.

mod common;

use std::time::Duration;

use common::{Bench, TICK};
use rigsim_physics::faults::{EncoderState, MotorFaults};
use rigsim_physics::r150::{FuseId, Load, PwmReading, PwmSource, R150Faults, Rail, Side};
use rigsim_physics::{Plant as _, R150Measurements, R150PlantSettings};

fn with_load(rail: Rail, load: Load) -> (Bench, R150Measurements) {
    let mut bench = Bench::new();
    bench.plant.set_load(rail, load);
    bench.command(|commands| commands.rail_on[rail.index()] = true);
    let read = bench.plant.measurements();
    (bench, read)
}

fn close(value: f64, expected: f64, tolerance: f64) -> bool {
    (value - expected).abs() <= tolerance
}

#[test]
fn a_fresh_vehicle_reads_its_bus_and_nothing_else() {
    let read = Bench::new().plant.measurements();
    assert!(read.module_powered && !read.power_module_fault);
    assert!(close(read.bus_voltage, 51.3, 0.1), "{read:?}");
    assert_eq!(read.soc, 0.8);
    assert_eq!(read.rail_voltage, [0.0; 6]);
    assert_eq!(read.rail_current, [0.0; 6]);
    assert_eq!(read.temperature, [25.0; 2]);
    assert_eq!(read.pwm_in, [PwmReading::default(); 4]);
}

#[test]
fn a_rail_follows_its_switch_and_its_load() {
    for (rail, load, voltage, current) in [
        (Rail::V12A, Load::Open, 12.0, 0.0),
        (Rail::V12B, Load::Power(60.0), 11.85, 5.07),
        (Rail::V12D, Load::Resistance(6.0), 11.94, 1.99),
        (Rail::V5, Load::Power(5.0), 4.95, 1.01),
        (Rail::V48, Load::Resistance(24.0), 51.25, 2.13),
        (Rail::V48, Load::Power(1000.0), 50.9, 19.7),
    ] {
        let (mut bench, read) = with_load(rail, load);
        let index = rail.index();
        println!(
            "{rail:?} {load:?}: {} V, {} A",
            read.rail_voltage[index], read.rail_current[index]
        );
        assert!(close(read.rail_voltage[index], voltage, 0.05));
        assert!(close(read.rail_current[index], current, 0.1));
        bench.command(|commands| commands.rail_on[index] = false);
        let off = bench.plant.measurements();
        assert_eq!(
            (off.rail_voltage[index], off.rail_current[index]),
            (0.0, 0.0)
        );
    }
}

#[test]
fn what_the_rails_take_comes_out_of_the_battery() {
    let (mut bench, _) = with_load(Rail::V12A, Load::Power(100.0));
    bench.plant.set_load(Rail::V48, Load::Power(500.0));
    bench.command(|commands| commands.rail_on[Rail::V48.index()] = true);
    let truth = bench.plant.truth();
    let power = truth.battery_voltage * truth.battery_current;
    // Module, small modules and the converter's loss come on top.
    assert!((600.0..660.0).contains(&power), "{power}");
}

#[test]
fn shorts_exceed_three_times_every_limit_and_stay_bounded() {
    for (rail, watts, amps) in [
        (Rail::V12A, 750.0, 62.5),
        (Rail::V12C, 750.0, 62.5),
        (Rail::V48, 6000.0, 125.0),
        (Rail::V5, 30.0, 6.0),
    ] {
        let (_, read) = with_load(rail, Load::Short);
        let (voltage, current) = (
            read.rail_voltage[rail.index()],
            read.rail_current[rail.index()],
        );
        println!(
            "{rail:?} short: {voltage:.2} V, {current:.1} A, bus {:.2} V",
            read.bus_voltage
        );
        assert!(current > 1.2 * amps && current < 5000.0);
        assert!(voltage * current > 1.2 * watts);
        assert!(read.module_powered);
    }
}

#[test]
fn more_power_than_the_source_has_collapses_the_voltage_and_no_more() {
    let (bench, read) = with_load(Rail::V48, Load::Power(1e5));
    println!(
        "100 kW asked: bus {:.2} V, {:.0} A",
        read.bus_voltage, read.rail_current[4]
    );
    assert!(close(read.bus_voltage, 51.35 / 2.0, 0.1));
    assert!(bench.plant.truth().battery_current < 51.35 / 0.02);
    let (_, read) = with_load(Rail::V12A, Load::Power(1e5));
    assert!(close(read.rail_voltage[0], 6.0, 1e-9));
    assert!(close(read.rail_current[0], 200.0, 1e-9));
}

#[test]
fn braking_feeds_the_battery() {
    let mut bench = Bench::unlimited();
    bench.drive(1.0, 1.0);
    bench.run(2.0);
    bench.drive(0.5, 0.5);
    bench.step();
    let truth = bench.plant.truth();
    assert!(truth.battery_current < -3.0, "{truth:?}");
    assert!(truth.battery_voltage > 51.4);
    // At zero duty the bridge is a short in itself and nothing reaches the bus.
    bench.drive(0.0, 0.0);
    bench.step();
    let truth = bench.plant.truth();
    assert!(truth.motor_current.right < -50.0);
    assert_eq!(truth.motor_supply_current.right, 0.0);
}

#[test]
fn an_hour_at_rest_counts_the_same_in_ticks_and_at_once() {
    let rested = |tick: Duration, ticks: u32| {
        let (mut bench, _) = with_load(Rail::V12A, Load::Power(100.0));
        bench.run_while(5.0, |bench| !bench.plant.at_rest());
        assert!(bench.plant.at_rest());
        for _ in 0..ticks {
            bench.plant.rest(tick);
        }
        bench.plant.truth().soc
    };
    let ticks = rested(TICK, 36_000);
    let once = rested(Duration::from_secs(3600), 1);
    println!("state of charge after an hour at 100 W: {ticks:.5} in ticks, {once:.5} at once");
    assert!((0.72..0.745).contains(&ticks));
    assert!(close(ticks, once, 1e-3));
}

#[test]
fn stepping_and_resting_agree() {
    let (mut stepped, _) = with_load(Rail::V12A, Load::Power(100.0));
    let (mut rested, _) = with_load(Rail::V12A, Load::Power(100.0));
    for bench in [&mut stepped, &mut rested] {
        bench.run_while(5.0, |bench| !bench.plant.at_rest());
    }
    stepped.run(60.0);
    for _ in 0..600 {
        rested.plant.rest(TICK);
    }
    let (stepped, rested) = (stepped.plant, rested.plant);
    assert!(close(stepped.truth().soc, rested.truth().soc, 1e-6));
    let warm = stepped.measurements().temperature[0];
    assert!(close(warm, rested.measurements().temperature[0], 1e-3));
    assert!(warm > 30.0);
}

#[test]
fn a_pair_at_full_load_settles_near_70_degrees_with_120_seconds() {
    let (mut bench, _) = with_load(Rail::V12C, Load::Power(125.0));
    bench.plant.set_load(Rail::V12D, Load::Power(125.0));
    bench.command(|commands| commands.rail_on[Rail::V12D.index()] = true);
    bench.plant.rest(Duration::from_secs(120));
    let read = bench.plant.measurements();
    assert!(
        close(read.temperature[1], 25.0 + 45.0 * 0.632, 0.1),
        "{read:?}"
    );
    assert_eq!(read.temperature[0], 25.0);
    bench.plant.rest(Duration::from_secs(1200));
    assert!(close(bench.plant.measurements().temperature[1], 70.0, 0.1));
}

#[test]
fn stalled_motors_blow_their_fuses() {
    let mut bench = Bench::unlimited();
    let blocked = MotorFaults {
        blocked: true,
        ..MotorFaults::default()
    };
    bench.plant.set_side_faults(Side::Right, blocked);
    bench.plant.set_side_faults(Side::Left, blocked);
    bench.drive(1.0, 1.0);
    let took = bench.run_while(60.0, |bench| !bench.plant.is_fuse_blown(FuseId::MotorLeft));
    println!("a stalled motor blows its fuse after {took:.2} s");
    assert!((1.0..15.0).contains(&took));
    bench.run(1.0);
    assert_eq!(bench.plant.truth().motor_current.left, 0.0);
    assert!(bench.plant.measurements().module_powered);
    for side in Side::ALL {
        bench.plant.set_side_faults(side, MotorFaults::default());
    }
    bench.run(1.0);
    assert!(bench.speed().abs() < 1e-3);
}

#[test]
fn a_fuse_carries_its_rating_for_ever_and_rest_finds_the_instant_it_blows() {
    let (mut bench, _) = with_load(Rail::V48, Load::Power(2900.0));
    bench.plant.rest(Duration::from_secs(600));
    assert!(bench.plant.measurements().rail_current[4] > 55.0);
    assert!(!bench.plant.is_fuse_blown(FuseId::Tail));

    let (mut short, _) = with_load(Rail::V48, Load::Short);
    let from = short.plant.truth().soc;
    short.plant.rest(Duration::from_secs(3600));
    assert!(short.plant.is_fuse_blown(FuseId::Tail));
    // Had the short lasted for the hour, the battery would be empty.
    assert!(short.plant.truth().soc > from - 0.05);
    let read = short.plant.measurements();
    assert!(!read.module_powered);
    assert_eq!(read.bus_voltage, 0.0);
}

#[test]
fn charge_and_sag_show_on_the_bus() {
    let charged = |percent: f64| {
        let mut settings = R150PlantSettings::default();
        settings.battery.initial_soc = percent;
        Bench::with(&settings)
    };
    let mut last = f64::INFINITY;
    for percent in [100.0, 90.0, 55.0, 20.0, 5.0, 0.0] {
        let volts = charged(percent).plant.measurements().bus_voltage;
        assert!(volts < last);
        last = volts;
    }
    assert!(close(last, 39.0, 0.1));
    let mut bench = charged(50.0);
    assert!(close(bench.plant.measurements().bus_voltage, 48.1, 0.1));
    bench.plant.set_load(Rail::V48, Load::Power(1000.0));
    bench.command(|commands| commands.rail_on[4] = true);
    let firm = bench.plant.measurements().bus_voltage;
    let worn = R150Faults {
        supply_resistance: 0.2,
        ..R150Faults::default()
    };
    bench.plant.set_faults(&worn);
    assert!(bench.plant.measurements().bus_voltage < firm - 4.0);
}

#[test]
fn pwm_inputs_measure_what_is_within_their_limits() {
    let mut bench = Bench::new();
    let generator = |frequency, duty, high_voltage| PwmSource::Generator {
        frequency,
        duty,
        high_voltage,
    };
    let nothing = PwmReading::default();
    for (source, expected) in [
        (
            generator(50.0, 0.075, 5.0),
            PwmReading {
                frequency: 50.0,
                duty: 0.075,
            },
        ),
        (
            generator(10.0, 0.5, 2.0),
            PwmReading {
                frequency: 10.0,
                duty: 0.5,
            },
        ),
        (
            generator(20_000.0, 0.5, 15.0),
            PwmReading {
                frequency: 20_000.0,
                duty: 0.5,
            },
        ),
        (generator(50.0, 0.5, 1.99), nothing),
        (generator(50.0, 0.5, 15.01), nothing),
        (generator(9.99, 0.5, 5.0), nothing),
        (generator(20_001.0, 0.5, 5.0), nothing),
        (generator(50.0, 0.0, 5.0), nothing),
        (generator(f64::NAN, f64::NAN, f64::NAN), nothing),
        (PwmSource::OwnOutput(7), nothing),
        (PwmSource::None, nothing),
    ] {
        bench.plant.set_pwm_source(2, source);
        assert_eq!(bench.plant.measurements().pwm_in[2], expected, "{source:?}");
    }
    bench.plant.set_pwm_source(0, PwmSource::OwnOutput(3));
    assert_eq!(bench.plant.measurements().pwm_in[0], nothing);
    bench.command(|commands| commands.pwm_out_duty[3] = 0.25);
    let read = bench.plant.measurements().pwm_in[0];
    assert_eq!(
        read,
        PwmReading {
            frequency: 1000.0,
            duty: 0.25
        }
    );
}

#[test]
fn encoders_can_lie_while_the_truth_goes_on() {
    let mut bench = Bench::new();
    bench.drive(1.0, 1.0);
    bench.run(2.0);
    let with = |encoder| MotorFaults {
        encoder,
        ..MotorFaults::default()
    };
    bench
        .plant
        .set_side_faults(Side::Right, with(EncoderState::Lost));
    bench
        .plant
        .set_side_faults(Side::Left, with(EncoderState::Stuck));
    bench.drive(0.5, 0.5);
    bench.run(2.0);
    let rpm = bench.plant.measurements().motor_rpm;
    assert_eq!(rpm.right, 0.0);
    assert!(close(rpm.left, 1513.0, 30.0));
    assert!(close(bench.speed(), 0.69, 0.02), "{}", bench.speed());
}
