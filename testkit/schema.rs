//! What the JSON Schemas of files say of a value.

use serde_json::Value as Json;
use toml::Value;

pub(crate) fn parsed(text: &str) -> Json {
    serde_json::from_str(text).unwrap_or_else(|error| panic!("{error}"))
}

/// The schemas that stand for one: itself, the one that it refers to, and its alternatives.
pub fn parts<'s>(root: &'s Json, schema: &'s Json) -> Vec<&'s Json> {
    let target = schema["$ref"].as_str().map(|name| &name[1..]);
    let target = target.and_then(|name| root.pointer(name));
    let alternatives = ["anyOf", "oneOf"].map(|key| schema[key].as_array());
    let alternatives = alternatives.into_iter().flatten().flatten();
    let others = target.into_iter().chain(alternatives);
    let others = others.flat_map(|other| parts(root, other));
    std::iter::once(schema).chain(others).collect()
}

/// The keys that a table of this schema may have, each with its own schema.
pub fn properties<'s>(root: &'s Json, schema: &'s Json) -> Vec<(&'s str, &'s Json)> {
    let parts = parts(root, schema).into_iter();
    let properties = parts.filter_map(|part| part["properties"].as_object());
    let keys = properties.flatten();
    keys.map(|(key, schema)| (key.as_str(), schema)).collect()
}

/// Values that a schema names: words, the ends of ranges, examples, and a few where it names none.
pub fn values(root: &Json, schema: &Json) -> Vec<Value> {
    let parts = parts(root, schema).into_iter();
    parts.flat_map(|part| values_of_part(root, part)).collect()
}

/// Returns whether this part of a schema allows values of a type.
pub(crate) fn is(part: &Json, kind: &str) -> bool {
    let of = &part["type"];
    *of == *kind || of.as_array().is_some_and(|all| all.contains(&kind.into()))
}

/// Those of one of its [parts].
pub(crate) fn values_of_part(root: &Json, part: &Json) -> Vec<Value> {
    let lists = ["enum", "examples"].map(|key| part[key].as_array());
    let ends = ["const", "minimum", "maximum"].map(|key| part.get(key));
    let named = lists.into_iter().flatten().flatten();
    let named = named.chain(ends.into_iter().flatten());
    let mut values: Vec<Value> = named
        .filter_map(|value| Value::try_from(value).ok())
        .collect();
    if is(part, "boolean") {
        values.extend([true, false].map(Value::from));
    }
    if is(part, "integer") {
        let low = part["minimum"].as_i64().unwrap_or(-500);
        let high = part["maximum"].as_i64().unwrap_or(i64::MAX).max(low);
        values.extend([1, 2, 7, 300].map(|number| Value::from(number.clamp(low, high))));
    }
    if is(part, "number") && part["minimum"].is_null() {
        values.extend([-2.0, 0.0, 0.5, 1.0].map(Value::from));
    }
    if is(part, "array") {
        let count = part["minItems"].as_u64().unwrap_or(1);
        let count = usize::try_from(count).unwrap_or(1);
        let items = self::values(root, &part["items"]).into_iter();
        values.extend(items.map(|item| Value::Array(vec![item; count])));
    }
    values
}
