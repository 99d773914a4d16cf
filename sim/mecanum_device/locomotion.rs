//! The driving half of the firmware: who drives, what the wheels do, and what their pulses say.

use rigsim_physics::mecanum::{
    MecanumCommands, MecanumMeasurements, PORTS, PortCommand, WHEELS, Wheel,
};
use rigsim_settings::SimTime;

use super::encoder::{Encoder, Stopping};
use super::kinematics::{Movement, body_speed};
use super::motion::{Change, Motions};
use super::odometry::Odometry;
use super::settings::{IdleWheels, MecanumFirmwareSettings, StartMode};

/// Motions, remote control, encoders and dead reckoning.
#[derive(Debug, Clone)]
pub(super) struct Locomotion {
    settings: MecanumFirmwareSettings,
    pub motions: Motions,
    /// The remote control drives; the board otherwise.
    pub remote: bool,
    /// The key that the operator holds.
    pub key: Option<Movement>,
    /// By wheel, not by port.
    encoders: [Encoder; WHEELS],
    pub odometry: Odometry,
    /// The movement in effect or last in effect; late pulses belong to it.
    last: Option<Movement>,
    /// Number of motions that had begun when the last one that was noticed did.
    started: u64,
}

impl Locomotion {
    /// Standing at the origin, with the board in control.
    pub fn new(settings: &MecanumFirmwareSettings, measured: &MecanumMeasurements) -> Self {
        Self {
            settings: settings.clone(),
            motions: Motions::new(settings.clone()),
            remote: settings.start_mode == StartMode::Remote,
            key: None,
            encoders: Wheel::ALL.map(|wheel| {
                let stopping = Stopping {
                    reversed: settings.reversing_time,
                    held: settings.braking_time,
                };
                Encoder::new(stopping, measured.pulses[wheel.port().index()])
            }),
            odometry: Odometry::new(settings.odometry.clone()),
            last: None,
            started: 0,
        }
    }

    /// Says who drives; motions go on when it is the board.
    pub fn set_remote(&mut self, now: SimTime, remote: bool, changed: &mut impl FnMut(Change)) {
        self.remote = remote;
        self.start_due(now, changed);
    }

    pub fn set_key(&mut self, now: SimTime, key: Option<Movement>) {
        self.key = key;
        if self.remote && key.is_some() {
            self.odometry.begin_motion();
        }
        self.update_encoders(now);
    }

    /// Starts what may start.
    pub fn start_due(&mut self, now: SimTime, changed: &mut impl FnMut(Change)) {
        if !self.remote {
            self.motions.start(now, changed);
        }
        self.update_encoders(now);
    }

    /// Time at which a motion begins by itself.
    pub fn due(&self) -> Option<SimTime> {
        self.motions.due().filter(|_| !self.remote)
    }

    /// Wheels that the present driver has still to turn.
    pub fn driven(&self) -> [bool; WHEELS] {
        if self.remote {
            self.rotations().map(|rotation| rotation != 0)
        } else {
            self.motions.driven()
        }
    }

    /// Discards all motions; says how many there were.
    pub fn discard(&mut self, now: SimTime) -> usize {
        let count = self.motions.discard();
        self.update_encoders(now);
        count
    }

    /// Reads the PG wires.
    pub fn sense(&mut self, now: SimTime, pulses: &[u32; PORTS], changed: &mut impl FnMut(Change)) {
        let mut came = [0; WHEELS];
        for wheel in Wheel::ALL {
            let at = wheel.index();
            let count = pulses[wheel.port().index()];
            came[at] = self.encoders[at].read(now, count);
        }
        if came == [0; WHEELS] {
            return;
        }
        self.odometry.add(came, self.last);
        if !self.remote {
            let progress = std::array::from_fn(|at| self.encoders[at].progress(came[at]));
            self.motions.turned(now, progress, changed);
        }
        self.update_encoders(now);
    }

    /// Direction in which each wheel is driven: 1 forward, −1 backward, 0 not at all.
    pub fn rotations(&self) -> [i8; WHEELS] {
        if !self.remote {
            return self.motions.rotations();
        }
        match self.key.filter(|_| self.settings.remote_speed > 0.0) {
            Some(movement) => movement.rotations(),
            None => [0; WHEELS],
        }
    }

    /// The pins. A wheel that is not driven while others are is always held: SV is shared.
    pub fn commands(&self) -> MecanumCommands {
        let rotations = self.rotations();
        let idle = rotations == [0; WHEELS];
        let held = !idle || self.settings.idle_wheels == IdleWheels::Hold;
        // A port without a wheel holds what may be plugged in there.
        let mut commands = MecanumCommands::default();
        for wheel in Wheel::ALL {
            let at = wheel.index();
            let stands = rotations[at] == 0;
            commands.ports[wheel.port().index()] = PortCommand {
                reverse: self.encoders[at].is_backward(),
                brake: stands && held,
            };
        }
        if !idle {
            commands.speed_voltage = self.speed_share();
        }
        commands
    }

    /// Speed of the body by pulses, ahead and left, r/min of a wheel.
    pub fn velocity_rpm(&self, now: SimTime) -> [f64; 2] {
        let [ahead, left, _] = body_speed(self.wheels_rpm(now), 1.0);
        [ahead, left]
    }

    /// Mean speed by pulses of the wheels that the movement in effect turns, r/min; negative while
    /// it goes its negative way.
    pub fn speed_rpm(&self, now: SimTime) -> f64 {
        let Some(movement) = self.last else {
            return 0.0;
        };
        let rotations = movement.rotations().map(f64::from);
        let along = self.wheels_rpm(now).into_iter().zip(rotations);
        let sum: f64 = along.map(|(rpm, rotation)| rpm * rotation).sum();
        let wheels: f64 = rotations.iter().map(|rotation| rotation.abs()).sum();
        sum / wheels * f64::from(movement.sign())
    }

    /// Wheels that turn, by their pulses.
    pub fn turning(&self, now: SimTime) -> [bool; WHEELS] {
        self.wheels_rpm(now).map(|rpm| rpm != 0.0)
    }

    fn wheels_rpm(&self, now: SimTime) -> [f64; WHEELS] {
        let rotations = self.rotations();
        let per_revolution = f64::from(self.settings.odometry.pulses_per_revolution);
        std::array::from_fn(|at| {
            let rate = self.encoders[at].pulse_rate(now, rotations[at] != 0);
            rate * 60.0 / per_revolution
        })
    }

    /// Wheel speed of the present driver, as a share of the full one.
    fn speed_share(&self) -> f64 {
        let rpm = if self.remote {
            self.settings.remote_speed
        } else {
            self.motions
                .running()
                .map_or(0.0, |motion| motion.speed_rpm)
        };
        (rpm / self.settings.full_speed).clamp(0.0, 1.0)
    }

    /// Makes the encoders count the way in which the wheels are driven now.
    fn update_encoders(&mut self, now: SimTime) {
        let running = self.motions.running().map(|motion| motion.movement);
        let movement = if self.remote { self.key } else { running };
        self.last = movement.or(self.last);
        if self.motions.started != self.started {
            self.started = self.motions.started;
            self.odometry.begin_motion();
        }
        let rotations = self.rotations();
        let share = self.speed_share();
        for (encoder, rotation) in self.encoders.iter_mut().zip(rotations) {
            encoder.drive(now, f64::from(rotation) * share);
        }
    }
}
