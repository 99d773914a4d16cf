//! Recordings in the formats of other tools, made by playing them again.

mod dissector;
mod frames;
mod pcapng;

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, BufWriter};
use std::path::{Path, PathBuf};
use std::time::UNIX_EPOCH;

use anyhow::{Context as _, anyhow};
use clap::ValueEnum;
use rigsim_core::SimTime;
use rigsim_core::device::Devices;
use rigsim_core::event::Event;
use rigsim_core::message::Sender;
use rigsim_pty::paths::Results;
use rigsim_runner::Run;
use rigsim_runner::trace::{Onlooker, PortRecord, Record};

use crate::exit::Failure;
use crate::recording::{self, Played};
use crate::visible;

pub(crate) use dissector::dissector;
use frames::{Frame, Streams};

/// Most frames and records that wait for the second run to come to their time.
const MOST_WAITING: usize = 1 << 16;

/// A format of another tool.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum ExportFormat {
    /// Frames on the lines, for Wireshark.
    Pcapng,
}

impl ExportFormat {
    /// How names of such files end.
    fn ending(self) -> &'static str {
        match self {
            Self::Pcapng => "pcapng",
        }
    }

    /// What stands near the beginning of such a file.
    fn marks(self) -> &'static [&'static str] {
        match self {
            Self::Pcapng => &["\n\r\r\n"],
        }
    }

    fn of(path: &Path) -> Result<Self, Failure> {
        let ending = path.extension().and_then(|ending| ending.to_str());
        let all = Self::value_variants();
        let known = all.iter().find(|format| Some(format.ending()) == ending);
        known.copied().ok_or_else(|| {
            let endings: Vec<&str> = all.iter().map(|format| format.ending()).collect();
            Failure::usage(anyhow!(
                "--export: the ending of {} names no format; allowed: {}. Or say it with --format",
                visible::name(path),
                endings.join(", ")
            ))
        })
    }

    fn writer(self, run: &Run, about: &About, out: Out) -> io::Result<Box<dyn Writer>> {
        Ok(match self {
            Self::Pcapng => Box::new(pcapng::Pcapng::begin(run, about, out)?),
        })
    }
}

type Out = BufWriter<File>;

/// What a file of another tool says about the run.
struct About {
    /// Midnight in UTC of the day on which the trace was written, nanoseconds since 1970.
    date: u64,
    /// The command that repeats it.
    command: String,
}

/// Something in a recording, in the order of time.
enum Moment<'a> {
    /// Something happened.
    Event(&'a Event),
    /// A frame or noise was on a line.
    Frame(&'a Frame),
    /// A line of the recording, bytes and events aside.
    Record(&'a Record),
}

/// Writes one format.
trait Writer {
    fn take(&mut self, at: SimTime, moment: &Moment<'_>) -> io::Result<()>;

    fn finish(self: Box<Self>) -> io::Result<()>;
}

enum Waiting {
    Frame(Frame),
    Record(Record),
}

/// Walks through a recording for a writer.
struct Walk {
    writer: Box<dyn Writer>,
    streams: Streams,
    /// Frames and records, which come before the second run reaches their times.
    waiting: BTreeMap<(SimTime, u64), Waiting>,
    number: u64,
    written: io::Result<()>,
}

impl Walk {
    fn wait(&mut self, at: SimTime, what: Waiting) {
        self.number += 1;
        self.waiting.insert((at, self.number), what);
        if self.waiting.len() > MOST_WAITING {
            self.first_waiting();
        }
    }

    fn wait_all(&mut self, frames: Vec<Frame>) {
        for frame in frames {
            self.wait(frame.at, Waiting::Frame(frame));
        }
    }

    fn first_waiting(&mut self) {
        if let Some(((at, _), what)) = self.waiting.pop_first() {
            match &what {
                Waiting::Frame(frame) => self.take(at, &Moment::Frame(frame)),
                Waiting::Record(record) => self.take(at, &Moment::Record(record)),
            }
        }
    }

    fn catch_up(&mut self, to: SimTime) {
        let frames = self.streams.silence(to);
        self.wait_all(frames);
        while self.waiting.keys().next().is_some_and(|(at, _)| *at <= to) {
            self.first_waiting();
        }
    }

    fn take(&mut self, at: SimTime, moment: &Moment<'_>) {
        if self.written.is_ok() {
            self.written = self.writer.take(at, moment);
        }
    }

    fn finish(mut self) -> io::Result<()> {
        self.catch_up(SimTime::MAX);
        self.written.and_then(|()| self.writer.finish())
    }
}

impl Onlooker for Walk {
    fn record(&mut self, record: &Record) {
        let mut bytes = |t: u64, dt: u64, port: PortRecord, sender, bytes: &[u8]| {
            let times = (0_u64..).map(|index| SimTime::from_nanos(t.saturating_add(index * dt)));
            self.streams
                .add(port, sender, times.zip(bytes.iter().copied()))
        };
        let frames = match record {
            Record::In {
                t,
                port,
                bytes: own,
            }
            | Record::Host {
                t,
                port,
                bytes: own,
            } => bytes(*t, 0, *port, Sender::Client, &own.0),
            Record::Out {
                t,
                dt,
                port,
                bytes: own,
            } => bytes(*t, *dt, *port, Sender::Device, &own.0),
            Record::Attach { t, .. }
            | Record::Detach { t, .. }
            | Record::Line { t, .. }
            | Record::Late { t, .. }
            | Record::Add { t, .. }
            | Record::Clear { t, .. }
            | Record::Pace { t, .. }
            | Record::Publish { t, .. }
            | Record::Step { t, .. }
            | Record::Failure { t, .. }
            | Record::End { t, .. } => {
                let at = SimTime::from_nanos(*t);
                return self.wait(at, Waiting::Record(record.clone()));
            }
            Record::Header(_)
            | Record::Time { .. }
            | Record::Event { .. }
            | Record::Pose { .. } => return,
        };
        self.wait_all(frames);
    }

    fn event(&mut self, _: &Run, event: &Event) {
        self.catch_up(event.at);
        self.take(event.at, &Moment::Event(event));
    }

    fn has_enough(&self) -> bool {
        self.written.is_err()
    }
}

/// Plays a recording again and writes it as `to`, whose ending says the format unless it is given.
pub(crate) fn export(
    devices: Devices,
    trace: &Path,
    to: &Path,
    format: Option<ExportFormat>,
) -> Result<Played, Failure> {
    let format = format.map_or_else(|| ExportFormat::of(to), Ok)?;
    let failed = || format!("cannot write {}", visible::name(to));
    let walk = |run: &Run| {
        let out = Results::at(to, format.marks()).and_then(Results::into_file);
        let out = BufWriter::new(out.with_context(failed).map_err(Failure::usage)?);
        let about = About {
            date: date(trace),
            command: format!("sim replay {}", visible::name(trace)),
        };
        let writer = format.writer(run, &about, out).with_context(failed);
        let writer = writer.map_err(Failure::system)?;
        Ok(Walk {
            writer,
            streams: Streams::new(run),
            waiting: BTreeMap::new(),
            number: 0,
            written: Ok(()),
        })
    };
    let (walk, played) = recording::view(devices, trace, walk)?;
    walk.finish()
        .with_context(failed)
        .map_err(Failure::system)?;
    Ok(played)
}

/// Writes the trace of a case also in these formats, beside it.
pub(crate) fn export_beside(
    devices: Devices,
    trace: &Path,
    formats: &[ExportFormat],
) -> Result<(), Failure> {
    for format in formats {
        let mut name = trace.as_os_str().to_owned();
        if let Some(stem) = visible::name(trace).strip_suffix(".trace.jsonl") {
            name.clear();
            name.push(stem);
        }
        name.push(format!(".{}", format.ending()));
        // A run that differs when it is played again is what `sim replay` finds.
        let _played = export(devices, trace, &PathBuf::from(name), Some(*format))?;
    }
    Ok(())
}

/// Midnight in UTC of the day on which a file was written, nanoseconds since 1970.
fn date(path: &Path) -> u64 {
    const DAY: u64 = 86_400;
    let modified = path.metadata().and_then(|about| about.modified());
    let since = modified
        .ok()
        .and_then(|at| at.duration_since(UNIX_EPOCH).ok());
    let day = since.unwrap_or_default().as_secs() / DAY;
    day.saturating_mul(DAY * 1_000_000_000)
}
