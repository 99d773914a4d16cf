use super::*;
use std::process::Command;

#[test]
fn what_a_terminal_obeys_is_shown_and_the_rest_stays() {
    assert_eq!(lines("a\u{1b}]0;x\u{7}\n\tb"), "a\\u{1b}]0;x\\u{7}\n\tb");
    assert_eq!(line("a\nb\r\u{9b}2J"), "a\\nb\\r\\u{9b}2J");
    assert_eq!(
        line("\u{202e}\u{fffe}\u{ffff}"),
        "\\u{202e}\\u{fffe}\\u{ffff}"
    );
    let plain = "Größe 漢字 🚗 é \u{fffd}";
    assert!(matches!(lines(plain), Cow::Borrowed(text) if text == plain));
    assert_eq!(name(OsStr::from_bytes(b"a\xff\xc3\xa9\n")), "a\\xffé\\n");
}

#[test]
fn json_says_the_same_with_escapes() {
    let text = "a\u{9b}2J\u{202e}\u{e0041}\u{1b}\n\"é";
    let value = serde_json::json!({ "a": text });
    let shown = json(&value);
    assert!(!shown.contains(is_unsafe), "{shown}");
    assert_eq!(
        serde_json::from_str::<serde_json::Value>(&shown).unwrap(),
        value
    );
}

#[test]
fn a_shell_reads_the_same_words_from_a_command() {
    let words: [&[u8]; 6] = [
        b"plain",
        b"two words",
        b"it's \"$HOME\" `x` \\",
        b"\xff\n'\\1",
        b"",
        "\u{1b}[2Jé7".as_bytes(),
    ];
    let shown = command(words.map(OsStr::from_bytes));
    assert!(!shown.contains(is_unsafe), "{shown}");
    let script = format!("printf '%s\\0' {shown}");
    let output = Command::new("bash").args(["-c", &script]).output().unwrap();
    let read: Vec<&[u8]> = output.stdout.split(|byte| *byte == 0).collect();
    assert_eq!(read[..words.len()], words);
}
