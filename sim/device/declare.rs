//! The macros that declare effects: types, schema and documentation from one entry.

use super::effect::EffectInfo;

/// Finds a kind by its id, which is one of these.
#[doc(hidden)]
#[must_use]
pub fn kind_of(kinds: &'static [EffectInfo], id: &str) -> &'static EffectInfo {
    let found = kinds.iter().find(|kind| kind.id == id);
    found.unwrap_or(&kinds[0])
}

/// The name behind what was given.
#[doc(hidden)]
#[macro_export]
macro_rules! name_behind {
    ([$($given:literal)*] $name:ident) => {
        $name
    };
}

/// Description of a parameter that many faults take, where none is given.
#[doc(hidden)]
#[macro_export]
macro_rules! shared_text {
    ($key:ident $given:literal) => {
        $given
    };
    (only) => {
        "Only replies to this command, or packets of this type; default all."
    };
    (chance) => {
        "Probability for each frame; default 1."
    };
    (most) => {
        "Maximum number of hits; default no limit."
    };
    (way) => {
        "Direction; default both."
    };
    (on) => {
        "Link; default main."
    };
}

/// Declares kinds of faults: a type with a variant for each, read from `fault = { kind = … }`.
///
/// A parameter without `#[serde(…)]` must be given. Parameters that many faults take follow the
/// braces, each with its description and its default where those are not the usual ones: `motors`,
/// `only` replies to some command, `chance`, `most` times, `way` and link (`on`). Together they are
/// its [`Scope`](crate::device::parameters::Scope). The crate needs `serde` and `schemars`.
///
/// After `counts` stands what a search takes from it, where that is not the usual: parameters that it
/// `tries`, how long the fault `lasts`, and `weaker` kinds; see [`EffectInfo`].
///
/// ```
/// rigsim_core::faults! {
///     /// Faults of a lamp.
///     pub enum LampFault {
///         /// The lamp flickers.
///         Flickers = "flickers", Electrical,
///         sees "Nothing.",
///         counts "The lamp was on.",
///         {
///             /// Times a second.
///             often: u8,
///         }
///     }
/// }
/// ```
#[macro_export]
macro_rules! faults {
    (
        $(#[doc = $of_all:literal])+
        $vis:vis enum $of:ident { $(
            $(#[doc = $summary:literal])+
            $variant:ident = $id:literal, $level:ident,
            sees $sees:literal,
            counts $counts:literal,
            $(tries [$($try:literal),+])?
            $(lasts [$($lasts:literal),+])?
            $(weaker [$($weaker:literal),+])?
            $(motors $motors:literal $(or $usual_motors:literal)?)?
            { $(
                $(#[doc = $about:literal])+
                $(#[serde($($serde:tt)*)])?
                $field:ident: $type:ty,
            )* }
            $(only $($only:literal)?)?
            $(chance $($chance:literal $usual_chance:literal)?)?
            $(most $($most:literal)?)?
            $(way $($way:literal $usual_way:literal)?)?
            $(on $($on:literal)?)?
        )+ }
    ) => {
        $(#[doc = $of_all])+
        #[derive(Debug, Clone, PartialEq, serde::Deserialize, schemars::JsonSchema)]
        #[serde(deny_unknown_fields)]
        #[schemars(tag = "kind")]
        $vis enum $of { $(
            $(#[doc = $summary])+
            #[serde(rename = $id)]
            $variant {
                $(
                    #[doc = $motors]
                    $( #[serde(default = $usual_motors)] )?
                    motors: $crate::device::parameters::Motors,
                )?
                $(
                    $(#[doc = $about])+
                    $(#[serde($($serde)*)])?
                    $field: $type,
                )*
                $(
                    #[doc = $crate::shared_text!(only $($only)?)]
                    #[serde(default)]
                    command: Option<u8>,
                )?
                $(
                    #[doc = $crate::shared_text!(chance $($chance)?)]
                    #[serde(default $(= $usual_chance)?)]
                    probability: $crate::device::parameters::Probability,
                )?
                $(
                    #[doc = $crate::shared_text!(most $($most)?)]
                    #[serde(default)]
                    count: Option<u64>,
                )?
                $(
                    #[doc = $crate::shared_text!(way $($way)?)]
                    #[serde(default $(= $usual_way)?)]
                    direction: $crate::device::parameters::Direction,
                )?
                $(
                    #[doc = $crate::shared_text!(on $($on)?)]
                    #[serde(default)]
                    link: $crate::device::parameters::LinkName,
                )?
            },
        )+ }

        impl $crate::device::Kinds for $of {
            const KINDS: &'static [$crate::device::EffectInfo] = &[$( $crate::device::EffectInfo {
                id: $id,
                level: $crate::device::Level::$level,
                parameters: &[
                    $( $crate::device::ParameterInfo {
                        name: "motors",
                        description: $motors,
                        required: {
                            let usual: &[&str] = &[$($usual_motors)?];
                            usual.is_empty()
                        },
                    }, )?
                    $( $crate::device::ParameterInfo {
                        name: stringify!($field),
                        description: concat!($($about),+).trim_ascii_start(),
                        required: {
                            let given: &[&str] = &[$(stringify!($($serde)*),)?];
                            given.is_empty()
                        },
                    }, )*
                    $( $crate::device::ParameterInfo::shared("command", $crate::shared_text!(only $($only)?)), )?
                    $( $crate::device::ParameterInfo::shared("probability", $crate::shared_text!(chance $($chance)?)), )?
                    $( $crate::device::ParameterInfo::shared("count", $crate::shared_text!(most $($most)?)), )?
                    $( $crate::device::ParameterInfo::shared("direction", $crate::shared_text!(way $($way)?)), )?
                    $( $crate::device::ParameterInfo::shared("link", $crate::shared_text!(on $($on)?)), )?
                ],
                client_sees: $sees,
                counts: $counts,
                tries: &[$($($try),+)?],
                lasts: &[$($($lasts),+)?],
                weaker: &[$($($weaker),+)?],
                summary: concat!($($summary),+).trim_ascii_start(),
            } ),+];
        }

        impl $crate::device::Declared for $of {
            fn info(&self) -> &'static $crate::device::EffectInfo {
                let id = match self { $( Self::$variant { .. } => $id, )+ };
                $crate::device::kind_of(<Self as $crate::device::Kinds>::KINDS, id)
            }

            fn scope(&self) -> $crate::device::parameters::Scope {
                match self { $(
                    Self::$variant {
                        $( motors: $crate::name_behind!([$motors] motors), )?
                        $( command: $crate::name_behind!([$($only)?] command), )?
                        $( probability: $crate::name_behind!([$($chance)?] probability), )?
                        $( count: $crate::name_behind!([$($most)?] count), )?
                        $( direction: $crate::name_behind!([$($way)?] direction), )?
                        $( link: $crate::name_behind!([$($on)?] link), )?
                        ..
                    } => $crate::device::parameters::Scope {
                        $( motors: Some(*$crate::name_behind!([$motors] motors)), )?
                        $( command: *$crate::name_behind!([$($only)?] command), )?
                        $( probability: *$crate::name_behind!([$($chance)?] probability), )?
                        $( count: *$crate::name_behind!([$($most)?] count), )?
                        $( direction: *$crate::name_behind!([$($way)?] direction), )?
                        $( link: Some($crate::name_behind!([$($on)?] link).clone()), )?
                        ..Default::default()
                    },
                )+ }
            }
        }
    };
}

/// Declares kinds of actions: a type with a variant for each, read from `operator = …` or
/// `world = …`, a word or a table with one key. The crate needs `serde` and `schemars`.
///
/// ```
/// rigsim_core::actions! {
///     /// What people do to a lamp.
///     pub enum Lamp: Operator {
///         /// Switches it on.
///         On = "on";
///         /// Turns it to the left, degrees.
///         Turn(i16) = "turn";
///     }
/// }
/// ```
#[macro_export]
macro_rules! actions {
    (
        $(#[doc = $of_all:literal])+
        $(#[derive($($derive:ident),+)])?
        $vis:vis enum $of:ident: $level:ident { $(
            $(#[doc = $summary:literal])+
            $(#[schemars($($schemars:tt)*)])?
            $variant:ident $(($type:ty))? = $id:literal
            $(tries [$($try:literal),+])?
            $(weaker [$($weaker:literal),+])?;
        )+ }
    ) => {
        $(#[doc = $of_all])+
        #[derive(Debug, Clone, serde::Deserialize, schemars::JsonSchema)]
        $(#[derive($($derive),+)])?
        $vis enum $of { $(
            $(#[doc = $summary])+
            $(#[schemars($($schemars)*)])?
            #[serde(rename = $id)]
            $variant $(($type))?,
        )+ }

        impl $crate::device::Kinds for $of {
            const KINDS: &'static [$crate::device::EffectInfo] = &[$( $crate::device::EffectInfo {
                id: $id,
                level: $crate::device::Level::$level,
                parameters: &[],
                client_sees: "",
                counts: "It changed something.",
                tries: &[$($($try),+)?],
                lasts: &[],
                weaker: &[$($($weaker),+)?],
                summary: concat!($($summary),+).trim_ascii_start(),
            } ),+];
        }

        impl $crate::device::Declared for $of {
            fn info(&self) -> &'static $crate::device::EffectInfo {
                let id = match self { $( Self::$variant { .. } => $id, )+ };
                $crate::device::kind_of(<Self as $crate::device::Kinds>::KINDS, id)
            }
        }
    };
}
