//! The module's protections: overcurrent, over-temperature, and too low a supply.
//!
//! They see measured currents, temperatures and voltages only, and act by withholding outputs.

use std::fmt;

use sim_physics::r150::R150Measurements;
use sim_settings::SimTime;

use super::event::R150Event;
use super::reply::sys_status;
use super::settings::{OvercurrentRecovery, ProtectionSettings};

/// Outputs that are protected together.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Group {
    /// 12 V outputs A and B.
    Ab,
    /// 12 V outputs C and D.
    Cd,
    /// The 48 V output.
    V48,
    /// The 5 V outputs.
    V5,
}

impl Group {
    const ALL: [Self; 4] = [Self::Ab, Self::Cd, Self::V48, Self::V5];

    /// Its bits in `powerStatus`.
    #[must_use]
    pub fn mask(self) -> u8 {
        match self {
            Self::Ab => 0b00_0011,
            Self::Cd => 0b00_1100,
            Self::V48 => 0b01_0000,
            Self::V5 => 0b10_0000,
        }
    }

    fn overcurrent_bit(self) -> u32 {
        match self {
            Self::Ab => sys_status::OVERCURRENT_AB,
            Self::Cd => sys_status::OVERCURRENT_CD,
            Self::V48 => sys_status::OVERCURRENT_48V,
            Self::V5 => sys_status::OVERCURRENT_5V,
        }
    }

    fn over_temperature_bit(self) -> u32 {
        match self {
            Self::Ab => sys_status::OVER_TEMPERATURE_AB,
            Self::Cd => sys_status::OVER_TEMPERATURE_CD,
            Self::V48 | Self::V5 => 0,
        }
    }

    /// Its temperature sensor, if it has one.
    fn temperature_c(self, measured: &R150Measurements) -> Option<f64> {
        match self {
            Self::Ab => Some(measured.temperature[0]),
            Self::Cd => Some(measured.temperature[1]),
            Self::V48 | Self::V5 => None,
        }
    }
}

impl fmt::Display for Group {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Ab => "12 V A+B",
            Self::Cd => "12 V C+D",
            Self::V48 => "48 V",
            Self::V5 => "5 V",
        })
    }
}

/// Why a group was switched off.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Cause {
    /// Too much current or power for too long.
    Overcurrent,
    /// Too hot.
    OverTemperature,
}

impl fmt::Display for Cause {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Overcurrent => "overcurrent",
            Self::OverTemperature => "over-temperature",
        })
    }
}

/// A protection that has switched its group off.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Latch {
    /// Whether the overcurrent bit is set.
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
    hot: bool,
}

/// State of all protections.
#[derive(Debug, Clone)]
pub struct Protection {
    settings: ProtectionSettings,
    groups: [GroupState; 4],
    fault: bool,
    /// Since when the supply has been too low, and how low it is.
    low: Option<(SimTime, f64)>,
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
        }
    }

    /// The outputs that may be on now, as bits of `powerStatus`.
    #[must_use]
    pub fn allowed(&self) -> u8 {
        if self.fault {
            return 0;
        }
        self.iter()
            .filter(|(_, state)| state.latch.is_none() && !state.hot)
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
            if state.latch.is_some_and(|latch| latch.overcurrent) {
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
    /// withheld stays off until it is asked for anew.
    pub fn requested(&mut self, now: SimTime, requested: u8, event: &mut impl FnMut(R150Event)) {
        for (group, state) in Group::ALL.iter().zip(&mut self.groups) {
            if requested & group.mask() == 0 {
                if state.latch.take().is_some() {
                    event(R150Event::TripCleared(*group));
                }
            } else if (state.hot || self.fault) && state.latch.is_none() {
                state.latch = Some(Latch {
                    overcurrent: false,
                    since: now,
                });
            }
        }
    }

    /// Takes what was measured at `now`; `requested` is what the outputs should be.
    pub fn sense(
        &mut self,
        now: SimTime,
        measured: &R150Measurements,
        requested: u8,
        event: &mut impl FnMut(R150Event),
    ) {
        self.sense_supply(now, measured, requested, event);
        for group in Group::ALL {
            let (over, short) = self.excess(group, measured);
            let limits = &self.settings;
            let state = &mut self.groups[group as usize];
            state.over = over.then(|| state.over.unwrap_or(now));
            state.short = short.then(|| state.short.unwrap_or(now));
            let Some(celsius) = group.temperature_c(measured) else {
                continue;
            };
            if !state.hot && celsius > limits.over_temperature {
                state.hot = true;
                if requested & group.mask() != 0 && state.latch.is_none() {
                    state.latch = Some(Latch {
                        overcurrent: false,
                        since: now,
                    });
                }
                event(R150Event::Tripped(group, Cause::OverTemperature));
            } else if state.hot && celsius < limits.over_temperature_clear {
                state.hot = false;
                event(R150Event::Cooled(group));
            }
        }
    }

    /// The next time at which something happens by itself.
    #[must_use]
    pub fn deadline(&self) -> Option<SimTime> {
        let groups = self
            .iter()
            .filter_map(|(group, state)| self.group_deadline(group, state));
        groups.chain(self.supply_deadline()).min()
    }

    /// Does what is due at `now`; `requested` is what the outputs should be.
    pub fn advance(&mut self, now: SimTime, requested: u8, event: &mut impl FnMut(R150Event)) {
        if let Some((_, supply_v)) = self.low
            && self.supply_deadline().is_some_and(|due| due <= now)
        {
            self.fail(now, supply_v, requested, event);
        }
        for group in Group::ALL {
            let state = self.groups[group as usize];
            if self
                .group_deadline(group, &state)
                .is_none_or(|deadline| deadline > now)
            {
                continue;
            }
            let state = &mut self.groups[group as usize];
            if state.latch.is_some() {
                state.latch = None;
                event(R150Event::TripCleared(group));
            } else {
                state.latch = Some(Latch {
                    overcurrent: true,
                    since: now,
                });
                state.over = None;
                state.short = None;
                event(R150Event::Tripped(group, Cause::Overcurrent));
            }
        }
    }

    fn iter(&self) -> impl Iterator<Item = (Group, &GroupState)> {
        Group::ALL.into_iter().zip(&self.groups)
    }

    fn group_deadline(&self, group: Group, state: &GroupState) -> Option<SimTime> {
        let limits = &self.settings;
        if let Some(latch) = state.latch {
            return (limits.overcurrent_recovery == OvercurrentRecovery::Retry
                && !state.hot
                && !self.fault)
                .then(|| latch.since + limits.retry_period);
        }
        let delay = match group {
            Group::Ab | Group::Cd => limits.delay_12v,
            Group::V48 => limits.delay_48v,
            Group::V5 => limits.delay_5v,
        };
        let over = state.over.map(|since| since + delay);
        let short = state.short.map(|since| since + limits.short_delay);
        over.into_iter().chain(short).min()
    }

    /// Whether the group is above its threshold, and above the short-circuit multiple.
    ///
    /// The short-circuit rule looks at current, because a short collapses the voltage and with it
    /// the power.
    fn excess(&self, group: Group, measured: &R150Measurements) -> (bool, bool) {
        let limits = &self.settings;
        let rails = 0..6_usize;
        let rails = rails.filter(|rail| group.mask() >> rail & 1 == 1);
        let (power_w, current_a) = rails.fold((0.0, 0.0), |(power_w, current_a), rail| {
            let current = measured.rail_current[rail];
            (
                power_w + current * measured.rail_voltage[rail],
                current_a + current,
            )
        });
        let short_a = limits.short_multiple
            * match group {
                Group::Ab | Group::Cd => limits.limit_12v / limits.nominal_12v,
                Group::V48 => limits.limit_48v / limits.nominal_48v,
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
        event: &mut impl FnMut(R150Event),
    ) {
        let supply_v = measured.bus_voltage;
        let limits = &self.settings;
        let floor = if self.fault {
            limits.undervoltage_clear
        } else {
            limits.undervoltage
        };
        let low = supply_v < floor;
        if self.fault {
            if !low && !measured.power_module_fault {
                self.fault = false;
                event(R150Event::PowerModuleRecovered);
            }
        } else if measured.power_module_fault {
            self.fail(now, supply_v, requested, event);
        } else {
            let since = self.low.map_or(now, |(since, _)| since);
            self.low = low.then_some((since, supply_v));
        }
    }

    /// Withholds everything, and latches what was asked for.
    fn fail(
        &mut self,
        now: SimTime,
        supply_v: f64,
        requested: u8,
        event: &mut impl FnMut(R150Event),
    ) {
        self.fault = true;
        self.low = None;
        for (group, state) in Group::ALL.iter().zip(&mut self.groups) {
            if requested & group.mask() != 0 && state.latch.is_none() {
                state.latch = Some(Latch {
                    overcurrent: false,
                    since: now,
                });
            }
        }
        event(R150Event::PowerModuleFault { supply_v });
    }

    fn supply_deadline(&self) -> Option<SimTime> {
        self.low
            .map(|(since, _)| since + self.settings.undervoltage_delay)
    }
}
