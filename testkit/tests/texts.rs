//! Files as they are shipped, with something wrong in them, and files as no user writes them.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::path::Path;

use rigsim_testkit::text;

/// Numbers in the place of others.
const NUMBERS: &[&str] = &[
    "nan",
    "inf",
    "-inf",
    "0",
    "-1",
    "1e308",
    "1e-320",
    "99999999999999999999",
    "1000000",
    "0x7F",
];
/// Words in the place of others.
const WORDS: &[&str] = &["", "x", "1 m", "\\u0000", "a.b[0] + c.d"];

type Play = fn(&str);

/// The files of a folder of the repository, by what they are.
fn shipped(folder: &str) -> Vec<(String, String, Play)> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap();
    let mut files = Vec::new();
    for entry in std::fs::read_dir(root.join(folder)).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_some_and(|ending| ending == "toml") && !path.ends_with("Cargo.toml")
        {
            let content = std::fs::read_to_string(&path).unwrap();
            let play: Play = if content.contains("title = ") {
                text::scenario
            } else if content.contains("[[device]]") {
                text::rig
            } else {
                text::world
            };
            files.push((path.display().to_string(), content, play));
        }
    }
    assert!(!files.is_empty(), "{folder}");
    files.sort_by(|(one, ..), (other, ..)| one.cmp(other));
    files
}

/// Where numbers stand in a text.
fn numbers(text: &str) -> Vec<(usize, usize)> {
    let bytes = text.as_bytes();
    let mut found = Vec::new();
    let mut at = 0;
    while at < bytes.len() {
        let begins = bytes[at].is_ascii_digit()
            && (at == 0 || !(bytes[at - 1].is_ascii_alphanumeric() || bytes[at - 1] == b'_'));
        let part = |byte: &u8| byte.is_ascii_digit() || b".eE".contains(byte);
        let end = at + bytes[at..].iter().take_while(|byte| part(byte)).count();
        if begins {
            let sign = usize::from(at > 0 && bytes[at - 1] == b'-');
            found.push((at - sign, end));
        }
        at = end.max(at + 1);
    }
    found
}

/// Where strings stand in a text, without their quotes.
fn words(text: &str) -> Vec<(usize, usize)> {
    let mut found = Vec::new();
    let mut start = 0;
    for line in text.split_inclusive('\n') {
        if !line.starts_with('#') {
            let quotes: Vec<usize> = line.match_indices('"').map(|(at, _)| start + at).collect();
            found.extend(quotes.chunks_exact(2).map(|pair| (pair[0] + 1, pair[1])));
        }
        start += line.len();
    }
    found
}

fn spoil(folder: &str) {
    let mut played = 0;
    let files = shipped(folder);
    // Of many files each has another part of its places spoilt, so that it does not take too long.
    let pace = 1 + files.len() / 5;
    for (nth, (file, content, play)) in files.into_iter().enumerate() {
        play(&content);
        let mut places: Vec<(usize, usize, &[&str])> = Vec::new();
        places.extend(
            numbers(&content)
                .into_iter()
                .map(|(from, to)| (from, to, NUMBERS)),
        );
        places.extend(
            words(&content)
                .into_iter()
                .map(|(from, to)| (from, to, WORDS)),
        );
        for (from, to, others) in places.into_iter().skip(nth % pace).step_by(pace) {
            for other in others {
                played += 1;
                let spoilt = [&content[..from], other, &content[to..]].concat();
                let outcome = std::panic::catch_unwind(|| play(&spoilt));
                assert!(
                    outcome.is_ok(),
                    "{file} with {other} for {}",
                    &content[from..to]
                );
            }
        }
        for line in (nth % pace..content.lines().count()).step_by(pace) {
            played += 2;
            let without = content.lines().enumerate().filter(|(at, _)| *at != line);
            play(
                &without
                    .map(|(_, text)| format!("{text}\n"))
                    .collect::<String>(),
            );
            let doubled = content.lines().enumerate();
            let doubled = doubled.map(|(at, text)| text.repeat(1 + usize::from(at == line)) + "\n");
            play(&doubled.collect::<String>());
        }
        // A file that is still being written.
        let cuts = (nth..content.len()).step_by(23 * pace);
        let cuts = cuts.filter(|at| content.is_char_boundary(*at));
        cuts.for_each(|at| play(&content[..at]));
    }
    assert!(played > 100, "{folder}: {played}");
}

#[test]
fn shipped_worlds_and_rigs_may_be_spoilt() {
    spoil("worlds");
}

#[test]
fn shipped_scenarios_of_the_r150_may_be_spoilt() {
    spoil("scenarios/r150");
}

#[test]
fn shipped_scenarios_of_the_car_may_be_spoilt() {
    spoil("scenarios/mecanum");
}

/// What goes deeper than any stack, or on longer than any line.
fn monsters() -> Vec<(&'static str, String)> {
    let deep = 100_000;
    vec![
        ("arrays", format!("world.slope = {}", "[".repeat(deep))),
        (
            "closed arrays",
            format!("world.slope = {}{}", "[".repeat(deep), "]".repeat(deep)),
        ),
        ("inline tables", format!("world = {}", "{a=".repeat(deep))),
        (
            "closed inline tables",
            format!("world = {}1{}", "{a=".repeat(deep), "}".repeat(deep)),
        ),
        ("dotted key", format!("{}a = 1", "a.".repeat(deep))),
        ("table header", format!("[{}a]\nb = 1", "a.".repeat(deep))),
        (
            "array of tables",
            format!("[[{}a]]\nb = 1", "a.".repeat(deep)),
        ),
        (
            "dotted key of a table that settings take",
            format!(
                "schema = 1\n[settings]\n{}a = 1\n[[device]]\nkind = \"r150\"",
                "a.".repeat(deep)
            ),
        ),
        ("long key", format!("{} = 1", "k".repeat(1_000_000))),
        (
            "long string",
            format!("world.slope = \"{}\"", "9".repeat(1_000_000)),
        ),
        (
            "long number",
            format!("world.slope = {}", "9".repeat(1_000_000)),
        ),
        (
            "many keys",
            (0..20_000).map(|at| format!("k{at} = 1\n")).collect(),
        ),
        (
            "many tables",
            (0..20_000).map(|at| format!("[t{at}]\n")).collect(),
        ),
        ("many headers", "[[wall]]\n".repeat(20_000)),
        ("no end of lines", "\n".repeat(1_000_000)),
        ("quotes", "\"".repeat(100_000)),
        ("nothing", "\u{0}".repeat(10_000)),
        ("byte order marks", "\u{feff}".repeat(10_000)),
    ]
}

#[test]
fn monsters_are_refused_by_every_reader() {
    let readers: [(&str, Play); 5] = [
        ("settings", text::settings),
        ("world", text::world),
        ("rig", text::rig),
        ("scenario", text::scenario),
        ("trace", rigsim_testkit::trace::play),
    ];
    for (what, monster) in monsters() {
        for (reader, read) in readers {
            println!("{what} for {reader}");
            read(&monster);
        }
    }
}

#[test]
fn conditions_without_bottom_are_refused() {
    let scenario = |condition: &str| {
        format!(
            "schema = 1\ntitle = \"t\"\ngood_client = \"g\"\nlimit = \"1 s\"\n\
             [[device]]\nkind = \"r150\"\n[[always]]\nthat = '{condition}'\n"
        )
    };
    for deep in [30, 60, 900, 100_000] {
        for (open, inside, close) in [
            ("(", "true", ")"),
            ("!", "true", ""),
            ("-", "1", " == 1"),
            ("[", "1", "]"),
            ("{1:", "1", "}"),
            ("true ? true : ", "true", ""),
            ("true && ", "true", ""),
            ("1 + ", "1 == 1", ""),
            ("truth.", "x", ""),
            ("x[", "1", "]"),
            ("size(", "1", ")"),
            ("[1].map(x, ", "x", ")"),
        ] {
            text::scenario(&scenario(
                &[&open.repeat(deep), inside, &close.repeat(deep)].concat(),
            ));
        }
    }
}

#[test]
fn traces_without_bottom_are_refused() {
    for deep in [100, 1000, 100_000] {
        for (open, close) in [("[", "]"), ("{\"a\":", "}")] {
            rigsim_testkit::trace::play(
                &[open.repeat(deep), "1".to_owned(), close.repeat(deep)].concat(),
            );
        }
    }
}
