//! Collecting what is wrong with files.

use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;

use sim_settings::Origin;

use crate::rig_file::RigFileError;
use crate::sources::Sources;

/// The most errors that are told of one file; further ones are counted.
pub(crate) const MOST_ERRORS: usize = 20;

/// Problems found so far.
pub(crate) struct Problems<'t> {
    sources: Sources<'t>,
    /// Each with the place by which they are sorted.
    lines: Vec<(usize, String)>,
    /// Where something that cannot be read has been told.
    told: BTreeSet<usize>,
    /// Values that were put in the place of others, by where they stand.
    put: BTreeMap<usize, Put>,
    /// The same of values of which they are only a part.
    put_into: BTreeMap<usize, Put>,
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
            lines: Vec::new(),
            told: BTreeSet::new(),
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

    /// Something is wrong at a place of the files.
    pub(crate) fn add(&mut self, at: Range<usize>, why: &str) {
        self.refuse(at.start, |sources, at| sources.wrong(at, why));
    }

    /// Something is wrong with a file as a whole.
    pub(crate) fn add_to_file(&mut self, why: &str) {
        let line = format!("{}: {why}", self.sources.place(0));
        self.lines.push((0, line));
    }

    /// Lines that name their places by themselves.
    pub(crate) fn add_all(&mut self, lines: impl IntoIterator<Item = (usize, String)>) {
        for (at, line) in lines {
            self.lines.push((self.order(at), line));
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

    /// The value, or `None` and one problem more, at the place that the reader's error names or
    /// else here.
    pub(crate) fn read<T>(
        &mut self,
        at: Range<usize>,
        result: Result<T, toml::de::Error>,
    ) -> Option<T> {
        result
            .map_err(|error| {
                let own = error.span().filter(|span| *span != (0..0));
                self.syntax(own.map_or(at.start, |span| span.start), &error);
            })
            .ok()
    }

    /// An error of the TOML reader about what stands at a place.
    pub(crate) fn syntax(&mut self, at: usize, error: &toml::de::Error) {
        // What is wrong there with what stands for something else cannot be read, either.
        if at == 0 || !self.told.contains(&at) {
            self.refuse(at, |sources, at| sources.syntax(at, error));
        }
    }

    fn refuse(&mut self, at: usize, line: impl FnOnce(Sources<'_>, usize) -> String) {
        self.told.insert(at);
        let sources = self.sources;
        let stands = || {
            let key = sources.key_at(at).map(|key| format!("`{key}` of "));
            format!("{}{}", key.unwrap_or_default(), sources.place(at))
        };
        let text = match self.put.get(&at) {
            None => {
                let part = self.put_into.get(&at).map(|put| match put {
                    Put::At(own) => format!("; a part of it is from {}", sources.place(*own)),
                    Put::Flag(flag) => format!("; a part of it is from {flag}"),
                });
                line(sources, at) + &part.unwrap_or_default()
            }
            Some(Put::At(own)) => format!("{}; it is {}", line(sources, *own), stands()),
            Some(Put::Flag(flag)) => {
                let line = line(sources, at);
                let why = line.strip_prefix(&format!("{}: ", sources.place(at)));
                format!(
                    "{flag}: {}; it is in {}",
                    why.unwrap_or(&line),
                    sources.place(at)
                )
            }
        };
        self.lines.push((self.order(at), text));
    }

    /// The errors in the order of the files.
    pub(crate) fn into_error(self) -> RigFileError {
        let mut lines = self.lines;
        lines.sort_by_key(|(at, _)| *at);
        let more = lines.len().saturating_sub(MOST_ERRORS);
        let shown = lines.into_iter().take(MOST_ERRORS).map(|(_, line)| line);
        let more = (more > 0).then(|| format!("{}: and {more} more", self.sources.name()));
        RigFileError(shown.chain(more).collect())
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.lines.is_empty()
    }

    pub(crate) fn into_result(self) -> Result<(), RigFileError> {
        if self.is_empty() {
            Ok(())
        } else {
            Err(self.into_error())
        }
    }
}
