//! Values of names as CSV.

use std::io::{self, BufWriter, Write as _};
use std::time::Duration;

use anyhow::anyhow;
use rigsim_core::SimTime;
use rigsim_runner::Run;
use rigsim_runner::condition::Reading;
use rigsim_runner::run::Probe;
use rigsim_runner::trace::Observer;

use super::Part;
use crate::args::TraceArgs;
use crate::exit::Failure;

/// Interval at which values are printed unless it is said.
const EVERY: Duration = Duration::from_millis(100);

/// Prints a line of values now and then.
pub(super) struct Values {
    part: Part,
    every: Duration,
    next: SimTime,
    probes: Vec<Probe>,
    out: BufWriter<anstream::Stdout>,
    written: io::Result<()>,
}

impl Values {
    pub(super) fn new(args: &TraceArgs, run: &Run) -> Result<Self, Failure> {
        let probes: Result<Vec<Probe>, Failure> = args
            .csv
            .iter()
            .map(|name| run.probe(name.trim()))
            .map(|probe| probe.map_err(|why| Failure::usage(anyhow!("--csv: {why}"))))
            .collect();
        let part = Part::new(args, run)?;
        let mut values = Self {
            every: args.every.map_or(EVERY, |every| every.0),
            next: part.from,
            part,
            probes: probes?,
            out: BufWriter::new(anstream::stdout()),
            written: Ok(()),
        };
        let names: Vec<&str> = values.probes.iter().map(|probe| &*probe.name).collect();
        values.written = writeln!(values.out, "{}", names.join(","));
        Ok(values)
    }

    pub(super) fn finish(mut self) -> io::Result<()> {
        self.written.and_then(|()| self.out.flush())
    }
}

impl Observer for Values {
    fn next_sample(&self) -> SimTime {
        match self.has_enough() {
            true => SimTime::MAX,
            false => self.next,
        }
    }

    fn sample(&mut self, run: &Run) {
        let cell = |probe: &Probe| match probe.read(run) {
            Some(Reading::Number(number)) => number.to_string(),
            Some(Reading::Flag(flag)) => flag.to_string(),
            None => String::new(),
        };
        let cells: Vec<String> = self.probes.iter().map(cell).collect();
        if self.written.is_ok() {
            self.written = writeln!(self.out, "{}", cells.join(","));
        }
        self.next += self.every;
    }

    fn has_enough(&self) -> bool {
        self.next > self.part.until || self.written.is_err()
    }
}
