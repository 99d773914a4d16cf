//! Settings of a device.

use std::any::Any;
use std::fmt;

use sim_settings::Settings;

use crate::event::Same;

/// Speed and stop bits of a link; there are 8 data bits and no parity.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LineSettings {
    /// Bits per second.
    pub baud: u32,
    /// 1 or 2.
    pub stop_bits: u8,
}

impl LineSettings {
    /// At this speed with one stop bit.
    #[must_use]
    pub const fn at(baud: u32) -> Self {
        Self { baud, stop_bits: 1 }
    }
}

/// The settings of one device, all in one tree.
pub trait DeviceSettings: Settings + Copied + Same + Any + fmt::Debug + Send + Sync {
    /// The device's end of a link.
    fn line(&self, link: usize) -> LineSettings;

    /// Pairs of settings of which the first must not be above the second: name and value of each.
    fn ordered(&self) -> Vec<[(&'static str, f64); 2]> {
        Vec::new()
    }
}

impl dyn DeviceSettings {
    /// The settings as those of this type, if they are.
    #[must_use]
    pub fn get<T: DeviceSettings>(&self) -> Option<&T> {
        (self as &dyn Any).downcast_ref()
    }

    /// The settings as those of this type, if they are.
    pub fn get_mut<T: DeviceSettings>(&mut self) -> Option<&mut T> {
        (self as &mut dyn Any).downcast_mut()
    }
}

/// Copies settings of any type; whatever can be cloned has it.
pub trait Copied {
    /// A copy.
    fn copied(&self) -> Box<dyn DeviceSettings>;
}

impl<T: DeviceSettings + Clone> Copied for T {
    fn copied(&self) -> Box<dyn DeviceSettings> {
        Box::new(self.clone())
    }
}

impl Clone for Box<dyn DeviceSettings> {
    fn clone(&self) -> Self {
        (**self).copied()
    }
}

impl PartialEq for dyn DeviceSettings {
    fn eq(&self, other: &Self) -> bool {
        self.is_same(other)
    }
}

/// Joins a firmware's and a plant's settings under one name.
#[macro_export]
macro_rules! device_settings {
    ($(#[doc = $doc:literal])* $vis:vis struct $name:ident { $firmware:ty, $plant:ty }) => {
        $(#[doc = $doc])*
        #[derive(Debug, Clone, PartialEq, Default)]
        $vis struct $name {
            /// The firmware.
            pub firmware: $firmware,
            /// The hardware around it.
            pub plant: $plant,
        }

        impl ::sim_settings::Settings for $name {
            fn list(&self, prefix: &str, entries: &mut Vec<::sim_settings::Entry>) {
                self.firmware.list(prefix, entries);
                self.plant.list(prefix, entries);
            }

            fn assign(
                &mut self,
                path: &str,
                value: &::sim_settings::Value,
            ) -> Result<(), ::sim_settings::Problem> {
                match self.firmware.assign(path, value) {
                    Err(::sim_settings::Problem::UnknownKey) => self.plant.assign(path, value),
                    outcome => outcome,
                }
            }
        }
    };
}
