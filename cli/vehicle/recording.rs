//! A recording of a vehicle, and what the model answers to the same bytes at the same times.

use std::collections::BTreeMap;
use std::path::Path;
use std::time::Duration;

use anyhow::anyhow;
use rigsim_core::SimTime;
use rigsim_core::device::host::{Frame, FrameReader, MessageInfo};
use rigsim_core::device::{DeviceSpec, Devices};
use rigsim_core::event::Hex;
use rigsim_core::message::{FieldInfo, Sender, WireType};
use rigsim_core::settings::SimSettings;
use rigsim_runner::trace::{Header, Record, Replay, Sent};

use super::poses::{self, POSE, TimedPose, Track};
use crate::config;
use crate::exit::Failure;
use crate::print::complain;
use crate::recording::Lines;
use crate::visible;

mod rhythm;

/// Longest time to a reply, ns.
const PATIENCE: u64 = 1_000_000_000;
/// Time after a stall of the recording machine, or a late reply, in which changes may be shifted by the
/// same time, ns. After that the motion no longer depends on it.
const SETTLING: u64 = 1_500_000_000;
/// Time before a stall in which bytes may have waited for its end, ns.
const BEFORE: u64 = 200_000_000;
/// A reply was delayed if it is later than usual by more than this, ns, and ten times the spread. The
/// machine stalled if it was late by this.
pub(super) const LATE: u64 = 5_000_000;
/// Longest cycle of measurements, ns: of an R150's speed, and of the pulses of a car's slow wheels. In real time, no
/// message tells where in it the vehicle is.
const CYCLE: u64 = 20_000_000;
/// Parts of a cycle: as many as a model has plays with noise.
const PHASES: u64 = 8;
/// Stands for the link of poses beside the recording.
const POSES: usize = usize::MAX;

/// A recording with the vehicle's replies.
pub(super) struct Recording {
    devices: Devices,
    header: Header,
    pub(super) device: &'static DeviceSpec,
    /// Settings with which the bytes of vehicle and model are read.
    reading: SimSettings,
    /// What the vehicle sent.
    sent: Sent,
    /// What the client did.
    acts: Vec<Record>,
    pub(super) slots: Vec<Slot>,
    /// The vehicle's replies, one place for each slot.
    pub(super) seen: Seen,
    /// Set if it was recorded in real time, where a machine may stall.
    pub(super) is_real: bool,
    /// Set if any bytes of the vehicle can be parsed.
    pub(super) is_understood: bool,
    /// Clock offset of the poses beside it, s, if there are any.
    pub(super) offset: Option<f64>,
    /// When the recording machine stalled, ns.
    stalls: Vec<(u64, u64)>,
    end: SimTime,
    /// How long before the recording the model is switched on, ns: so that it sends by itself when the vehicle does.
    ahead: u64,
}

/// Something that is compared: a request, or a message that the device sends by itself.
#[derive(Clone)]
pub(super) struct Slot {
    /// Time at which the request was complete, ns.
    pub(super) at: u64,
    link: usize,
    command: Option<u8>,
    /// The message that is sent by itself.
    own: Option<&'static MessageInfo>,
    /// Description.
    pub(super) text: String,
    /// Name of the command or message.
    pub(super) name: String,
    /// Unset if the machine stalled at that time.
    pub(super) counts: bool,
    /// How long the machine stalled shortly before, ms.
    pub(super) late: f64,
    /// Set if it only judges the result of a fit.
    pub(super) held_out: bool,
}

impl Slot {
    /// Returns whether it is a pose beside the recording.
    pub(super) fn is_pose(&self) -> bool {
        self.link == POSES
    }
}

/// Replies, one place for each slot.
pub(super) type Seen = Vec<Option<Reply>>;

/// A reply to a slot, or a pose, which has no bytes.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Reply {
    pub(super) at: u64,
    pub(super) bytes: Vec<u8>,
    /// Message, command byte and length; of two replies to the same slot, equal forms have equal
    /// channels.
    pub(super) form: (&'static str, Option<u8>, usize),
    pub(super) info: Option<&'static MessageInfo>,
    /// Time to reply in ms, then the values of [`channels`].
    pub(super) values: Vec<f64>,
}

impl Reply {
    /// A pose, by its values on the wire.
    fn of_pose(on_wire: Vec<f64>) -> Self {
        Self {
            at: 0,
            bytes: Vec::new(),
            form: (POSE.name, None, 0),
            info: Some(&POSE),
            values: std::iter::once(0.0).chain(on_wire).collect(),
        }
    }
}

/// One value of a message.
#[derive(Debug, Clone)]
pub(super) struct Channel {
    pub(super) name: String,
    pub(super) unit: &'static str,
    /// Steps on the wire in one unit.
    pub(super) per: f64,
    /// Set for a bit, a word or a flag, which have no mean.
    pub(super) is_choice: bool,
    /// Set for a byte of a hexadecimal value, which is not rounded.
    pub(super) is_hex: bool,
}

/// The values of a reply: the time to it, then its fields.
pub(super) fn channels(info: Option<&MessageInfo>) -> Vec<Channel> {
    let wait = Channel {
        name: "time to reply".to_owned(),
        unit: "ms",
        per: 1.0,
        is_choice: false,
        is_hex: false,
    };
    let fields = info.into_iter().flat_map(|info| info.fields);
    let of_field = fields.flat_map(|field| {
        let parts = parts(field);
        (0..parts * field.count.unwrap_or(1)).map(move |at| Channel {
            name: match (field.bits.get(at), parts * field.count.unwrap_or(1)) {
                (Some(bit), _) => format!("{}.{bit}", field.name),
                (None, 1) => field.name.to_owned(),
                _ => format!("{}[{at}]", field.name),
            },
            unit: field.unit,
            per: f64::from(field.per),
            is_choice: !field.bits.is_empty()
                || !field.values.is_empty()
                || field.wire == WireType::Bool,
            is_hex: field.hex,
        })
    });
    std::iter::once(wait).chain(of_field).collect()
}

/// Number of values in one element of a field: its bits, or the bytes of a hexadecimal value.
fn parts(field: &FieldInfo) -> usize {
    match (field.bits.len(), field.hex) {
        (0, true) => field.wire.size(),
        (0, false) => 1,
        (bits, _) => bits,
    }
}

#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "at most 32 bits of the wire"
)]
fn take_apart(field: &FieldInfo, number: f64) -> Vec<f64> {
    let (parts, bits) = (parts(field), number as u64);
    let wide = if field.bits.is_empty() { 8 } else { 1 };
    match parts {
        1 if field.bits.is_empty() => vec![number],
        _ => (0..parts)
            .map(|part| (bits >> (wide * part) & ((1 << wide) - 1)) as f64)
            .collect(),
    }
}

struct Timed {
    at: u64,
    link: usize,
    frame: Frame,
}

impl Recording {
    /// Reads a trace; frames are read as with these settings.
    pub(super) fn read(
        devices: Devices,
        path: &Path,
        settings: &SimSettings,
    ) -> Result<Self, Failure> {
        let shown = visible::name(path);
        let wrong = |why: String| Failure::usage(anyhow!("{shown}: {why}"));
        let mut lines = Lines::open(path)?;
        let mut records: Vec<Record> = Vec::new();
        while let Some(line) = lines.next()? {
            // A power cut can leave zeros in place of the last lines.
            match serde_json::from_str(line.trim_end_matches('\0')) {
                Ok(record) => records.push(record),
                // The last line may be incomplete.
                Err(error) if error.is_eof() && lines.next()?.is_none() => {
                    let line = records.len() + 1;
                    complain(&format!(
                        "warning: {shown}: line {line}, the last one, is torn; it is left out"
                    ));
                    break;
                }
                Err(error) => {
                    let (line, column) = (records.len() + 1, error.column());
                    return Err(wrong(format!(
                        "no trace: line {line}, column {column}: {error}"
                    )));
                }
            }
        }
        let mut records = records.into_iter();
        let Some(Record::Header(header)) = records.next() else {
            return Err(wrong("a trace begins with its header".to_owned()));
        };
        Self::of(devices, *header, records.collect(), settings).map_err(wrong)
    }

    pub(super) fn of(
        devices: Devices,
        header: Header,
        records: Vec<Record>,
        settings: &SimSettings,
    ) -> Result<Self, String> {
        let plan = Replay::plan(devices, &header)?;
        let [planned] = &*plan.devices else {
            return Err("a recording of one vehicle is wanted".to_owned());
        };
        let device = planned.device;
        let in_lockstep =
            |record: &Record| matches!(record, Record::Time { client, .. } if client == "lockstep");
        let mut recording = Self {
            devices,
            device,
            reading: settings.clone(),
            sent: Sent::new(),
            is_real: !records.iter().any(in_lockstep),
            is_understood: false,
            header,
            acts: Vec::new(),
            slots: Vec::new(),
            seen: Vec::new(),
            offset: None,
            stalls: Vec::new(),
            end: SimTime::ZERO,
            ahead: 0,
        };
        let (mut client, mut vehicle) = (Sent::new(), Sent::new());
        let mut last = 0;
        for record in records {
            match &record {
                Record::Host { .. } => {
                    return Err("its client was scripted in a file; drive with a client".to_owned());
                }
                Record::In { t, port, bytes } => {
                    last = last.max(*t);
                    let bytes = bytes.0.iter().map(|byte| (*t, *byte));
                    client.entry((*port).into()).or_default().extend(bytes);
                }
                Record::Out { t, dt, port, bytes } => {
                    last = last.max(*t);
                    let bytes = (0u64..)
                        .zip(&bytes.0)
                        .map(|(at, byte)| (t + at * dt, *byte));
                    vehicle.entry((*port).into()).or_default().extend(bytes);
                    continue;
                }
                Record::Late { t, by, .. } => {
                    let is_stall = *by > LATE;
                    let stall = is_stall.then(|| (t.saturating_sub(*by), *t));
                    recording.stalls.extend(stall);
                    continue;
                }
                Record::Attach { .. }
                | Record::Detach { .. }
                | Record::Line { .. }
                | Record::Add { .. }
                | Record::Clear { .. } => {}
                _ => continue,
            }
            recording.acts.push(record);
        }
        recording.end = SimTime::from_nanos(last + PATIENCE);
        let asked = recording.frames(&client, Sender::Client, settings);
        let answers = recording.frames(&vehicle, Sender::Device, settings);
        let is_known = |one: &Timed| one.frame.message.is_some() || one.frame.command.is_some();
        recording.is_understood = answers.iter().any(is_known);
        let slots = if device.host.chatters {
            &answers
        } else {
            &asked
        };
        recording.slots = slots.iter().map(|timed| slot(timed, device)).collect();
        if recording.slots.is_empty() {
            let [by_client, by_vehicle] =
                [&client, &vehicle].map(|sent| sent.values().flatten().count());
            return Err(format!(
                "nothing is in it that could be compared: {by_client} bytes from the client, {by_vehicle} from the vehicle"
            ));
        }
        recording.hold_out();
        recording.seen = recording.align(answers);
        if recording.is_real {
            recording.find_stalls();
            leave_out(&recording.stalls, &mut recording.slots);
            recording.ahead = recording.find_ahead(settings)?;
        }
        recording.sent = vehicle;
        Ok(recording)
    }

    /// The vehicle's replies as they are read with these settings.
    pub(super) fn seen_with(&self, settings: &SimSettings) -> Seen {
        self.align(self.frames(&self.sent, Sender::Device, settings))
    }

    /// Reads all bytes with these settings from now on. Poses are added after that.
    pub(super) fn read_with(&mut self, settings: &SimSettings) {
        self.seen = self.seen_with(settings);
        self.reading = settings.clone();
    }

    /// The usual time between two messages of each kind that the vehicle sends by itself, s.
    pub(super) fn periods(&self) -> Vec<f64> {
        rhythm::periods(&self.slots)
    }

    /// How long before the recording the vehicle may have been switched on, as far as the times tell at which it sends by
    /// itself, ns. A model that sends at other times reports another place and speed.
    fn find_ahead(&self, settings: &SimSettings) -> Result<u64, String> {
        if !self.device.host.chatters {
            return Ok(0);
        }
        let (sent, _) = self.replay(settings, 0, &[])?;
        let frames = self.frames(&sent, Sender::Device, settings);
        let slots: Vec<Slot> = frames.iter().map(|one| slot(one, self.device)).collect();
        Ok(rhythm::lead(&self.slots, &slots))
    }

    /// The first `part` of `of` equal parts.
    pub(super) fn beginning(&self, part: usize, of: usize) -> Self {
        let count = (self.slots.len() * part / of).max(1);
        let last = self.slots[count - 1].at;
        let later = |act: &Record| matches!(act, Record::In { t, .. } if *t > last);
        let acts = self.acts.iter().take_while(|act| !later(act));
        Self {
            header: self.header.clone(),
            reading: self.reading.clone(),
            sent: Sent::new(),
            acts: acts.cloned().collect(),
            slots: self.slots[..count].to_vec(),
            seen: self.seen[..count].to_vec(),
            stalls: Vec::new(),
            end: self.end.min(SimTime::from_nanos(last + PATIENCE)),
            ..*self
        }
    }

    /// Adds poses. Without an offset, it is found from the motion of a model with these `settings`.
    pub(super) fn add_poses(
        &mut self,
        poses: &[TimedPose],
        offset: Option<f64>,
        settings: &SimSettings,
    ) -> Result<(), String> {
        let end = self.end.as_nanos();
        let find = || {
            let times: Vec<u64> = (1..=end / poses::APART)
                .map(|at| at * poses::APART)
                .collect();
            let (_, model) = self.replay(settings, 0, &times)?;
            let found = poses::offset(poses, &model);
            let still =
                "the poses do not move as the model does, or it stands still: give --poses-offset";
            found.ok_or(still.to_owned())
        };
        let offset = offset.map_or_else(find, Ok)?;
        let at = |pose: &TimedPose| {
            let at = Duration::try_from_secs_f64(pose[0] + offset).ok()?;
            u64::try_from(at.as_nanos())
                .ok()
                .filter(|at| (1..end).contains(at))
        };
        let (times, poses): (Vec<u64>, Vec<TimedPose>) = poses
            .iter()
            .filter_map(|pose| Some((at(pose)?, *pose)))
            .unzip();
        if poses.is_empty() {
            let length = self.end.as_secs_f64();
            return Err(format!(
                "no pose is of the recording's {length:.1} s, if {offset} s are added to their times"
            ));
        }
        let still = times.partition_point(|at| *at < self.slots[0].at);
        let slot = |(count, at): (usize, u64)| Slot {
            at,
            link: POSES,
            command: None,
            own: None,
            text: "pose".to_owned(),
            name: "pose".to_owned(),
            counts: true,
            late: 0.0,
            held_out: count % 3 == 2,
        };
        let mut slots: Vec<Slot> = times.into_iter().enumerate().map(slot).collect();
        leave_out(&self.stalls, &mut slots);
        let known = std::mem::take(&mut self.slots)
            .into_iter()
            .zip(self.seen.drain(..));
        let new = slots
            .into_iter()
            .zip(poses::on_wire(&poses, still).map(|pose| Some(Reply::of_pose(pose))));
        let mut all: Vec<(Slot, Option<Reply>)> = known.chain(new).collect();
        all.sort_by_key(|(slot, _)| slot.at);
        (self.slots, self.seen) = all.into_iter().unzip();
        self.offset = Some(offset);
        Ok(())
    }

    /// The replies of the model with these settings.
    pub(super) fn play(&self, settings: &SimSettings, seed: u64) -> Result<Seen, String> {
        let times = self.slots.iter().filter(|slot| slot.is_pose());
        let times: Vec<u64> = times.map(|slot| slot.at).collect();
        let (sent, track) = self.replay(settings, seed, &times)?;
        let mut seen = self.align(self.frames(&sent, Sender::Device, &self.reading));
        let poses = self
            .slots
            .iter()
            .zip(&mut seen)
            .filter(|(slot, _)| slot.is_pose());
        for ((_, seen), pose) in poses.zip(poses::on_wire(&track, 1)) {
            *seen = Some(Reply::of_pose(pose));
        }
        Ok(seen)
    }

    /// Frames of the model, and its poses at these times.
    fn replay(
        &self,
        settings: &SimSettings,
        seed: u64,
        times: &[u64],
    ) -> Result<(Sent, Vec<TimedPose>), String> {
        let mut header = Header {
            settings: config::changed(settings).join("\n"),
            seed,
            ..self.header.clone()
        };
        header.source.set.clear();
        let ahead = self.ahead + self.phase(seed);
        let times: Vec<u64> = times.iter().map(|at| at + ahead).collect();
        let mut track = Track {
            times: &times,
            poses: Vec::new(),
        };
        let sent = Replay::play(
            self.devices,
            &header,
            &self.acts(ahead),
            self.end + Duration::from_nanos(ahead),
            Some(&mut track),
        );
        let mut sent = sent.map_err(|error| error.to_string())?;
        for bytes in sent.values_mut() {
            bytes.retain(|(at, _)| *at >= ahead);
            bytes.iter_mut().for_each(|(at, _)| *at -= ahead);
        }
        for pose in &mut track.poses {
            pose[0] -= ahead as f64 / 1e9;
        }
        Ok((sent, track.poses))
    }

    /// How much earlier a play is switched on, ns: in real time, each at another place in a cycle. That is a scatter of
    /// the model, too.
    fn phase(&self, seed: u64) -> u64 {
        // Few plays are spread over the whole cycle, too.
        let part = 3 * seed % PHASES;
        u64::from(self.is_real) * part * CYCLE / PHASES
    }

    /// What the client did, by the clock of a model that is switched on so much earlier.
    fn acts(&self, ahead: u64) -> Vec<Record> {
        let mut acts = self.acts.clone();
        for act in &mut acts {
            if let Record::In { t, .. }
            | Record::Attach { t, .. }
            | Record::Detach { t, .. }
            | Record::Line { t, .. }
            | Record::Add { t, .. }
            | Record::Clear { t, .. } = act
            {
                *t += ahead;
            }
        }
        acts
    }

    fn frames(&self, sent: &Sent, sender: Sender, settings: &SimSettings) -> Vec<Timed> {
        let mut all = Vec::new();
        for (port, bytes) in sent {
            let Some(device_settings) = settings.of_device(self.device) else {
                continue;
            };
            let mut reader: Box<dyn FrameReader> =
                (self.device.host.frames)(port.link, sender, device_settings);
            for (at, byte) in bytes {
                let found = reader.push(SimTime::from_nanos(*at), *byte).into_iter();
                let link = port.link;
                all.extend(found.map(|frame| Timed {
                    at: *at,
                    link,
                    frame,
                }));
            }
        }
        all.sort_by_key(|timed| timed.at);
        all
    }

    /// Keeps every third of the same kind for the judgement of a fit.
    fn hold_out(&mut self) {
        let mut counts = BTreeMap::new();
        for slot in &mut self.slots {
            let count = counts.entry(slot.text.clone()).or_insert(0usize);
            slot.held_out = *count % 3 == 2;
            *count += 1;
        }
    }

    /// Assigns frames of the device to what they answer: the last request of their command or its neighbour, or bytes
    /// that are not a request. A message that it sends by itself goes to the nearest one of the recording.
    fn align(&self, frames: Vec<Timed>) -> Seen {
        let mut seen: Seen = self.slots.iter().map(|_| None).collect();
        for timed in frames {
            let end = self.slots.partition_point(|slot| slot.at <= timed.at);
            let own = timed.frame.message.as_ref().map(|(info, _)| *info);
            let free = |at: &usize| seen[*at].is_none() && self.slots[*at].link == timed.link;
            let place = if self.device.host.chatters {
                let near = end.saturating_sub(4)..(end + 4).min(self.slots.len());
                let same = near.filter(|at| self.slots[*at].own == own);
                same.filter(free)
                    .min_by_key(|at| self.slots[*at].at.abs_diff(timed.at))
            } else {
                let before = (0..end).rev();
                let recent = before.take_while(|at| self.slots[*at].at + PATIENCE > timed.at);
                let recent: Vec<usize> = recent.filter(free).collect();
                let with = |command| {
                    let same = |at: &usize| self.slots[*at].command == command;
                    let mut recent = recent.iter().copied().filter(same);
                    let last = recent.next()?;
                    let later = end..self.slots.len();
                    let mut soon = later.take_while(|at| self.slots[*at].at < timed.at + LATE);
                    let next = soon.find(|at| free(at) && same(at));
                    Some(self.answered(timed.at, last, [next, recent.next()]))
                };
                with(timed.frame.command).or_else(|| with(None))
            };
            if let Some(place) = place {
                let wait = (timed.at as f64 - self.slots[place].at as f64) / 1e6;
                let wait = if self.device.host.chatters { 0.0 } else { wait };
                seen[place] = Some(reply(timed, wait));
            }
        }
        seen
    }

    /// The last request before a reply, or its neighbour if the vehicle answered that one at about this time. In real
    /// time, a request that comes together with a reply may be before or after it.
    fn answered(&self, reply: u64, last: usize, others: [Option<usize>; 2]) -> usize {
        let seen = |at: usize| self.seen.get(at).and_then(Option::as_ref);
        let is_now = |at: &usize| seen(*at).is_some_and(|seen| seen.at.abs_diff(reply) < LATE);
        let other = others.into_iter().flatten().find(is_now);
        let other = other.filter(|_| self.is_real && seen(last).is_none());
        other.unwrap_or(last)
    }

    /// Records replies that came later than the line can explain; for a device that sends by itself, its most
    /// frequent message.
    fn find_stalls(&mut self) {
        if self.device.host.chatters {
            let times = rhythm::own_times(&self.slots).into_values();
            let often = times.max_by_key(Vec::len).unwrap_or_default();
            let waits = often.windows(2).map(|two| (two[1] - two[0]) as f64 / 1e6);
            let (usual, spread) = middle(&waits.clone().collect::<Vec<_>>());
            let late = |wait: f64| (wait - usual) * 1e6;
            // The vehicle causes longer silences.
            let is_late = (LATE as f64 + 10e6 * spread)..PATIENCE as f64;
            let stalls = often
                .windows(2)
                .zip(waits)
                .filter(|(_, wait)| is_late.contains(&late(*wait)));
            self.stalls.extend(stalls.map(|(two, _)| (two[0], two[1])));
            return;
        }
        let mut waits: BTreeMap<_, Vec<f64>> = Default::default();
        for reply in self.seen.iter().flatten() {
            waits.entry(reply.form).or_default().push(reply.values[0]);
        }
        for (slot, reply) in self.slots.iter().zip(&self.seen) {
            let Some(reply) = reply else { continue };
            let (usual, spread) = middle(&waits[&reply.form]);
            if (reply.values[0] - usual) * 1e6 > LATE as f64 + 10e6 * spread {
                self.stalls.push((slot.at, reply.at));
            }
        }
    }
}

/// Leaves out the time in which the recording machine stalled, and marks the time after it.
fn leave_out(stalls: &[(u64, u64)], slots: &mut [Slot]) {
    for slot in slots {
        for (from, to) in stalls {
            slot.counts &= !(*from..=*to + 1).contains(&slot.at)
                && !(slot.at..slot.at + BEFORE).contains(from);
            if (*from..to + SETTLING).contains(&slot.at) {
                slot.late += (to - from) as f64 / 1e6;
            }
        }
    }
}

/// Median, and median deviation from it.
pub(super) fn middle(values: &[f64]) -> (f64, f64) {
    let median = |mut values: Vec<f64>| {
        values.sort_by(f64::total_cmp);
        values.get(values.len() / 2).copied().unwrap_or(0.0)
    };
    let centre = median(values.to_vec());
    let spread = values.iter().map(|value| (value - centre).abs()).collect();
    (centre, median(spread))
}

fn slot(timed: &Timed, device: &DeviceSpec) -> Slot {
    let frame = &timed.frame;
    let info = frame.message.as_ref().map(|(info, _)| *info);
    let name = match (info, frame.command) {
        (Some(info), _) => info.name.to_owned(),
        (None, Some(command)) => format!("0x{command:02X}"),
        (None, None) => "bytes that are not a message".to_owned(),
    };
    Slot {
        at: timed.at,
        link: timed.link,
        command: frame.command,
        own: info.filter(|_| device.host.chatters),
        text: match device.host.chatters {
            true => name.clone(),
            false => format!("{name} | {}", Hex(&frame.bytes)),
        },
        name,
        counts: true,
        late: 0.0,
        held_out: false,
    }
}

fn reply(timed: Timed, wait: f64) -> Reply {
    let Frame {
        bytes,
        command_byte,
        message,
        ..
    } = timed.frame;
    let info = message.as_ref().map(|(info, _)| *info);
    let mut values = vec![wait];
    for (field, numbers) in message
        .iter()
        .flat_map(|(info, payload)| info.values(payload))
    {
        values.extend(numbers.iter().flat_map(|number| take_apart(field, *number)));
    }
    let name = info.map_or("no message", |info| info.name);
    Reply {
        at: timed.at,
        form: (name, command_byte, bytes.len()),
        bytes,
        info,
        values,
    }
}
