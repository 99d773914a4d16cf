//! The reference of scenario files as a page, printed from their JSON Schema.

use std::collections::{BTreeSet, VecDeque};
use std::fmt::Write as _;

use rigsim_core::device::Devices;
use rigsim_core::event::Code;
use serde_json::{Map, Value};

/// Value of the keys called `settings`, which are too many for a cell.
const SETTINGS: &str = "`sim config`";
/// Definitions that have their own page or list.
const ELSEWHERE: [(&str, &str); 2] = [
    ("Fault", "[faults.md](faults.md)"),
    ("SettingsText", SETTINGS),
];

/// Returns the page: every key of a scenario file, its words, and the kinds of the client report.
pub(crate) fn page(schema: &Value, devices: Devices) -> String {
    let mut page = Page {
        text: String::from(
            "# Scenario files: reference\n\nThis page lists every key. `sim schema scenario --format markdown` \
             prints it; [scenarios.md](scenarios.md) is the tutorial.\n\nUnknown keys are errors. Quantities \
             are texts with a unit: `\"250 ms\"`, `\"48 V\"`. Lists are written `key = [{ … }]` or as `[[key]]`, \
             not both in one file.\n",
        ),
        definitions: schema["$defs"].as_object(),
        queue: VecDeque::new(),
        seen: ELSEWHERE
            .iter()
            .map(|(name, _)| (*name).to_owned())
            .collect(),
    };
    page.section("The file", schema);
    while let Some(name) = page.queue.pop_front() {
        if let Some(definition) = page.definitions.and_then(|all| all.get(&name)) {
            page.section(title(&name), definition);
        }
    }
    page.client_report(devices);
    page.text
}

struct Page<'a> {
    text: String,
    definitions: Option<&'a Map<String, Value>>,
    /// Definitions that were referred to and not printed yet, in that order.
    queue: VecDeque<String>,
    seen: BTreeSet<String>,
}

impl Page<'_> {
    fn section(&mut self, title: &str, schema: &Value) {
        let about = one_line(schema);
        // Writing to a string cannot fail.
        let _ = write!(self.text, "\n## {title}\n\n{about}\n");
        if let Some(keys) = schema["properties"].as_object() {
            // A file without a base needs more than one with it.
            let alone = &schema["anyOf"][0]["required"];
            let required = schema.get("required").unwrap_or(alone);
            self.keys(keys, required);
        }
        // With keys, `anyOf` says only which of them are required.
        let choices = ["oneOf", "anyOf"].map(|key| schema[key].as_array());
        if let (None, Some(choices)) = (
            schema.get("properties"),
            choices.into_iter().flatten().next(),
        ) {
            self.choices(choices);
        }
        if let Some(words) = schema["enum"].as_array() {
            let words: Vec<String> = words.iter().map(code).collect();
            let _ = write!(self.text, "\n{}\n", words.join(", "));
        }
    }

    fn keys(&mut self, keys: &Map<String, Value>, required: &Value) {
        self.text += "\n| key | value | default | |\n|---|---|---|---|\n";
        let required: BTreeSet<&str> = required
            .as_array()
            .into_iter()
            .flatten()
            .filter_map(Value::as_str)
            .collect();
        // What is required first, the rest by name.
        let (first, rest): (Vec<_>, Vec<_>) = keys
            .iter()
            .partition(|(key, _)| required.contains(key.as_str()));
        for (key, schema) in first.into_iter().chain(rest) {
            let default = match schema.get("default") {
                _ if required.contains(key.as_str()) => "required".to_owned(),
                None | Some(Value::Null) => String::new(),
                Some(default) => code(default),
            };
            let value = if key == "settings" {
                SETTINGS.to_owned()
            } else {
                self.value(schema)
            };
            let about = one_line(schema);
            let _ = writeln!(self.text, "| `{key}` | {value} | {default} | {about} |");
        }
    }

    fn choices(&mut self, choices: &[Value]) {
        self.text += "\n| one of | value | |\n|---|---|---|\n";
        for choice in choices {
            let about = one_line(choice);
            match choice["properties"].as_object() {
                Some(keys) => {
                    for (key, schema) in keys {
                        let value = self.value(schema);
                        let _ = writeln!(self.text, "| `{key}` | {value} | {about} |");
                    }
                }
                None => {
                    let value = self.value(choice);
                    let _ = writeln!(self.text, "| {value} | | {about} |");
                }
            }
        }
    }

    /// Returns a value's type in words, with links to the definitions that it refers to.
    fn value(&mut self, schema: &Value) -> String {
        if let Some(target) = schema["$ref"].as_str() {
            return self.reference(target.trim_start_matches("#/$defs/"));
        }
        if let Some(word) = schema.get("const") {
            return code(word);
        }
        let choices = ["oneOf", "anyOf", "enum"].map(|key| schema[key].as_array());
        if let Some(choices) = choices.into_iter().flatten().next() {
            let all: Vec<String> = choices
                .iter()
                .filter(|choice| choice["type"] != "null" && !choice.is_null())
                .map(|choice| match choice {
                    Value::Object(_) => self.value(choice),
                    word => code(word),
                })
                .collect();
            return all.join(", ");
        }
        let kinds = match &schema["type"] {
            Value::Array(kinds) => kinds.iter().filter_map(Value::as_str).collect(),
            kind => Vec::from_iter(kind.as_str()),
        };
        match kinds.into_iter().find(|kind| *kind != "null") {
            Some("array") => format!("list of {}", self.value(&schema["items"])),
            Some("object") => match schema["properties"].as_object() {
                Some(keys) => {
                    let each = keys.iter().map(|(key, schema)| {
                        let about = one_line(schema);
                        let about = about.trim_end_matches('.');
                        format!("`{key}`: {}, {about}", self.value(schema))
                    });
                    each.collect::<Vec<_>>().join("; ")
                }
                None => "table".to_owned(),
            },
            Some("boolean") => "`true`, `false`".to_owned(),
            Some("string") => "text".to_owned(),
            Some(_) => match (schema["minimum"].as_f64(), schema["maximum"].as_f64()) {
                (Some(least), Some(most)) if least < most => format!("number, {least} to {most}"),
                (Some(only), Some(_)) => format!("`{only}`"),
                _ => "number".to_owned(),
            },
            None => String::new(),
        }
    }

    /// Returns what stands for a definition, which gets its own section unless it is short.
    fn reference(&mut self, name: &str) -> String {
        if let Some((_, place)) = ELSEWHERE.iter().find(|(elsewhere, _)| *elsewhere == name) {
            return (*place).to_owned();
        }
        let definition = self.definitions.and_then(|all| all.get(name));
        match definition.and_then(|definition| definition["examples"][0].as_str()) {
            // A quantity: an example says more than its name.
            Some(example) => format!("as `\"{example}\"`"),
            None if definition.is_some_and(|all| all["type"] == "number") => "number".to_owned(),
            None => {
                if self.seen.insert(name.to_owned()) {
                    self.queue.push_back(name.to_owned());
                }
                let title = title(name);
                format!("[{title}](#{})", title.to_lowercase().replace(' ', "-"))
            }
        }
    }

    fn client_report(&mut self, devices: Devices) {
        self.text += "\n## Kinds of the client report\n\nErrors of a client, by the name that \
                      `client_report` uses.\n";
        let every: (&str, &[Code]) = ("of any device", rigsim_core::event::code::CODES);
        let of_devices = devices.iter().map(|device| (device.id, device.codes));
        for (of, codes) in std::iter::once(every).chain(of_devices) {
            let _ = write!(self.text, "\n| {of} | |\n|---|---|\n");
            for kind in codes.iter().filter(|kind| kind.may_be_client_error()) {
                let _ = writeln!(self.text, "| `{kind}` | {} |", kind.about);
            }
        }
    }
}

fn title(name: &str) -> &str {
    name.strip_suffix("Text").unwrap_or(name)
}

fn code(value: &Value) -> String {
    match value.as_str() {
        Some(text) => format!("`\"{text}\"`"),
        None => format!("`{value}`"),
    }
}

/// Returns a description on one line, for a cell.
fn one_line(schema: &Value) -> String {
    let about = schema["description"].as_str().unwrap_or_default();
    about.replace('\n', " ").replace('|', "\\|")
}
