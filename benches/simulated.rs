//! Simulated time beside bare rapier2d, and a hostile stream beside a clean one:
//! `cargo bench --bench simulated`.
#![allow(clippy::unwrap_used, reason = "a benchmark ends at the first surprise")]

mod support;

use std::hint::black_box;
use std::time::Duration;

use rapier2d::prelude as rapier;
use rigsim_core::SimTime;
use rigsim_core::device::Setup;
use rigsim_core::line::Wire;
use rigsim_core::r150::R150Settings;
use rigsim_core::r150_device::command::Request;
use rigsim_core::rig::{PortId, Rig, RigSettings};
use rigsim_physics::{Pose, WorldMap, WorldSettings};
use support::{Aim, Figures, Options, Table, alternate, cpu_seconds, micros, times_real_time};

/// A command every 50 ms, which is the fastest rate at which the module answers.
const COMMAND_INTERVAL: Duration = Duration::from_millis(50);
/// Metres between the lanes, so that no two vehicles meet.
const LANE: f64 = 3.0;

fn main() {
    let options = Options::read();
    let table = Table::begin("Simulated time", &options);
    for vehicles in [1, 10, 100] {
        if options.wants(&format!("driving {vehicles}")) {
            driving(vehicles, &options, &table);
        }
    }
    if options.wants("growth") {
        growth(&options, &table);
    }
    if options.wants("idle") {
        idle(&options, &table);
    }
    if options.wants("hostile") {
        support::hostile::rows(&options, &table);
    }
}

/// Vehicles that drive for ever, each commanded at 20 Hz over its paced line.
struct Driving {
    rig: Rig,
    vehicles: usize,
    command: u64,
    read: Vec<u8>,
}

impl Driving {
    fn new(vehicles: usize) -> Self {
        let mut rig = rig();
        for lane in 0..vehicles {
            add_r150(&mut rig, lane);
            let port = PortId {
                device: lane,
                link: 0,
            };
            rig.attach(port, SimTime::ZERO).unwrap();
        }
        let mut driving = Self {
            rig,
            vehicles,
            command: 0,
            read: Vec::new(),
        };
        // Up to speed, and to where nothing is allocated any more.
        driving.advance(2.0);
        driving
    }

    /// Drives on for so many simulated seconds.
    fn advance(&mut self, seconds: f64) {
        let commands = (seconds / COMMAND_INTERVAL.as_secs_f64()).round();
        let mut done = 0.0;
        while done < commands {
            // A client that changes its mind every time, and never drives in a circle.
            let pwm = 900 + 50 * i16::from(self.command.is_multiple_of(2));
            let request = Request::SetMotors {
                right: pwm,
                left: pwm,
            }
            .encode();
            let round = SimTime::ZERO + COMMAND_INTERVAL * u32::try_from(self.command).unwrap();
            for device in 0..self.vehicles {
                // Separate clients do not send at the same instant.
                let offset = COMMAND_INTERVAL.mul_f64(fraction(device, self.vehicles));
                let port = PortId { device, link: 0 };
                self.rig.approach(round + offset).unwrap();
                self.rig.client_puts(port, &request);
                self.rig.advance(round + offset).unwrap();
                self.read.clear();
                self.rig.client_reads(port, &mut self.read);
                black_box(&self.read);
            }
            while let Some(event) = self.rig.poll_event() {
                black_box(event);
            }
            self.command += 1;
            done += 1.0;
        }
    }
}

/// The same bodies at the same speed in rapier2d and nothing else.
struct Bare(rapier::PhysicsWorld);

impl Bare {
    fn new(vehicles: usize) -> Self {
        let mut world = rapier::PhysicsWorld::new();
        world.gravity = rapier::Vector::ZERO;
        world.integration_parameters.dt = 0.005;
        let mut y = 0.0;
        for _ in 0..vehicles {
            let mass = rapier::MassProperties::new(rapier::Vector::ZERO, 130.0, 16.0);
            let body = rapier::RigidBodyBuilder::dynamic()
                .translation(rapier::Vector::new(0.0, y))
                .additional_mass_properties(mass)
                .linvel(rapier::Vector::new(1.4, 0.0))
                .can_sleep(false);
            let body = world.insert_body(body);
            let collider = rapier::ColliderBuilder::cuboid(0.49, 0.33).density(0.0);
            world.insert_collider(collider, Some(body));
            y += 3.0;
        }
        let mut bare = Self(world);
        bare.advance(2.0);
        bare
    }

    fn advance(&mut self, seconds: f64) {
        let steps = seconds / 0.005;
        let mut done = 0.0;
        while done < steps {
            self.0.step();
            done += 1.0;
        }
    }
}

fn driving(vehicles: usize, options: &Options, table: &Table) {
    let (mut own, mut bare) = (Driving::new(vehicles), Bare::new(vehicles));
    let span = 20.0 / f64::from(u32::try_from(vehicles).unwrap());
    let span = if options.quick { 0.1 } else { span };
    let [own, bare] = alternate(
        options.count(100, 1),
        [
            &mut || cpu_seconds(|| own.advance(span)) / span,
            &mut || cpu_seconds(|| bare.advance(span)) / span,
        ],
    );
    let what = format!("{vehicles} × R150 driving at 20 Hz commands, per simulated second");
    let aim = if vehicles == 1 {
        Aim::AtMost(2.0)
    } else {
        Aim::None
    };
    table.ratio(&what, &own, &bare, micros, aim);
    if vehicles == 1 {
        let mut speed = own.clone();
        speed.0.iter_mut().for_each(|cost| *cost = 1.0 / *cost);
        let what = "the same, simulated seconds per second";
        table.figure(what, &speed, times_real_time, Aim::AtLeast(1000.0));
    }
}

/// By how much the cost grows with the number of vehicles, and what a further one costs.
fn growth(options: &Options, table: &Table) {
    let [mut one, mut ten, mut hundred] = [1, 10, 100].map(Driving::new);
    let [mut bare_one, mut bare_ten, mut bare_hundred] = [1, 10, 100].map(Bare::new);
    let span = if options.quick { 0.1 } else { 0.5 };
    let [one, ten, hundred, bare_one, bare_ten, bare_hundred] = alternate(
        options.count(100, 1),
        [
            &mut || cpu_seconds(|| one.advance(span)),
            &mut || cpu_seconds(|| ten.advance(span)),
            &mut || cpu_seconds(|| hundred.advance(span)),
            &mut || cpu_seconds(|| bare_one.advance(span)),
            &mut || cpu_seconds(|| bare_ten.advance(span)),
            &mut || cpu_seconds(|| bare_hundred.advance(span)),
        ],
    );
    let times = |times: f64| format!("{times:.1} ×");
    let pairs = [(10, &ten, &bare_ten), (100, &hundred, &bare_hundred)];
    for (vehicles, many, bare_many) in pairs {
        let what = format!("{vehicles} vehicles cost so many times as much as one");
        let (own, bare) = (many.over(&one), bare_many.over(&bare_one));
        table.ratio(&what, &own, &bare, times, Aim::AtMost(1.0));
    }
    // What a further vehicle costs among many, beside what it costs among few.
    let further = |one: &Figures, ten: &Figures, hundred: &Figures| {
        let rounds = one.0.iter().zip(&ten.0).zip(&hundred.0);
        Figures(
            rounds
                .map(|((one, ten), hundred)| (hundred - ten) / 90.0 / ((ten - one) / 9.0))
                .collect(),
        )
    };
    let own = further(&one, &ten, &hundred);
    let bare = further(&bare_one, &bare_ten, &bare_hundred);
    let what = "a further vehicle up to the 100th costs so many times as much as up to the 10th";
    let times = |times: f64| format!("{times:.2} ×");
    table.ratio(what, &own, &bare, times, Aim::AtMost(1.0));
}

fn idle(options: &Options, table: &Table) {
    let mut rig = rig();
    add_r150(&mut rig, 0);
    rig.advance(SimTime::from_secs(5)).unwrap();
    let span = Duration::from_secs(if options.quick { 10 } else { 10_000 });
    let [speed] = alternate(
        options.count(30, 1),
        [&mut || {
            let until = rig.now() + span;
            let taken = cpu_seconds(|| rig.advance(until).unwrap());
            span.as_secs_f64() / taken
        }],
    );
    let what = "idle R150, simulated seconds per second";
    table.figure(what, &speed, times_real_time, Aim::AtLeast(100_000.0));
}

fn rig() -> Rig {
    Rig::new(RigSettings {
        world: WorldSettings::default(),
        map: WorldMap::default(),
        wire: Wire::Paced,
        seed: 1,
    })
}

fn add_r150(rig: &mut Rig, lane: usize) {
    let pose = Pose {
        y: LANE * f64::from(u32::try_from(lane).unwrap()),
        ..Pose::default()
    };
    let name = format!("r150-{lane}");
    let settings = R150Settings::default();
    let setup = Setup {
        name: &name,
        settings: &settings,
        start: 0,
        links: 1,
        pose,
        seed: 0,
    };
    rig.add(&rigsim_core::r150::R150_SPEC, &setup);
}

fn fraction(part: usize, whole: usize) -> f64 {
    f64::from(u32::try_from(part).unwrap()) / f64::from(u32::try_from(whole).unwrap())
}
