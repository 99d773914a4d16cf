//! Lines as bits and names as values over time (VCD), for PulseView, sigrok and GTKWave.

use std::collections::BTreeMap;
use std::io;

use ::vcd::{Command, IdCode, TimescaleUnit, Value, VarType, Writer as File};
use rigsim_core::SimTime;
use rigsim_core::rig::PortId;
use rigsim_runner::Run;
use rigsim_runner::trace::Record;

use super::{About, Group, Item, Out, Writer};

/// A change waits as long as an earlier one may come: a byte is on the line before it arrives.
const PATIENCE: u64 = 100_000_000;
/// One start bit, eight data bits, one stop bit.
const BITS: u64 = 10;

/// One direction of a line.
struct Wire {
    id: IdCode,
    /// Duration of a bit, ns.
    bit: u64,
    /// Time at which the last byte ends, ns.
    free: u64,
}

pub(super) struct Vcd {
    out: File<Out>,
    wires: BTreeMap<(PortId, bool), Wire>,
    groups: Vec<Group>,
    /// The values of all groups, as they were written last.
    shown: Vec<(IdCode, f64)>,
    /// Changes that are not written yet, by their times in ns.
    waiting: BTreeMap<u64, Vec<Command>>,
}

impl Vcd {
    pub(super) fn begin(run: &Run, about: &About, out: Out) -> io::Result<Self> {
        let mut out = File::new(out);
        out.version(concat!("sim ", env!("CARGO_PKG_VERSION")))?;
        out.comment(&format!("seed {}, {}", run.seed(), about.command))?;
        out.timescale(1, TimescaleUnit::NS)?;
        let mut wires = BTreeMap::new();
        for link in run.scenario().rig.links() {
            out.add_module(&name(&format!("{}_{}", link.device, link.name)))?;
            for (word, to_client) in [("tx", false), ("rx", true)] {
                let id = out.add_wire(1, word)?;
                let bit = 1_000_000_000 / u64::from(link.baud.max(1));
                wires.insert((link.id, to_client), Wire { id, bit, free: 0 });
            }
            out.upscope()?;
        }
        let groups = Group::all(run);
        let mut shown = Vec::new();
        for group in &groups {
            let device = &run.scenario().rig.devices[group.device].name;
            out.add_module(&name(&format!("{device}_{}", group.of)))?;
            for (field, _) in group.fields() {
                shown.push((
                    out.add_var(VarType::Real, 64, &name(field), None)?,
                    f64::NAN,
                ));
            }
            out.upscope()?;
        }
        out.enddefinitions()?;
        let idle = wires
            .values()
            .map(|wire| Command::ChangeScalar(wire.id, Value::V1));
        Ok(Self {
            out,
            waiting: BTreeMap::from([(0, idle.collect())]),
            wires,
            groups,
            shown,
        })
    }

    /// Puts a byte on the line that has arrived at a time, or is sent from then on.
    fn byte(&mut self, port: PortId, to_client: bool, at: u64, byte: u8) {
        let Some(wire) = self.wires.get_mut(&(port, to_client)) else {
            return;
        };
        let begin = if to_client {
            at.saturating_sub(BITS * wire.bit)
        } else {
            at
        };
        let begin = begin.max(wire.free);
        wire.free = begin + BITS * wire.bit;
        let frame = (u64::from(byte) << 1) | (1 << (BITS - 1));
        let mut level = 1;
        for index in 0..BITS {
            let next = (frame >> index) & 1;
            if next != level {
                let changes = self.waiting.entry(begin + index * wire.bit).or_default();
                changes.push(Command::ChangeScalar(wire.id, Value::from(next == 1)));
            }
            level = next;
        }
    }

    fn values(&mut self, at: u64, run: &Run) {
        let values = self.groups.iter().flat_map(|group| group.values(run));
        for ((id, shown), value) in self.shown.iter_mut().zip(values) {
            if value.is_finite() && *shown != value {
                *shown = value;
                let changes = self.waiting.entry(at).or_default();
                changes.push(Command::ChangeReal(*id, value));
            }
        }
    }

    fn write_before(&mut self, end: u64) -> io::Result<()> {
        while let Some(next) = self.waiting.first_entry().filter(|next| *next.key() < end) {
            self.out.timestamp(*next.key())?;
            next.remove()
                .iter()
                .try_for_each(|change| self.out.command(change))?;
        }
        Ok(())
    }
}

impl Writer for Vcd {
    fn take(&mut self, at: SimTime, item: &Item<'_>) -> io::Result<()> {
        match item {
            Item::Record(Record::In { t, port, bytes } | Record::Host { t, port, bytes }) => {
                for byte in &bytes.0 {
                    self.byte((*port).into(), false, *t, *byte);
                }
            }
            Item::Record(Record::Out { t, dt, port, bytes }) => {
                for (index, byte) in (0..).zip(&bytes.0) {
                    self.byte((*port).into(), true, t + index * dt, *byte);
                }
            }
            Item::Values(run) => self.values(at.as_nanos(), run),
            _ => {}
        }
        self.write_before(at.as_nanos().saturating_sub(PATIENCE))
    }

    fn finish(mut self: Box<Self>) -> io::Result<()> {
        self.write_before(u64::MAX)?;
        self.out.flush()
    }
}

/// A name without spaces.
fn name(text: &str) -> String {
    text.replace(|letter: char| !letter.is_ascii_alphanumeric(), "_")
}
