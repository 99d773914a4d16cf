//! JSON as clients write it: a key that stands twice in an object is an error.

use serde_json::Value;

/// Reads a document that TOML can say as well, in which there is no `null`.
///
/// # Errors
/// When it is not JSON, or an object has a key twice.
pub fn read(text: &[u8]) -> Result<Value, serde_json::Error> {
    // Unlike a map of JSON, a table of TOML takes each key once.
    let value: toml::Value = serde_json::from_slice(text)?;
    serde_json::to_value(value)
}

#[cfg(test)]
mod tests;
