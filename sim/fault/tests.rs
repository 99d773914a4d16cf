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

use sim_physics::r150::{Load, Rail};
use sim_physics::world::{Obstacle, Strip, Tag};
use sim_physics::{Pose, WorldMap, WorldSettings};
use sim_settings::SimTime;

use super::*;
use crate::device::EffectHandle;
use crate::event::Event;
use crate::line::Wire;
use crate::mecanum::{Mecanum, MecanumSettings};
use crate::mecanum_device::codec::{Decoded, Decoder};
use crate::mecanum_device::packet::{Request as Packet, Status};
use crate::r150::{R150, R150Settings};
use crate::r150_device::command::{Reply, Request};
use crate::r150_device::system_info::SystemInfo;
use crate::r150_device::vehicle::Start;
use crate::r150_device::{codec, settings};
use crate::rig::{PortId, Rig, RigSettings};

const MAIN: PortId = PortId { device: 0, link: 0 };
const ROS: PortId = PortId { device: 0, link: 1 };
const NOTHING: [u8; 0] = [];
const MS: fn(u64) -> Duration = Duration::from_millis;

fn rig(map: WorldMap, seed: u64) -> Rig {
    Rig::new(RigSettings {
        world: WorldSettings::default(),
        map,
        wire: Wire::Paced,
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
    crate::r150::add(&mut rig, "r150", &settings, Start::Ready, Pose::default());
    rig.with_device(0, |r150: &mut R150, _, _| {
        for rail in Rail::ALL {
            r150.plant_mut().set_load(rail, Load::Power(5.0));
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
    crate::mecanum::add(&mut rig, "car", &settings, ros, Pose::default());
    rig.attach(MAIN, SimTime::ZERO).unwrap();
    rig.attach(ROS, SimTime::ZERO).unwrap();
    rig
}

fn read(text: &str) -> Fault {
    toml::from_str(text).unwrap_or_else(|error| panic!("{text}: {error}"))
}

fn inject(rig: &mut Rig, text: &str) -> EffectHandle {
    rig.inject(0, "test", &read(text)).unwrap()
}

/// Lets time pass and gives what the client of a port got.
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

/// Sends a request, and gives what came back within 40 ms.
fn ask(rig: &mut Rig, request: Request) -> Vec<u8> {
    send(rig, &request.encode());
    run(rig, MAIN, MS(40))
}

/// As [`ask`], and reads the frames.
fn replies(rig: &mut Rig, request: Request) -> Vec<Reply> {
    frames(&ask(rig, request))
}

fn frames(bytes: &[u8]) -> Vec<Reply> {
    let mut decoder = codec::Decoder::new(MS(1000), settings::Resync::SecondByte);
    let mut found = Vec::new();
    for &byte in bytes {
        decoder.push(SimTime::ZERO, byte, &mut |decoded| {
            if let codec::Decoded::Frame(frame) = decoded {
                found.extend(Reply::parse(frame.command, &frame.parameters));
            }
        });
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
    replies(rig, Request::PowerControl { status })
}

/// Drives for a while; gives the last answered speeds, right then left.
fn drive(rig: &mut Rig, right: i16, left: i16, times: u32) -> [i16; 2] {
    let mut speeds = None;
    for _ in 0..times {
        send(rig, &Request::SetMotors { right, left }.encode());
        for reply in frames(&run(rig, MAIN, MS(50))) {
            if let Reply::Motors {
                right_rpm,
                left_rpm,
                ..
            } = reply
            {
                speeds = Some([right_rpm, left_rpm]);
            }
        }
    }
    speeds.expect("an answer")
}

fn statuses(bytes: &[u8]) -> Vec<Status> {
    let mut decoder: Decoder<Status> = Decoder::new(MS(1000));
    let mut found = Vec::new();
    for &byte in bytes {
        decoder.push(SimTime::ZERO, byte, &mut |decoded| {
            if let Decoded::Packet(status) = decoded {
                found.push(status);
            }
        });
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

/// Moves a car for a while, feeding its link; gives its last status.
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

/// What was told of faults.
fn phases(rig: &mut Rig) -> Vec<FaultPhase> {
    std::iter::from_fn(|| rig.poll_event())
        .filter_map(|event| Some(event.kind.get::<FaultEvent>()?.phase.clone()))
        .collect()
}

fn words(phases: &[FaultPhase]) -> Vec<&'static str> {
    phases
        .iter()
        .map(|phase| match phase {
            FaultPhase::Armed => "armed",
            FaultPhase::Triggered { .. } => "triggered",
            FaultPhase::Cleared => "cleared",
        })
        .collect()
}

/// The least that each fault needs to be told, and enough of it for a short test.
fn sample(id: &str) -> Fault {
    let parameters = match id {
        "bit-flips" | "dropped-bytes" | "duplicated-bytes" | "inserted-bytes" => {
            "probability = 0.2"
        }
        "burst" => "probability = 0.1",
        "stall" | "mute" => "direction = \"to-client\"",
        "rail-load" => "rail = \"48v\"\npower = \"20 W\"",
        "rail-short" | "rail-open" => "rail = \"12v-a\"",
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
    read(&format!("kind = \"{id}\"\n{parameters}"))
}
