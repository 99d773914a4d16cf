//! What was assumed about the R150's hardware, chosen otherwise.

mod common;

use rigsim_physics::Plant as _;
use std::time::Duration;

use common::Bench;
use rigsim_physics::R150PlantSettings;
use rigsim_physics::r150::{AtZeroPwm, FuseId, Load, R150Faults, Rail};

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
    let from = bench.plant.truth().motion.distance;
    bench.drive(0.0, 0.0);
    // Behind the ramp.
    bench.run(0.27);
    assert_eq!(
        bench.plant.truth().motor_current.right == 0.0,
        at_zero_pwm == AtZeroPwm::Coast
    );
    bench.run_while(60.0, |bench| !bench.plant.at_rest());
    assert!(bench.plant.at_rest());
    bench.plant.truth().motion.distance - from
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
