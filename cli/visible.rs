//! Text that others wrote, made safe to show: titles, messages, names of files, what clients print.
//!
//! A terminal obeys some characters, an XML document may not hold some, and some make text look
//! like another. All of those are shown as escapes. Everything that is printed or goes into a
//! document for people passes here.

use std::borrow::Cow;
use std::ffi::OsStr;
use std::fmt::Write as _;
use std::os::unix::ffi::OsStrExt as _;
use std::path::Path;

/// Text of any number of lines: line feeds and tabs stay.
pub(crate) fn lines(text: &str) -> Cow<'_, str> {
    escaped(text, |c| is_unsafe(c) && !matches!(c, '\n' | '\t'))
}

/// Text that is to stay on its line.
pub(crate) fn line(text: &str) -> Cow<'_, str> {
    escaped(text, is_unsafe)
}

/// The name of a file or a word of a command, whatever its bytes are; no two look the same, but for
/// those that have backslashes in them.
pub(crate) fn name<N: AsRef<OsStr> + ?Sized>(name: &N) -> String {
    valid(name.as_ref().as_bytes(), line)
}

/// Bytes as text, with non-printable bytes escaped. Control characters of terminals stay as they are.
pub(crate) fn bytes(bytes: &[u8]) -> String {
    valid(bytes, |text| Cow::Borrowed(text))
}

fn valid(bytes: &[u8], shown: impl Fn(&str) -> Cow<'_, str>) -> String {
    let mut text = String::new();
    for chunk in bytes.utf8_chunks() {
        text += &shown(chunk.valid());
        for byte in chunk.invalid() {
            // Writing to a string cannot fail.
            let _ = write!(text, "\\x{byte:02x}");
        }
    }
    text
}

/// A JSON document on one line, in which these characters are escaped as JSON does it.
pub(crate) fn json(value: &serde_json::Value) -> String {
    let text = value.to_string();
    let mut safe = String::with_capacity(text.len());
    for c in text.chars() {
        if is_unsafe(c) {
            for unit in c.encode_utf16(&mut [0; 2]) {
                let _ = write!(safe, "\\u{unit:04x}");
            }
        } else {
            safe.push(c);
        }
    }
    safe
}

/// A path as a document for programs has it: valid text, with U+FFFD for what is none.
pub(crate) fn path_value(path: &Path) -> String {
    path.to_string_lossy().into_owned()
}

/// A command that a shell takes apart into these words again, in characters that can be shown. What
/// cannot is written as `$'…'`, which POSIX and all usual shells know.
pub(crate) fn command<'w>(words: impl IntoIterator<Item = &'w OsStr>) -> String {
    let quoted: Vec<String> = words.into_iter().map(quoted).collect();
    quoted.join(" ")
}

fn quoted(word: &OsStr) -> String {
    let plain = word
        .to_str()
        .filter(|text| !text.contains(is_unsafe))
        .and_then(|text| shlex::try_quote(text).ok());
    if let Some(plain) = plain {
        return plain.into_owned();
    }
    let mut text = "$'".to_owned();
    for &byte in word.as_bytes() {
        match byte {
            b'\\' | b'\'' => {
                text.push('\\');
                text.push(byte.into());
            }
            b' '..=b'~' => text.push(byte.into()),
            // Octal has three digits at most, so that no character after it is taken for one more.
            _ => {
                let _ = write!(text, "\\{byte:03o}");
            }
        }
    }
    text + "'"
}

fn escaped(text: &str, is_escaped: impl Fn(char) -> bool) -> Cow<'_, str> {
    if !text.contains(&is_escaped) {
        return Cow::Borrowed(text);
    }
    let mut safe = String::with_capacity(text.len() + 16);
    for c in text.chars() {
        if is_escaped(c) {
            safe.extend(c.escape_default());
        } else {
            safe.push(c);
        }
    }
    Cow::Owned(safe)
}

/// Returns whether a terminal may obey it, XML forbids it, or it hides or turns around what is beside
/// it.
fn is_unsafe(c: char) -> bool {
    c.is_control()
        || matches!(
            c,
            '\u{061c}'
                | '\u{200b}'..='\u{200f}'
                | '\u{2028}'..='\u{202e}'
                | '\u{2060}'..='\u{206f}'
                | '\u{feff}'
                | '\u{fff9}'..='\u{fffb}'
                | '\u{fffe}'
                | '\u{ffff}'
                | '\u{e0000}'..='\u{e007f}'
        )
}

#[cfg(test)]
mod tests;
