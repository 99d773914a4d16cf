//! Devices as everybody else sees them: a row of a table, and a trait.
//!
//! [`DeviceSpec`] describes a device: its links, settings, events, names for conditions, commands
//! and replies for scripted clients, what can go wrong with it and what people do to it, and how it
//! is built. [`Device`] is one that was built: firmware and hardware, tied together. Nothing
//! outside of a device's own folder knows which devices there are, but the table ([`Devices`]),
//! which the program hands in.

mod action;
mod framing;
pub mod host;
pub mod names;
mod observed;
mod settings;

use std::any::Any;
use std::fmt;
use std::sync::Arc;
use std::time::Duration;

use sim_physics::{Plant, Pose, World};
use sim_settings::SimTime;

use crate::defects::{DefectCounts, Defects};
use crate::event::{Code, EventKind, code};
use crate::fault::{Fault, FaultInfo, OperatorFault, catalogue};
use crate::noise::Noise;

pub use sim_physics::Motion;

pub use action::{
    Action, Actions, Change, EffectHandle, HANDS, Hands, Performed, Place, Push, Restore, actions,
};
pub(crate) use framing::with_first;
pub use framing::{Framing, TextLines};
pub use host::HostSpec;
pub use names::{NameInfo, View};
pub use observed::{Observed, Observer};
pub use settings::{DeviceSettings, LineSettings};

/// The devices that there are.
pub type Devices = &'static [&'static DeviceSpec];

/// A device as it is described to everybody else.
pub struct DeviceSpec {
    /// Its `kind` in files, flags and settings: lower-case letters and digits.
    pub id: &'static str,
    /// It in a sentence, with its article: `an R150`.
    pub title: &'static str,
    /// Description in a sentence, for help.
    pub about: &'static str,
    /// Its serial links. The first one is always there.
    pub links: &'static [LinkSpec],
    /// States in which it can begin, the usual one first; none if it has no choice.
    pub starts: &'static [StartSpec],
    /// Its settings as they are by default.
    pub settings: fn() -> Box<dyn DeviceSettings>,
    /// Puts one into a world.
    pub build: fn(&Setup<'_>, &mut World) -> Box<dyn Device>,
    /// The names of its own events.
    pub codes: &'static [Code],
    /// Names of conditions about it.
    pub names: &'static [&'static [NameInfo]],
    /// Takes note of its events for those names.
    pub observer: fn() -> Box<dyn Observer>,
    /// Language in which scripted clients speak with it.
    pub host: HostSpec,
    /// Deeds of people that it alone knows, beside those that any vehicle knows.
    pub operator: Option<Actions>,
    /// Changes around it that it alone knows, beside those of any world.
    pub surroundings: Option<Actions>,
    /// The faults of its own that it can have, by their ids; those that every device can have are
    /// not among them.
    pub faults: &'static [&'static str],
    /// Refuses a fault that it cannot have, or not with these parameters, in a sentence that says
    /// why.
    pub check_fault: fn(&Fault) -> Result<(), String>,
}

impl DeviceSpec {
    /// Finds a name of conditions that stands in no list, such as one with a number in it.
    pub fn find_name(&self, name: &str) -> Option<&'static NameInfo> {
        self.all_names().find(|info| info.name == name)
    }

    /// Everything that a condition can say of it.
    pub fn all_names(&self) -> impl Iterator<Item = &'static NameInfo> + use<> {
        self.names.iter().copied().flatten()
    }

    /// Checks that it can have this fault, with these parameters.
    ///
    /// # Errors
    /// Says in a sentence why not.
    pub fn check(&self, fault: &Fault) -> Result<(), String> {
        (self.check_fault)(fault)?;
        let (id, title) = (fault.id(), self.title);
        if !self.has_fault(fault.info()) {
            return Err(format!(
                "{title} cannot have `{id}`; `sim faults --device {}` lists what it can have",
                self.id
            ));
        }
        if let Some(link) = fault.link()
            && self.link(link.as_str()).is_none()
        {
            return Err(format!("{title} has no {link} link"));
        }
        fault.check()
    }

    /// Index of the link with this id.
    #[must_use]
    pub fn link(&self, id: &str) -> Option<usize> {
        self.links.iter().position(|link| link.id == id)
    }

    /// Tells whether it can have this fault at all.
    #[must_use]
    pub fn has_fault(&self, info: &FaultInfo) -> bool {
        info.everywhere || self.faults.contains(&info.id)
    }
}

/// A row that lists a fault which is none.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error(
    "the row of {device} lists the fault `{fault}`, which is in no catalogue; docs/faults.md lists \
     those that there are"
)]
pub struct RowError {
    /// The device's id.
    pub device: &'static str,
    /// The fault's id, as the row has it.
    pub fault: &'static str,
}

/// Checks of a table what the compiler cannot: its rows list faults of the catalogue.
///
/// # Errors
/// Names the first fault that is none, and its row.
pub fn check_rows(devices: Devices) -> Result<(), RowError> {
    for device in devices {
        let unknown = |id: &&&str| catalogue().iter().all(|info| info.id != **id);
        if let Some(fault) = device.faults.iter().find(unknown) {
            let device = device.id;
            return Err(RowError { device, fault });
        }
    }
    Ok(())
}

/// Every kind that a client report can have: what these devices and the line tell of that the
/// protocol forbids, or that is risky.
pub fn client_report_codes(devices: Devices) -> impl Iterator<Item = &'static str> {
    let own = devices.iter().map(|device| device.codes);
    let all = std::iter::once(code::CODES).chain(own).flatten();
    all.filter(|code| code.may_blame_client())
        .map(|code| code.as_str())
}

impl PartialEq for DeviceSpec {
    fn eq(&self, other: &Self) -> bool {
        self.id == other.id
    }
}

impl Eq for DeviceSpec {}

impl fmt::Debug for DeviceSpec {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.id)
    }
}

/// A serial link of a device.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LinkSpec {
    /// Word for it in scenario files.
    pub id: &'static str,
    /// Name for people.
    pub name: &'static str,
    /// Cost, for help, of a link that is there only when it is asked for.
    pub optional: Option<&'static str>,
}

impl LinkSpec {
    /// A link that is always there.
    #[must_use]
    pub const fn always(id: &'static str, name: &'static str) -> Self {
        Self {
            id,
            name,
            optional: None,
        }
    }
}

/// A state in which a device can begin.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct StartSpec {
    /// The word in files and flags.
    pub id: &'static str,
    /// Meaning, for help.
    pub about: &'static str,
}

/// A device that is to be built.
#[derive(Debug, Clone, Copy)]
pub struct Setup<'a> {
    /// Its name, from which its streams of chance are named.
    pub name: &'a str,
    /// Its settings, of the type that its own row gives.
    pub settings: &'a dyn DeviceSettings,
    /// Index of the state in which it begins.
    pub start: usize,
    /// Number of its links that are there, from the first one on.
    pub links: usize,
    /// Place and heading at the start.
    pub pose: Pose,
    /// From which every stream of chance of the run is derived.
    pub seed: u64,
}

/// Firmware and hardware of one device, tied together.
///
/// Time never goes back. After `advance`, and after a `receive` that has led to news, the rig calls
/// `settle`, and takes all output and events.
pub trait Device: Breakable + Any + Send + Sync {
    /// Takes bytes whose last has arrived on `link` at `now`.
    fn receive(&mut self, now: SimTime, link: usize, bytes: &[u8]);

    /// Does everything that the firmware has due by `now`.
    fn advance(&mut self, now: SimTime);

    /// Time at which the firmware next does something by itself.
    fn next_deadline(&self) -> Option<SimTime>;

    /// Tells whether output or events wait to be taken. Whatever bytes do to a device is told by
    /// one, but for the place within a frame that they bring it to.
    fn has_news(&self) -> bool;

    /// Passes pins and measurements between firmware and hardware until neither changes.
    fn settle(&mut self, now: SimTime);

    /// Bytes for the client of a link.
    fn poll_output(&mut self) -> Option<(usize, Vec<u8>)>;

    /// The next event and when it happened.
    fn poll_event(&mut self) -> Option<(SimTime, Arc<dyn EventKind>)>;

    /// The machine was late by `by`: until then what clients send may come up to `by` closer
    /// together than they were sent. Of no concern to firmware without a rule against that.
    fn expect_burst(&mut self, _by: Duration, _until: SimTime) {}

    /// Returns its hardware.
    fn plant(&self) -> &dyn Plant;

    /// The same, to change.
    fn plant_mut(&mut self) -> &mut dyn Plant;

    /// Lets time pass for its slow states up to `now`, while nothing in the world moves. Of no
    /// concern to a device without any.
    fn rest_until(&mut self, _now: SimTime) {}

    /// Takes over what the step, which ended at `now`, has done.
    fn after_step(&mut self, _now: SimTime, world: &mut World) {
        self.plant_mut().after_step(world);
    }

    /// Replaces all that is wrong with the firmware. This and what follows, but for the framing, is
    /// only called if the row has faults of the firmware.
    fn set_defects(&mut self, _now: SimTime, _defects: Defects) {}

    /// Counts how often what is wrong with the firmware has shown.
    fn defect_counts(&self) -> DefectCounts {
        DefectCounts::default()
    }

    /// Tells whether the firmware has a watchdog that could fail; says in a sentence why not.
    fn check_watchdog(&self) -> Result<(), String> {
        Ok(())
    }

    /// The firmware restarts, and is up after `boot`; says whether it ran.
    fn reset(&mut self, _now: SimTime, _boot: Duration) -> bool {
        false
    }

    /// Returns the form of what a link carries, for faults that spoil it.
    fn framing(&self, link: usize) -> &'static dyn Framing;
}

/// Faults of a device's hardware, its sensors and its operators. What is here is only called if the
/// row has such faults.
pub trait Breakable {
    /// A fault of the hardware or a sensor begins.
    fn arm(&mut self, _handle: EffectHandle, _fault: &Fault, _noise: Noise) {}

    /// That fault ends.
    fn disarm(&mut self, _handle: EffectHandle) {}

    /// Brings the hardware into the state that all such faults together make; those of it as a body
    /// are none of its concern.
    fn apply_faults(&mut self, _now: SimTime) {}

    /// Somebody does this to it; gives what that changes, also where it was so before.
    fn be_operated(&mut self, _now: SimTime, _fault: &OperatorFault) -> Vec<Change> {
        Vec::new()
    }

    /// So many seconds have passed for the hardware: interference goes on. Tells what it has acted
    /// on.
    fn interfere(&mut self, _seconds: f64, _acted: &mut dyn FnMut(EffectHandle, String)) {}

    /// Tells whether an armed fault has an effect now.
    fn acts(&self, _handle: EffectHandle, _fault: &Fault) -> bool {
        false
    }

    /// Says in words what it acts on now.
    fn acted_on(&self, fault: &Fault) -> String {
        fault.in_words()
    }
}

impl dyn Device {
    /// The device as one of this type, if it is one.
    #[must_use]
    pub fn get<T: Device>(&self) -> Option<&T> {
        (self as &dyn Any).downcast_ref()
    }

    /// The device as one of this type, if it is one.
    pub fn get_mut<T: Device>(&mut self) -> Option<&mut T> {
        (self as &mut dyn Any).downcast_mut()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::r150::R150_SPEC;

    #[test]
    fn a_row_with_a_fault_that_is_none_is_refused() {
        static WRONG: DeviceSpec = DeviceSpec {
            id: "own",
            faults: &["can-failing", "can-fading"],
            ..R150_SPEC
        };
        static TABLE: Devices = &[&R150_SPEC, &WRONG];
        assert_eq!(check_rows(crate::SHIPPED), Ok(()));
        let (device, fault) = ("own", "can-fading");
        let refused = check_rows(TABLE).unwrap_err();
        assert_eq!(refused, RowError { device, fault });
        assert!(refused.to_string().contains("`can-fading`"), "{refused}");
    }
}
