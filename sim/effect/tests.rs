//! What each fault does, seen from the client.

mod catalogue;
mod firmware;
mod hardiness;
mod lifecycle;
mod mecanum;
mod protocol;
mod r150;
mod wire;

use std::time::Duration;

use rigsim_physics::r150::{Load, Rail};
use rigsim_physics::world::{Obstacle, Strip, Tag};
use rigsim_physics::{Pose, WorldMap, WorldSettings};
use rigsim_settings::SimTime;

use toml::Spanned;
use toml::de::{DeTable, DeValue};

use super::*;
use crate::device::{EffectError, EffectHandle, Setup};
use crate::event::{Event, EventKind};
use crate::line::Wire;
use crate::mecanum::{Mecanum, MecanumSettings};
use crate::mecanum_device::codec as packets;
use crate::mecanum_device::packet::{Request as Packet, Status};
use crate::mecanum_device::settings::ByteOrder;
use crate::r150::{R150, R150Settings};
use crate::r150_device::codec;
use crate::r150_device::command::SystemInfo;
use crate::r150_device::command::{Reply, Request};
use crate::r150_device::tests::read_reply;
use crate::rig::{PortId, Rig, RigSettings};
use crate::scanner::Decoded;

const MAIN: PortId = PortId { device: 0, link: 0 };
const ROS: PortId = PortId { device: 0, link: 1 };
const NOTHING: [u8; 0] = [];
const MS: fn(u64) -> Duration = Duration::from_millis;

fn rig(map: WorldMap, seed: u64) -> Rig {
    Rig::new(RigSettings {
        world: WorldSettings::default(),
        map,
        wire: Wire::Bare,
        seed,
    })
}

/// An R150 with 10 W on each output.
fn r150() -> Rig {
    r150_with(1, |_| {})
}

fn r150_with(seed: u64, change: impl FnOnce(&mut R150Settings)) -> Rig {
    let mut rig = rig(WorldMap::default(), seed);
    let mut settings = R150Settings::default();
    change(&mut settings);
    rig.add(&crate::r150::R150_SPEC, &Setup::new("r150", &settings));
    rig.with_device(0, |r150: &mut R150, _, _| {
        for rail in Rail::ALL {
            r150.plant.set_load(rail, Load::Power(5.0));
        }
    });
    rig.attach(MAIN, SimTime::ZERO).unwrap();
    rig
}

/// A car on a strip, over a tag, with a wall in front; its link times out after 400 ms.
fn car(ros: bool) -> Rig {
    let mut map = WorldMap::default();
    map.obstacles
        .add(Obstacle::wall([1.5, -3.0], [1.5, 3.0], 0.1))
        .unwrap();
    map.strips.push(Strip {
        points: vec![[-2.0, 0.0], [2.0, 0.0]],
        ..Strip::default()
    });
    map.tags.push(Tag {
        at: [0.0, 0.0],
        number: 77,
    });
    let mut rig = rig(map, 1);
    let mut settings = MecanumSettings::default();
    // Only what a fault does to an echo is of interest.
    let ultrasonic = &mut settings.plant.ultrasonic;
    (ultrasonic.noise, ultrasonic.crosstalk) = (0.0, 0.0);
    settings.firmware.link_timeout = Some(MS(400));
    let setup = Setup {
        links: if ros { 2 } else { 1 },
        ..Setup::new("car", &settings)
    };
    rig.add(&crate::mecanum::MECANUM_SPEC, &setup);
    rig.attach(MAIN, SimTime::ZERO).unwrap();
    rig.attach(ROS, SimTime::ZERO).unwrap();
    rig
}

/// The most that a reading of 0x06 is off by its noise, which ends at six standard deviations, in mV
/// or mA.
const NOISE: u32 = 60;

/// Reads what a step does: the lines of a fault, or an action with its key.
fn read(device: &DeviceSpec, text: &str) -> Result<Arc<dyn Effect>, String> {
    let table = DeTable::parse(text).unwrap_or_else(|error| panic!("{text}: {error}"));
    let at = table.span();
    let table = table.into_inner();
    let (key, value) = match table.iter().next() {
        Some((key, value)) if table.len() == 1 && key.get_ref() != "kind" => {
            (key.get_ref().to_string(), value.clone())
        }
        _ => ("fault".to_owned(), Spanned::new(at, DeValue::Table(table))),
    };
    let name = match value.get_ref() {
        DeValue::String(word) => word.to_string(),
        DeValue::Table(table) => match table.get("kind") {
            Some(kind) => kind.get_ref().as_str().unwrap().to_owned(),
            None => table.keys().next().unwrap().get_ref().to_string(),
        },
        other => panic!("{other:?}"),
    };
    let effect = super::read(device, (&key, &name), &value);
    let none = || format!("{} has no {key} `{name}`", device.title);
    effect.map_err(|error| error.to_string())?.ok_or_else(none)
}

/// Reads and checks it for a device with so many links.
fn checked(device: &DeviceSpec, links: usize, text: &str) -> Result<Checked, String> {
    Checked::new(read(device, text)?, device, links)
}

trait Inject {
    fn inject(
        &mut self,
        device: usize,
        name: &str,
        text: &str,
    ) -> Result<EffectHandle, EffectError>;
}

impl Inject for Rig {
    fn inject(
        &mut self,
        device: usize,
        name: &str,
        text: &str,
    ) -> Result<EffectHandle, EffectError> {
        let spec = self.spec(device).ok_or(EffectError::NoDevice(device))?;
        let effect = checked(spec, self.links(device), text).map_err(EffectError::Impossible)?;
        let handle = self.apply(device, name, &effect)?;
        Ok(handle.expect("something that can end"))
    }
}

fn inject(rig: &mut Rig, text: &str) -> EffectHandle {
    rig.inject(0, "test", text).unwrap()
}

/// Every kind of fault.
fn faults() -> impl Iterator<Item = &'static EffectInfo> {
    let all = catalogue(crate::SHIPPED).into_iter();
    all.filter(|info| info.is_fault())
}

/// Advances time and returns what the client of a port got.
fn run(rig: &mut Rig, port: PortId, span: Duration) -> Vec<u8> {
    let end = rig.now() + span;
    let mut bytes = Vec::new();
    while rig.now() < end {
        let next = (rig.now() + MS(10)).min(end);
        rig.advance(next).unwrap();
        rig.client_reads(port, &mut bytes);
    }
    bytes
}

fn send(rig: &mut Rig, bytes: &[u8]) {
    let now = rig.now();
    rig.client_sends(MAIN, now, bytes).unwrap();
}

/// Sends a request, and returns what came back within 40 ms.
fn ask(rig: &mut Rig, request: Request) -> Vec<u8> {
    send(rig, &request.encode());
    run(rig, MAIN, MS(40))
}

/// As [`ask`], and reads the frames.
fn replies(rig: &mut Rig, request: Request) -> Vec<Reply> {
    frames(&ask(rig, request))
}

fn frames(bytes: &[u8]) -> Vec<Reply> {
    let mut decoder = codec::decoder(MS(1000));
    let mut found = Vec::new();
    for &byte in bytes {
        for decoded in decoder.push(SimTime::ZERO, byte) {
            if let Decoded::Frame(frame) = decoded {
                found.extend(read_reply(&frame));
            }
        }
    }
    found
}

fn info(rig: &mut Rig) -> SystemInfo {
    match replies(rig, Request::SystemInfo)[..] {
        [Reply::SystemInfo(info)] => info,
        ref other => panic!("{other:?}"),
    }
}

fn power(rig: &mut Rig, status: u32) -> Vec<Reply> {
    replies(rig, Request::PowerControl { on: status })
}

/// Drives for a while; returns the last answered speeds, right then left.
fn drive(rig: &mut Rig, right: i16, left: i16, times: u32) -> [i16; 2] {
    let mut speeds = None;
    for _ in 0..times {
        send(rig, &Request::SetMotors { right, left }.encode());
        for reply in frames(&run(rig, MAIN, MS(50))) {
            if let Reply::Motors(motors) = reply {
                speeds = Some([motors.right_rpm, motors.left_rpm]);
            }
        }
    }
    speeds.expect("an answer")
}

fn statuses(bytes: &[u8]) -> Vec<Status> {
    let mut decoder = packets::decoder::<Status>(MS(1000));
    let mut found = Vec::new();
    for &byte in bytes {
        for decoded in decoder.push(SimTime::ZERO, byte) {
            if let Decoded::Frame(packet) = decoded {
                found.extend(packets::parse::<Status>(&packet, ByteOrder::Little));
            }
        }
    }
    found
}

fn motion(moving_idx: u8, s: u16, v: i16) -> Vec<u8> {
    Packet::Motion {
        seq: 0,
        is_reset: 1,
        moving_idx,
        s,
        v,
    }
    .encode()
}

/// Moves a car for a while, feeding its link; returns its last status.
fn roll(rig: &mut Rig, moving_idx: u8, v: i16, span: Duration) -> Status {
    let end = rig.now() + span;
    let mut last = None;
    send(rig, &motion(moving_idx, 5000, v));
    while rig.now() < end {
        last = statuses(&run(rig, MAIN, MS(200))).last().copied().or(last);
        let keep = Packet::ControlMode { seq: 0, mode: 0 };
        send(rig, &keep.encode());
    }
    last.expect("a status packet")
}

fn status(rig: &mut Rig) -> Status {
    *statuses(&run(rig, MAIN, MS(300))).last().expect("a packet")
}

/// What was reported of faults.
fn phases(rig: &mut Rig) -> Vec<EventKind> {
    std::iter::from_fn(|| rig.poll_event())
        .map(|event| event.kind)
        .filter(|event| event.fault().is_some())
        .collect()
}

fn words(phases: &[EventKind]) -> Vec<&'static str> {
    let codes = phases.iter().map(|event| event.code().name);
    codes.map(|code| &code["fault_".len()..]).collect()
}

/// The least that each fault needs as parameters, and enough of it for a short test.
fn sample(id: &str) -> String {
    let parameters = match id {
        "bit-flips" | "dropped-bytes" | "duplicated-bytes" | "inserted-bytes" => {
            "probability = 0.2"
        }
        "burst" => "probability = 0.1",
        "stall" | "mute" => "direction = \"to-client\"",
        "rail-load" => "rail = \"48v\"\npower = \"20 W\"",
        "rail-short" => "rail = \"12v-a\"",
        "over-temperature" => "pair = \"cd\"",
        "fuse-blown" => "fuse = \"motor-left\"",
        "blocked" | "dragging" | "free-wheeling" | "encoder-lost" | "encoder-stuck"
        | "encoder-noisy" | "wired-backwards" => "motors = \"left\"",
        "ports-swapped" => "port = \"x\"\nwith = \"z\"",
        "payload" => "mass = \"20 kg\"",
        "push" => "ahead = \"5 N\"",
        "ultrasonic-ghost" => "distance = \"0.1 m\"",
        _ => "",
    };
    format!("kind = \"{id}\"\n{parameters}")
}
