use super::*;

const MOTOR: MotorPort = MotorPort {
    connected: true,
    duty: 0.0,
    back_emf: 20.0,
    resistance: 0.5,
};

#[test]
fn a_reversal_goes_down_by_one_ramp_and_up_by_the_other() {
    let settings = MotorSettings::default();
    let mut driver = Driver::new(&settings);
    let mut took = |wanted: f64| {
        let mut steps = 0;
        while (driver.duty - wanted).abs() > 1e-9 {
            driver.ramp(wanted, &settings, 0.005);
            steps += 1;
        }
        steps * 5
    };
    assert_eq!(took(1.0), 500);
    assert_eq!(took(-1.0), 750);
    assert_eq!(took(0.0), 250);
    let at_once = MotorSettings {
        ramp_up: std::time::Duration::ZERO,
        ..settings
    };
    driver.ramp(0.7, &at_once, 0.0005);
    assert_eq!(driver.duty, 0.7);
}

#[test]
fn the_limit_holds_both_ways_and_diodes_conduct_above_the_bus_only() {
    let driver = Driver {
        limit: Some(10.0),
        ..Driver::default()
    };
    for (duty, current) in [(1.0, 10.0), (-1.0, -10.0), (0.4, -1.6)] {
        let port = driver.port(true, duty, 48.0, MOTOR);
        let found = (port.duty * 48.0 - port.back_emf) / port.resistance;
        assert!((found - current).abs() < 1e-9, "{duty}: {found} A");
    }
    assert!(!driver.port(false, 1.0, 48.0, MOTOR).connected);
    let pushed = MotorPort {
        back_emf: -60.0,
        ..MOTOR
    };
    let port = driver.port(false, 0.0, 48.0, pushed);
    assert!(port.connected && port.duty == -1.0);
}

#[test]
fn heat_lowers_the_limit_and_shuts_off_until_it_has_cooled() {
    let (motor, thermal) = (MotorSettings::default(), MotorThermalSettings::default());
    let mut driver = Driver::new(&motor);
    let mut at = |celsius| {
        driver.warm(&motor, &thermal, 96.0, celsius);
        (driver.limit, driver.derated, driver.shut_off)
    };
    assert_eq!(at([110.0, 80.0]), (Some(45.0), false, false));
    assert_eq!(at([120.0, 25.0]), (Some(22.5), true, false));
    assert_eq!(at([130.0, 25.0]), (Some(0.0), true, true));
    assert!(at([121.0, 25.0]).2);
    assert!(!at([119.0, 25.0]).2);
    assert!(at([25.0, 95.0]).2);
}
