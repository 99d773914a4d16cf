//! Several files that are read as one, so that each value still knows where it stands.

use sim_settings::{Origin, Source, shorten};
use toml::Spanned;
use toml::de::{DeTable, DeValue};

use crate::problems::MOST_ERRORS;
use crate::rig_file::RigFileError;
use crate::suggest::{improve, plain};

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

    /// The key there.
    pub(crate) fn key_at(&self, at: usize) -> Option<String> {
        let (source, at) = self.part(at);
        source.key_at(at)
    }

    /// A line about something that is wrong there.
    pub(crate) fn wrong(&self, at: usize, why: &str) -> String {
        let key = self.key_at(at);
        // Who knows the end of the key by itself says it, too.
        let own = why.strip_prefix('`').and_then(|why| why.split_once("`: "));
        let own = own.filter(|(own, _)| key.as_ref().is_some_and(|key| key.ends_with(own)));
        let why = shorten(own.map_or(why, |(_, why)| why).replace('\n', " "));
        let key = key.map(|key| format!("`{}`: ", shorten(key)));
        format!("{}: {}{why}", self.place(at), key.unwrap_or_default())
    }

    /// The same error of the TOML reader about what is there, with its place and key.
    pub(crate) fn syntax(&self, at: usize, error: &toml::de::Error) -> String {
        let message = plain(&error.message().replace('\n', " "));
        let improved = improve(&message);
        // What it may have meant must not be cut off with the rest of a long list.
        let hint = improved.strip_prefix(&message).unwrap_or_default();
        self.wrong(at, &message) + hint
    }

    /// Name of the first of the files.
    pub(crate) fn name(&self) -> &'t str {
        self.0.first().map_or("", |source| source.file)
    }

    /// The tables of one of the files.
    pub(crate) fn tables(&self, number: usize) -> Result<DeTable<'t>, RigFileError> {
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
            let twice = match text.contains(&format!("[[{key}]]")) {
                true => format!(
                    "duplicate key `{key}`; a list is written either `{key} = [{{ … }}, {{ … }}]` or \
                     with `[[{key}]]`"
                ),
                false => format!("duplicate key `{key}`"),
            };
            let message = error.message().replace("duplicate key", &twice);
            self.wrong(at | number << SHIFT, &message)
        };
        errors.sort_by_key(|error| error.span().map_or(0, |span| span.start));
        let lines = errors.iter().take(MOST_ERRORS).map(wrong).collect();
        Err(RigFileError(lines))
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
