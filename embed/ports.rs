//! Opening the ports of a plan's devices.

use std::path::{Path, PathBuf};

use serde_json::{Value, json};
use sim_core::rig::PortId;
use sim_pty::{ListenAddress, Port, PtySetup};
use sim_runner::{RigPlan, Scenario};

use crate::served::Served;
use sim_pty::PortError;

/// Place of ports that have been given no path.
pub enum Elsewhere<'a> {
    /// Wherever the system puts them.
    Unlinked,
    /// Into this folder, under the name of the device.
    In(&'a Path),
}

/// A pseudo-terminal has two ends, a directory and a lock.
const DESCRIPTORS_OF_A_PORT: u64 = 4;
/// More than a program needs beside its ports: several runs at a time have ports of their own.
const OTHER_DESCRIPTORS: u64 = 512;

/// Opens every port that a client may open, which are all but those of devices that the script is
/// the client of; relative paths are relative to `folder`, and URLs are where to listen on the
/// network. The first device's first link is served on the real port `serial`, if one is named.
/// Pseudo-terminals are set up as `setup` says, but for the speed, which is the device's own.
///
/// # Errors
/// When a port cannot be made or opened.
pub fn open_all(
    scenario: &Scenario,
    folder: &Path,
    serial: Option<&Path>,
    elsewhere: &Elsewhere<'_>,
    setup: PtySetup,
) -> Result<Vec<Served>, PortError> {
    let plan = &scenario.rig;
    let links: usize = plan.devices.iter().map(|device| device.links().len()).sum();
    sim_pty::want_descriptors(OTHER_DESCRIPTORS + DESCRIPTORS_OF_A_PORT * links as u64);
    let mut ports = Vec::new();
    let devices = plan.devices.iter().enumerate();
    for (device, planned) in devices.filter(|(device, _)| !scenario.is_scripted(*device)) {
        for link in planned.links() {
            let id = PortId {
                device,
                link: link.index,
            };
            let setup = PtySetup {
                baud: link.baud,
                ..setup
            };
            let served = match (serial, &link.path, elsewhere) {
                (Some(serial), ..) if device == 0 && link.index == 0 => {
                    Port::open_serial(serial, link.baud, link.stop_bits)
                        .map(|port| Served::new(id, port))
                }
                (_, Some(path), _) if ListenAddress::is_url(path) => Served::at(id, path, setup),
                (_, Some(path), _) => Served::at(id, &folder.join(path), setup),
                (_, None, Elsewhere::In(dir)) => {
                    let mut name = planned.name.clone();
                    if link.index > 0 {
                        name += &format!("-{}", link.name.to_lowercase());
                    }
                    Served::at(id, &dir.join(name), setup)
                }
                (_, None, Elsewhere::Unlinked) => {
                    Port::open_unlinked(setup).map(|port| Served::new(id, port))
                }
            };
            ports.push(served?);
        }
    }
    Ok(ports)
}

/// A port as the user is told of it.
pub struct ShownPort {
    /// Name of the device.
    pub device: String,
    /// Name of the link.
    pub link: &'static str,
    /// Index of the link on the device.
    pub index: usize,
    /// Path at which a client opens it.
    pub path: PathBuf,
    /// Other machines can open it, too.
    pub is_public: bool,
    /// Speed of the device's end.
    pub baud: u32,
    /// Stop bits of the device's end.
    pub stop_bits: u32,
}

impl ShownPort {
    /// A port of the plan as it is served.
    pub fn new(served: &Served, plan: &RigPlan) -> Self {
        Self {
            is_public: served.port.as_ref().is_some_and(Port::is_public),
            ..Self::at(served.id, &served.path, plan)
        }
    }

    /// A port of the plan that is found at a path of this machine.
    pub fn at(id: PortId, path: &Path, plan: &RigPlan) -> Self {
        let device = &plan.devices[id.device];
        let mut links = device.links().into_iter();
        let link = links.find(|link| link.index == id.link);
        let (link, baud, stop_bits) =
            link.map_or(("", 0, 1), |link| (link.name, link.baud, link.stop_bits));
        Self {
            device: device.name.clone(),
            link,
            index: id.link,
            path: path.to_owned(),
            is_public: false,
            baud,
            stop_bits,
        }
    }

    /// The same as JSON.
    pub fn json(&self) -> Value {
        json!({
            "device": self.device,
            "link": self.link,
            "path": self.path.to_string_lossy(),
            "baud": self.baud,
            "stop_bits": self.stop_bits,
        })
    }

    /// The variable of a client's environment that holds the path.
    pub fn variable(&self) -> String {
        variable(&self.device, self.index, self.link)
    }
}

/// The variable of a client's environment that holds the path of a device's link: `SIM_R150_PORT`,
/// and `SIM_CAR_ROS_PORT` for the second link of the device `car`.
pub fn variable(device: &str, index: usize, link: &str) -> String {
    let mut name = format!("SIM_{device}");
    if index > 0 {
        name += &format!("_{link}");
    }
    let clean = |c: char| if c.is_ascii_alphanumeric() { c } else { '_' };
    let name: String = name.chars().map(clean).collect();
    format!("{}_PORT", name.to_ascii_uppercase())
}
