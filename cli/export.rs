//! Recordings in the formats of other tools, made by playing them again.

mod dissector;
mod frames;
mod mcap;
mod pcapng;
mod perfetto;
mod vcd;

use std::collections::{BTreeMap, BTreeSet};
use std::ffi::OsStr;
use std::fs::File;
use std::io::{self, BufWriter};
use std::path::Path;
use std::time::{Duration, UNIX_EPOCH};

use anyhow::{Context as _, anyhow};
use clap::ValueEnum;
use rigsim_core::SimTime;
use rigsim_core::device::Devices;
use rigsim_core::event::Event;
use rigsim_pty::paths::Results;
use rigsim_runner::Run;
use rigsim_runner::run::{Probe, published};
use rigsim_runner::scenario::NamedText;
use rigsim_runner::trace::{Observer, Record};

use crate::exit::Failure;
use crate::print::complain;
use crate::recording::{self, Lines, Played};
use crate::visible;

pub(crate) use dissector::dissector;
use frames::{Frame, Streams, Way};

/// Most items that wait for others of earlier times: the bytes of a burst are recorded when the next begins.
const MOST_WAITING: usize = 1 << 16;
/// Interval at which values are read.
const EVERY: Duration = Duration::from_millis(50);
const VERSION: &str = concat!("sim ", env!("CARGO_PKG_VERSION"));

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
    fn mark(self) -> &'static [&'static str] {
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
            let all: Vec<String> = Self::value_variants().iter().map(|format| format.name()).collect();
            let (path, all) = (visible::name(path), all.join(", "));
            Failure::usage(anyhow!(
                "--to: the ending of {path} names no format; allowed: {all}. --format says it too; a time \
                 belongs to --until"
            ))
        })
    }

    fn writer(self, run: &Run, about: About, out: Out) -> io::Result<Box<dyn Writer>> {
        Ok(match self {
            Self::Mcap => Box::new(mcap::Mcap::begin(run, about, out)?),
            Self::Pcapng => Box::new(pcapng::Pcapng::begin(run, &about, out)?),
            Self::Perfetto => Box::new(perfetto::Perfetto::begin(run, &about, out)?),
            Self::Vcd => Box::new(vcd::Vcd::begin(run, &about, out)?),
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
    /// What the values are of, in their order.
    groups: Vec<Group>,
}

/// Numbers that belong together.
struct Group {
    /// `None` for those that the client publishes.
    device: Option<usize>,
    /// Kind of the device.
    kind: Option<&'static str>,
    /// As in `/r150/truth`.
    topic: String,
    /// As in `truth`.
    of: String,
    /// Their names behind that, and their units.
    fields: Vec<(String, String)>,
    probes: Vec<Probe>,
}

/// Something in a recording.
enum Item {
    Event(Event),
    /// A frame or noise was on a line.
    Frame(Frame),
    /// Bytes were on a line.
    Bytes(Way, Vec<(SimTime, u8)>),
    /// A line of the recording; bytes, events and poses aside.
    Record(Record),
    /// The values of all groups.
    Values(Vec<Number>),
}

struct Number {
    number: f64,
    /// It is finite, and not what it was before.
    is_new: bool,
}

/// Writes one format.
trait Writer {
    /// Takes what comes next.
    fn take(&mut self, at: SimTime, item: Item) -> io::Result<()>;

    /// The run has come to this time; what comes before it may be taken later.
    fn draw(&mut self, at: SimTime, run: &Run) -> io::Result<()> {
        let _ = (at, run);
        Ok(())
    }

    fn finish(self: Box<Self>) -> io::Result<()>;
}

/// All numbers: of every device what it truly does, what it reports and what its client does, and what the
/// client publishes.
fn groups(run: &Run, published: &BTreeSet<String>) -> Vec<Group> {
    let published = published.iter().filter_map(|name| run.probe(name).ok());
    let mut groups: Vec<Group> = Vec::new();
    for probe in run.probes().into_iter().chain(published) {
        let device = probe.device;
        let own = device.map(|device| &run.scenario().rig.devices[device]);
        // The names of devices begin with that of their device.
        let mut parts = probe
            .name
            .splitn(2 + own.iter().len(), '.')
            .skip(own.iter().len());
        let (Some(of @ ("truth" | "reported" | "client")), Some(name)) =
            (parts.next(), parts.next())
        else {
            continue;
        };
        let field = (name.to_owned(), probe.unit.to_string());
        let mut same = groups.iter_mut();
        if let Some(group) = same.find(|group| group.device == device && group.of == of) {
            group.fields.push(field);
            group.probes.push(probe);
        } else {
            let topic = own.map_or_else(|| format!("/{of}"), |own| format!("/{}/{of}", own.name));
            let kind = own.map(|own| own.device.id);
            let (of, fields) = (of.to_owned(), vec![field]);
            groups.push(Group {
                device,
                kind,
                topic,
                of,
                fields,
                probes: vec![probe],
            });
        }
    }
    groups
}

/// Walks through a recording for a writer.
struct Walk {
    writer: Box<dyn Writer>,
    streams: Streams,
    probes: Vec<Probe>,
    /// Values as they were last.
    values: Vec<f64>,
    /// What is not written yet, in the order of time.
    waiting: BTreeMap<(SimTime, u64), Item>,
    number: u64,
    next: SimTime,
    /// The recording says what threads of the client waited for.
    has_waits: bool,
    written: io::Result<()>,
}

impl Walk {
    fn wait(&mut self, at: SimTime, item: Item) {
        self.number += 1;
        self.waiting.insert((at, self.number), item);
        if self.waiting.len() > MOST_WAITING {
            self.write_first();
        }
    }

    fn write_first(&mut self) {
        if let Some(((at, _), item)) = self.waiting.pop_first()
            && self.written.is_ok()
        {
            self.written = self.writer.take(at, item);
        }
    }

    fn finish(mut self) -> io::Result<()> {
        for frame in std::mem::take(&mut self.streams).rest() {
            self.wait(frame.at, Item::Frame(frame));
        }
        while !self.waiting.is_empty() {
            self.write_first();
        }
        self.written.and_then(|()| self.writer.finish())
    }
}

impl Observer for Walk {
    fn record(&mut self, record: &Record) {
        let (t, dt, way, bytes) = match record {
            Record::In { t, port, bytes } | Record::Host { t, port, bytes } => {
                (*t, 0, ((*port).into(), false), bytes)
            }
            Record::Out { t, dt, port, bytes } => (*t, *dt, ((*port).into(), true), bytes),
            Record::Step { t, .. }
            | Record::Wait { t, .. }
            | Record::Failure { t, .. }
            | Record::End { t, .. } => {
                self.has_waits |= matches!(record, Record::Wait { .. });
                return self.wait(SimTime::from_nanos(*t), Item::Record(record.clone()));
            }
            // What came of the others is events.
            _ => return,
        };
        let times = (0..).map(|index: u64| t.saturating_add(index.saturating_mul(dt)));
        let times = times.map(SimTime::from_nanos);
        let bytes: Vec<_> = times.zip(bytes.0.iter().copied()).collect();
        for frame in self.streams.add(way, &bytes) {
            self.wait(frame.at, Item::Frame(frame));
        }
        self.wait(SimTime::from_nanos(t), Item::Bytes(way, bytes));
    }

    fn event(&mut self, _: &Run, event: &Event) {
        self.wait(event.at, Item::Event(event.clone()));
    }

    fn next_sample(&self) -> SimTime {
        self.next
    }

    fn sample(&mut self, run: &Run) {
        let now = run.rig().now();
        let read = |(probe, last): (&Probe, &mut f64)| {
            let number = probe.number(run);
            let is_new = number.is_finite() && std::mem::replace(last, number) != number;
            Number { number, is_new }
        };
        let values = self.probes.iter().zip(&mut self.values).map(read).collect();
        self.wait(now, Item::Values(values));
        if self.written.is_ok() {
            self.written = self.writer.draw(now, run);
        }
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
    let (client, date) = recording::client_time(trace)?;
    let walk = |run: &Run| {
        let out = Results::at(to, format.mark()).and_then(Results::into_file);
        let out = BufWriter::new(out.with_context(failed).map_err(Failure::usage)?);
        let command = ["sim", "replay"].map(OsStr::new).into_iter();
        let groups = groups(run, &published_in(trace)?);
        let probes = groups.iter().flat_map(|group| group.probes.clone());
        let probes: Vec<Probe> = probes.collect();
        let about = About {
            date: date
                .unwrap_or_else(|| midnight(trace))
                .saturating_mul(1_000_000_000),
            world: recording::header(trace)?.and_then(|header| header.world),
            command: visible::command(command.chain([trace.as_os_str()])),
            groups,
        };
        let writer = format.writer(run, about, out).with_context(failed);
        Ok(Walk {
            writer: writer.map_err(Failure::system)?,
            streams: Streams::new(run),
            values: vec![f64::NAN; probes.len()],
            probes,
            waiting: BTreeMap::new(),
            number: 0,
            next: SimTime::ZERO,
            has_waits: false,
            written: Ok(()),
        })
    };
    let (walk, played) = recording::view(devices, trace, walk)?;
    if format == ExportFormat::Perfetto && !walk.has_waits && client == "lockstep" {
        let name = visible::name(trace);
        complain(&format!(
            "{name} says nothing of the client's threads: only a run with `--export perfetto-trace` records them"
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
        // Behind `.trace.jsonl`.
        let to = trace.with_extension("").with_extension(format.name());
        // A run that differs when it is played again is what `sim replay` finds.
        let _played = export(devices, trace, &to, Some(*format))?;
    }
    Ok(())
}

/// Names of the numbers that the client publishes in a recording.
fn published_in(trace: &Path) -> Result<BTreeSet<String>, Failure> {
    let (mut lines, mut names) = (Lines::open(trace)?, BTreeSet::new());
    while let Some(line) = lines.next()? {
        if line.starts_with("{\"kind\":\"publish\"")
            && let Ok(Record::Publish { line, .. }) = serde_json::from_str(line)
        {
            names.extend(published(&line));
        }
    }
    Ok(names)
}

/// Midnight in UTC of the day on which a file was written, seconds since 1970.
fn midnight(path: &Path) -> u64 {
    let modified = path.metadata().and_then(|about| about.modified()).ok();
    let since = modified.and_then(|at| at.duration_since(UNIX_EPOCH).ok());
    let seconds = since.unwrap_or_default().as_secs();
    seconds - seconds % 86_400
}
