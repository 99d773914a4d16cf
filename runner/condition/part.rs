//! Evaluation of conditions.
//!
//! Rules are judged at every instant of a run, so a checked expression is kept in a form that is
//! evaluated without looking up a name, a function or a type.

use std::cmp::Ordering;

use super::{Origin, Reading, Situation};

/// Value of what has none yet, where one has to be said.
pub(super) const NOTHING: Reading = Reading::Number(0.0);
/// Distance from holding of what is false and cannot be more or less so.
const FAR: f64 = 1.0;

/// A part of a condition. All types in it are right.
#[derive(Debug, Clone)]
pub(super) enum Part {
    Value(Reading),
    Name(String, Origin),
    Not(Box<[Part; 1]>),
    And(Box<[Part; 2]>),
    Or(Box<[Part; 2]>),
    If(Box<[Part; 3]>),
    Compare(Sign, Box<[Part; 2]>),
    One(fn(f64) -> f64, Box<[Part; 1]>),
    Two(fn(f64, f64) -> f64, Box<[Part; 2]>),
}

/// A comparison.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Sign {
    Less,
    LessOrEqual,
    Greater,
    GreaterOrEqual,
    Equal,
    NotEqual,
}

impl Part {
    /// Evaluates it now. `None` if it compares what is not a number, as 0/0.
    pub(super) fn value(&self, situation: &Situation) -> Option<Reading> {
        Some(match self {
            Self::Value(value) => *value,
            Self::Name(name, origin) => origin.read(name, situation).unwrap_or(NOTHING),
            Self::Not(part) => Reading::Flag(!part[0].flag(situation)?),
            Self::And(parts) => Reading::Flag(Self::joined(parts, false, situation)?),
            Self::Or(parts) => Reading::Flag(Self::joined(parts, true, situation)?),
            Self::If(parts) => {
                let [condition, yes, no] = &**parts;
                let part = if condition.flag(situation)? { yes } else { no };
                return part.value(situation);
            }
            Self::Compare(sign, parts) => {
                let [left, right] = &**parts;
                let order = left
                    .number(situation)?
                    .partial_cmp(&right.number(situation)?);
                Reading::Flag(sign.holds(order)?)
            }
            Self::One(function, part) => Reading::Number(function(part[0].number(situation)?)),
            Self::Two(function, parts) => {
                let [left, right] = &**parts;
                Reading::Number(function(left.number(situation)?, right.number(situation)?))
            }
        })
    }

    /// The value of `&&` and `||`: one part that is `decisive` decides, even if the other has no value.
    fn joined(parts: &[Self; 2], decisive: bool, situation: &Situation) -> Option<bool> {
        let left = parts[0].flag(situation);
        if left == Some(decisive) {
            return left;
        }
        let right = parts[1].flag(situation)?;
        (left.is_some() || right == decisive).then_some(right)
    }

    fn flag(&self, situation: &Situation) -> Option<bool> {
        Some(match self.value(situation)? {
            Reading::Flag(flag) => flag,
            Reading::Number(number) => number != 0.0,
        })
    }

    fn number(&self, situation: &Situation) -> Option<f64> {
        Some(match self.value(situation)? {
            Reading::Flag(flag) => f64::from(u8::from(flag)),
            Reading::Number(number) => number,
        })
    }

    /// Returns whether it can be nearer to holding and farther from it: it compares.
    pub(super) fn is_gradual(&self) -> bool {
        match self {
            Self::Compare(..) => true,
            Self::Value(_) | Self::Name(..) => false,
            Self::Not(parts) | Self::One(_, parts) => parts[0].is_gradual(),
            Self::And(parts) | Self::Or(parts) | Self::Two(_, parts) => {
                parts.iter().any(Self::is_gradual)
            }
            Self::If(parts) => parts.iter().any(Self::is_gradual),
        }
    }

    /// The distance from changing between true and false, positive where it holds. Numbers that are compared
    /// count by how far they are apart, as a part of the larger one; of what must hold together, all that does not
    /// counts.
    pub(super) fn margin(&self, situation: &Situation) -> f64 {
        let margins = |parts: &[Self; 2]| parts.each_ref().map(|part| part.margin(situation));
        let margin = match self {
            Self::Not(part) => Some(-part[0].margin(situation)),
            Self::Or(parts) => {
                let [left, right] = margins(parts);
                Some(left.max(right))
            }
            Self::And(parts) => {
                let [left, right] = margins(parts);
                Some(match left < 0.0 && right < 0.0 {
                    true => left + right,
                    false => left.min(right),
                })
            }
            Self::Compare(sign, parts) => {
                let apart = Self::apart(parts, situation);
                apart.and_then(|apart| sign.margin(apart))
            }
            _ => None,
        };
        margin.unwrap_or_else(|| match self.value(situation) {
            Some(Reading::Flag(true)) => FAR,
            _ => -FAR,
        })
    }

    /// By how much the left number is larger, as a part of the larger one.
    fn apart(parts: &[Self; 2], situation: &Situation) -> Option<f64> {
        let number = |part: &Self| match part.value(situation) {
            Some(Reading::Number(number)) if number.is_finite() => Some(number),
            _ => None,
        };
        let (left, right) = (number(&parts[0])?, number(&parts[1])?);
        let larger = left.abs().max(right.abs()).max(f64::MIN_POSITIVE);
        Some((left - right) / larger)
    }
}

impl Sign {
    fn holds(self, order: Option<Ordering>) -> Option<bool> {
        match self {
            Self::Less => order.map(Ordering::is_lt),
            Self::LessOrEqual => order.map(Ordering::is_le),
            Self::Greater => order.map(Ordering::is_gt),
            Self::GreaterOrEqual => order.map(Ordering::is_ge),
            Self::Equal => Some(order == Some(Ordering::Equal)),
            Self::NotEqual => Some(order != Some(Ordering::Equal)),
        }
    }

    fn margin(self, apart: f64) -> Option<f64> {
        match self {
            Self::Less | Self::LessOrEqual => Some(-apart),
            Self::Greater | Self::GreaterOrEqual => Some(apart),
            Self::Equal => Some(-apart.abs()),
            Self::NotEqual => None,
        }
    }
}
