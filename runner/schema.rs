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

/// One of several, each a word, a table with one key, or one with a `kind`. Two devices may have one of
/// the same name.
pub(crate) fn one_of(about: &str, groups: Vec<Schema>) -> Value {
    let mut all: Vec<Value> = Vec::new();
    for group in groups.into_iter().map(Schema::to_value) {
        let parts = match group["oneOf"].as_array() {
            Some(parts) => parts.clone(),
            None => vec![group],
        };
        for part in parts {
            if !all.contains(&part) {
                all.push(part);
            }
        }
    }
    json!({ "description": about, "anyOf": all })
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
