//! The macros that declare effects: types, schema and documentation from one entry.

use super::effect::EffectInfo;

/// Finds a kind by its id, which is one of these.
#[doc(hidden)]
#[must_use]
pub fn kind_of(kinds: &'static [EffectInfo], id: &str) -> &'static EffectInfo {
    let found = kinds.iter().find(|kind| kind.id == id);
    found.unwrap_or(&kinds[0])
}

/// Its second argument.
#[doc(hidden)]
#[macro_export]
macro_rules! second {
    ($first:literal $second:ident) => {
        $second
    };
}

/// Declares kinds of faults: a type with a variant for each, read from `fault = { kind = … }`.
///
/// A parameter without `#[serde(…)]` must be given. Parameters that many faults take follow the
/// braces, each with its description and, where they differ, its default: `motors`, `only` replies
/// to some command, `chance`, `most` times, `way` and link (`on`). Together they are its
/// [`Scope`](crate::device::parameters::Scope). The crate needs `serde` and `schemars`.
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
            $(only $only:literal)?
            $(chance $chance:literal $usual_chance:literal)?
            $(most $most:literal)?
            $(way $way:literal $usual_way:literal)?
            $(on $on:literal)?
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
                    #[doc = $only]
                    #[serde(default)]
                    command: Option<u8>,
                )?
                $(
                    #[doc = $chance]
                    #[serde(default = $usual_chance)]
                    probability: $crate::device::parameters::Probability,
                )?
                $(
                    #[doc = $most]
                    #[serde(default)]
                    count: Option<u64>,
                )?
                $(
                    #[doc = $way]
                    #[serde(default = $usual_way)]
                    direction: $crate::device::parameters::Direction,
                )?
                $(
                    #[doc = $on]
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
                    $( $crate::device::ParameterInfo::shared("command", $only), )?
                    $( $crate::device::ParameterInfo::shared("probability", $chance), )?
                    $( $crate::device::ParameterInfo::shared("count", $most), )?
                    $( $crate::device::ParameterInfo::shared("direction", $way), )?
                    $( $crate::device::ParameterInfo::shared("link", $on), )?
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

            #[allow(unused_mut, reason = "some declarations have no such parameter")]
            fn scope(&self) -> $crate::device::parameters::Scope {
                let mut scope = $crate::device::parameters::Scope::default();
                match self { $(
                    Self::$variant {
                        $( motors: $crate::second!($motors motors), )?
                        $( command: $crate::second!($only command), )?
                        $( probability: $crate::second!($chance probability), )?
                        $( count: $crate::second!($most count), )?
                        $( direction: $crate::second!($way direction), )?
                        $( link: $crate::second!($on link), )?
                        ..
                    } => {
                        $( scope.motors = Some(*$crate::second!($motors motors)); )?
                        $( scope.command = *$crate::second!($only command); )?
                        $( scope.probability = *$crate::second!($chance probability); )?
                        $( scope.count = *$crate::second!($most count); )?
                        $( scope.direction = *$crate::second!($way direction); )?
                        $( scope.link = Some($crate::second!($on link).clone()); )?
                    }
                )+ }
                scope
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
