//! The declaration of a group of settings.

/// Declares groups of settings: structs with defaults that files and flags can change.
///
/// ```
/// use std::time::Duration;
/// use rigsim_settings::{Settings, settings};
///
/// settings! {
///     /// The pack.
///     pub struct Pack {
///         /// Charge at the start.
///         initial_soc: f64 = 80.0, unit "%", range 0.0..=100.0, assumed "a typical charge";
///     }
///     /// The module.
///     pub struct Module {
///         /// Silence after which control goes back.
///         timeout: Duration = Duration::from_secs(3),
///             range Duration::from_millis(1)..=Duration::from_secs(3600), documented "4.3.6";
///     }
///     groups {
///         /// Its supply.
///         pack: Pack,
///     }
/// }
/// let entries = Module::default().entries();
/// let keys = entries.iter().map(|entry| entry.key.as_str());
/// assert!(keys.eq(["timeout", "pack.initial_soc"]));
/// ```
#[macro_export]
macro_rules! settings {
    ($(
        $(#[doc = $doc:literal])*
        pub struct $name:ident {
            $(
                $(#[doc = $field_doc:literal])+
                $field:ident : $ty:ty = $default:expr
                $(, unit $unit:literal)?
                $(, range $range:expr)?
                $(, documented $documented:literal)?
                $(, assumed $assumed:literal)?
                ;
            )*
        }
        $(
            groups {
                $( $(#[doc = $group_doc:literal])* $group:ident : $group_ty:ty ),* $(,)?
            }
        )?
    )+) => { $(
        $(#[doc = $doc])*
        #[derive(Debug, Clone, PartialEq)]
        pub struct $name {
            $( $(#[doc = $field_doc])+ pub $field: $ty, )*
            $( $( $(#[doc = $group_doc])* pub $group: $group_ty, )* )?
        }

        impl Default for $name {
            fn default() -> Self {
                Self {
                    $( $field: $default, )*
                    $( $( $group: Default::default(), )* )?
                }
            }
        }

        impl $crate::Settings for $name {
            #[allow(unused_variables, reason = "a group may have no fields")]
            fn list(&self, prefix: &str, entries: &mut Vec<$crate::Entry>) {
                let defaults = Self::default();
                $(
                    let unit = $crate::settings!(@unit $($unit)?);
                    entries.push($crate::Entry {
                        key: $crate::join(prefix, stringify!($field)),
                        doc: concat!($($field_doc, "\n"),+).to_owned(),
                        value: $crate::SettingValue::show(&self.$field, unit),
                        default: $crate::SettingValue::show(&defaults.$field, unit),
                        allowed: <$ty as $crate::SettingValue>::allowed(
                            unit,
                            $crate::settings!(@range $($range)?),
                        ),
                        basis: $crate::settings!(@basis ($($documented)?) ($($assumed)?)),
                    });
                )*
                $( $(
                    $crate::Settings::list(
                        &self.$group,
                        &$crate::join(prefix, stringify!($group)),
                        entries,
                    );
                )* )?
            }

            #[allow(unused_variables, reason = "a group may have no fields")]
            fn assign(&mut self, path: &str, value: &$crate::Value) -> Result<(), $crate::Problem> {
                let (head, rest) = match path.split_once('.') {
                    Some((head, rest)) => (head, Some(rest)),
                    None => (path, None),
                };
                match (head, rest) {
                    $(
                        (stringify!($field), None) => {
                            let unit = $crate::settings!(@unit $($unit)?);
                            let range = $crate::settings!(@range $($range)?);
                            self.$field = $crate::read_in::<$ty>(value, unit, range).map_err(|why| {
                                $crate::Problem::Invalid {
                                    why,
                                    allowed: <$ty as $crate::SettingValue>::allowed(unit, range).words,
                                }
                            })?;
                            Ok(())
                        }
                    )*
                    $( $(
                        (stringify!($group), Some(rest)) => {
                            $crate::Settings::assign(&mut self.$group, rest, value)
                        }
                        (stringify!($group), None) => Err($crate::Problem::IsGroup),
                    )* )?
                    _ => Err($crate::Problem::UnknownKey),
                }
            }
        }
    )+ };
    (@unit) => { "" };
    (@unit $unit:literal) => { $unit };
    (@range) => { None };
    (@range $range:expr) => { Some(&$range) };
    (@basis ($source:literal) ()) => { $crate::Basis::Documented($source) };
    (@basis () ($source:literal)) => { $crate::Basis::Assumed($source) };
}
