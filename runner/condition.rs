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
mod nearness;

use std::collections::BTreeMap;
use std::sync::{Arc, LazyLock};

use cel::common::types::{CelBool, CelDouble, DOUBLE_TYPE};
use cel::common::value::CowVal;
use cel::context::VariableResolver;
use cel::parser::{Expression, Parser};
use cel::{Context, Env, ExecutionError};
use rigsim_core::device::names::Getter;
use rigsim_core::device::{Counters, DeviceSpec, View};
use rigsim_core::rig::Rig;

pub use check::identifier;
pub(crate) use check::{CLIENT, Scope};
pub use error::ExpressionError;
pub use rigsim_core::device::names::Reading;

/// Longest text of a condition.
const MOST_TEXT: usize = 2000;
/// Deepest nesting of a condition.
const MOST_DEPTH: u16 = 40;
/// Value of what has none yet, where one has to be said.
const NOTHING: Reading = Reading::Number(0.0);

/// A checked condition.
#[derive(Debug, Clone)]
pub struct Condition {
    /// As it was written.
    pub(crate) text: String,
    expression: Expression,
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
    /// As [`Condition::holds`].
    pub(crate) fn evaluate(&self, condition: &Condition) -> Result<Option<bool>, ExpressionError> {
        let known = condition.is_known(self);
        known.then(|| condition.holds(self)).transpose()
    }

    /// Returns whether a condition holds; what is not known yet does not.
    ///
    /// # Errors
    /// As [`Condition::holds`].
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

    /// Reads an expression that may be a number, too.
    ///
    /// # Errors
    /// Says in words what is wrong and what is allowed.
    pub(crate) fn parse_value(text: &str, scope: &Scope<'_>) -> Result<Self, ExpressionError> {
        Self::parse_typed(text, scope).map(|(value, _)| value)
    }

    /// The same, and whether it is true or false.
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
        let mut expression = parser.parse(text).map_err(|errors| {
            let at = errors.errors.first().map(|error| error.pos.1);
            unreadable(text, usize::try_from(at.unwrap_or_default()).unwrap_or(0))
        })?;
        let mut names = BTreeMap::new();
        let is_flag = check::is_flag(&mut expression, scope, &mut names).map_err(unsound)?;
        let condition = Self {
            text: text.to_owned(),
            expression,
            names,
        };
        Ok((condition, is_flag))
    }

    /// Returns whether all that it speaks of has a value by now: what steps remember has none before.
    pub(crate) fn is_known(&self, situation: &Situation) -> bool {
        let mut names = self.names.iter();
        names.all(|(name, origin)| origin.read(name, situation).is_some())
    }

    /// Returns whether it holds.
    ///
    /// # Errors
    /// When it has no value, which only a number that is not one (as 0/0) can bring about.
    pub(crate) fn holds(&self, situation: &Situation) -> Result<bool, ExpressionError> {
        match self.value(situation)? {
            Reading::Flag(holds) => Ok(holds),
            Reading::Number(_) => Err(ExpressionError::NoFlag {
                expression: self.text.clone(),
            }),
        }
    }

    /// Evaluates it now.
    ///
    /// # Errors
    /// As [`Condition::holds`].
    pub(crate) fn value(&self, situation: &Situation) -> Result<Reading, ExpressionError> {
        let value = self.value_of(&self.expression, situation);
        value.map_err(|why| ExpressionError::NoValue {
            expression: self.text.clone(),
            why,
        })
    }

    /// Evaluates a part of it now; or says why it has no value.
    fn value_of(&self, part: &Expression, situation: &Situation) -> Result<Reading, String> {
        let resolver = Resolver {
            names: &self.names,
            situation,
        };
        let mut context = Context::with_env(Arc::clone(&ENVIRONMENT));
        context.set_variable_resolver(&resolver);
        let value = cel::Value::resolve_val(part, &context).map_err(|error| error.to_string())?;
        let flag = value.downcast_ref::<CelBool>();
        let flag = flag.map(|flag| Reading::Flag(*flag.inner()));
        let number = || value.downcast_ref::<CelDouble>();
        flag.or_else(|| number().map(|number| Reading::Number(*number.inner())))
            .ok_or_else(String::new)
    }

    /// The values of the names in it, as in `truth.speed_mps = 1.2`, which say why it holds or not.
    pub(crate) fn explain(&self, situation: &Situation) -> String {
        let values = self.names.iter().map(|(name, origin)| {
            let value = origin.read(name, situation).unwrap_or(NOTHING);
            format!("{name} = {value}")
        });
        values.collect::<Vec<_>>().join(", ")
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

struct Resolver<'a> {
    names: &'a BTreeMap<String, Origin>,
    situation: &'a Situation,
}

impl VariableResolver for Resolver<'_> {
    fn resolve<'b>(&'b self, variable: &str) -> Option<CowVal<'b, 'b>> {
        let origin = self.names.get(variable)?;
        Some(
            match origin.read(variable, self.situation).unwrap_or(NOTHING) {
                Reading::Number(number) => CowVal::owned(CelDouble::from(number)),
                Reading::Flag(flag) => CowVal::owned(CelBool::from(flag)),
            },
        )
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

/// The operators, and our functions.
static ENVIRONMENT: LazyLock<Arc<Env>> = LazyLock::new(|| {
    let mut environment = Env::default().with_stdlib();
    let two = || vec![DOUBLE_TYPE, DOUBLE_TYPE];
    let added = [
        environment.add_overload("abs", "abs_double", vec![DOUBLE_TYPE], |args| {
            number(&args, 0).map(|x| CowVal::owned(CelDouble::from(x.abs())))
        }),
        environment.add_overload("min", "min_double", two(), |args| {
            let (a, b) = (number(&args, 0)?, number(&args, 1)?);
            Ok(CowVal::owned(CelDouble::from(a.min(b))))
        }),
        environment.add_overload("max", "max_double", two(), |args| {
            let (a, b) = (number(&args, 0)?, number(&args, 1)?);
            Ok(CowVal::owned(CelDouble::from(a.max(b))))
        }),
    ];
    debug_assert!(added.iter().all(Result::is_ok), "these names are ours");
    Arc::new(environment)
});

fn number(args: &[CowVal<'_, '_>], index: usize) -> Result<f64, ExecutionError> {
    args.get(index)
        .and_then(|value| value.downcast_ref::<CelDouble>())
        .map(|number| *number.inner())
        .ok_or(ExecutionError::MissingArgumentOrTarget)
}

#[cfg(test)]
mod tests;
