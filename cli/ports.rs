//! Opening the ports of a plan's devices.

use std::path::{Path, PathBuf};

use serde_json::{Value, json};
use sim_core::rig::PortId;
use sim_pty::{Port, PtyPort, SerialPort};
use sim_runner::RigPlan;

use crate::exit::Failure;
use crate::served::Served;

/// Where ports go that have been given no path.
pub(crate) enum Elsewhere<'a> {
    /// Wherever the system puts them.
    Unlinked,
    /// Into this folder, under the name of the device.
    In(&'a Path),
}

/// Opens every port of the plan; relative paths are relative to `folder`. The first device's first
/// link is served on the real port `serial`, if one is named.
pub(crate) fn open_all(
    plan: &RigPlan,
    folder: &Path,
    serial: Option<&Path>,
    elsewhere: &Elsewhere<'_>,
) -> Result<Vec<Served>, Failure> {
    let mut ports = Vec::new();
    for (device, planned) in plan.devices.iter().enumerate() {
        for link in planned.links() {
            let id = PortId {
                device,
                link: link.index,
            };
            let served = match (serial, &link.path, elsewhere) {
                (Some(serial), ..) if device == 0 && link.index == 0 => {
                    SerialPort::open(serial, link.baud)
                        .map(|port| Served::new(id, Port::from(port)))
                }
                (_, Some(path), _) => Served::at(id, &folder.join(path), link.baud),
                (_, None, Elsewhere::In(dir)) => {
                    let mut name = planned.name.clone();
                    if link.index > 0 {
                        name += &format!("-{}", link.name.to_lowercase());
                    }
                    Served::at(id, &dir.join(name), link.baud)
                }
                (_, None, Elsewhere::Unlinked) => {
                    PtyPort::open_unlinked(link.baud).map(|port| Served::new(id, Port::from(port)))
                }
            };
            ports.push(served.map_err(Failure::system)?);
        }
    }
    Ok(ports)
}

/// A port as the user is told of it.
pub(crate) struct ShownPort {
    pub(crate) device: String,
    pub(crate) link: &'static str,
    /// Index of the link on the device.
    pub(crate) index: usize,
    pub(crate) path: PathBuf,
    pub(crate) baud: u32,
    pub(crate) stop_bits: u32,
}

impl ShownPort {
    pub(crate) fn new(served: &Served, plan: &RigPlan) -> Self {
        let device = &plan.devices[served.id.device];
        let link = device
            .links()
            .into_iter()
            .find(|link| link.index == served.id.link);
        let (link, baud, stop_bits) =
            link.map_or(("", 0, 1), |link| (link.name, link.baud, link.stop_bits));
        Self {
            device: device.name.clone(),
            link,
            index: served.id.link,
            path: served.path.clone(),
            baud,
            stop_bits,
        }
    }

    pub(crate) fn json(&self) -> Value {
        json!({
            "device": self.device,
            "link": self.link,
            "path": self.path,
            "baud": self.baud,
            "stop_bits": self.stop_bits,
        })
    }

    /// The variable of a client's environment that holds the path.
    pub(crate) fn variable(&self) -> String {
        variable(&self.device, self.index, self.link)
    }
}

/// The variable of a client's environment that holds the path of a device's link: `SIM_R150_PORT`,
/// and `SIM_CAR_ROS_PORT` for the second link of the device `car`.
pub(crate) fn variable(device: &str, index: usize, link: &str) -> String {
    let mut name = format!("SIM_{device}");
    if index > 0 {
        name += &format!("_{link}");
    }
    let clean = |c: char| if c.is_ascii_alphanumeric() { c } else { '_' };
    let name: String = name.chars().map(clean).collect();
    format!("{}_PORT", name.to_ascii_uppercase())
}
