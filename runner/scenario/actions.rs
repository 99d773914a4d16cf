//! Effects of steps: faults, actions of operators, changes around a vehicle.

use rigsim_core::effect::{self, Checked};
use rigsim_settings::{Part, ReadError, Wrong, nearest, or_allowed, read as read_value};
use serde::de::Error as _;
use toml::Spanned;
use toml::de::DeValue;

use crate::forgiving::find;
use crate::renamed::{self, Kind, is_like};
use crate::rig_file::DevicePlan;

/// The keys under which steps have effects, each with how one is written.
const KEYS: [(&str, &str, &str); 3] = [
    ("fault", "{ kind = \"", "\" }"),
    ("operator", "\"", "\""),
    ("world", "{ ", " = … }"),
];

/// Reads what a step does under this key, and checks it for the device.
pub(super) fn read(
    key: &str,
    value: &Spanned<DeValue<'_>>,
    plan: &DevicePlan,
) -> Result<Checked, ReadError> {
    let name = match (key, value.get_ref()) {
        ("fault", DeValue::Table(table)) => {
            let kind = table.get("kind");
            let kind = kind.ok_or_else(|| ReadError::missing_field("kind"))?;
            read_value::<String>(kind).map_err(|error| at_kind(error, kind))?
        }
        ("fault", _) => {
            let why = "a fault is a table, as in `{ kind = \"mute\" }`";
            return Err(ReadError::custom(why));
        }
        _ => name_of(value).unwrap_or_default().to_owned(),
    };
    if name.is_empty() {
        let known = effect::names(plan.device, key).join(", ");
        let why = format!("one thing is done by a step; allowed: {known}");
        return Err(ReadError::custom(why));
    }
    let read = effect::read(plan.device, (key, &name), value);
    match read.map_err(|error| explained(error, (key, &name), value, plan))? {
        Some(effect) => {
            let checked = Checked::new(effect, plan.device, plan.ports.len());
            checked.map_err(ReadError::custom)
        }
        None => {
            let error = ReadError::custom(unknown(key, &name, plan));
            let table = value.get_ref().as_table().filter(|_| key == "fault");
            Err(match table.and_then(|table| table.get("kind")) {
                Some(kind) => at_kind(error, kind),
                None => error,
            })
        }
    }
}

fn at_kind(error: ReadError, kind: &Spanned<DeValue<'_>>) -> ReadError {
    error.inside(Part::Key("kind".to_owned()), &kind.span())
}

/// Why a device has no effect of this name under this key.
fn unknown(key: &str, name: &str, plan: &DevicePlan) -> String {
    let of_key = |kind: Kind| matches!(kind, Kind::Effect(known) if known == key);
    if let Some(renamed) = renamed::find(of_key, name) {
        return renamed.to_string();
    }
    let (title, id) = (plan.device.title, plan.device.id);
    for (other, before, behind) in KEYS.iter().filter(|(other, ..)| *other != key) {
        let mut names = effect::names(plan.device, other).into_iter();
        if let Some(name) = names.find(|known| is_like(known, name)) {
            return format!("{title} has `{name}` as `{other} = {before}{name}{behind}`");
        }
    }
    let names = effect::names(plan.device, key);
    match (key, nearest(name, &names)) {
        ("fault", Some(near)) => format!("{title} cannot have `{name}`; did you mean `{near}`?"),
        ("fault", None) => format!(
            "{title} cannot have `{name}`; `sim faults --device {id}` lists what it can have"
        ),
        _ => format!("{title} has no `{name}`; {}", or_allowed(name, &names)),
    }
}

/// An error that says what an action is for that lacks its value, and of the words that are allowed
/// those that this device takes.
fn explained(
    mut error: ReadError,
    (key, name): (&str, &str),
    value: &Spanned<DeValue<'_>>,
    plan: &DevicePlan,
) -> ReadError {
    let takes = |word: &str| {
        let mut value = value.clone();
        let place = find(&mut value, &error.path)?;
        *place.get_mut() = DeValue::String(word.to_owned().into());
        let effect = effect::read(plan.device, (key, name), &value).ok()??;
        Checked::new(effect, plan.device, plan.ports.len()).ok()
    };
    let explained = match &error.why {
        Wrong::NeedsValue(_) => {
            let all = effect::of(plan.device).flat_map(|effects| effects.kinds);
            let mut all = all.filter(|info| info.level.key() == key && info.id == name);
            let about = all.next().map_or("", |info| info.summary);
            Wrong::Other(format!("{}: {about}", error.why))
        }
        Wrong::UnknownWord(word, allowed) => {
            let taken = allowed.iter().filter(|word| takes(word).is_some());
            match taken.copied().collect::<Vec<_>>() {
                none if none.is_empty() => return error,
                taken => Wrong::UnknownWord(word.clone(), taken),
            }
        }
        _ => return error,
    };
    error.why = explained;
    error
}

/// Name of a word or a table with one key: `unlock`, or `press` of `{ press = "left" }`.
fn name_of<'d>(value: &'d Spanned<DeValue<'_>>) -> Option<&'d str> {
    match value.get_ref() {
        DeValue::String(word) => Some(word),
        DeValue::Table(table) if table.len() == 1 => {
            table.keys().next().map(|key| key.get_ref().as_ref())
        }
        _ => None,
    }
}
