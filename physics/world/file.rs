//! World files: TOML in, [`WorldMap`] out.
//!
//! Coordinates are pairs of plain numbers under keys that end in `_m`; every other quantity is
//! written with its unit, as in `"50 mm"` or `"12 deg"`.

mod document;
mod quantity;

use sim_settings::{Origin, Source, shorten};

use super::map::WorldMap;
use super::obstacle::{MOST_PARTS, ObstacleError};
use document::Document;

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
    fn new(error: &toml::de::Error, source: &Source<'_>) -> Self {
        let at = error.span().map_or(0, |span| span.start);
        Self::at(at, error.message(), source)
    }

    /// `at` is the byte that is to blame.
    fn at(at: usize, why: &str, source: &Source<'_>) -> Self {
        Self {
            origin: source.place(at),
            key: source.key_at(at).map(shorten),
            why: shorten(why.replace('\n', " ")),
        }
    }
}

impl WorldMap {
    /// Reads a world file; `file` is what errors call it.
    ///
    /// # Errors
    /// The first thing that is wrong, with its line, its key and what is allowed there.
    pub fn from_toml(text: &str, file: &str) -> Result<Self, WorldFileError> {
        let source = Source { file, text };
        let document: Document =
            toml::from_str(text).map_err(|error| WorldFileError::new(&error, &source))?;
        let map = document
            .into_map()
            .map_err(|(at, why)| WorldFileError::at(at, &why, &source))?;
        if map.parts() > MOST_PARTS {
            let why = ObstacleError::TooMany.to_string();
            return Err(WorldFileError::at(0, &why, &source));
        }
        Ok(map)
    }

    /// The JSON Schema of world files.
    #[must_use]
    pub fn json_schema() -> String {
        format!("{:#}\n", schemars::schema_for!(Document).as_value())
    }
}

#[cfg(test)]
mod tests;
