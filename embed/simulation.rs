//! What the real-time loop drives: devices alone, or a scenario around them.

use std::time::Duration;

use anyhow::Context as _;
use sim_core::SimTime;
use sim_core::event::Event;
use sim_core::line::ClientLine;
use sim_core::rig::{PortId, Rig};
use sim_runner::Run;

/// Advanced by the clock, and told what clients do.
pub trait Simulation {
    /// The devices and their world.
    fn rig(&self) -> &Rig;
    /// Goes on towards `to`, by no more than can be done before somebody looks at a clock; says
    /// whether more happens until then.
    fn step(&mut self, to: SimTime) -> anyhow::Result<bool>;
    /// When something next happens by itself.
    fn next_deadline(&self) -> Option<SimTime>;
    /// Nothing happens any more.
    fn is_over(&self) -> bool;
    /// A client opened a port.
    fn attach(&mut self, port: PortId, now: SimTime) -> anyhow::Result<()>;
    /// The client closed it.
    fn detach(&mut self, port: PortId, now: SimTime) -> anyhow::Result<()>;
    /// The client sends.
    fn client_sends(&mut self, port: PortId, now: SimTime, bytes: &[u8]) -> anyhow::Result<()>;
    /// Adds what has arrived at the client.
    fn client_reads(&mut self, port: PortId, bytes: &mut Vec<u8>);
    /// How the client has set its end.
    fn set_client_line(&mut self, port: PortId, line: ClientLine);
    /// How many bytes the client may send now.
    fn room(&self, port: PortId) -> usize;
    /// The client did not read, and lost these.
    fn client_lost(&mut self, port: PortId, bytes: u64);
    /// The machine held the simulator up for so much real time.
    fn simulator_late(&mut self, by: Duration);
    /// The machine was late by `by`; until then what clients send may come too soon by as much.
    fn expect_burst(&mut self, by: Duration, until: SimTime);
    /// The machine is too slow for what it is to compute.
    fn simulator_too_slow(&mut self);
    /// What has happened.
    fn poll_event(&mut self) -> Option<Event>;
}

const BROKEN: &str = "the simulation cannot go on";

/// Both have these methods of their own, under the same names.
macro_rules! simulation {
    ($type:ty, rig: $rig:expr, is_over: $is_over:expr, step: $step:expr) => {
        impl Simulation for $type {
            fn rig(&self) -> &Rig {
                $rig(self)
            }

            fn is_over(&self) -> bool {
                $is_over(self)
            }

            fn step(&mut self, to: SimTime) -> anyhow::Result<bool> {
                $step(self, to).context(BROKEN)
            }

            fn next_deadline(&self) -> Option<SimTime> {
                self.next_deadline()
            }

            fn attach(&mut self, port: PortId, now: SimTime) -> anyhow::Result<()> {
                self.attach(port, now).context(BROKEN)
            }

            fn detach(&mut self, port: PortId, now: SimTime) -> anyhow::Result<()> {
                self.detach(port, now).context(BROKEN)
            }

            fn client_sends(
                &mut self,
                port: PortId,
                now: SimTime,
                bytes: &[u8],
            ) -> anyhow::Result<()> {
                self.client_sends(port, now, bytes).context(BROKEN)
            }

            fn client_reads(&mut self, port: PortId, bytes: &mut Vec<u8>) {
                self.client_reads(port, bytes);
            }

            fn set_client_line(&mut self, port: PortId, line: ClientLine) {
                self.set_client_line(port, line);
            }

            fn room(&self, port: PortId) -> usize {
                self.room(port)
            }

            fn client_lost(&mut self, port: PortId, bytes: u64) {
                self.client_lost(port, bytes);
            }

            fn simulator_late(&mut self, by: Duration) {
                self.simulator_late(by);
            }

            fn expect_burst(&mut self, by: Duration, until: SimTime) {
                self.expect_burst(by, until);
            }

            fn simulator_too_slow(&mut self) {
                self.simulator_too_slow();
            }

            fn poll_event(&mut self) -> Option<Event> {
                self.poll_event()
            }
        }
    };
}

simulation!(
    Rig,
    rig: |rig| rig,
    is_over: |_| false,
    step: |rig: &mut Rig, to| rig.advance(to).map(|()| false)
);
simulation!(
    Run,
    rig: Run::rig,
    is_over: |run: &Run| run.finished().is_some(),
    step: Run::step
);
