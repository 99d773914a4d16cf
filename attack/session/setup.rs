//! What is there at the start of a session.

use std::sync::LazyLock;
use std::time::Duration;

use sim_core::device_kind::DeviceKind;
use sim_core::line::Wire;
use sim_core::r150_device::vehicle::Start;
use sim_core::rig::{PortId, Rig, RigSettings};
use sim_core::settings::{MecanumSettings, R150Settings};
use sim_physics::{Pose, WorldMap, WorldSettings};

use super::promises::Client;

/// What is there at the start.
#[derive(Debug, Clone, Copy, PartialEq, Eq, arbitrary::Arbitrary)]
#[cfg_attr(feature = "proptest", derive(proptest_derive::Arbitrary))]
pub struct Setup {
    /// Which devices.
    pub devices: Devices,
    /// Bytes take no time.
    pub instant: bool,
    /// A car has its ROS link.
    pub ros: bool,
    /// An R150 starts as the hardware does.
    pub locked: bool,
    /// There are walls, slopes, a strip and a tag.
    pub yard: bool,
    /// Of everything random.
    pub seed: u8,
}

/// Which devices.
#[derive(Debug, Clone, Copy, PartialEq, Eq, arbitrary::Arbitrary)]
#[cfg_attr(feature = "proptest", derive(proptest_derive::Arbitrary))]
pub enum Devices {
    /// An R150.
    R150,
    /// A car.
    Mecanum,
    /// One of each, in each other's way.
    Both,
}

impl Setup {
    /// The rig, and a client for each of its ports.
    pub(super) fn begin(self) -> (Rig, Vec<Client>) {
        let mut rig = Rig::new(RigSettings {
            world: WorldSettings::default(),
            map: if self.yard {
                yard()
            } else {
                WorldMap::default()
            },
            wire: if self.instant {
                Wire::Instant
            } else {
                Wire::Paced
            },
            seed: self.seed.into(),
        });
        let mut clients = Vec::new();
        let mut serve = |device, kind, bauds: &[u32]| {
            for (link, baud) in bauds.iter().enumerate() {
                let port = PortId { device, link };
                clients.push(Client::new(port, kind, *baud));
            }
        };
        if self.devices != Devices::Mecanum {
            let settings = R150Settings::default();
            let start = if self.locked {
                Start::Locked
            } else {
                Start::Ready
            };
            let device = rig.add_r150("r150", &settings, start, Pose::default());
            serve(device, DeviceKind::R150, &[settings.firmware.baud]);
        }
        if self.devices != Devices::R150 {
            let mut settings = MecanumSettings::default();
            if self.locked {
                // There is a watchdog that can fail only then.
                settings.firmware.link_timeout = Some(Duration::from_millis(400));
            }
            let pose = Pose {
                x: 1.2,
                ..Pose::default()
            };
            let device = rig.add_mecanum("car", &settings, self.ros, pose);
            let bauds = [settings.firmware.baud, settings.firmware.ros_baud];
            serve(
                device,
                DeviceKind::Mecanum,
                &bauds[..1 + usize::from(self.ros)],
            );
        }
        (rig, clients)
    }
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
