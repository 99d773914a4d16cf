//! What the rig needs of a device together with its hardware.

use std::sync::Arc;
use std::time::Duration;

use sim_physics::World;
use sim_settings::SimTime;

use crate::event::EventKind;

/// Firmware and hardware of one device, tied together.
///
/// Time never goes back. After `advance`, and after a `receive` that has led to news, the rig calls
/// `settle`, and takes all output and events.
pub(crate) trait Unit {
    /// Takes bytes whose last has arrived on `link` at `now`.
    fn receive(&mut self, now: SimTime, link: usize, bytes: &[u8]);

    /// Does everything that the firmware has due by `now`.
    fn advance(&mut self, now: SimTime);

    /// When the firmware next does something by itself.
    fn next_deadline(&self) -> Option<SimTime>;

    /// The machine was late by `by`: until then what clients send may come closer together by as
    /// much than they sent it.
    fn expect_burst(&mut self, by: Duration, until: SimTime);

    /// Whether output or events wait to be taken. Whatever bytes do to a device is told by one, but
    /// for the place within a frame that they bring it to.
    fn has_news(&self) -> bool;

    /// Passes pins and measurements between firmware and hardware until neither changes.
    fn settle(&mut self, now: SimTime);

    /// Bytes for the client of a link.
    fn poll_output(&mut self) -> Option<(usize, Vec<u8>)>;

    /// The next event and when it happened.
    fn poll_event(&mut self) -> Option<(SimTime, Arc<dyn EventKind>)>;

    /// How far it has driven, m.
    fn distance_m(&self) -> f64;

    /// Whether nothing of it moves and nothing drives it.
    fn at_rest(&self) -> bool;

    /// Looks again whether it can stand, after something around it has changed.
    fn wake(&mut self);

    /// Lets time pass for its slow states up to `now`, while nothing in the world moves.
    fn rest_until(&mut self, now: SimTime);

    /// Applies its forces for a step.
    fn before_step(&mut self, world: &mut World);

    /// Takes over what the step, which ended at `now` and took `step`, has done.
    fn after_step(&mut self, now: SimTime, step: Duration, world: &mut World);
}
