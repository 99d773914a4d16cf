//! The parts, each by itself: `cargo bench --bench parts`.
#![allow(clippy::unwrap_used, reason = "a benchmark ends at the first surprise")]

use std::hint::black_box;
use std::time::Duration;

use divan::Bencher;
use divan::counter::BytesCount;
use rigsim_core::SimTime;
use rigsim_core::line::{Adapter, SerialLine, Wire};
use rigsim_core::mecanum_device::{ascii, codec as mecanum_codec, packet};
use rigsim_core::r150_device::codec;
use rigsim_core::r150_device::command::Request;
use rigsim_physics::{
    MecanumPlant, MecanumPlantSettings, Plant as _, Pose, R150Commands, R150Plant,
    R150PlantSettings, World, WorldMap, WorldSettings,
};

fn main() {
    divan::main();
}

const MOTORS: Request = Request::SetMotors {
    right: 900,
    left: 900,
};

#[divan::bench]
fn r150_encode_request(bencher: Bencher) {
    bencher.bench(|| black_box(MOTORS).encode());
}

/// A motor command, byte by byte.
#[divan::bench]
fn r150_decode_request(bencher: Bencher) {
    let frame = MOTORS.encode();
    let mut decoder = codec::decoder(Duration::from_millis(5));
    bencher
        .counter(BytesCount::of_slice(&frame))
        .bench_local(|| {
            for &byte in &frame {
                black_box(decoder.push(SimTime::ZERO, byte));
            }
        });
}

#[divan::bench]
fn r150_checksum_of_the_longest_frame(bencher: Bencher) {
    let covered = [0x5A; 256];
    bencher
        .counter(BytesCount::of_slice(&covered))
        .bench(|| codec::crc(black_box(&covered)));
}

/// A motion packet, byte by byte.
#[divan::bench]
fn mecanum_decode_request(bencher: Bencher) {
    let bytes = packet::Request::Motion {
        seq: 1,
        is_reset: 0,
        moving_idx: 0,
        s: 100,
        v: 100,
    }
    .encode();
    let mut decoder = mecanum_codec::decoder::<packet::Request>(Duration::from_millis(5));
    bencher
        .counter(BytesCount::of_slice(&bytes))
        .bench_local(|| {
            for &byte in &bytes {
                black_box(decoder.push(SimTime::ZERO, byte));
            }
        });
}

/// An order of the ROS link, byte by byte.
#[divan::bench]
fn ros_decode_order(bencher: Bencher) {
    let bytes = b"X10 \n";
    let mut decoder = ascii::Decoder::default();
    bencher
        .counter(BytesCount::of_slice(bytes))
        .bench_local(|| {
            for &byte in bytes {
                black_box(decoder.push(byte));
            }
        });
}

/// A frame through a paced line.
#[divan::bench]
fn line_carries_a_frame(bencher: Bencher) {
    let frame = MOTORS.encode();
    let mut line = SerialLine::new(115_200, Wire::Paced, Adapter::default());
    line.attach(SimTime::ZERO);
    let mut now = SimTime::ZERO;
    bencher.bench_local(|| {
        line.client_sends(now, &frame);
        now += Duration::from_millis(2);
        while let Some(byte) = line.take_for_device(now) {
            black_box(byte);
        }
    });
}

/// A step of 5 ms with one R150 that drives.
#[divan::bench]
fn r150_step(bencher: Bencher) {
    let mut world = World::new(&WorldSettings::default());
    let settings = R150PlantSettings::default();
    let mut plant = R150Plant::new("r150", &settings, &mut world, Pose::default());
    let mut commands = R150Commands {
        propulsion_power: true,
        ..R150Commands::default()
    };
    let mut step = 0_u32;
    bencher.bench_local(|| {
        if step.is_multiple_of(10) {
            let duty = 0.9 + f64::from(step / 10 % 2) * 0.05;
            commands.motor_duty = [duty; 2].into();
            plant.set_commands(&commands);
        }
        step = step.wrapping_add(1);
        plant.before_step(&mut world);
        world.step().unwrap();
        plant.after_step(&mut world);
    });
}

#[divan::bench]
fn r150_measurements(bencher: Bencher) {
    let mut world = World::new(&WorldSettings::default());
    let plant = R150Plant::new(
        "r150",
        &R150PlantSettings::default(),
        &mut world,
        Pose::default(),
    );
    bencher.bench_local(|| black_box(&plant).measurements());
}

/// 100 ms of rest.
#[divan::bench]
fn r150_rest(bencher: Bencher) {
    let mut world = World::new(&WorldSettings::default());
    let mut plant = R150Plant::new(
        "r150",
        &R150PlantSettings::default(),
        &mut world,
        Pose::default(),
    );
    bencher.bench_local(|| plant.rest(Duration::from_millis(100)));
}

/// A step of 5 ms with a car that stands among the walls of a yard, seeing them.
#[divan::bench]
fn mecanum_step_in_a_yard(bencher: Bencher) {
    let yard = include_str!("../worlds/yard.toml");
    let map = WorldMap::from_toml(yard, "yard").unwrap();
    let mut world = World::with_map(&WorldSettings::default(), &map);
    let settings = MecanumPlantSettings::default();
    let mut car = MecanumPlant::new("mecanum", &settings, &mut world, Pose::default());
    bencher.bench_local(|| {
        car.wake();
        car.before_step(&mut world);
        world.step().unwrap();
        car.after_step(&mut world);
    });
}
