//! A sequence of operations on devices in a world, and what must hold after each.
//!
//! - Nothing panics, and the rig goes on: no body's physics breaks down, nothing goes on for ever
//!   at one instant.
//! - Time never goes back, and what is due lies ahead of it.
//! - Every number of the truth is finite, charge stays between empty and full, distances only grow.
//! - Clients get no more than the line carries, and of the R150 no more than its replies.
//! - What a client gets while nothing disturbs its line is whole frames with the right CRC, whole
//!   packets, whole lines.
//! - Events are told in order, and have words.

mod promises;
mod setup;

use std::hash::{DefaultHasher, Hash as _, Hasher as _};
use std::time::Duration;

use sim_core::SimTime;
use sim_core::device::EffectHandle;
use sim_core::fault::FaultLevel;
use sim_core::line::{ClientLine, LineEvent};
use sim_core::mecanum::Mecanum;
use sim_core::r150::R150;
use sim_core::rig::Rig;
use sim_physics::r150::{Load, Rail};
use sim_physics::{Ground, Pose};

use crate::operation::{Hands, Message, Operation, Wait, car_key, r150_button};
use crate::setting::{self, SettingChoice};
use promises::Client;
pub use promises::truth;
pub use setup::{Devices, Setup};

/// Most operations of a session; further ones are left out.
const MOST_OPERATIONS: usize = 200;
/// Most simulated time of a session; what waits longer waits less.
const MOST_TIME: Duration = Duration::from_secs(20);
/// Most obstacles, since each makes every step dearer.
const MOST_OBSTACLES: usize = 20;

/// A session.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "proptest", derive(proptest_derive::Arbitrary))]
pub struct Session {
    /// Setup at the start.
    pub setup: Setup,
    /// Settings that are not as they are by default, maybe.
    #[cfg_attr(feature = "proptest", proptest(strategy = "crate::some(5)"))]
    pub settings: Vec<SettingChoice>,
    /// Operations, in order.
    #[cfg_attr(feature = "proptest", proptest(strategy = "crate::some(40)"))]
    pub operations: Vec<Operation>,
}

/// Operations as long as there are bytes to make them of.
impl<'b> arbitrary::Arbitrary<'b> for Session {
    fn arbitrary(bytes: &mut arbitrary::Unstructured<'b>) -> arbitrary::Result<Self> {
        let setup = bytes.arbitrary()?;
        let settings = (0..bytes.int_in_range(0..=7)?).map(|_| bytes.arbitrary());
        let settings = settings.collect::<Result<_, _>>()?;
        let mut operations = Vec::new();
        while !bytes.is_empty() && operations.len() < MOST_OPERATIONS {
            operations.push(bytes.arbitrary()?);
        }
        Ok(Self {
            setup,
            settings,
            operations,
        })
    }
}

/// Plays a session; gives a digest of everything that could be seen of it, which is the same every
/// time.
#[must_use]
pub fn play(session: &Session) -> u64 {
    let mut player = Player::new(session);
    for operation in session.operations.iter().take(MOST_OPERATIONS) {
        player.perform(operation);
        player.check();
    }
    player.seen.finish()
}

struct Player {
    rig: Rig,
    clients: Vec<Client>,
    faults: Vec<Injected>,
    now: SimTime,
    end: SimTime,
    obstacles: usize,
    distance: Vec<f64>,
    told: SimTime,
    seen: DefaultHasher,
}

struct Injected {
    handle: EffectHandle,
    device: usize,
    /// Set if it acts on what the client gets, and not only on what is told to it.
    disturbs: bool,
    armed: bool,
}

impl Player {
    fn new(session: &Session) -> Self {
        let (rig, clients) = session.setup.begin(&setting::settings(&session.settings));
        let mut player = Self {
            distance: vec![0.0; rig.devices()],
            rig,
            clients,
            faults: Vec::new(),
            now: SimTime::ZERO,
            end: SimTime::ZERO + MOST_TIME,
            obstacles: 0,
            told: SimTime::ZERO,
            seen: DefaultHasher::new(),
        };
        for port in 0..player.clients.len() {
            player.attach(port);
        }
        player
    }

    fn perform(&mut self, operation: &Operation) {
        match operation {
            Operation::Send { port, message } => self.send(*port, message),
            Operation::Wait(wait) => self.wait(*wait),
            Operation::Follow(count) => self.follow(*count),
            Operation::Read { port } => {
                let port = self.port(*port);
                self.read(port);
            }
            Operation::Attach { port } => {
                let port = self.port(*port);
                if !self.clients[port].attached {
                    self.attach(port);
                }
            }
            Operation::Detach { port } => {
                let port = self.port(*port);
                self.read(port);
                let client = &mut self.clients[port];
                if std::mem::take(&mut client.attached) {
                    let left = self.rig.detach(client.port, self.now);
                    left.unwrap_or_else(|error| panic!("{error}"));
                }
            }
            Operation::SetLine {
                port,
                speed,
                two_stop_bits,
                cooked,
            } => {
                let port = self.port(*port);
                self.read(port);
                let client = &mut self.clients[port];
                let speeds = [client.baud, 300, client.baud, 9600, client.baud, 115_200];
                let speeds = [&speeds[..], &[client.baud, 4_000_000, client.baud, 0]].concat();
                client.line = ClientLine {
                    baud: speeds[usize::from(*speed) % speeds.len()],
                    stop_bits: if *two_stop_bits { 2 } else { 1 },
                    raw: !cooked,
                    ..ClientLine::at(0)
                };
                client.undisturbed = false;
                self.rig.set_client_line(client.port, client.line);
            }
            Operation::Inject {
                device,
                name,
                fault,
            } => {
                let device = self.device(*device);
                let fault = fault.fault();
                let name = ["a", "b", "c"][usize::from(*name) % 3];
                // Faults do not reach back to what has arrived.
                self.read_all();
                match self.rig.inject(device, name, &fault) {
                    Ok(handle) => self.injected(handle, device, fault.info().level),
                    Err(error) => assert!(!error.to_string().is_empty()),
                }
            }
            Operation::Clear { which } => {
                if let Some(at) = usize::from(*which).checked_rem(self.faults.len()) {
                    self.read_all();
                    let fault = &mut self.faults[at];
                    fault.armed = false;
                    self.rig.clear(fault.handle);
                }
            }
            Operation::Operate { device, button } => {
                let device = self.device(*device);
                let action = r150_button(*button);
                self.rig
                    .with_device(device, |r150: &mut R150, _, now| r150.operate(now, action));
                let action = car_key(*button);
                self.rig
                    .with_device(device, |car: &mut Mecanum, _, now| car.operate(now, action));
            }
            Operation::Handle { device, how } => {
                let device = self.device(*device);
                self.handle(device, *how);
            }
            Operation::Obstacle { at, size } => {
                self.obstacles += 1;
                if self.obstacles <= MOST_OBSTACLES {
                    let [x, y] = at.map(|at| f64::from(at) / 10.0);
                    let radius = f64::from(*size).max(1.0) / 100.0;
                    self.rig.with_world(|world| world.add_disc(x, y, radius));
                }
            }
            Operation::Ground(percent) => {
                let ground = Ground::new(f64::from(percent % 201) / 100.0, 0.0, 0.0);
                self.rig.with_world(|world| world.set_ground(ground));
            }
            Operation::Late { by, rest } => {
                let [by, rest] = [by, rest].map(|span| Duration::from_millis((*span).into()));
                self.rig.tell_all(LineEvent::SimulatorLate { by });
                self.rig.expect_burst(by, self.now + rest);
            }
        }
    }

    fn port(&self, port: u8) -> usize {
        usize::from(port) % self.clients.len()
    }

    fn device(&self, device: u8) -> usize {
        usize::from(device) % self.rig.devices()
    }

    fn attach(&mut self, port: usize) {
        let client = &mut self.clients[port];
        let came = self.rig.attach(client.port, self.now);
        came.unwrap_or_else(|error| panic!("{error}"));
        let disturbed =
            |fault: &Injected| fault.armed && fault.disturbs && fault.device == client.port.device;
        // What is under way to whoever is there began before this one came.
        let idle = self.rig.next_for_client(client.port).is_none();
        client.comes(self.now, idle && !self.faults.iter().any(disturbed));
    }

    fn injected(&mut self, handle: EffectHandle, device: usize, level: FaultLevel) {
        let disturbs = matches!(level, FaultLevel::Wire | FaultLevel::Protocol);
        self.faults.push(Injected {
            handle,
            device,
            disturbs,
            armed: true,
        });
        for client in &mut self.clients {
            client.undisturbed &= !(disturbs && client.port.device == device);
        }
    }

    fn send(&mut self, port: u8, message: &Message) {
        let port = self.port(port);
        let client = &mut self.clients[port];
        if !client.attached {
            return;
        }
        let bytes = message.bytes();
        client.sent += bytes.len();
        self.rig.client_puts(client.port, &bytes);
        let sent = self.rig.advance(self.now);
        sent.unwrap_or_else(|error| panic!("{error}"));
    }

    fn wait(&mut self, wait: Wait) {
        let due = self
            .rig
            .next_deadline()
            .map_or(self.now, |due| due.max(self.now));
        self.advance(self.now + wait.span(due.since(self.now)));
        if self.clients.iter().all(|client| !client.attached) {
            self.due();
        }
    }

    /// Time of what is due next: always something, since batteries and temperatures never stand still,
    /// and always later.
    fn due(&self) -> SimTime {
        let due = self.rig.next_deadline();
        let due = due.unwrap_or_else(|| panic!("nothing is due for ever"));
        assert!(due > self.now, "{due} is due at {}", self.now);
        due
    }

    /// From event to event, with clients that read at once.
    fn follow(&mut self, count: u8) {
        // What was done at this instant may have left something to be done at it.
        self.advance(self.now);
        self.read_all();
        for _ in 0..count {
            self.advance(self.due());
            self.read_all();
        }
    }

    fn advance(&mut self, to: SimTime) {
        let to = to.min(self.end);
        let advanced = self.rig.advance(to);
        advanced.unwrap_or_else(|error| panic!("{error}"));
        assert!(self.rig.now() >= self.now, "time went back");
        if to > self.now {
            assert_eq!(self.rig.now(), to);
        }
        self.now = self.rig.now();
        if self.now >= self.end {
            // Nothing more can happen later, so a little more time is given.
            self.end = self.now + Duration::from_micros(100);
        }
    }

    fn read_all(&mut self) {
        for port in 0..self.clients.len() {
            self.read(port);
        }
    }

    fn read(&mut self, port: usize) {
        let client = &mut self.clients[port];
        let mut bytes = Vec::new();
        self.rig.client_reads(client.port, &mut bytes);
        bytes.hash(&mut self.seen);
        client.gets(&bytes, self.now);
    }

    fn handle(&mut self, device: usize, how: Hands) {
        let scale = |numbers: [i16; 3], unit: f64| numbers.map(|number| f64::from(number) * unit);
        let place = |[x, y, heading]: [i16; 3]| Pose {
            x: f64::from(x) / 10.0,
            y: f64::from(y) / 10.0,
            heading: f64::from(heading) / 100.0,
        };
        let rig = &mut self.rig;
        // Some are for one kind of device only.
        let _ = match how {
            Hands::Push(push) => rig.with_any_device(device, |own, _, _| {
                own.plant_mut().set_push(scale(push, 3.0))
            }),
            Hands::Payload(mass) => rig.with_any_device(device, |own, world, _| {
                own.plant_mut().set_payload(world, mass.into())
            }),
            Hands::Place(pose) => rig.with_any_device(device, |own, world, _| {
                own.plant_mut().place(world, place(pose))
            }),
            Hands::Load { rail, watts } => rig.with_device(device, |r150: &mut R150, _, _| {
                let rail = Rail::ALL[usize::from(rail) % Rail::ALL.len()];
                r150.plant_mut().set_load(rail, Load::Power(watts.into()));
            }),
        };
    }
}
