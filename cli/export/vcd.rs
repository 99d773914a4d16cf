//! Lines as bits and names as values over time (VCD), for PulseView, sigrok and GTKWave.

use std::collections::BTreeMap;
use std::io::{self, Write as _};

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
    code: usize,
    /// Duration of a bit, ns.
    bit: u64,
    /// Time at which the last byte ends, ns.
    free: u64,
}

pub(super) struct Vcd {
    out: Out,
    wires: BTreeMap<(PortId, bool), Wire>,
    groups: Vec<Group>,
    shown: Vec<f64>,
    /// Changes that are not written yet, by their times in ns.
    waiting: BTreeMap<u64, Vec<String>>,
}

impl Vcd {
    pub(super) fn begin(run: &Run, about: &About, mut out: Out) -> io::Result<Self> {
        writeln!(out, "$version sim {} $end", env!("CARGO_PKG_VERSION"))?;
        let seed = run.seed();
        writeln!(out, "$comment seed {seed}, {} $end", about.command)?;
        writeln!(out, "$timescale 1 ns $end")?;
        let mut wires = BTreeMap::new();
        let mut waiting: Vec<String> = Vec::new();
        for link in run.scenario().rig.links() {
            writeln!(
                out,
                "$scope module {} $end",
                name(&format!("{}_{}", link.device, link.name))
            )?;
            for (word, to_client) in [("tx", false), ("rx", true)] {
                let code = wires.len();
                writeln!(out, "$var wire 1 {} {word} $end", sign(code))?;
                waiting.push(format!("1{}", sign(code)));
                let bit = 1_000_000_000 / u64::from(link.baud.max(1));
                wires.insert((link.id, to_client), Wire { code, bit, free: 0 });
            }
            writeln!(out, "$upscope $end")?;
        }
        let groups = Group::all(run);
        let mut code = wires.len();
        for group in &groups {
            let device = &run.scenario().rig.devices[group.device].name;
            writeln!(
                out,
                "$scope module {} $end",
                name(&format!("{device}_{}", group.of))
            )?;
            for (field, _) in group.fields() {
                writeln!(out, "$var real 64 {} {} $end", sign(code), name(field))?;
                code += 1;
            }
            writeln!(out, "$upscope $end")?;
        }
        writeln!(out, "$enddefinitions $end")?;
        Ok(Self {
            out,
            shown: vec![f64::NAN; code - wires.len()],
            wires,
            groups,
            waiting: BTreeMap::from([(0, waiting)]),
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
        let (sign, bit) = (sign(wire.code), wire.bit);
        let frame = (u64::from(byte) << 1) | (1 << (BITS - 1));
        let mut level = 1;
        for index in 0..BITS {
            let next = (frame >> index) & 1;
            if next != level {
                let changes = self.waiting.entry(begin + index * bit).or_default();
                changes.push(format!("{next}{sign}"));
            }
            level = next;
        }
    }

    fn values(&mut self, at: u64, run: &Run) {
        let values = self.groups.iter().flat_map(|group| group.values(run));
        let first = self.wires.len();
        for (index, (shown, value)) in self.shown.iter_mut().zip(values).enumerate() {
            if value.is_finite() && *shown != value {
                *shown = value;
                let changes = self.waiting.entry(at).or_default();
                changes.push(format!("r{value} {}", sign(first + index)));
            }
        }
    }

    fn write_before(&mut self, end: u64) -> io::Result<()> {
        while let Some(next) = self.waiting.first_entry().filter(|next| *next.key() < end) {
            writeln!(self.out, "#{}", next.key())?;
            for change in next.remove() {
                writeln!(self.out, "{change}")?;
            }
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

/// The short sign of a variable: digits of base 94.
fn sign(mut code: usize) -> String {
    let mut sign = String::new();
    loop {
        sign.push(char::from(
            b'!' + u8::try_from(code % 94).unwrap_or_default(),
        ));
        code /= 94;
        if code == 0 {
            return sign;
        }
    }
}

/// A name without spaces.
fn name(text: &str) -> String {
    text.replace(|letter: char| !letter.is_ascii_alphanumeric(), "_")
}
