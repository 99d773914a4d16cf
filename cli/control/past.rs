//! The last minute of a run that was played again, which the page has from the beginning.

use std::collections::VecDeque;
use std::time::Duration;

use rigsim_core::SimTime;
use rigsim_core::event::Event;
use rigsim_runner::Run;
use rigsim_runner::run::Probe;
use rigsim_runner::trace::Observer;
use serde_json::{Map, Value, json};

use super::{answers, log_line};
use crate::log::Words;

/// As much as the page keeps.
const SPAN: Duration = Duration::from_secs(60);
const EVERY: Duration = Duration::from_millis(50);
const MOST_EVENTS: usize = 1000;

/// Samples a run up to a time.
pub(crate) struct Past {
    events: VecDeque<Event>,
    next: SimTime,
    probes: Vec<Probe>,
    /// Pictures, each with the values of all names then.
    samples: Vec<(Value, Vec<Value>)>,
}

impl Past {
    pub(crate) fn before(at: SimTime) -> Self {
        let from = at.since(SimTime::ZERO).saturating_sub(SPAN);
        Self {
            events: VecDeque::new(),
            next: SimTime::ZERO + from,
            probes: Vec::new(),
            samples: Vec::new(),
        }
    }

    /// As the stream has it, with the values of these names.
    pub(super) fn shown(&self, wanted: &[Probe], words: &Words) -> Value {
        let log = self.events.iter().map(|event| log_line(words, event));
        // With one device, names need not begin with its own.
        let is_same = |own: &Probe, one: &Probe| {
            let bare = own.name.split_once('.').map(|(_, bare)| bare);
            own.device == one.device && (own.name == one.name || bare == Some(&one.name))
        };
        let column = |one: &Probe| self.probes.iter().position(|own| is_same(own, one));
        let columns = wanted
            .iter()
            .filter_map(|one| Some((&one.name, column(one)?)));
        let columns: Vec<(&String, usize)> = columns.collect();
        let values = self.samples.iter().map(|(picture, values)| {
            let own = columns
                .iter()
                .map(|(name, at)| ((*name).clone(), values[*at].clone()));
            json!({"t": picture["t"], "values": own.collect::<Map<_, _>>()})
        });
        let pictures = self.samples.iter().map(|(picture, _)| picture);
        json!({
            "pictures": pictures.collect::<Vec<_>>(),
            "values": values.collect::<Vec<_>>(),
            "log": log.collect::<Vec<_>>(),
        })
    }
}

impl Observer for Past {
    fn event(&mut self, _: &Run, event: &Event) {
        self.events.push_back(event.clone());
        if self.events.len() > MOST_EVENTS {
            self.events.pop_front();
        }
    }

    fn next_sample(&self) -> SimTime {
        self.next
    }

    fn sample(&mut self, run: &Run) {
        if self.probes.is_empty() {
            self.probes = run.probes();
        }
        let values = self.probes.iter().map(|probe| answers::value(run, probe));
        self.samples.push((answers::picture(run), values.collect()));
        self.next = run.rig().now() + EVERY;
    }
}
