//! Margins: how near the rules of a run came to being broken.

use std::time::Duration;

use rigsim_core::SimTime;

use super::outcome::Margin;
use crate::condition::{Condition, Situation};
use crate::scenario::Rule;

/// Shortest time between two measurements of a distance; far from the limit it is ten times as long.
const EVERY: Duration = Duration::from_millis(20);
/// Smallest margin of what was kept, and the step of all margins.
const SMALLEST: f64 = 1e-4;

/// The smallest slack so far.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Slack {
    share: Option<f64>,
    at: SimTime,
    /// The distance is not measured before.
    next: SimTime,
}

impl Slack {
    pub(super) fn break_at(&mut self, now: SimTime) {
        (self.share, self.at) = (Some(0.0), now);
    }

    /// What was kept had this slack; times are measured without rounding.
    pub(super) fn narrow(&mut self, share: f64, now: SimTime) {
        let share = ((share / SMALLEST).round() * SMALLEST).max(SMALLEST);
        if self.share.is_none_or(|smallest| share < smallest) {
            (self.share, self.at) = (Some(share), now);
        }
    }

    /// So much of a time limit was used.
    pub(super) fn narrow_time(&mut self, used: Duration, limit: Duration, now: SimTime) {
        if !limit.is_zero() {
            self.narrow(1.0 - used.div_duration_f64(limit), now);
        }
    }

    pub(super) fn margin(self, what: String) -> Option<Margin> {
        let (margin, at) = (self.share?, self.at);
        margin.is_finite().then_some(Margin { what, margin, at })
    }

    /// Measures how far a rule that is kept is from being broken. Before the time of a `longer_than`
    /// begins, the whole of it is left.
    pub(super) fn measure(&mut self, rule: &Rule, situation: &Situation, now: SimTime) {
        if now < self.next {
            return;
        }
        let distance = distance(&rule.that, rule.must_hold, situation);
        let time_left = f64::from(u8::from(!rule.longer_than.is_zero()));
        self.narrow(distance + time_left, now);
        // On a grid, so that one instant more or less shifts nothing.
        let pause = EVERY.mul_f64(1.0 + (9.0 * distance.min(1.0)).floor());
        self.next = (now + pause - EVERY).next_multiple(EVERY);
    }
}

/// Returns the distance of a condition from becoming false, or true if it must not hold.
pub(super) fn distance(condition: &Condition, must_hold: bool, situation: &Situation) -> f64 {
    let margin = condition.margin(situation);
    if must_hold { margin } else { -margin }.max(0.0)
}
