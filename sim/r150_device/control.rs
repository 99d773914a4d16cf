//! Who controls power and PWM: the client over RS232, or the app (manual sections 4.3.5, 4.3.6).

use sim_settings::SimTime;

use super::settings::{OnHeartbeatLoss, OnTakeover, R150FirmwareSettings};

/// Set-points of the outputs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Outputs {
    /// Rails that should be on, as bits of `powerStatus`.
    pub power: u8,
    /// Duty of PWM outputs A–D, 0.1 %.
    pub pwm: [u16; 4],
}

/// Bits of the rails that exist.
pub const POWER_BITS: u8 = 0b11_1111;

/// Who controls what, and the set-points in effect.
///
/// Unless the settings say otherwise, a client that takes control leaves the outputs as they are:
/// one that comes back after a lost heartbeat finds what the app has set, not what it set itself.
#[derive(Debug, Clone)]
pub struct Control {
    /// Power follows the client.
    pub power_by_client: bool,
    /// PWM follows the client.
    pub pwm_by_client: bool,
    /// The app keeps power whatever the client sends.
    pub app_holds_power: bool,
    /// The app keeps PWM whatever the client sends.
    pub app_holds_pwm: bool,
    /// What the app has set.
    pub app: Outputs,
    /// What is in effect.
    pub outputs: Outputs,
    /// What was in effect when the client lost control.
    lost: Outputs,
    heartbeat_due: Option<SimTime>,
}

impl Control {
    /// At power-on the app is in control and everything is off.
    #[must_use]
    pub fn new() -> Self {
        Self {
            power_by_client: false,
            pwm_by_client: false,
            app_holds_power: false,
            app_holds_pwm: false,
            app: Outputs::default(),
            outputs: Outputs::default(),
            lost: Outputs::default(),
            heartbeat_due: None,
        }
    }

    /// Back to the state at power-on. What the app wants is the app's to remember, not the module's.
    pub fn restart(&mut self) {
        *self = Self {
            app: self.app,
            ..Self::new()
        };
        self.follow_app();
    }

    /// A valid frame came. Says whether the client took anything by it.
    pub fn frame(&mut self, now: SimTime, settings: &R150FirmwareSettings) -> bool {
        self.heartbeat_due = Some(now + settings.heartbeat_timeout);
        let restore = settings.on_takeover == OnTakeover::Restore;
        let takes_power = !self.power_by_client && !self.app_holds_power;
        let takes_pwm = !self.pwm_by_client && !self.app_holds_pwm;
        if takes_power {
            self.power_by_client = true;
            self.outputs.power = if restore {
                self.lost.power
            } else {
                self.outputs.power
            };
        }
        if takes_pwm {
            self.pwm_by_client = true;
            self.outputs.pwm = if restore {
                self.lost.pwm
            } else {
                self.outputs.pwm
            };
        }
        takes_power || takes_pwm
    }

    /// When the heartbeat is lost unless a valid frame comes.
    #[must_use]
    pub fn deadline(&self) -> Option<SimTime> {
        self.heartbeat_due
    }

    /// Gives control back if the heartbeat is due at `now`; says whether it did.
    pub fn expire(&mut self, now: SimTime, settings: &R150FirmwareSettings) -> bool {
        if self.heartbeat_due.is_none_or(|due| due > now) {
            return false;
        }
        self.heartbeat_due = None;
        let had = (self.power_by_client, self.pwm_by_client);
        self.note_lost();
        self.power_by_client = false;
        self.pwm_by_client = false;
        match settings.on_heartbeat_loss {
            OnHeartbeatLoss::Hold => {}
            OnHeartbeatLoss::App => self.follow_app(),
            OnHeartbeatLoss::Off => self.outputs = Outputs::default(),
        }
        had != (false, false)
    }

    /// The app takes (`true`) or leaves (`false`) control of power and of PWM.
    pub fn app_holds(&mut self, power: bool, pwm: bool) {
        self.note_lost();
        self.app_holds_power = power;
        self.app_holds_pwm = pwm;
        self.power_by_client &= !power;
        self.pwm_by_client &= !pwm;
        if power || pwm {
            self.follow_app();
        }
    }

    /// The app sets what it wants; in effect where it has control.
    pub fn app_sets(&mut self, outputs: Outputs) {
        self.app = Outputs {
            power: outputs.power & POWER_BITS,
            pwm: outputs.pwm.map(|d| d.min(1000)),
        };
        self.follow_app();
    }

    fn note_lost(&mut self) {
        if self.power_by_client {
            self.lost.power = self.outputs.power;
        }
        if self.pwm_by_client {
            self.lost.pwm = self.outputs.pwm;
        }
    }

    fn follow_app(&mut self) {
        if !self.power_by_client {
            self.outputs.power = self.app.power;
        }
        if !self.pwm_by_client {
            self.outputs.pwm = self.app.pwm;
        }
    }
}

impl Default for Control {
    fn default() -> Self {
        Self::new()
    }
}
