//! Errors of world files.

use sim_settings::{Origin, Source, shorten};

/// A world file that was refused.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{origin}: {}{why}", key.as_ref().map(|key| format!("`{key}`: ")).unwrap_or_default())]
pub struct WorldFileError {
    /// File, line and column.
    pub origin: Origin,
    /// The key with the tables around it; `None` where the file is not TOML at all.
    pub key: Option<String>,
    /// Reason, and what is allowed.
    pub why: String,
}

impl WorldFileError {
    pub(super) fn new(error: &toml::de::Error, source: &Source<'_>) -> Self {
        let at = error.span().map_or(0, |span| span.start);
        Self::at(at, error.message(), source)
    }

    /// `at` is the byte that is to blame.
    pub(super) fn at(at: usize, why: &str, source: &Source<'_>) -> Self {
        Self {
            origin: source.place(at),
            key: source.key_at(at).map(shorten),
            why: shorten(why.replace('\n', " ")),
        }
    }
}
