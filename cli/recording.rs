//! Recordings of runs: written, read and played again.

use std::borrow::Cow;
use std::collections::BTreeSet;
use std::fs::File;
use std::hash::Hasher as _;
use std::io::{self, BufRead as _, BufReader, BufWriter, ErrorKind, Read as _, Write as _};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use anyhow::{Context as _, anyhow};
use rigsim_core::SimTime;
use rigsim_core::device::Devices;
use rigsim_core::rig::PortId;
use rigsim_pty::paths::Results;
use rigsim_runner::Run;
use rigsim_runner::trace::{Header, Observer, Record, Replay, ReplayError, Timed};
use siphasher::sip128::{Hasher128 as _, SipHasher13};

use crate::exit::{Exit, Failure, refuse};
use crate::patient_file::PatientFile;
use crate::print::{complain, print};
use crate::visible;

/// What the beginning of a trace has.
pub(crate) const MARKS: &[&str] = &["{\"kind\":\"header\""];

/// Real time after which the next line of a trace writes those that wait.
const FLUSH: Duration = Duration::from_secs(1);

/// Name in the header of the recording of a vehicle.
pub(crate) const OF_VEHICLE: &str = "a recorded vehicle";

/// Most bytes of a line of a trace; the first holds the scenario and its world.
const MOST_LINE: u64 = 16 << 20;

/// The `replay` subcommand: plays a trace again and compares.
pub(crate) fn replay(devices: Devices, path: &Path) -> Result<Exit, Failure> {
    match compare(devices, path)? {
        Ok(()) => print("the devices did the same to the last byte"),
        Err(error) => not_the_same(error),
    }
}

/// Says why a recording could not be repeated.
pub(crate) fn not_the_same(error: ReplayError) -> Result<Exit, Failure> {
    match error {
        ReplayError::Differs(_) => {
            print(&format!("FAILED: {error}"))?;
            Ok(Exit::Failed)
        }
        ReplayError::Malformed { .. } => Err(Failure::usage(error)),
        _ => Err(Failure::system(error)),
    }
}

/// A trace file; the first error is kept for the end.
pub(crate) struct TraceFile {
    path: PathBuf,
    out: BufWriter<File>,
    error: Option<io::Error>,
    flushed: Instant,
    /// Of all lines.
    digest: SipHasher13,
}

impl TraceFile {
    /// Begins one where no recording is yet: a drive is not recorded twice.
    pub(crate) fn begin(path: PathBuf, header: Header) -> Result<Self, Failure> {
        if std::fs::metadata(&path).is_ok_and(|about| about.is_file() && about.len() > 0) {
            let why = "is there already, and is left alone; name another --trace or remove it";
            refuse!("{} {why}", visible::name(&path));
        }
        let mut trace = Self::create(path).map_err(Failure::usage)?;
        trace.record(&Record::Header(Box::new(header)));
        trace.flush().map(|()| trace)
    }

    /// Replaces a trace that is there, and nothing else.
    pub(crate) fn create(path: PathBuf) -> anyhow::Result<Self> {
        let file = Results::at(&path, MARKS)
            .and_then(Results::into_file)
            .with_context(|| format!("cannot write the trace {}", visible::name(&path)))?;
        Ok(Self {
            path,
            out: BufWriter::with_capacity(1 << 16, file),
            error: None,
            flushed: Instant::now(),
            digest: SipHasher13::new(),
        })
    }

    /// Adds a line.
    fn line(&mut self, line: &str) {
        self.digest.write(line.as_bytes());
        self.digest.write_u8(b'\n');
        if self.error.is_none() {
            let written = writeln!(self.out, "{line}");
            self.keep_error(written);
        }
    }

    /// Adds a record.
    pub(crate) fn record(&mut self, record: &Record) {
        if let Some(line) = record.to_line() {
            self.line(&line);
        }
    }

    /// Writes out what there is so far.
    ///
    /// # Errors
    /// When not all could be written, now or before.
    pub(crate) fn flush(&mut self) -> Result<(), Failure> {
        if let Err(error) = self.out.flush() {
            self.error.get_or_insert(error);
        }
        match &self.error {
            None => Ok(()),
            Some(error) => Err(Failure::system(anyhow!("{}: {error}", self.incomplete()))),
        }
    }

    fn incomplete(&self) -> String {
        let shown = visible::name(&self.path);
        format!("cannot write the trace {shown}; it is not complete")
    }

    /// Keeps the first error for the end, and reports it at once.
    fn keep_error(&mut self, written: io::Result<()>) {
        if let Err(error) = written
            && self.error.is_none()
        {
            complain(&format!("{}: {error}", self.incomplete()));
            self.error = Some(error);
        }
    }

    /// Adds what a run has to tell.
    pub(crate) fn take(&mut self, run: &mut Run) {
        while let Some(line) = run.poll_trace() {
            self.line(&line);
        }
        if self.flushed.elapsed() > FLUSH {
            self.flushed = Instant::now();
            let written = self.out.flush();
            self.keep_error(written);
        }
    }

    /// Makes sure that all has been written. Returns a digest of it, in hexadecimal digits.
    pub(crate) fn finish(mut self) -> Result<String, Failure> {
        self.flush()?;
        Ok(format!("{:032x}", self.digest.finish128().as_u128()))
    }
}

/// Result of playing a recording again.
pub(crate) type Played = Result<(), ReplayError>;

/// The lines of a recording.
pub(crate) struct Lines<'a> {
    path: &'a Path,
    file: BufReader<PatientFile>,
    line: String,
}

impl<'a> Lines<'a> {
    pub(crate) fn open(path: &'a Path) -> Result<Self, Failure> {
        let file = PatientFile::open(path)
            .with_context(|| format!("cannot read the trace {}", visible::name(path)))
            .map_err(Failure::usage)?;
        Ok(Self {
            path,
            file: BufReader::new(file),
            line: String::new(),
        })
    }

    /// The next line; `None` at the end.
    pub(crate) fn next(&mut self) -> Result<Option<&str>, Failure> {
        let shown = visible::name(self.path);
        self.line.clear();
        // What is not a trace may be one line without an end.
        let mut some = self.file.by_ref().take(MOST_LINE + 1);
        let read = some.read_line(&mut self.line).map_err(|error| {
            let unfit = matches!(error.kind(), ErrorKind::InvalidData | ErrorKind::TimedOut);
            let why = anyhow!(error).context(format!("cannot read the trace {shown}"));
            if unfit {
                Failure::usage(why)
            } else {
                Failure::system(why)
            }
        })?;
        if read as u64 > MOST_LINE {
            refuse!("{shown} is not a trace: a line of it is too long");
        }
        let line = self.line.trim_end_matches(['\r', '\n']);
        Ok((read > 0).then_some(line))
    }

    /// The first line.
    fn first(&mut self) -> Result<&str, Failure> {
        let empty = Failure::usage(anyhow!("the trace {} is empty", visible::name(self.path)));
        self.next()?.ok_or(empty)
    }

    /// The same; refuses the recording of a vehicle, which no run of the model repeats.
    fn first_of_run(&mut self) -> Result<&str, Failure> {
        let shown = visible::name(self.path);
        let first = self.first()?;
        match serde_json::from_str(first) {
            Ok(Record::Header(header)) if header.source.file == OF_VEHICLE => {
                Err(Failure::usage(anyhow!(
                    "{shown} is a recording of a vehicle, which the model does not repeat byte for byte; `sim compare \
                     {shown}` shows both, and `sim tap -v` prints what passes as it records"
                )))
            }
            _ => Ok(first),
        }
    }
}

/// Plays a recording again and compares.
pub(crate) fn compare(devices: Devices, path: &Path) -> Result<Played, Failure> {
    let mut lines = Lines::open(path)?;
    match Replay::begin(devices, lines.first_of_run()?) {
        Ok(replay) => play(&mut lines, replay),
        Err(error) => Ok(Err(error)),
    }
}

/// Plays a recording again for an observer, which is made when it is known what it is
/// a recording of.
pub(crate) fn view<V: Observer>(
    devices: Devices,
    path: &Path,
    viewer: impl FnOnce(&Run) -> Result<V, Failure>,
) -> Result<(V, Played), Failure> {
    let mut lines = Lines::open(path)?;
    let begun = Replay::begin(devices, lines.first_of_run()?);
    let replay = begun
        .with_context(|| visible::name(path))
        .map_err(Failure::usage)?;
    let mut viewer = viewer(replay.run())?;
    let played = play(&mut lines, replay.watched(&mut viewer))?;
    Ok((viewer, played))
}

fn play(lines: &mut Lines<'_>, mut replay: Replay<'_>) -> Result<Played, Failure> {
    while let Some(line) = lines.next()? {
        if let Err(error) = replay.line(line) {
            return Ok(Err(error));
        }
        if replay.is_enough() {
            return Ok(Ok(()));
        }
    }
    Ok(replay.finish())
}

/// First line of a recording, as far as it can be read.
pub(crate) fn header(path: &Path) -> Result<Option<Box<Header>>, Failure> {
    Ok(match serde_json::from_str(Lines::open(path)?.first()?) {
        Ok(Record::Header(header)) => Some(header),
        _ => None,
    })
}

/// Kind of time of a recording's client, and the date at which it begins, in seconds since 1970: the second line.
pub(crate) fn client_time(path: &Path) -> Result<(Cow<'static, str>, Option<u64>), Failure> {
    let mut lines = Lines::open(path)?;
    lines.first()?;
    Ok(match lines.next()?.map(serde_json::from_str) {
        Some(Ok(Record::Time { client, date })) => (client, date),
        _ => ("none".into(), None),
    })
}

/// Plays a recording again up to a time. Its client has closed its ports then.
pub(crate) fn until(
    devices: Devices,
    path: &Path,
    at: SimTime,
    observer: &mut dyn Observer,
) -> Result<Run, Failure> {
    let (mut run, open, is_there) = part(devices, path, at, Some(observer))?;
    if !is_there || run.finished().is_some() {
        let (path, now) = (visible::name(path), run.rig().now());
        refuse!("--until: {path} ends at {now}; give an earlier time");
    }
    for port in open {
        run.detach(port, at).map_err(Failure::system)?;
    }
    Ok(run)
}

/// Plays a recording again up to a time. Returns also the ports that its client has open then, and whether
/// there is more of it.
pub(crate) fn part(
    devices: Devices,
    path: &Path,
    at: SimTime,
    mut observer: Option<&mut dyn Observer>,
) -> Result<(Run, BTreeSet<PortId>, bool), Failure> {
    let failed = |error| Failure::usage(anyhow!("{}: {error}", visible::name(path)));
    let mut lines = Lines::open(path)?;
    let mut replay = Replay::begin(devices, lines.first_of_run()?).map_err(failed)?;
    if let Some(observer) = &mut observer {
        replay = replay.watched(*observer);
    }
    let (mut open, mut is_there) = (BTreeSet::new(), false);
    while let Some(line) = lines.next()? {
        if let Ok(line) = serde_json::from_str::<Timed>(line) {
            if line.over() > at.as_nanos() {
                is_there = true;
                // What the client did next stands behind bytes of the device.
                match line.kind.as_str() {
                    "out" | "event" | "pose" => continue,
                    _ => break,
                }
            }
            let port = line.port.map(PortId::from);
            match (line.kind.as_str(), port) {
                ("attach", Some(port)) => open.insert(port),
                ("detach", Some(port)) => open.remove(&port),
                _ => false,
            };
        }
        replay.line(line).map_err(failed)?;
    }
    let mut run = replay.into_run();
    if let Some(observer) = observer {
        while observer.next_sample() <= at && run.finished().is_none() {
            run.advance(observer.next_sample())
                .map_err(Failure::system)?;
            observer.sample(&run);
        }
    }
    run.advance(at).map_err(Failure::system)?;
    Ok((run, open, is_there))
}
