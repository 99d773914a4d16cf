//! Settings that are one of a few words.

/// Declares enums whose variants are words.
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

/// Declares [words](crate::words) that settings may have.
///
/// ```
/// rigsim_settings::choices! {
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
macro_rules! choices {
    ($(
        $(#[$meta:meta])*
        $vis:vis enum $name:ident {
            $( $(#[$variant_meta:meta])* $variant:ident = $word:literal ),+ $(,)?
        }
    )+) => { $(
        $crate::words! {
            $(#[$meta])*
            $vis enum $name {
                $( $(#[$variant_meta])* $variant = $word ),+
            }
        }

        impl $crate::SettingValue for $name {
            type Bound = std::convert::Infallible;

            fn read(value: &$crate::Value, _unit: &str) -> Result<Self, String> {
                // `--set key=false` arrives as a boolean, which may be meant as the word.
                let text = match value {
                    $crate::Value::Text(text) => text.clone(),
                    $crate::Value::Bool(flag) => flag.to_string(),
                    other => return Err(format!("{other} is not a word")),
                };
                Self::ALL
                    .iter()
                    .copied()
                    .find(|choice| choice.as_str() == text)
                    .ok_or_else(|| format!("{value} is not one of the choices"))
            }

            fn show(&self, _unit: &str) -> String {
                format!("\"{}\"", self.as_str())
            }

            fn allowed(
                _unit: &str,
                _bounds: Option<&$crate::Bounds<Self::Bound>>,
            ) -> $crate::Allowed {
                let words = Self::ALL.map(|choice| choice.as_str());
                let quoted = words.map(|word| format!("\"{word}\""));
                let schema = $crate::private::schemars::json_schema!({"enum": words.to_vec()});
                $crate::Allowed::any(quoted.join(", "), schema)
            }
        }
    )+ };
}
