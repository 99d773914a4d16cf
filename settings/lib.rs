//! Time, quantities with units, and named settings.
//!
//! Every number that a user may change is declared once, with its default, its unit, its range
//! and the reason we believe it, in a [`settings!`] block beside the code that uses it. From that
//! one declaration come the struct, `--set`, `--config`, and `sim config`.
//!
//! A setting is either *documented* (the manual says so) or *assumed* (we decided); [`Basis`]
//! carries which, and where it comes from, so that the two are never mixed up.

#![warn(clippy::disallowed_methods, clippy::disallowed_types)]

mod choice;
mod document;
mod error;
mod key;
mod line;
mod macros;
mod quantity;
mod read;
mod time;
mod value;
mod written;

pub use choice::Words;
pub use document::{
    Source, apply_table, load_toml, nearest, parse_assignment, schema_of, set, show_entry,
    show_toml,
};
pub use error::{Origin, SettingsError, shorten};
pub use line::ClientLine;
pub use quantity::parse_quantity;
pub use read::{Part, ReadError, Reader, Wrong, or_allowed, read};
pub use time::{SimTime, show_duration, show_rounded};
pub use value::{Allowed, Bounds, SettingValue, Value, read_in};
pub use written::{
    Angle, Force, Frequency, Friction, Length, Mass, Percent, Power, Resistance, Span, Speed,
    Torque, Voltage, Written, private,
};

/// Basis of a default.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Basis {
    /// The manual says so; the text names the place.
    Documented(&'static str),
    /// The manual is silent and we decided; the text says on what ground.
    Assumed(&'static str),
}

impl Basis {
    /// `documented` or `assumed`.
    #[must_use]
    pub fn as_str(&self) -> &'static str {
        match self {
            Self::Documented(_) => "documented",
            Self::Assumed(_) => "assumed",
        }
    }

    /// Where the manual says so, or the ground of the assumption.
    #[must_use]
    pub fn source(&self) -> &'static str {
        match self {
            Self::Documented(source) | Self::Assumed(source) => source,
        }
    }
}

/// One setting as it stands.
#[derive(Debug, Clone)]
pub struct Entry {
    /// Full dotted key, such as `r150.heartbeat_timeout`.
    pub key: String,
    /// Meaning, in the words of its documentation comment.
    pub doc: String,
    /// The effective value as a TOML literal.
    pub value: String,
    /// The default as a TOML literal.
    pub default: String,
    /// The allowed values.
    pub allowed: Allowed,
    /// Documented behaviour or our assumption.
    pub basis: Basis,
}

/// Error of an attempt to set one key.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub enum Problem {
    /// No setting has this name.
    UnknownKey,
    /// The name is that of a group, which has no value itself.
    IsGroup,
    /// The value is not one of those allowed.
    Invalid {
        /// Reason.
        why: String,
        /// The allowed values in words.
        allowed: String,
    },
}

/// A tree of settings, as [`settings!`] declares it.
pub trait Settings {
    /// Adds every setting to `entries`, in order of declaration; `prefix` goes before each key.
    fn list(&self, prefix: &str, entries: &mut Vec<Entry>);

    /// Sets the one at `path` (dotted, relative to this tree).
    ///
    /// # Errors
    /// Says what is wrong with the key or the value; nothing has changed then.
    fn assign(&mut self, path: &str, value: &Value) -> Result<(), Problem>;

    /// Every setting, in order of declaration.
    fn entries(&self) -> Vec<Entry> {
        let mut entries = Vec::new();
        self.list("", &mut entries);
        entries
    }
}

/// Puts a group's key before a name in it; the root's key is empty.
#[must_use]
pub fn join(prefix: &str, name: &str) -> String {
    if prefix.is_empty() {
        name.to_owned()
    } else {
        format!("{prefix}.{name}")
    }
}

#[cfg(test)]
mod tests;
