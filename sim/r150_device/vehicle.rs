//! The vehicle around the module: lock, parking brake, drive mode, emergency stop, and the remote
//! control that works them (manual section 2).

use std::fmt;

use super::control::{Outputs, Parts};
use super::settings::R150FirmwareSettings;

rigsim_settings::file_words! {
    /// A motion key of the remote control.
    pub enum Key {
        /// Forward, 向前.
        Forward = "forward",
        /// Backward, 向后.
        Backward = "backward",
        /// Turn left on the spot, 左转.
        Left = "left",
        /// Turn right on the spot, 右转.
        Right = "right",
    }
}

crate::actions! {
    /// What an operator or the app does.
    #[derive(Copy, PartialEq)]
    pub enum OperatorInput: Operator {
        /// R150: long press of both rear buttons.
        Unlock = "unlock";
        /// R150: short press of the rear buttons.
        Lock = "lock";
        /// R150: the parking brake is applied.
        Park = "park";
        /// R150: long press of the top button.
        ReleaseParking = "release_parking";
        /// R150: long press of the middle button.
        Autonomous = "autonomous";
        /// R150: a motion key of the remote control goes down; the vehicle is in remote mode.
        Press(Key) = "press" tries ["\"forward\"", "\"left\""];
        /// The motion key goes up.
        ReleaseKey = "release";
        /// R150: the remote control takes over, without a key held down: the vehicle rolls freely.
        TakeOver = "take_over" weaker ["park"];
        /// R150: the emergency stop goes in (true) or out.
        EmergencyStop(bool) = "emergency_stop" tries ["true"] weaker ["lock", "park"];
        /// R150: the app takes or leaves control.
        AppHolds(Parts) = "app_holds" tries ["{ power = true }", "{ pwm = true }"];
        /// R150: set-points of the app for the outputs.
        AppSets(Outputs) = "app_sets" tries ["{}"];
    }
}

impl fmt::Display for OperatorInput {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Unlock => f.write_str("unlock"),
            Self::Lock => f.write_str("lock"),
            Self::ReleaseParking => f.write_str("release the parking brake"),
            Self::Park => f.write_str("put the parking brake on"),
            Self::Autonomous => f.write_str("autonomous mode"),
            Self::Press(key) => write!(f, "{key} key down"),
            Self::ReleaseKey => f.write_str("motion key up"),
            Self::EmergencyStop(true) => f.write_str("emergency stop pushed in"),
            Self::EmergencyStop(false) => f.write_str("emergency stop pulled out"),
            Self::TakeOver => f.write_str("take over"),
            Self::AppHolds(Parts { power, pwm }) => write!(f, "app holds power {power}, PWM {pwm}"),
            Self::AppSets(outputs) => {
                write!(
                    f,
                    "app sets power 0x{:02X}, PWM {:?}",
                    outputs.power, outputs.pwm
                )
            }
        }
    }
}

rigsim_settings::words! {
    /// Reason for which a motor command does not move the vehicle, as a client developer would put it.
    pub enum Obstacle {
        /// The remote control has locked it.
        Locked = "it is locked",
        /// The parking brake is on.
        Parked = "the parking brake is on",
        /// It is in remote mode.
        Remote = "it is in remote mode, not autonomous",
        /// The emergency stop is in.
        EmergencyStop = "the emergency stop is in",
        /// The battery is empty.
        BatteryEmpty = "the battery is empty",
    }
}

/// In which state the vehicle is when the simulation begins.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Start {
    /// Unlocked, released, autonomous: the first motor command moves it.
    Ready,
    /// Locked, parked, remote: as the hardware starts.
    Locked,
}

/// PWM of both motors while a key of the remote control drives, in opposite directions while a turn
/// key does. The manual does not say how fast the remote control drives.
const REMOTE_PWM: i16 = 500;

/// State of the vehicle.
#[derive(Debug, Clone)]
pub struct Vehicle {
    /// The remote control has locked it.
    pub locked: bool,
    /// The parking brake is on.
    pub parked: bool,
    /// It is in autonomous mode.
    pub autonomous: bool,
    /// The emergency stop is in.
    pub emergency_stop: bool,
    key: Option<Key>,
    settings: R150FirmwareSettings,
}

impl Vehicle {
    /// A vehicle as `start` says.
    #[must_use]
    pub fn new(start: Start, settings: &R150FirmwareSettings) -> Self {
        let ready = start == Start::Ready;
        Self {
            locked: !ready,
            parked: !ready,
            autonomous: ready,
            emergency_stop: false,
            key: None,
            settings: settings.clone(),
        }
    }

    /// Works a button; the app's actions are not the vehicle's and change nothing here.
    pub fn operate(&mut self, action: OperatorInput) {
        match action {
            OperatorInput::Unlock => self.locked = false,
            OperatorInput::Lock => self.lock(),
            OperatorInput::ReleaseParking => self.parked &= !self.top_button_works(),
            OperatorInput::Park => self.parked = true,
            OperatorInput::Autonomous => {
                self.autonomous = true;
                self.key = None;
            }
            OperatorInput::Press(key) => {
                self.autonomous = false;
                self.key = Some(key);
            }
            OperatorInput::ReleaseKey => self.key = None,
            OperatorInput::EmergencyStop(pushed_in) => {
                self.emergency_stop = pushed_in;
                if pushed_in && self.settings.emergency_stop_locks {
                    self.lock();
                }
            }
            OperatorInput::TakeOver => {
                self.autonomous = false;
                self.key = None;
            }
            OperatorInput::AppHolds(_) | OperatorInput::AppSets(_) => {}
        }
    }

    fn lock(&mut self) {
        self.locked = true;
        self.parked |= self.settings.locking_parks;
        self.key = None;
    }

    /// The top button releases the brake in manual mode after unlocking.
    fn top_button_works(&self) -> bool {
        !self.locked && !self.autonomous
    }

    /// The input that makes the motion key what it is.
    #[must_use]
    pub fn key_input(&self) -> OperatorInput {
        self.key
            .map_or(OperatorInput::ReleaseKey, OperatorInput::Press)
    }

    /// Returns whether the parking brake holds while the client wants this of the motors.
    #[must_use]
    pub fn holds(&self, set_point: [i16; 2]) -> bool {
        let drives = !self.locked && !self.brake_hinders() && set_point != [0, 0];
        self.parked && !drives
    }

    /// Returns whether the parking brake keeps commands from driving.
    fn brake_hinders(&self) -> bool {
        let gives_way = self.autonomous && !self.settings.driving_needs_release;
        self.parked && !gives_way
    }

    /// Lists what keeps a motor command from moving it; empty when nothing does.
    #[must_use]
    pub fn obstacles(&self, battery_empty: bool) -> Vec<Obstacle> {
        [
            (self.locked, Obstacle::Locked),
            (self.brake_hinders(), Obstacle::Parked),
            (!self.autonomous, Obstacle::Remote),
            (self.emergency_stop, Obstacle::EmergencyStop),
            (battery_empty, Obstacle::BatteryEmpty),
        ]
        .into_iter()
        .filter_map(|(holds, obstacle)| holds.then_some(obstacle))
        .collect()
    }

    /// Returns the PWM that the motor bridges apply, right then left, ±1000, given what the client
    /// wants; 0 shorts the motor, which brakes. `None` if they are open: the vehicle can be pushed.
    #[must_use]
    pub fn drive(&self, set_point: [i16; 2], battery_empty: bool) -> Option<[i16; 2]> {
        if self.emergency_stop {
            return None;
        }
        if self.locked || self.brake_hinders() || battery_empty {
            return Some([0, 0]);
        }
        if self.autonomous {
            return Some(set_point);
        }
        self.key.map(|key| match key {
            Key::Forward => [REMOTE_PWM; 2],
            Key::Backward => [-REMOTE_PWM; 2],
            Key::Left => [REMOTE_PWM, -REMOTE_PWM],
            Key::Right => [-REMOTE_PWM, REMOTE_PWM],
        })
    }
}
