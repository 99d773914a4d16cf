//! The motor command 0x12: set-point, watchdog and reply rate (manual section 4.3.8).

use std::collections::VecDeque;
use std::time::Duration;

use rigsim_settings::SimTime;

use super::client_clock::{ClientClock, Sent};
use super::settings::{OverRate, R150FirmwareSettings};
use crate::rounding::round;

/// Set-points of the client for the motors, right then left.
#[derive(Debug, Clone, Default)]
pub struct Motors {
    /// PWM of the right and the left motor, ±1000.
    pub set_point: [i16; 2],
    /// Time at which the watchdog fires unless a command comes.
    pub watchdog_due: Option<SimTime>,
    /// Time at which the next reply may begin.
    next_answer: SimTime,
    /// Time at which a delayed answer is due.
    pub answer_due: Option<SimTime>,
    /// A watchdog that is out of order has missed its time.
    missed: bool,
    /// When the last commands were sent; as many as are allowed within [`WINDOW`], and one more.
    recent: VecDeque<Sent>,
    /// Time at which the last report was that there were too many.
    over_rate_at: Option<SimTime>,
    /// When the last command was sent that was not ignored.
    last_taken: Option<Sent>,
    pub(super) client_clock: ClientClock,
}

/// Over what time the rate of commands is judged.
const WINDOW: Duration = Duration::from_secs(1);
/// By what share a client may be faster over a second than is answered before it is reported: clocks of
/// computers are better, their schedulers are not.
const TOLERANCE: f64 = 0.05;
/// Most commands whose times are kept.
const MOST_RECENT: usize = 4096;

/// Largest motor PWM.
pub const FULL: i16 = 1000;

impl Motors {
    /// Takes a command that is answered if `answered`; values beyond ±1000 are clamped. Says whether it
    /// is answered now, by a reply that begins `delay` later, and how many commands were sent within
    /// a second if that is more than is allowed.
    pub fn command(
        &mut self,
        (now, delay): (SimTime, Duration),
        set_point: [i16; 2],
        answered: bool,
        settings: &R150FirmwareSettings,
    ) -> (bool, Option<usize>) {
        let sent = self.client_clock.sent(now);
        let over_rate = self.over_rate(now, sent, settings);
        let answer = self.answer((now, delay, sent), set_point, answered, settings);
        (answer, over_rate)
    }

    fn answer(
        &mut self,
        (now, delay, sent): (SimTime, Duration, Sent),
        set_point: [i16; 2],
        answered: bool,
        settings: &R150FirmwareSettings,
    ) -> bool {
        let interval = settings.motor_reply_interval;
        let was_sent_too_soon = self
            .last_taken
            .is_some_and(|last| !sent.may_be_after(last, interval));
        if was_sent_too_soon && settings.over_rate == OverRate::Ignore {
            return false;
        }
        self.set_point = set_point.map(|pwm| pwm.clamp(-FULL, FULL));
        self.watchdog_due = Some(now + settings.motor_watchdog);
        self.missed = false;
        if !answered {
            return false;
        }
        self.last_taken = Some(sent);
        // A busy machine excuses the client, and never makes the module answer faster.
        if self.may_answer(now + delay, settings) {
            self.answer_due = None;
            return true;
        }
        if matches!(settings.over_rate, OverRate::Delay | OverRate::Ignore) {
            self.answer_due = Some(self.next_answer - delay);
        }
        false
    }

    /// Returns whether a reply may begin at `at`.
    pub fn may_answer(&self, at: SimTime, settings: &R150FirmwareSettings) -> bool {
        at >= self.next_answer || settings.over_rate == OverRate::Answer
    }

    /// Returns when a reply begins that is ready at `at`; the next one may come an interval later.
    pub fn pace(&mut self, at: SimTime, settings: &R150FirmwareSettings) -> SimTime {
        let at = match self.may_answer(at, settings) {
            true => at,
            false => self.next_answer,
        };
        self.next_answer = at + settings.motor_reply_interval;
        at
    }

    /// Returns the number of commands that were sent within a second, if those are too many, and at
    /// most once a second. The client is judged by its own clock.
    fn over_rate(
        &mut self,
        now: SimTime,
        sent: Sent,
        settings: &R150FirmwareSettings,
    ) -> Option<usize> {
        let interval = settings.motor_reply_interval.as_secs_f64();
        let window = WINDOW.max(settings.motor_reply_interval * 2);
        let share = 1.0 + TOLERANCE;
        let most = round::<u32>((window.as_secs_f64() / interval * share).floor());
        let most = usize::try_from(most).map_or(MOST_RECENT, |most| most.min(MOST_RECENT));
        self.recent.push_back(sent);
        while self.recent.len() > most + 1 {
            self.recent.pop_front();
        }
        let first = *self.recent.front()?;
        let is_many = most < MOST_RECENT && self.recent.len() > most;
        let is_reported = self.over_rate_at.is_some_and(|at| now.since(at) < window);
        if !is_many || is_reported || sent.may_be_after(first, window) {
            return None;
        }
        self.over_rate_at = Some(now);
        Some(most + 1)
    }

    /// Forgets everything that was commanded.
    pub fn restart(&mut self) {
        *self = Self {
            client_clock: std::mem::take(&mut self.client_clock),
            ..Self::default()
        };
    }

    /// Stops the motors if the watchdog is due at `now`; returns the set-point that it cleared.
    pub fn expire(&mut self, now: SimTime) -> Option<[i16; 2]> {
        self.watchdog_due.take_if(|due| *due <= now)?;
        let cleared = std::mem::take(&mut self.set_point);
        (cleared != [0, 0]).then_some(cleared)
    }

    /// Passes over the time of the watchdog without effect; says whether that left the motors on.
    pub fn miss_watchdog(&mut self, now: SimTime) -> bool {
        let missed = self.watchdog_due.take_if(|due| *due <= now).is_some();
        self.missed |= missed;
        missed && self.set_point != [0, 0]
    }

    /// The watchdog works again, and makes up for what it has missed.
    pub fn mend_watchdog(&mut self, now: SimTime) {
        if std::mem::take(&mut self.missed) {
            self.watchdog_due = Some(now);
        }
    }

    /// Takes the delayed answer if it is due at `now`.
    pub fn take_answer(&mut self, now: SimTime) -> bool {
        self.answer_due.take_if(|due| *due <= now).is_some()
    }
}
