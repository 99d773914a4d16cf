//! Errors of settings.

use std::fmt;

/// Origin of a value.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub enum Origin {
    /// A place in a file; line and column count from 1.
    File {
        /// The file's name as the user gave it.
        file: String,
        /// Line of the key or value.
        line: usize,
        /// Column in characters.
        column: usize,
    },
    /// A file as a whole, by its name.
    Name(String),
    /// A command-line flag, as the user wrote it.
    Flag(String),
}

impl fmt::Display for Origin {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::File { file, line, column } => write!(f, "{file}:{line}:{column}"),
            Self::Name(file) => f.write_str(file),
            Self::Flag(flag) => f.write_str(&shorten(flag.clone())),
        }
    }
}

/// Most characters that an error repeats of a file or a flag.
const MOST_REPEATED: usize = 400;

/// The beginning of `text`, if it is too long to be repeated in an error.
#[must_use]
pub fn shorten(text: String) -> String {
    match text.char_indices().nth(MOST_REPEATED) {
        Some((at, _)) => format!("{}… ({} bytes)", &text[..at], text.len()),
        None => text,
    }
}

/// A setting or a settings file that was refused.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum SettingsError {
    /// The file is not TOML.
    #[error("{origin}: {why}")]
    Syntax {
        /// Where it stands.
        origin: Origin,
        /// Reason in the parser's words.
        why: String,
    },
    /// The flag is not of the form `KEY=VALUE`.
    #[error("{origin}: write it as KEY=VALUE, as in --set r150.heartbeat_timeout=5s")]
    NotAnAssignment {
        /// Where it stands.
        origin: Origin,
    },
    /// No setting has this name.
    #[error("{origin}: no setting is named `{key}`{}; `sim config` lists them all",
        nearest.as_ref().map(|near| format!(", did you mean `{near}`?")).unwrap_or_default())]
    UnknownKey {
        /// Where it stands.
        origin: Origin,
        /// The key as written.
        key: String,
        /// The existing key most like it.
        nearest: Option<String>,
    },
    /// The name is that of a group.
    #[error(
        "{origin}: `{key}` is a group of settings, not a setting: name one in it, as in `{example}`"
    )]
    IsGroup {
        /// Where it stands.
        origin: Origin,
        /// The key as written.
        key: String,
        /// A setting in that group.
        example: String,
    },
    /// The value is not allowed.
    #[error("{origin}: `{key}`: {why}; allowed: {allowed}")]
    Invalid {
        /// Where it stands.
        origin: Origin,
        /// The full key.
        key: String,
        /// Reason.
        why: String,
        /// The allowed values in words.
        allowed: String,
    },
}
