//! Numbers and faults that no vehicle may be upset by.
#![allow(unreachable_pub, reason = "shared by including the file")]

use proptest::prelude::*;
use rigsim_physics::Wrench;
use rigsim_physics::faults::{BodyFaults, EncoderState, MotorFaults};

/// Mostly sensible, sometimes absurd; often within ±2, and less often within ±`usual`.
pub fn any_number(usual: f64) -> impl Strategy<Value = f64> {
    prop_oneof![
        6 => -2.0..2.0,
        3 => -usual..usual,
        1 => -1e7..1e7,
        1 => prop::sample::select(vec![0.0, -0.0, f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 1e308, f64::MIN_POSITIVE]),
    ]
}

pub fn any_motor_faults(usual: f64) -> impl Strategy<Value = MotorFaults> {
    let encoder = prop::sample::select(vec![
        EncoderState::Working,
        EncoderState::Lost,
        EncoderState::Stuck,
    ]);
    (any::<[bool; 5]>(), any_number(usual), encoder).prop_map(|(broken, drag_torque, encoder)| {
        let [
            blocked,
            free_wheeling,
            brake_stuck_open,
            brake_stuck_on,
            reversed,
        ] = broken;
        MotorFaults {
            blocked,
            drag_torque,
            free_wheeling,
            brake_stuck_on,
            brake_stuck_open,
            reversed,
            encoder,
        }
    })
}

pub fn any_body_faults(usual: f64) -> impl Strategy<Value = BodyFaults> {
    let any = any_number;
    (any(usual), any(usual), any(usual)).prop_map(|(friction, payload, push)| BodyFaults {
        friction: Some(friction),
        payload,
        push: Wrench {
            ahead: push,
            left: push,
            turn: -push,
        },
    })
}
