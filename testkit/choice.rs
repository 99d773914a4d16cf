//! Any effect on a device, and any command to it, in the forms that files give them.

use std::collections::BTreeMap;
use std::fmt;
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
#[cfg_attr(feature = "proptest", derive(proptest_derive::Arbitrary))]
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
        let effects = forms(device).effects.iter();
        effects.map(move |(key, form)| (*key, form.choose(&mut std::iter::repeat(value))))
    }

    /// The effect on a device, as a step with its key reads it.
    ///
    /// # Errors
    /// When its values do not go together.
    pub fn effect(&self, device: &DeviceSpec) -> Result<Arc<dyn Effect>, String> {
        let effects = &forms(device).effects;
        let (key, form) = &effects[usize::from(self.form) % effects.len()];
        let value = form.choose(&mut self.values.into_iter());
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
        let commands = &forms(device).commands[link];
        let form = &commands[usize::from(self.form) % commands.len()];
        let value = form.choose(&mut self.values.into_iter());
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

/// What files may write at one place.
enum Form {
    /// One of these.
    Values(Vec<Value>),
    /// A whole number from the first to the second.
    Whole(i64, i64),
    /// One of these forms.
    Either(Vec<Form>),
    /// So many of the same form.
    List(usize, Box<Form>),
    /// A table of these keys; set for those that must be there, which come first, since there may be
    /// more than choices.
    Table(Vec<(String, bool, Form)>),
}

impl Form {
    fn of(root: &Json, schema: &Json) -> Self {
        let parts = schema::parts(root, schema).into_iter();
        let mut forms: Vec<Self> = parts.filter_map(|part| Self::of_part(root, part)).collect();
        match forms.len() {
            1 => forms.remove(0),
            _ => Self::Either(forms),
        }
    }

    /// The form that this part of a schema gives alone, if it gives any.
    fn of_part(root: &Json, part: &Json) -> Option<Self> {
        if let Some(properties) = part["properties"].as_object() {
            let required = part["required"].as_array().cloned().unwrap_or_default();
            let key = |(key, schema): (&String, &Json)| {
                let is_required = required.iter().any(|name| name == key);
                (key.clone(), is_required, Self::of(root, schema))
            };
            let mut keys: Vec<_> = properties.iter().map(key).collect();
            keys.sort_by_key(|(_, is_required, _)| !is_required);
            return Some(Self::Table(keys));
        }
        let items = &part["items"];
        let whole = schema::is(part, "integer") && part["const"].is_null();
        if whole {
            let low = part["minimum"].as_i64().unwrap_or(-500);
            let high = part["maximum"].as_i64().unwrap_or(i64::MAX).max(low);
            return Some(Self::Whole(low, high));
        }
        if items.is_object() {
            let count = part["minItems"].as_u64().unwrap_or(1);
            let count = usize::try_from(count).unwrap_or(1);
            return Some(Self::List(count, Box::new(Self::of(root, items))));
        }
        let values = schema::values_of_part(root, part);
        (!values.is_empty()).then_some(Self::Values(values))
    }

    fn choose(&self, choices: &mut impl Iterator<Item = u8>) -> Value {
        let mut next = || choices.next().unwrap_or(0);
        match self {
            Self::Values(values) if values.len() == 1 => values[0].clone(),
            Self::Values(values) => values[usize::from(next()) % values.len()].clone(),
            Self::Whole(low, high) => Value::from(whole(next()).clamp(*low, *high)),
            Self::Either(forms) if forms.is_empty() => Value::from("a"),
            Self::Either(forms) => forms[usize::from(next()) % forms.len()].choose(choices),
            Self::List(count, form) => {
                let value = form.choose(choices);
                Value::Array(vec![value; *count])
            }
            Self::Table(keys) => {
                let mut table = Table::new();
                for (key, is_required, form) in keys {
                    // What may be left out is, now and then.
                    if *is_required || choices.next().unwrap_or(0) % 2 == 1 {
                        table.insert(key.clone(), form.choose(choices));
                    }
                }
                Value::Table(table)
            }
        }
    }
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

/// Forms of what may be done with a device.
struct Forms {
    /// Each with the key of steps that has it.
    effects: Vec<(&'static str, Form)>,
    /// Commands by link.
    commands: Vec<Vec<Form>>,
}

impl Forms {
    fn of(device: &'static DeviceSpec) -> Self {
        let mut generator = SchemaGenerator::default();
        let commands = (device.host.schema)(&mut generator);
        let effects: Vec<_> = effect::of(device)
            .map(|group| {
                (
                    group.kinds[0].level.key(),
                    (group.schema)(&mut generator).to_value(),
                )
            })
            .collect();
        let mut root = json!({ "$defs": generator.take_definitions(true) });
        let links = device.links.iter().map(|link| link.id);
        root["$defs"]["LinkName"] = json!({ "enum": links.collect::<Vec<_>>() });
        // Those of a word have one for each.
        let alone = |schema: &Json| -> Vec<Form> {
            match Form::of(&root, schema) {
                Form::Either(forms) => forms
                    .into_iter()
                    .flat_map(|form| match form {
                        Form::Values(words) => {
                            let words = words.into_iter();
                            words.map(|word| Form::Values(vec![word])).collect()
                        }
                        form => vec![form],
                    })
                    .collect(),
                form => vec![form],
            }
        };
        let settings = (device.settings)();
        let mut by_link: Vec<Vec<Form>> = device.links.iter().map(|_| Vec::new()).collect();
        for form in commands.iter().flat_map(|schema| alone(schema.as_value())) {
            let value = form.choose(&mut std::iter::repeat(2));
            let command = read(&value, |value| (device.host.read)(value, &*settings));
            let command = command.unwrap_or_else(|error| panic!("{error}"));
            by_link[command.link].push(form);
        }
        let effects = effects.iter().flat_map(|(key, schema)| {
            let forms = alone(schema).into_iter();
            forms.map(move |form| (*key, form))
        });
        Self {
            effects: effects.collect(),
            commands: by_link,
        }
    }
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

impl fmt::Debug for Form {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.choose(&mut std::iter::repeat(0)))
    }
}

#[cfg(test)]
mod tests;
