//! Overcurrent, over-temperature and undervoltage.

use super::*;
use crate::r150_device::command::sys_status as bit;
use crate::r150_device::settings::{OvercurrentRecovery, ProtectionAction, ProtectionSettings};

const MS: fn(u64) -> Duration = Duration::from_millis;

/// All rails on and nothing drawn.
fn idle(change: impl FnOnce(&mut R150FirmwareSettings)) -> Bench {
    let mut bench = Bench::with(change);
    bench.power(0b11_1111);
    bench.read(|r| {
        r.rail_voltage = [12.0, 12.0, 12.0, 12.0, 50.0, 5.0];
        r.rail_current = [0.0; 6];
        r.temperature = [25.0; 2];
    });
    bench.codes();
    bench
}

/// One row: these currents trip this status bit after that time, and switch these rails off.
#[test]
fn overcurrent_trips_at_its_time_and_not_one_quantum_before() {
    let pair = 275.0 / 12.0; // 110 % of 250 W at 12 V
    let main = 2500.0 / 50.0; // 125 % of 2000 W at 50 V
    let rows: [([f64; 6], u32, u8, Duration); 9] = [
        (
            [pair / 2.0, pair / 2.0 + 0.01, 0., 0., 0., 0.],
            bit::OVERCURRENT_AB,
            0b11_1100,
            MS(200),
        ),
        (
            [pair + 0.01, 0., 0., 0., 0., 0.],
            bit::OVERCURRENT_AB,
            0b11_1100,
            MS(200),
        ),
        (
            [0., 0., 0., pair + 0.01, 0., 0.],
            bit::OVERCURRENT_CD,
            0b11_0011,
            MS(200),
        ),
        (
            [0., 0., 0., 0., main + 0.01, 0.],
            bit::OVERCURRENT_48V,
            0b10_1111,
            MS(100),
        ),
        (
            [0., 0., 0., 0., 0., 2.01],
            bit::OVERCURRENT_5V,
            0b01_1111,
            MS(100),
        ),
        (
            [62.6, 0., 0., 0., 0., 0.],
            bit::OVERCURRENT_AB,
            0b11_1100,
            MS(1),
        ),
        (
            [0., 0., 31.3, 31.3, 0., 0.],
            bit::OVERCURRENT_CD,
            0b11_0011,
            MS(1),
        ),
        (
            [0., 0., 0., 0., 125.1, 0.],
            bit::OVERCURRENT_48V,
            0b10_1111,
            MS(1),
        ),
        (
            [0., 0., 0., 0., 0., 6.01],
            bit::OVERCURRENT_5V,
            0b01_1111,
            MS(1),
        ),
    ];
    for (currents, status, left_on, time) in rows {
        let mut bench = idle(|_| {});
        bench.read(|r| r.rail_current = currents);
        bench.after(time - QUANTUM);
        assert_eq!(bench.device.power_status(), 0b11_1111, "{currents:?}");
        assert_eq!(bench.device.sys_status(), 0);
        bench.after(QUANTUM);
        assert_eq!(bench.device.power_status(), left_on, "{currents:?}");
        assert_eq!(bench.device.sys_status(), status, "{currents:?}");
        let info = bench.info();
        assert_eq!((info.sys_status, info.power_status), (status, left_on));
        assert_eq!(bench.codes(), ["overcurrent"]);
    }
}

/// One row: with this setting these readings set this status bit after that time, and with the default
/// they do not by then.
#[test]
fn every_limit_threshold_and_delay_may_be_another() {
    type Row = (
        fn(&mut ProtectionSettings),
        fn(&mut R150Measurements),
        u32,
        Duration,
    );
    let rows: [Row; 9] = [
        (
            |s| s.limit_12v = 125.0,
            |r| r.rail_current[0] = 11.47,
            bit::OVERCURRENT_AB,
            MS(200),
        ),
        (
            |s| s.limit_48v = 1000.0,
            |r| r.rail_current[4] = 25.01,
            bit::OVERCURRENT_48V,
            MS(100),
        ),
        (
            |s| s.limit_5v = 1.0,
            |r| r.rail_current[5] = 1.01,
            bit::OVERCURRENT_5V,
            MS(100),
        ),
        (
            |s| s.threshold_12v = 50.0,
            |r| r.rail_current[2] = 10.43,
            bit::OVERCURRENT_CD,
            MS(200),
        ),
        (
            |s| s.threshold_48v = 50.0,
            |r| r.rail_current[4] = 20.01,
            bit::OVERCURRENT_48V,
            MS(100),
        ),
        (
            |s| s.delay_12v = MS(50),
            |r| r.rail_current[0] = 25.0,
            bit::OVERCURRENT_AB,
            MS(50),
        ),
        (
            |s| s.delay_48v = MS(50),
            |r| r.rail_current[4] = 60.0,
            bit::OVERCURRENT_48V,
            MS(50),
        ),
        (
            |s| s.undervoltage = 45.0,
            |r| r.bus_voltage = 44.9,
            bit::POWER_MODULE_FAULT,
            MS(5),
        ),
        (
            |s| s.over_temperature = 60.0,
            |r| r.temperature[1] = 60.1,
            bit::OVER_TEMPERATURE_CD,
            QUANTUM,
        ),
    ];
    for (row, (change, readings, status, time)) in rows.into_iter().enumerate() {
        let mut usual = idle(|_| {});
        usual.read(readings);
        usual.after(time);
        assert_eq!(usual.device.sys_status(), 0, "row {row}, by default");
        let mut bench = idle(|s| change(&mut s.protection));
        bench.read(readings);
        if time > QUANTUM {
            bench.after(time - QUANTUM);
            assert_eq!(bench.device.sys_status(), 0, "row {row}");
        }
        bench.after(QUANTUM);
        assert_eq!(bench.device.sys_status(), status, "row {row}");
    }
}

#[test]
fn at_the_threshold_nothing_trips() {
    let mut bench = idle(|_| {});
    bench.read(|r| r.rail_current = [275.0 / 24.0, 275.0 / 24.0, 275.0 / 12.0, 0.0, 50.0, 2.0]);
    bench.after(Duration::from_secs(2));
    assert_eq!(bench.device.power_status(), 0b11_1111);
}

#[test]
fn a_short_collapses_the_voltage_and_trips_all_the_same() {
    let mut bench = idle(|_| {});
    bench.read(|r| {
        r.rail_voltage[0] = 0.4;
        r.rail_current[0] = 80.0;
    });
    bench.after(MS(1));
    assert_eq!(bench.device.sys_status(), bit::OVERCURRENT_AB);
}

#[test]
fn an_overload_that_ends_in_time_starts_again() {
    let mut bench = idle(|_| {});
    for _ in 0..5 {
        bench.read(|r| r.rail_current[0] = 30.0);
        bench.after(MS(150));
        bench.read(|r| r.rail_current[0] = 1.0);
        bench.after(MS(1));
    }
    assert_eq!(bench.codes(), [""; 0]);
}

fn tripped(change: impl FnOnce(&mut R150FirmwareSettings)) -> Bench {
    let mut bench = idle(change);
    bench.read(|r| r.rail_current[0] = 30.0);
    bench.after(MS(200));
    bench.read(|r| r.rail_current[0] = 0.0);
    assert_eq!(bench.device.sys_status(), bit::OVERCURRENT_AB);
    bench.codes();
    bench
}

#[test]
fn a_trip_is_latched_until_the_pair_is_commanded_off() {
    let mut bench = tripped(|_| {});
    bench.after(MS(1000));
    assert!(bench.power(0b11_1111), "the command itself succeeds");
    assert_eq!(bench.device.power_status(), 0b11_1100);
    bench.power(0b11_1101);
    assert_eq!(
        bench.device.power_status(),
        0b11_1100,
        "half of the pair is still asked for"
    );
    assert_eq!(bench.device.sys_status(), bit::OVERCURRENT_AB);
    bench.power(0b11_1100);
    assert_eq!(bench.device.sys_status(), 0);
    assert_eq!(bench.codes(), ["trip_cleared"]);
    bench.power(0b11_1111);
    assert_eq!(bench.device.power_status(), 0b11_1111);
}

#[test]
fn power_control_may_say_that_a_rail_stays_off() {
    let mut bench = tripped(|s| s.true_when_tripped = false);
    assert!(!bench.power(0b11_1111));
    assert!(bench.power(0b11_1100));
}

#[test]
fn a_latched_trip_trips_again_if_the_load_is_still_there() {
    let mut bench = tripped(|_| {});
    bench.power(0);
    bench.power(0b11);
    bench.read(|r| r.rail_current[0] = 30.0);
    bench.after(MS(200));
    assert_eq!(bench.device.power_status(), 0);
    assert_eq!(bench.codes(), ["trip_cleared", "overcurrent"]);
}

#[test]
fn with_retry_a_trip_tries_again_by_itself() {
    let mut bench = tripped(|s| {
        s.protection.overcurrent_recovery = OvercurrentRecovery::Retry;
        s.heartbeat_timeout = Duration::from_secs(60);
    });
    bench.after(Duration::from_secs(5) - QUANTUM);
    assert_eq!(bench.device.power_status(), 0b11_1100);
    bench.after(QUANTUM);
    assert_eq!(bench.device.power_status(), 0b11_1111);
    assert_eq!(bench.device.sys_status(), 0);
}

#[test]
fn a_retry_may_come_sooner() {
    let mut bench = tripped(|s| {
        s.protection.overcurrent_recovery = OvercurrentRecovery::Retry;
        s.protection.retry_period = MS(300);
    });
    bench.after(MS(300) - QUANTUM);
    assert_eq!(bench.device.power_status(), 0b11_1100);
    bench.after(QUANTUM);
    assert_eq!(bench.device.power_status(), 0b11_1111);
}

#[test]
fn heat_may_clear_at_another_temperature() {
    let mut bench = idle(|s| s.protection.over_temperature = 60.0);
    for (celsius, hot) in [(60.1, true), (50.1, true), (49.9, false)] {
        bench.read(|r| r.temperature = [celsius, 25.0]);
        let status = bench.device.sys_status();
        assert_eq!(
            status == bit::OVER_TEMPERATURE_AB,
            hot,
            "{celsius}: {status}"
        );
    }
}

#[test]
fn a_retry_that_heat_has_held_back_comes_when_it_has_cooled_and_not_before() {
    let mut bench = tripped(|s| {
        s.protection.overcurrent_recovery = OvercurrentRecovery::Retry;
        s.heartbeat_timeout = Duration::from_secs(60);
    });
    bench.read(|r| r.temperature = [90.0, 25.0]);
    bench.after(Duration::from_secs(20));
    bench.codes();
    bench.read(|r| r.temperature = [60.0, 25.0]);
    bench.after(Duration::ZERO);
    let reported = std::iter::from_fn(|| bench.device.poll_event());
    let reported: Vec<SimTime> = reported.map(|(at, _)| at).collect();
    assert_eq!(reported, [bench.now; 2], "the trip and the heat");
}

#[test]
fn over_temperature_sets_above_85_and_clears_below_75() {
    let mut bench = idle(|_| {});
    bench.read(|r| r.temperature = [85.0, 25.0]);
    assert_eq!(bench.device.sys_status(), 0);
    bench.read(|r| r.temperature = [85.1, 25.0]);
    assert_eq!(bench.device.sys_status(), bit::OVER_TEMPERATURE_AB);
    assert_eq!(bench.device.power_status(), 0b11_1100);
    bench.read(|r| r.temperature = [75.0, 25.0]);
    assert_eq!(bench.device.sys_status(), bit::OVER_TEMPERATURE_AB);
    // While hot, not even off and on helps.
    bench.power(0);
    bench.power(0b11);
    assert_eq!(bench.device.power_status(), 0);
    bench.read(|r| r.temperature = [74.9, 90.0]);
    assert_eq!(bench.device.sys_status(), bit::OVER_TEMPERATURE_CD);
    assert_eq!(
        bench.device.power_status(),
        0,
        "asked for while hot, it stays off"
    );
    bench.power(0);
    bench.power(0b11);
    assert_eq!(bench.device.power_status(), 0b11);
    let codes = bench.codes();
    assert_eq!(
        codes,
        [
            "over_temperature",
            "trip_cleared",
            "cooled",
            "over_temperature",
            "trip_cleared"
        ]
    );
}

#[test]
fn a_pair_that_was_too_hot_stays_off_until_it_is_commanded_off() {
    let mut bench = idle(|_| {});
    bench.read(|r| r.temperature = [90.0, 25.0]);
    bench.read(|r| r.temperature = [60.0, 25.0]);
    assert_eq!(bench.device.sys_status(), 0);
    assert_eq!(bench.device.power_status(), 0b11_1100);
    bench.power(0);
    bench.power(0b11_1111);
    assert_eq!(bench.device.power_status(), 0b11_1111);
}

#[test]
fn undervoltage_sets_below_39_v_and_switches_everything_off() {
    let mut bench = idle(|_| {});
    bench.read(|r| r.bus_voltage = 39.0);
    bench.after(MS(100));
    assert_eq!(bench.device.sys_status(), 0);
    bench.read(|r| r.bus_voltage = 38.99);
    bench.after(MS(5) - QUANTUM);
    assert_eq!(bench.device.sys_status(), 0);
    assert_eq!(bench.device.power_status(), 0b11_1111);
    bench.after(QUANTUM);
    assert_eq!(bench.device.sys_status(), bit::POWER_MODULE_FAULT);
    assert_eq!(bench.device.power_status(), 0);
    bench.read(|r| r.bus_voltage = 40.9);
    assert_eq!(bench.device.sys_status(), bit::POWER_MODULE_FAULT);
    bench.read(|r| r.bus_voltage = 41.1);
    assert_eq!(bench.device.sys_status(), 0);
    assert_eq!(
        bench.device.power_status(),
        0,
        "off until commanded off and on"
    );
    bench.power(0);
    bench.power(0b1);
    assert_eq!(bench.device.power_status(), 0b1);
}

#[test]
fn a_sag_shorter_than_the_delay_is_ridden_out() {
    let mut bench = idle(|_| {});
    for _ in 0..5 {
        bench.read(|r| r.bus_voltage = 30.0);
        bench.after(MS(4));
        bench.read(|r| r.bus_voltage = 48.0);
        bench.after(MS(4));
    }
    assert_eq!(bench.codes(), [""; 0]);
}

#[test]
fn a_fault_of_the_power_module_itself_sets_bit_6() {
    let mut bench = idle(|_| {});
    bench.read(|r| r.power_module_fault = true);
    assert_eq!(bench.device.sys_status(), bit::POWER_MODULE_FAULT);
    assert_eq!(bench.device.power_status(), 0);
    assert_eq!(bench.codes(), ["power_module_fault"]);
}

/// What is reported only leaves the outputs on, and ends with its cause.
#[test]
fn an_overloaded_12_v_pair_may_be_reported_only() {
    let mut bench = idle(|s| s.protection.on_overcurrent_12v = ProtectionAction::Report);
    bench.read(|r| r.rail_current[0] = 30.0);
    bench.after(MS(200) - QUANTUM);
    assert_eq!(bench.device.sys_status(), 0);
    bench.after(QUANTUM);
    assert_eq!(bench.device.sys_status(), bit::OVERCURRENT_AB);
    assert_eq!(bench.device.power_status(), 0b11_1111);
    bench.after(MS(1000));
    bench.read(|r| r.rail_current[0] = 1.0);
    assert_eq!(bench.device.sys_status(), 0);
    assert_eq!(bench.codes(), ["overcurrent", "trip_cleared"]);
    // 48 V and 5 V have the protection that the manual promises.
    bench.read(|r| r.rail_current[4..].copy_from_slice(&[126.0, 2.1]));
    bench.after(MS(100));
    assert_eq!(bench.device.power_status(), 0b00_1111);
}

#[test]
fn over_temperature_may_be_reported_only() {
    let mut bench = idle(|s| s.protection.on_over_temperature = ProtectionAction::Report);
    bench.read(|r| r.temperature = [25.0, 86.0]);
    assert_eq!(bench.device.sys_status(), bit::OVER_TEMPERATURE_CD);
    assert_eq!(bench.device.power_status(), 0b11_1111);
    bench.power(0);
    bench.power(0b1100);
    assert_eq!(bench.device.power_status(), 0b1100);
    bench.read(|r| r.temperature = [25.0, 74.0]);
    assert_eq!(bench.device.sys_status(), 0);
    assert_eq!(bench.codes(), ["over_temperature", "cooled"]);
}

#[test]
fn a_power_module_fault_may_be_reported_only() {
    let mut bench = idle(|s| s.protection.on_power_module_fault = ProtectionAction::Report);
    bench.read(|r| r.bus_voltage = 38.0);
    bench.after(MS(5));
    assert_eq!(bench.device.sys_status(), bit::POWER_MODULE_FAULT);
    assert_eq!(bench.device.power_status(), 0b11_1111);
    bench.read(|r| r.bus_voltage = 42.0);
    assert_eq!(bench.device.sys_status(), 0);
    assert_eq!(bench.device.power_status(), 0b11_1111);
    let codes = ["power_module_fault", "power_module_recovered"];
    assert_eq!(bench.codes(), codes);
}
