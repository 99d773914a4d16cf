//! The drive that makes settings identifiable, from the table of its device.

use std::fmt::Write as _;
use std::time::Duration;

use anyhow::anyhow;
use rigsim_core::device::{DeviceSettings, DeviceSpec, Devices};
use rigsim_core::event::read_hex;
use rigsim_core::settings::SimSettings;
use rigsim_settings::{Source, parse_quantity};
use serde::Serialize;
use toml::Spanned;
use toml::de::{DeTable, DeValue};

use crate::exit::Failure;

/// A part of the drive.
#[derive(Debug, Serialize)]
pub(super) struct Manoeuvre {
    pub(super) name: String,
    /// Safety note.
    pub(super) care: String,
    /// Settings that it identifies, without the id of the device.
    pub(super) touches: Vec<String>,
    pub(super) frames: Vec<PlannedFrame>,
}

/// Bytes to send, and the time to wait after them.
#[derive(Debug, Serialize)]
pub(super) struct PlannedFrame {
    pub(super) link: usize,
    pub(super) bytes: String,
    pub(super) wait_ms: u64,
}

/// The manoeuvres of a device.
pub(super) fn manoeuvres(
    device: &DeviceSpec,
    device_settings: &dyn DeviceSettings,
) -> Result<Vec<Manoeuvre>, String> {
    parts("manoeuvre", device, device_settings)
}

/// What of the plan stands under this key: manoeuvres, or what only a hand can do.
pub(super) fn parts(
    key: &str,
    device: &DeviceSpec,
    device_settings: &dyn DeviceSettings,
) -> Result<Vec<Manoeuvre>, String> {
    let source = Source {
        file: "the plan",
        text: device.host.plan,
    };
    let table = DeTable::parse(source.text).map_err(|error| source.syntax(&error).to_string())?;
    let all = table.get_ref().get(key);
    let all = all.into_iter().flat_map(|all| all.get_ref().as_array());
    all.flatten()
        .map(|one| manoeuvre(one, device, device_settings))
        .collect()
}

fn manoeuvre(
    value: &Spanned<DeValue<'_>>,
    device: &DeviceSpec,
    device_settings: &dyn DeviceSettings,
) -> Result<Manoeuvre, String> {
    let text = |key| {
        let text = value
            .get_ref()
            .get(key)
            .and_then(|text| text.get_ref().as_str());
        text.unwrap_or_default().to_owned()
    };
    let mut frames: Vec<PlannedFrame> = Vec::new();
    for step in list(value, "do") {
        let field = |key| step.get_ref().get(key).map(Spanned::get_ref);
        let time = |key| {
            let text = field(key).and_then(DeValue::as_str).unwrap_or("0s");
            parse_quantity(text, "ms").map_err(|why| format!("{key}: {why}"))
        };
        let (every, wait) = (time("every")?, time("wait")?);
        let mut once = Vec::new();
        for message in list(step, "send") {
            let message =
                (device.host.read)(message, device_settings).map_err(|error| error.to_string())?;
            once.push((message.link, message.bytes));
        }
        for bytes in list(step, "bytes") {
            let digits = bytes.get_ref().as_str().unwrap_or_default();
            let digits = digits.chars().filter(|c| *c != ' ');
            once.push((
                0,
                read_hex(digits).ok_or("bytes are pairs of hexadecimal digits")?,
            ));
        }
        let times = field("times").and_then(DeValue::as_integer);
        let times = times.and_then(|times| times.as_str().parse::<usize>().ok());
        for (link, bytes) in (0..times.unwrap_or(1)).flat_map(|_| &once) {
            let bytes = bytes.iter().map(|byte| format!("{byte:02X}")).collect();
            frames.push(PlannedFrame {
                link: *link,
                bytes,
                wait_ms: whole(every),
            });
        }
        if let Some(last) = frames.last_mut() {
            last.wait_ms += whole(wait);
        }
    }
    Ok(Manoeuvre {
        name: text("name"),
        care: text("care"),
        touches: list(value, "touches")
            .filter_map(|key| Some(key.get_ref().as_str()?.to_owned()))
            .collect(),
        frames,
    })
}

#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "a cast from a float saturates"
)]
fn whole(number: f64) -> u64 {
    number as u64
}

/// The elements of an array.
fn list<'v, 't>(
    value: &'v Spanned<DeValue<'t>>,
    key: &str,
) -> impl Iterator<Item = &'v Spanned<DeValue<'t>>> {
    let all = value
        .get_ref()
        .get(key)
        .and_then(|all| all.get_ref().as_array());
    all.into_iter().flatten()
}

/// The whole drive for a device with these settings.
pub(super) fn of_device(
    device: Option<&DeviceSpec>,
    kind: &str,
    settings: &SimSettings,
) -> Result<Vec<Manoeuvre>, Failure> {
    let known = device.and_then(|device| Some((device, settings.of_device(device)?)));
    let all = known
        .map(|(device, settings)| manoeuvres(device, settings))
        .transpose();
    let all = all.map_err(|why| Failure::system(anyhow!("the plan of {kind}: {why}")))?;
    let all = all.filter(|all| !all.is_empty());
    all.ok_or_else(|| Failure::usage(anyhow!("there is no plan for {kind} yet")))
}

/// The whole drive, for people or as JSON.
pub(super) fn show(
    devices: Devices,
    kind: &str,
    settings: &SimSettings,
    as_json: bool,
) -> Result<String, Failure> {
    let device = devices.iter().copied().find(|device| device.id == kind);
    let all = of_device(device, kind, settings)?;
    if as_json {
        return serde_json::to_string(&all).map_err(Failure::system);
    }
    let mut text =
        format!("A drive for the settings of {kind}; docs/examples/identify.py performs it.\n");
    for one in &all {
        let time: u64 = one.frames.iter().map(|frame| frame.wait_ms).sum();
        let time = Duration::from_millis(time).as_secs_f64();
        // Writing to a string cannot fail.
        let _ = write!(
            text,
            "\n{} ({time:.0} s)\n  {}\n  identifies: {}\n",
            one.name,
            one.care,
            one.touches.join(", ")
        );
    }
    Ok(text.trim_end().to_owned())
}

/// Text that names the manoeuvre that a setting acts on.
pub(super) fn touching(device: &DeviceSpec, key: &str) -> String {
    let settings = (device.settings)();
    let parts = |key| parts(key, device, &*settings).unwrap_or_default();
    let within_device = key
        .strip_prefix(device.id)
        .map_or(key, |rest| rest.trim_start_matches('.'));
    let tells = |touched: &String| {
        within_device == touched
            || within_device
                .strip_prefix(touched.as_str())
                .is_some_and(|rest| rest.starts_with('.'))
    };
    let find = |key| {
        let mut all = parts(key).into_iter();
        all.find(|one| one.touches.iter().any(tells))
    };
    if let Some(Manoeuvre { name, .. }) = find("manoeuvre") {
        return format!("the manoeuvre \"{name}\" of `sim fit --plan` touches it");
    }
    let by_hand = find("by_hand")
        .map(|one| format!("; by hand, which the model does not follow: {}", one.name));
    let by_hand = by_hand.unwrap_or_default();
    format!("no manoeuvre of `sim fit --plan` touches it{by_hand}")
}
