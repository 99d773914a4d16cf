//! Checks of expressions, before they are ever evaluated.

use std::collections::BTreeMap;

use cel::common::ast::{CallExpr, Expr, IdedExpr, LiteralValue, operators};
use rigsim_core::device::NameInfo;
use rigsim_core::device::names::Unit;
use rigsim_settings::{nearest, or_allowed};

use super::part::{Part, Sign};
use super::{Devices, Origin, Reading, Saved};
use crate::renamed::{self, Kind};

/// What the names of published numbers begin with, as some names of devices do.
pub(crate) const CLIENT: &str = "client.";
/// Most bytes of the name of a published number behind that.
const MOST_NAME: usize = 40;

enum Function {
    One(fn(f64) -> f64),
    Two(fn(f64, f64) -> f64),
}

/// What makes a number of one or two.
const FUNCTIONS: [(&str, Function); 8] = [
    ("abs", Function::One(f64::abs)),
    ("min", Function::Two(f64::min)),
    ("max", Function::Two(f64::max)),
    (operators::NEGATE, Function::One(|x| -x)),
    (operators::ADD, Function::Two(|x, y| x + y)),
    (operators::SUBSTRACT, Function::Two(|x, y| x - y)),
    (operators::MULTIPLY, Function::Two(|x, y| x * y)),
    (operators::DIVIDE, Function::Two(|x, y| x / y)),
];

/// What compares.
const SIGNS: [(&str, Sign); 6] = [
    (operators::LESS, Sign::Less),
    (operators::LESS_EQUALS, Sign::LessOrEqual),
    (operators::GREATER, Sign::Greater),
    (operators::GREATER_EQUALS, Sign::GreaterOrEqual),
    (operators::EQUALS, Sign::Equal),
    (operators::NOT_EQUALS, Sign::NotEqual),
];

/// Names and their meanings.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Scope<'a> {
    /// The devices.
    pub devices: &'a Devices<'a>,
    /// The device whose name may be left out.
    pub usual: Option<usize>,
    /// Values that steps remember.
    pub saved: &'a [Saved],
    /// The parameters that are not texts.
    pub parameters: &'a BTreeMap<String, Reading>,
}

/// Checks an expression, and notes what its names mean; says whether it is true or false.
pub(super) fn checked(
    expression: &IdedExpr,
    scope: &Scope<'_>,
    found: &mut BTreeMap<String, Origin>,
) -> Result<(Part, bool), String> {
    if let Some(name) = qualified_name(&expression.expr) {
        let (origin, unit) = scope.look_up(&name)?;
        found.insert(name.clone(), origin);
        return Ok((Part::Name(name, origin), matches!(unit, Unit::Flag)));
    }
    match &expression.expr {
        Expr::Literal(literal) => checked_literal(literal),
        Expr::Call(call) => checked_call(call, scope, found),
        Expr::List(_) | Expr::Map(_) | Expr::Struct(_) => {
            Err("lists, maps and messages have no use here".to_owned())
        }
        Expr::Comprehension(_) => {
            Err("macros such as `all` and `exists` have no use here".to_owned())
        }
        Expr::Select(select) => Err(format!("`.{}` is not a name", select.field)),
        Expr::Ident(_) | Expr::Unspecified => Err("it is not an expression".to_owned()),
    }
}

fn checked_literal(literal: &LiteralValue) -> Result<(Part, bool), String> {
    let number = match literal {
        LiteralValue::Boolean(flag) => {
            return Ok((Part::Value(Reading::Flag(*flag.inner())), true));
        }
        LiteralValue::Double(number) => *number.inner(),
        #[expect(
            clippy::cast_precision_loss,
            reason = "a number of more than 53 bits becomes the nearest decimal number"
        )]
        LiteralValue::Int(whole) => *whole.inner() as f64,
        _ => return Err("only numbers, true and false can be written here".to_owned()),
    };
    Ok((Part::Value(Reading::Number(number)), false))
}

fn checked_call(
    call: &CallExpr,
    scope: &Scope<'_>,
    found: &mut BTreeMap<String, Origin>,
) -> Result<(Part, bool), String> {
    let name = call.func_name.as_str();
    if call.target.is_some() {
        return Err(unknown_function(name));
    }
    let (mut parts, mut are_flags) = (Vec::new(), Vec::new());
    let mut wrong = Vec::new();
    for argument in &call.args {
        match checked(argument, scope, found) {
            Ok((part, is_flag)) => {
                parts.push(part);
                are_flags.push(is_flag);
            }
            Err(why) => wrong.push(why),
        }
    }
    if !wrong.is_empty() {
        return Err(wrong.join("; "));
    }
    let word = |is_flag| if is_flag { "true or false" } else { "a number" };
    let all_are_flags = |wanted: bool| match are_flags.contains(&!wanted) {
        false => Ok(()),
        true => Err(format!(
            "`{}` wants {}, this is {}",
            shown(name),
            word(wanted),
            word(!wanted)
        )),
    };
    if let Some((_, function)) = FUNCTIONS.iter().find(|(known, _)| *known == name) {
        let part = match function {
            Function::One(function) => Part::One(*function, exactly(name, parts)?),
            Function::Two(function) => Part::Two(*function, exactly(name, parts)?),
        };
        return all_are_flags(false).map(|()| (part, false));
    }
    if let Some((_, sign)) = SIGNS.iter().find(|(known, _)| *known == name) {
        match (sign, &are_flags[..]) {
            (Sign::Equal | Sign::NotEqual, [left, right]) if left == right => {}
            (Sign::Equal | Sign::NotEqual, _) => {
                let name = shown(name);
                return Err(format!("`{name}` compares a number with true or false"));
            }
            _ => all_are_flags(false)?,
        }
        return Ok((Part::Compare(*sign, exactly(name, parts)?), true));
    }
    let part = match name {
        operators::CONDITIONAL => match are_flags[..] {
            [true, yes, no] if yes == no => {
                return Ok((Part::If(exactly(name, parts)?), yes));
            }
            _ => return Err("`?:` wants a condition and two values of one kind".to_owned()),
        },
        operators::LOGICAL_AND => Part::And(exactly(name, parts)?),
        operators::LOGICAL_OR => Part::Or(exactly(name, parts)?),
        operators::LOGICAL_NOT => Part::Not(exactly(name, parts)?),
        _ => return Err(unknown_function(name)),
    };
    all_are_flags(true).map(|()| (part, true))
}

/// The arguments of a function, if it takes so many.
fn exactly<const COUNT: usize>(name: &str, parts: Vec<Part>) -> Result<Box<[Part; COUNT]>, String> {
    let parts: Result<Box<[Part; COUNT]>, _> = parts.into_boxed_slice().try_into();
    parts.map_err(|parts| format!("`{}` takes {COUNT}, not {}", shown(name), parts.len()))
}

fn unknown_function(name: &str) -> String {
    format!(
        "`{}` is not known here; allowed: && || ! == != < <= > >= + - * / ?: abs min max",
        shown(name)
    )
}

/// An operator as it is written: the library calls `+` by the name `_+_`.
fn shown(name: &str) -> &str {
    name.trim_matches(['_', '@'])
}

/// The dotted name that an expression is, if it is one.
fn qualified_name(expression: &Expr) -> Option<String> {
    match expression {
        Expr::Ident(name) => Some(name.clone()),
        Expr::Select(select) if !select.test => {
            let mut name = qualified_name(&select.operand.expr)?;
            name.push('.');
            name.push_str(&select.field);
            Some(name)
        }
        _ => None,
    }
}

impl Scope<'_> {
    pub(crate) fn look_up(&self, name: &str) -> Result<(Origin, Unit), String> {
        if name == "t" {
            return Ok((Origin::Time, Unit::Number("s")));
        }
        if let Some(own) = name.strip_prefix("saved.") {
            return self.look_up_saved(own);
        }
        if let Some(own) = name.strip_prefix("param.") {
            return self.look_up_parameter(own);
        }
        let mut candidates =
            self.devices
                .iter()
                .enumerate()
                .filter_map(|(index, (own, device))| {
                    let own = identifier(own);
                    let inner = name
                        .strip_prefix(&own)
                        .and_then(|rest| rest.strip_prefix('.'))
                        .or_else(|| (self.usual == Some(index)).then_some(name))?;
                    let info = device.find_name(inner)?;
                    Some((Origin::Device(index, info.getter), info.unit))
                });
        let found = candidates.next().or_else(|| self.look_up_published(name));
        found.ok_or_else(|| self.unknown(name))
    }

    /// A number that a client may publish: its name is unlike those that devices have.
    fn look_up_published(&self, name: &str) -> Option<(Origin, Unit)> {
        let own = name.strip_prefix(CLIENT)?;
        let is_letter = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_';
        let is_name = own.starts_with(|c: char| c.is_ascii_lowercase())
            && own.len() <= MOST_NAME
            && own.chars().all(is_letter);
        let of_devices = self.devices.iter();
        let of_devices = of_devices.flat_map(|(_, device)| device.all_names());
        let of_devices = of_devices.filter_map(|info| info.name.strip_prefix(CLIENT));
        let former = renamed::find(|kind| kind == Kind::Name, name);
        let is_free = is_name && former.is_none() && nearest(own, of_devices).is_none();
        is_free.then_some((Origin::Published, Unit::Number("")))
    }

    /// Returns whether a client may publish a number by this name of conditions.
    pub(crate) fn is_publishable(&self, name: &str) -> bool {
        matches!(self.look_up(name), Ok((Origin::Published, _)))
    }

    /// What a name is called now, or the name that is meant, where one of the tables has it.
    fn known_mistake(&self, name: &str) -> Option<String> {
        let of_device = |(own, _): &(&str, _)| {
            let own = format!("{}.", identifier(own));
            Some((name.strip_prefix(&own)?, own))
        };
        let found = self.devices.iter().find_map(of_device);
        let (inner, own) = found.unwrap_or((name, String::new()));
        if let Some(renamed) = renamed::find(|kind| kind == Kind::Name, inner) {
            return Some(renamed.to_string());
        }
        let meant = renamed::meant(inner)?;
        let (not, meant) = meant
            .strip_prefix('!')
            .map_or(("", meant), |meant| ("!", meant));
        let whole = format!("{own}{meant}");
        self.look_up(&whole).ok()?;
        Some(format!(
            "no name `{name}`; did you mean `{not}{whole}`? (`sim names` lists them all)"
        ))
    }

    fn look_up_parameter(&self, name: &str) -> Result<(Origin, Unit), String> {
        let value = self.parameters.get(name).ok_or_else(|| {
            let known: Vec<&str> = self.parameters.keys().map(String::as_str).collect();
            let hint = or_allowed(name, &known);
            format!("no parameter that is a number, true or false is named `{name}`; {hint}")
        })?;
        let unit = match value {
            Reading::Flag(_) => Unit::Flag,
            Reading::Number(_) => Unit::Number(""),
        };
        Ok((Origin::Fixed(*value), unit))
    }

    fn look_up_saved(&self, name: &str) -> Result<(Origin, Unit), String> {
        let index = self.saved.iter().position(|saved| saved.name == name);
        let index = index.ok_or_else(|| {
            let hint = nearest(name, self.saved.iter().map(|saved| saved.name.as_str()));
            hint.map_or_else(
                || {
                    format!(
                        "no step remembers `{name}`; one does with `remember = {{ {name} = \"…\" }}`"
                    )
                },
                |near| format!("no step remembers `{name}`, did you mean `saved.{near}`?"),
            )
        })?;
        let unit = match self.saved[index].is_flag {
            true => Unit::Flag,
            false => Unit::Number(""),
        };
        Ok((Origin::Saved(index), unit))
    }

    fn unknown(&self, name: &str) -> String {
        if let Some(why) = self.known_mistake(name) {
            return why;
        }
        let all = self
            .devices
            .iter()
            .enumerate()
            .flat_map(|(index, (own, device))| {
                let own = identifier(own);
                let short = self.usual == Some(index) && !name.starts_with(&format!("{own}."));
                device.all_names().map(move |NameInfo { name, .. }| {
                    if short {
                        (*name).to_owned()
                    } else {
                        format!("{own}.{name}")
                    }
                })
            });
        let hint = nearest(name, all).map_or_else(
            || {
                let devices: Vec<String> = self
                    .devices
                    .iter()
                    .map(|(own, _)| identifier(own))
                    .collect();
                format!("names begin with `t` or a device: {}", devices.join(", "))
            },
            |near| format!("did you mean `{near}`?"),
        );
        format!("no name `{name}`; {hint} (`sim names` lists them all)")
    }
}

/// Refuses what cannot be the name of what files give to conditions.
pub(crate) fn check_name(name: &str) -> Result<(), &'static str> {
    let is_letter = |c: char| c.is_ascii_alphanumeric() || c == '_';
    let begins = name.starts_with(|c: char| c.is_ascii_digit());
    match name.chars().all(is_letter) && !begins {
        true => Ok(()),
        false => Err("a name for conditions has letters, digits and _, and no digit first"),
    }
}

/// A device's name as it is written in a condition.
pub fn identifier(name: &str) -> String {
    name.replace('-', "_")
}
