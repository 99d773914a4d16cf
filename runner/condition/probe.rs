//! Values of single names, for tables and plots.

use sim_core::device::DeviceSpec;
use sim_core::device::names::{Reading, Unit};

use super::check::Scope;
use super::{Devices, ExpressionError, Origin, identifier};
use crate::run::Run;

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

/// The value of a name.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ProbeValue {
    /// A number; without end where a name says so.
    Number(f64),
    /// True or false.
    Flag(bool),
    /// No step has remembered it yet.
    Unknown,
}

impl ProbeValue {
    /// The number; true is 1, and what is not known is no number.
    #[must_use]
    pub fn number(self) -> f64 {
        match self {
            Self::Number(number) => number,
            Self::Flag(flag) => f64::from(u8::from(flag)),
            Self::Unknown => f64::NAN,
        }
    }
}

impl Probe {
    /// A name as conditions write it.
    ///
    /// # Errors
    /// Says what names there are.
    fn parse(name: &str, scope: &Scope<'_>) -> Result<Self, ExpressionError> {
        let found = scope.look_up(name);
        let (origin, unit) = found.map_err(|why| ExpressionError::Unsound {
            expression: name.to_owned(),
            why,
        })?;
        let device = match origin {
            Origin::Time | Origin::Saved(_) | Origin::Fixed(_) => None,
            Origin::Device(device, _) => Some(device),
        };
        Ok(Self {
            name: name.to_owned(),
            unit,
            device,
            origin,
        })
    }

    /// Every name of every device, the device's own name before it.
    fn all(devices: &Devices<'_>) -> Vec<Self> {
        let of_device = |(device, (own, kind)): (usize, &(&str, &'static DeviceSpec))| {
            let own = identifier(own);
            kind.all_names().map(move |info| Self {
                name: format!("{own}.{}", info.name),
                unit: info.unit,
                device: Some(device),
                origin: Origin::Device(device, info.getter),
            })
        };
        devices.iter().enumerate().flat_map(of_device).collect()
    }

    /// Its value now.
    #[must_use]
    pub fn read(&self, run: &Run) -> ProbeValue {
        if !self.origin.is_known(run.situation()) {
            return ProbeValue::Unknown;
        }
        match self.origin.read(run.situation()) {
            Reading::Number(number) => ProbeValue::Number(number),
            Reading::Flag(flag) => ProbeValue::Flag(flag),
        }
    }
}

impl Run {
    /// A name of the devices, parameters and remembered values of the run, as conditions write it.
    ///
    /// # Errors
    /// Says what names there are.
    pub fn probe(&self, name: &str) -> Result<Probe, ExpressionError> {
        self.in_scope(|scope| Probe::parse(name, scope))
    }

    /// Every name of every device, the device's own name before it.
    #[must_use]
    pub fn probes(&self) -> Vec<Probe> {
        Probe::all(&self.devices())
    }

    /// A name of one device, without the device's.
    #[must_use]
    pub fn probe_of(&self, device: usize, name: &str) -> Option<Probe> {
        let own = identifier(&self.scenario().rig.devices.get(device)?.name);
        self.probe(&format!("{own}.{name}")).ok()
    }

    fn devices(&self) -> Vec<(&str, &'static DeviceSpec)> {
        let plans = self.scenario().rig.devices.iter();
        plans
            .map(|plan| (plan.name.as_str(), plan.device))
            .collect()
    }
}
