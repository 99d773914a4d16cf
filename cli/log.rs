//! Printing what happens, on a thread of its own so that a slow terminal never delays a reply.

use std::collections::BTreeMap;
use std::io::{self, Write};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

use anstyle::{AnsiColor, Style};
use crossbeam_channel::{Receiver, RecvTimeoutError, Sender, TrySendError};
use serde_json::json;
use sim_core::SimTime;
use sim_core::event::{Event, Hex, Level};

use crate::args::LogFormat;

/// Most lines that wait to be printed; further ones are dropped and counted.
const MOST_LINES: usize = 1 << 14;
/// How long whoever reads the output may take for one line at the end before the rest is given up:
/// a reader that has stopped reading must not keep the simulator from ending.
const END_PATIENCE: Duration = Duration::from_secs(3);
/// Simulated seconds during which a warning of the same kind is only counted.
const REPEAT_SECONDS: f64 = 1.0;

/// What to print.
#[derive(Debug, Clone, Copy)]
pub(crate) struct LogOptions {
    pub(crate) format: LogFormat,
    pub(crate) verbose: bool,
    pub(crate) quiet: bool,
}

enum Line {
    Event(Event),
    /// Printed as it is, whatever the options say.
    Text(String),
}

/// The sending end; dropping it prints the rest and ends the thread.
pub(crate) struct Log {
    lines: Option<Sender<Line>>,
    dropped: Arc<AtomicU64>,
    options: LogOptions,
    /// Has something in it when a line was printed; disconnected when the thread has ended.
    progress: Receiver<()>,
    thread: Option<JoinHandle<()>>,
}

impl Log {
    /// Starts the thread; `names` are the devices by index.
    pub(crate) fn start(options: LogOptions, names: Vec<String>) -> io::Result<Self> {
        let (lines, receiver) = crossbeam_channel::bounded(MOST_LINES);
        let (printed, progress) = crossbeam_channel::bounded(1);
        let dropped = Arc::new(AtomicU64::new(0));
        let printer = Printer {
            options,
            names,
            dropped: Arc::clone(&dropped),
            told_dropped: 0,
            repeats: BTreeMap::new(),
            printed,
        };
        let thread = std::thread::Builder::new()
            .name("log".to_owned())
            .spawn(move || printer.run(&receiver))?;
        Ok(Self {
            lines: Some(lines),
            dropped,
            options,
            progress,
            thread: Some(thread),
        })
    }

    /// Prints an event, if the options ask for its kind; never waits.
    pub(crate) fn event(&self, event: Event) {
        let level = event.kind.level();
        let wanted = match level {
            Level::Traffic => self.options.verbose,
            Level::Notice | Level::Warning => !self.options.quiet,
        };
        if wanted {
            self.send(Line::Event(event));
        }
    }

    /// Prints a line.
    pub(crate) fn text(&self, line: String) {
        self.send(Line::Text(line));
    }

    pub(crate) fn format(&self) -> LogFormat {
        self.options.format
    }

    pub(crate) fn is_quiet(&self) -> bool {
        self.options.quiet
    }

    fn send(&self, line: Line) {
        let Some(lines) = &self.lines else { return };
        if let Err(TrySendError::Full(_)) = lines.try_send(line) {
            self.dropped.fetch_add(1, Ordering::Relaxed);
        }
    }
}

impl Drop for Log {
    fn drop(&mut self) {
        self.lines = None;
        let Some(thread) = self.thread.take() else {
            return;
        };
        // Every round takes a line off a queue that is bounded and that nobody fills any more.
        let end = loop {
            if let Err(end) = self.progress.recv_timeout(END_PATIENCE) {
                break end;
            }
        };
        if end == RecvTimeoutError::Disconnected {
            // A panic of the printing thread has been printed by its own hook.
            let _ = thread.join();
        }
    }
}

struct Printer {
    options: LogOptions,
    names: Vec<String>,
    dropped: Arc<AtomicU64>,
    told_dropped: u64,
    /// When an event of a device and kind was last printed, and how many were not since.
    repeats: BTreeMap<(usize, &'static str), (SimTime, u64)>,
    /// Told of each line, if whoever listens has heard of the one before.
    printed: Sender<()>,
}

impl Printer {
    fn run(mut self, lines: &Receiver<Line>) {
        let mut out = anstream::stdout();
        // When nobody reads, as after `| head`, the lines go nowhere and the device goes on.
        while let Ok(line) = lines.recv() {
            let _ = self.print(&mut out, line);
            let _ = self.printed.try_send(());
            if lines.is_empty() {
                let _ = self.tell_dropped(&mut out);
                let _ = out.flush();
            }
        }
        let _ = out.flush();
    }

    fn print(&mut self, out: &mut impl Write, line: Line) -> io::Result<()> {
        let event = match line {
            Line::Text(text) => return writeln!(out, "{text}"),
            Line::Event(event) => event,
        };
        let Some(repeats) = self.due(&event) else {
            return Ok(());
        };
        match self.options.format {
            LogFormat::Text => self.print_text(out, &event, repeats),
            LogFormat::Json => self.print_json(out, &event),
        }
    }

    /// How many like it were not printed; `None` if it is not to be printed either.
    fn due(&mut self, event: &Event) -> Option<u64> {
        let plain = self.options.verbose || self.options.format == LogFormat::Json;
        if plain || event.kind.level() != Level::Warning {
            return Some(0);
        }
        let key = (event.device, event.kind.code());
        match self.repeats.get_mut(&key) {
            Some((last, hidden)) if event.at.since(*last).as_secs_f64() < REPEAT_SECONDS => {
                *hidden += 1;
                None
            }
            Some((last, hidden)) => {
                *last = event.at;
                Some(std::mem::take(hidden))
            }
            None => {
                self.repeats.insert(key, (event.at, 0));
                Some(0)
            }
        }
    }

    fn print_text(&self, out: &mut impl Write, event: &Event, repeats: u64) -> io::Result<()> {
        let kind = &event.kind;
        let (mark, style) = match (kind.level(), kind.code()) {
            (Level::Traffic, "request") => ("->", Style::new()),
            (Level::Traffic, _) => ("<-", Style::new()),
            (Level::Notice, _) => (" .", Style::new().bold()),
            // Red is readable on dark and on light backgrounds.
            (Level::Warning, _) => (" !", AnsiColor::Red.on_default().bold()),
        };
        let name = self.names.get(event.device).map_or("?", String::as_str);
        let code = match kind.level() {
            Level::Traffic => String::new(),
            _ => format!(" [{}]", kind.code()),
        };
        let bytes = match (kind.level(), kind.bytes()) {
            (Level::Traffic, Some(bytes)) => format!("  | {}", Hex(&bytes)),
            _ => String::new(),
        };
        let repeats = match repeats {
            0 => String::new(),
            count => format!(" ({count} more since the last line)"),
        };
        let time = event.at;
        writeln!(
            out,
            "{time:>12} {name} {style}{mark} {kind}{style:#}{code}{bytes}{repeats}"
        )
    }

    fn print_json(&self, out: &mut impl Write, event: &Event) -> io::Result<()> {
        let kind = &event.kind;
        let line = json!({
            "time_s": event.at.as_secs_f64(),
            "device": self.names.get(event.device),
            "level": kind.level().word(),
            "code": kind.code(),
            "text": kind.to_string(),
            "bytes": kind.bytes().map(|bytes| Hex(&bytes).to_string()),
        });
        writeln!(out, "{line}")
    }

    fn tell_dropped(&mut self, out: &mut impl Write) -> io::Result<()> {
        let dropped = self.dropped.load(Ordering::Relaxed);
        let new = dropped - self.told_dropped;
        if new == 0 {
            return Ok(());
        }
        self.told_dropped = dropped;
        match self.options.format {
            LogFormat::Text => writeln!(out, "({new} lines not printed: the terminal is too slow)"),
            LogFormat::Json => writeln!(out, "{}", json!({"code": "lines_dropped", "count": new})),
        }
    }
}
