//! From a plan to a rig.

use std::path::PathBuf;

use rigsim_core::device::{DeviceSettings, LinkSpec, Setup};
use rigsim_core::line::Wire;
use rigsim_core::rig::{PortId, Rig, RigSettings};

use rigsim_physics::WorldMap;

use crate::rig_file::{DevicePlan, RigPlan};

/// A serial link of a planned device.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PlannedLink {
    /// Its port.
    pub id: PortId,
    /// Name of the device.
    pub device: String,
    /// Name of the link.
    pub name: &'static str,
    /// Speed of the device's end.
    pub baud: u32,
    /// Where its port is, if it has been given one.
    pub path: Option<PathBuf>,
}

impl PlannedLink {
    /// File name of the pseudo-terminal in a folder for those of all devices.
    #[must_use]
    pub fn file_name(&self) -> String {
        match self.id.link {
            0 => self.device.clone(),
            _ => format!("{}-{}", self.device, self.name.to_lowercase()),
        }
    }

    /// The variable of a client's environment that holds the path of its port: `SIM_R150_PORT`, and
    /// `SIM_CAR_ROS_PORT` for the second link of the device `car`.
    #[must_use]
    pub fn variable(&self) -> String {
        let name = match self.id.link {
            0 => self.device.clone(),
            _ => format!("{}_{}", self.device, self.name),
        };
        let clean = |c: char| if c.is_ascii_alphanumeric() { c } else { '_' };
        let name: String = name.chars().map(clean).collect();
        format!("SIM_{}_PORT", name.to_ascii_uppercase())
    }
}

impl DevicePlan {
    /// The settings of the device alone.
    #[must_use]
    pub fn own_settings(&self) -> Option<&dyn DeviceSettings> {
        self.settings.of_device(self.device)
    }

    /// In which state it starts, if its kind has a choice.
    #[must_use]
    pub fn start_word(&self) -> Option<&'static str> {
        self.device.starts.get(self.start).map(|start| start.id)
    }
}

impl RigPlan {
    /// The links on which its devices are served.
    pub fn links(&self) -> impl Iterator<Item = PlannedLink> {
        let links = |(device, plan): (usize, &DevicePlan)| {
            let ports = plan.device.links.iter().zip(&plan.ports).enumerate();
            let planned = |(link, (spec, path)): (usize, (&LinkSpec, &Option<PathBuf>))| {
                Some(PlannedLink {
                    id: PortId { device, link },
                    device: plan.name.clone(),
                    name: spec.name,
                    baud: plan.own_settings()?.baud(link),
                    path: path.clone(),
                })
            };
            ports.filter_map(planned).collect::<Vec<_>>()
        };
        self.devices.iter().enumerate().flat_map(links)
    }

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
        for plan in &self.devices {
            let usual = (plan.device.settings)();
            let setup = Setup {
                name: &plan.name,
                settings: plan.own_settings().unwrap_or(usual.as_ref()),
                start: plan.start,
                links: plan.ports.len(),
                pose: plan.pose,
                seed,
            };
            rig.add(plan.device, &setup);
        }
        rig
    }
}
