//! Heartbeat, and who is in control.

use super::*;
use crate::r150_device::control::{Outputs, Parts};
use crate::r150_device::settings::{ControlTakenBy, OnHeartbeatLoss, OnTakeover};
use crate::r150_device::vehicle::OperatorInput;

const TIMEOUT: Duration = Duration::from_secs(3);

fn modes(bench: &Bench) -> [bool; 2] {
    let control = bench.device.control();
    [control.by_client.power, control.by_client.pwm]
}

/// A bench on which the client has switched things on.
fn switched_on(change: impl FnOnce(&mut R150FirmwareSettings)) -> Bench {
    let mut bench = Bench::with(change);
    assert!(bench.power(0b11));
    bench.ask(Request::SetPwmOutputs { duty: [100; 4] });
    bench.codes();
    bench
}

#[test]
fn at_power_on_the_app_is_in_control_until_a_command_sets_something() {
    let mut bench = Bench::new();
    assert_eq!(modes(&bench), [false, false]);
    bench.send(&[0xAA, 0x55, 0x00, 0x07, 0x00, 0x00]);
    assert_eq!(modes(&bench), [false, false], "a bad CRC takes nothing");
    let modes_reported = |bench: &mut Bench| {
        let info = bench.info();
        (info.power_ctrl_mode, info.pwm_ctrl_mode)
    };
    assert_eq!(modes_reported(&mut bench), (1, 1), "looking takes nothing");
    assert!(bench.power(0));
    assert_eq!(modes_reported(&mut bench), (0, 1));
}

#[test]
fn the_heartbeat_is_lost_at_three_seconds_and_not_one_quantum_before() {
    let mut bench = switched_on(|_| {});
    bench.after(TIMEOUT - QUANTUM);
    assert_eq!(modes(&bench), [true, true]);
    assert_eq!(bench.device.power_status(), 0b11);
    assert_eq!(bench.codes(), [""; 0]);
    bench.after(QUANTUM);
    assert_eq!(modes(&bench), [false, false]);
    assert_eq!(bench.device.power_status(), 0);
    assert_eq!(bench.device.commands().pwm_out_duty, [0.0; 4]);
    assert_eq!(bench.codes(), ["heartbeat_lost"]);
}

#[test]
fn a_frame_at_the_last_moment_counts() {
    let mut bench = switched_on(|_| {});
    bench.now += TIMEOUT;
    // Not advanced: bytes that arrive exactly at the deadline come before it.
    assert!(bench.ask(Request::Heartbeat).is_some());
    bench.until(bench.now);
    assert_eq!(modes(&bench), [true, true]);
}

#[test]
fn every_command_counts_as_a_heartbeat() {
    let commands = [
        Request::PowerControl { on: 0b11 },
        Request::SetPwmOutputs { duty: [9999; 4] },
        Request::GetPwmOutputs,
        Request::GetPwmInputs,
        Request::SystemInfo,
        Request::Heartbeat,
        Request::Version,
        Request::SetMotors { right: 0, left: 0 },
    ];
    for request in commands {
        let mut bench = switched_on(|_| {});
        bench.after(TIMEOUT - QUANTUM);
        bench.ask(request);
        bench.after(TIMEOUT - QUANTUM);
        assert_eq!(modes(&bench), [true, true], "{request:?}");
        bench.after(QUANTUM);
        assert_eq!(modes(&bench), [false, false], "{request:?}");
    }
}

#[test]
fn what_is_no_valid_frame_is_no_heartbeat() {
    let mut bench = switched_on(|_| {});
    bench.after(TIMEOUT - Duration::from_millis(1));
    bench.send(&crate::r150_device::codec::encode(0x99, &[]));
    bench.send(&crate::r150_device::codec::encode(0x02, &[]));
    bench.after(Duration::from_millis(1));
    assert_eq!(modes(&bench), [false, false]);
}

#[test]
fn on_heartbeat_loss_holds_or_switches_off_as_set() {
    let app = Outputs {
        power: 0b1000,
        pwm: [1, 2, 3, 4],
    };
    for (choice, power, pwm) in [
        (OnHeartbeatLoss::App, 0b1000, [1, 2, 3, 4]),
        (OnHeartbeatLoss::Hold, 0b11, [100; 4]),
        (OnHeartbeatLoss::Off, 0, [0; 4]),
    ] {
        let mut bench = switched_on(|s| s.on_heartbeat_loss = choice);
        bench.device.operate(bench.now, OperatorInput::AppSets(app));
        assert_eq!(
            bench.device.power_status(),
            0b11,
            "the client is in control"
        );
        bench.after(TIMEOUT);
        assert_eq!(bench.device.power_status(), power, "{choice:?}");
        assert_eq!(bench.device.control().outputs.pwm, pwm, "{choice:?}");
        assert_eq!(modes(&bench), [false, false], "{choice:?}");
    }
}

#[test]
fn a_client_that_comes_back_finds_what_the_app_has_set() {
    let mut bench = switched_on(|_| {});
    bench.after(TIMEOUT);
    bench.ask(Request::Heartbeat);
    assert_eq!(modes(&bench), [false, false]);
    bench.ask(Request::SetPwmOutputs { duty: [1; 4] });
    assert_eq!(modes(&bench), [false, true]);
    assert_eq!(bench.device.power_status(), 0);
}

#[test]
fn with_restore_it_finds_what_it_had_set() {
    let mut bench = switched_on(|s| {
        s.on_takeover = OnTakeover::Restore;
        s.control_taken_by = ControlTakenBy::AnyRequest;
    });
    bench.after(TIMEOUT);
    assert_eq!(bench.device.power_status(), 0);
    bench.ask(Request::Heartbeat);
    assert_eq!(bench.device.power_status(), 0b11);
    assert_eq!(bench.device.commands().pwm_out_duty, [0.1; 4]);
}

#[test]
fn while_the_app_holds_control_power_and_pwm_commands_fail() {
    let mut bench = switched_on(|_| {});
    let app = Outputs {
        power: 0b10_0000,
        pwm: [7; 4],
    };
    bench.device.operate(bench.now, OperatorInput::AppSets(app));
    bench.device.operate(
        bench.now,
        OperatorInput::AppHolds(Parts {
            power: true,
            pwm: true,
        }),
    );
    assert!(!bench.power(0b1));
    let refused = Some(Reply::Bool {
        command: 0x03,
        success: false,
    });
    assert_eq!(bench.ask(Request::SetPwmOutputs { duty: [5; 4] }), refused);
    let info = bench.info();
    assert_eq!((info.power_ctrl_mode, info.pwm_ctrl_mode), (1, 1));
    assert_eq!(info.power_status, 0b10_0000);
    assert_eq!(
        bench.codes(),
        ["operated", "operated", "app_in_control", "app_in_control"]
    );
    // It may hold one and leave the other.
    bench.device.operate(
        bench.now,
        OperatorInput::AppHolds(Parts {
            power: true,
            pwm: false,
        }),
    );
    let taken = Some(Reply::Bool {
        command: 0x03,
        success: true,
    });
    assert_eq!(bench.ask(Request::SetPwmOutputs { duty: [5; 4] }), taken);
    assert!(!bench.power(0b1));
    bench.device.operate(
        bench.now,
        OperatorInput::AppHolds(Parts {
            power: false,
            pwm: false,
        }),
    );
    assert!(bench.power(0b1));
}

#[test]
fn a_module_without_supply_is_silent_and_starts_again() {
    let mut bench = switched_on(|_| {});
    bench.drive(500, 500);
    bench.read(|r| r.module_powered = false);
    assert_eq!(bench.ask(Request::Heartbeat), None);
    assert_eq!(bench.duty(), [0.0, 0.0]);
    assert_eq!(bench.device.commands().rail_on, [false; 6]);
    bench.after(Duration::from_secs(10));
    bench.read(|r| r.module_powered = true);
    assert_eq!(modes(&bench), [false, false]);
    assert!(bench.ask(Request::Heartbeat).is_some());
    assert_eq!(bench.device.power_status(), 0);
    assert_eq!(bench.codes(), ["power_lost", "started"]);
}
