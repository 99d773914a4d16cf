//! What was assumed about the R150's hardware, chosen otherwise.

mod common;

use sim_physics::Plant as _;
use std::time::Duration;

use common::Bench;
use sim_physics::R150PlantSettings;
use sim_physics::r150::{
    AtZeroPwm, FuseId, Load, OutputDuty, PwmReading, PwmSource, R150Faults, Rail, SteadyLevel,
    Unmeasured,
};

fn with(change: impl FnOnce(&mut R150PlantSettings)) -> Bench {
    let mut settings = R150PlantSettings::default();
    change(&mut settings);
    Bench::with(&settings)
}

/// How far it rolls after full speed once the PWM is 0.
fn way_to_rest(at_zero_pwm: AtZeroPwm) -> f64 {
    let mut bench = with(|s| s.motor.at_zero_pwm = at_zero_pwm);
    bench.drive(1.0, 1.0);
    bench.run(3.0);
    let from = bench.plant.truth().distance;
    bench.drive(0.0, 0.0);
    // Behind the ramp.
    bench.run(0.27);
    assert_eq!(
        bench.plant.truth().motor_current.right == 0.0,
        at_zero_pwm == AtZeroPwm::Coast
    );
    bench.run_while(60.0, |bench| !bench.plant.at_rest());
    assert!(bench.plant.at_rest());
    bench.plant.truth().distance - from
}

#[test]
fn at_pwm_0_it_brakes_or_rolls_on() {
    let [brake, coast] = [AtZeroPwm::Brake, AtZeroPwm::Coast].map(way_to_rest);
    println!("{brake:.2} m braking, {coast:.2} m coasting");
    assert!(brake < 0.5);
    // Dry friction of gears and tyres alone stops it: 1.4² / 2 over about 0.9 m/s².
    assert!(coast > 3.0 * brake && coast < 5.0);
}

/// A vehicle whose tail supply carries more than its fuse can for ever.
fn overloaded() -> Bench {
    let mut bench = Bench::new();
    bench.plant.set_load(Rail::V48, Load::Power(4500.0));
    bench.command(|commands| commands.rail_on[Rail::V48.index()] = true);
    bench
}

fn blown(bench: &Bench) -> bool {
    bench.plant.is_fuse_blown(FuseId::Tail)
}

#[test]
fn a_fuse_blows_when_it_has_warmed_to_its_holding_current() {
    let holding: f64 = 60.0 * 1.2;
    let mut bench = overloaded();
    let current = bench.plant.measurements().supply_current;
    assert!(current > 1.2 * holding, "{current}");
    let seconds = 10.0 * (current.powi(2) / (current.powi(2) - holding.powi(2))).ln();
    bench.plant.rest(Duration::from_secs_f64(seconds * 0.999));
    assert!(!blown(&bench), "before {seconds} s");
    bench.plant.rest(Duration::from_secs_f64(seconds * 0.01));
    assert!(blown(&bench), "at {seconds} s");
    assert!(!bench.plant.measurements().module_powered);
}

#[test]
fn the_converters_may_be_warm_at_the_start_and_cool_to_what_is_around() {
    let mut bench = with(|s| s.thermal.initial_rise = 30.0);
    assert_eq!(bench.plant.measurements().temperature, [55.0; 2]);
    bench.plant.rest(Duration::from_secs(1800));
    let [ab, _] = bench.plant.measurements().temperature;
    assert!((ab - 25.0).abs() < 0.01, "{ab}");
}

fn generator(frequency: f64, duty: f64, high_voltage: f64) -> PwmSource {
    PwmSource::Generator {
        frequency,
        duty,
        high_voltage,
    }
}

#[test]
fn an_input_may_keep_what_it_measured_last() {
    let mut bench = with(|s| s.pwm.unmeasured = Unmeasured::Last);
    let last = PwmReading {
        frequency: 50.0,
        duty: 0.25,
    };
    assert_eq!(bench.plant.measurements().pwm_in[1], PwmReading::default());
    bench.plant.set_pwm_source(1, generator(50.0, 0.25, 5.0));
    for lost in [
        generator(50.0, 0.25, 1.0),
        generator(5.0, 0.5, 5.0),
        generator(30_000.0, 0.5, 5.0),
        generator(50.0, 1.0, 5.0),
        PwmSource::None,
    ] {
        bench.plant.set_pwm_source(1, lost);
        assert_eq!(bench.plant.measurements().pwm_in[1], last, "{lost:?}");
    }
    assert_eq!(bench.plant.measurements().pwm_in[0], PwmReading::default());
}

#[test]
fn an_input_may_read_a_level_that_never_changes() {
    let mut bench = with(|s| s.pwm.steady_level = SteadyLevel::Level);
    for (source, duty) in [
        (generator(50.0, 1.0, 5.0), 1.0),
        (generator(50.0, 0.0, 5.0), 0.0),
        (generator(50.0, 1.0, 1.0), 0.0),
        (PwmSource::OwnOutput(2), 0.0),
    ] {
        bench.plant.set_pwm_source(3, source);
        let expected = PwmReading {
            frequency: 0.0,
            duty,
        };
        assert_eq!(bench.plant.measurements().pwm_in[3], expected, "{source:?}");
    }
    bench.command(|commands| commands.pwm_out_duty[2] = 1.0);
    assert_eq!(bench.plant.measurements().pwm_in[3].duty, 1.0);
}

#[test]
fn the_duty_of_an_output_may_be_the_time_in_which_it_sinks() {
    let mut bench = with(|s| s.pwm.output_duty = OutputDuty::Sinking);
    bench.plant.set_pwm_source(0, PwmSource::OwnOutput(3));
    bench.command(|commands| commands.pwm_out_duty[3] = 0.25);
    let expected = PwmReading {
        frequency: 1000.0,
        duty: 0.75,
    };
    assert_eq!(bench.plant.measurements().pwm_in[0], expected);
}

#[test]
fn the_converters_and_the_supply_can_be_measured_apart_from_the_outputs() {
    let mut bench = Bench::new();
    let idle = bench.plant.measurements();
    assert_eq!((idle.converter_12v, idle.rail_voltage[0]), (12.0, 0.0));
    assert!((0.05..0.2).contains(&idle.supply_current), "{idle:?}");
    bench.plant.set_load(Rail::V12A, Load::Power(100.0));
    bench.command(|commands| commands.rail_on[0] = true);
    let loaded = bench.plant.measurements();
    let drawn = (loaded.supply_current - idle.supply_current) * loaded.bus_voltage;
    assert!(
        (105.0..115.0).contains(&drawn),
        "{drawn} W through the converter"
    );
    let mut faults = R150Faults::default();
    faults.fuses_out[2] = true;
    bench.plant.set_faults(&faults);
    let off = bench.plant.measurements();
    assert_eq!((off.converter_12v, off.supply_current), (0.0, 0.0));
}
