//! Collecting what is wrong with files.

use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;

use rigsim_settings::{Origin, ReadError, SettingsError, Wrong};

use crate::error::{FileError, FileErrorKind, FileErrors};
use crate::sources::{MOST_ERRORS, Sources};

/// Problems found so far.
pub(crate) struct Problems<'t> {
    sources: Sources<'t>,
    /// Each with the place by which they are sorted.
    found: Vec<(usize, Found)>,
    /// Where something wrong has been found.
    places: BTreeSet<usize>,
    /// Values that were put in the place of others, by where they stand.
    put: BTreeMap<usize, Put>,
    /// The same of values of which they are only a part.
    put_into: BTreeMap<usize, Put>,
}

/// A problem, whose place is looked up only if it is reported.
enum Found {
    At(usize, FileErrorKind),
    Known(FileError),
}

/// Where a value comes from that stands for a parameter.
#[derive(Debug, Clone)]
pub(crate) enum Put {
    /// A place in the files.
    At(usize),
    /// A flag, as it was written.
    Flag(String),
}

impl<'t> Problems<'t> {
    pub(crate) fn new(sources: Sources<'t>) -> Self {
        Self {
            sources,
            found: Vec::new(),
            places: BTreeSet::new(),
            put: BTreeMap::new(),
            put_into: BTreeMap::new(),
        }
    }

    /// The value that stands at `at` comes from somewhere else, and so does what is wrong with it.
    pub(crate) fn comes_from(&mut self, at: usize, origin: Put) {
        self.put.insert(at, origin);
    }

    /// The value that stands at `at` has something in it that comes from somewhere else.
    pub(crate) fn comes_partly_from(&mut self, at: usize, origin: Put) {
        self.put_into.insert(at, origin);
    }

    /// Something makes no sense at a place of the files.
    pub(crate) fn add(&mut self, at: Range<usize>, why: &str) {
        self.refuse(at.start, FileErrorKind::Sense(why.to_owned()));
    }

    /// What stands at a place has a wrong form.
    pub(crate) fn wrong(&mut self, at: usize, wrong: Wrong) {
        // What is wrong there with what stands for something else cannot be read, either.
        if at == 0 || !self.places.contains(&at) {
            self.refuse(at, FileErrorKind::Form(wrong));
        }
    }

    /// Something is wrong with a file as a whole.
    pub(crate) fn add_to_file(&mut self, why: &str) {
        let kind = FileErrorKind::Sense(why.to_owned());
        let error = FileError::at(Some(self.sources.place(0)), kind);
        self.found.push((0, Found::Known(error)));
    }

    /// A flag is wrong.
    pub(crate) fn add_to_flag(&mut self, flag: String, why: String) {
        let error = FileError::at(Some(Origin::Flag(flag)), FileErrorKind::Sense(why));
        self.found.push((0, Found::Known(error)));
    }

    /// Settings are refused that stand at places or, at 0, in flags.
    pub(crate) fn add_settings(
        &mut self,
        errors: impl IntoIterator<Item = (usize, SettingsError)>,
    ) {
        for (at, error) in errors {
            self.found
                .push((self.order(at), Found::Known(error.into())));
        }
    }

    /// Place by which what is wrong at a place is sorted: that of the value which is to be changed.
    fn order(&self, at: usize) -> usize {
        match self.put.get(&at) {
            Some(Put::At(own)) => *own,
            Some(Put::Flag(_)) => 0,
            None => at,
        }
    }

    /// Origin of what stands at a place.
    pub(crate) fn origin(&self, at: usize) -> Origin {
        match self.put.get(&at) {
            Some(Put::At(own)) => self.sources.place(*own),
            Some(Put::Flag(flag)) => Origin::Flag(flag.clone()),
            None => self.sources.place(at),
        }
    }

    /// The value, or `None` and one problem more.
    pub(crate) fn take<T>(
        &mut self,
        at: Range<usize>,
        result: Result<T, impl ToString>,
    ) -> Option<T> {
        result.map_err(|why| self.add(at, &why.to_string())).ok()
    }

    /// The value, or `None` and one problem more, at the place that the error names or else here.
    pub(crate) fn read<T>(&mut self, at: Range<usize>, result: Result<T, ReadError>) -> Option<T> {
        result
            .map_err(|error| self.wrong(error.at.unwrap_or(at).start, error.why))
            .ok()
    }

    fn refuse(&mut self, at: usize, kind: FileErrorKind) {
        self.places.insert(at);
        self.found.push((self.order(at), Found::At(at, kind)));
    }

    fn error(&self, at: usize, kind: FileErrorKind) -> FileError {
        let (place, key_at, used) = match self.put.get(&at) {
            None => {
                let part = self.put_into.get(&at).map(|put| match put {
                    Put::At(own) => format!("; a part of it is from {}", self.sources.place(*own)),
                    Put::Flag(flag) => format!("; a part of it is from {flag}"),
                });
                (self.sources.place(at), at, part.unwrap_or_default())
            }
            Some(Put::At(own)) => {
                let key = self.sources.key_at(at);
                let key = key.map(|key| format!("`{key}` of ")).unwrap_or_default();
                let used = format!("; it is {key}{}", self.sources.place(at));
                (self.sources.place(*own), *own, used)
            }
            Some(Put::Flag(flag)) => {
                let used = format!("; it is in {}", self.sources.place(at));
                (Origin::Flag(flag.clone()), at, used)
            }
        };
        // A key that the file itself lacks is in no other.
        let is_of_file = matches!(kind, FileErrorKind::Form(Wrong::MissingKey(_)))
            && self.sources.begins_file(key_at);
        FileError {
            place: Some(place),
            key: self.sources.key_at(key_at).filter(|_| !is_of_file),
            kind,
            used,
        }
    }

    /// The errors in the order of the files.
    pub(crate) fn into_error(mut self) -> FileErrors {
        let mut found = std::mem::take(&mut self.found);
        found.sort_by_key(|(order, _)| *order);
        let more = found.len().saturating_sub(MOST_ERRORS);
        let shown = found.into_iter().take(MOST_ERRORS);
        let mut errors: Vec<FileError> = shown
            .map(|(_, found)| match found {
                Found::At(at, kind) => self.error(at, kind),
                Found::Known(error) => error,
            })
            .collect();
        if more > 0 {
            errors.push(self.sources.and_more(more));
        }
        FileErrors(errors)
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.found.is_empty()
    }

    pub(crate) fn into_result(self) -> Result<(), FileErrors> {
        if self.is_empty() {
            Ok(())
        } else {
            Err(self.into_error())
        }
    }
}
