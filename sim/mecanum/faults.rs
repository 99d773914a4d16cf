//! Faults that only a mecanum car has, and what all faults together make of its hardware.

use rigsim_physics::mecanum::{ECHOES, MecanumFaults, Port, PortCommand, Ultrasonic, Wheel};
use rigsim_settings::Length;

use super::Mecanum;
use crate::device::parameters::Scope;
use crate::device::{
    Begin, Declared, Device, Effect, EffectError, MotorState, OnHardware, Sum, Tally, Work,
};
use crate::effect::defaults;
use crate::noise::Noise;
use crate::rounding::round;

/// Drag on a wheel unless given, N·m.
pub(super) const USUAL_DRAG: f64 = 0.5;
/// Slower than this a wheel stands, rad/s.
const STANDING: f64 = 0.01;

/// Checks that a car has such a target.
pub(super) fn check_scope(scope: &Scope) -> Result<(), String> {
    let link = scope.link.as_ref();
    match scope.command {
        Some(_) if link.is_some_and(|link| link.0 == "ros") => {
            Err("`command`: the lines of the ROS link have none".to_owned())
        }
        Some(command) if command != 0 => Err(format!(
            "`command`: the car sends packets of type 0 only, not {command}"
        )),
        _ => Ok(()),
    }
}

rigsim_settings::file_words! {
    /// Ultrasonic sensors, each row counted from the left.
    #[derive(Default)]
    pub enum Echoes {
        /// All eight.
        #[default]
        All = "all",
        /// All in front.
        Front = "front",
        /// All in the rear.
        Rear = "rear",
        /// Leftmost in front, `ut_f[0]`.
        Front1 = "front-1",
        /// `ut_f[1]`.
        Front2 = "front-2",
        /// `ut_f[2]`.
        Front3 = "front-3",
        /// Rightmost in front, `ut_f[3]`.
        Front4 = "front-4",
        /// Leftmost in the rear, `ut_b[0]`.
        Rear1 = "rear-1",
        /// `ut_b[1]`.
        Rear2 = "rear-2",
        /// `ut_b[2]`.
        Rear3 = "rear-3",
        /// Rightmost in the rear, `ut_b[3]`.
        Rear4 = "rear-4",
    }
}

impl Echoes {
    /// Their places among the eight.
    fn places(self) -> std::ops::Range<usize> {
        match self {
            Self::All => 0..ECHOES,
            Self::Front => 0..4,
            Self::Rear => 4..8,
            Self::Front1 => 0..1,
            Self::Front2 => 1..2,
            Self::Front3 => 2..3,
            Self::Front4 => 3..4,
            Self::Rear1 => 4..5,
            Self::Rear2 => 5..6,
            Self::Rear3 => 6..7,
            Self::Rear4 => 7..8,
        }
    }
}

crate::faults! {
    /// Supply, plugs and sensors of a car.
    pub enum MecanumFault {
        /// Board and motors have no supply.
        SupplyLost = "supply-lost", Electrical,
        sees "Silence, then a board that has forgotten motions and position.",
        counts "The board was powered.",
        lasts [300, 2000, 0]
        weaker ["reset"]
        {}
        /// Two motors are plugged into each other's ports.
        PortsSwapped = "ports-swapped", Mechanical,
        sees "A car that moves differently from its packets.",
        counts "One of the two ports was driven.",
        tries ["port = \"x\", with = \"y\"", "port = \"e0\", with = \"e1\""]
        lasts [2000, 0]
        {
            /// One port.
            port: Port,
            /// The other.
            with: Port,
        }
        /// Interference disturbs encoders.
        EncoderNoisy = "encoder-noisy", Mechanical,
        sees "Pulses without motion: the car reports more distance than it drove, even while standing.",
        counts "A reading was disturbed.",
        tries ["motors = \"all\", pulses_per_second = 200", "motors = \"all\"", "motors = \"left\""]
        motors "Motors, or wheels."
        {
            /// Additional pulses per second; default 20.
            #[serde(default = "defaults::pulses")]
            pulses_per_second: u16,
        }
        /// Ultrasonic sensors hear nothing.
        UltrasonicMissing = "ultrasonic-missing", Sensor,
        sees "4500 mm at any distance.",
        counts "An echo was not heard.",
        tries ["", "sensor = \"front\"", "sensor = \"rear\""]
        {
            /// Sensors; default all.
            #[serde(default)]
            sensor: Echoes,
        }
        /// Ultrasonic sensors repeat what they read at the start.
        UltrasonicStuck = "ultrasonic-stuck", Sensor,
        sees "A distance that does not change.",
        counts "The true distance differed.",
        tries ["", "sensor = \"front\"", "sensor = \"rear\""]
        {
            /// Sensors; default all.
            #[serde(default)]
            sensor: Echoes,
        }
        /// Ultrasonic sensors hear a false echo.
        UltrasonicGhost = "ultrasonic-ghost", Sensor,
        sees "An obstacle where there is none.",
        counts "The false echo was nearer than any real one.",
        tries ["", "sensor = \"front\"", "sensor = \"front-1\""]
        {
            /// Sensors; default all.
            #[serde(default)]
            sensor: Echoes,
            /// Distance of the echo; default 0.3 m.
            #[serde(default = "defaults::ghost")]
            distance: Length,
        }
        /// The reader misreads tags.
        TagMisread = "tag-misread", Sensor,
        sees "A wrong number in `rfid`, or none.",
        counts "A tag was misread.",
        tries ["", "reads_as = 1"]
        {
            /// Number that any tag is read as; default 0, which is not a tag.
            #[serde(default)]
            reads_as: u32,
        }
        /// The magnetic bar does not detect the strip.
        StripLost = "strip-lost", Sensor,
        sees "`magn` 0 over a strip.",
        counts "A strip was not detected.",
        {}
        /// The infrared sensor has a constant output.
        InfraredStuck = "infrared-stuck", Sensor,
        sees "`infra` that does not change.",
        counts "The true value differed.",
        tries ["", "sees = false"]
        {
            /// The constant output: true for an obstacle, false for none; default true.
            #[serde(default = "defaults::yes")]
            sees: bool,
        }
    }
}

impl Effect for MecanumFault {
    fn check(&self) -> Result<(), String> {
        match self {
            Self::PortsSwapped { port, with } if port == with => {
                Err(format!("`ports-swapped`: both ports are \"{port}\""))
            }
            _ => Ok(()),
        }
    }

    fn begin(&self, at: &mut Begin<'_>) -> Result<Work, EffectError> {
        let car = at.device.get::<Mecanum>();
        Ok(Work::Hardware(Box::new(AtWork {
            kind: self.clone(),
            noise: (at.stream)("device"),
            echoes: car.map_or([None; ECHOES], |car| car.plant.unspoilt().echoes),
            pulses: [0.0; 4],
        })))
    }
}

/// A fault at work.
struct AtWork {
    kind: MecanumFault,
    noise: Noise,
    /// What the ultrasonic sensors read when it began.
    echoes: [Option<f64>; ECHOES],
    /// Shares of the next pulses of interference, by wheel.
    pulses: [f64; 4],
}

impl AtWork {
    fn add_to(&self, whole: &mut MecanumFaults) {
        let mut spoil = |sensor: Echoes, how: &dyn Fn(usize) -> Ultrasonic| {
            for index in sensor.places() {
                whole.ultrasonic[index] = how(index);
            }
        };
        match &self.kind {
            MecanumFault::SupplyLost {} => whole.unsupplied = true,
            MecanumFault::PortsSwapped { port, with } => {
                whole.swaps = whole.swaps.and(*port, *with)
            }
            // It adds pulses as it acts.
            MecanumFault::EncoderNoisy { .. } => {}
            MecanumFault::UltrasonicMissing { sensor } => spoil(*sensor, &|_| Ultrasonic::Missing),
            MecanumFault::UltrasonicStuck { sensor } => {
                spoil(*sensor, &|index| Ultrasonic::Stuck(self.echoes[index]));
            }
            MecanumFault::UltrasonicGhost { sensor, distance } => {
                spoil(*sensor, &|_| Ultrasonic::Ghost(distance.0));
            }
            MecanumFault::TagMisread { reads_as } => whole.tag_reads_as = Some(*reads_as),
            MecanumFault::StripLost {} => whole.strip_lost = true,
            MecanumFault::InfraredStuck { sees } => whole.infrared_stuck = Some(*sees),
        }
    }

    /// Returns whether the sensors would read something else without it.
    fn spoils(&self, car: &Mecanum) -> bool {
        let unspoilt = car.plant.unspoilt();
        let mut alone = MecanumFaults::default();
        self.add_to(&mut alone);
        let mut spoilt = unspoilt;
        alone.spoil(&mut spoilt);
        spoilt != unspoilt
    }
}

impl OnHardware for AtWork {
    fn add(&self, sum: &mut Sum) {
        if let Some(whole) = sum.own_mut() {
            self.add_to(whole);
        }
    }

    fn watch(&mut self, device: &dyn Device, tally: &mut Tally) {
        let Some(car) = device.get::<Mecanum>() else {
            return;
        };
        let commands = car.plant.commands();
        let acts = match &self.kind {
            MecanumFault::SupplyLost {} => true,
            MecanumFault::PortsSwapped { port, with } => [port, with]
                .into_iter()
                .any(|port| runs(commands.ports[port.index()], commands.speed_voltage)),
            MecanumFault::EncoderNoisy { .. } => return,
            _ => self.spoils(car),
        };
        tally.hit_when(acts, || match &self.kind {
            MecanumFault::PortsSwapped { port, with } => format!("ports {port} and {with}"),
            MecanumFault::UltrasonicMissing { sensor }
            | MecanumFault::UltrasonicStuck { sensor }
            | MecanumFault::UltrasonicGhost { sensor, .. } => format!("ultrasonic {sensor}"),
            other => other.info().counts.trim_end_matches('.').to_owned(),
        });
    }

    fn interfere(&mut self, device: &mut dyn Device, seconds: f64, tally: &mut Tally) -> bool {
        let (
            MecanumFault::EncoderNoisy {
                motors,
                pulses_per_second,
            },
            Some(car),
        ) = (&self.kind, device.get_mut::<Mecanum>())
        else {
            return false;
        };
        for (wheel, is_meant) in Wheel::ALL.into_iter().zip(motors.wheels()) {
            let mean = f64::from(*pulses_per_second) * seconds;
            let share = &mut self.pulses[wheel.index()];
            *share += mean * 2.0 * self.noise.uniform();
            let whole = share.floor();
            *share -= whole;
            if is_meant && whole >= 1.0 {
                car.plant.add_pulses(wheel, round(whole));
                tally.hit(|| format!("wheel {wheel}"));
            }
        }
        false
    }
}

fn runs(pins: PortCommand, speed_voltage: f64) -> bool {
    !pins.brake && speed_voltage > 0.0
}

impl Mecanum {
    /// Puts all faults in the place of those before, and touches nothing else.
    pub(super) fn set_layer(&mut self, sum: &Sum) {
        let Some(whole) = sum.own::<MecanumFaults>() else {
            return;
        };
        for wheel in Wheel::ALL {
            self.plant
                .set_wheel_faults(wheel, sum.motors[wheel.index()]);
        }
        self.plant.set_faults(whole);
    }

    pub(super) fn motor_states(&self) -> [MotorState; 4] {
        let plant = &self.plant;
        let commands = plant.commands();
        let speeds = plant.truth().wheel_speed;
        Wheel::ALL.map(|wheel| {
            let pins = plant.pins(wheel);
            let turns = speeds[wheel.index()].abs() > STANDING;
            MotorState {
                driven: runs(pins, commands.speed_voltage),
                turns,
                repeats_wrongly: turns,
                braked: pins.brake,
            }
        })
    }
}
