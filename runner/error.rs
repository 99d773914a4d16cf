//! Errors of files.

use std::fmt;

use rigsim_settings::{Origin, SettingsError, Wrong, shorten};

use crate::renamed::{self, Kind};

/// All that is wrong with a file and those that it is based on, in the order of their text.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub struct FileErrors(pub Vec<FileError>);

impl fmt::Display for FileErrors {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let lines: Vec<String> = self.0.iter().map(ToString::to_string).collect();
        f.write_str(&lines.join("\n"))
    }
}

impl From<Vec<SettingsError>> for FileErrors {
    fn from(errors: Vec<SettingsError>) -> Self {
        Self(errors.into_iter().map(FileError::from).collect())
    }
}

/// Something wrong with a file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FileError {
    /// The place to change; `None` where the kind says it, or the file as a whole is meant.
    pub place: Option<Origin>,
    /// The key there, with the tables around it.
    pub key: Option<String>,
    /// What is wrong.
    pub kind: FileErrorKind,
    /// Where what stands at the place is used, if that is elsewhere.
    pub(crate) used: String,
}

/// What is wrong with a file.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub enum FileErrorKind {
    /// It is not TOML; the parser says why.
    Syntax(String),
    /// A value has not the form that belongs there.
    Form(Wrong),
    /// A setting is refused.
    Setting(SettingsError),
    /// A value has the form that belongs there and makes no sense; why.
    Sense(String),
    /// So many more things are wrong.
    More(usize),
}

impl FileError {
    /// Something that is wrong with no place in particular.
    pub(crate) fn general(why: String) -> Self {
        Self::at(None, FileErrorKind::Sense(why))
    }

    pub(crate) fn at(place: Option<Origin>, kind: FileErrorKind) -> Self {
        Self {
            place,
            key: None,
            kind,
            used: String::new(),
        }
    }
}

impl From<SettingsError> for FileError {
    fn from(error: SettingsError) -> Self {
        Self::at(None, FileErrorKind::Setting(error))
    }
}

impl From<FileError> for FileErrors {
    fn from(error: FileError) -> Self {
        Self(vec![error])
    }
}

impl fmt::Display for FileError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(place) = &self.place {
            write!(f, "{place}: ")?;
        }
        if let Some(key) = &self.key {
            write!(f, "`{}`: ", shorten(key.clone()))?;
        }
        match &self.kind {
            FileErrorKind::Form(wrong) => f.write_str(&in_words(wrong))?,
            FileErrorKind::Syntax(why) | FileErrorKind::Sense(why) => {
                f.write_str(&shorten(why.replace('\n', " ")))?;
            }
            FileErrorKind::Setting(error) => f.write_str(&renamed::in_words(error))?,
            FileErrorKind::More(count) => write!(f, "and {count} more")?,
        }
        f.write_str(&self.used)
    }
}

/// An error of a form, which names the new key in the place of a former one.
fn in_words(wrong: &Wrong) -> String {
    if let Wrong::UnknownKey(key, allowed) = wrong {
        let renamed = renamed::find(|kind| matches!(kind, Kind::Key(_)), key);
        if let Some(renamed) = renamed.filter(|renamed| allowed.contains(&renamed.new)) {
            return renamed.to_string();
        }
        if let Some(instead) = renamed::instead(key, allowed) {
            return instead;
        }
    }
    shorten(wrong.to_string().replace('\n', " "))
}
