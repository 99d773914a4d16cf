//! Setup at the start of a session.

use std::sync::LazyLock;

use rigsim_core::device::{self, DeviceSettings, DeviceSpec, Devices};
use rigsim_core::line::Wire;
use rigsim_core::rig::{PortId, Rig, RigSettings};
use rigsim_core::settings::SimSettings;
use rigsim_physics::{Pose, WorldMap};

use super::promises::Client;

/// Setup at the start.
#[derive(Debug, Clone, Copy, PartialEq, Eq, arbitrary::Arbitrary)]
#[cfg_attr(feature = "proptest", derive(proptest_derive::Arbitrary))]
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
    /// A rig with these devices in each other's way, and a client for each of its ports.
    pub(super) fn begin(self, devices: Devices, settings: &SimSettings) -> (Rig, Vec<Client>) {
        let wire = if self.instant {
            Wire::Instant
        } else {
            Wire::Paced
        };
        let mut rig = Rig::new(RigSettings {
            world: settings.world.clone(),
            map: if self.yard {
                yard()
            } else {
                WorldMap::default()
            },
            wire,
            seed: self.seed.into(),
        });
        let mut clients = Vec::new();
        for (device, x) in devices.iter().zip([0.0, 1.2, 2.4]) {
            let there = |link: &&device::LinkSpec| self.all_links || link.optional.is_none();
            let links = device.links.iter().filter(there).count();
            let start = usize::from(self.start) % device.starts.len().max(1);
            let index = add(&mut rig, (device, settings), [x, 0.0], start, links);
            clients.extend((0..links).map(|link| {
                let port = PortId {
                    device: index,
                    link,
                };
                let baud = of_device(settings, device).baud(link);
                Client::new(port, device, baud, wire)
            }));
        }
        (rig, clients)
    }
}

/// Adds a device with its first links at a place, m, in the state with this index. Returns its index.
pub(crate) fn add(
    rig: &mut Rig,
    (device, settings): (&'static DeviceSpec, &SimSettings),
    [x, y]: [f64; 2],
    start: usize,
    links: usize,
) -> usize {
    let setup = device::Setup {
        name: device.id,
        settings: of_device(settings, device),
        start,
        links,
        pose: Pose {
            x,
            y,
            ..Pose::default()
        },
        seed: 0,
    };
    rig.add(device, &setup)
}

fn of_device<'s>(settings: &'s SimSettings, device: &DeviceSpec) -> &'s dyn DeviceSettings {
    let found = settings.of_device(device);
    found.unwrap_or_else(|| panic!("{device:?} has no settings"))
}

/// Walls within reach, a slope, a strip, and a tag under the car.
fn yard() -> WorldMap {
    static YARD: LazyLock<WorldMap> = LazyLock::new(|| {
        WorldMap::from_toml(YARD_FILE, "yard").unwrap_or_else(|error| panic!("{error}"))
    });
    YARD.clone()
}

const YARD_FILE: &str = r#"
schema = 1

[[wall]]
points_m = [[2.5, -3.0], [2.5, 3.0]]
thickness = "0.1 m"

[[wall]]
points_m = [[-2.0, -2.0], [2.0, -2.0]]
thickness = "0.1 m"

[[slope]]
area.circle = { at_m = [-1.0, 0.5], radius = "0.8 m" }
slope = "12 deg"
uphill = "60 deg"

[[tag]]
at_m = [1.2, 0.0]
number = 77

[[strip]]
points_m = [[-2.0, 0.0], [2.0, 0.0]]
"#;
