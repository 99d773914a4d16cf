//! A recording in the words of the log.

use std::collections::VecDeque;
use std::io::{self, BufWriter, Write as _};

use rigsim_core::SimTime;
use rigsim_core::event::Event;
use rigsim_runner::Run;
use rigsim_runner::trace::{Observer, Record};
use rigsim_settings::show_rounded;
use serde_json::json;

use super::Part;
use crate::args::TraceArgs;
use crate::exit::Failure;
use crate::log::{LogFormat, Words};
use crate::visible;

/// Prints what happens as it comes.
pub(super) struct Printer {
    part: Part,
    words: Words,
    format: LogFormat,
    out: BufWriter<anstream::Stdout>,
    written: io::Result<()>,
    /// Events of the recording at times to which the second run has not come.
    printed: VecDeque<(SimTime, String)>,
    now: SimTime,
}

impl Printer {
    pub(super) fn new(args: &TraceArgs, run: &Run) -> Result<Self, Failure> {
        let mut printer = Self {
            part: Part::new(args, run)?,
            words: Words::new(&run.scenario().rig),
            format: args.log_format,
            out: BufWriter::new(anstream::stdout()),
            written: Ok(()),
            printed: VecDeque::new(),
            now: SimTime::ZERO,
        };
        if args.log_format == LogFormat::Text {
            let scenario = run.scenario();
            let (title, file, seed) = (&scenario.title, &scenario.source.file, run.seed());
            let client = match run.is_live() {
                true => "a real client",
                false => "the scripted client",
            };
            let (title, file) = (visible::line(title), visible::line(file));
            printer.line(&format!("{title}\n  {file}, seed {seed}, {client}"));
        }
        Ok(printer)
    }

    /// Prints the rest.
    pub(super) fn finish(mut self) -> io::Result<()> {
        self.catch_up(SimTime::MAX);
        self.written.and_then(|()| self.out.flush())
    }

    fn line(&mut self, line: &str) {
        if self.written.is_ok() {
            self.written = writeln!(self.out, "{}", visible::lines(line));
        }
    }

    /// Prints what the recording tells up to a time.
    fn catch_up(&mut self, to: SimTime) {
        while let Some((at, line)) = self.printed.pop_front_if(|(at, _)| *at <= to) {
            if self.part.has(at, None) {
                self.line(&line);
            }
        }
    }

    fn emit(&mut self, t: u64, code: &'static str, text: &str) {
        let at = SimTime::from_nanos(t);
        let line = match self.format {
            LogFormat::Text => format!("{at:>12} == {text}"),
            LogFormat::Json => {
                json!({"time_s": at.as_secs_f64(), "code": code, "text": text}).to_string()
            }
        };
        self.printed.push_back((at, line));
    }
}

impl Observer for Printer {
    fn record(&mut self, record: &Record) {
        match record {
            Record::Step { t, step, what } => {
                self.emit(*t, "step", &format!("step \"{step}\" {what}"));
            }
            Record::Add { t, step, text } => {
                let text = text.split_whitespace().collect::<Vec<_>>().join(" ");
                self.emit(*t, "add", &format!("step \"{step}\" was added: {text}"));
            }
            Record::Clear { t, step } => {
                self.emit(*t, "clear", &format!("step \"{step}\" was cleared"));
            }
            Record::Pace { t, change } => {
                self.emit(*t, "pace", &format!("time was changed: {change}"));
            }
            Record::Publish { t, line } => {
                self.emit(*t, "publish", &format!("the client published {line}"));
            }
            Record::Failure { t, step, what } => {
                let step = step.as_ref().map(|step| format!("\"{step}\": "));
                let text = format!("FAILED: {}{what}", step.unwrap_or_default());
                self.emit(*t, "failure", &text);
            }
            Record::Late { t, by, .. } => {
                let by = show_rounded(std::time::Duration::from_nanos(*by));
                self.emit(
                    *t,
                    "late",
                    &format!("the simulator was late or paused, for {by}"),
                );
            }
            Record::End {
                t,
                passed,
                not_applicable,
                ..
            } => {
                let words = match (passed, &not_applicable[..]) {
                    (true, _) => "passed".to_owned(),
                    (false, []) => "FAILED".to_owned(),
                    (false, why) => format!("skipped: {}", why.join("; ")),
                };
                self.emit(*t, "end", &format!("the end: {words}"));
            }
            _ => {}
        }
    }

    fn event(&mut self, _: &Run, event: &Event) {
        self.now = event.at;
        self.catch_up(event.at);
        if self.written.is_err() || !self.part.has(event.at, Some(event.device)) {
            return;
        }
        self.written = match self.format {
            LogFormat::Text => self.words.print(&mut self.out, event, 0),
            LogFormat::Json => writeln!(self.out, "{}", visible::json(&self.words.json(event))),
        };
    }

    fn has_enough(&self) -> bool {
        self.now > self.part.until || self.written.is_err()
    }
}
