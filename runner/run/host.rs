//! The scripted client: it sends what the file says and compares what comes back.

use std::collections::BTreeMap;

use rigsim_core::SimTime;
use rigsim_core::device::host::{Frame, FrameReader, Reply, Sender};
use rigsim_core::line::ClientLine;
use rigsim_core::rig::PortId;

use super::agenda::Item;
use super::record::{Hexed, Record};
use super::{Run, RunError};
use crate::rig_file::DevicePlan;
use crate::scenario::{HostAction, HostDoes, ReplyWanted, Wanted, matches_fields};

/// The scripted client's ends of its ports.
#[derive(Default)]
pub(super) struct Script {
    ports: BTreeMap<PortId, HostPort>,
}

/// A step whose wait is over, and why it fails if it does.
type Over = (usize, Option<String>);

/// The scripted client's end of a port.
struct HostPort {
    /// Set if its port is open; what it sends without that goes nowhere.
    open: bool,
    reader: Box<dyn FrameReader>,
    /// It sends by itself, so not all that comes answers.
    chatters: bool,
    waiting: Vec<Waiting>,
}

struct Waiting {
    step: usize,
    due: SimTime,
    wanted: ReplyWanted,
    /// Reason for which what came so far is not it.
    so_far: String,
}

impl HostPort {
    fn new(plan: &DevicePlan, link: usize) -> Option<Self> {
        let host = &plan.device.host;
        Some(Self {
            open: true,
            reader: (host.frames)(link, Sender::Device, plan.own_settings()?),
            chatters: host.chatters,
            waiting: Vec::new(),
        })
    }
}

/// What a byte or a reply means to one that waits.
enum Verdict {
    Continue,
    Came,
    Wrong(String),
}

impl Waiting {
    fn byte(&self, byte: u8) -> Verdict {
        match &self.wanted.wanted {
            Wanted::Silence => Verdict::Wrong(format!("wanted silence, {byte:02X} came")),
            Wanted::Any | Wanted::Fields(_) => Verdict::Continue,
        }
    }

    fn found(&mut self, found: &Reply, chatters: bool) -> Verdict {
        if self.wanted.command.is_some() && self.wanted.command != found.command {
            return Verdict::Continue;
        }
        match &self.wanted.wanted {
            Wanted::Any => Verdict::Came,
            Wanted::Fields(fields) => match matches_fields(&found.fields, fields) {
                Ok(()) => Verdict::Came,
                Err(why) if chatters => {
                    self.so_far = format!("; in the last packet {why}");
                    Verdict::Continue
                }
                Err(why) => Verdict::Wrong(why),
            },
            Wanted::Silence => Verdict::Continue,
        }
    }
}

impl Script {
    pub(super) fn has_port(&self, port: PortId) -> bool {
        self.ports.contains_key(&port)
    }

    fn has_open(&self, port: PortId) -> bool {
        self.ports.get(&port).is_some_and(|host| host.open)
    }

    /// Bytes have come at a port. Returns the steps whose wait that ends, and why those fail.
    pub(super) fn read(&mut self, now: SimTime, port: PortId, bytes: &[u8]) -> Vec<Over> {
        let Some(host) = self.ports.get_mut(&port) else {
            return Vec::new();
        };
        let chatters = host.chatters;
        let mut over = Vec::new();
        for &byte in bytes {
            let found = host.reader.push(now, byte);
            let found: Vec<Reply> = found.iter().filter_map(Frame::reply).collect();
            host.waiting.retain_mut(|waiting| {
                let mut verdict = waiting.byte(byte);
                for found in &found {
                    if matches!(verdict, Verdict::Continue) {
                        verdict = waiting.found(found, chatters);
                    }
                }
                let why = match verdict {
                    Verdict::Continue => return true,
                    Verdict::Came => None,
                    Verdict::Wrong(why) => Some(why),
                };
                over.push((waiting.step, why));
                false
            });
        }
        over
    }

    /// Ends the wait for replies whose time has come, as [`read`](Self::read) does.
    pub(super) fn due(&mut self, now: SimTime) -> Vec<Over> {
        let mut over = Vec::new();
        for host in self.ports.values_mut() {
            host.waiting.retain(|waiting| {
                if waiting.due > now {
                    return true;
                }
                let silent = matches!(waiting.wanted.wanted, Wanted::Silence);
                let why = (!silent).then(|| waiting.missing());
                over.push((waiting.step, why));
                false
            });
        }
        over
    }

    /// The steps that still wait for an answer, and for what.
    pub(super) fn unanswered(&self) -> Vec<(usize, String)> {
        let waiting = self.ports.values().flat_map(|host| &host.waiting);
        let waiting = waiting.filter(|w| !matches!(w.wanted.wanted, Wanted::Silence));
        waiting.map(|w| (w.step, w.missing())).collect()
    }
}

impl Run {
    /// Opens the scripted client's ports.
    pub(super) fn open_script(&mut self) -> Result<(), RunError> {
        for port in self.ports.ids.clone() {
            if !self.plan.has_script(port.device) {
                continue;
            }
            let plan = &self.plan.scenario.rig.devices[port.device];
            let host = HostPort::new(plan, port.link);
            self.script.ports.extend(host.map(|host| (port, host)));
            self.situation.rig.attach(port, SimTime::ZERO)?;
        }
        Ok(())
    }

    pub(super) fn host_acts(&mut self, step: usize, action: &HostAction, now: SimTime) {
        let port = action.port;
        match &action.does {
            HostDoes::Send(_) if !self.script.has_open(port) => {}
            HostDoes::Send(bytes) => {
                self.record(|| Record::Host {
                    t: now.as_nanos(),
                    port: port.into(),
                    bytes: Hexed(bytes.clone()),
                });
                self.situation.rig.client_puts(port, bytes);
            }
            HostDoes::Open if self.situation.rig.cable_pulled(port) => {
                // A client that tries again and again is not wrong yet.
                if self.plan.scenario.steps[step].every.is_none() {
                    let why = "the port cannot be opened while its cable is out; with `every`, it is \
                               tried again";
                    self.fail_step(step, now, why.to_owned());
                }
            }
            HostDoes::Open => self.open_port(port, true, now),
            HostDoes::Close => self.open_port(port, false, now),
            HostDoes::Baud(baud) => self
                .situation
                .rig
                .set_client_line(port, ClientLine::at(*baud)),
            HostDoes::Nothing => {}
        }
        if let (Some(wanted), Some(host)) = (&action.expect, self.script.ports.get_mut(&port)) {
            let due = now + wanted.within;
            host.waiting.push(Waiting {
                step,
                due,
                wanted: wanted.clone(),
                so_far: String::new(),
            });
            self.agenda.plan(due, Item::Judge);
            self.time_begun(step);
        }
    }

    fn open_port(&mut self, port: PortId, open: bool, now: SimTime) {
        let Some(host) = self.script.ports.get_mut(&port) else {
            return;
        };
        if std::mem::replace(&mut host.open, open) == open {
            return;
        }
        // The rig is where it is to be, so this goes no further and cannot fail.
        let _ = if open {
            self.situation.rig.attach(port, now)
        } else {
            self.situation.rig.detach(port, now)
        };
    }

    /// The scripted client's port hangs up if its cable is out.
    pub(super) fn hang_up(&mut self, device: usize, now: SimTime) {
        let own: Vec<PortId> = self.script.ports.keys().copied().collect();
        for port in own {
            if port.device == device && self.situation.rig.cable_pulled(port) {
                self.open_port(port, false, now);
            }
        }
    }

    pub(super) fn answers_over(&mut self, over: Vec<Over>, now: SimTime) {
        for (step, why) in over {
            if let Some(why) = why {
                self.fail_step(step, now, why);
            }
            self.time_over(step, now);
        }
    }
}

impl Waiting {
    fn missing(&self) -> String {
        let within = rigsim_settings::show_duration(self.wanted.within);
        let wanted = match &self.wanted.wanted {
            Wanted::Any | Wanted::Silence => "an answer",
            Wanted::Fields(_) => "an answer with these fields",
        };
        format!("wanted {wanted} within {within}, none came{}", self.so_far)
    }
}
