//! Any fault of the catalogue with any parameters that it takes.
//!
//! What a parameter takes is found out by trying: a fault that is added to the catalogue is played
//! from then on without a word here.

use std::sync::LazyLock;

use sim_core::SHIPPED;
use sim_core::device::DeviceSpec;
use sim_core::fault::parameters::{
    Direction, EchoSensor, FuseName, Key, Motors, PairName, PortName, RailName, WrongLength,
};
use sim_core::fault::{Fault, FaultInfo, catalogue};
use toml::{Table, Value};

/// Numbers that quantities are tried with, from nothing to beyond every range.
const SIZES: &[&str] = &[
    "0", "-1", "1e-9", "0.05", "1", "12", "400", "3600", "100000", "-100000", "1e30",
];
/// Units that they are tried in.
const UNITS: &[&str] = &[
    "s", "V", "A", "W", "ohm", "degC", "%", "m", "kg", "N", "N*m",
];
/// Whole numbers, among them the commands and the limits of their types.
const NUMBERS: &[i64] = &[
    0,
    1,
    -1,
    2,
    6,
    7,
    0x12,
    0xF0,
    60,
    127,
    -128,
    255,
    9600,
    65_535,
    250_000,
    4_294_967_295,
];
/// Bytes, among them what looks like frames of each link.
const BYTES: &[&str] = &[
    "AA",
    "AA 55 FF 12",
    "AA 55 00 07 C7 84",
    "00 27 01",
    "56 0A",
];

/// A choice of a fault; any numbers are one.
#[derive(Clone, Copy, PartialEq, Eq, arbitrary::Arbitrary)]
#[cfg_attr(feature = "proptest", derive(proptest_derive::Arbitrary))]
pub struct FaultChoice {
    kind: u8,
    parameters: [u8; 6],
}

impl FaultChoice {
    /// A choice of these numbers.
    #[must_use]
    pub fn new([kind, parameters @ ..]: [u8; 7]) -> Self {
        Self { kind, parameters }
    }

    /// The choice of the next kind with the same parameters.
    #[must_use]
    pub fn next(&self) -> Self {
        let kind = self.kind.wrapping_add(1);
        Self { kind, ..*self }
    }

    /// Tells whether a device of this kind has it.
    #[must_use]
    pub fn is_for(&self, device: &DeviceSpec) -> bool {
        device.has_fault(self.info().0)
    }

    fn info(&self) -> &'static (&'static FaultInfo, Taken) {
        let kinds = &*KINDS;
        &kinds[usize::from(self.kind) % kinds.len()]
    }

    /// The fault.
    #[must_use]
    pub fn fault(&self) -> Fault {
        read(self.table()).unwrap_or_else(|why| panic!("{}: {why}", self.info().0.id))
    }

    /// The fault as scenario files have it.
    #[must_use]
    pub fn table(&self) -> Table {
        let (info, taken) = self.info();
        let mut table = Table::new();
        table.insert("kind".to_owned(), Value::from(info.id));
        // Those that must be given come first, since there may be more parameters than choices.
        let parameters = info.parameters.iter().zip(taken);
        let (must, may): (Vec<_>, Vec<_>) = parameters.partition(|(info, _)| info.required);
        let choices = self.parameters.iter().map(|choice| usize::from(*choice));
        for ((parameter, values), choice) in must.into_iter().chain(may).zip(choices) {
            let value = match choice.checked_sub(usize::from(!parameter.required)) {
                Some(choice) if !values.is_empty() => &values[choice % values.len()],
                _ => continue,
            };
            table.insert(parameter.name.to_owned(), value.clone());
        }
        table
    }
}

impl std::fmt::Debug for FaultChoice {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { kind, parameters } = self;
        let fault = self.fault();
        write!(
            f,
            "FaultChoice {{ kind: {kind}, parameters: {parameters:?} }} /* {fault:?} */"
        )
    }
}

/// Values that each of a fault's parameters takes.
type Taken = Vec<Vec<Value>>;

/// The catalogue, with the values that each parameter takes.
static KINDS: LazyLock<Vec<(&'static FaultInfo, Taken)>> = LazyLock::new(|| {
    let values = values();
    let of = |info: &'static FaultInfo| {
        let takes = |name: &str, value: &Value| {
            let mut table = Table::new();
            table.insert("kind".to_owned(), Value::from(info.id));
            table.insert(name.to_owned(), value.clone());
            match read(table) {
                Ok(_) => true,
                // The value was looked at first, and was right.
                Err(why) => why.contains("missing field"),
            }
        };
        let of_parameter = |name: &str| -> Vec<Value> {
            if name == "link" {
                let links = SHIPPED.iter().flat_map(|device| device.links);
                return links.map(|link| Value::from(link.id)).collect();
            }
            values.iter().filter(|v| takes(name, v)).cloned().collect()
        };
        let parameters = info.parameters.iter();
        (info, parameters.map(|own| of_parameter(own.name)).collect())
    };
    catalogue().iter().map(of).collect()
});

/// Everything that a parameter is tried with.
fn values() -> Vec<Value> {
    fn words<T: std::fmt::Display>(all: &[T]) -> impl Iterator<Item = String> {
        all.iter().map(ToString::to_string)
    }
    let texts = words(Direction::ALL)
        .chain(words(WrongLength::ALL))
        .chain(words(RailName::ALL))
        .chain(words(PairName::ALL))
        .chain(words(FuseName::ALL))
        .chain(words(Motors::ALL))
        .chain(words(PortName::ALL))
        .chain(words(Key::ALL))
        .chain(words(EchoSensor::ALL));
    let quantities = UNITS
        .iter()
        .flat_map(|unit| SIZES.iter().map(move |size| format!("{size} {unit}")));
    let bytes = BYTES.iter().map(|&bytes| bytes.to_owned());
    let texts = texts.chain(quantities).chain(bytes).map(Value::from);
    let numbers = NUMBERS.iter().map(|&number| Value::from(number));
    let shares = [0.0, 0.01, 0.5, 1.0, -1.0, f64::NAN].map(Value::from);
    let flags = [false, true].map(Value::from);
    texts.chain(numbers).chain(shares).chain(flags).collect()
}

fn read(table: Table) -> Result<Fault, String> {
    let fault: Result<Fault, _> = Value::Table(table).try_into();
    fault.map_err(|error| error.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_parameter_of_every_fault_takes_something() {
        for (info, taken) in &*KINDS {
            for (parameter, values) in info.parameters.iter().zip(taken) {
                let name = parameter.name;
                assert!(!values.is_empty(), "{}.{name} is never played", info.id);
            }
        }
    }

    #[test]
    fn any_choice_is_a_fault() {
        for kind in 0..=u8::MAX {
            for choice in 0..=u8::MAX {
                let parameters = [choice; 6];
                assert!(!FaultChoice { kind, parameters }.fault().id().is_empty());
            }
        }
    }
}
