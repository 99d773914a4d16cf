//! Any effect on a device, and any command to it, in the forms that files give them.

use std::collections::BTreeMap;
use std::sync::{Arc, LazyLock};

use rigsim_core::SHIPPED;
use rigsim_core::device::{DeviceSettings, DeviceSpec, Effect, host};
use rigsim_core::effect;
use rigsim_settings::ReadError;
use schemars::SchemaGenerator;
use serde_json::{Value as Json, json};
use toml::de::DeValue;
use toml::{Spanned, Table, Value};

use crate::schema;

/// A choice of one form and of its values; any numbers are one. What they mean is up to the device.
#[derive(Debug, Clone, Copy, PartialEq, Eq, arbitrary::Arbitrary)]
pub struct Choice {
    form: u8,
    values: [u8; 6],
}

impl Choice {
    /// Every effect of a device with the value of this number for each of its parameters, each with
    /// the key of steps that has it.
    pub(crate) fn effects(
        device: &DeviceSpec,
        value: u8,
    ) -> impl Iterator<Item = (&'static str, Value)> {
        let forms = forms(device);
        let effects = forms.effects.iter();
        effects.map(move |(key, form)| {
            let choices = &mut std::iter::repeat(value);
            (*key, choose(&forms.root, form, choices))
        })
    }

    /// The effect on a device, as a step with its key reads it.
    ///
    /// # Errors
    /// When its values do not go together.
    pub fn effect(&self, device: &DeviceSpec) -> Result<Arc<dyn Effect>, String> {
        let Forms { root, effects, .. } = forms(device);
        let (key, form) = &effects[usize::from(self.form) % effects.len()];
        let value = choose(root, form, &mut self.values.into_iter());
        let name = match &value {
            Value::Table(table) if *key == "fault" => table["kind"].as_str(),
            Value::Table(table) => table.keys().next().map(String::as_str),
            word => word.as_str(),
        };
        let name = name.unwrap_or_default().to_owned();
        read(&value, |value| effect::read(device, (key, &name), value))
            .map(|effect| effect.unwrap_or_else(|| panic!("{device:?} has no {key} {name}")))
    }

    /// The command to a device, of those that a link takes.
    ///
    /// # Errors
    /// When its values do not go together.
    pub fn command(
        &self,
        device: &DeviceSpec,
        link: usize,
        settings: &dyn DeviceSettings,
    ) -> Result<host::Message, String> {
        let Forms { root, commands, .. } = forms(device);
        let commands = &commands[link];
        let form = &commands[usize::from(self.form) % commands.len()];
        let value = choose(root, form, &mut self.values.into_iter());
        read(&value, |value| (device.host.read)(value, settings))
    }
}

fn read<T>(
    value: &Value,
    read: impl FnOnce(&Spanned<DeValue<'_>>) -> Result<T, ReadError>,
) -> Result<T, String> {
    let text = value.to_string();
    let value = DeValue::parse(&text).unwrap_or_else(|error| panic!("{text}: {error}"));
    read(&value).map_err(|error| format!("{text}: {error}"))
}

/// A value that a schema allows, as the choices say.
fn choose(root: &Json, schema: &Json, choices: &mut impl Iterator<Item = u8>) -> Value {
    let mut pick = |count: usize| match count {
        1 => 0,
        count => usize::from(choices.next().unwrap_or(0)) % count,
    };
    let parts = forms_of(root, schema);
    if parts.is_empty() {
        return Value::from("a");
    }
    let part = parts[pick(parts.len())];
    if let Some(properties) = part["properties"].as_object() {
        let required = part["required"].as_array().cloned().unwrap_or_default();
        let is_required = |key: &str| required.iter().any(|name| name == key);
        // What must be there comes first, since there may be more keys than choices.
        let mut keys: Vec<_> = properties.iter().collect();
        keys.sort_by_key(|(key, _)| !is_required(key));
        let mut table = Table::new();
        for (key, schema) in keys {
            // What may be left out is, now and then.
            if is_required(key) || choices.next().unwrap_or(0) % 2 == 1 {
                table.insert(key.clone(), choose(root, schema, choices));
            }
        }
        return Value::Table(table);
    }
    if is_whole(part) {
        let low = part["minimum"].as_i64().unwrap_or(-500);
        let high = part["maximum"].as_i64().unwrap_or(i64::MAX).max(low);
        return Value::from(whole(choices.next().unwrap_or(0)).clamp(low, high));
    }
    if part["items"].is_object() {
        let count = part["minItems"].as_u64().unwrap_or(1);
        let value = choose(root, &part["items"], choices);
        return Value::Array(vec![value; usize::try_from(count).unwrap_or(1)]);
    }
    let values = schema::values_of_part(root, part);
    values[pick(values.len())].clone()
}

/// The parts of a schema that allow something by themselves.
fn forms_of<'s>(root: &'s Json, schema: &'s Json) -> Vec<&'s Json> {
    let mut parts = schema::parts(root, schema);
    parts.retain(|part| {
        part["properties"].is_object()
            || is_whole(part)
            || part["items"].is_object()
            || !schema::values_of_part(root, part).is_empty()
    });
    parts
}

fn is_whole(part: &Json) -> bool {
    schema::is(part, "integer") && part["const"].is_null()
}

/// Small numbers, the ends of ranges, and some thousand.
fn whole(choice: u8) -> i64 {
    let number = i64::from(choice % 64);
    match choice / 64 {
        0 => [i64::MIN, i64::MAX, 1, 2, 7, 300, 0, -1][usize::from(choice % 8)],
        1 => number - 8,
        2 => 25 * number,
        _ => -25 * number,
    }
}

/// Schemas of what may be done with a device, each of one form.
struct Forms {
    /// Where they refer to.
    root: Json,
    /// Each with the key of steps that has it.
    effects: Vec<(&'static str, Json)>,
    /// Commands by link.
    commands: Vec<Vec<Json>>,
}

impl Forms {
    fn of(device: &'static DeviceSpec) -> Self {
        let mut generator = SchemaGenerator::default();
        let commands = (device.host.schema)(&mut generator);
        let effects: Vec<_> = effect::of(device)
            .map(|group| {
                let key = group.kinds[0].level.key();
                (key, (group.schema)(&mut generator).to_value())
            })
            .collect();
        let mut root = json!({ "$defs": generator.take_definitions(true) });
        let links = device.links.iter().map(|link| link.id);
        root["$defs"]["LinkName"] = json!({ "enum": links.collect::<Vec<_>>() });
        let settings = (device.settings)();
        let mut by_link: Vec<Vec<Json>> = device.links.iter().map(|_| Vec::new()).collect();
        for form in commands
            .iter()
            .flat_map(|schema| alone(&root, schema.as_value()))
        {
            let value = choose(&root, &form, &mut std::iter::repeat(2));
            let command = read(&value, |value| (device.host.read)(value, &*settings));
            let command = command.unwrap_or_else(|error| panic!("{error}"));
            by_link[command.link].push(form);
        }
        let effects = effects.iter().flat_map(|(key, schema)| {
            let forms = alone(&root, schema).into_iter();
            forms.map(move |form| (*key, form))
        });
        Self {
            effects: effects.collect(),
            commands: by_link,
            root,
        }
    }
}

/// The forms of a schema. Those of a word have one for each.
fn alone(root: &Json, schema: &Json) -> Vec<Json> {
    let forms = forms_of(root, schema);
    let is_one = forms.len() == 1;
    let words = |part: &Json| match part["enum"].as_array() {
        Some(words) if !is_one => words.iter().map(|word| json!({ "const": word })).collect(),
        _ => vec![part.clone()],
    };
    forms.into_iter().flat_map(words).collect()
}

fn forms(device: &DeviceSpec) -> &'static Forms {
    static FORMS: LazyLock<BTreeMap<&str, Forms>> = LazyLock::new(|| {
        let all = SHIPPED.iter();
        all.map(|device| (device.id, Forms::of(device))).collect()
    });
    FORMS
        .get(device.id)
        .unwrap_or_else(|| panic!("{device:?} is not shipped"))
}

#[cfg(test)]
mod tests;
