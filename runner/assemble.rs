//! From a plan to a rig.

use std::path::PathBuf;

use sim_core::line::Wire;
use sim_core::r150_device::vehicle::Start;
use sim_core::rig::{Rig, RigSettings};

use sim_physics::WorldMap;

use crate::rig_file::{DevicePlan, Kind, RigPlan};

/// A serial link of a planned device.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Link {
    /// Index of the link on the device.
    pub index: usize,
    /// What it is called.
    pub name: &'static str,
    /// Speed of the device's end.
    pub baud: u32,
    /// Stop bits of the device's end; there are 8 data bits and no parity.
    pub stop_bits: u32,
    /// Path of its port, if it has been given one.
    pub path: Option<PathBuf>,
}

impl DevicePlan {
    /// The links on which it is served.
    #[must_use]
    pub fn links(&self) -> Vec<Link> {
        match self.kind {
            Kind::R150 => vec![Link {
                index: 0,
                name: "RS-232",
                baud: self.settings.r150.firmware.baud,
                stop_bits: 1,
                path: self.port.clone(),
            }],
            Kind::Mecanum => {
                let firmware = &self.settings.mecanum.firmware;
                let main = Link {
                    index: 0,
                    name: "main",
                    baud: firmware.baud,
                    stop_bits: firmware.stop_bits,
                    path: self.port.clone(),
                };
                let ros = self.ros.then(|| Link {
                    index: 1,
                    name: "ROS",
                    baud: firmware.ros_baud,
                    stop_bits: firmware.ros_stop_bits,
                    path: self.ros_port.clone(),
                });
                std::iter::once(main).chain(ros).collect()
            }
        }
    }

    /// In which state it starts, if its kind has a choice.
    #[must_use]
    pub fn start_word(&self) -> Option<&'static str> {
        match (self.kind, self.start) {
            (Kind::R150, Start::Ready) => Some("ready"),
            (Kind::R150, Start::Locked) => Some("locked"),
            (Kind::Mecanum, _) => None,
        }
    }
}

impl RigPlan {
    /// Builds the world and puts the devices into it; a device's index in the rig is its index in
    /// the plan.
    #[must_use]
    pub fn build(&self, map: WorldMap, wire: Wire, seed: u64) -> Rig {
        let world = self.settings.world.clone();
        let mut rig = Rig::new(RigSettings {
            world,
            map,
            wire,
            seed,
        });
        for device in &self.devices {
            match device.kind {
                Kind::R150 => {
                    let settings = &device.settings.r150;
                    sim_core::r150::add(&mut rig, &device.name, settings, device.start, device.pose);
                }
                Kind::Mecanum => {
                    let settings = &device.settings.mecanum;
                    sim_core::mecanum::add(&mut rig, &device.name, settings, device.ros, device.pose);
                }
            }
        }
        rig
    }
}
