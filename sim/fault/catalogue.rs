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
use super::{Fault, FaultInfo, FaultLevel, ParameterInfo, Scope};

/// Declares the type [`Fault`], one of its kinds for each level, and the catalogue.
///
/// A parameter without `#[serde(…)]` must be given. What many faults take is their [`Scope`]: the
/// `motors` that they are about, `only` some command's replies, with what `chance`, how often at
/// `most`, which `way`, `on` which link; each with its description, and where they differ with its
/// default.
macro_rules! faults {
    ({} $(
        $(#[doc = $of_level:literal])+
        $level:ident $of:ident { $(
            $(#[doc = $summary:literal])+
            $variant:ident = $id:literal, $everywhere:literal,
            sees $sees:literal, counts $counts:literal,
            $(motors $motors:literal $(or $usual_motors:literal)?)?
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
        )+ }
    )+) => {
        /// What goes wrong, by its level, with the parameters of its own.
        #[derive(Debug, Clone, PartialEq)]
        #[non_exhaustive]
        pub enum FaultKind { $(
            $(#[doc = $of_level])+
            $level($of),
        )+ }

        $(
            $(#[doc = $of_level])+
            #[derive(Debug, Clone, PartialEq)]
            #[non_exhaustive]
            pub enum $of { $(
                $(#[doc = $summary])+
                $variant { $(
                    $(#[doc = $about])+
                    $field: $type,
                )* },
            )+ }
        )+

        /// Something that goes wrong. In files a table with the fault's id as `kind` and its
        /// parameters beside it.
        #[derive(Deserialize, Serialize, JsonSchema)]
        #[serde(
            tag = "kind",
            rename_all = "kebab-case",
            deny_unknown_fields,
            expecting = "a table, as in `{ kind = \"mute\" }`"
        )]
        pub(super) enum Written { $( $(
            $(#[doc = $summary])+
            #[serde(rename = $id)]
            $variant {
                $(
                    #[doc = $motors]
                    $( #[serde(default = $usual_motors)] )?
                    motors: Motors,
                )?
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
        )+ )+ }

        impl From<Written> for Fault {
            fn from(written: Written) -> Self {
                let mut scope = Scope::default();
                let kind = match written { $( $(
                    Written::$variant {
                        $( motors: taken!($motors motors), )?
                        $( $field, )*
                        $( command: taken!($only command), )?
                        $( probability: taken!($chance probability), )?
                        $( count: taken!($most count), )?
                        $( direction: taken!($way direction), )?
                        $( link: taken!($on link), )?
                    } => {
                        $( scope.motors = Some(taken!($motors motors)); )?
                        $( scope.command = taken!($only command); )?
                        $( scope.probability = taken!($chance probability); )?
                        $( scope.count = taken!($most count); )?
                        $( scope.direction = taken!($way direction); )?
                        $( scope.link = Some(taken!($on link)); )?
                        FaultKind::$level($of::$variant { $($field),* })
                    },
                )+ )+ };
                Self { kind, scope }
            }
        }

        impl From<Fault> for Written {
            fn from(Fault { kind, scope }: Fault) -> Self {
                match kind { $( $(
                    FaultKind::$level($of::$variant { $($field),* }) => Self::$variant {
                        $( motors: taken!($motors scope.motors.unwrap_or(Motors::All)), )?
                        $( $field, )*
                        $( command: taken!($only scope.command), )?
                        $( probability: taken!($chance scope.probability), )?
                        $( count: taken!($most scope.count), )?
                        $( direction: taken!($way scope.direction), )?
                        $( link: taken!($on scope.link.unwrap_or_default()), )?
                    },
                )+ )+ }
            }
        }

        impl FaultKind {
            /// Returns the row of the catalogue.
            #[must_use]
            pub fn info(&self) -> &'static FaultInfo {
                let mut place = 0;
                $( $(
                    if let Self::$level($of::$variant { .. }) = self {
                        return &CATALOGUE[place];
                    }
                    place += 1;
                )+ )+
                &CATALOGUE[place % CATALOGUE.len()]
            }
        }

        const CATALOGUE: &[FaultInfo] = &[$( $( FaultInfo {
            id: $id,
            level: FaultLevel::$level,
            everywhere: $everywhere,
            parameters: &[
                $( ParameterInfo {
                    name: "motors",
                    description: $motors,
                    required: {
                        let usual: &[&str] = &[$($usual_motors)?];
                        usual.is_empty()
                    },
                }, )?
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
        } ),+ ),+];
    };
}

/// The value of a parameter that a fault has, as its description says.
macro_rules! taken {
    ($about:literal $value:ident) => {
        $value
    };
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
