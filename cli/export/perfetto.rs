//! Slices, counters and flows on tracks (TrackEvent), for Perfetto.
//!
//! Times are simulated, in nanoseconds. The numbers of fields are those of `perfetto_trace.proto`.

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::io::{self, Write as _};
use std::time::Duration;

use prost::encoding::{bytes, double, fixed64, int32, int64, string, uint32, uint64};
use rigsim_core::SimTime;
use rigsim_core::event::{Event, Level, code};
use rigsim_core::message::Sender;
use rigsim_core::rig::PortId;
use rigsim_runner::Run;
use rigsim_runner::trace::Record;

use super::frames::Frame;
use super::{About, Group, Item, Out, Writer};

/// A reply answers the oldest request of its command that is no older, or else the newest.
const PATIENCE: Duration = Duration::from_millis(100);
/// Name of an argument of the first event.
pub(super) const MARK: &str = "version of sim";
/// Bits of a byte on a line.
const BITS: u64 = 10;
/// Number of the client's process, which real ones need not have.
const CLIENT: i32 = 1;

/// What a track event says of its track, by the numbers of `TrackEvent.Type`.
#[derive(Clone, Copy)]
enum Kind {
    Begin = 1,
    End = 2,
    Instant = 3,
    Counter = 4,
}

/// One line of a device.
struct Line {
    /// Tracks of what the client sends and receives.
    tracks: [u64; 2],
    /// Times at which the last frames of both end, ns.
    free: [u64; 2],
    /// Duration of a byte, ns.
    byte: u64,
    /// Requests without a reply, by their commands: their times and flows.
    open: BTreeMap<u8, VecDeque<(SimTime, u64)>>,
    /// Flows of replies to which the next request is the reaction.
    replied: Vec<u64>,
}

pub(super) struct Perfetto {
    out: Out,
    /// By parent and name.
    tracks: BTreeMap<(u64, String), u64>,
    /// Tracks of the devices.
    devices: Vec<u64>,
    lines: BTreeMap<PortId, Line>,
    groups: Vec<Group>,
    /// Tracks of all values, and what they showed last.
    shown: Vec<(u64, f64)>,
    flows: u64,
    /// Tracks whose last slice has not ended.
    open: BTreeSet<u64>,
}

impl Perfetto {
    pub(super) fn begin(run: &Run, about: &About, out: Out) -> io::Result<Self> {
        let mut perfetto = Self {
            out,
            tracks: BTreeMap::new(),
            devices: Vec::new(),
            lines: BTreeMap::new(),
            groups: Group::all(run),
            shown: Vec::new(),
            flows: 0,
            open: BTreeSet::new(),
        };
        let scenario = run.scenario();
        let track = perfetto.track(0, "scenario", None)?;
        perfetto.event(0, Kind::Instant, track, |event| {
            add_argument(MARK, env!("CARGO_PKG_VERSION"), event);
            add_argument("seed", &run.seed().to_string(), event);
            add_argument("command", &about.command, event);
            named(&scenario.title, "run", event);
        })?;
        for plan in &scenario.rig.devices {
            let track = perfetto.track(0, &plan.name, None)?;
            perfetto.devices.push(track);
        }
        for link in scenario.rig.links() {
            let parent = perfetto.devices[link.id.device];
            let name = |what: &str| match link.id.link {
                0 => what.to_owned(),
                _ => format!("{} {what}", link.name),
            };
            let line = Line {
                tracks: [
                    perfetto.track(parent, &name("requests"), None)?,
                    perfetto.track(parent, &name("replies"), None)?,
                ],
                free: [0; 2],
                byte: BITS * 1_000_000_000 / u64::from(link.baud.max(1)),
                open: BTreeMap::new(),
                replied: Vec::new(),
            };
            perfetto.lines.insert(link.id, line);
        }
        for group in std::mem::take(&mut perfetto.groups) {
            let parent = perfetto.devices[group.device];
            for (name, unit) in group.fields() {
                let mut counter = Vec::new();
                string::encode(6, &unit, &mut counter);
                let name = format!("{}.{name}", group.of);
                let track = perfetto.track(parent, &name, Some((8, counter)))?;
                perfetto.shown.push((track, f64::NAN));
            }
            perfetto.groups.push(group);
        }
        Ok(perfetto)
    }

    fn packet(&mut self, field: u32, data: &Vec<u8>, at: Option<u64>) -> io::Result<()> {
        let (mut packet, mut whole) = (Vec::new(), Vec::new());
        if let Some(at) = at {
            uint64::encode(8, &at, &mut packet);
        }
        uint32::encode(10, &1, &mut packet);
        bytes::encode(field, data, &mut packet);
        bytes::encode(1, &packet, &mut whole);
        self.out.write_all(&whole)
    }

    /// A track, which is described when it is first used; `kind` is a further field of its description.
    fn track(&mut self, parent: u64, name: &str, kind: Option<(u32, Vec<u8>)>) -> io::Result<u64> {
        let next = self.tracks.len() as u64 + 1;
        let key = (parent, name.to_owned());
        if let Some(known) = self.tracks.get(&key) {
            return Ok(*known);
        }
        self.tracks.insert(key, next);
        let mut track = Vec::new();
        uint64::encode(1, &next, &mut track);
        string::encode(2, &name.to_owned(), &mut track);
        if parent > 0 {
            uint64::encode(5, &parent, &mut track);
        }
        if let Some((field, kind)) = kind {
            bytes::encode(field, &kind, &mut track);
        }
        self.packet(60, &track, None)?;
        Ok(next)
    }

    fn event(
        &mut self,
        at: u64,
        kind: Kind,
        track: u64,
        more: impl FnOnce(&mut Vec<u8>),
    ) -> io::Result<()> {
        let mut event = Vec::new();
        int32::encode(9, &(kind as i32), &mut event);
        uint64::encode(11, &track, &mut event);
        more(&mut event);
        self.packet(11, &event, Some(at))
    }

    /// Ends the slice of a track, and begins one that ends with the next.
    fn next_slice(&mut self, at: u64, track: u64, next: Option<(&str, &str)>) -> io::Result<()> {
        if self.open.remove(&track) {
            self.event(at, Kind::End, track, |_| ())?;
        }
        if let Some((name, category)) = next {
            self.open.insert(track);
            self.event(at, Kind::Begin, track, |event| named(name, category, event))?;
        }
        Ok(())
    }

    fn frame(&mut self, frame: &Frame) -> io::Result<()> {
        let Some(line) = self.lines.get_mut(&frame.port) else {
            return Ok(());
        };
        let from_client = frame.sender == Sender::Client;
        let (at, long) = (
            frame.at.as_nanos(),
            line.byte * frame.found.bytes.len() as u64,
        );
        // What the client sends begins then; what it receives has arrived by then.
        let begin = if from_client {
            at
        } else {
            at.saturating_sub(long)
        };
        let side = usize::from(!from_client);
        let begin = begin.max(line.free[side]);
        let end = if from_client {
            begin + long
        } else {
            at.max(begin)
        };
        line.free[side] = end;

        let (mut flows, mut ended) = (Vec::new(), Vec::new());
        let message = frame.found.message.as_ref();
        let command = frame.found.command.filter(|_| message.is_some());
        match command {
            Some(command) if from_client => {
                self.flows += 1;
                flows.push(self.flows);
                ended.append(&mut line.replied);
                let open = line.open.entry(command).or_default();
                open.push_back((frame.at, self.flows));
            }
            Some(command) => {
                let open = line.open.entry(command).or_default();
                let is_old = |(sent, _): &mut (SimTime, u64)| *sent + PATIENCE < frame.at;
                while open.len() > 1 && open.pop_front_if(is_old).is_some() {}
                if let Some((_, flow)) = open.pop_front() {
                    flows.push(flow);
                    line.replied.push(flow);
                }
            }
            None => {}
        }
        let track = line.tracks[side];
        let (name, category) = match (message, from_client) {
            (Some((info, _)), true) => (info.name, "request"),
            (Some((info, _)), false) => (info.name, "reply"),
            (None, _) => ("no message", "noise"),
        };
        let hex = frame.found.bytes.iter().map(|byte| format!("{byte:02X}"));
        let hex: Vec<String> = hex.collect();
        self.event(begin, Kind::Begin, track, |event| {
            named(name, category, event);
            add_argument("words", &frame.found.show(), event);
            add_argument("bytes", &hex.join(" "), event);
            fixed64::encode_repeated(47, &flows, event);
            fixed64::encode_repeated(48, &ended, event);
        })?;
        self.event(end, Kind::End, track, |_| ())
    }

    fn happened(&mut self, event: &Event) -> io::Result<()> {
        let device = self.devices.get(event.device).copied().unwrap_or_default();
        let at = event.at.as_nanos();
        if let Some((name, id)) = event.kind.fault() {
            let track = self.track(device, &format!("fault {name}"), None)?;
            return match event.kind.code() {
                code::FAULT_ARMED => self.next_slice(at, track, Some((id, "fault"))),
                code::FAULT_CLEARED => self.next_slice(at, track, None),
                _ => {
                    let text = event.kind.to_string();
                    self.event(at, Kind::Instant, track, |event| {
                        named(&text, "fault", event)
                    })
                }
            };
        }
        let category = match event.kind.level() {
            Level::Traffic => return Ok(()),
            _ if event.kind.is_client_error() => "client_error",
            Level::Notice => "notice",
            Level::Warning => "warning",
        };
        let track = self.track(device, "events", None)?;
        self.event(at, Kind::Instant, track, |data| {
            named(event.kind.code().as_str(), category, data);
            add_argument("text", &event.kind.to_string(), data);
        })
    }

    fn record(&mut self, record: &Record) -> io::Result<()> {
        let scenario = self.track(0, "scenario", None)?;
        match record {
            Record::Step { t, step, what } => {
                let track = self.track(scenario, &format!("step {step}"), None)?;
                let next = (what == "begun").then_some((step.as_str(), "step"));
                self.next_slice(*t, track, next)
            }
            Record::Failure { t, what, .. } => self.event(*t, Kind::Instant, scenario, |event| {
                named(what, "failure", event)
            }),
            Record::Wait {
                t,
                thread,
                name,
                wait,
            } => {
                let (mut client, mut about) = (Vec::new(), Vec::new());
                int32::encode(1, &CLIENT, &mut client);
                string::encode(6, &"client".to_owned(), &mut client);
                self.track(0, "client", Some((3, client)))?;
                int32::encode(1, &CLIENT, &mut about);
                int64::encode(2, &i64::try_from(*thread).unwrap_or(i64::MAX), &mut about);
                string::encode(5, name, &mut about);
                // It belongs to its process by the number of that.
                let track = self.track(0, &format!("thread {thread}"), Some((4, about)))?;
                let next = (!wait.is_empty()).then_some((wait.as_str(), "wait"));
                self.next_slice(*t, track, next)
            }
            Record::End { t, .. } => {
                let mut open = self.open.clone().into_iter();
                open.try_for_each(|track| self.next_slice(*t, track, None))
            }
            _ => Ok(()),
        }
    }

    fn values(&mut self, at: u64, run: &Run) -> io::Result<()> {
        let values = self.groups.iter().flat_map(|group| group.values(run));
        let values: Vec<f64> = values.collect();
        for (index, value) in values.into_iter().enumerate() {
            let (track, shown) = self.shown[index];
            if value.is_finite() && value != shown {
                self.shown[index].1 = value;
                self.event(at, Kind::Counter, track, |event| {
                    double::encode(44, &value, event)
                })?;
            }
        }
        Ok(())
    }
}

impl Writer for Perfetto {
    fn take(&mut self, at: SimTime, item: &Item<'_>) -> io::Result<()> {
        match item {
            Item::Event(event) => self.happened(event),
            Item::Frame(frame) => self.frame(frame),
            Item::Record(record) => self.record(record),
            Item::Values(run) => self.values(at.as_nanos(), run),
        }
    }

    fn finish(mut self: Box<Self>) -> io::Result<()> {
        self.out.flush()
    }
}

/// Adds name and category to a track event.
fn named(name: &str, category: &str, event: &mut Vec<u8>) {
    string::encode(22, &category.to_owned(), event);
    string::encode(23, &name.to_owned(), event);
}

/// Adds an argument to a track event.
fn add_argument(name: &str, text: &str, event: &mut Vec<u8>) {
    let mut note = Vec::new();
    string::encode(6, &text.to_owned(), &mut note);
    string::encode(10, &name.to_owned(), &mut note);
    bytes::encode(4, &note, event);
}
