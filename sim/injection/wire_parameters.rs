//! From the parameters of a wire fault to the fault at work.

use std::time::Duration;

use sim_settings::SimTime;

use super::wire::{Effect, OneWay, Way, WireFault};
use crate::fault::Fault;
use crate::fault::parameters::Direction;
use crate::noise::Noise;

/// Longest mean time between two bytes of idle noise.
const LONGEST_NOISE: Duration = Duration::from_hours(24 * 365);
/// Shortest mean time between two bytes of idle noise.
const SHORTEST_NOISE: Duration = Duration::from_millis(1);

impl WireFault {
    /// `stream` gives the random numbers of each way.
    pub(super) fn new(
        fault: &Fault,
        link: usize,
        now: SimTime,
        stream: impl Fn(&str) -> Noise,
    ) -> Option<Self> {
        let mut most = None;
        let mut either = Direction::Both;
        let effect = match fault {
            Fault::BitFlips {
                probability,
                count,
                direction,
                ..
            } => {
                (most, either) = (*count, *direction);
                Effect::Flip(probability.get())
            }
            Fault::DroppedBytes {
                probability,
                count,
                direction,
                ..
            } => {
                (most, either) = (*count, *direction);
                Effect::Drop(probability.get())
            }
            Fault::DuplicatedBytes {
                probability,
                count,
                direction,
                ..
            } => {
                (most, either) = (*count, *direction);
                Effect::Double(probability.get())
            }
            Fault::InsertedBytes {
                probability,
                count,
                direction,
                ..
            } => {
                (most, either) = (*count, *direction);
                Effect::Insert(probability.get())
            }
            Fault::Burst {
                length,
                probability,
                count,
                direction,
                ..
            } => {
                (most, either) = (*count, *direction);
                Effect::Burst {
                    chance: probability.get(),
                    length: (*length).max(1),
                }
            }
            Fault::Delay {
                by,
                jitter,
                direction,
                ..
            } => {
                either = *direction;
                Effect::Delay {
                    by: by.0,
                    jitter: jitter.0,
                }
            }
            Fault::Fragmentation {
                size,
                pause,
                direction,
                ..
            } => {
                either = *direction;
                Effect::Fragment {
                    size: (*size).max(1),
                    pause: pause.0,
                }
            }
            Fault::Stall { direction, .. } => {
                either = *direction;
                Effect::Stall
            }
            Fault::Mute { direction, .. } => {
                either = *direction;
                Effect::Mute
            }
            Fault::IdleNoise {
                every,
                count,
                direction,
                ..
            } => {
                (most, either) = (*count, *direction);
                Effect::Noise {
                    every: every.0.clamp(SHORTEST_NOISE, LONGEST_NOISE),
                }
            }
            Fault::CablePulled { .. } => Effect::Cable,
            Fault::WrongBaud { baud, .. } => Effect::Baud((*baud).max(1)),
            _ => return None,
        };
        let mut fault = Self {
            link,
            direction: either,
            most,
            effect,
            ways: ["to-device", "to-client"].map(|way| OneWay {
                noise: stream(way),
                counted: 0,
                last: SimTime::ZERO,
                noise_due: None,
            }),
        };
        for way in Way::BOTH {
            fault.schedule_noise(now, way);
        }
        Some(fault)
    }
}
