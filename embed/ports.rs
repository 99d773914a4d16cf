//! Opening the ports of a plan's devices.

use std::path::{Path, PathBuf};

use rigsim_pty::{ListenAddress, PtySetup, open_serial_port, open_unlinked_port};
use rigsim_runner::{PlannedLink, RigPlan, Scenario};
use serde_json::{Value, json};

use crate::served::Served;
use rigsim_pty::PortError;

/// A pseudo-terminal has two ends, a directory and a lock.
const DESCRIPTORS_OF_A_PORT: u64 = 4;
/// More than a program needs beside its ports: several runs at a time have their own ports.
const OTHER_DESCRIPTORS: u64 = 512;

/// Opens every port that a client may open, which are all but those of devices that the script is
/// the client of; relative paths are relative to `folder`, and URLs are where to listen on the
/// network. Ports without a path are in `unnamed` under the name of the device, or wherever the system
/// puts them. The first device's first link is served on the real port `serial`, if one is named.
/// Pseudo-terminals are set up as `setup` says, but for the speed, which is the device's own.
///
/// # Errors
/// When a port cannot be made or opened.
pub fn open_all(
    scenario: &Scenario,
    folder: &Path,
    serial: Option<&Path>,
    unnamed: Option<&Path>,
    setup: PtySetup,
) -> Result<Vec<Served>, PortError> {
    let links = scenario.rig.links().count() as u64;
    rigsim_pty::want_descriptors(OTHER_DESCRIPTORS + DESCRIPTORS_OF_A_PORT * links);
    let open = |link: PlannedLink| {
        let id = link.id;
        let setup = PtySetup {
            baud: link.baud,
            ..setup
        };
        match (serial, &link.path, unnamed) {
            (Some(serial), ..) if id.device == 0 && id.link == 0 => {
                open_serial_port(serial, link.baud).map(|port| Served::new(id, port))
            }
            (_, Some(path), _) if ListenAddress::is_url(path) => Served::at(id, path, setup),
            (_, Some(path), _) => Served::at(id, &folder.join(path), setup),
            (_, None, Some(dir)) => Served::at(id, &dir.join(link.file_name()), setup),
            (_, None, None) => open_unlinked_port(setup).map(|port| Served::new(id, port)),
        }
    };
    scenario.client_links().map(open).collect()
}

/// A port as it is shown to the user.
pub struct ShownPort {
    /// The link that is served there.
    pub link: PlannedLink,
    /// Path at which a client opens it.
    pub path: PathBuf,
    /// Other machines can open it, too.
    pub is_public: bool,
}

impl ShownPort {
    /// The ports of the plan as they are served.
    pub fn all(served: &[Served], plan: &RigPlan) -> Vec<Self> {
        let links = plan.links();
        let shown = links.filter_map(|link| {
            let served = served.iter().find(|served| served.id == link.id)?;
            Some(Self {
                link,
                path: served.path.clone(),
                is_public: served.port.as_ref().is_some_and(|port| port.is_public()),
            })
        });
        shown.collect()
    }

    /// The same as JSON.
    pub fn json(&self) -> Value {
        json!({
            "device": self.link.device,
            "link": self.link.name,
            "path": self.path.to_string_lossy(),
            "baud": self.link.baud,
            "stop_bits": 1,
        })
    }
}
