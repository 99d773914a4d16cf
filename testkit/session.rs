//! A sequence of operations on devices in a world, and what must hold after each.
//!
//! - Nothing panics, and the rig goes on: no body's physics breaks down, nothing goes on for ever
//!   at one instant.
//! - Time never goes back, and what is due lies ahead of it.
//! - Every number of the truth is finite, charge stays between empty and full, distances only grow.
//! - Clients get no more than the line carries, and of a device that only answers no more than replies.
//! - What a client gets while nothing disturbs its line is whole frames with the right CRC, whole
//!   packets, whole lines.
//! - Events are reported in order, and have words.

mod drive;
mod promises;
mod setup;

use std::hash::{DefaultHasher, Hash as _, Hasher as _};
use std::time::Duration;

use rigsim_core::SimTime;
use rigsim_core::device::{Devices, EffectHandle, Level};
use rigsim_core::effect::Checked;
use rigsim_core::line::{ClientLine, Wire, event};
use rigsim_core::rig::Rig;
use rigsim_physics::WorldMap;
use rigsim_runner::RigPlan;

use crate::operation::{Operation, Wait};
use crate::setting::{self, SettingChoice};
use promises::Client;
pub(crate) use promises::truth;
pub use setup::Setup;

/// Most operations of a session; further ones are left out.
const MOST_OPERATIONS: usize = 200;
/// Most simulated time of a session; what waits longer waits less.
const MOST_TIME: Duration = Duration::from_secs(20);
/// Most changes of the world, since each obstacle makes every step dearer.
const MOST_CHANGES: usize = 20;

/// A session.
#[derive(Debug, Clone, PartialEq)]
pub struct Session {
    /// Setup at the start.
    pub setup: Setup,
    /// Settings that are not as they are by default, maybe.
    pub settings: Vec<SettingChoice>,
    /// Operations, in order.
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

/// Plays a session with these devices. Returns a digest of everything that could be seen of it, which is
/// the same every time.
#[must_use]
pub fn play(devices: Devices, session: &Session) -> u64 {
    let settings = setting::settings(&session.settings);
    let mut player = session.setup.begin(devices, &settings);
    for operation in session.operations.iter().take(MOST_OPERATIONS) {
        player.perform(operation);
        player.check();
    }
    player.seen.finish()
}

/// Devices with their clients, and what happened so far, by which promises are checked.
pub(crate) struct Player {
    plan: RigPlan,
    rig: Rig,
    clients: Vec<Client>,
    effects: Vec<Applied>,
    now: SimTime,
    end: SimTime,
    changes: usize,
    distance: Vec<f64>,
    reported: SimTime,
    seen: DefaultHasher,
}

struct Applied {
    handle: EffectHandle,
    device: usize,
    /// Set if it acts on what the client gets, and not only on what is sent to it.
    disturbs: bool,
    lasts: bool,
}

impl Player {
    /// The devices of a plan, with a client at each of their ports.
    pub(crate) fn new(plan: RigPlan, map: WorldMap, wire: Wire, seed: u64) -> Self {
        let clients = plan.links().map(|link| {
            let device = plan.devices[link.id.device].device;
            Client::new(link.id, device, link.baud, wire)
        });
        let mut player = Self {
            clients: clients.collect(),
            rig: plan.build(map, wire, seed),
            distance: vec![0.0; plan.devices.len()],
            plan,
            effects: Vec::new(),
            now: SimTime::ZERO,
            end: SimTime::ZERO + MOST_TIME,
            changes: 0,
            reported: SimTime::ZERO,
            seen: DefaultHasher::new(),
        };
        for port in 0..player.clients.len() {
            player.attach(port);
        }
        player
    }

    fn perform(&mut self, operation: &Operation) {
        match operation {
            Operation::Send { port, message } => {
                let port = self.port(*port);
                let id = self.clients[port].port;
                let bytes = message.bytes(&self.plan.devices[id.device], id.link);
                self.send(port, &bytes);
            }
            Operation::Wait(wait) => self.wait(*wait),
            Operation::Follow(count) => self.play_events(*count),
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
            Operation::Apply {
                device,
                name,
                effect,
            } => {
                let device = usize::from(*device) % self.rig.devices();
                let spec = self.plan.devices[device].device;
                let effect = effect.effect(spec);
                let effect =
                    effect.and_then(|chosen| Checked::new(chosen, spec, self.rig.links(device)));
                let effect = match effect {
                    Ok(effect) => effect,
                    Err(why) => return assert!(!why.is_empty()),
                };
                let level = effect.info().level;
                self.changes += usize::from(level == Level::World);
                if level == Level::World && self.changes > MOST_CHANGES {
                    return;
                }
                let name = ["a", "b", "c"][usize::from(*name) % 3];
                // Effects do not reach back to what has arrived.
                self.read_all();
                match self.rig.apply(device, name, &effect) {
                    Ok(Some(handle)) => self.applied(handle, device, level),
                    Ok(None) => assert!(!effect.info().is_fault(), "a fault lasts"),
                    Err(error) => assert!(!error.to_string().is_empty()),
                }
            }
            Operation::Clear { which } => {
                if let Some(at) = usize::from(*which).checked_rem(self.effects.len()) {
                    self.read_all();
                    let effect = &mut self.effects[at];
                    effect.lasts = false;
                    self.rig.clear(effect.handle);
                }
            }
            Operation::Late { by, stood } => {
                let [by, stood] = [by, stood].map(|span| Duration::from_millis((*span).into()));
                self.rig.emit_at_all(&event::simulator_stalled(by));
                self.rig.late(by, stood);
            }
        }
    }

    fn port(&self, port: u8) -> usize {
        usize::from(port) % self.clients.len()
    }

    fn attach(&mut self, port: usize) {
        let client = &mut self.clients[port];
        let came = self.rig.attach(client.port, self.now);
        came.unwrap_or_else(|error| panic!("{error}"));
        let disturbed = |applied: &Applied| {
            applied.lasts && applied.disturbs && applied.device == client.port.device
        };
        // What is under way to the client that is there began before this one came.
        let idle = self.rig.next_for_client(client.port).is_none();
        client.comes(self.now, idle && !self.effects.iter().any(disturbed));
    }

    fn applied(&mut self, handle: EffectHandle, device: usize, level: Level) {
        let disturbs = matches!(level, Level::Wire | Level::Protocol);
        self.effects.push(Applied {
            handle,
            device,
            disturbs,
            lasts: true,
        });
        for client in &mut self.clients {
            client.undisturbed &= !(disturbs && client.port.device == device);
        }
    }

    fn send(&mut self, port: usize, bytes: &[u8]) {
        let client = &mut self.clients[port];
        if !client.attached {
            return;
        }
        client.sent += bytes.len();
        self.rig.client_puts(client.port, bytes);
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
    fn play_events(&mut self, count: u8) {
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
}
