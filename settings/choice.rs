//! Settings that are one of a few words.

/// Declares enums whose variants are words in files and flags.
///
/// ```
/// sim_settings::choices! {
///     /// What happens to a request that comes too soon.
///     pub enum OverRate {
///         /// It gets no reply.
///         Silent = "silent",
///         /// It is answered like any other.
///         Answer = "answer",
///     }
/// }
/// assert_eq!(OverRate::Silent.word(), "silent");
/// ```
#[macro_export]
macro_rules! choices {
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
            /// Every choice, in order of declaration.
            pub const ALL: &'static [Self] = &[$( Self::$variant ),+];

            /// The word that stands for it in files and flags.
            #[must_use]
            pub fn word(self) -> &'static str {
                match self { $( Self::$variant => $word ),+ }
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
                    .find(|choice| choice.word() == text)
                    .ok_or_else(|| format!("{value} is not one of the choices"))
            }

            fn show(&self, _unit: &str) -> String {
                format!("\"{}\"", self.word())
            }

            fn allowed(_unit: &str, _bounds: Option<&$crate::Bounds<Self::Bound>>) -> String {
                let words: Vec<String> =
                    Self::ALL.iter().map(|choice| format!("\"{}\"", choice.word())).collect();
                words.join(", ")
            }

            fn schema(
                _unit: &str,
                _bounds: Option<&$crate::Bounds<Self::Bound>>,
            ) -> $crate::private::schemars::Schema {
                let words: Vec<&str> = Self::ALL.iter().map(|choice| choice.word()).collect();
                $crate::private::schemars::json_schema!({"enum": words})
            }
        }
    )+ };
}
