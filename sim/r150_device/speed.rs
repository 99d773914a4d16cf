//! The speed of a motor as firmware measures it: whole pulses of an encoder over a window,
//! filtered.

use std::time::Duration;

use rigsim_settings::SimTime;

use super::settings::R150FirmwareSettings;

/// Pulses of a motor's encoder for one turn of its shaft: a magnetic encoder of ten bits.
const PULSES: f64 = 1024.0;

/// Time over which pulses are counted: a speed is measured more often than it is reported.
const WINDOW: Duration = Duration::from_millis(20);

/// Speed from one motor's encoder.
#[derive(Debug, Clone)]
pub struct Speedometer {
    /// Share of the old speed that stays after a window.
    kept: f64,
    /// Time at which the window that runs began, and the count then.
    begun: SimTime,
    count: f64,
    /// Time at which the encoder was last read, and its place then, turns.
    read: SimTime,
    turns: f64,
    /// The speed, rpm.
    pub rpm: f64,
}

impl Speedometer {
    /// One that has just been switched on.
    #[must_use]
    pub fn new(settings: &R150FirmwareSettings, now: SimTime, turns: f64) -> Self {
        let filter = settings.speed_filter.as_secs_f64();
        let window = WINDOW.as_secs_f64();
        let mut meter = Self {
            kept: if filter > 0.0 {
                libm::exp(-window / filter)
            } else {
                0.0
            },
            begun: now,
            count: 0.0,
            read: now,
            turns,
            rpm: 0.0,
        };
        meter.count = meter.whole(turns);
        meter
    }

    /// Reads the encoder, which since it last changed has turned steadily.
    pub fn read(&mut self, now: SimTime, turns: f64) {
        if turns.to_bits() == self.turns.to_bits() && now < self.begun + WINDOW {
            return;
        }
        let window = WINDOW.as_secs_f64();
        let since = now.since(self.read).as_secs_f64();
        if since > 100.0 * window {
            // It has stood for long, or was not read.
            self.rpm = (turns - self.turns) / since * 60.0;
            self.begun = now;
            self.count = self.whole(turns);
        }
        while self.begun + WINDOW <= now {
            self.begun += WINDOW;
            let share = if since > 0.0 {
                self.begun.since(self.read).as_secs_f64() / since
            } else {
                1.0
            };
            let count = self.whole(self.turns + (turns - self.turns) * share);
            let rpm = (count - self.count) / PULSES / window * 60.0;
            self.rpm = rpm + (self.rpm - rpm) * self.kept;
            self.count = count;
        }
        self.read = now;
        self.turns = turns;
    }

    fn whole(&self, turns: f64) -> f64 {
        // What is a hair short of a whole number by rounding alone is that number.
        (turns * PULSES + 1e-6).floor()
    }
}

#[cfg(test)]
mod tests;
