//! Settings of a device.

use std::any::Any;
use std::fmt;

use dyn_clone::DynClone;
use rigsim_settings::Settings;

use crate::line::Adapter;

/// The settings of one device, all in one tree.
pub trait DeviceSettings: Settings + DynClone + Same + Any + fmt::Debug + Send + Sync {
    /// Returns the speed of the device's end of a link, bits per second. Bytes have 8 data bits, no parity
    /// and one stop bit.
    fn baud(&self, link: usize) -> u32;

    /// Returns the adapter of the client's computer at a link.
    fn adapter(&self, _link: usize) -> Adapter {
        Adapter::default()
    }
}

impl dyn DeviceSettings {
    /// The settings as those of this type, if they are.
    #[must_use]
    pub fn get<T: DeviceSettings>(&self) -> Option<&T> {
        (self as &dyn Any).downcast_ref()
    }
}

/// Comparison of settings of any type; whatever can be compared with its own type has it.
pub trait Same: Any {
    /// Returns whether both are of the same type, and equal.
    fn is_same(&self, other: &dyn Any) -> bool;
}

impl<T: PartialEq + Any> Same for T {
    fn is_same(&self, other: &dyn Any) -> bool {
        other.downcast_ref() == Some(self)
    }
}

dyn_clone::clone_trait_object!(DeviceSettings);

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

        impl ::rigsim_settings::Settings for $name {
            fn list(&self, prefix: &str, entries: &mut Vec<::rigsim_settings::Entry>) {
                self.firmware.list(prefix, entries);
                self.plant.list(prefix, entries);
            }

            fn assign(
                &mut self,
                path: &str,
                value: &::rigsim_settings::Value,
            ) -> Result<(), ::rigsim_settings::Problem> {
                match self.firmware.assign(path, value) {
                    Err(::rigsim_settings::Problem::UnknownKey) => self.plant.assign(path, value),
                    outcome => outcome,
                }
            }
        }
    };
}
