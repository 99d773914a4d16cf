//! Settings that are one of a few words.

use std::convert::Infallible;

use schemars::json_schema;

use crate::value::{Allowed, Bounds, SettingValue, Value};

/// Declares enums whose variants are words, as settings may have them.
///
/// ```
/// rigsim_settings::words! {
///     /// What happens to a request that comes too soon.
///     pub enum OverRate {
///         /// It gets no reply.
///         Silent = "silent",
///         /// It is answered like any other.
///         Answer = "answer",
///     }
/// }
/// assert_eq!(OverRate::Silent.as_str(), "silent");
/// ```
#[macro_export]
macro_rules! words {
    ($(
        $(#[$meta:meta])*
        $vis:vis enum $name:ident {
            $( $(#[$variant_meta:meta])* $variant:ident = $word:literal ),+ $(,)?
        }
    )+) => { $(
        $(#[$meta])*
        #[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
        $vis enum $name {
            $( $(#[$variant_meta])* $variant ),+
        }

        impl $name {
            /// All, in order of declaration.
            pub const ALL: [Self; [$( Self::$variant ),+].len()] = [$( Self::$variant ),+];

            /// Its place among all, for arrays with an element for each.
            #[allow(dead_code, reason = "not every one has arrays")]
            #[must_use]
            pub const fn index(self) -> usize {
                self as usize
            }

            /// The word that stands for it.
            #[must_use]
            pub const fn as_str(self) -> &'static str {
                match self { $( Self::$variant => $word ),+ }
            }
        }

        impl $crate::Words for $name {
            const WORDS: &'static [Self] = &Self::ALL;

            fn word(self) -> &'static str {
                self.as_str()
            }
        }

        impl std::fmt::Display for $name {
            fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                f.write_str(self.as_str())
            }
        }
    )+ };
}

/// Declares [words](crate::words) that files have. The crate needs `serde` and `schemars`.
#[macro_export]
macro_rules! file_words {
    ($(
        $(#[$meta:meta])*
        $vis:vis enum $name:ident {
            $( $(#[$variant_meta:meta])* $variant:ident = $word:literal ),+ $(,)?
        }
    )+) => {
        $crate::words! { $(
            $(#[$meta])*
            #[derive(serde::Deserialize, schemars::JsonSchema)]
            $vis enum $name {
                $( $(#[$variant_meta])* #[serde(rename = $word)] $variant = $word ),+
            }
        )+ }
    };
}

/// An enum that [`words!`](crate::words) has declared.
pub trait Words: Copy + 'static {
    /// All, in order of declaration.
    const WORDS: &'static [Self];

    /// The word that stands for it.
    fn word(self) -> &'static str;
}

impl<T: Words> SettingValue for T {
    type Bound = Infallible;

    fn read(value: &Value, _unit: &str) -> Result<Self, String> {
        // `--set key=false` arrives as a boolean, which may be meant as the word.
        let text = match value {
            Value::Text(text) => text.clone(),
            Value::Bool(flag) => flag.to_string(),
            other => return Err(format!("{other} is not a word")),
        };
        let mut words = Self::WORDS.iter().copied();
        words
            .find(|choice| choice.word() == text)
            .ok_or_else(|| format!("{value} is not one of the choices"))
    }

    fn show(&self, _unit: &str) -> String {
        format!("\"{}\"", self.word())
    }

    fn allowed(_unit: &str, _bounds: Option<&Bounds<Infallible>>) -> Allowed {
        let quoted: Vec<String> = Self::WORDS.iter().map(|choice| choice.show("")).collect();
        let words: Vec<&str> = Self::WORDS.iter().map(|choice| choice.word()).collect();
        Allowed::any(quoted.join(", "), json_schema!({ "enum": words }))
    }
}
