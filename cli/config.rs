//! Effective settings: defaults, then the file, then the flags.

use std::io::{self, Read as _};
use std::path::Path;

use anyhow::{Context as _, anyhow};
use rigsim_core::device::{DeviceSpec, Devices};
use rigsim_core::settings::SimSettings;
use rigsim_runner::renamed;
use rigsim_settings::{
    Entry, Origin, Settings as _, load_toml, parse_assignment, set, show_entry, show_toml,
};

use crate::args::SettingsArgs;
use crate::exit::{Exit, Failure, refuse};
use crate::patient_file::PatientFile;
use crate::print::print;
use crate::visible;

/// The largest file that is read.
const MOST_BYTES: u64 = 1 << 20;

/// Reads the settings that the flags name: the file, then single ones.
pub(crate) fn load(devices: Devices, args: &SettingsArgs) -> Result<SimSettings, Failure> {
    let mut settings = load_file(devices, args)?;
    apply_flags(args, &mut settings)?;
    Ok(settings)
}

/// Reads the settings file, if one is named.
pub(crate) fn load_file(devices: Devices, args: &SettingsArgs) -> Result<SimSettings, Failure> {
    let mut settings = SimSettings::new(devices);
    if let Some(path) = &args.config {
        let text = read(path, "settings file")?;
        load_toml(&text, &visible::name(path), &mut settings).map_err(|errors| {
            let lines: Vec<String> = errors.iter().map(renamed::in_words).collect();
            Failure::usage(anyhow!(lines.join("\n")))
        })?;
    }
    Ok(settings)
}

/// Applies the settings that are given one by one.
pub(crate) fn apply_flags(args: &SettingsArgs, settings: &mut SimSettings) -> Result<(), Failure> {
    for text in &args.set {
        let (key, value) = parse_assignment("--set", text).map_err(Failure::usage)?;
        set(
            settings,
            &key,
            &value,
            Origin::Flag(format!("--set {text}")),
        )
        .map_err(|error| Failure::usage(anyhow!(renamed::in_words(&error))))?;
    }
    Ok(())
}

/// Reads a file that a user wrote; `what` is what it should be.
pub(crate) fn read(path: &Path, what: &str) -> Result<String, Failure> {
    let shown = visible::name(path);
    // A device or a pipe has no length to be asked for, and may have no end.
    let mut bytes = Vec::new();
    let text = PatientFile::open(path)
        .and_then(|file| file.take(MOST_BYTES + 1).read_to_end(&mut bytes))
        .and_then(|_| String::from_utf8(bytes).map_err(|_| no_text()))
        .with_context(|| format!("cannot read the {what} {shown}"))
        .map_err(Failure::usage)?;
    if text.len() as u64 > MOST_BYTES {
        refuse!("the {what} {shown} is too long; 1 MiB is allowed");
    }
    Ok(text)
}

fn no_text() -> io::Error {
    io::Error::new(io::ErrorKind::InvalidData, "it is not UTF-8 text")
}

/// Lists what differs from the defaults, as `key = value`.
pub(crate) fn changed(settings: &SimSettings) -> Vec<String> {
    changed_of(settings.entries())
}

/// Lists which of these differ from the defaults.
pub(crate) fn changed_of(entries: impl IntoIterator<Item = Entry>) -> Vec<String> {
    let entries = entries.into_iter();
    let changed = entries.filter(|entry| entry.value != entry.default);
    changed
        .map(|entry| format!("{} = {}", entry.key, entry.value))
        .collect()
}

/// The `config` subcommand.
pub(crate) fn list(
    devices: Devices,
    device: Option<&str>,
    args: &SettingsArgs,
) -> Result<Exit, Failure> {
    let settings = load(devices, args)?;
    let device = device.and_then(|id| devices.iter().find(|device| device.id == id));
    let text = match device {
        Some(device) => of_device(&settings, device),
        None => show_toml(&settings),
    };
    print(&format!(
        "# Settings of sim. \"documented\" is what the device's manual says; \"assumed\" is our\n\
         # decision where the manual is silent: check it against your hardware before you rely\n\
         # on it.\n\n{}",
        text.trim_end()
    ))
}

/// The settings of a device, each by its whole key; those to compare first come first.
fn of_device(settings: &SimSettings, device: &DeviceSpec) -> String {
    let mut entries = settings.entries();
    entries.retain(|entry| entry.key.split('.').next() == Some(device.id));
    let place = |entry: &Entry| {
        let key = entry.key.split_once('.').map_or("", |(_, key)| key);
        let first = device.compare_first.iter().position(|first| *first == key);
        first.unwrap_or(usize::MAX)
    };
    entries.sort_by_key(place);
    let (first, others) = entries.split_at(device.compare_first.len().min(entries.len()));
    let show = |entries: &[Entry]| -> String {
        let each = entries.iter().map(|entry| show_entry(entry, &entry.key));
        each.collect()
    };
    format!(
        "# Compare these with your device first.\n{}\n# The others.\n{}",
        show(first),
        show(others)
    )
}
