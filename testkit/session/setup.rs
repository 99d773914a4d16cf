//! Setup at the start of a session.

use std::sync::LazyLock;
use std::time::Duration;

use sim_core::line::Wire;
use sim_core::mecanum::MecanumSettings;
use sim_core::mecanum_device::Link;
use sim_core::mecanum_device::settings::Acknowledge;
use sim_core::r150::R150Settings;
use sim_core::r150_device::vehicle::Start;
use sim_core::rig::{PortId, Rig, RigSettings};
use sim_core::settings::SimSettings;
use sim_physics::{Pose, WorldMap};

use super::promises::{Client, Says};

/// Setup at the start.
#[derive(Debug, Clone, Copy, PartialEq, Eq, arbitrary::Arbitrary)]
#[cfg_attr(feature = "proptest", derive(proptest_derive::Arbitrary))]
pub struct Setup {
    /// Devices.
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

/// Devices of a session.
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
    pub(super) fn begin(self, settings: &SimSettings) -> (Rig, Vec<Client>) {
        let mut rig = Rig::new(RigSettings {
            world: settings.world.clone(),
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
        let mut serve = |device, link, baud, says| {
            clients.push(Client::new(PortId { device, link }, baud, says));
        };
        if self.devices != Devices::Mecanum {
            let settings: R150Settings = settings.of().cloned().unwrap_or_default();
            let start = if self.locked {
                Start::Locked
            } else {
                Start::Ready
            };
            let device = sim_core::r150::add(&mut rig, "r150", &settings, start, Pose::default());
            serve(device, 0, settings.firmware.baud, Says::Replies);
        }
        if self.devices != Devices::R150 {
            let mut settings: MecanumSettings = settings.of().cloned().unwrap_or_default();
            let firmware = &mut settings.firmware;
            if self.locked && firmware.link_timeout.is_none() {
                // There is a watchdog that can fail only then.
                firmware.link_timeout = Some(Duration::from_millis(400));
            }
            let pose = Pose {
                x: 1.2,
                ..Pose::default()
            };
            let device = sim_core::mecanum::add(&mut rig, "car", &settings, self.ros, pose);
            let firmware = &settings.firmware;
            let reports = |link, period| Says::Reports {
                link,
                period,
                acknowledges: firmware.acknowledge == Acknowledge::Status,
            };
            let main = reports(Link::Main, firmware.status_period);
            serve(device, 0, firmware.baud, main);
            if self.ros {
                let ros = reports(Link::Ros, firmware.ros_report_period);
                serve(device, 1, firmware.ros_baud, ros);
            }
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
