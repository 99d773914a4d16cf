//! Devices as all other code sees them: a row of a table, and a trait.
//!
//! [`DeviceSpec`] describes a device: its links, settings, events, names for conditions, commands
//! and replies for scripted clients, what can go wrong with it and what people do to it, and how it
//! is built. [`Device`] is one that was built: firmware and hardware, tied together. Nothing
//! outside of a device's own folder knows which devices there are, but the table ([`Devices`]),
//! which the program hands in.

mod counters;
mod declare;
mod effect;
mod framing;
pub mod host;
pub mod names;
pub mod parameters;
mod settings;

use std::any::Any;
use std::fmt;
use std::time::Duration;

use rigsim_physics::{Plant, Pose, World};
use rigsim_settings::SimTime;

use crate::defects::{DefectCounts, Defects};
use crate::event::{Code, EventKind, code};
use crate::message::{MessageInfo, Sender};
use parameters::Scope;

pub use rigsim_physics::Motion;

pub use counters::Counters;
#[doc(hidden)]
pub use declare::kind_of;
pub use effect::{
    Begin, Change, Declared, Effect, EffectError, EffectHandle, EffectInfo, Effects, Kinds, Level,
    MotorState, OnBytes, OnFrames, OnHardware, ParameterInfo, Restore, Sum, Tally, TimedByte,
    TimedFrame, Way, Work, effects,
};
pub(crate) use effect::{MOST_ARMED, MOST_EVER};
pub use framing::{Form, Framing};
pub use host::HostSpec;
pub use names::{NameInfo, View};
pub use settings::DeviceSettings;

/// The devices that there are.
pub type Devices = &'static [&'static DeviceSpec];

/// A device as it is described to all other code.
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
    /// Keys of settings that an owner compares with the real device first, most telling ones first.
    pub compare_first: &'static [&'static str],
    /// Puts one into a world.
    pub build: fn(&Setup<'_>, &mut World) -> Box<dyn Device>,
    /// The names of the device's own events.
    pub codes: &'static [Code],
    /// Messages of its protocol, as they are declared.
    pub messages: &'static [&'static [MessageInfo]],
    /// Names of conditions about it, beside those that its messages and codes declare.
    pub names: &'static [&'static [NameInfo]],
    /// Language in which scripted clients speak with it.
    pub host: HostSpec,
    /// What can be done to it, beside what can be done to any device: faults, actions of people,
    /// changes around it. What several devices have is in [`crate::effect`].
    pub effects: &'static [Effects],
    /// Refuses a target that it does not have, in a sentence that says why.
    pub check_scope: fn(&Scope) -> Result<(), String>,
}

impl DeviceSpec {
    /// Finds a name of conditions.
    #[must_use]
    pub fn find_name(&self, name: &str) -> Option<NameInfo> {
        self.all_names().find(|info| info.name == name)
    }

    /// Everything that a condition can say of it, each name once.
    pub fn all_names(&self) -> impl Iterator<Item = NameInfo> + use<> {
        let mut all: Vec<NameInfo> = self.names.iter().copied().flatten().copied().collect();
        for info in self.all_messages().flat_map(names::of_message) {
            if all.iter().all(|known| known.name != info.name) {
                all.push(info);
            }
        }
        for code in [self.codes, code::CODES].concat() {
            if !all.iter().any(|known| known.is_count_of(code)) {
                all.push(names::of_code(code));
            }
        }
        all.into_iter()
    }

    /// The messages of its protocol.
    pub fn all_messages(&self) -> impl Iterator<Item = &'static MessageInfo> + use<> {
        self.messages.iter().copied().flatten()
    }

    /// Names of the fields that a reply to this command on a link can have; to any command where
    /// it is not known.
    #[must_use]
    pub fn reply_fields(&self, link: usize, command: Option<u8>) -> Vec<&'static str> {
        let mut replies: Vec<&MessageInfo> = self.all_messages().collect();
        replies.retain(|info| info.sender == Sender::Device && info.link == link);
        replies.retain(|info| command.is_none_or(|command| info.id == command));
        let fields = replies.iter().flat_map(|info| info.fields);
        fields.map(|field| field.name).collect()
    }

    /// Says that one of its links is not there.
    #[must_use]
    pub fn lacks_link(&self, link: usize) -> String {
        let link = self.links.get(link);
        let (id, name) = link.map_or(("?", "?"), |link| (link.id, link.name));
        format!("this device has no {name} link; it has one with `{id} = true`")
    }

    /// Index of the link with this id.
    #[must_use]
    pub fn link(&self, id: &str) -> Option<usize> {
        self.links.iter().position(|link| link.id == id)
    }
}

/// Every kind of a client report with these devices: what the protocol forbids, or what is risky.
pub fn client_report_codes(devices: Devices) -> impl Iterator<Item = &'static str> {
    let of_devices = devices.iter().map(|device| device.codes);
    let all = std::iter::once(code::CODES).chain(of_devices).flatten();
    all.filter(|code| code.may_be_client_error())
        .map(|code| code.name)
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
#[derive(Debug, Clone, Copy)]
pub struct LinkSpec {
    /// Word for it in scenario files.
    pub id: &'static str,
    /// Name for people.
    pub name: &'static str,
    /// Cost, for help, of a link that is there only when it is asked for.
    pub optional: Option<&'static str>,
    /// What it carries.
    pub framing: Framing,
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

/// Settings as those of the type that a row has.
///
/// # Panics
/// The row has settings of another type: an error of the row that would otherwise give a default
/// vehicle.
#[must_use]
pub fn typed<T: DeviceSettings>(settings: &dyn DeviceSettings) -> &T {
    #[expect(
        clippy::panic,
        reason = "only a wrong row leads here, in its first test"
    )]
    settings.get().unwrap_or_else(|| {
        let wanted = std::any::type_name::<T>();
        panic!("a row builds its device from {wanted}, but has other settings: {settings:?}")
    })
}

/// Firmware and hardware of one device, tied together.
///
/// Time never goes back. After `advance`, and after a `receive` that has led to output, the rig calls
/// `exchange_signals`, and takes all output and events.
pub trait Device: Any + Send + Sync {
    /// Takes bytes whose last has arrived on `link` at `now`.
    fn receive(&mut self, now: SimTime, link: usize, bytes: &[u8]);

    /// Does everything that the firmware has due by `now`.
    fn advance(&mut self, now: SimTime);

    /// Time at which the firmware next does something by itself.
    fn next_deadline(&self) -> Option<SimTime>;

    /// Returns whether output or events wait to be taken. Whatever bytes do to a device is reported by
    /// one, but for the place within a frame that they bring it to.
    fn has_output(&self) -> bool;

    /// Passes pins and measurements between firmware and hardware until neither changes. By now, this
    /// much of the step that comes has `passed`.
    fn exchange_signals(&mut self, now: SimTime, passed: Duration);

    /// Bytes for the client of a link.
    fn poll_output(&mut self) -> Option<(usize, Vec<u8>)>;

    /// The next event and when it happened.
    fn poll_event(&mut self) -> Option<(SimTime, EventKind)>;

    /// The machine was late: what waits for the line at `now` may have been sent up to `by` before,
    /// and simulated time stood still for `stood`. Of no concern to firmware that does not judge
    /// how fast clients send.
    fn late(&mut self, _now: SimTime, _by: Duration, _stood: Duration) {}

    /// Returns its hardware.
    fn plant(&self) -> &dyn Plant;

    /// The same, to change.
    fn plant_mut(&mut self) -> &mut dyn Plant;

    /// Returns a sum of faults in which nothing is wrong. A device whose hardware has faults
    /// has a part for them in it.
    fn no_faults(&self) -> Sum {
        Sum::new(0.0, ())
    }

    /// Brings motors and hardware into the state that all faults together make. Body and firmware
    /// are not its concern.
    fn set_faults(&mut self, _now: SimTime, _sum: &Sum) {}

    /// Returns the state of the motors of the wheels: left front, right front, left rear, right
    /// rear.
    fn motors(&self) -> [MotorState; 4] {
        Default::default()
    }

    /// Replaces all that is wrong with the firmware. This and what follows is
    /// only called if the row has faults of the firmware.
    fn set_defects(&mut self, _now: SimTime, _defects: Defects) {}

    /// Counts how often what is wrong with the firmware has shown.
    fn defect_counts(&self) -> DefectCounts {
        DefectCounts::default()
    }

    /// Returns whether the firmware has a watchdog that could fail; says in a sentence why not.
    fn check_watchdog(&self) -> Result<(), String> {
        Ok(())
    }

    /// The firmware restarts, and is up after `boot`; says whether it ran.
    fn reset(&mut self, _now: SimTime, _boot: Duration) -> bool {
        false
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

    /// The device of this type, which the row of an effect belongs to.
    ///
    /// # Panics
    /// The device is of another type.
    pub fn typed<T: Device>(&mut self) -> &mut T {
        #[expect(
            clippy::panic,
            reason = "only a wrong row leads here, in its first test"
        )]
        self.get_mut().unwrap_or_else(|| {
            let wanted = std::any::type_name::<T>();
            panic!("an effect of {wanted} is in the row of another device")
        })
    }
}

#[cfg(test)]
mod tests;
