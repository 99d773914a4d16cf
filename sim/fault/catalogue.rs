//! Every fault with its parameters: one table, from which types, schema and documentation come.
//!
//! The table lies in one file for each level. Each is a macro that hands its part on to the next one
//! in the row, and the last one declares them all.

#[macro_use]
mod wire;
#[macro_use]
mod protocol;
#[macro_use]
mod firmware;
#[macro_use]
mod electrical;
#[macro_use]
mod mechanical;
#[macro_use]
mod operator;
#[macro_use]
mod sensor;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use sim_settings::{
    Current, Force, Length, Mass, Percent, Power, Resistance, Span, Temperature, Torque, Voltage,
};

use super::defaults;
use super::parameters::{
    Direction, EchoSensor, FuseName, HexBytes, Key, LinkName, Motors, PairName, PortName,
    Probability, RailName, WrongLength,
};
use super::{FaultInfo, FaultLevel, ParameterInfo};

/// Declares the type [`Fault`] and its catalogue. A parameter without `#[serde(…)]` must be given.
macro_rules! faults {
    ({} $(
        $(#[doc = $summary:literal])+
        $variant:ident = $id:literal, $level:ident, $everywhere:literal,
        sees $sees:literal, counts $counts:literal,
        { $(
            $(#[doc = $about:literal])+
            $(#[serde($($serde:tt)*)])?
            $field:ident: $type:ty,
        )* }
    )+) => {
        /// Something that goes wrong. In files a table with the fault's id as `kind` and its
        /// parameters beside it.
        #[derive(Debug, Clone, PartialEq, Deserialize, Serialize, JsonSchema)]
        #[serde(tag = "kind", rename_all = "kebab-case", deny_unknown_fields)]
        pub enum Fault { $(
            $(#[doc = $summary])+
            #[serde(rename = $id)]
            $variant { $(
                $(#[doc = $about])+
                $(#[serde($($serde)*)])?
                $field: $type,
            )* },
        )+ }

        impl Fault {
            /// What the catalogue says of it.
            #[must_use]
            pub fn info(&self) -> &'static FaultInfo {
                let mut place = 0;
                $(
                    if let Self::$variant { .. } = self {
                        return &CATALOGUE[place];
                    }
                    place += 1;
                )+
                &CATALOGUE[place % CATALOGUE.len()]
            }
        }

        const CATALOGUE: &[FaultInfo] = &[$( FaultInfo {
            id: $id,
            level: FaultLevel::$level,
            everywhere: $everywhere,
            parameters: &[$( ParameterInfo {
                name: stringify!($field),
                description: concat!($($about),+).trim_ascii_start(),
                required: {
                    let given: &[&str] = &[$(stringify!($($serde)*),)?];
                    given.is_empty()
                },
            } ),*],
            client_sees: $sees,
            counts: $counts,
            summary: concat!($($summary),+).trim_ascii_start(),
        } ),+];
    };
}

wire! { { protocol firmware electrical mechanical operator sensor faults } }

/// Every fault, by level.
#[must_use]
pub fn catalogue() -> &'static [FaultInfo] {
    CATALOGUE
}
