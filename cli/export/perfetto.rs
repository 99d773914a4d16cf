//! Slices, counters and flows on tracks (TrackEvent), for Perfetto.
//!
//! Times are simulated, in nanoseconds. The numbers of fields are those of `perfetto_trace.proto`.

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::io::{self, Write as _};
use std::time::Duration;

use prost::encoding::{bytes, double, fixed64, uint64};
use rigsim_core::SimTime;
use rigsim_core::event::{Event, Hex, Level, code};
use rigsim_core::rig::PortId;
use rigsim_runner::Run;
use rigsim_runner::trace::Record;

use super::frames::{Frame, Way};
use super::{About, Item, Number, Out, Writer};

/// A reply answers the oldest request of its command that is no older, or else the newest.
const PATIENCE: Duration = Duration::from_millis(100);
/// Name of an argument of the first event.
pub(super) const MARK: &str = "version of sim";
/// Bits of a byte on a line.
const BITS: u64 = 10;
/// Number of the client's process, which real ones need not have.
const CLIENT: u64 = 1;

/// What an event says of its track: `TrackEvent.Type`.
const BEGIN: u64 = 1;
const END: u64 = 2;
const INSTANT: u64 = 3;
const COUNTER: u64 = 4;

/// One direction of a line.
struct Side {
    track: u64,
    /// Duration of a byte, ns.
    byte: u64,
    /// Time at which the last frame ends, ns.
    free: u64,
}

pub(super) struct Perfetto {
    out: Out,
    /// By parent and name.
    tracks: BTreeMap<(u64, String), u64>,
    devices: Vec<u64>,
    sides: BTreeMap<Way, Side>,
    counters: Vec<u64>,
    /// Number of the last flow.
    flow: u64,
    /// Times and flows of requests without a reply, by their commands.
    requests: BTreeMap<(PortId, u8), VecDeque<(SimTime, u64)>>,
    /// Flows of replies to which the next request is the reaction.
    replied: BTreeMap<PortId, Vec<u64>>,
    /// Tracks whose last slice has not ended.
    open: BTreeSet<u64>,
}

impl Perfetto {
    pub(super) fn begin(run: &Run, about: &About, out: Out) -> io::Result<Self> {
        let mut perfetto = Self {
            out,
            tracks: BTreeMap::new(),
            devices: Vec::new(),
            sides: BTreeMap::new(),
            counters: Vec::new(),
            flow: 0,
            requests: BTreeMap::new(),
            replied: BTreeMap::new(),
            open: BTreeSet::new(),
        };
        let scenario = run.scenario();
        let track = perfetto.track(0, "scenario", &[])?;
        let mut about_run = argument(MARK, env!("CARGO_PKG_VERSION"));
        about_run.extend(argument("seed", &run.seed().to_string()));
        about_run.extend(argument("command", &about.command));
        perfetto.event(
            0,
            INSTANT,
            track,
            &[&named("run", &scenario.title), &about_run],
        )?;
        for plan in &scenario.rig.devices {
            let track = perfetto.track(0, &plan.name, &[])?;
            perfetto.devices.push(track);
        }
        for link in scenario.rig.links() {
            let byte = BITS * 1_000_000_000 / u64::from(link.baud.max(1));
            for (is_reply, what) in [(false, "requests"), (true, "replies")] {
                let name = match link.id.link {
                    0 => what.to_owned(),
                    _ => format!("{} {what}", link.name),
                };
                let track = perfetto.track(perfetto.devices[link.id.device], &name, &[])?;
                perfetto.sides.insert(
                    (link.id, is_reply),
                    Side {
                        track,
                        byte,
                        free: 0,
                    },
                );
            }
        }
        for group in &about.groups {
            let parent = group.device.map_or(0, |device| perfetto.devices[device]);
            for (name, unit) in &group.fields {
                let name = format!("{}.{name}", group.of);
                let track = perfetto.track(
                    parent,
                    &name,
                    &message(8, &[&message(6, &[unit.as_bytes()])]),
                )?;
                perfetto.counters.push(track);
            }
        }
        Ok(perfetto)
    }

    fn packet(&mut self, parts: &[&[u8]]) -> io::Result<()> {
        let sequence = number(10, 1);
        self.out
            .write_all(&message(1, &[&sequence, &parts.concat()]))
    }

    /// A track, which is described when it is first used; `kind` is more of its description.
    fn track(&mut self, parent: u64, name: &str, kind: &[u8]) -> io::Result<u64> {
        let next = self.tracks.len() as u64 + 1;
        let track = *self.tracks.entry((parent, name.to_owned())).or_insert(next);
        if track == next {
            let name = message(2, &[name.as_bytes()]);
            let parent = if parent > 0 {
                number(5, parent)
            } else {
                Vec::new()
            };
            self.packet(&[&message(60, &[&number(1, track), &name, &parent, kind])])?;
        }
        Ok(track)
    }

    fn event(&mut self, at: u64, kind: u64, track: u64, more: &[&[u8]]) -> io::Result<()> {
        let event = [&number(9, kind), &number(11, track), &more.concat()[..]].concat();
        self.packet(&[&number(8, at), &message(11, &[&event])])
    }

    /// Ends the slice of a track, and begins one that ends with the next.
    fn next_slice(&mut self, at: u64, track: u64, next: Option<(&str, &str)>) -> io::Result<()> {
        if self.open.remove(&track) {
            self.event(at, END, track, &[])?;
        }
        if let Some((category, name)) = next {
            self.open.insert(track);
            self.event(at, BEGIN, track, &[&named(category, name)])?;
        }
        Ok(())
    }

    fn frame(&mut self, frame: &Frame) -> io::Result<()> {
        let Some(side) = self.sides.get_mut(&frame.way) else {
            return Ok(());
        };
        let (port, is_reply) = frame.way;
        let (at, long) = (
            frame.at.as_nanos(),
            side.byte * frame.found.bytes.len() as u64,
        );
        // What the client sends begins then; what it receives has arrived by then.
        let begin = if is_reply {
            at.saturating_sub(long)
        } else {
            at
        };
        let begin = begin.max(side.free);
        let end = if is_reply {
            at.max(begin)
        } else {
            begin + long
        };
        let track = side.track;
        side.free = end;

        let (mut flows, mut ended) = (Vec::new(), Vec::new());
        let found = frame.found.message.as_ref();
        if let Some(command) = frame.found.command.filter(|_| found.is_some()) {
            let open = self.requests.entry((port, command)).or_default();
            let replied = self.replied.entry(port).or_default();
            let is_old = |(sent, _): &mut (SimTime, u64)| *sent + PATIENCE < frame.at;
            while open.len() > 1 && open.pop_front_if(is_old).is_some() {}
            if is_reply {
                flows.extend(open.pop_front().map(|(_, flow)| flow));
                replied.extend(&flows);
            } else {
                self.flow += 1;
                flows.push(self.flow);
                ended.append(replied);
                open.push_back((frame.at, self.flow));
            }
        }
        let (category, name) = match found {
            Some((info, _)) if is_reply => ("reply", info.name),
            Some((info, _)) => ("request", info.name),
            None => ("noise", "no message"),
        };
        let mut more = named(category, name);
        more.extend(argument("words", &frame.found.show()));
        more.extend(argument("bytes", &Hex(&frame.found.bytes).to_string()));
        fixed64::encode_repeated(47, &flows, &mut more);
        fixed64::encode_repeated(48, &ended, &mut more);
        self.event(begin, BEGIN, track, &[&more])?;
        self.event(end, END, track, &[])
    }

    fn happened(&mut self, event: &Event) -> io::Result<()> {
        let (at, text) = (event.at.as_nanos(), event.kind.to_string());
        let device = self.devices.get(event.device).copied().unwrap_or_default();
        if let Some((name, id)) = event.kind.fault() {
            let track = self.track(device, &format!("fault {name}"), &[])?;
            return match event.kind.code() {
                code::FAULT_ARMED => self.next_slice(at, track, Some(("fault", id))),
                code::FAULT_CLEARED => self.next_slice(at, track, None),
                _ => self.event(at, INSTANT, track, &[&named("fault", &text)]),
            };
        }
        let category = match event.kind.level() {
            Level::Traffic => return Ok(()),
            _ if event.kind.is_client_error() => "client_error",
            Level::Notice => "notice",
            Level::Warning => "warning",
        };
        let track = self.track(device, "events", &[])?;
        let named = named(category, event.kind.code().name);
        self.event(at, INSTANT, track, &[&named, &argument("text", &text)])
    }

    fn record(&mut self, record: &Record) -> io::Result<()> {
        let scenario = self.track(0, "scenario", &[])?;
        match record {
            Record::Step { t, step, what } => {
                let track = self.track(scenario, &format!("step {step}"), &[])?;
                let next = (what == "begun").then_some(("step", step.as_str()));
                self.next_slice(*t, track, next)
            }
            Record::Failure { t, what, .. } => {
                self.event(*t, INSTANT, scenario, &[&named("failure", what)])
            }
            Record::Wait {
                t,
                thread,
                name,
                wait,
            } => {
                let process = number(1, CLIENT);
                let client = message(6, &[b"client"]);
                self.track(0, "client", &message(3, &[&process, &client]))?;
                let about = [process, number(2, *thread), message(5, &[name.as_bytes()])];
                // It belongs to its process by the number of that.
                let name = format!("thread {thread}");
                let track = self.track(0, &name, &message(4, &[&about.concat()]))?;
                // It ran before it waited, which takes no simulated time.
                self.event(*t, INSTANT, track, &[&named("run", "runs")])?;
                self.next_slice(*t, track, (!wait.is_empty()).then_some(("wait", wait)))
            }
            Record::End { t, .. } => {
                let mut open = self.open.clone().into_iter();
                open.try_for_each(|track| self.next_slice(*t, track, None))
            }
            _ => Ok(()),
        }
    }

    fn values(&mut self, at: u64, values: &[Number]) -> io::Result<()> {
        for (index, value) in values.iter().enumerate().filter(|(_, value)| value.is_new) {
            let mut number = Vec::new();
            double::encode(44, &value.number, &mut number);
            self.event(at, COUNTER, self.counters[index], &[&number])?;
        }
        Ok(())
    }
}

impl Writer for Perfetto {
    fn take(&mut self, at: SimTime, item: Item) -> io::Result<()> {
        match item {
            Item::Event(event) => self.happened(&event),
            Item::Frame(frame) => self.frame(&frame),
            Item::Record(record) => self.record(&record),
            Item::Values(values) => self.values(at.as_nanos(), &values),
            Item::Bytes(..) => Ok(()),
        }
    }

    fn finish(mut self: Box<Self>) -> io::Result<()> {
        self.out.flush()
    }
}

fn number(field: u32, number: u64) -> Vec<u8> {
    let mut data = Vec::new();
    uint64::encode(field, &number, &mut data);
    data
}

/// A message or a text of these parts.
fn message(field: u32, parts: &[&[u8]]) -> Vec<u8> {
    let mut data = Vec::new();
    bytes::encode(field, &parts.concat(), &mut data);
    data
}

/// Category and name of a track event.
fn named(category: &str, name: &str) -> Vec<u8> {
    [
        message(22, &[category.as_bytes()]),
        message(23, &[name.as_bytes()]),
    ]
    .concat()
}

/// An argument of a track event.
fn argument(name: &str, text: &str) -> Vec<u8> {
    message(
        4,
        &[
            &message(6, &[text.as_bytes()]),
            &message(10, &[name.as_bytes()]),
        ],
    )
}
