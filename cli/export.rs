//! Recordings in the formats of other tools, made by playing them again.

mod dissector;
mod frames;
mod mcap;
mod pcapng;
mod perfetto;
mod vcd;

use std::collections::BTreeMap;
use std::ffi::OsStr;
use std::fs::File;
use std::io::{self, BufWriter};
use std::path::{Path, PathBuf};
use std::time::{Duration, UNIX_EPOCH};

use anyhow::{Context as _, anyhow};
use clap::ValueEnum;
use rigsim_core::SimTime;
use rigsim_core::device::Devices;
use rigsim_core::event::Event;
use rigsim_core::message::Sender;
use rigsim_pty::paths::Results;
use rigsim_runner::Run;
use rigsim_runner::run::Probe;
use rigsim_runner::scenario::NamedText;
use rigsim_runner::trace::{Observer, Record};

use crate::exit::Failure;
use crate::print::complain;
use crate::recording::{self, Played};
use crate::visible;

pub(crate) use dissector::dissector;
use frames::{Frame, Streams};

/// Most frames and records that wait for the second run to come to their time.
const MOST_WAITING: usize = 1 << 16;

/// Interval at which values are read.
const EVERY: Duration = Duration::from_millis(50);

/// A format of another tool; files end with its name.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum ExportFormat {
    /// World, values, messages and log, for Foxglove, Rerun and PlotJuggler.
    Mcap,
    /// Frames on the lines, for Wireshark.
    Pcapng,
    /// Frames, faults, values and threads as tracks, for Perfetto.
    #[value(name = "perfetto-trace", aliases = ["perfetto", "pftrace"])]
    Perfetto,
    /// Bits on the lines and values, for PulseView and GTKWave.
    Vcd,
}

impl ExportFormat {
    fn name(self) -> String {
        let value = self.to_possible_value();
        value.map_or_else(String::new, |value| value.get_name().to_owned())
    }

    /// What stands near the beginning of such a file.
    fn marks(self) -> &'static [&'static str] {
        match self {
            Self::Mcap => &["MCAP0\r\n"],
            Self::Pcapng => &["\n\r\r\n"],
            Self::Perfetto => &[perfetto::MARK],
            Self::Vcd => &["$version\n    sim"],
        }
    }

    fn of(path: &Path) -> Result<Self, Failure> {
        let ending = path.extension().and_then(|ending| ending.to_str());
        Self::from_str(ending.unwrap_or_default(), false).map_err(|_| {
            let all = Self::value_variants().iter().map(|format| format.name());
            Failure::usage(anyhow!(
                "--export: the ending of {} names no format; allowed: {}. Or say it with --format",
                visible::name(path),
                all.collect::<Vec<_>>().join(", ")
            ))
        })
    }

    fn writer(self, run: &Run, about: &About, out: Out) -> io::Result<Box<dyn Writer>> {
        Ok(match self {
            Self::Mcap => Box::new(mcap::Mcap::begin(run, about, out)?),
            Self::Pcapng => Box::new(pcapng::Pcapng::begin(run, about, out)?),
            Self::Perfetto => Box::new(perfetto::Perfetto::begin(run, about, out)?),
            Self::Vcd => Box::new(vcd::Vcd::begin(run, about, out)?),
        })
    }
}

type Out = BufWriter<File>;

/// What a file of another tool says about the run.
struct About {
    /// Date at which simulated time begins, nanoseconds since 1970.
    date: u64,
    /// The world file.
    world: Option<NamedText>,
    /// The command that repeats it.
    command: String,
}

/// Something in a recording, in the order of time.
enum Item<'a> {
    /// Something happened.
    Event(&'a Event),
    /// A frame or noise was on a line.
    Frame(&'a Frame),
    /// A line of the recording, events and poses aside.
    Record(&'a Record),
    /// The run, as it is now and then.
    Values(&'a Run),
}

/// Writes one format.
trait Writer {
    fn take(&mut self, at: SimTime, item: &Item<'_>) -> io::Result<()>;

    fn finish(self: Box<Self>) -> io::Result<()>;
}

/// Numbers of a device that belong together.
struct Group {
    device: usize,
    /// What they are of, as in `truth`.
    of: &'static str,
    probes: Vec<Probe>,
}

impl Group {
    /// Of every device what it truly does, what it reports, and what its client does.
    fn all(run: &Run) -> Vec<Self> {
        let kinds = |device| ["truth", "reported", "client"].map(|of| (device, of));
        let groups = (0..run.rig().devices()).flat_map(kinds);
        let group = |(device, of)| {
            let is_own = |probe: &Probe| {
                probe.device == Some(device) && probe.name.split('.').nth(1) == Some(of)
            };
            let probes = run.probes().into_iter().filter(is_own).collect();
            Self { device, of, probes }
        };
        groups.map(group).collect()
    }

    /// The last part of each name, with its unit.
    fn fields(&self) -> impl Iterator<Item = (&str, String)> {
        self.probes.iter().map(|probe| {
            let name = probe.name.splitn(3, '.').nth(2);
            (name.unwrap_or(&probe.name), probe.unit.to_string())
        })
    }

    /// Their values, no numbers where there are none.
    fn values(&self, run: &Run) -> impl Iterator<Item = f64> {
        self.probes.iter().map(|probe| probe.number(run))
    }
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
    next: SimTime,
    /// The recording says what threads of the client waited for.
    has_waits: bool,
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

    fn first_waiting(&mut self) {
        if let Some(((at, _), what)) = self.waiting.pop_first() {
            match &what {
                Waiting::Frame(frame) => self.take(at, &Item::Frame(frame)),
                Waiting::Record(record) => self.take(at, &Item::Record(record)),
            }
        }
    }

    fn catch_up(&mut self, to: SimTime) {
        while self.waiting.keys().next().is_some_and(|(at, _)| *at <= to) {
            self.first_waiting();
        }
    }

    fn take(&mut self, at: SimTime, item: &Item<'_>) {
        if self.written.is_ok() {
            self.written = self.writer.take(at, item);
        }
    }

    fn finish(mut self) -> io::Result<()> {
        for frame in self.streams.rest() {
            self.wait(frame.at, Waiting::Frame(frame));
        }
        self.catch_up(SimTime::MAX);
        self.written.and_then(|()| self.writer.finish())
    }
}

impl Observer for Walk {
    fn record(&mut self, record: &Record) {
        let (t, bytes) = match record {
            Record::In { t, port, bytes } | Record::Host { t, port, bytes } => {
                (t, Some((0, port, Sender::Client, bytes)))
            }
            Record::Out { t, dt, port, bytes } => (t, Some((*dt, port, Sender::Device, bytes))),
            Record::Step { t, .. }
            | Record::Wait { t, .. }
            | Record::Failure { t, .. }
            | Record::End { t, .. } => (t, None),
            // What came of the others is events.
            _ => return,
        };
        self.has_waits |= matches!(record, Record::Wait { .. });
        self.wait(SimTime::from_nanos(*t), Waiting::Record(record.clone()));
        if let Some((dt, port, sender, bytes)) = bytes {
            let times = (0_u64..).map(|index| SimTime::from_nanos(t.saturating_add(index * dt)));
            let bytes = times.zip(bytes.0.iter().copied());
            for frame in self.streams.add((*port).into(), sender, bytes) {
                self.wait(frame.at, Waiting::Frame(frame));
            }
        }
    }

    fn event(&mut self, _: &Run, event: &Event) {
        self.catch_up(event.at);
        self.take(event.at, &Item::Event(event));
    }

    fn next_sample(&self) -> SimTime {
        self.next
    }

    fn sample(&mut self, run: &Run) {
        let now = run.rig().now();
        self.catch_up(now);
        self.take(now, &Item::Values(run));
        self.next = now + EVERY;
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
        let command = ["sim", "replay"].map(OsStr::new).into_iter();
        let about = About {
            date: date(trace)?,
            world: recording::header(trace)?.and_then(|header| header.world),
            command: visible::command(command.chain([trace.as_os_str()])),
        };
        let writer = format.writer(run, &about, out).with_context(failed);
        let writer = writer.map_err(Failure::system)?;
        Ok(Walk {
            writer,
            streams: Streams::new(run),
            waiting: BTreeMap::new(),
            number: 0,
            next: SimTime::ZERO,
            has_waits: false,
            written: Ok(()),
        })
    };
    let (walk, played) = recording::view(devices, trace, walk)?;
    if format == ExportFormat::Perfetto
        && !walk.has_waits
        && recording::client_time(trace)?.0 == "lockstep"
    {
        complain(&format!(
            "{} says nothing of the client's threads: only a run with `--export perfetto-trace` records them",
            visible::name(trace)
        ));
    }
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
        name.push(format!(".{}", format.name()));
        // A run that differs when it is played again is what `sim replay` finds.
        let _played = export(devices, trace, &PathBuf::from(name), Some(*format))?;
    }
    Ok(())
}

/// Date at which the time of a recording begins, nanoseconds since 1970: that of its client, or midnight in UTC
/// of the day on which the file was written.
fn date(path: &Path) -> Result<u64, Failure> {
    const DAY: u64 = 86_400;
    let modified = path.metadata().and_then(|about| about.modified());
    let since = modified
        .ok()
        .and_then(|at| at.duration_since(UNIX_EPOCH).ok());
    let day = since.unwrap_or_default().as_secs() / DAY;
    let (_, date) = recording::client_time(path)?;
    let date = date.unwrap_or(day * DAY);
    Ok(date.saturating_mul(1_000_000_000))
}
