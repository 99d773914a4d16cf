//! Faults of motors, their encoders and brakes, and of what they turn.

use rigsim_physics::faults::{EncoderState, MotorFaults};
use rigsim_settings::Torque;

use super::defaults;
use crate::device::parameters::Motors;
use crate::device::{
    Begin, Declared, Device, Effect, EffectError, MotorState, OnHardware, Sum, Tally, Work,
};

crate::faults! {
    /// Motors, what they turn, and their encoders and brakes.
    pub enum MotorFault {
        /// Wheels cannot turn.
        Blocked = "blocked", Mechanical,
        sees "Speed 0 of these wheels although driven; an R150's bus voltage falls and fuses may blow; a car's motion does not end.",
        counts "A blocked wheel was driven.",
        tries ["motors = \"all\"", "motors = \"left\"", "motors = \"left-front\""]
        weaker ["dragging"]
        motors "Motors, or wheels of a car."
        {}
        /// Something drags on wheels.
        Dragging = "dragging", Mechanical,
        sees "Less speed, and a vehicle that pulls to one side.",
        counts "A dragged wheel was driven or turned.",
        tries ["motors = \"all\"", "motors = \"left\"", "motors = \"left-front\""]
        lasts [300, 2000, 0]
        motors "Motors, or wheels of a car."
        {
            /// Torque at a side, or at one wheel of a car; default 100 N*m for an R150 and 0.5 N*m
            /// for a car.
            #[serde(default, skip_serializing_if = "Option::is_none")]
            torque: Option<Torque>,
        }
        /// Motors neither drive nor hold their wheels.
        FreeWheeling = "free-wheeling", Mechanical,
        sees "Less speed, and wheels that turn only because the others drag them.",
        counts "A motor without effect was driven.",
        tries ["motors = \"all\"", "motors = \"left\"", "motors = \"left-front\""]
        weaker ["dragging"]
        motors "Motors, or wheels of a car."
        {}
        /// The cables of encoders are unplugged.
        EncoderLost = "encoder-lost", Mechanical,
        sees "Speed 0 while driving; a car's motion does not end.",
        counts "A wheel turned without being measured.",
        tries ["motors = \"all\"", "motors = \"left\"", "motors = \"left-front\""]
        weaker ["encoder-stuck"]
        motors "Motors, or wheels of a car."
        {}
        /// Encoders repeat their last reading.
        EncoderStuck = "encoder-stuck", Mechanical,
        sees "A speed that does not change; a car's pulses come all at once at the end.",
        counts "A wheel turned at another speed than its encoder reported.",
        tries ["motors = \"all\"", "motors = \"left\"", "motors = \"left-front\""]
        motors "Motors, or wheels of a car."
        {}
        /// Motors are wired backwards; their encoders are not.
        WiredBackwards = "wired-backwards", Mechanical,
        sees "An R150's speed with the wrong sign; a car that turns away while its packets report the expected motion.",
        counts "Such a motor was driven.",
        tries ["motors = \"all\"", "motors = \"left\"", "motors = \"left-front\""]
        lasts [2000, 0]
        motors "Motors, or wheels of a car."
        {}
        /// Brakes do not release: the R150's parking brake, or the motor brakes of the car.
        BrakeStuckOn = "brake-stuck-on", Mechanical,
        sees "Little or no speed although driven.",
        counts "A braked wheel was driven.",
        tries ["", "motors = \"left\""]
        lasts [300, 2000, 0]
        weaker ["dragging"]
        motors "Motors, or wheels of a car; default all." or "defaults::all_motors"
        {}
        /// Brakes do not hold: the R150's parking brake, or the motor brakes of the car.
        BrakeStuckOpen = "brake-stuck-open", Mechanical,
        sees "A parked vehicle that rolls on a slope or when pushed.",
        counts "The brake should have held.",
        lasts [2000, 0]
        motors "Motors, or wheels of a car; default all." or "defaults::all_motors"
        {}
    }
}

impl Effect for MotorFault {
    fn begin(&self, _at: &mut Begin<'_>) -> Result<Work, EffectError> {
        Ok(Work::Hardware(Box::new(self.clone())))
    }
}

impl MotorFault {
    fn motors(&self) -> Motors {
        self.scope().motors.unwrap_or(Motors::All)
    }

    fn add_to(&self, motor: &mut MotorFaults, usual_drag: f64) {
        match self {
            Self::Blocked { .. } => motor.blocked = true,
            Self::Dragging { torque, .. } => {
                motor.drag_torque += torque.map_or(usual_drag, |torque| torque.0.abs());
            }
            Self::FreeWheeling { .. } => motor.free_wheeling = true,
            Self::EncoderLost { .. } => motor.encoder = EncoderState::Lost,
            Self::EncoderStuck { .. } => motor.encoder = EncoderState::Stuck,
            Self::WiredBackwards { .. } => motor.reversed = !motor.reversed,
            Self::BrakeStuckOn { .. } => motor.brake_stuck_on = true,
            Self::BrakeStuckOpen { .. } => motor.brake_stuck_open = true,
        }
    }

    fn acts_on(&self, motor: MotorState) -> bool {
        match self {
            Self::Blocked { .. }
            | Self::FreeWheeling { .. }
            | Self::WiredBackwards { .. }
            | Self::BrakeStuckOn { .. } => motor.driven,
            Self::Dragging { .. } => motor.driven || motor.turns,
            Self::EncoderLost { .. } => motor.turns,
            Self::EncoderStuck { .. } => motor.repeats_wrongly,
            Self::BrakeStuckOpen { .. } => motor.braked,
        }
    }
}

impl OnHardware for MotorFault {
    fn add(&self, sum: &mut Sum) {
        for (motor, is_meant) in sum.motors.iter_mut().zip(self.motors().wheels()) {
            if is_meant {
                self.add_to(motor, sum.usual_drag);
            }
        }
    }

    fn watch(&mut self, device: &dyn Device, tally: &mut Tally) {
        let meant = self.motors().wheels();
        let mut motors = device.motors().into_iter().zip(meant);
        let acts = motors.any(|(motor, is_meant)| is_meant && self.acts_on(motor));
        tally.hit_when(acts, || format!("motors {}", self.motors()));
    }
}
