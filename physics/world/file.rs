//! World files: TOML in, [`WorldMap`] out.
//!
//! Coordinates are pairs of plain numbers under keys that end in `_m`; every other quantity is
//! written with its unit, as in `"50 mm"` or `"12 deg"`.

mod document;
mod error;
mod quantity;

pub use error::WorldFileError;

use super::map::WorldMap;
use document::Document;

impl WorldMap {
    /// Reads a world file; `file` is what errors call it.
    ///
    /// # Errors
    /// The first thing that is wrong, with its line, its key and what is allowed there.
    pub fn from_toml(text: &str, file: &str) -> Result<Self, WorldFileError> {
        toml::from_str::<Document>(text)
            .map(Document::into_map)
            .map_err(|error| WorldFileError::new(&error, text, file))
    }

    /// The JSON Schema of world files.
    #[must_use]
    pub fn json_schema() -> String {
        format!("{:#}\n", schemars::schema_for!(Document).as_value())
    }
}

#[cfg(test)]
mod tests;
