//! Events in the words of the log.

use std::io::{self, Write};

use anstyle::{AnsiColor, Style};
use rigsim_core::event::{Event, Hex, Level, Role};
use rigsim_runner::{DevicePlan, RigPlan};
use serde_json::{Value, json};

use crate::visible;

/// Puts events of these devices into words.
#[derive(Debug, Clone)]
pub(crate) struct Words(Vec<DevicePlan>);

impl Words {
    /// For the devices of a rig.
    pub(crate) fn new(rig: &RigPlan) -> Self {
        Self(rig.devices.clone())
    }

    /// A line for people; `repeats` like it were left out before it.
    pub(crate) fn print(
        &self,
        out: &mut impl Write,
        event: &Event,
        repeats: u64,
    ) -> io::Result<()> {
        let kind = &event.kind;
        let (mark, style) = match (kind.level(), kind.code().role) {
            (Level::Traffic, Role::Request) => ("->", Style::new()),
            (Level::Traffic, _) => ("<-", Style::new()),
            (Level::Notice, _) => (" .", Style::new().bold()),
            // Red is readable on dark and on light backgrounds.
            (Level::Warning, _) => (" !", AnsiColor::Red.on_default().bold()),
        };
        let name = self.name(event);
        let code = match kind.level() {
            Level::Traffic => String::new(),
            _ => format!(" [{}]", kind.code()),
        };
        let (text, bytes) = text_and_bytes(event);
        let repeats = match repeats {
            0 => String::new(),
            count => format!(" ({count} more since the last line)"),
        };
        let time = event.at;
        writeln!(
            out,
            "{time:>12} {name} {style}{mark} {}{style:#}{code}{bytes}{repeats}",
            visible::line(&text)
        )
    }

    /// The device, and its link if it has several and the event is about one.
    fn name(&self, event: &Event) -> String {
        let Some(device) = self.0.get(event.device) else {
            return "?".to_owned();
        };
        match self.link(event) {
            Some(link) if device.ports.len() > 1 => format!("{}/{link}", device.name),
            _ => device.name.clone(),
        }
    }

    fn link(&self, event: &Event) -> Option<&'static str> {
        let device = self.0.get(event.device)?;
        let index = event
            .kind
            .link()
            .filter(|link| *link < device.ports.len())?;
        Some(device.device.links.get(index)?.name)
    }

    /// The same for programs.
    pub(crate) fn json(&self, event: &Event) -> Value {
        let kind = &event.kind;
        json!({
            "time_s": event.at.as_secs_f64(),
            "device": self.0.get(event.device).map(|device| &device.name),
            "link": self.link(event),
            "level": kind.level().as_str(),
            "code": kind.code().name,
            "text": kind.to_string(),
            "bytes": kind.bytes().map(|bytes| Hex(bytes).to_string()),
        })
    }

    /// A line for people without colours.
    pub(crate) fn plain(&self, event: &Event) -> String {
        let mut line = Vec::new();
        // Writing to memory cannot fail.
        let _ = self.print(&mut anstream::StripStream::new(&mut line), event, 0);
        String::from_utf8_lossy(line.trim_ascii_end()).into_owned()
    }
}

/// An event in words, and its bytes unless the words have them.
fn text_and_bytes(event: &Event) -> (String, String) {
    let text = event.kind.to_string();
    let bytes = event.kind.bytes();
    let bytes = bytes.map_or_else(String::new, |bytes| Hex(bytes).to_string());
    let shown = match text.contains(&bytes) {
        true => String::new(),
        false => format!("  | {bytes}"),
    };
    (text, shown)
}
