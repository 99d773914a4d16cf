//! Observing while a recording is played again.

use rigsim_core::SimTime;
use rigsim_core::event::Event;

use crate::run::Run;
use crate::run::record::Record;

/// Observes while a recording is played again ([`super::Replay::watched`]).
///
/// Events come in the order of time, each before the first sample at or behind its time. Records come
/// as they stand in the recording, which is before the second run goes past their times.
pub trait Observer {
    /// A line of the recording, the header aside.
    fn record(&mut self, record: &Record) {
        let _ = record;
    }

    /// Something happened in the second run.
    fn event(&mut self, run: &Run, event: &Event) {
        let _ = (run, event);
    }

    /// Returns when to sample next; the end of time for never. After a sample it has to be later.
    fn next_sample(&self) -> SimTime {
        SimTime::MAX
    }

    /// The second run has come to that time.
    fn sample(&mut self, run: &Run) {
        let _ = run;
    }

    /// Returns whether the rest is of no use.
    fn has_enough(&self) -> bool {
        false
    }
}
