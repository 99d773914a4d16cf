//! Recordings as MCAP with messages of Foxglove, for Foxglove, Rerun and PlotJuggler.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::io::{self, Write as _};

use ::mcap::records::{MessageHeader, Metadata};
use ::mcap::write::NoSeek;
use ::mcap::{Attachment, McapResult, WriteOptions, Writer as File};
use foxglove::messages::{
    self as fg, Color, CubePrimitive, FrameTransform, LaserScan, LinePrimitive, Log, Point3,
    PoseInFrame, Quaternion, SceneEntity, SceneUpdate, TextPrimitive, Timestamp, Vector3,
};
use foxglove::{Encode, Schema};
use prost::Message as _;
use prost::encoding::{bool, bytes, double, string};
use prost_types::field_descriptor_proto::{Label, Type};
use prost_types::{DescriptorProto, FieldDescriptorProto, FileDescriptorProto, FileDescriptorSet};
use rigsim_core::SimTime;
use rigsim_core::event::{Event, Level};
use rigsim_core::message::Sender;
use rigsim_physics::world::{Feature, FeatureKind};
use rigsim_runner::trace::Record;
use rigsim_runner::{Run, Scenario};
use serde_json::json;

use super::frames::Frame;
use super::{About, Group, Item, Out, Writer};
use crate::control::outline;
use crate::visible;

const GREY: [f64; 3] = [0.5, 0.5, 0.5];
const BLUE: [f64; 3] = [0.1, 0.4, 0.8];
const BROWN: [f64; 3] = [0.6, 0.45, 0.2];
const GREEN: [f64; 3] = [0.2, 0.6, 0.3];
const RED: [f64; 3] = [0.85, 0.1, 0.1];
/// Height of vehicles, m; they are drawn from above otherwise.
const HEIGHT: f64 = 0.3;

/// Fields of a message on a line.
const LINE: [(&str, Type); 4] = [
    ("direction", Type::String),
    ("bytes", Type::Bytes),
    ("words", Type::String),
    ("is_noise", Type::Bool),
];

pub(super) struct Mcap {
    out: File<NoSeek<Out>>,
    date: u64,
    channels: BTreeMap<String, u16>,
    names: Vec<String>,
    groups: Vec<Group>,
    /// Faults that are active, of each device, as they are drawn.
    faults: Option<Vec<String>>,
    about: BTreeMap<String, String>,
    /// What the run was made of, as it was read.
    files: Vec<(String, String)>,
    /// The world as it was drawn last.
    world: Vec<LinePrimitive>,
    failures: Vec<serde_json::Value>,
    counts: BTreeMap<&'static str, u64>,
}

impl Mcap {
    pub(super) fn begin(run: &Run, about: &About, out: Out) -> io::Result<Self> {
        let scenario = run.scenario();
        let options = WriteOptions::new()
            .disable_seeking(true)
            .library(concat!("sim ", env!("CARGO_PKG_VERSION")));
        let known = [
            ("command", about.command.clone()),
            ("seed", run.seed().to_string()),
            ("title", scenario.title.clone()),
        ];
        Ok(Self {
            out: options.create(NoSeek::new(out)).map_err(io::Error::other)?,
            date: about.date,
            channels: BTreeMap::new(),
            names: scenario
                .rig
                .devices
                .iter()
                .map(|plan| plan.name.clone())
                .collect(),
            groups: Group::all(run),
            faults: None,
            about: known.map(|(key, value)| (key.to_owned(), value)).into(),
            files: files(scenario, about),
            world: Vec::new(),
            failures: Vec::new(),
            counts: BTreeMap::new(),
        })
    }

    fn put<M: Encode + prost::Message>(
        &mut self,
        topic: &str,
        at: SimTime,
        message: &M,
    ) -> McapResult<()> {
        let schema = || M::get_schema().unwrap_or_else(|| Schema::new("", "", &[][..]));
        self.put_bytes(
            topic,
            at,
            &message.encode_to_vec(),
            schema,
            &BTreeMap::new(),
        )
    }

    fn put_bytes(
        &mut self,
        topic: &str,
        at: SimTime,
        data: &[u8],
        schema: impl FnOnce() -> Schema,
        about: &BTreeMap<String, String>,
    ) -> McapResult<()> {
        let channel_id = match self.channels.get(topic) {
            Some(channel) => *channel,
            None => {
                let Schema {
                    name,
                    encoding,
                    data,
                } = schema();
                let schema = self.out.add_schema(&name, &encoding, &data)?;
                let channel = self.out.add_channel(schema, topic, "protobuf", about)?;
                self.channels.insert(topic.to_owned(), channel);
                channel
            }
        };
        let log_time = self.date.saturating_add(at.as_nanos());
        let header = MessageHeader {
            channel_id,
            sequence: 0,
            log_time,
            publish_time: log_time,
        };
        self.out.write_to_known_channel(&header, data)
    }

    fn time(&self, at: SimTime) -> Option<Timestamp> {
        let time = self.date.saturating_add(at.as_nanos());
        let seconds = u32::try_from(time / 1_000_000_000).ok()?;
        Timestamp::new_checked(seconds, u32::try_from(time % 1_000_000_000).ok()?)
    }

    fn values(&mut self, at: SimTime, run: &Run) -> McapResult<()> {
        for group in std::mem::take(&mut self.groups) {
            let kind = run.rig().spec(group.device).map_or("", |spec| spec.id);
            let topic = format!("/{}/{}", self.names[group.device], group.of);
            let mut data = Vec::new();
            for (tag, value) in (1..).zip(group.values(run)) {
                double::encode(tag, &value, &mut data);
            }
            let fields = || group.fields().map(|(name, _)| (name, Type::Double));
            let message = || schema(&format!("{kind}_{}", group.of), fields());
            let units = group.fields().map(|(name, unit)| (name.to_owned(), unit));
            self.put_bytes(&topic, at, &data, message, &units.collect())?;
            self.groups.push(group);
        }
        let faults: Vec<String> = self.names.iter().map(|name| active(run, name)).collect();
        let world = world(run);
        if self.faults.is_none() || self.world != world {
            self.world.clone_from(&world);
            let world = SceneEntity {
                timestamp: self.time(at),
                frame_id: "world".to_owned(),
                id: "world".to_owned(),
                lines: world,
                ..SceneEntity::default()
            };
            let world = SceneUpdate {
                entities: vec![world],
                ..SceneUpdate::default()
            };
            self.put("/world", at, &world)?;
        }
        if self.faults.as_ref() != Some(&faults) {
            let vehicle = |(index, text): (usize, &String)| {
                vehicle(run, index, &self.names[index], text, self.time(at))
            };
            let scene = SceneUpdate {
                entities: faults.iter().enumerate().map(vehicle).collect(),
                ..SceneUpdate::default()
            };
            self.put("/vehicles", at, &scene)?;
            self.faults = Some(faults);
        }
        for (device, name) in self.names.clone().into_iter().enumerate() {
            let place = run
                .rig()
                .motion(device)
                .map_or_else(Default::default, |motion| motion.pose);
            let pose = pose([place.x, place.y, 0.0], place.heading);
            let transform = FrameTransform {
                timestamp: self.time(at),
                parent_frame_id: "world".to_owned(),
                child_frame_id: name.clone(),
                translation: pose.position,
                rotation: pose.orientation,
            };
            self.put("/tf", at, &transform)?;
            let placed = PoseInFrame {
                timestamp: self.time(at),
                frame_id: "world".to_owned(),
                pose: Some(pose),
            };
            self.put(&format!("/{name}/pose"), at, &placed)?;
            let drawing = run
                .rig()
                .any_device(device)
                .map(|device| device.plant().drawing());
            for (index, ray) in drawing.unwrap_or_default().echoes.iter().enumerate() {
                let scan = LaserScan {
                    timestamp: self.time(at),
                    frame_id: name.clone(),
                    pose: Some(self::pose(
                        [ray.place[0], ray.place[1], HEIGHT],
                        ray.heading,
                    )),
                    start_angle: -ray.opening / 2.0,
                    end_angle: ray.opening / 2.0,
                    ranges: vec![ray.distance.unwrap_or(f64::INFINITY); 9],
                    intensities: Vec::new(),
                };
                self.put(&format!("/{name}/ray_{index}"), at, &scan)?;
            }
        }
        Ok(())
    }

    fn frame(&mut self, at: SimTime, frame: &Frame) -> McapResult<()> {
        let direction = match frame.sender {
            Sender::Client => "request",
            Sender::Device => "reply",
        };
        let mut data = Vec::new();
        string::encode(1, &direction.to_owned(), &mut data);
        bytes::encode(2, &frame.found.bytes, &mut data);
        string::encode(3, &frame.found.show(), &mut data);
        bool::encode(4, &frame.is_noise, &mut data);
        let name = &self.names[frame.port.device];
        let topic = format!("/{name}/line_{}", frame.port.link);
        let about = || schema("Line", LINE.into_iter());
        self.put_bytes(&topic, at, &data, about, &BTreeMap::new())
    }

    fn event(&mut self, event: &Event) -> McapResult<()> {
        let level = match event.kind.level() {
            Level::Traffic => return Ok(()),
            Level::Notice => fg::log::Level::Info,
            Level::Warning => fg::log::Level::Warning,
        };
        let code = event.kind.code().as_str();
        *self.counts.entry(code).or_default() += 1;
        let name = self.names.get(event.device).cloned().unwrap_or_default();
        self.log(event.at, level, name, format!("{} [{code}]", event.kind))
    }

    fn log(
        &mut self,
        at: SimTime,
        level: fg::log::Level,
        name: String,
        message: String,
    ) -> McapResult<()> {
        let log = Log {
            timestamp: self.time(at),
            level: level.into(),
            message,
            name,
            ..Log::default()
        };
        self.put("/log", at, &log)
    }

    fn record(&mut self, at: SimTime, record: &Record) -> McapResult<()> {
        match record {
            Record::Step { step, what, .. } => {
                let text = format!("step \"{step}\" {what}");
                self.log(at, fg::log::Level::Info, "scenario".to_owned(), text)
            }
            Record::Failure { step, what, .. } => {
                self.failures
                    .push(json!({"t": at.as_secs_f64(), "step": step, "what": what}));
                self.log(
                    at,
                    fg::log::Level::Error,
                    "scenario".to_owned(),
                    what.clone(),
                )
            }
            Record::End { passed, .. } => {
                self.about.insert("passed".to_owned(), passed.to_string());
                Ok(())
            }
            _ => Ok(()),
        }
    }

    fn end(&mut self) -> McapResult<()> {
        let report = json!({"run": self.about, "failures": self.failures, "events": self.counts});
        let report = ("report.json".to_owned(), report.to_string());
        let files = std::mem::take(&mut self.files).into_iter().chain([report]);
        for (name, text) in files {
            let media_type = match name.ends_with(".json") {
                true => "application/json",
                false => "application/toml",
            };
            self.out.attach(&Attachment {
                log_time: self.date,
                create_time: self.date,
                name,
                media_type: media_type.to_owned(),
                data: Cow::Owned(text.into_bytes()),
            })?;
        }
        let metadata = std::mem::take(&mut self.about);
        self.out.write_metadata(&Metadata {
            name: "run".to_owned(),
            metadata,
        })?;
        self.out.finish().map(|_| ())
    }
}

impl Writer for Mcap {
    fn take(&mut self, at: SimTime, item: &Item<'_>) -> io::Result<()> {
        let taken = match item {
            Item::Event(event) => self.event(event),
            Item::Frame(frame) => self.frame(at, frame),
            Item::Record(record) => self.record(at, record),
            Item::Values(run) => self.values(at, run),
        };
        taken.map_err(io::Error::other)
    }

    fn finish(mut self: Box<Self>) -> io::Result<()> {
        self.end().map_err(io::Error::other)?;
        self.out.into_inner().into_inner().flush()
    }
}

/// Schema of a flat message.
fn schema<'a>(name: &str, fields: impl Iterator<Item = (&'a str, Type)>) -> Schema {
    let field = |(number, (name, kind)): (i32, (&str, Type))| FieldDescriptorProto {
        name: Some(name.replace('.', "_")),
        number: Some(number),
        label: Some(Label::Optional.into()),
        r#type: Some(kind.into()),
        ..FieldDescriptorProto::default()
    };
    let message = DescriptorProto {
        name: Some(name.to_owned()),
        field: (1..).zip(fields).map(field).collect(),
        ..DescriptorProto::default()
    };
    let file = FileDescriptorProto {
        name: Some(format!("rigsim/{name}.proto")),
        package: Some("rigsim".to_owned()),
        message_type: vec![message],
        syntax: Some("proto3".to_owned()),
        ..FileDescriptorProto::default()
    };
    let set = FileDescriptorSet { file: vec![file] };
    Schema::new(format!("rigsim.{name}"), "protobuf", set.encode_to_vec())
}

fn pose([x, y, z]: [f64; 3], heading: f64) -> fg::Pose {
    fg::Pose {
        position: Some(Vector3 { x, y, z }),
        orientation: Some(Quaternion {
            z: (heading / 2.0).sin(),
            w: (heading / 2.0).cos(),
            ..Quaternion::default()
        }),
    }
}

fn color([r, g, b]: [f64; 3], a: f64) -> Option<Color> {
    Some(Color { r, g, b, a })
}

/// The scenario, the files that it is based on, and the world file.
fn files(scenario: &Scenario, about: &About) -> Vec<(String, String)> {
    let source = &scenario.source;
    let own = (&source.file, &source.text);
    let others = source.base.iter().chain(&about.world);
    let others = others.map(|other| (&other.file, &other.text));
    let all = std::iter::once(own).chain(others);
    all.map(|(file, text)| (visible::name(file), text.clone()))
        .collect()
}

/// Everything that lies and stands around, as outlines.
fn world(run: &Run) -> Vec<LinePrimitive> {
    let line = |feature: Feature| LinePrimitive {
        r#type: fg::line_primitive::Type::LineLoop.into(),
        thickness: 0.05,
        points: outline(&feature.shape)
            .into_iter()
            .map(|[x, y]| Point3 { x, y, z: 0.0 })
            .collect(),
        color: color(
            match feature.kind {
                FeatureKind::Obstacle => GREY,
                FeatureKind::Strip | FeatureKind::Tag(_) => BLUE,
                FeatureKind::Slope | FeatureKind::Friction(_) => BROWN,
            },
            1.0,
        ),
        ..LinePrimitive::default()
    };
    run.rig().world().features().map(line).collect()
}

/// A vehicle in its own frame: red, and with their names, while faults are active.
fn vehicle(
    run: &Run,
    index: usize,
    name: &str,
    faults: &str,
    timestamp: Option<Timestamp>,
) -> SceneEntity {
    let [length, width] = run
        .rig()
        .world()
        .bodies()
        .nth(index)
        .map_or([0.0; 2], |(_, size)| size);
    let cube = |[x, y]: [f64; 2], size: [f64; 3], paint| CubePrimitive {
        pose: Some(pose([x, y, size[2] / 2.0], 0.0)),
        size: Some(Vector3 {
            x: size[0],
            y: size[1],
            z: size[2],
        }),
        color: paint,
    };
    let paint = color(if faults.is_empty() { GREEN } else { RED }, 0.8);
    let body = cube([0.0; 2], [length, width, HEIGHT], paint);
    let drawing = run
        .rig()
        .any_device(index)
        .map(|device| device.plant().drawing());
    let wheels = drawing.unwrap_or_default().wheels.into_iter();
    let wheels = wheels.map(|wheel| {
        cube(
            wheel.place,
            [wheel.length, wheel.width, wheel.length],
            color(GREY, 1.0),
        )
    });
    let text = TextPrimitive {
        pose: Some(pose([0.0, 0.0, 2.0 * HEIGHT], 0.0)),
        billboard: true,
        font_size: 0.2,
        color: color(RED, 1.0),
        text: faults.to_owned(),
        ..TextPrimitive::default()
    };
    SceneEntity {
        timestamp,
        frame_id: name.to_owned(),
        id: name.to_owned(),
        frame_locked: true,
        cubes: std::iter::once(body).chain(wheels).collect(),
        texts: vec![text],
        ..SceneEntity::default()
    }
}

/// What is active on a device, in words.
fn active(run: &Run, device: &str) -> String {
    let steps = run.steps().filter(|step| {
        let acts = matches!(step.key, "fault" | "operator" | "world");
        let is_active = step.begun.is_some() && (step.lasting || step.done.is_none());
        acts && is_active && step.device == device
    });
    steps.map(|step| step.what).collect::<Vec<_>>().join(", ")
}
