//! Steps of a scenario, and what its schema does not say of them.

use toml::{Table, Value};

use super::{Writer, table};
use crate::fault::FaultChoice;

/// Keys of which only one may be there, by what has them.
const EXCLUSIVE: &[(&str, &[&str])] = &[
    ("HostText", &["send", "bytes", "port", "baud"]),
    ("ReplyText", &["reply", "bytes", "silence"]),
    ("LoadText", &["power", "resistance", "short"]),
    ("PowerText", &["on", "status"]),
    ("KindsText", &["allowed", "forbidden"]),
];

impl Writer<'_> {
    /// Returns what has a name in the schema.
    pub(super) fn defined(&mut self, name: &str, key: &str) -> Value {
        let schema = &self.schema["$defs"][name];
        if name == "Fault" {
            return self.fault();
        }
        if name == "RangeText" {
            let least = Value::from("0 s");
            let most = self.defined("Span", "max");
            return table([("min", least), ("max", most)]);
        }
        if name == "SignalText" {
            let generator = &["from_output"][..];
            let output = &["frequency", "duty", "high"][..];
            let left_out = if self.choices.once_in(2) {
                output
            } else {
                generator
            };
            return self.object(schema, left_out);
        }
        let exclusive = EXCLUSIVE.iter().find(|(own, _)| *own == name);
        let Some((_, exclusive)) = exclusive else {
            return self.value(schema, key);
        };
        let one = exclusive[self.choices.below(exclusive.len())];
        let fields = matches!(one, "reply" | "allowed" | "forbidden");
        let mut table = match self.object(schema, exclusive) {
            Value::Table(table) => table,
            other => return other,
        };
        let property = schema["properties"][one].clone();
        let value = match (one, fields) {
            ("reply", _) => Value::Table(Table::new()),
            (_, true) => Value::Array(vec![Value::from("over_rate")]),
            ("short" | "silence", _) => Value::from(true),
            _ => self.value(&property, one),
        };
        table.insert(one.to_owned(), value);
        Value::Table(table)
    }

    /// Any fault that this kind of device has, or now and then one that it has not.
    fn fault(&mut self) -> Value {
        let mut fault = FaultChoice::new([0; 7].map(|_| self.choices.byte()));
        for _ in 0..200 {
            let is_for_it = self.kind.is_none_or(|kind| fault.is_for(kind));
            if is_for_it || self.choices.is_odd() {
                break;
            }
            fault = fault.next();
        }
        Value::Table(fault.table())
    }

    /// Steps, and conditions over time.
    pub(super) fn steps(&mut self, document: &mut Table) {
        let count = self.choices.below(9);
        let steps: Vec<Value> = (0..count).map(|index| self.step(index)).collect();
        document.insert("step".to_owned(), Value::Array(steps));
        for list in ["always", "never"] {
            let rules: Vec<Value> = (0..self.choices.below(3))
                .map(|_| {
                    let schema = &self.schema["$defs"]["RuleText"];
                    let mut left_out = vec!["until", "after"];
                    if self.choices.once_in(2) {
                        left_out.push("from");
                    }
                    let mut rule = self.object(schema, &left_out);
                    if let Value::Table(rule) = &mut rule
                        && count > 0
                        && self.choices.once_in(3)
                    {
                        let after = format!("s{}", self.choices.below(count));
                        rule.insert("after".to_owned(), Value::from(after));
                    }
                    rule
                })
                .collect();
            document.insert(list.to_owned(), Value::Array(rules));
        }
        let responses: Vec<Value> = (0..self.choices.below(3))
            .map(|_| {
                let schema = &self.schema["$defs"]["ResponseText"];
                let mut response = self.object(schema, &["step", "whenever", "until"]);
                if let Value::Table(response) = &mut response {
                    let (cause, value) = if count > 0 && self.choices.once_in(2) {
                        ("step", format!("s{}", self.choices.below(count)))
                    } else {
                        ("whenever", self.condition())
                    };
                    response.insert(cause.to_owned(), Value::from(value));
                }
                response
            })
            .collect();
        document.insert("response".to_owned(), Value::Array(responses));
        if self.choices.once_in(4) {
            let report = self.value(&self.schema["$defs"]["DemandText"], "client_report");
            document.insert("client_report".to_owned(), report);
        }
    }

    fn step(&mut self, index: usize) -> Value {
        let device = self.choices.pick(&self.devices).cloned();
        let Some((name, kind)) = device else {
            return self.odd();
        };
        self.speak_of(kind);
        let mut step = Table::new();
        let mut put = |key: &str, value: Value| step.insert(key.to_owned(), value);
        put("name", Value::from(format!("s{index}")));
        put("device", Value::from(name));
        match self.choices.below(4) {
            0 | 1 => {
                let at = self.defined("TimeText", "at");
                put("at", at);
            }
            2 if index > 0 => {
                // Now and then one that is not there, or that waits for this one.
                let before = if self.choices.is_odd() {
                    index + 1
                } else {
                    index
                };
                let after = format!("s{}", self.choices.below(before));
                put("after", Value::from(after));
                if self.choices.once_in(2) {
                    let delay = self.defined("Span", "delay");
                    put("delay", delay);
                }
            }
            _ => {
                let when = self.condition();
                put("when", Value::from(when));
                put("may_not_trigger", Value::from(true));
            }
        }
        let has_links = kind.links.len() > 1;
        let (key, named) = [
            ("host", "HostText"),
            ("fault", "Fault"),
            ("operator", "OperatorText"),
            ("world", "WorldText"),
            ("expect", "ExpectText"),
        ][self.choices.below(5)];
        let mut action = self.defined(named, key);
        if let Value::Table(action) = &mut action {
            self.mend(action, has_links);
        }
        if key == "fault" && self.choices.once_in(2) {
            let lasts = self.defined("TimeText", "for");
            put("for", lasts);
        }
        if key == "fault" && self.choices.once_in(4) {
            let until = self.condition();
            put("until", Value::from(until));
        }
        if self.choices.once_in(4) {
            let value = self.condition();
            put("remember", table([("x0", Value::from(value))]));
        }
        put(key, action);
        if self.choices.once_in(4) && !self.choices.is_odd() {
            let every = ["70 ms", "200 ms", "50 ms"][self.choices.below(3)];
            put("every", Value::from(every));
            let count = i64::try_from(self.choices.below(6)).unwrap_or(0) + 1;
            put("count", Value::from(count));
        }
        if self.choices.once_in(8) {
            put("probability", Value::from(0.5));
        }
        if self.choices.is_odd() {
            let odd = self.odd();
            put(
                ["at", "every", "clear", "for", "device"][self.choices.below(5)],
                odd,
            );
        }
        Value::Table(step)
    }

    /// Makes fit what goes together in an action.
    fn mend(&mut self, action: &mut Table, has_links: bool) {
        if !has_links {
            action.remove("link");
        }
        if let Some(add) = action.get_mut("add") {
            let circle = table([
                ("name", Value::from("o0")),
                ("at_m", Value::Array([1.0, 0.5].map(Value::from).into())),
                ("radius", Value::from("0.2 m")),
            ]);
            *add = table([("circle", Value::Array(vec![circle]))]);
        }
    }
}
