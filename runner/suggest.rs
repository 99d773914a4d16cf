//! Finding what a misspelt word may have meant.

/// One wrong letter of three is just a little more like than this.
const LIKE_ENOUGH: f64 = 0.79;

/// The one most like `word`, if any is like it at all.
pub(crate) fn nearest<S: AsRef<str>>(word: &str, known: impl IntoIterator<Item = S>) -> Option<S> {
    let mut best: Option<(f64, S)> = None;
    for candidate in known {
        let text = candidate.as_ref();
        // A forgotten group in front is as common as a misspelling.
        let likeness = if text.ends_with(&format!(".{word}")) {
            1.0
        } else {
            strsim::jaro_winkler(text, word)
        };
        if likeness > LIKE_ENOUGH && best.as_ref().is_none_or(|(found, _)| likeness > *found) {
            best = Some((likeness, candidate));
        }
    }
    best.map(|(_, candidate)| candidate)
}

/// `did you mean …?` and what is allowed, if anything is.
pub(crate) fn or_allowed(word: &str, allowed: &[&str]) -> String {
    if allowed.is_empty() {
        return "there is none".to_owned();
    }
    let list = allowed.join(", ");
    nearest(word, allowed).map_or_else(
        || format!("allowed: {list}"),
        |near| format!("did you mean `{near}`? allowed: {list}"),
    )
}

/// Words of the TOML reader for its own types, and their meaning in a file.
const PLAIN: [(&str, &str); 11] = [
    ("` as i128,", "`,"),
    (
        "invalid type: map, expected a sequence",
        "a list belongs here, also of one: `[{ … }]` instead of `{ … }`",
    ),
    (
        "invalid type: unit variant, expected newtype variant",
        "a value belongs to it: `{ name = … }` instead of `\"name\"`",
    ),
    ("expected u8", "expected a whole number from 0 to 255"),
    (
        "expected i16",
        "expected a whole number from -32768 to 32767",
    ),
    ("expected u16", "expected a whole number from 0 to 65535"),
    (
        "expected u32",
        "expected a whole number from 0 to 4294967295",
    ),
    ("expected i32", "expected a whole number"),
    ("expected u64", "expected a whole number, 0 or more"),
    ("expected usize", "expected a whole number, 0 or more"),
    ("expected f64", "expected a number"),
];

/// An error of the TOML reader without the names of our types.
pub(crate) fn plain(message: &str) -> String {
    let mut plain = message.to_owned();
    for (said, meant) in PLAIN {
        let ends = plain.split_once(said).map(|(_, rest)| rest);
        // `expected u8` is not the beginning of something longer.
        if ends.is_some_and(|rest| !rest.starts_with(|c: char| c.is_ascii_alphanumeric())) {
            plain = plain.replacen(said, meant, 1);
        }
    }
    let Some((before, rest)) = plain.split_once("expected struct ") else {
        return plain;
    };
    let rest = rest.trim_start_matches(|c: char| c.is_ascii_alphanumeric());
    format!("{before}expected a table, `{{ … }}`{rest}")
}

/// Adds to an error of the TOML reader what a misspelt field or word may have meant.
pub(crate) fn improve(message: &str) -> String {
    let Some(at) = message
        .find("unknown field `")
        .or_else(|| message.find("unknown variant `"))
    else {
        return message.to_owned();
    };
    let mut words = message[at..].split('`').skip(1).step_by(2);
    let near = words.next().and_then(|word| nearest(word, words));
    near.map_or_else(
        || message.to_owned(),
        |near| format!("{message}; did you mean `{near}`?"),
    )
}
