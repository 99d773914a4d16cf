//! From a plan to a rig.

use std::path::PathBuf;

use sim_core::device::{DeviceSettings, LineSettings, LinkSpec, Setup};
use sim_core::fault::Fault;
use sim_core::line::Wire;
use sim_core::rig::{PortId, Rig, RigSettings};

use sim_physics::WorldMap;

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
    /// Stop bits of the device's end; there are 8 data bits and no parity.
    pub stop_bits: u32,
    /// Path of its port, if it has been given one.
    pub path: Option<PathBuf>,
}

impl PlannedLink {
    /// Name of its pseudo-terminal in a folder for those of all devices.
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

    /// Tells whether it can have a fault as it is planned.
    pub(crate) fn check_fault(&self, fault: &Fault) -> Result<(), String> {
        self.device.check(fault)?;
        let link = fault
            .link()
            .and_then(|link| self.device.link(link.as_str()));
        match link.filter(|link| *link >= self.ports.len()) {
            Some(link) => Err(self.lacks_link(link)),
            None => Ok(()),
        }
    }

    /// Says that a link is not there.
    pub(crate) fn lacks_link(&self, link: usize) -> String {
        let link = self.device.links.get(link);
        let (id, name) = link.map_or(("?", "?"), |link| (link.id, link.name));
        format!("this device has no {name} link; it has one with `{id} = true`")
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
                let LineSettings { baud, stop_bits } = plan.own_settings()?.line(link);
                Some(PlannedLink {
                    id: PortId { device, link },
                    device: plan.name.clone(),
                    name: spec.name,
                    baud,
                    stop_bits: stop_bits.into(),
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
