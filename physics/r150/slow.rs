//! Changes over seconds to hours: charge, warmth of converters and fuses.

use std::time::Duration;

use super::R150Plant;
use super::battery::Battery;
use super::fuse::{FUSES, Fuse, FuseId, TIME_CONSTANT};
use super::network::Flow;
use super::settings::{R150PlantSettings, ThermalSettings};
use super::signals::Rail;

/// Current at which the rises of motors and drivers are reached, A: what the rated 7 N·m need.
const RATED_CURRENT: f64 = 22.0;
/// Rise of a driver at that current, K; assumed: a few watts into a plate of aluminium.
const DRIVER_RISE: f64 = 30.0;
/// Full load of a converter pair, W (manual section 3).
const FULL_LOAD: f64 = 250.0;
/// Rise of a converter pair at full load, K; assumed: it settles near 70 °C, under the limit of 85 °C.
const FULL_LOAD_RISE: f64 = 45.0;
/// Time constant of converters and drivers; assumed: a small heat sink in still air.
const TWO_MINUTES: Duration = Duration::from_secs(120);

/// The slow states of the plant. Each follows its input with one time constant, so any span can be
/// taken in one closed step while the currents stay the same.
#[derive(Debug, Clone)]
pub(super) struct SlowStates {
    pub(super) battery: Battery,
    pub(super) fuses: [Fuse; FUSES],
    /// Of the 12 V converters A+B and C+D, °C.
    pub(super) temperature: [f64; 2],
    /// Of each motor and its driver, °C.
    pub(super) motors: [[f64; 2]; 2],
    ambient: f64,
    rise_per_watt: f64,
    /// Of a motor and its driver, K/A².
    rise_per_square: [f64; 2],
    motor_thermal: [Decay; 2],
    thermal: Decay,
    melting: Decay,
}

impl SlowStates {
    pub(super) fn new(settings: &R150PlantSettings) -> Self {
        let thermal: &ThermalSettings = &settings.thermal;
        let motors = &settings.motor_thermal;
        Self {
            battery: Battery::new(&settings.battery),
            fuses: Fuse::all(&settings.fuses),
            temperature: [thermal.ambient; 2],
            motors: [[thermal.ambient; 2]; 2],
            ambient: thermal.ambient,
            rise_per_square: [motors.motor_rise, DRIVER_RISE]
                .map(|rise| rise / (RATED_CURRENT * RATED_CURRENT)),
            motor_thermal: [motors.motor_time_constant, TWO_MINUTES].map(Decay::new),
            rise_per_watt: FULL_LOAD_RISE / FULL_LOAD,
            thermal: Decay::new(TWO_MINUTES),
            melting: Decay::new(TIME_CONSTANT),
        }
    }

    /// Seconds until the first fuse blows if the currents stay as they are.
    pub(super) fn time_to_blow(&self, flow: &Flow) -> Option<f64> {
        let currents = fuse_currents(flow);
        self.fuses
            .iter()
            .zip(currents)
            .filter_map(|(fuse, current)| fuse.time_to_blow(current))
            .reduce(f64::min)
    }

    /// Advances by `seconds` at steady currents. Returns whether a fuse blew.
    pub(super) fn advance(&mut self, flow: &Flow, seconds: f64) -> bool {
        self.battery.discharge(flow.battery_current, seconds);

        let kept = self.thermal.kept(seconds);
        let pairs = [[Rail::V12A, Rail::V12B], [Rail::V12C, Rail::V12D]];
        for (temperature, pair) in self.temperature.iter_mut().zip(pairs) {
            let power: f64 = pair
                .iter()
                .map(|rail| flow.rail_voltage[rail.index()] * flow.rail_current[rail.index()])
                .sum();
            let settled = self.ambient + self.rise_per_watt * power;
            *temperature = settled + (*temperature - settled) * kept;
        }

        let kept = self
            .motor_thermal
            .each_mut()
            .map(|decay| decay.kept(seconds));
        for (pair, current) in self.motors.iter_mut().zip(flow.motor_current) {
            for part in 0..2 {
                let settled = self.ambient + self.rise_per_square[part] * current * current;
                pair[part] = settled + (pair[part] - settled) * kept[part];
            }
        }

        let kept = self.melting.kept(seconds);
        let mut blew = false;
        for (fuse, current) in self.fuses.iter_mut().zip(fuse_currents(flow)) {
            blew |= fuse.carry(current, kept);
        }
        blew
    }

    /// Blows whichever fuse is due next, so that rounding can never leave it a hair short for ever.
    pub(super) fn blow_next(&mut self, flow: &Flow) {
        let due = self
            .fuses
            .iter_mut()
            .zip(fuse_currents(flow))
            .filter_map(|(fuse, current)| fuse.time_to_blow(current).map(|time| (time, fuse)))
            .min_by(|(first, _), (second, _)| first.total_cmp(second));
        if let Some((_, fuse)) = due {
            fuse.blown = true;
        }
    }
}

impl R150Plant {
    /// Advances the slow states with the present currents, which change whenever a fuse blows. Each
    /// round but the last blows one, so there are at most as many as there are fuses.
    pub(super) fn pass(&mut self, seconds: f64) {
        self.count_turns(seconds);
        let mut left = seconds;
        for _ in FuseId::ALL {
            let Some(due) = self
                .slow
                .time_to_blow(&self.flow)
                .filter(|due| *due <= left)
            else {
                break;
            };
            if !self.slow.advance(&self.flow, due) {
                self.slow.blow_next(&self.flow);
            }
            left -= due;
            self.solve_network();
            self.body.wake();
        }
        if self.slow.advance(&self.flow, left) {
            self.solve_network();
            self.body.wake();
        }
    }
}

fn fuse_currents(flow: &Flow) -> [f64; FUSES] {
    FuseId::ALL.map(|id| match id {
        FuseId::MotorRight => flow.motor_supply[0],
        FuseId::MotorLeft => flow.motor_supply[1],
        FuseId::Tail => flow.tail_current,
        FuseId::SmallModules => flow.small_modules_current,
    })
}

/// `exp(−t / time constant)`, remembered for the last span, since nearly all spans are equal.
#[derive(Debug, Clone)]
struct Decay {
    time_constant: f64,
    span: f64,
    kept: f64,
}

impl Decay {
    fn new(time_constant: Duration) -> Self {
        Self {
            time_constant: time_constant.as_secs_f64(),
            span: 0.0,
            kept: 1.0,
        }
    }

    fn kept(&mut self, span: f64) -> f64 {
        if span.to_bits() != self.span.to_bits() {
            self.span = span;
            self.kept = libm::exp(-span / self.time_constant);
        }
        self.kept
    }
}
