//! Each assumption chosen otherwise: commands, replies and who is in control.

use super::*;
use crate::r150_device::codec::encode;
use crate::r150_device::control::{Outputs, Parts};
use crate::r150_device::event::CONTROL_TAKEN;
use crate::r150_device::settings::{
    ControlMode, ControlTakenBy, Current48v, HeartbeatBy, MotorsAnswered, MotorsRefusalReply,
    OnHeartbeatLoss, OutOfRange, OverRate, RefusalReply, Voltage12v,
};
use crate::r150_device::vehicle::OperatorInput;

const TIMEOUT: Duration = Duration::from_secs(3);
const INTERVAL: Duration = Duration::from_millis(50);

const POWER: Parts = Parts {
    power: true,
    pwm: false,
};
const BOTH: Parts = Parts {
    power: true,
    pwm: true,
};
const NEITHER: Parts = Parts {
    power: false,
    pwm: false,
};

fn falsehood(command: u8) -> Option<Vec<u8>> {
    Some(encode(command, &[0]))
}

#[test]
fn a_bad_crc_may_be_answered_false_once_and_still_changes_nothing() {
    let mut bench = Bench::with(|s| s.on_bad_crc = RefusalReply::False);
    let mut frame = Request::PowerControl { on: 1 }.encode();
    frame[9] ^= 1;
    assert_eq!(bench.send(&frame), falsehood(0x02));
    assert_eq!(bench.reply(), None);
    assert_eq!(bench.device.power_status(), 0);
    assert_eq!(bench.device.control().by_client, NEITHER);
    // What is not a whole frame has no command to answer.
    bench.send(&[0x55, 0xAA, 0x55, 0x01]);
    bench.after(Duration::from_millis(21));
    assert_eq!(bench.reply(), None);
    assert_eq!(bench.codes(), ["bad_crc", "noise", "partial_frame"]);
}

#[test]
fn a_vehicle_that_hears_nothing_stops_after_a_timeout() {
    let mut bench = Bench::with(|s| s.motor_watchdog = Duration::from_secs(1));
    let full = Request::SetMotors {
        right: 1000,
        left: 1000,
    };
    bench.ask(full);
    let failure = Some(crate::r150_device::can::CanFailure::Cut);
    bench.device.set_can_failure(bench.now, failure);
    bench.after(crate::r150_device::CAN_TIMEOUT - Duration::from_nanos(1));
    assert_eq!(bench.device.commands().motor_duty.right, 1.0);
    bench.after(Duration::from_nanos(1));
    assert_eq!(bench.device.commands().motor_duty.right, 0.0);
    assert_eq!(bench.device.motor_set_point(), [1000, 1000]);
}

#[test]
fn a_refused_motor_command_may_be_answered() {
    let speeds = |bench: &mut Bench| Some(bench.device.motor_reply().encode());
    for (choice, expected) in [
        (MotorsRefusalReply::Silent, None),
        (MotorsRefusalReply::False, falsehood(0x12)),
        (MotorsRefusalReply::Speeds, speeds(&mut Bench::new())),
    ] {
        let mut bench = Bench::with(|s| {
            s.on_motors_refused = choice;
            s.on_motors_out_of_range = OutOfRange::Refuse;
        });
        assert_eq!(bench.send(&encode(0x12, &[1])), expected, "{choice:?}");
        // These replies are no more frequent than others to motor commands.
        assert_eq!(bench.send(&encode(0x12, &[1])), None, "{choice:?}");
        bench.after(INTERVAL);
        let beyond = Request::SetMotors {
            right: 9,
            left: -2000,
        };
        assert_eq!(bench.send(&beyond.encode()), expected, "{choice:?}");
        assert_eq!(bench.duty(), [0.0, 0.0], "{choice:?}");
        bench.after(INTERVAL);
        assert!(bench.drive(10, 10).is_some());
        assert_eq!(
            bench.codes(),
            ["wrong_length", "wrong_length", "motors_out_of_range"]
        );
    }
}

#[test]
fn motor_commands_may_be_answered_only_while_they_drive() {
    let mut bench = Bench::with(|s| s.motors_answered = MotorsAnswered::WhenDriving);
    bench
        .device
        .operate(bench.now, OperatorInput::EmergencyStop(true));
    assert_eq!(bench.drive(500, 500), None);
    bench
        .device
        .operate(bench.now, OperatorInput::EmergencyStop(false));
    assert_eq!(bench.duty(), [0.5, 0.5], "it took effect all the same");
    // An unanswered command is none that a later one could come too soon after.
    assert!(bench.drive(400, 400).is_some());
    assert_eq!(bench.codes(), ["operated", "not_driving", "operated"]);
}

#[test]
fn over_rate_ignore_changes_nothing_and_feeds_no_watchdog() {
    let mut bench = Bench::with(|s| s.over_rate = OverRate::Ignore);
    assert!(bench.drive(100, 100).is_some());
    bench.after(INTERVAL - QUANTUM);
    assert_eq!(bench.drive(200, 200), None);
    assert_eq!(bench.duty(), [0.1, 0.1]);
    bench.until(SimTime::from_millis(500));
    assert_eq!(bench.duty(), [0.0, 0.0]);
    assert!(bench.drive(300, 300).is_some());
    assert_eq!(bench.duty(), [0.3, 0.3]);
}

#[test]
fn it_answers_once_it_has_booted_and_not_one_quantum_before() {
    let boot = Duration::from_millis(800);
    let mut bench = Bench::with(|s| s.boot_time = boot);
    bench.after(boot - QUANTUM);
    assert_eq!(bench.ask(Request::Heartbeat), None);
    bench.after(QUANTUM);
    assert!(bench.ask(Request::Heartbeat).is_some());
    bench.read(|r| r.module_powered = false);
    bench.read(|r| r.module_powered = true);
    bench.after(boot - QUANTUM);
    assert_eq!(bench.ask(Request::Heartbeat), None);
    bench.after(QUANTUM);
    assert!(bench.ask(Request::Heartbeat).is_some());
    assert_eq!(bench.codes(), ["started", "power_lost", "started"]);
}

#[test]
fn voltage_12v_may_be_the_converters() {
    let mut bench = Bench::with(|s| s.voltage_12v = Voltage12v::Converter);
    bench.power(0b0001);
    let info = bench.info();
    assert_eq!(info.voltage_12v, [12_010, 12_050, 12_050, 12_050]);
    let mut bench = Bench::new();
    bench.power(0b0001);
    assert_eq!(bench.info().voltage_12v[1], 0);
}

#[test]
fn current_48v_may_be_that_of_the_supply() {
    let mut bench = Bench::with(|s| s.current_48v = Current48v::Supply);
    assert_eq!(bench.info().current_48v, 9_750);
    assert_eq!(Bench::new().info().current_48v, 7_000);
}

#[test]
fn any_frame_with_the_right_crc_may_be_a_heartbeat_but_takes_no_control() {
    let mut bench = Bench::with(|s| s.heartbeat_by = HeartbeatBy::Frames);
    bench.send(&encode(0x99, &[]));
    assert_eq!(bench.device.control().by_client, NEITHER);
    bench.power(0b11);
    for bad in [encode(0x99, &[]), encode(0x02, &[]), encode(0x12, &[])] {
        bench.after(TIMEOUT - QUANTUM);
        bench.send(&bad);
    }
    bench.after(TIMEOUT - QUANTUM);
    assert_eq!(bench.device.power_status(), 0b11);
    bench.after(QUANTUM);
    assert_eq!(bench.device.power_status(), 0);
}

#[test]
fn any_request_may_take_control_and_its_reply_tells_the_state_before() {
    let mut bench = Bench::with(|s| s.control_taken_by = ControlTakenBy::AnyRequest);
    let info = bench.info();
    assert_eq!((info.power_ctrl_mode, info.pwm_ctrl_mode), (1, 1));
    assert_eq!(bench.device.control().by_client, BOTH);
    let info = bench.info();
    assert_eq!((info.power_ctrl_mode, info.pwm_ctrl_mode), (0, 0));
}

#[test]
fn control_is_taken_by_the_command_that_needs_it() {
    let mut bench = Bench::new();
    for request in [Request::Heartbeat, Request::SystemInfo, Request::Version] {
        bench.ask(request);
    }
    bench.drive(100, 100);
    assert_eq!(bench.device.control().by_client, NEITHER);
    bench.events();
    assert!(bench.power(0b1));
    assert_eq!(bench.device.control().by_client, POWER);
    let words = "the client took control of power (RS232 mode)";
    let taken = EventKind::new(CONTROL_TAKEN, words);
    assert!(bench.events().contains(&taken));
    let info = bench.info();
    assert_eq!((info.power_ctrl_mode, info.pwm_ctrl_mode), (0, 1));
    bench.ask(Request::SetPwmOutputs { duty: [5; 4] });
    assert_eq!(bench.device.control().by_client, BOTH);
    bench.after(TIMEOUT);
    assert_eq!(bench.device.control().by_client, NEITHER);
}

#[test]
fn it_may_start_in_rs232_mode_and_keep_it_until_a_first_heartbeat_is_lost() {
    let mut bench = Bench::with(|s| s.control_at_power_on = ControlMode::Rs232);
    bench.after(TIMEOUT * 2);
    let app = Outputs {
        power: 0b1,
        pwm: [9; 4],
    };
    bench.device.operate(bench.now, OperatorInput::AppSets(app));
    assert_eq!(bench.device.power_status(), 0);
    assert_eq!(bench.device.control().by_client, BOTH);
    bench.ask(Request::Heartbeat);
    bench.after(TIMEOUT);
    assert_eq!(bench.device.control().by_client, NEITHER);
    assert_eq!(bench.device.power_status(), 0b1);
}

#[test]
fn the_app_may_have_switched_things_on() {
    let mut bench = Bench::with(|_| {});
    let outputs = Outputs {
        power: 0b10_0010,
        pwm: [1, 2, 3, 1000],
    };
    let sets = OperatorInput::AppSets(outputs);
    bench.device.operate(bench.now, sets);
    assert_eq!(bench.device.power_status(), 0b10_0010);
    assert_eq!(bench.device.control().outputs.pwm, [1, 2, 3, 1000]);
    assert!(bench.power(0b1));
    bench.after(TIMEOUT);
    assert_eq!(bench.device.power_status(), 0b10_0010);
}

#[test]
fn off_on_a_lost_heartbeat_leaves_what_the_app_holds() {
    let mut bench = Bench::with(|s| {
        s.on_heartbeat_loss = OnHeartbeatLoss::Off;
    });
    let sets = OperatorInput::AppSets(Outputs {
        power: 0,
        pwm: [7; 4],
    });
    bench.device.operate(bench.now, sets);
    let app_holds_pwm = OperatorInput::AppHolds(Parts {
        power: false,
        pwm: true,
    });
    bench.device.operate(bench.now, app_holds_pwm);
    bench.power(0b11);
    bench.after(TIMEOUT);
    let off = Outputs {
        power: 0,
        pwm: [7; 4],
    };
    assert_eq!(bench.device.control().outputs, off);
}

#[test]
fn what_the_app_refuses_may_be_silent() {
    let mut bench = Bench::with(|s| s.on_app_in_control = RefusalReply::Silent);
    let app_holds = OperatorInput::AppHolds(Parts {
        power: true,
        pwm: true,
    });
    bench.device.operate(bench.now, app_holds);
    assert_eq!(bench.ask(Request::PowerControl { on: 1 }), None);
    assert_eq!(bench.ask(Request::SetPwmOutputs { duty: [1; 4] }), None);
    assert!(bench.ask(Request::GetPwmOutputs).is_some());
    assert_eq!(
        bench.codes(),
        ["operated", "app_in_control", "app_in_control"]
    );
}
