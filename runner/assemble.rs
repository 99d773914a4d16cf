//! From a plan to a rig.

use std::path::PathBuf;

use sim_core::device::{DeviceSettings, LineSettings, LinkSpec, Setup};
use sim_core::fault::Fault;
use sim_core::line::Wire;
use sim_core::rig::{Rig, RigSettings};

use sim_physics::WorldMap;

use crate::rig_file::{DevicePlan, RigPlan};

/// A serial link of a planned device.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PlannedLink {
    /// Index of the link on the device.
    pub index: usize,
    /// Name of it.
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
    pub fn links(&self) -> Vec<PlannedLink> {
        let ports = self.device.links.iter().zip(&self.ports).enumerate();
        let link = |(index, (link, path)): (usize, (&LinkSpec, &Option<PathBuf>))| {
            let LineSettings { baud, stop_bits } = self.own_settings()?.line(index);
            Some(PlannedLink {
                index,
                name: link.name,
                baud,
                stop_bits: stop_bits.into(),
                path: path.clone(),
            })
        };
        ports.filter_map(link).collect()
    }

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
