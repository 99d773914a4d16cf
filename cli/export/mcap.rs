//! Recordings as MCAP with messages of Foxglove, for Foxglove, Rerun and PlotJuggler.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::io::{self, Write as _};

use ::mcap::records::{MessageHeader, Metadata};
use ::mcap::write::NoSeek;
use ::mcap::{Attachment, McapResult, WriteOptions, Writer as File};
use foxglove::messages::{
    Color, CubePrimitive, FrameTransform, LaserScan, LinePrimitive, Log, Point3, Pose, PoseInFrame,
    Quaternion, SceneEntity, SceneUpdate, TextPrimitive, Timestamp, Vector3,
    line_primitive::Type as Form, log::Level as Kind,
};
use foxglove::{Encode, Schema};
use prost::Message;
use prost::encoding::{bool, bytes, double, string};
use prost_types::field_descriptor_proto::{Label, Type};
use prost_types::{DescriptorProto, FieldDescriptorProto, FileDescriptorProto, FileDescriptorSet};
use rigsim_core::SimTime;
use rigsim_core::event::{Event, Level};
use rigsim_physics::world::{Feature, FeatureKind};
use rigsim_runner::Run;
use rigsim_runner::trace::Record;
use serde_json::{Value, json};

use super::frames::Frame;
use super::{About, Item, Number, Out, VERSION, Writer};
use crate::control::{drawing, outline};
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
    about: About,
    channels: BTreeMap<String, u16>,
    /// Of the devices.
    names: Vec<String>,
    /// The world, and the faults that are active on each device, as they were drawn last.
    drawn: Option<(Vec<LinePrimitive>, Vec<String>)>,
    metadata: BTreeMap<String, String>,
    /// What the run was made of, as it was read.
    files: Vec<(String, String)>,
    failures: Vec<Value>,
    counts: BTreeMap<&'static str, u64>,
}

impl Mcap {
    pub(super) fn begin(run: &Run, about: About, out: Out) -> io::Result<Self> {
        let scenario = run.scenario();
        let options = WriteOptions::new().disable_seeking(true).library(VERSION);
        let metadata = [
            ("command", about.command.clone()),
            ("seed", run.seed().to_string()),
            ("title", scenario.title.clone()),
        ];
        // The scenario, the files that it is based on, and the world file.
        let source = &scenario.source;
        let others = source.base.iter().chain(&about.world);
        let others = others.map(|other| (&other.file, &other.text));
        let files = std::iter::once((&source.file, &source.text)).chain(others);
        let devices = scenario.rig.devices.iter();
        Ok(Self {
            out: options.create(NoSeek::new(out)).map_err(io::Error::other)?,
            channels: BTreeMap::new(),
            names: devices.map(|plan| plan.name.clone()).collect(),
            drawn: None,
            metadata: metadata.map(|(key, value)| (key.to_owned(), value)).into(),
            files: files
                .map(|(file, text)| (visible::name(file), text.clone()))
                .collect(),
            failures: Vec::new(),
            counts: BTreeMap::new(),
            about,
        })
    }

    fn put<M: Encode + Message>(
        &mut self,
        topic: &str,
        at: SimTime,
        message: &M,
    ) -> McapResult<()> {
        let schema = || M::get_schema().unwrap_or_else(|| Schema::new("", "", &[][..]));
        self.put_bytes(topic, at, &message.encode_to_vec(), schema, &[])
    }

    fn put_bytes(
        &mut self,
        topic: &str,
        at: SimTime,
        data: &[u8],
        schema: impl FnOnce() -> Schema,
        units: &[(String, String)],
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
                let units = units.iter().cloned().collect();
                let channel = self.out.add_channel(schema, topic, "protobuf", &units)?;
                self.channels.insert(topic.to_owned(), channel);
                channel
            }
        };
        let log_time = self.about.date.saturating_add(at.as_nanos());
        let header = MessageHeader {
            channel_id,
            sequence: 0,
            log_time,
            publish_time: log_time,
        };
        self.out.write_to_known_channel(&header, data)
    }

    fn time(&self, at: SimTime) -> Option<Timestamp> {
        let time = self.about.date.saturating_add(at.as_nanos());
        let seconds = u32::try_from(time / 1_000_000_000).ok()?;
        Timestamp::new_checked(seconds, u32::try_from(time % 1_000_000_000).ok()?)
    }

    fn values(&mut self, at: SimTime, values: &[Number]) -> McapResult<()> {
        let groups = std::mem::take(&mut self.about.groups);
        let mut values = values.iter();
        for group in &groups {
            let mut data = Vec::new();
            for (tag, value) in (1..).zip(values.by_ref().take(group.fields.len())) {
                double::encode(tag, &value.number, &mut data);
            }
            let kind = group
                .kind
                .map_or_else(String::new, |kind| format!("{kind}_"));
            let fields = group
                .fields
                .iter()
                .map(|(name, _)| (name.as_str(), Type::Double));
            let schema = || schema(&format!("{kind}{}", group.of), fields);
            self.put_bytes(&group.topic, at, &data, schema, &group.fields)?;
        }
        self.about.groups = groups;
        Ok(())
    }

    fn scenes(&mut self, at: SimTime, run: &Run) -> McapResult<()> {
        let world = world(run);
        let faults: Vec<String> = self.names.iter().map(|name| active(run, name)).collect();
        let timestamp = self.time(at);
        let drawn = self.drawn.replace((world.clone(), faults.clone()));
        let scene = |entities| SceneUpdate {
            entities,
            ..SceneUpdate::default()
        };
        if drawn.as_ref().is_none_or(|(drawn, _)| *drawn != world) {
            let world = SceneEntity {
                timestamp,
                frame_id: "world".to_owned(),
                id: "world".to_owned(),
                lines: world,
                ..SceneEntity::default()
            };
            self.put("/world", at, &scene(vec![world]))?;
        }
        if drawn.is_none_or(|(_, drawn)| drawn != faults) {
            let vehicles = self.names.iter().zip(&faults).enumerate();
            let vehicle = |(index, (name, text)): (_, (&String, &String))| SceneEntity {
                timestamp,
                ..vehicle(run, index, name, text)
            };
            self.put("/vehicles", at, &scene(vehicles.map(vehicle).collect()))?;
        }
        for (device, name) in self.names.clone().into_iter().enumerate() {
            let place = run
                .rig()
                .motion(device)
                .map(|motion| motion.pose)
                .unwrap_or_default();
            let pose = pose([place.x, place.y, 0.0], place.heading);
            let transform = FrameTransform {
                timestamp,
                parent_frame_id: "world".to_owned(),
                child_frame_id: name.clone(),
                translation: pose.position,
                rotation: pose.orientation,
            };
            self.put("/tf", at, &transform)?;
            let (frame_id, pose) = ("world".to_owned(), Some(pose));
            self.put(
                &format!("/{name}/pose"),
                at,
                &PoseInFrame {
                    timestamp,
                    frame_id,
                    pose,
                },
            )?;
            for (index, ray) in drawing(run.rig(), device).echoes.iter().enumerate() {
                let scan = LaserScan {
                    timestamp,
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
        let (port, is_reply) = frame.way;
        let mut data = Vec::new();
        let direction = if is_reply { "reply" } else { "request" };
        string::encode(1, &direction.to_owned(), &mut data);
        bytes::encode(2, &frame.found.bytes, &mut data);
        string::encode(3, &frame.found.show(), &mut data);
        bool::encode(4, &frame.is_noise, &mut data);
        let topic = format!("/{}/line_{}", self.names[port.device], port.link);
        self.put_bytes(&topic, at, &data, || schema("Line", LINE.into_iter()), &[])
    }

    fn event(&mut self, at: SimTime, event: &Event) -> McapResult<()> {
        let level = match event.kind.level() {
            Level::Traffic => return Ok(()),
            Level::Notice => Kind::Info,
            Level::Warning => Kind::Warning,
        };
        let code = event.kind.code().name;
        *self.counts.entry(code).or_default() += 1;
        let name = self.names.get(event.device).cloned().unwrap_or_default();
        self.log(at, level, &name, format!("{} [{code}]", event.kind))
    }

    fn log(&mut self, at: SimTime, level: Kind, name: &str, message: String) -> McapResult<()> {
        let log = Log {
            timestamp: self.time(at),
            level: level.into(),
            message,
            name: name.to_owned(),
            ..Log::default()
        };
        self.put("/log", at, &log)
    }

    fn record(&mut self, at: SimTime, record: Record) -> McapResult<()> {
        match record {
            Record::Step { step, what, .. } => self.log(
                at,
                Kind::Info,
                "scenario",
                format!("step \"{step}\" {what}"),
            ),
            Record::Failure { step, what, .. } => {
                let failure = json!({"t": at.as_secs_f64(), "step": step, "what": what});
                self.failures.push(failure);
                self.log(at, Kind::Error, "scenario", what)
            }
            Record::End { passed, .. } => {
                self.metadata
                    .insert("passed".to_owned(), passed.to_string());
                Ok(())
            }
            _ => Ok(()),
        }
    }

    fn end(&mut self) -> McapResult<()> {
        let report =
            json!({"run": self.metadata, "failures": self.failures, "events": self.counts});
        self.files
            .push(("report.json".to_owned(), report.to_string()));
        for (name, text) in std::mem::take(&mut self.files) {
            let format = if name.ends_with(".json") {
                "json"
            } else {
                "toml"
            };
            self.out.attach(&Attachment {
                log_time: self.about.date,
                create_time: self.about.date,
                name,
                media_type: format!("application/{format}"),
                data: Cow::Owned(text.into_bytes()),
            })?;
        }
        let (name, metadata) = ("run".to_owned(), std::mem::take(&mut self.metadata));
        self.out.write_metadata(&Metadata { name, metadata })?;
        self.out.finish().map(|_| ())
    }
}

impl Writer for Mcap {
    fn take(&mut self, at: SimTime, item: Item) -> io::Result<()> {
        let taken = match item {
            Item::Event(event) => self.event(at, &event),
            Item::Frame(frame) => self.frame(at, &frame),
            Item::Record(record) => self.record(at, record),
            Item::Values(values) => self.values(at, &values),
            Item::Bytes(..) => Ok(()),
        };
        taken.map_err(io::Error::other)
    }

    fn draw(&mut self, at: SimTime, run: &Run) -> io::Result<()> {
        self.scenes(at, run).map_err(io::Error::other)
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

fn pose([x, y, z]: [f64; 3], heading: f64) -> Pose {
    Pose {
        position: Some(Vector3 { x, y, z }),
        orientation: Some(Quaternion {
            x: 0.0,
            y: 0.0,
            z: (heading / 2.0).sin(),
            w: (heading / 2.0).cos(),
        }),
    }
}

fn color([r, g, b]: [f64; 3], a: f64) -> Option<Color> {
    Some(Color { r, g, b, a })
}

/// Everything that lies and stands around, as outlines.
fn world(run: &Run) -> Vec<LinePrimitive> {
    let line = |feature: Feature| LinePrimitive {
        r#type: Form::LineLoop.into(),
        thickness: 0.05,
        points: outline(&feature.shape)
            .iter()
            .map(|[x, y]| Point3 {
                x: *x,
                y: *y,
                z: 0.0,
            })
            .collect(),
        color: match feature.kind {
            FeatureKind::Obstacle => color(GREY, 1.0),
            FeatureKind::Strip | FeatureKind::Tag(_) => color(BLUE, 1.0),
            FeatureKind::Slope | FeatureKind::Friction(_) => color(BROWN, 1.0),
        },
        ..LinePrimitive::default()
    };
    run.rig().world().features().map(line).collect()
}

/// A vehicle in its own frame: red, and with their names, while faults are active.
fn vehicle(run: &Run, index: usize, name: &str, faults: &str) -> SceneEntity {
    let size = run.rig().world().bodies().nth(index).map(|(_, size)| size);
    let cube = |[x, y]: [f64; 2], [length, width]: [f64; 2], height: f64, color| CubePrimitive {
        pose: Some(pose([x, y, height / 2.0], 0.0)),
        size: Some(Vector3 {
            x: length,
            y: width,
            z: height,
        }),
        color,
    };
    let paint = color(if faults.is_empty() { GREEN } else { RED }, 0.8);
    let body = cube([0.0; 2], size.unwrap_or_default(), HEIGHT, paint);
    let wheels = drawing(run.rig(), index).wheels.into_iter();
    let wheels = wheels.map(|wheel| {
        cube(
            wheel.place,
            [wheel.length, wheel.width],
            wheel.length,
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
