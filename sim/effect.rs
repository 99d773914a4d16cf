//! Effects that every device has, and finding those that a device has.
//!
//! A fault acts at its own level only. Electrical, mechanical and sensor faults change the hardware,
//! and people work its buttons; both reach the client through what the firmware then measures. None
//! writes a status into a reply. Faults of the firmware are bugs in it.
//!
//! [`Rig::apply`](crate::rig::Rig::apply) begins an effect, [`Rig::clear`](crate::rig::Rig::clear)
//! ends it, and any number may be at work at once: they act in the order in which they began. Each
//! random one draws from its own streams, named by its step and direction, so that another never
//! changes what it does. Without an effect none of this runs.

mod body;
pub(crate) mod defaults;
mod firmware;
mod frames;
mod hands;
mod motors;
mod surroundings;
mod wire;

#[cfg(test)]
mod tests;

use std::sync::Arc;

use rigsim_settings::{ReadError, Reader};
use toml::Spanned;
use toml::de::DeValue;

use crate::device::parameters::LinkName;
use crate::device::{DeviceSpec, Devices, Effect, EffectInfo, Effects, effects};
pub use body::BodyFault;
pub use firmware::FirmwareFault;
pub use frames::{FrameFault, Frames, WrongLength};
pub use hands::{Hands, Place};
pub use motors::MotorFault;
pub use surroundings::{MoveText, Surroundings};
pub use wire::WireFault;

/// Effects that every device has.
pub static EVERYWHERE: &[Effects] = &[
    effects::<WireFault>(),
    effects::<FrameFault>(),
    effects::<BodyFault>(),
    effects::<Hands>(),
    effects::<Surroundings>(),
];
/// Faults of firmware, for the rows of devices whose firmware can have them.
pub const FIRMWARE: Effects = effects::<FirmwareFault>();
/// Faults of motors, for the rows of devices that say what their [motors](crate::device::Device::motors)
/// do.
pub const MOTORS: Effects = effects::<MotorFault>();

/// The kinds of effects that a device has.
pub fn of(device: &DeviceSpec) -> impl Iterator<Item = &'static Effects> + use<> {
    EVERYWHERE.iter().chain(device.effects)
}

/// Returns whether a device has this kind of effect.
#[must_use]
pub fn has(device: &DeviceSpec, info: &EffectInfo) -> bool {
    of(device).any(|effects| effects.kinds.contains(info))
}

/// Every kind of effect that one of these devices has, by level.
#[must_use]
pub fn catalogue(devices: Devices) -> Vec<&'static EffectInfo> {
    let mut all: Vec<&EffectInfo> = Vec::new();
    for info in devices
        .iter()
        .flat_map(|device| of(device))
        .flat_map(|family| family.kinds)
    {
        if !all.contains(&info) {
            all.push(info);
        }
    }
    all.sort_by_key(|info| info.level);
    all
}

/// Returns the groups of effects that these devices have under a key of steps, each once.
#[must_use]
pub fn kinds(devices: Devices, key: &str) -> Vec<&'static Effects> {
    let mut all: Vec<&Effects> = Vec::new();
    for family in devices.iter().flat_map(|device| of(device)) {
        let has_key = family.kinds.iter().any(|info| info.level.key() == key);
        if has_key && all.iter().all(|known| known.kinds != family.kinds) {
            all.push(family);
        }
    }
    all
}

/// Returns the names of a device's effects under a key of steps.
#[must_use]
pub fn names(device: &DeviceSpec, key: &str) -> Vec<&'static str> {
    let all = of(device).flat_map(|effects| effects.kinds);
    let all = all.filter(|info| info.level.key() == key);
    all.map(|info| info.id).collect()
}

/// Reads the effect of this name that a device has under a key of steps; `None` if it has none.
///
/// # Errors
/// When the value is wrong.
pub fn read(
    device: &DeviceSpec,
    (key, name): (&str, &str),
    value: &Spanned<DeValue<'_>>,
) -> Result<Option<Arc<dyn Effect>>, ReadError> {
    let is_it = |info: &EffectInfo| info.level.key() == key && info.id == name;
    let found = of(device).find(|effects| effects.kinds.iter().any(is_it));
    let reader = match key {
        "fault" => Reader::of_kind(value),
        _ => Reader::new(value),
    };
    found.map(|effects| (effects.read)(reader)).transpose()
}

/// An effect that was checked for a device.
#[derive(Debug, Clone)]
pub struct Checked {
    effect: Arc<dyn Effect>,
    link: usize,
}

impl Checked {
    /// Checks that a device with so many links can have an effect.
    ///
    /// # Errors
    /// Says in a sentence why not.
    pub fn new(effect: Arc<dyn Effect>, device: &DeviceSpec, links: usize) -> Result<Self, String> {
        let (info, scope, title) = (effect.info(), effect.scope(), device.title);
        if !has(device, info) {
            return Err(format!("{title} cannot have `{}`", info.id));
        }
        (device.check_scope)(&scope)?;
        effect.check()?;
        let link = match &scope.link {
            None => 0,
            Some(LinkName(name)) => device
                .link(name)
                .ok_or_else(|| format!("{title} has no {name} link"))?,
        };
        if link >= links {
            return Err(device.lacks_link(link));
        }
        Ok(Self { effect, link })
    }

    /// Returns the declaration of its kind.
    #[must_use]
    pub fn info(&self) -> &'static EffectInfo {
        self.effect.info()
    }

    /// Returns the effect.
    #[must_use]
    pub fn effect(&self) -> &dyn Effect {
        self.effect.as_ref()
    }

    /// Returns the index of the link on which it acts.
    #[must_use]
    pub fn link(&self) -> usize {
        self.link
    }
}
