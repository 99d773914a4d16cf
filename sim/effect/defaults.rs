//! Defaults of parameters; the catalogue says the same in words.

use std::time::Duration;

use rigsim_settings::{Force, Length, Percent, Resistance, Span, Torque, Voltage};

use crate::device::parameters::{Direction, Interval, Motors, Probability};
use crate::line::Adapter;

const fn millis(millis: u64) -> Span {
    Span(Duration::from_millis(millis))
}

macro_rules! defaults {
    ($( $name:ident: $type:ty = $value:expr; )+) => { $(
        pub(crate) fn $name() -> $type {
            $value
        }
    )+ };
}

defaults! {
    always: Probability = Probability::ALWAYS;
    rarely: Probability = Probability(0.01);
    ice: Probability = Probability(0.05);
    burst_length: u16 = 8;
    piece: u16 = 3;
    one_less: i8 = -1;
    wrong_baud: u32 = 9600;
    no_adapter: Adapter = Adapter::Bytes;
    spread: u16 = 50;
    pulses: u16 = 20;
    yes: bool = true;
    to_client: Direction = Direction::ToClient;
    all_motors: Motors = Motors::All;
    pause: Span = millis(5);
    delay: Span = millis(50);
    noise_every: Interval = Interval(Duration::from_millis(100));
    slow: Span = millis(200);
    boot: Span = millis(500);
    late: Span = millis(500);
    sag: Voltage = Voltage(10.0);
    no_resistance: Resistance = Resistance(0.0);
    half: Percent = Percent(50.0);
    ghost: Length = Length(0.3);
    no_force: Force = Force(0.0);
    no_torque: Torque = Torque(0.0);
}
