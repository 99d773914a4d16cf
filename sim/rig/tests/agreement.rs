//! The length of a physics step is a matter of speed and not of what happens.

use std::time::Duration;

use rigsim_physics::noise::Noise;

use super::*;
use crate::mecanum::MecanumSettings;
use crate::mecanum_device::packet::Request as Packet;

/// Drives for so long; `sends` is what the client says and when.
fn drive(step: u64, car: bool, sends: &[(SimTime, Vec<u8>)], seconds: u64) -> Motion {
    let world = WorldSettings {
        step: Duration::from_micros(step),
        ..WorldSettings::default()
    };
    let mut rig = Rig::new(RigSettings {
        world,
        map: WorldMap::default(),
        wire: Wire::Bare,
        seed: 1,
    });
    if car {
        let settings = MecanumSettings::default();
        rig.add(&crate::mecanum::MECANUM_SPEC, &Setup::new("car", &settings));
    } else {
        let settings = R150Settings::default();
        rig.add(&crate::r150::R150_SPEC, &Setup::new("r150", &settings));
    }
    rig.attach(PORT, SimTime::ZERO).unwrap();
    for (at, bytes) in sends {
        rig.client_sends(PORT, *at, bytes).unwrap();
        read(&mut rig);
    }
    while rig.now() < SimTime::from_secs(seconds) {
        let next = rig.now() + Duration::from_millis(500);
        rig.advance(next).unwrap();
        read(&mut rig);
    }
    rig.motion(0).unwrap()
}

/// Steps of 5 ms against steps of 500 µs: 0.5 % of the way, but of no less than 10 cm, and 0.5°.
fn agree(name: &str, car: bool, sends: &[(SimTime, Vec<u8>)]) {
    let [coarse, fine] = [5000, 500].map(|step| drive(step, car, sends, 20));
    let apart = (coarse.pose.x - fine.pose.x).hypot(coarse.pose.y - fine.pose.y);
    let turn = coarse.pose.heading - fine.pose.heading;
    let turn = turn.sin().atan2(turn.cos()).to_degrees();
    println!(
        "{name}: {:.2} m, {:.1} mm and {turn:.3} deg apart",
        fine.distance,
        1e3 * apart
    );
    assert!(apart < 0.005 * fine.distance.max(0.1), "{name}: {apart} m");
    assert!(turn.abs() < 0.5, "{name}: {turn} deg");
}

/// Queued motions one after another, each another way.
#[test]
fn queued_motions_of_the_car() {
    let motions: [&[Asked]; 5] = [
        &[
            (0, 20, 300),
            (2, 20, 300),
            (0, 20, -300),
            (2, 20, -300),
            (1, 5, 300),
        ],
        &[
            (3, 12, 450),
            (4, 12, -450),
            (3, 12, -450),
            (1, 7, -450),
            (0, 15, 450),
            (2, 15, -450),
            (0, 40, 450),
        ],
        &[
            (1, 10, 200),
            (1, 10, -200),
            (0, 10, 200),
            (0, 10, -200),
            (2, 12, 200),
        ],
        &[
            (0, 3, 500),
            (2, 3, 500),
            (0, 3, -500),
            (2, 3, -500),
            (1, 3, 500),
            (1, 3, -500),
            (0, 40, 500),
            (1, 9, 500),
            (0, 40, -500),
            (2, 10, 500),
        ],
        &[
            (2, 3, 350),
            (1, 3, -350),
            (3, 3, 350),
            (1, 3, 350),
            (4, 3, -350),
            (0, 60, 350),
        ],
    ];
    for (index, motions) in motions.into_iter().enumerate() {
        agree(&format!("motions {index}"), true, &queue(motions));
    }
}

/// Motions that pre-empt one another, so that within two steps wheels are braked and driven again.
#[test]
fn motions_of_the_car_that_preempt_one_another() {
    let motions = [
        (100, (1, 20, -463)),
        (2597, (1, 49, -483)),
        (4830, (0, 19, 175)),
        (5833, (4, 16, 174)),
        (7402, (0, 42, 309)),
        (8630, (1, 59, -448)),
        (10098, (4, 8, 463)),
        (11134, (1, 30, 483)),
        (12568, (2, 57, 491)),
        (14390, (3, 8, 422)),
        (16673, (3, 21, 414)),
    ];
    agree("preempting motions", true, &preempt(&motions));
}

/// Kind, way in 1/10 revolution or turn in °, speed.
type Asked = (u8, u16, i16);

/// Packets that queue these motions.
fn queue(motions: &[Asked]) -> Vec<(SimTime, Vec<u8>)> {
    let packets = motions.iter().map(|motion| packet(*motion, 0));
    (3..).map(SimTime::from_millis).zip(packets).collect()
}

/// Packets with these motions, each of which preempts the one before it, at these ms.
fn preempt(motions: &[(u64, Asked)]) -> Vec<(SimTime, Vec<u8>)> {
    let packet = |(at, motion): &(u64, Asked)| (SimTime::from_millis(*at), packet(*motion, 1));
    motions.iter().map(packet).collect()
}

fn packet((moving_idx, s, v): Asked, is_reset: u8) -> Vec<u8> {
    let motion = Packet::Motion {
        seq: 0,
        is_reset,
        moving_idx,
        s,
        v,
    };
    motion.encode()
}

/// A client that asks at 20 Hz for something else every half second.
#[test]
fn a_drive_of_the_r150() {
    let duties = [
        (1000, 1000),
        (600, 1000),
        (1000, 300),
        (-500, 500),
        (0, 0),
        (-800, -800),
        (400, 400),
        (900, -200),
        (0, 700),
        (1000, 1000),
    ];
    for seed in [0, 3, 7] {
        let duties = |half: usize| duties[(half * (seed + 1)) % duties.len()];
        agree(&format!("duties {seed}"), false, &at_20_hz(duties));
    }
}

/// Commands for 20 s; `duties` of the right and the left motor by the half second.
fn at_20_hz(duties: impl Fn(usize) -> (i16, i16)) -> Vec<(SimTime, Vec<u8>)> {
    let command = |tick: usize| {
        let (right, left) = duties(tick / 10);
        let at = SimTime::from_millis(2 + 50 * tick as u64);
        (at, Request::SetMotors { right, left }.encode())
    };
    (0..399).map(command).collect()
}

/// Anything that drives, drawn again for each.
#[test]
fn any_drive_of_either() {
    for seed in 0..8 {
        let name = |what| format!("{what} {seed}");
        let mut drawn = Drawn::new(seed);
        let motions = drawn.motions();
        agree(&name("queue"), true, &queue(&motions));
        agree(&name("preempting"), true, &drawn.preempting(motions));
        let duties = [(); 40].map(|()| (drawn.within(-1000, 1000), drawn.within(-1000, 1000)));
        let sends = at_20_hz(|half| duties[half]);
        agree(&name("R150"), false, &sends);
    }
}

/// Drives in which a wheel stops just before an encoder pulse or just behind it, or slips at many
/// stops.
#[test]
fn preempting_drives_that_end_on_the_brink() {
    for seed in [81, 325, 434, 436] {
        let mut drawn = Drawn::new(seed);
        let motions = drawn.motions();
        agree(&format!("{seed}"), true, &drawn.preempting(motions));
    }
}

/// What a client asks for at random.
struct Drawn(Noise);

impl Drawn {
    fn new(seed: u64) -> Self {
        Self(Noise::new(seed, "drives"))
    }

    fn within(&mut self, low: i16, high: i16) -> i16 {
        let span = u32::try_from(high - low + 1).unwrap();
        low + i16::try_from(self.0.below(span)).unwrap()
    }

    fn motions(&mut self) -> Vec<Asked> {
        let count = self.within(4, 12);
        let motion = |_| {
            let (kind, way) = (self.within(0, 4), self.within(5, 60));
            let (speed, sign) = (self.within(100, 500), 2 * self.within(0, 1) - 1);
            let [kind, way] = [kind, way].map(i16::cast_unsigned);
            (u8::try_from(kind).unwrap(), way, speed * sign)
        };
        (0..count).map(motion).collect()
    }

    /// Packets with these motions, each of which preempts the one before it; the last ends within
    /// the drive.
    fn preempting(&mut self, motions: Vec<Asked>) -> Vec<(SimTime, Vec<u8>)> {
        let mut at = 100;
        let timed = motions.into_iter().cycle().take(16).map(|motion| {
            at += u64::from(self.within(300, 2200).cast_unsigned());
            (at, motion)
        });
        let timed: Vec<_> = timed.take_while(|(at, _)| *at < 19_000).collect();
        preempt(&timed)
    }
}
