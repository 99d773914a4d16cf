//! Every fault with its parameters: one table, from which types, schema and documentation come.
//!
//! The table lies in one file for each level. Each is a macro that hands its part on to the next
//! one in the row, and the last one declares them all.

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

/// Declares the type [`Fault`] and its catalogue.
///
/// A parameter without `#[serde(…)]` must be given. What many faults take stands behind their own
/// parameters: `only` some command's replies, with what `chance`, how often at `most`, which `way`,
/// `on` which link; each with its description, and where they differ with its default.
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
        $(only $only:literal)?
        $(chance $chance:literal $usual_chance:literal)?
        $(most $most:literal)?
        $(way $way:literal $usual_way:literal)?
        $(on $on:literal)?
    )+) => {
        /// Something that goes wrong. In files a table with the fault's id as `kind` and its
        /// parameters beside it.
        #[derive(Debug, Clone, PartialEq, Deserialize, Serialize, JsonSchema)]
        #[serde(tag = "kind", rename_all = "kebab-case", deny_unknown_fields)]
        pub enum Fault { $(
            $(#[doc = $summary])+
            #[serde(rename = $id)]
            $variant {
                $(
                    $(#[doc = $about])+
                    $(#[serde($($serde)*)])?
                    $field: $type,
                )*
                $(
                    #[doc = $only]
                    #[serde(default, skip_serializing_if = "Option::is_none")]
                    command: Option<u8>,
                )?
                $(
                    #[doc = $chance]
                    #[serde(default = $usual_chance)]
                    probability: Probability,
                )?
                $(
                    #[doc = $most]
                    #[serde(default, skip_serializing_if = "Option::is_none")]
                    count: Option<u64>,
                )?
                $(
                    #[doc = $way]
                    #[serde(default = $usual_way)]
                    direction: Direction,
                )?
                $(
                    #[doc = $on]
                    #[serde(default)]
                    link: LinkName,
                )?
            },
        )+ }

        impl Fault {
            /// Returns the row of the catalogue.
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

            /// The command to whose replies it keeps, if it keeps to one.
            #[must_use]
            pub fn command(&self) -> Option<u8> {
                match self {
                    $( $( Self::$variant { command, .. } => taken!($only *command), )? )+
                    _ => None,
                }
            }

            /// Returns the probability of each time; 1 if that is not said.
            #[must_use]
            pub fn probability(&self) -> Probability {
                match self {
                    $( $( Self::$variant { probability, .. } => taken!($chance *probability), )? )+
                    _ => Probability::ALWAYS,
                }
            }

            /// Returns the number of times that it acts at most.
            #[must_use]
            pub fn most(&self) -> Option<u64> {
                match self {
                    $( $( Self::$variant { count, .. } => taken!($most *count), )? )+
                    _ => None,
                }
            }

            /// Returns the direction in which it acts; both if that is not said.
            #[must_use]
            pub fn direction(&self) -> Direction {
                match self {
                    $( $( Self::$variant { direction, .. } => taken!($way *direction), )? )+
                    _ => Direction::Both,
                }
            }

            /// The link on which it acts, if it says so.
            pub(super) fn own_link(&self) -> Option<LinkName> {
                match self {
                    $( $( Self::$variant { link, .. } => taken!($on Some(link.clone())), )? )+
                    _ => None,
                }
            }
        }

        const CATALOGUE: &[FaultInfo] = &[$( FaultInfo {
            id: $id,
            level: FaultLevel::$level,
            everywhere: $everywhere,
            parameters: &[
                $( ParameterInfo {
                    name: stringify!($field),
                    description: concat!($($about),+).trim_ascii_start(),
                    required: {
                        let given: &[&str] = &[$(stringify!($($serde)*),)?];
                        given.is_empty()
                    },
                }, )*
                $( ParameterInfo::shared("command", $only), )?
                $( ParameterInfo::shared("probability", $chance), )?
                $( ParameterInfo::shared("count", $most), )?
                $( ParameterInfo::shared("direction", $way), )?
                $( ParameterInfo::shared("link", $on), )?
            ],
            client_sees: $sees,
            counts: $counts,
            summary: concat!($($summary),+).trim_ascii_start(),
        } ),+];
    };
}

/// The value of a parameter that a fault has, as its description says.
macro_rules! taken {
    ($about:literal $value:expr) => {
        $value
    };
}

wire! { { protocol firmware electrical mechanical operator sensor faults } }

/// Every fault, by level.
#[must_use]
pub fn catalogue() -> &'static [FaultInfo] {
    CATALOGUE
}
