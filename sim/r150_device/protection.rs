//! The module's protections: overcurrent, over-temperature, and too low a supply.
//!
//! They see measured currents, temperatures and voltages only, and act by withholding outputs.
//! Where the settings say so they report only, for as long as what they report lasts.

use std::time::Duration;

use rigsim_physics::r150::R150Measurements;
use rigsim_settings::SimTime;

use super::command::sys_status;
use super::event;
use super::group::Group;
use super::settings::{OvercurrentRecovery, ProtectionAction, ProtectionSettings};
use super::{R150Shell, earlier};

/// Multiple of its limit, as a current, above which any rail trips almost at once: a short pulls the
/// voltage down, so power does not show it. The manual promises the protection without figures.
const SHORT_MULTIPLE: f64 = 3.0;
/// Time for which a rail may stay above that multiple; likewise.
const SHORT_DELAY: Duration = Duration::from_millis(1);
/// Time for which the 5 V outputs may stay above their limit; the manual gives none.
const DELAY_5V: Duration = Duration::from_millis(100);
/// Voltages by which limits become currents, V (manual sections 3a and 3b).
const NOMINAL_12V: f64 = 12.0;
const NOMINAL_48V: f64 = 48.0;
/// A report of heat ends so far below its threshold, K.
const OVER_TEMPERATURE_HYSTERESIS: f64 = 10.0;
/// Time for which the supply may be too low: longer than a short takes to trip, which pulls the
/// supply down too.
const UNDERVOLTAGE_DELAY: Duration = Duration::from_millis(5);
/// That report ends so far above its threshold, V, so that the bit does not flutter.
const UNDERVOLTAGE_HYSTERESIS: f64 = 2.0;

/// A protection that has switched its group off.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Latch {
    /// State of the overcurrent bit.
    overcurrent: bool,
    since: SimTime,
}

#[derive(Debug, Clone, Copy, Default)]
struct GroupState {
    /// Since when the load has been above the threshold.
    over: Option<SimTime>,
    /// Since when the load has been above the short-circuit multiple.
    short: Option<SimTime>,
    latch: Option<Latch>,
    /// Overloaded for too long, and only reported.
    reported: bool,
    hot: bool,
}

impl GroupState {
    /// Switches it off for another reason than its current, unless it is off already.
    fn withhold(&mut self, now: SimTime) {
        self.latch.get_or_insert(Latch {
            overcurrent: false,
            since: now,
        });
    }
}

/// State of all protections.
#[derive(Debug, Clone)]
pub struct Protection {
    settings: ProtectionSettings,
    groups: [GroupState; 4],
    fault: bool,
    /// Since when the supply has been too low, and how low it is.
    low: Option<(SimTime, f64)>,
    /// The next time at which something happens by itself. It is asked far more often than anything
    /// changes.
    pub deadline: Option<SimTime>,
}

impl Protection {
    /// Everything allowed.
    #[must_use]
    pub fn new(settings: ProtectionSettings) -> Self {
        Self {
            settings,
            groups: [GroupState::default(); 4],
            fault: false,
            low: None,
            deadline: None,
        }
    }

    /// The outputs that may be on now, as bits of `powerStatus`.
    #[must_use]
    pub fn allowed(&self) -> u8 {
        self.iter()
            .filter(|(_, state)| state.latch.is_none() && !self.withholds(state.hot))
            .fold(0, |mask, (group, _)| mask | group.mask())
    }

    /// The bits of `sysStatus`.
    #[must_use]
    pub fn sys_status(&self) -> u32 {
        let fault = if self.fault {
            sys_status::POWER_MODULE_FAULT
        } else {
            0
        };
        self.iter().fold(fault, |mut bits, (group, state)| {
            if state.reported || state.latch.is_some_and(|latch| latch.overcurrent) {
                bits |= group.overcurrent_bit();
            }
            if state.hot {
                bits |= group.over_temperature_bit();
            }
            bits
        })
    }

    /// The client or the app asks for these outputs at `now`, as bits of `powerStatus`. That ends
    /// the latch of every group of which it asks for nothing; what it asks of a group that is
    /// withheld stays off until it is asked for again.
    pub fn requested(&mut self, now: SimTime, requested: u8, shell: &mut R150Shell) {
        for group in Group::ALL {
            let withheld = self.withholds(self.groups[group as usize].hot);
            let state = &mut self.groups[group as usize];
            if requested & group.mask() == 0 {
                if state.latch.take().is_some() {
                    let text = format!("{group} may be switched on again");
                    shell.emit(now, event::TRIP_CLEARED, text);
                }
            } else if withheld {
                state.withhold(now);
            }
        }
        self.find_deadline();
    }

    /// Takes what was measured at `now`; `requested` is what the outputs should be.
    pub fn sense(
        &mut self,
        now: SimTime,
        measured: &R150Measurements,
        requested: u8,
        shell: &mut R150Shell,
    ) {
        self.sense_supply(now, measured, requested, shell);
        for group in Group::ALL {
            let (over, short) = self.excess(group, measured);
            let limits = &self.settings;
            let state = &mut self.groups[group as usize];
            state.over = over.then(|| state.over.unwrap_or(now));
            state.short = short.then(|| state.short.unwrap_or(now));
            if state.reported && !over && !short {
                state.reported = false;
                let text = format!("{group} is within its limits again");
                shell.emit(now, event::TRIP_CLEARED, text);
            }
            let Some(celsius) = group.temperature_c(measured) else {
                continue;
            };
            if !state.hot && celsius > limits.over_temperature {
                state.hot = true;
                let action = limits.on_over_temperature;
                if action == ProtectionAction::SwitchOff && requested & group.mask() != 0 {
                    state.withhold(now);
                }
                let text = format!("{group}: over-temperature; its {}", outputs(action));
                shell.emit(now, event::OVER_TEMPERATURE, text);
            } else if state.hot && celsius < limits.over_temperature - OVER_TEMPERATURE_HYSTERESIS {
                state.hot = false;
                shell.emit(now, event::COOLED, format!("{group} has cooled down"));
            }
        }
        self.find_deadline();
    }

    /// Does what is due at `now`; `requested` is what the outputs should be.
    pub fn advance(&mut self, now: SimTime, requested: u8, shell: &mut R150Shell) {
        if let Some((_, supply_v)) = self.low
            && self.supply_deadline().is_some_and(|due| due <= now)
        {
            self.fail(now, supply_v, requested, shell);
        }
        for group in Group::ALL {
            let state = self.groups[group as usize];
            if self
                .group_deadline(group, &state)
                .is_none_or(|deadline| deadline > now)
            {
                continue;
            }
            let action = self.on_overcurrent(group);
            let state = &mut self.groups[group as usize];
            if state.latch.is_some() {
                state.latch = None;
                let text = format!("{group} may be switched on again");
                shell.emit(now, event::TRIP_CLEARED, text);
                continue;
            }
            match action {
                ProtectionAction::SwitchOff => {
                    state.latch = Some(Latch {
                        overcurrent: true,
                        since: now,
                    });
                    state.over = None;
                    state.short = None;
                }
                ProtectionAction::Report => state.reported = true,
            }
            let text = format!("{group}: overcurrent; its {}", outputs(action));
            shell.emit(now, event::OVERCURRENT, text);
        }
        self.find_deadline();
    }

    /// To be called after every change.
    fn find_deadline(&mut self) {
        let groups = self
            .iter()
            .map(|(group, state)| self.group_deadline(group, state));
        self.deadline = groups.fold(self.supply_deadline(), earlier);
    }

    fn iter(&self) -> impl Iterator<Item = (Group, &GroupState)> {
        Group::ALL.iter().copied().zip(&self.groups)
    }

    fn group_deadline(&self, group: Group, state: &GroupState) -> Option<SimTime> {
        let limits = &self.settings;
        if let Some(latch) = state.latch {
            return (limits.overcurrent_recovery == OvercurrentRecovery::Retry
                && !self.withholds(state.hot))
            .then(|| latch.since + limits.retry_period);
        }
        if state.reported {
            return None;
        }
        let delay = match group {
            Group::Ab | Group::Cd => limits.delay_12v,
            Group::V48 => limits.delay_48v,
            Group::V5 => DELAY_5V,
        };
        let over = state.over.map(|since| since + delay);
        let short = state.short.map(|since| since + SHORT_DELAY);
        earlier(over, short)
    }

    /// Returns whether the group is above its threshold, and above the short-circuit multiple.
    ///
    /// The short-circuit rule looks at current, because a short collapses the voltage and with it
    /// the power.
    fn excess(&self, group: Group, measured: &R150Measurements) -> (bool, bool) {
        let limits = &self.settings;
        let (power_w, current_a) = group
            .rails()
            .fold((0.0, 0.0), |(power_w, current_a), rail| {
                let current = measured.rail_current[rail];
                (
                    power_w + current * measured.rail_voltage[rail],
                    current_a + current,
                )
            });
        let short_a = SHORT_MULTIPLE
            * match group {
                Group::Ab | Group::Cd => limits.limit_12v / NOMINAL_12V,
                Group::V48 => limits.limit_48v / NOMINAL_48V,
                Group::V5 => limits.limit_5v,
            };
        let over = match group {
            Group::Ab | Group::Cd => power_w > limits.limit_12v * limits.threshold_12v / 100.0,
            Group::V48 => power_w > limits.limit_48v * limits.threshold_48v / 100.0,
            Group::V5 => current_a > limits.limit_5v,
        };
        (over, current_a > short_a)
    }

    fn sense_supply(
        &mut self,
        now: SimTime,
        measured: &R150Measurements,
        requested: u8,
        shell: &mut R150Shell,
    ) {
        let supply_v = measured.bus_voltage;
        let limits = &self.settings;
        let floor = if self.fault {
            limits.undervoltage + UNDERVOLTAGE_HYSTERESIS
        } else {
            limits.undervoltage
        };
        let low = supply_v < floor;
        if self.fault {
            if !low && !measured.power_module_fault {
                self.fault = false;
                let text = "power module fault ended";
                shell.emit(now, event::POWER_MODULE_RECOVERED, text);
            }
        } else if measured.power_module_fault {
            self.fail(now, supply_v, requested, shell);
        } else {
            let since = self.low.map_or(now, |(since, _)| since);
            self.low = low.then_some((since, supply_v));
        }
    }

    /// Returns whether a group stays off whatever is asked for, being as `hot` as it is.
    fn withholds(&self, hot: bool) -> bool {
        let switches_off = |action| action == ProtectionAction::SwitchOff;
        (hot && switches_off(self.settings.on_over_temperature))
            || (self.fault && switches_off(self.settings.on_power_module_fault))
    }

    /// Action on an overloaded group: the manual promises that 48 V and 5 V are protected.
    fn on_overcurrent(&self, group: Group) -> ProtectionAction {
        match group {
            Group::Ab | Group::Cd => self.settings.on_overcurrent_12v,
            Group::V48 | Group::V5 => ProtectionAction::SwitchOff,
        }
    }

    /// The module is faulty, or its supply is too low.
    fn fail(&mut self, now: SimTime, supply_v: f64, requested: u8, shell: &mut R150Shell) {
        self.fault = true;
        self.low = None;
        let action = self.settings.on_power_module_fault;
        if action == ProtectionAction::SwitchOff {
            for (group, state) in Group::ALL.iter().zip(&mut self.groups) {
                if requested & group.mask() != 0 {
                    state.withhold(now);
                }
            }
        }
        let outputs = match action {
            ProtectionAction::SwitchOff => "all outputs are off",
            ProtectionAction::Report => "the outputs stay as they are",
        };
        let text = format!("power module fault at {supply_v:.1} V supply; {outputs}");
        shell.emit(now, event::POWER_MODULE_FAULT, text);
    }

    fn supply_deadline(&self) -> Option<SimTime> {
        self.low.map(|(since, _)| since + UNDERVOLTAGE_DELAY)
    }
}

/// What becomes of the outputs of a group.
fn outputs(action: ProtectionAction) -> &'static str {
    match action {
        ProtectionAction::SwitchOff => "outputs are off",
        ProtectionAction::Report => "outputs stay as they are",
    }
}
