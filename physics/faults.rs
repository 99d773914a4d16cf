//! Faults that vehicles of every kind can have.

use crate::twist::Wrench;

/// The most that may be done to a vehicle.
#[derive(Debug, Clone, Copy)]
pub struct Bounds {
    /// kg.
    pub payload: f64,
    /// N and N·m.
    pub push: f64,
}

/// State of a wheel encoder.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum EncoderState {
    /// It measures.
    #[default]
    Working,
    /// Its cable is off: it reads zero, and pulses are lost.
    Lost,
    /// It repeats what it read last; a counter that is free again has everything that it missed.
    Stuck,
}

/// Faults of a motor and of what it drives: the wheels of a side of the R150, a wheel of the car.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct MotorFaults {
    /// Set if what it drives cannot turn at all; rollers of a mecanum wheel still can.
    pub blocked: bool,
    /// Something drags on that, N·m.
    pub drag_torque: f64,
    /// The motor's cable is off: it neither drives nor holds.
    pub free_wheeling: bool,
    /// The brake holds all the time.
    pub brake_stuck_on: bool,
    /// The brake does not hold.
    pub brake_stuck_open: bool,
    /// The motor turns the other way than commanded. Its encoder is not reversed.
    pub reversed: bool,
    /// The encoder.
    pub encoder: EncoderState,
}

impl MotorFaults {
    /// With a drag of at most this, N·m.
    pub(crate) fn within(self, drag: f64) -> Self {
        Self {
            drag_torque: number(self.drag_torque).clamp(0.0, drag),
            ..self
        }
    }
}

/// Faults of a vehicle as a body.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct BodyFaults {
    /// Most friction that the ground under the wheels gives.
    pub friction: Option<f64>,
    /// Payload on the deck, kg.
    pub payload: f64,
    /// Push.
    pub push: Wrench,
}

impl BodyFaults {
    pub(crate) fn within(&self, bounds: Bounds) -> Self {
        Self {
            friction: self
                .friction
                .map(|friction| number(friction).clamp(0.0, 10.0)),
            payload: number(self.payload).clamp(0.0, bounds.payload),
            push: Wrench {
                ahead: within(self.push.ahead, bounds.push),
                left: within(self.push.left, bounds.push),
                turn: within(self.push.turn, bounds.push),
            },
        }
    }
}

/// Callers check what they are given; this is the last line that keeps a NaN out of the state.
pub(crate) fn number(value: f64) -> f64 {
    if value.is_nan() { 0.0 } else { value }
}

/// A number of either sign that is held within bounds.
pub(crate) fn within(value: f64, most: f64) -> f64 {
    number(value).clamp(-most, most)
}
