//! The faults, until the rig has them.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use sim_core::rig::Rig;
use sim_physics::r150::{Load, Rail};

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DeviceKind {
    R150,
    Mecanum,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "kind", rename_all = "kebab-case", deny_unknown_fields)]
pub enum Fault {
    /// A dead short on the 48 V output.
    Short48,
    /// Nothing.
    Dummy { hits: u64 },
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FaultHandle(usize, u64);

impl Fault {
    pub fn id(&self) -> &'static str {
        match self {
            Self::Short48 => "short48",
            Self::Dummy { .. } => "dummy",
        }
    }
    pub fn check(&self, kind: DeviceKind) -> Result<(), String> {
        match (self, kind) {
            (Self::Short48, DeviceKind::Mecanum) => Err("only an R150 has rails".to_owned()),
            _ => Ok(()),
        }
    }
}

pub trait FaultRig {
    fn inject(&mut self, device: usize, name: &str, fault: &Fault) -> Result<FaultHandle, String>;
    fn clear(&mut self, handle: FaultHandle);
    fn fault_hits(&self, handle: FaultHandle) -> u64;
}

impl FaultRig for Rig {
    fn inject(&mut self, device: usize, _name: &str, fault: &Fault) -> Result<FaultHandle, String> {
        match fault {
            Fault::Short48 => {
                self.with_r150(device, |r, _, _| {
                    r.plant_mut().set_load(Rail::V48, Load::Short)
                });
                Ok(FaultHandle(device, 1))
            }
            Fault::Dummy { hits } => Ok(FaultHandle(usize::MAX, *hits)),
        }
    }
    fn clear(&mut self, handle: FaultHandle) {
        self.with_r150(handle.0, |r, _, _| {
            r.plant_mut().set_load(Rail::V48, Load::Open)
        });
    }
    fn fault_hits(&self, handle: FaultHandle) -> u64 {
        handle.1
    }
}

pub(crate) fn inject(
    rig: &mut Rig,
    device: usize,
    name: &str,
    fault: &Fault,
) -> Result<FaultHandle, String> {
    rig.inject(device, name, fault)
}

/// Whether bytes may arrive otherwise than they were sent.
pub(crate) fn disturbs_line(_fault: &Fault) -> bool {
    false
}
