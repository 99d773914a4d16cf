//! Control of power and PWM: by the client over RS232, or by the app (manual sections 4.3.5,
//! 4.3.6).

use rigsim_physics::r150::Rail;
use rigsim_settings::SimTime;
use schemars::JsonSchema;
use serde::Deserialize;

use super::command::{Request, rails};
use super::settings::{
    ControlMode, ControlTakenBy, OnHeartbeatLoss, OnTakeover, R150FirmwareSettings,
};

/// Set-points of the outputs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
#[schemars(rename = "AppSetsText")]
pub struct Outputs {
    /// Rails to be on.
    #[serde(rename = "on", deserialize_with = "rails")]
    #[schemars(with = "Vec<Rail>", extend("default" = []))]
    pub power: u8,
    /// Duty of the PWM outputs, 0.1 %.
    pub pwm: [u16; 4],
}

/// Bits of the rails that exist.
pub const POWER_BITS: u8 = 0b11_1111;
/// Largest duty of a PWM output.
pub const FULL_DUTY: u16 = 1000;

impl Outputs {
    fn within_limits(self) -> Self {
        Self {
            power: self.power & POWER_BITS,
            pwm: self.pwm.map(|duty| duty.min(FULL_DUTY)),
        }
    }

    /// Takes these parts over from others.
    fn take(&mut self, parts: Parts, from: Self) {
        if parts.power {
            self.power = from.power;
        }
        if parts.pwm {
            self.pwm = from.pwm;
        }
    }
}

/// Power, PWM, both or neither.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
#[schemars(rename = "AppHoldsText")]
pub struct Parts {
    /// Of the power rails.
    pub power: bool,
    /// Of the PWM outputs.
    pub pwm: bool,
}

impl Parts {
    pub(super) const BOTH: Self = Self {
        power: true,
        pwm: true,
    };

    /// Returns whether it is at least one of them.
    #[must_use]
    pub fn any(self) -> bool {
        self.power || self.pwm
    }

    fn without(self, other: Self) -> Self {
        Self {
            power: self.power && !other.power,
            pwm: self.pwm && !other.pwm,
        }
    }
}

/// Division of control, and the set-points in effect.
///
/// Unless the settings say otherwise, a client that takes control leaves the outputs as they are:
/// one that comes back after a lost heartbeat finds what the app has set, not what it set itself.
#[derive(Debug, Clone)]
pub struct Control {
    /// Parts that follow the client.
    pub by_client: Parts,
    /// Parts that the app keeps whatever the client sends.
    pub held_by_app: Parts,
    /// Set-points of the app, in effect where it has control.
    pub app: Outputs,
    /// Set-points in effect.
    pub outputs: Outputs,
    /// Set-points that were in effect when the client lost control.
    lost: Outputs,
    heartbeat_due: Option<SimTime>,
}

impl Control {
    /// The state at power-on.
    #[must_use]
    pub(super) fn new(settings: &R150FirmwareSettings) -> Self {
        // Assumed: an app that has switched nothing on yet.
        Self::powered_on(settings, Outputs::default())
    }

    /// Back to the state at power-on. What the app wants and whether it insists is the app's to
    /// remember, not the module's.
    pub(super) fn restart(&mut self, settings: &R150FirmwareSettings) {
        let held = self.held_by_app;
        *self = Self::powered_on(settings, self.app);
        self.app_holds(held);
        self.lost = Outputs::default();
    }

    fn powered_on(settings: &R150FirmwareSettings, app: Outputs) -> Self {
        let mut control = Self {
            by_client: match settings.control_at_power_on {
                ControlMode::App => Parts::default(),
                ControlMode::Rs232 => Parts::BOTH,
            },
            held_by_app: Parts::default(),
            app,
            outputs: Outputs::default(),
            lost: Outputs::default(),
            heartbeat_due: None,
        };
        control.apply_app_outputs();
        control
    }

    /// The client, which controls power, sets the rails.
    pub(super) fn set_power(&mut self, power: u8) {
        self.outputs.power = power & POWER_BITS;
    }

    /// The client, which controls PWM, sets the duties.
    pub(super) fn set_pwm(&mut self, pwm: [u16; 4]) {
        self.outputs.pwm = pwm;
    }

    /// A request came, which is a heartbeat. Says what the client took by it.
    pub(super) fn request(
        &mut self,
        now: SimTime,
        request: Request,
        settings: &R150FirmwareSettings,
    ) -> Parts {
        self.heartbeat(now, settings);
        let wanted = match settings.control_taken_by {
            ControlTakenBy::AnyRequest => Parts::BOTH,
            ControlTakenBy::OwnCommand => Parts {
                power: matches!(request, Request::PowerControl { .. }),
                pwm: matches!(request, Request::SetPwmOutputs { .. }),
            },
        };
        let taken = wanted.without(self.by_client).without(self.held_by_app);
        self.by_client.power |= taken.power;
        self.by_client.pwm |= taken.pwm;
        if settings.on_takeover == OnTakeover::Restore {
            self.outputs.take(taken, self.lost);
        }
        taken
    }

    /// A heartbeat came that is not a request.
    pub(super) fn heartbeat(&mut self, now: SimTime, settings: &R150FirmwareSettings) {
        self.heartbeat_due = Some(now + settings.heartbeat_timeout);
    }

    /// Time at which the heartbeat is lost unless another comes.
    #[must_use]
    pub(super) fn deadline(&self) -> Option<SimTime> {
        self.heartbeat_due
    }

    /// Takes control from the client if the heartbeat is due at `now`. Returns whether it had any.
    pub(super) fn expire(&mut self, now: SimTime, settings: &R150FirmwareSettings) -> bool {
        if self.heartbeat_due.take_if(|due| *due <= now).is_none() {
            return false;
        }
        self.lost.take(self.by_client, self.outputs);
        let had = std::mem::take(&mut self.by_client);
        match settings.on_heartbeat_loss {
            OnHeartbeatLoss::Hold => {}
            OnHeartbeatLoss::App => self.apply_app_outputs(),
            OnHeartbeatLoss::Off => self.outputs.take(had, Outputs::default()),
        }
        had.any()
    }

    /// The app takes (`true`) or leaves (`false`) control of power and of PWM.
    pub(super) fn app_holds(&mut self, held: Parts) {
        self.lost.take(self.by_client, self.outputs);
        self.held_by_app = held;
        self.by_client = self.by_client.without(held);
        if held.any() {
            self.apply_app_outputs();
        }
    }

    /// The app sets what it wants; in effect where it has control.
    pub(super) fn app_sets(&mut self, outputs: Outputs) {
        self.app = outputs.within_limits();
        self.apply_app_outputs();
    }

    fn apply_app_outputs(&mut self) {
        self.outputs
            .take(Parts::BOTH.without(self.by_client), self.app);
    }
}
