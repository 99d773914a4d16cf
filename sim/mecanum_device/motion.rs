//! Motions: the one that runs, those that wait, and when each wheel has turned far enough.

use std::collections::VecDeque;
use std::fmt;

use rigsim_physics::mecanum::WHEELS;
use rigsim_settings::SimTime;

use super::kinematics::Movement;
use super::settings::{MecanumFirmwareSettings, Preempt, ZeroDistance, ZeroSpeed};
use crate::rounding::round;

/// A movement with its distance and speed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Motion {
    /// Movement.
    pub movement: Movement,
    /// Distance that each driven wheel turns, never negative.
    pub revolutions: f64,
    /// Speed at which it turns, r/min, never negative.
    pub speed_rpm: f64,
}

impl fmt::Display for Motion {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (movement, revolutions) = (self.movement, self.revolutions);
        let tenths = revolutions * 10.0;
        let digits = if (tenths - tenths.round()).abs() < 1e-6 {
            1
        } else {
            4
        };
        let speed = self.speed_rpm;
        write!(f, "{movement} {revolutions:.digits$} rev at {speed} rpm")
    }
}

/// The motion that runs.
#[derive(Debug, Clone)]
struct Running {
    motion: Motion,
    rotations: [i8; WHEELS],
    /// Pulses that each wheel has still to turn; `None` if there is no end.
    pulses_left: Option<[i64; WHEELS]>,
}

impl Running {
    /// Returns whether a wheel has still to turn.
    fn drives(&self, wheel: usize) -> bool {
        match self.pulses_left {
            Some(left) => left[wheel] > 0,
            None => self.rotations[wheel] != 0,
        }
    }
}

/// Change of a motion.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Change {
    /// It runs.
    Started(Motion),
    /// Its wheels have turned far enough.
    Done(Motion),
}

/// The motion that runs and those that wait.
#[derive(Debug, Clone)]
pub struct Motions {
    settings: MecanumFirmwareSettings,
    running: Option<Running>,
    waiting: VecDeque<Motion>,
    /// Earliest time of the next.
    not_before: SimTime,
    /// Number that have begun to run so far.
    pub started: u64,
}

impl Motions {
    /// None.
    #[must_use]
    pub fn new(settings: MecanumFirmwareSettings) -> Self {
        Self {
            settings,
            running: None,
            waiting: VecDeque::new(),
            not_before: SimTime::ZERO,
            started: 0,
        }
    }

    /// Appends a motion; returns it if there is no room.
    pub fn append(&mut self, motion: Motion) -> Option<Motion> {
        let most = usize::try_from(self.settings.queue_length).unwrap_or(usize::MAX);
        if self.running.is_some() && self.waiting.len() >= most {
            return Some(motion);
        }
        self.waiting.push_back(motion);
        None
    }

    /// Discards what a motion that preempts does and puts it first; says how many were discarded.
    pub fn preempt(&mut self, motion: Motion) -> usize {
        let count = match self.settings.preempt {
            Preempt::All => self.discard(),
            Preempt::Running => usize::from(self.running.take().is_some()),
        };
        self.waiting.push_front(motion);
        self.not_before = SimTime::ZERO;
        count
    }

    /// Discards all; says how many there were.
    pub fn discard(&mut self) -> usize {
        let waiting = std::mem::take(&mut self.waiting).len();
        waiting + usize::from(self.running.take().is_some())
    }

    /// The wheels have turned by these pulses in the direction in which they are to turn.
    pub fn turned(
        &mut self,
        now: SimTime,
        pulses: [i64; WHEELS],
        changed: &mut impl FnMut(Change),
    ) {
        let Some(running) = &mut self.running else {
            return;
        };
        if let Some(left) = &mut running.pulses_left {
            for (wheel, pulses) in pulses.into_iter().enumerate() {
                // One that has arrived has stopped, and goes on no more if it is turned back.
                if left[wheel] > 0 {
                    left[wheel] = left[wheel].saturating_sub(pulses);
                }
            }
        }
        let running = &*running;
        if !(0..WHEELS).any(|wheel| running.drives(wheel)) {
            changed(Change::Done(running.motion));
            self.running = None;
            self.not_before = now + self.settings.motion_pause;
            self.start(now, changed);
        }
    }

    /// The motion that runs.
    #[must_use]
    pub fn running(&self) -> Option<&Motion> {
        self.running.as_ref().map(|running| &running.motion)
    }

    /// Number of motions that wait.
    #[must_use]
    pub fn waiting(&self) -> usize {
        self.waiting.len()
    }

    /// Time at which one that waits begins by itself.
    #[must_use]
    pub fn due(&self) -> Option<SimTime> {
        let pauses = self.running.is_none() && !self.waiting.is_empty();
        pauses.then_some(self.not_before)
    }

    /// Wheels that have still to turn in the motion that runs, or are to in the next one.
    #[must_use]
    pub fn driven(&self) -> [bool; WHEELS] {
        let rotations = match (&self.running, self.waiting.front()) {
            (None, Some(next)) => next.movement.rotations(),
            _ => self.rotations(),
        };
        rotations.map(|rotation| rotation != 0)
    }

    /// Direction in which each wheel is driven now; one that has turned far enough has stopped.
    #[must_use]
    pub fn rotations(&self) -> [i8; WHEELS] {
        let Some(running) = &self.running else {
            return [0; WHEELS];
        };
        std::array::from_fn(|wheel| {
            if running.drives(wheel) {
                running.rotations[wheel]
            } else {
                0
            }
        })
    }

    /// Starts the next motion if none runs and the pause is over; those with nothing to do end as
    /// they come.
    pub fn start(&mut self, now: SimTime, changed: &mut impl FnMut(Change)) {
        while self.running.is_none() && now >= self.not_before {
            let Some(motion) = self.waiting.pop_front() else {
                return;
            };
            if self.is_nothing(&motion) {
                continue;
            }
            let rotations = motion.movement.rotations();
            let of_wheel =
                |pulses| rotations.map(|rotation| if rotation == 0 { 0 } else { pulses });
            self.running = Some(Running {
                motion,
                rotations,
                pulses_left: self.pulses(&motion).map(of_wheel),
            });
            self.started += 1;
            changed(Change::Started(motion));
        }
    }
    /// Returns whether a motion ends as it begins.
    fn is_nothing(&self, motion: &Motion) -> bool {
        let no_distance =
            motion.revolutions <= 0.0 && self.settings.zero_distance == ZeroDistance::End;
        no_distance || motion.speed_rpm <= 0.0 && self.settings.zero_speed == ZeroSpeed::End
    }

    /// Pulses after which a wheel has turned far enough, which is at the first one at or beyond the
    /// distance; `None` if it never has.
    fn pulses(&self, motion: &Motion) -> Option<i64> {
        if motion.revolutions <= 0.0 {
            return None;
        }
        let pulses = motion.revolutions * f64::from(self.settings.odometry.pulses_per_revolution);
        // What is beyond a whole number by rounding alone is that number.
        Some(round((pulses - 1e-6).ceil()))
    }
}

#[cfg(test)]
mod tests;
