//! Lines as bits and names as values over time (VCD), for PulseView, sigrok and GTKWave.

use std::collections::BTreeMap;
use std::io;

use ::vcd::{Command, IdCode, TimescaleUnit, Value, VarType, Writer as File};
use rigsim_core::SimTime;
use rigsim_runner::Run;

use super::frames::Way;
use super::{About, Item, Out, VERSION, Writer};

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
    wires: BTreeMap<Way, Wire>,
    values: Vec<IdCode>,
    /// Bits that are still to come, by their times in ns.
    bits: BTreeMap<u64, Vec<Command>>,
}

impl Vcd {
    pub(super) fn begin(run: &Run, about: &About, out: Out) -> io::Result<Self> {
        let mut out = File::new(out);
        out.version(VERSION)?;
        out.comment(&format!("seed {}, {}", run.seed(), about.command))?;
        out.timescale(1, TimescaleUnit::NS)?;
        let mut wires = BTreeMap::new();
        for link in run.scenario().rig.links() {
            out.add_module(&name(&format!("{}_{}", link.device, link.name)))?;
            for (word, is_reply) in [("tx", false), ("rx", true)] {
                let id = out.add_wire(1, word)?;
                let bit = 1_000_000_000 / u64::from(link.baud.max(1));
                wires.insert((link.id, is_reply), Wire { id, bit, free: 0 });
            }
            out.upscope()?;
        }
        let mut values = Vec::new();
        for group in &about.groups {
            out.add_module(&name(&group.topic[1..]))?;
            for (field, _) in &group.fields {
                values.push(out.add_var(VarType::Real, 64, &name(field), None)?);
            }
            out.upscope()?;
        }
        out.enddefinitions()?;
        let idle = wires
            .values()
            .map(|wire| Command::ChangeScalar(wire.id, Value::V1));
        let bits = BTreeMap::from([(0, idle.collect())]);
        Ok(Self {
            out,
            wires,
            values,
            bits,
        })
    }

    /// Puts a byte on the line that has arrived at a time, or is sent from then on.
    fn byte(&mut self, way: Way, at: u64, byte: u8) {
        let Some(wire) = self.wires.get_mut(&way) else {
            return;
        };
        let long = BITS * wire.bit;
        let begin = if way.1 { at.saturating_sub(long) } else { at };
        let begin = begin.max(wire.free);
        wire.free = begin + long;
        let frame = (u64::from(byte) << 1) | (1 << (BITS - 1));
        let mut level = 1;
        for index in 0..BITS {
            let next = (frame >> index) & 1;
            if std::mem::replace(&mut level, next) != next {
                let changes = self.bits.entry(begin + index * wire.bit).or_default();
                changes.push(Command::ChangeScalar(wire.id, Value::from(next == 1)));
            }
        }
    }

    fn write_before(&mut self, end: u64) -> io::Result<()> {
        while let Some(next) = self.bits.first_entry().filter(|next| *next.key() < end) {
            self.out.timestamp(*next.key())?;
            let changes = next.remove();
            changes
                .iter()
                .try_for_each(|change| self.out.command(change))?;
        }
        Ok(())
    }
}

impl Writer for Vcd {
    fn take(&mut self, at: SimTime, item: Item) -> io::Result<()> {
        match item {
            Item::Bytes(way, bytes) => {
                for (at, byte) in bytes {
                    self.byte(way, at.as_nanos(), byte);
                }
            }
            Item::Values(values) => {
                let changed = self
                    .values
                    .iter()
                    .zip(values)
                    .filter(|(_, value)| value.is_new);
                let change = changed.map(|(id, value)| Command::ChangeReal(*id, value.number));
                self.bits.entry(at.as_nanos()).or_default().extend(change);
            }
            _ => {}
        }
        // A byte is on the line before it arrives.
        let slowest = self.wires.values().map(|wire| BITS * wire.bit).max();
        self.write_before(at.as_nanos().saturating_sub(slowest.unwrap_or(0)))
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
