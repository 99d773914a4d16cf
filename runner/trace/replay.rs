//! The run again, from its trace.

use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;
use std::time::Duration;

use rigsim_core::SimTime;
use rigsim_core::device::Devices;
use rigsim_core::event::Hex;
use rigsim_core::line::Wire;
use rigsim_core::rig::PortId;
use rigsim_core::settings::SimSettings;
use rigsim_settings::{load_toml, shorten};

use super::observer::Observer;
use crate::rig_file::RigPlan;
use crate::run::record::{FORMAT, Header, MOST_BYTES, PortRecord, Record};
use crate::run::{Run, RunError, RunOptions, StepError};
use crate::scenario::{self, NamedText, Scenario};

/// Most bytes of a port by which the recording and the second run may be apart, since of one
/// instant there is never more. So neither of them fills the memory when the other has nothing.
const MOST_APART: usize = 1 << 16;
/// Simulated time that is played before what came is compared.
const SLICE: Duration = Duration::from_millis(500);
const NANOSECOND: Duration = Duration::from_nanos(1);

/// What devices sent at each port: bytes with their times, ns.
pub type Sent = BTreeMap<PortId, VecDeque<(u64, u8)>>;

/// A second run that is compared with the first as the trace is read.
///
/// The recorded client's bytes are sent at their recorded times, and what the devices send has to
/// be the same bytes at the same times.
pub struct Replay<'o> {
    run: Run,
    observer: Option<&'o mut dyn Observer>,
    /// Bytes that were recorded and that came now, of each port, as far as they are not yet
    /// compared.
    streams: BTreeMap<PortId, Stream>,
    line: usize,
    /// Time at which the client last did something.
    acted: u64,
    ended: bool,
    /// Set if what the devices send is kept instead of compared.
    keeps: bool,
}

#[derive(Default)]
struct Stream {
    recorded: VecDeque<(u64, u8)>,
    now: VecDeque<(u64, u8)>,
    compared: u64,
}

impl Stream {
    fn differs(&self, port: PortId) -> ReplayError {
        let at = |byte: Option<&(u64, u8)>| byte.map(|(t, byte)| (SimTime::from_nanos(*t), *byte));
        ReplayError::Differs(Box::new(Difference {
            port,
            offset: self.compared,
            recorded: at(self.recorded.front()),
            found: at(self.now.front()),
        }))
    }
}

/// First difference of a second run.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error(
    "device {} link {}: byte {offset} differs: {} recorded, {} in the second run",
    port.device, port.link, shown(*recorded), shown(*found)
)]
pub struct Difference {
    /// The port that sent the byte.
    pub port: PortId,
    /// Index of the byte among those that the device sent there, from 0.
    pub offset: u64,
    /// Time and byte of the recording; `None` if it has none.
    pub recorded: Option<(SimTime, u8)>,
    /// Time and byte of the second run; `None` if it has none.
    pub found: Option<(SimTime, u8)>,
}

fn shown(byte: Option<(SimTime, u8)>) -> String {
    byte.map_or_else(
        || "nothing".to_owned(),
        |(at, byte)| format!("{} at {} ns", Hex(&[byte]), at.as_nanos()),
    )
}

/// Reason for which a trace is not repeated.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum ReplayError {
    /// The second run is another one.
    #[error(transparent)]
    Differs(#[from] Box<Difference>),
    /// The trace cannot be read.
    #[error("line {line} of the trace: {why}")]
    Malformed {
        /// Number of the line, from 1.
        line: usize,
        /// Reason.
        why: String,
    },
    /// The second run cannot go on.
    #[error(transparent)]
    Run(#[from] RunError),
}

impl<'o> Replay<'o> {
    /// Repeats a whole trace of these devices.
    ///
    /// # Errors
    /// Where the second run first differs, or what is wrong with the trace.
    pub fn all<'l>(
        devices: Devices,
        lines: impl IntoIterator<Item = &'l str>,
    ) -> Result<(), ReplayError> {
        let mut lines = lines.into_iter();
        let mut replay = Self::begin(devices, lines.next().unwrap_or_default())?;
        for line in lines {
            replay.line(line)?;
        }
        replay.finish()
    }

    /// Begins with the first line of a trace of these devices.
    ///
    /// # Errors
    /// When it is not a header, or the scenario in it cannot be read any more.
    pub fn begin(devices: Devices, line: &str) -> Result<Self, ReplayError> {
        let malformed = |why| ReplayError::Malformed { line: 1, why };
        let record = read(line, 1).map_err(|error| match error {
            ReplayError::Malformed { why, .. } => {
                malformed(format!("a trace begins with its header: {why}"))
            }
            other => other,
        })?;
        let Record::Header(header) = record else {
            return Err(malformed("a trace begins with its header".to_owned()));
        };
        if header.format != FORMAT {
            let why = format!("format {} is not known; allowed: {FORMAT}", header.format);
            return Err(malformed(why));
        }
        Self::of(devices, &header).map_err(malformed)
    }

    fn of(devices: Devices, header: &Header) -> Result<Self, String> {
        Ok(Self {
            run: start(devices, header)?,
            observer: None,
            streams: BTreeMap::new(),
            line: 1,
            acted: 0,
            ended: false,
            keeps: false,
        })
    }

    /// The devices of a recording with this header.
    ///
    /// # Errors
    /// What is wrong with it.
    pub fn plan(devices: Devices, header: &Header) -> Result<RigPlan, String> {
        scenario_of(devices, header).map(|scenario| scenario.rig)
    }

    /// Plays what clients and people did in a recording with this header, which may be another than
    /// was recorded, until `end`; returns what the devices sent at each port, with times in ns. An
    /// observer looks on.
    ///
    /// # Errors
    /// What is wrong with the header or with a record.
    pub fn play<'r>(
        devices: Devices,
        header: &Header,
        records: impl IntoIterator<Item = &'r Record>,
        end: SimTime,
        observer: Option<&'o mut dyn Observer>,
    ) -> Result<Sent, ReplayError> {
        let malformed = |why| ReplayError::Malformed { line: 1, why };
        let mut replay = Self::of(devices, header).map_err(malformed)?;
        replay.keeps = true;
        replay.observer = observer;
        for record in records {
            replay.line += 1;
            replay.record(record.clone())?;
        }
        replay.advance(end)?;
        // The last bytes of each port are written down then.
        replay.run.end();
        replay.take_own()?;
        let streams = replay.streams.into_iter();
        Ok(streams.map(|(port, stream)| (port, stream.now)).collect())
    }

    /// The same with an observer from now on.
    #[must_use]
    pub fn watched<'n>(self, observer: &'n mut dyn Observer) -> Replay<'n> {
        let observer = Some(observer);
        Replay { observer, ..self }
    }

    /// The second run, as far as it has come.
    #[must_use]
    pub fn run(&self) -> &Run {
        &self.run
    }

    /// The second run, to go on with it.
    #[must_use]
    pub fn into_run(self) -> Run {
        self.run
    }

    /// Returns whether the observer wants no more of it.
    #[must_use]
    pub fn is_enough(&self) -> bool {
        let observer = self.observer.as_ref();
        observer.is_some_and(|observer| observer.has_enough())
    }

    /// Takes a further line.
    ///
    /// # Errors
    /// Where the second run first differs, or what is wrong with the line.
    pub fn line(&mut self, line: &str) -> Result<(), ReplayError> {
        self.line += 1;
        if line.trim().is_empty() {
            return Ok(());
        }
        self.record(read(line, self.line)?)
    }

    fn record(&mut self, record: Record) -> Result<(), ReplayError> {
        if let Some(observer) = &mut self.observer {
            observer.record(&record);
        }
        match record {
            Record::Host { .. }
            | Record::Event { .. }
            | Record::Pose { .. }
            | Record::Time { .. }
            | Record::Step { .. }
            | Record::Wait { .. }
            | Record::Pace { .. }
            // How the client ended may be written behind the end of the run.
            | Record::Failure { .. } => return Ok(()),
            _ if self.ended => {
                let why = "nothing is done behind the end".to_owned();
                return Err(self.malformed(why));
            }
            Record::Header(_) => {
                return Err(self.malformed("a second header".to_owned()));
            }
            Record::Attach { t, port } => {
                let (at, port) = self.client_acts_at(t, port)?;
                self.run.attach(port, at)?;
            }
            Record::Detach { t, port } => {
                let (at, port) = self.client_acts_at(t, port)?;
                self.run.detach(port, at)?;
            }
            Record::In { t, port, bytes } => {
                let (at, port) = self.client_acts_at(t, port)?;
                self.run.send(port, at, &bytes.0)?;
            }
            Record::Line { t, port, line } => {
                let (at, port) = self.client_acts_at(t, port)?;
                self.run.advance(at)?;
                self.run.set_line(port, line);
            }
            Record::Add { t, text, .. } => {
                self.client_acts(t)?;
                match self.run.add_step(&text) {
                    Ok(_) | Err(StepError::Over) => {}
                    Err(StepError::Run(error)) => return Err(error.into()),
                    Err(error) => return Err(self.malformed(error.to_string())),
                }
            }
            Record::Clear { t, step } => {
                self.client_acts(t)?;
                let Some(index) = self.run.step_named(&step) else {
                    return Err(self.malformed(format!("no step is named \"{step}\"")));
                };
                self.run.clear_step(index)?;
            }
            Record::Publish { t, line } => {
                let at = self.client_acts(t)?;
                // A line that was not used then is not used now either.
                let _ = self.run.publish(at, &line)?;
            }
            Record::Late { t, by, stood } => {
                let at = self.client_acts(t)?;
                self.run.advance(at)?;
                self.run
                    .late(Duration::from_nanos(by), Duration::from_nanos(stood));
            }
            Record::Out { t, dt, port, bytes } => {
                let port = self.port(port)?;
                if bytes.0.len() > MOST_BYTES {
                    let why = format!("no line has more than {MOST_BYTES} bytes");
                    return Err(self.malformed(why));
                }
                let bytes: Vec<(u64, u8)> = spread(t, dt, &bytes.0).collect();
                let last = bytes.last().map_or(t, |(at, _)| *at);
                self.stream(port).recorded.extend(bytes);
                // The line was written after the last of its bytes, so whatever the client did
                // before has been read.
                self.advance(SimTime::from_nanos(last))?;
            }
            Record::End { t, dropped, .. } => {
                if dropped > 0 {
                    let why = format!("it lacks {dropped} lines, which were lost in recording");
                    return Err(self.malformed(why));
                }
                let at = self.client_acts(t)?;
                self.advance(at)?;
                self.run.end();
                self.ended = true;
            }
        }
        // A replay that has enough has not seen all that is to be compared.
        if self.is_enough() {
            return Ok(());
        }
        self.compare()
    }

    /// Ends it: nothing may be missing on either side.
    ///
    /// # Errors
    /// Where the second run first differs, or that the trace has no end.
    pub fn finish(self) -> Result<(), ReplayError> {
        if !self.ended {
            return Err(
                self.malformed("the trace has no end, as after a run that was killed".to_owned())
            );
        }
        for (port, stream) in &self.streams {
            if !stream.recorded.is_empty() || !stream.now.is_empty() {
                return Err(stream.differs(*port));
            }
        }
        Ok(())
    }

    /// The client does something at `t`: the second run advances to just before it.
    fn client_acts(&mut self, t: u64) -> Result<SimTime, ReplayError> {
        if t < self.acted {
            let why = format!("it goes back in time, from {} ns to {t} ns", self.acted);
            return Err(self.malformed(why));
        }
        self.acted = t;
        let at = SimTime::from_nanos(t);
        self.advance(at - NANOSECOND)?;
        Ok(at)
    }

    /// The same at a port, which the scenario has.
    fn client_acts_at(
        &mut self,
        t: u64,
        port: PortRecord,
    ) -> Result<(SimTime, PortId), ReplayError> {
        Ok((self.client_acts(t)?, self.port(port)?))
    }

    /// A port that the scenario has.
    fn port(&self, port: PortRecord) -> Result<PortId, ReplayError> {
        let port = PortId::from(port);
        if self.run.ports().contains(&port) {
            return Ok(port);
        }
        let PortId { device, link } = port;
        let why = format!("the scenario has no device {device} with a link {link}");
        Err(self.malformed(why))
    }

    /// Advances the second run, which may take long, and compares on the way.
    fn advance(&mut self, to: SimTime) -> Result<(), ReplayError> {
        while self.run.rig().now() < to && self.run.finished().is_none() {
            let next = self.run.rig().now() + SLICE;
            let next = next.min(self.sample()).min(to);
            while self.run.step(next)? {
                if self.is_enough() {
                    return Ok(());
                }
            }
            self.compare()?;
        }
        self.sample();
        Ok(())
    }

    /// Calls the observer if it is time, and returns when it is time again.
    fn sample(&mut self) -> SimTime {
        let Some(observer) = &mut self.observer else {
            return SimTime::MAX;
        };
        if observer.next_sample() <= self.run.rig().now() {
            observer.sample(&self.run);
        }
        // An observer that never looks later would stop the time.
        observer
            .next_sample()
            .max(self.run.rig().now() + NANOSECOND)
    }

    fn stream(&mut self, port: PortId) -> &mut Stream {
        self.streams.entry(port).or_default()
    }

    /// Takes what the second run has written down.
    fn take_own(&mut self) -> Result<(), ReplayError> {
        while let Some(line) = self.run.poll_trace() {
            if let Record::Out { t, dt, port, bytes } = read(&line, self.line)? {
                let bytes = spread(t, dt, &bytes.0);
                self.stream(port.into()).now.extend(bytes);
            }
        }
        while let Some(event) = self.run.poll_event() {
            if let Some(observer) = &mut self.observer {
                observer.event(&self.run, &event);
            }
        }
        Ok(())
    }

    fn compare(&mut self) -> Result<(), ReplayError> {
        self.take_own()?;
        if self.keeps {
            return Ok(());
        }
        for (port, stream) in &mut self.streams {
            while let (Some(recorded), Some(found)) = (
                stream.recorded.front().copied(),
                stream.now.front().copied(),
            ) {
                if recorded != found {
                    return Err(stream.differs(*port));
                }
                stream.recorded.pop_front();
                stream.now.pop_front();
                stream.compared += 1;
            }
            if stream.recorded.len().max(stream.now.len()) > MOST_APART {
                return Err(stream.differs(*port));
            }
        }
        Ok(())
    }

    fn malformed(&self, why: String) -> ReplayError {
        ReplayError::Malformed {
            line: self.line,
            why,
        }
    }
}

fn start(devices: Devices, header: &Header) -> Result<Run, String> {
    let scenario = scenario_of(devices, header)?;
    let world = header.world.as_ref().map(NamedText::source);
    let options = RunOptions {
        seed: header.seed,
        wire: match (header.paced, header.adapters) {
            (true, true) => Wire::Paced,
            (true, false) => Wire::Bare,
            (false, _) => Wire::Instant,
        },
        live: header.live,
        trace: true,
    };
    Run::new(Arc::new(scenario), world, options).map_err(|error| error.to_string())
}

fn scenario_of(devices: Devices, header: &Header) -> Result<Scenario, String> {
    let mut base = SimSettings::new(devices);
    load_toml(&header.settings, "settings of the trace", &mut base).map_err(|errors| {
        let errors: Vec<String> = errors.iter().map(ToString::to_string).collect();
        shorten(errors.join("; "))
    })?;
    let scenario = if header.serving {
        RigPlan::parse(header.source.source(), &base).map(Scenario::serving)
    } else {
        scenario::read(&header.source, &base)
    };
    scenario.map_err(|error| error.to_string())
}

fn read(line: &str, number: usize) -> Result<Record, ReplayError> {
    serde_json::from_str(line).map_err(|error| ReplayError::Malformed {
        line: number,
        why: match error.is_eof() {
            true => "it is cut off, as after a run that was killed".to_owned(),
            false => shorten(error.to_string()),
        },
    })
}

fn spread(t: u64, dt: u64, bytes: &[u8]) -> impl Iterator<Item = (u64, u8)> + '_ {
    let times = std::iter::successors(Some(t), move |t| Some(t.saturating_add(dt)));
    times.zip(bytes.iter().copied())
}
