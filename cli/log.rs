//! Printing what happens, on its own thread so that a slow terminal never delays a reply.

mod words;

use std::collections::BTreeMap;
use std::io::{self, Write};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use clap::ValueEnum;
use crossbeam_channel::{Receiver, RecvTimeoutError, Sender};
use rigsim_core::SimTime;
use rigsim_core::event::{Event, Level};
use serde_json::json;

pub(crate) use words::Words;

use crate::print::complain;
use crate::visible;

/// Most lines that wait to be printed; further ones are dropped and counted.
const MOST_LINES: usize = 1 << 14;
/// Time that the output's reader may take at the end for the lines that wait; then the rest is
/// left out, but for the last.
const END_PATIENCE: Duration = Duration::from_secs(2);
/// Time that the output's reader may take at the end in all: a reader that has stopped reading
/// must not keep the simulator from ending.
const LAST_PATIENCE: Duration = Duration::from_secs(5);
/// Time to wait for the end of the printing before looking around.
const GLANCE: Duration = Duration::from_millis(20);
/// Simulated seconds during which a warning of the same kind is only counted.
const REPEAT_SECONDS: f64 = 1.0;

/// Format of what is printed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum LogFormat {
    /// Readable lines.
    Text,
    /// One JSON object a line.
    Json,
}

/// Things to print.
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
    /// Asks for an answer when all lines before it are printed.
    Mark(Sender<()>),
}

/// The sending end; finishing or dropping it prints the rest and ends the thread.
pub(crate) struct Log {
    lines: Option<Sender<Line>>,
    dropped: Arc<AtomicU64>,
    pub(crate) options: LogOptions,
    /// Text to print after all lines, or after those for which there was time.
    last: Sender<String>,
    hurry: Arc<AtomicBool>,
    /// First refusal of the output, if it was one; disconnected when the thread has ended.
    ended: Receiver<io::Error>,
    refusal: Option<io::Error>,
    thread: Option<JoinHandle<()>>,
}

impl Log {
    /// Starts the thread.
    pub(crate) fn start(options: LogOptions, words: Words) -> io::Result<Self> {
        // A bounded channel takes the memory of all its places at once.
        let (lines, receiver) = crossbeam_channel::unbounded();
        let (last, last_receiver) = crossbeam_channel::bounded(1);
        let (ends, ended) = crossbeam_channel::bounded(1);
        let dropped = Arc::new(AtomicU64::new(0));
        let hurry = Arc::new(AtomicBool::new(false));
        let printer = Printer {
            options,
            words,
            dropped: Arc::clone(&dropped),
            reported_dropped: 0,
            repeats: BTreeMap::new(),
            last: last_receiver,
            hurry: Arc::clone(&hurry),
            ends,
        };
        let thread = std::thread::Builder::new()
            .name("log".to_owned())
            .spawn(move || printer.run(&receiver))?;
        Ok(Self {
            lines: Some(lines),
            dropped,
            options,
            last,
            hurry,
            ended,
            refusal: None,
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

    /// Waits until the lines so far are printed, but not long for a slow reader.
    pub(crate) fn flush(&self) {
        let (mark, printed) = crossbeam_channel::bounded(1);
        self.send(Line::Mark(mark));
        let _ = printed.recv_timeout(END_PATIENCE);
    }

    fn send(&self, line: Line) {
        let Some(lines) = &self.lines else { return };
        if lines.len() < MOST_LINES {
            // Lines are not read once the output has refused one.
            let _ = lines.send(line);
        } else {
            self.dropped.fetch_add(1, Ordering::Relaxed);
        }
    }
}

impl Log {
    /// Prints what waits and then `last`. Returns early if `interrupted`, which waits as long as
    /// asked, returns true; what could not be printed is reported on standard error.
    pub(crate) fn finish(
        &mut self,
        last: Option<String>,
        mut interrupted: impl FnMut(Duration) -> bool,
    ) {
        if let Some(last) = last {
            // The channel takes one, and this is the only one.
            let _ = self.last.try_send(last);
        }
        let printed = self.drain(|| interrupted(GLANCE));
        let why = match &self.refusal {
            Some(refusal) => refusal.to_string(),
            None if !printed => "its reader is too slow".to_owned(),
            None => return,
        };
        complain(&format!("some output was not printed: {why}"));
    }

    /// Waits until all is printed, up to a point; says whether it was.
    fn drain(&mut self, mut interrupted: impl FnMut() -> bool) -> bool {
        self.lines = None;
        let begun = Instant::now();
        let ended = loop {
            match self.ended.recv_timeout(GLANCE) {
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => break true,
                Ok(refusal) => self.refusal = Some(refusal),
            }
            if begun.elapsed() > END_PATIENCE {
                self.hurry.store(true, Ordering::Relaxed);
            }
            if begun.elapsed() > LAST_PATIENCE || interrupted() {
                break false;
            }
        };
        if let Some(thread) = self.thread.take().filter(|_| ended) {
            // A panic of the printing thread has been printed by its own hook.
            let _ = thread.join();
        }
        ended
    }
}

impl Drop for Log {
    fn drop(&mut self) {
        if self.thread.is_some() && self.lines.is_some() {
            self.drain(|| false);
        }
    }
}

struct Printer {
    options: LogOptions,
    words: Words,
    dropped: Arc<AtomicU64>,
    reported_dropped: u64,
    /// Time at which an event of a device and kind was last printed, and number that were not
    /// since.
    repeats: BTreeMap<(usize, &'static str), (SimTime, u64)>,
    last: Receiver<String>,
    /// Set when there is no more time for the lines that wait.
    hurry: Arc<AtomicBool>,
    /// Takes the first refusal of the output; dropped with the rest of it at the end.
    ends: Sender<io::Error>,
}

impl Printer {
    fn run(mut self, lines: &Receiver<Line>) {
        let mut out = anstream::stdout();
        // Without a reader, as after `| head`, the lines go nowhere and the device goes on.
        while let Ok(line) = lines.recv() {
            if self.hurry.load(Ordering::Relaxed) {
                self.dropped.fetch_add(1, Ordering::Relaxed);
                continue;
            }
            let mut printed = self.print(&mut out, line);
            if lines.is_empty() {
                printed = printed
                    .and_then(|()| self.report_dropped(&mut out))
                    .and_then(|()| out.flush());
            }
            self.keep_error(printed);
        }
        let mut printed = self.report_dropped(&mut out);
        if let Ok(last) = self.last.try_recv() {
            printed = printed.and_then(|()| writeln!(out, "{}", visible::lines(&last)));
        }
        self.keep_error(printed.and_then(|()| out.flush()));
    }

    /// Keeps a refusal of the output to be reported at the end. The end of its reader is none.
    fn keep_error(&self, printed: io::Result<()>) {
        if let Err(error) = printed
            && error.kind() != io::ErrorKind::BrokenPipe
        {
            // There is room for one, which is the first.
            let _ = self.ends.try_send(error);
        }
    }

    fn print(&mut self, out: &mut impl Write, line: Line) -> io::Result<()> {
        let event = match line {
            Line::Text(text) => return writeln!(out, "{}", visible::lines(&text)),
            Line::Event(event) => event,
            Line::Mark(mark) => {
                out.flush()?;
                // Its reader may have waited long enough.
                let _ = mark.send(());
                return Ok(());
            }
        };
        let Some(repeats) = self.due(&event) else {
            return Ok(());
        };
        match self.options.format {
            LogFormat::Text => self.words.print(out, &event, repeats),
            LogFormat::Json => writeln!(out, "{}", visible::json(&self.words.json(&event))),
        }
    }

    /// Number of those like it that were not printed; `None` if it is not to be printed either.
    fn due(&mut self, event: &Event) -> Option<u64> {
        let plain = self.options.verbose || self.options.format == LogFormat::Json;
        if plain || event.kind.level() != Level::Warning {
            return Some(0);
        }
        let key = (event.device, event.kind.code().name);
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

    fn report_dropped(&mut self, out: &mut impl Write) -> io::Result<()> {
        let dropped = self.dropped.load(Ordering::Relaxed);
        let new = dropped - self.reported_dropped;
        if new == 0 {
            return Ok(());
        }
        self.reported_dropped = dropped;
        match self.options.format {
            LogFormat::Text => writeln!(out, "({new} lines not printed: the terminal is too slow)"),
            LogFormat::Json => writeln!(out, "{}", json!({"code": "lines_dropped", "count": new})),
        }
    }
}
