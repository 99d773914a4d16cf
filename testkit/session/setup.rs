//! Setup at the start of a session.

use std::sync::LazyLock;

use rigsim_core::device::{Devices, LinkSpec};
use rigsim_core::line::Wire;
use rigsim_core::settings::SimSettings;
use rigsim_physics::{Pose, WorldMap};
use rigsim_runner::{DevicePlan, RigPlan};

use super::Player;

/// Setup at the start.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, arbitrary::Arbitrary)]
pub struct Setup {
    /// Bytes take no time.
    pub instant: bool,
    /// Devices have their optional links.
    pub all_links: bool,
    /// Index of the states in which devices start.
    pub start: u8,
    /// There are walls, slopes, a strip and a tag.
    pub yard: bool,
    /// Of everything random.
    pub seed: u8,
}

impl Setup {
    /// Devices in each other's way, and a client for each of their ports.
    pub(super) fn begin(self, devices: Devices, settings: &SimSettings) -> Player {
        let wire = if self.instant {
            Wire::Instant
        } else {
            Wire::Paced
        };
        let map = if self.yard {
            yard()
        } else {
            WorldMap::default()
        };
        let plan = self.plan(devices, settings, [1.2, 0.0]);
        Player::new(plan, map, wire, self.seed.into())
    }

    /// Devices of which each is so far from the last one, m.
    pub(crate) fn plan(
        self,
        devices: Devices,
        settings: &SimSettings,
        [x, y]: [f64; 2],
    ) -> RigPlan {
        let devices = devices.iter().zip([0.0, 1.0, 2.0]).map(|(device, place)| {
            let there = |link: &&LinkSpec| self.all_links || link.optional.is_none();
            let links = device.links.iter().filter(there).count();
            DevicePlan {
                name: device.id.to_owned(),
                device,
                start: usize::from(self.start) % device.starts.len().max(1),
                pose: Pose {
                    x: place * x,
                    y: place * y,
                    ..Pose::default()
                },
                settings: settings.clone(),
                ports: vec![None; links],
            }
        });
        RigPlan {
            world: None,
            seed: None,
            settings: settings.clone(),
            devices: devices.collect(),
        }
    }
}

/// Walls within reach, a slope, a strip, and a tag under the car.
fn yard() -> WorldMap {
    static YARD: LazyLock<WorldMap> = LazyLock::new(|| {
        let text = include_str!("../corpus/world.toml");
        WorldMap::from_toml(text, "world.toml").unwrap_or_else(|error| panic!("{error}"))
    });
    YARD.clone()
}
