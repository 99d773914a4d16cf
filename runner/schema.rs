//! JSON Schemas that are put together from what each device adds.

use rigsim_core::device::Devices;
use schemars::generate::SchemaSettings;
use schemars::{JsonSchema, Schema, SchemaGenerator};
use serde_json::{Map, Value, json};

/// The schema of `T`, in which `change` has replaced definitions.
pub(crate) fn compose<T: JsonSchema>(
    devices: Devices,
    change: impl FnOnce(Devices, &mut SchemaGenerator) -> Vec<(&'static str, Value)>,
) -> String {
    let mut generator = SchemaSettings::draft2020_12().into_generator();
    let changed = change(devices, &mut generator);
    let mut schema = generator.root_schema_for::<T>().to_value();
    for (name, definition) in changed {
        schema["$defs"][name] = definition;
    }
    format!("{schema:#}\n")
}

/// One of several, each a word, a table with one key, or one with a `kind`.
pub(crate) fn one_of(about: &str, alternatives: Vec<Schema>) -> Value {
    let mut all: Vec<(String, Value)> = Vec::new();
    for (name, own) in alternatives.into_iter().flat_map(split) {
        match all.iter_mut().find(|(known, _)| *known == name) {
            Some((_, known)) => join(known, &name, &own),
            None => all.push((name, own)),
        }
    }
    let all: Vec<Value> = all.into_iter().map(|(_, own)| own).collect();
    json!({ "description": about, "oneOf": all })
}

fn split(schema: Schema) -> Vec<(String, Value)> {
    let schema = schema.to_value();
    let parts = match schema["oneOf"].as_array() {
        Some(parts) => parts.clone(),
        None => vec![schema],
    };
    parts.into_iter().flat_map(named).collect()
}

fn named(part: Value) -> Vec<(String, Value)> {
    if let Some(word) = part["const"].as_str() {
        return vec![(word.to_owned(), part)];
    }
    if let Some(words) = part["enum"].as_array() {
        let word = |word: &Value| {
            let name = word.as_str()?.to_owned();
            Some((name.clone(), json!({ "type": "string", "const": name })))
        };
        return words.iter().filter_map(word).collect();
    }
    let properties = part["properties"].as_object();
    if let Some(kind) = part["properties"]["kind"]["const"].as_str() {
        return vec![(kind.to_owned(), part)];
    }
    let name = properties.and_then(|all| all.keys().next().cloned());
    name.map(|name| (name, part)).into_iter().collect()
}

/// Two devices have an alternative of one name.
fn join(known: &mut Value, name: &str, other: &Value) {
    if let (Some(one), Some(two)) = (known["description"].as_str(), other["description"].as_str())
        && one != two
    {
        known["description"] = format!("{one} {two}").into();
    }
    if known["properties"]["kind"].is_object() {
        let more = other["properties"].as_object().cloned();
        add_properties(known, more.unwrap_or_default());
    } else if let Some(properties) = known.get_mut("properties") {
        let both = [properties[name].take(), other["properties"][name].clone()];
        properties[name] = json!({ "anyOf": both });
    }
}

/// A word of a list, with what each means.
pub(crate) fn words<'a>(words: impl Iterator<Item = (&'a str, &'a str)>) -> Value {
    let words: Vec<Value> = words
        .map(|(word, about)| json!({ "type": "string", "const": word, "description": about }))
        .collect();
    json!({ "oneOf": words })
}

/// Adds properties to a table.
pub(crate) fn add_properties(table: &mut Value, more: Map<String, Value>) {
    if let Some(properties) = table["properties"].as_object_mut() {
        properties.extend(more);
    }
}
