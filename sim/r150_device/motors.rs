//! The motor command 0x12: set-point, watchdog and reply rate (manual section 4.3.8).

use std::collections::VecDeque;
use std::time::Duration;

use sim_settings::SimTime;

use super::bursts::Bursts;
use super::settings::{OverRate, R150FirmwareSettings};

/// Answer to a motor command.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Answer {
    /// At once.
    Now,
    /// Sent when the reply interval has passed.
    Later,
    /// Not at all.
    Never,
}

/// Set-points of the client for the motors, right then left.
#[derive(Debug, Clone, Default)]
pub struct Motors {
    /// PWM of the right and the left motor, ±1000.
    pub set_point: [i16; 2],
    /// Time at which the watchdog fires unless a command comes.
    pub watchdog_due: Option<SimTime>,
    last_answer: Option<SimTime>,
    /// Time at which a delayed answer is due.
    pub answer_due: Option<SimTime>,
    /// A watchdog that is out of order has missed its time.
    missed: bool,
    /// Times of the last commands; as many as are allowed within [`WINDOW`], and one more.
    recent: VecDeque<SimTime>,
    bursts: Bursts,
}

/// Over what time the rate of commands is judged.
const WINDOW: Duration = Duration::from_secs(1);
/// Most commands whose times are kept.
const MOST_RECENT: usize = 4096;

/// Largest motor PWM.
pub const FULL: i16 = 1000;

impl Motors {
    /// Takes a command that is answered if `answered`; values beyond ±1000 are clamped. Says how it
    /// is answered, and how many have come within a second if that is more than is allowed.
    pub fn command(
        &mut self,
        now: SimTime,
        set_point: [i16; 2],
        answered: bool,
        settings: &R150FirmwareSettings,
    ) -> (Answer, Option<usize>) {
        let over_rate = self.over_rate(now, settings);
        (self.answer(now, set_point, answered, settings), over_rate)
    }

    fn answer(
        &mut self,
        now: SimTime,
        set_point: [i16; 2],
        answered: bool,
        settings: &R150FirmwareSettings,
    ) -> Answer {
        let too_soon = self.last_answer.is_some_and(|last| {
            now.since(last) + self.bursts.allowance(now) < settings.motor_reply_interval
        });
        if too_soon && settings.over_rate == OverRate::Ignore {
            return Answer::Never;
        }
        self.set_point = set_point.map(|pwm| pwm.clamp(-FULL, FULL));
        self.watchdog_due = Some(now + settings.motor_watchdog);
        self.missed = false;
        if !answered {
            return Answer::Never;
        }
        if !too_soon {
            self.last_answer = Some(now);
            // In a burst the command before may still be owed its answer.
            self.answer_due = self.answer_due.filter(|due| *due > now);
            return Answer::Now;
        }
        match settings.over_rate {
            OverRate::Silent | OverRate::Ignore => Answer::Never,
            OverRate::Answer => {
                self.last_answer = Some(now);
                Answer::Now
            }
            OverRate::Delay => {
                self.answer_due = self
                    .last_answer
                    .map(|last| last + settings.motor_reply_interval);
                Answer::Later
            }
        }
    }

    /// Number of commands that have come within a second, if those are too many. It is told once a
    /// second.
    fn over_rate(&mut self, now: SimTime, settings: &R150FirmwareSettings) -> Option<usize> {
        let interval = settings.motor_reply_interval.as_secs_f64();
        let window = WINDOW.max(settings.motor_reply_interval * 2);
        let share = 1.0 + settings.over_rate_tolerance / 100.0;
        let most =
            super::telemetry::round::<u32>((window.as_secs_f64() / interval * share).floor());
        let most = usize::try_from(most).map_or(MOST_RECENT, |most| most.min(MOST_RECENT));
        self.recent.push_back(now);
        while self.recent.len() > most + 1 {
            self.recent.pop_front();
        }
        let first = *self.recent.front()?;
        let span = now.since(first) + self.bursts.allowance(now);
        if most == MOST_RECENT || self.recent.len() <= most || span >= window {
            return None;
        }
        self.recent.clear();
        Some(most + 1)
    }

    /// See [`super::R150Device::expect_burst`].
    pub fn expect_burst(&mut self, by: Duration, until: SimTime) {
        self.bursts.expect(by, until);
    }

    /// Forgets everything that was commanded.
    pub fn restart(&mut self) {
        *self = Self {
            bursts: std::mem::take(&mut self.bursts),
            ..Self::default()
        };
    }

    /// Stops the motors if the watchdog is due at `now`; gives the set-point it cleared.
    pub fn expire(&mut self, now: SimTime) -> Option<[i16; 2]> {
        if self.watchdog_due.is_none_or(|due| due > now) {
            return None;
        }
        self.watchdog_due = None;
        let cleared = std::mem::take(&mut self.set_point);
        (cleared != [0, 0]).then_some(cleared)
    }

    /// Lets the time of the watchdog pass without effect; says whether that left the motors on.
    pub fn miss_watchdog(&mut self, now: SimTime) -> bool {
        if self.watchdog_due.is_none_or(|due| due > now) {
            return false;
        }
        self.watchdog_due = None;
        self.missed = true;
        self.set_point != [0, 0]
    }

    /// The watchdog works again, and makes up for what it has missed.
    pub fn mend_watchdog(&mut self, now: SimTime) {
        if std::mem::take(&mut self.missed) {
            self.watchdog_due = Some(now);
        }
    }

    /// Takes the delayed answer if it is due at `now`.
    pub fn take_answer(&mut self, now: SimTime) -> bool {
        let due = self.answer_due.is_some_and(|due| due <= now);
        if due {
            self.answer_due = None;
            self.last_answer = Some(now);
        }
        due
    }
}
