//! Reading of rules, responses and the demand on the client report.

use std::collections::BTreeSet;
use std::ops::Range;

use rigsim_core::device::client_report_codes;
use rigsim_settings::or_allowed;
use toml::Spanned;

use super::Checker;
use crate::scenario::document::{DemandText, ResponseText, RuleText};
use crate::scenario::{Cause, Demand, Response, Rule};

impl Checker<'_> {
    /// Those that a file changes by name need different names.
    pub(super) fn check_rule_names<'n>(&mut self, names: impl Iterator<Item = &'n str>) {
        let mut seen = BTreeSet::new();
        for name in names.filter(|name| !seen.insert(*name)) {
            let why = format!("two rules of a kind are named \"{name}\"");
            self.problems.add_to_file(&why);
        }
    }

    pub(super) fn response(&mut self, spanned: &Spanned<ResponseText>) -> Option<Response> {
        let (text, at) = (spanned.get_ref(), spanned.span());
        let whenever = text.whenever.as_ref();
        let whenever = whenever.map(|whenever| self.condition(whenever).map(Cause::Whenever));
        let step = text.step.as_ref();
        let step = step.map(|name| self.step_named(name).map(Cause::Step));
        if whenever.is_some() == step.is_some()
            && !self.left_out.lacks(at.start, &["whenever", "step"])
        {
            let why = "exactly one of `whenever` and `step` says what this is a response to";
            self.problems.add(at, why);
        }
        let to = whenever.or(step).flatten();
        let then = self.condition(&text.then);
        let within = text.within.unwrap_or_default().0;
        if let Some(until) = text.until.as_ref().filter(|u| u.get_ref().0 < within) {
            self.problems.add(until.span(), "is before `within`");
        }
        Some(Response {
            to: to?,
            then: then?,
            optional: text.optional,
            within,
            until: text.until.as_ref().map(|until| until.get_ref().0),
            message: text.message.clone(),
            only: text.only,
            mission: text.mission,
        })
    }

    pub(super) fn rule(
        &mut self,
        text: &RuleText,
        must_hold: bool,
    ) -> Option<(Rule, Option<Range<usize>>)> {
        let that = self.condition(&text.that);
        let after = text.after.as_ref();
        let after = after.and_then(|name| self.step_named(name));
        let from = text.from.unwrap_or_default().0;
        let until = text.until.as_ref().map(|until| until.get_ref().0);
        if let Some(spanned) = &text.until
            && spanned.get_ref().0 < from
        {
            self.problems.add(spanned.span(), "is before `from`");
        }
        let rule = Rule {
            that: that?,
            must_hold,
            message: text.message.clone(),
            longer_than: text.longer_than.unwrap_or_default().0,
            from,
            until,
            after,
            only: text.only,
            mission: text.mission,
        };
        Some((rule, text.after.as_ref().map(Spanned::span)))
    }

    pub(super) fn demand(&mut self, text: &Spanned<DemandText>) -> Demand {
        let DemandText::Kinds(kinds) = text.get_ref() else {
            return Demand {
                allowed: Some(Vec::new()),
                forbidden: Vec::new(),
                only: None,
            };
        };
        let known: Vec<&str> = client_report_codes(self.rig.settings.table()).collect();
        for kind in kinds.allowed.iter().chain(&kinds.forbidden).flatten() {
            if !known.contains(&kind.as_str()) {
                let allowed = or_allowed(kind, &known);
                let why = format!("the client report has no kind `{kind}`; {allowed}");
                self.problems.add(text.span(), &why);
            }
        }
        if kinds.allowed.is_some() == kinds.forbidden.is_some() {
            let why = "exactly one of `allowed` and `forbidden` says what may be in it";
            self.problems.add(text.span(), why);
        }
        Demand {
            allowed: kinds.allowed.clone(),
            forbidden: kinds.forbidden.clone().unwrap_or_default(),
            only: kinds.only,
        }
    }
}
