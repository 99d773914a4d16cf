//! Values of single names, for tables and plots.

use rigsim_core::device::DeviceSpec;
use rigsim_core::device::names::Unit;

use super::Run;
use crate::condition::{ExpressionError, Origin, Reading, identifier};

/// A name that can be read while a run goes on.
#[derive(Debug, Clone)]
pub struct Probe {
    /// As conditions write it.
    pub name: String,
    /// Unit of its value.
    pub unit: Unit,
    /// Index of the device; `None` for the time.
    pub device: Option<usize>,
    origin: Origin,
}

impl Probe {
    /// Its value now as a number: true is 1, and what is not known is not a number.
    #[must_use]
    pub fn number(&self, run: &Run) -> f64 {
        match self.read(run) {
            Some(Reading::Number(number)) => number,
            Some(Reading::Flag(flag)) => f64::from(u8::from(flag)),
            None => f64::NAN,
        }
    }

    /// Its value now, which may be without end; `None` if no step has remembered it yet.
    #[must_use]
    pub fn read(&self, run: &Run) -> Option<Reading> {
        self.origin.read(&self.name, &run.situation)
    }
}

impl Run {
    /// A name of the devices, parameters and remembered values of the run, as conditions write it.
    ///
    /// # Errors
    /// Says what names there are.
    pub fn probe(&self, name: &str) -> Result<Probe, ExpressionError> {
        let found = self.in_scope(|scope| scope.look_up(name));
        let (origin, unit) = found.map_err(|why| ExpressionError::Unsound {
            expression: name.to_owned(),
            why,
        })?;
        let device = match origin {
            Origin::Time | Origin::Saved(_) | Origin::Fixed(_) | Origin::Published => None,
            Origin::Device(device, _) => Some(device),
        };
        Ok(Probe {
            name: name.to_owned(),
            unit,
            device,
            origin,
        })
    }

    /// Every number that a client has published so far.
    pub fn published(&self) -> impl Iterator<Item = Probe> {
        self.situation.published.keys().map(|name| Probe {
            name: name.clone(),
            unit: Unit::Number(""),
            device: None,
            origin: Origin::Published,
        })
    }

    /// Every name of every device, the device's own name before it.
    #[must_use]
    pub fn probes(&self) -> Vec<Probe> {
        let of_device = |(device, (device_name, kind)): (usize, (&str, &'static DeviceSpec))| {
            let device_name = identifier(device_name);
            kind.all_names().map(move |info| Probe {
                name: format!("{device_name}.{}", info.name),
                unit: info.unit,
                device: Some(device),
                origin: Origin::Device(device, info.getter),
            })
        };
        let devices = self.scenario().rig.kinds().into_iter();
        devices.enumerate().flat_map(of_device).collect()
    }
}
