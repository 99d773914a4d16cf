//! Distance of a condition that does not hold from holding.

use cel::common::ast::{CallExpr, Expr, operators};
use cel::parser::Expression;

use super::{Condition, Reading, Situation};

/// Distance of what is false and cannot be more or less so.
const FAR: f64 = 1.0;

impl Condition {
    /// Returns whether it can be nearer to holding and farther from it: it compares.
    pub(crate) fn is_gradual(&self) -> bool {
        fn compares(part: &Expr) -> bool {
            const SIGNS: [&str; 6] = [
                operators::LESS,
                operators::LESS_EQUALS,
                operators::GREATER,
                operators::GREATER_EQUALS,
                operators::EQUALS,
                operators::NOT_EQUALS,
            ];
            matches!(part, Expr::Call(call) if SIGNS.contains(&call.func_name.as_str())
                || call.args.iter().any(|part| compares(&part.expr)))
        }
        compares(&self.expression.expr)
    }

    /// Distance from holding, 0 at most; larger is nearer. Numbers that are compared count by how
    /// far they are apart, as a part of the larger one; of what must hold together, all that does
    /// not counts.
    pub(crate) fn nearness(&self, situation: &Situation) -> f64 {
        self.margin(situation).min(0.0)
    }

    /// The distance from changing between true and false, positive where it holds.
    pub(crate) fn margin(&self, situation: &Situation) -> f64 {
        self.margin_of(&self.expression, situation)
    }

    fn margin_of(&self, part: &Expression, situation: &Situation) -> f64 {
        if let Expr::Call(call) = &part.expr
            && let Some(margin) = self.margin_of_call(call, situation)
        {
            return margin;
        }
        match self.value_of(part, situation) {
            Ok(Reading::Flag(true)) => FAR,
            _ => -FAR,
        }
    }

    fn margin_of_call(&self, call: &CallExpr, situation: &Situation) -> Option<f64> {
        let margin = |at: usize| Some(self.margin_of(call.args.get(at)?, situation));
        let number = |at: usize| match self.value_of(call.args.get(at)?, situation) {
            Ok(Reading::Number(number)) if number.is_finite() => Some(number),
            _ => None,
        };
        let apart = || {
            let (left, right) = (number(0)?, number(1)?);
            let larger = left.abs().max(right.abs()).max(f64::MIN_POSITIVE);
            Some((left - right) / larger)
        };
        match call.func_name.as_str() {
            operators::LOGICAL_NOT => Some(-margin(0)?),
            operators::LOGICAL_OR => Some(margin(0)?.max(margin(1)?)),
            operators::LOGICAL_AND => {
                let (left, right) = (margin(0)?, margin(1)?);
                Some(match left < 0.0 && right < 0.0 {
                    true => left + right,
                    false => left.min(right),
                })
            }
            operators::LESS | operators::LESS_EQUALS => Some(-apart()?),
            operators::GREATER | operators::GREATER_EQUALS => apart(),
            operators::EQUALS => Some(-apart()?.abs()),
            _ => None,
        }
    }
}
