//! World files: TOML in, [`WorldMap`] out.
//!
//! Coordinates are pairs of plain numbers under keys that end in `_m`; every other quantity is
//! written with its unit, as in `"50 mm"` or `"12 deg"`.

mod document;
mod quantity;

use std::ops::Range;

use rigsim_settings::{Origin, Source, Wrong, read, shorten};
use serde::{Deserialize, Deserializer};
use toml::Spanned;
use toml::de::{DeTable, DeValue};

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
    /// `at` is the byte that is wrong.
    fn at(at: usize, why: &str, source: &Source<'_>) -> Self {
        Self {
            origin: source.place(at),
            key: source.key_at(at).map(shorten),
            why: shorten(why.replace('\n', " ")),
        }
    }
}

/// What stands in a world, in the form of a world file, which need not say its version.
impl<'de> Deserialize<'de> for WorldMap {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let document = Document::deserialize(deserializer)?;
        document
            .into_map()
            .map_err(|(_, why)| serde::de::Error::custom(why))
    }
}

impl WorldMap {
    /// Reads a world file; `file` is what errors call it.
    ///
    /// # Errors
    /// The first thing that is wrong, with its line, its key and what is allowed there.
    pub fn from_toml(text: &str, file: &str) -> Result<Self, WorldFileError> {
        let source = Source { file, text };
        let wrong = |at: Option<Range<usize>>, why: &str| {
            WorldFileError::at(at.map_or(0, |at| at.start), why, &source)
        };
        let table = DeTable::parse(text).map_err(|error| wrong(error.span(), error.message()))?;
        let table = Spanned::new(0..0, DeValue::Table(table.into_inner()));
        let document: Document =
            read(&table).map_err(|error| wrong(error.at.clone(), &error.to_string()))?;
        if document.schema.is_none() {
            let why = Wrong::MissingKey("schema".to_owned()).to_string();
            return Err(wrong(None, &why));
        }
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
