//! Conditions: expressions in CEL over a documented tree of names.
//!
//! A condition is true or false. It is made of names, numbers, `true` and `false`, the operators
//! `&& || ! == != < <= > >= + - * / ?:`, and the functions `abs(x)`, `min(a, b)` and `max(a, b)`.
//! Every number is a decimal one, so that `2` and `2.0` are the same.
//!
//! `t` is the time since the start in seconds. Every other name is the name of a device, a dot, and
//! a name of the device: `r150.truth.speed_mps`. With one device its name may be left out. A `-` in
//! a device's name is written `_`. `saved.x0` is what a step has remembered under that name, and
//! `param.pwm` a parameter. `client.x` is the number that the client publishes as `x`, where no
//! device has such a name.
//!
//! All this is checked when the file is read: a condition that passed cannot fail for a name, a
//! function or a type.

mod check;
mod error;
mod part;

use std::collections::BTreeMap;

use cel::parser::Parser;
use rigsim_core::device::names::Getter;
use rigsim_core::device::{Counters, DeviceSpec, View};
use rigsim_core::rig::Rig;

pub use check::identifier;
pub(crate) use check::{CLIENT, Scope, check_name};
pub use error::ExpressionError;
use part::{NOTHING, Part};
pub use rigsim_core::device::names::Reading;

/// Longest text of a condition.
const MOST_TEXT: usize = 2000;
/// Deepest nesting of a condition.
const MOST_DEPTH: u16 = 40;

/// A checked condition.
#[derive(Debug, Clone)]
pub struct Condition {
    /// As it was written.
    pub(crate) text: String,
    part: Part,
    names: BTreeMap<String, Origin>,
}

/// Where the value of a name comes from.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Origin {
    Time,
    Device(usize, Getter),
    /// Value that a step has remembered, by its index.
    Saved(usize),
    /// A parameter.
    Fixed(Reading),
    /// Number that a client publishes by this name.
    Published,
}

/// A value that a step remembers.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Saved {
    /// As conditions write it behind `saved.`.
    pub name: String,
    /// It is true or false, and no number.
    pub is_flag: bool,
}

/// The devices that conditions can speak of: name and kind, by their index in the rig.
pub(crate) type Devices<'a> = [(&'a str, &'static DeviceSpec)];

/// State of a run that conditions are evaluated against.
pub(crate) struct Situation {
    /// The devices and their world.
    pub rig: Rig,
    /// Observations of each device, by its index.
    pub counters: Vec<Counters>,
    /// Values that steps have remembered so far.
    pub saved: Vec<Option<Reading>>,
    /// Numbers that clients have published so far, by their names in conditions.
    pub published: BTreeMap<String, f64>,
}

impl Situation {
    /// Returns whether a condition holds, unless it speaks of what no step has remembered yet.
    ///
    /// # Errors
    /// When it has no value, which only a number that is not one (as 0/0) can bring about.
    pub(crate) fn evaluate(&self, condition: &Condition) -> Result<Option<bool>, ExpressionError> {
        if !condition.is_known(self) {
            return Ok(None);
        }
        match condition.value(self)? {
            Reading::Flag(holds) => Ok(Some(holds)),
            Reading::Number(_) => Err(ExpressionError::NoFlag {
                expression: condition.text.clone(),
            }),
        }
    }

    /// Returns whether a condition holds; what is not known yet does not.
    ///
    /// # Errors
    /// As [`Situation::evaluate`].
    pub(crate) fn holds(&self, condition: &Condition) -> Result<bool, ExpressionError> {
        Ok(self.evaluate(condition)?.unwrap_or(false))
    }
}

impl Condition {
    /// Reads a condition.
    ///
    /// # Errors
    /// Says in words what is wrong and what is allowed.
    pub(crate) fn parse(text: &str, scope: &Scope<'_>) -> Result<Self, ExpressionError> {
        match Self::parse_typed(text, scope)? {
            (condition, true) => Ok(condition),
            (_, false) => Err(ExpressionError::Unsound {
                expression: text.to_owned(),
                why: "a condition is true or false, this is a number; \
                      compare it, as in `truth.speed_mps > 1.5`"
                    .to_owned(),
            }),
        }
    }

    /// Reads an expression that may be a number, too; returns whether it is true or false.
    ///
    /// # Errors
    /// Says in words what is wrong and what is allowed.
    pub(crate) fn parse_typed(
        text: &str,
        scope: &Scope<'_>,
    ) -> Result<(Self, bool), ExpressionError> {
        let unsound = |why| ExpressionError::Unsound {
            expression: text.to_owned(),
            why,
        };
        if text.len() > MOST_TEXT {
            let why = format!("a condition has at most {MOST_TEXT} bytes");
            return Err(unsound(why));
        }
        let parser = Parser::new().max_recursion_depth(MOST_DEPTH);
        let expression = parser.parse(text).map_err(|errors| {
            let at = errors.errors.first().map(|error| error.pos.1);
            unreadable(text, usize::try_from(at.unwrap_or_default()).unwrap_or(0))
        })?;
        let mut names = BTreeMap::new();
        let (part, is_flag) = check::checked(&expression, scope, &mut names).map_err(unsound)?;
        let condition = Self {
            text: text.to_owned(),
            part,
            names,
        };
        Ok((condition, is_flag))
    }

    /// Returns whether all that it speaks of has a value by now: what steps remember has none before.
    pub(crate) fn is_known(&self, situation: &Situation) -> bool {
        self.names.iter().all(|(name, origin)| match origin {
            Origin::Saved(_) | Origin::Published => origin.read(name, situation).is_some(),
            Origin::Time | Origin::Device(..) | Origin::Fixed(_) => true,
        })
    }

    /// Evaluates it now.
    ///
    /// # Errors
    /// As [`Situation::evaluate`].
    pub(crate) fn value(&self, situation: &Situation) -> Result<Reading, ExpressionError> {
        let value = self.part.value(situation);
        value.ok_or_else(|| ExpressionError::NoValue {
            expression: self.text.clone(),
        })
    }

    /// Returns whether it can be nearer to holding and farther from it: it compares.
    pub(crate) fn is_gradual(&self) -> bool {
        self.part.is_gradual()
    }

    /// The distance from changing between true and false, positive where it holds.
    pub(crate) fn margin(&self, situation: &Situation) -> f64 {
        self.part.margin(situation)
    }

    /// The values of the names in it, as in `truth.speed_mps = 1.2`, which say why it holds or not.
    pub(crate) fn explain(&self, situation: &Situation) -> String {
        let values = self.names.iter().map(|(name, origin)| {
            let value = origin.read(name, situation).unwrap_or(NOTHING);
            format!("{name} = {value}")
        });
        match values.collect::<Vec<_>>().join(", ") {
            none if none.is_empty() => "it names no value of the run".to_owned(),
            values => values,
        }
    }
}

impl Origin {
    /// The value of a name now; `None` if no step has remembered it yet, or no client published it.
    pub(crate) fn read(self, name: &str, situation: &Situation) -> Option<Reading> {
        let Situation {
            rig,
            counters,
            saved,
            published,
        } = situation;
        match self {
            Self::Time => Some(Reading::Number(rig.now().as_secs_f64())),
            Self::Saved(index) => saved.get(index).copied().flatten(),
            Self::Fixed(value) => Some(value),
            Self::Published => published.get(name).copied().map(Reading::Number),
            Self::Device(index, getter) => Some(getter.read(&View {
                now: rig.now(),
                world: rig.world(),
                device: rig.any_device(index)?,
                counters: counters.get(index)?,
            })),
        }
    }
}

/// Says where an expression cannot be read.
fn unreadable(text: &str, at: usize) -> ExpressionError {
    let unreadable = |at, why| ExpressionError::Unreadable {
        expression: text.to_owned(),
        at,
        why,
    };
    let letters: Vec<char> = text.chars().collect();
    let at = at.min(letters.len());
    if letters[at..].iter().all(|letter| letter.is_whitespace()) {
        return unreadable(at, "the expression is not finished".to_owned());
    }
    // Of a word that cannot be there, the reader may have taken the beginning.
    let in_word = |letter: &&char| letter.is_ascii_alphanumeric() || **letter == '_';
    let start = at - letters[..at].iter().rev().take_while(in_word).count();
    let word: String = letters[start..].iter().take_while(in_word).collect();
    let before: String = letters[..start].iter().collect();
    let before = before.trim_end();
    let compares = ["==", "!=", "<=", ">="];
    let hint = match word.as_str() {
        "and" => "`and` is written `&&`",
        "or" => "`or` is written `||`",
        _ if before.ends_with("not") => "`not` is written `!`",
        _ if before.ends_with('=') && !compares.iter().any(|sign| before.ends_with(sign)) => {
            "`==` compares"
        }
        "" => OPERATORS,
        _ if before.ends_with(|letter: char| letter.is_ascii_digit()) => {
            "a number has no unit; `sim names` lists the units of names"
        }
        _ if word.starts_with(|letter: char| letter.is_ascii_digit()) => {
            "this is not a number, or one that is too large"
        }
        _ => OPERATORS,
    };
    let rest: String = letters[start..].iter().take(20).collect();
    let (rest, from) = (rest.trim(), start + 1);
    let why = format!("the expression cannot be read from character {from} on: `{rest}`; {hint}");
    unreadable(start, why)
}

const OPERATORS: &str = "it is made of names, numbers, and && || ! == != < <= > >= + - * / ?: ( )";

#[cfg(test)]
mod tests;
