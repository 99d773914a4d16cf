//! Several files that are read as one, so that each value still knows where it stands.

use rigsim_settings::{Origin, Source};
use toml::Spanned;
use toml::de::{DeTable, DeValue};

use crate::error::{FileError, FileErrorKind, FileErrors};

/// The most errors that are reported of one file; further ones are counted.
pub(crate) const MOST_ERRORS: usize = 20;

/// Where the number of a file is in a place; below it is the place in the file.
const SHIFT: u32 = usize::BITS - 5;

/// Most files that make one.
pub(crate) const MOST_FILES: usize = 16;

/// Files that are read as one, by their numbers.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Sources<'t>(pub &'t [Source<'t>]);

impl<'t> Sources<'t> {
    fn part(&self, at: usize) -> (Source<'t>, usize) {
        let none = Source { file: "", text: "" };
        let source = self.0.get(at >> SHIFT).or(self.0.first());
        (source.copied().unwrap_or(none), at & ((1 << SHIFT) - 1))
    }

    /// Place of something.
    pub(crate) fn place(&self, at: usize) -> Origin {
        let (source, at) = self.part(at);
        source.place(at)
    }

    /// Returns whether a file begins there.
    pub(crate) fn begins_file(&self, at: usize) -> bool {
        self.part(at).1 == 0
    }

    /// The key there.
    pub(crate) fn key_at(&self, at: usize) -> Option<String> {
        let (source, at) = self.part(at);
        source.key_at(at)
    }

    /// The error that says how many more there are.
    pub(crate) fn and_more(&self, count: usize) -> FileError {
        let file = self.0.first().map_or("", |source| source.file).to_owned();
        let kind = FileErrorKind::More(count);
        FileError::at(Some(Origin::Name(file)), kind)
    }

    /// The tables of one of the files.
    pub(crate) fn tables(&self, number: usize) -> Result<DeTable<'t>, FileErrors> {
        let text = self.0.get(number).map_or("", |source| source.text);
        let (table, mut errors) = DeTable::parse_recoverable(text);
        if errors.is_empty() {
            return Ok(numbered_table(table.into_inner(), number << SHIFT));
        }
        let wrong = |error: &toml::de::Error| {
            let at = error.span().map_or(0, |span| span.start);
            let rest = text.get(at..).unwrap_or_default();
            let in_key = |c: char| c.is_ascii_alphanumeric() || c == '_' || c == '-';
            let key = &rest[..rest.find(|c| !in_key(c)).unwrap_or(rest.len())];
            let mut why = error.message().to_owned();
            if !key.is_empty() {
                why += &format!(" `{key}`");
            }
            if text.contains(&format!("[[{key}]]")) {
                why += &format!(
                    "; a list is written either `{key} = [{{ … }}, {{ … }}]` or with `[[{key}]]`"
                );
            }
            let at = at | number << SHIFT;
            FileError {
                key: self.key_at(at),
                ..FileError::at(Some(self.place(at)), FileErrorKind::Syntax(why))
            }
        };
        errors.sort_by_key(|error| error.span().map_or(0, |span| span.start));
        let mut found: Vec<FileError> = errors.iter().take(MOST_ERRORS).map(wrong).collect();
        let more = errors.len() - found.len();
        if more > 0 {
            found.push(self.and_more(more));
        }
        Err(FileErrors(found))
    }
}

fn numbered_table(table: DeTable<'_>, number: usize) -> DeTable<'_> {
    let numbered = |(key, value)| (moved(key, number), numbered(value, number));
    table.into_iter().map(numbered).collect()
}

fn numbered(value: Spanned<DeValue<'_>>, number: usize) -> Spanned<DeValue<'_>> {
    let span = value.span();
    let inside = match value.into_inner() {
        DeValue::Table(table) => DeValue::Table(numbered_table(table, number)),
        DeValue::Array(values) => {
            let values = values.into_iter().map(|value| numbered(value, number));
            DeValue::Array(values.collect())
        }
        plain => plain,
    };
    moved(Spanned::new(span, inside), number)
}

fn moved<T>(value: Spanned<T>, number: usize) -> Spanned<T> {
    let span = value.span();
    Spanned::new(span.start | number..span.end | number, value.into_inner())
}

/// The table with this name in another one.
pub(crate) fn table<'d, 't>(parent: &'d DeTable<'t>, name: &str) -> Option<&'d DeTable<'t>> {
    parent.get(name)?.get_ref().as_table()
}

/// A table of the list with this name.
pub(crate) fn element<'d, 't>(
    parent: &'d DeTable<'t>,
    list: &str,
    index: usize,
) -> Option<&'d DeTable<'t>> {
    let tables = parent.get(list)?.get_ref().as_array()?;
    tables.get(index)?.get_ref().as_table()
}
