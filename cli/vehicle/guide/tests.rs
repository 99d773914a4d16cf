use super::*;
use crate::vehicle::plan::PlannedFrame;

/// A manoeuvre of frames: link, bytes, and the time behind them in s.
fn manoeuvre(name: &str, frames: &[(usize, &str, u64)]) -> Manoeuvre {
    let frame = |(link, bytes, wait): &(usize, &str, u64)| PlannedFrame {
        link: *link,
        bytes: (*bytes).to_owned(),
        wait_ms: 1000 * wait,
    };
    Manoeuvre {
        name: name.to_owned(),
        care: String::new(),
        touches: Vec::new(),
        frames: frames.iter().map(frame).collect(),
    }
}

/// Bytes on a link at a time in s.
type Sent<'b> = (usize, f64, &'b [u8]);

/// What is said when bytes come on links at times in s: codes, with the names that stand in the words.
fn said(guide: &mut Guide, sent: &[Sent<'_>]) -> Vec<String> {
    let mut all = Vec::new();
    for (link, at, bytes) in sent {
        let t = std::time::Duration::from_secs_f64(*at).as_nanos();
        all.extend(guide.client_sent(*link, t.try_into().unwrap(), bytes));
    }
    let words = |(code, text): &(Code, String)| format!("{} {}", code.name, text);
    all.iter().map(words).collect()
}

#[test]
fn what_comes_is_ticked_by_its_bytes_and_its_time() {
    let plan = [
        manoeuvre("one", &[(0, "0102", 2), (0, "0103", 5)]),
        manoeuvre("two", &[(0, "0A", 1), (1, "0B0C", 20), (0, "0D", 1)]),
    ];
    let begin = || Guide::new(&plan, 2);
    let (one, two): (&[u8], &[u8]) = (&[1, 2], &[1, 3]);
    let (next, next_one) = ("manoeuvre_next next: two", "manoeuvre_next next: one");
    let cases: &[(&[Sent], &[&str], &[&str])] = &[
        // In parts, behind what is not part of it, and not on the other link.
        (
            &[(0, 1.0, &[9, 1, 1, 2, 1]), (0, 3.0, &[3])],
            &["manoeuvre_done done: one", next],
            &["two"],
        ),
        (&[(1, 1.0, one), (1, 3.0, two)], &[], &["one", "two"]),
        (
            &[(0, 1.0, one), (0, 2.0, &[9]), (0, 3.0, two)],
            &[],
            &["one", "two"],
        ),
        // 2 s, of which 1.2 s are allowed more or less.
        (
            &[(0, 1.0, one), (0, 1.7, two)],
            &["manoeuvre_refused one took 0.7 s instead of 2.0 s"],
            &["one", "two"],
        ),
        (
            &[(0, 1.0, one), (0, 4.3, two)],
            &["manoeuvre_refused one took 3.3 s instead of 2.0 s"],
            &["one", "two"],
        ),
        (
            &[
                (0, 1.0, one),
                (0, 4.3, two),
                (0, 5.0, one),
                (0, 8.1, two),
                (0, 9.0, one),
                (0, 11.0, two),
            ],
            &["manoeuvre_refused one", "manoeuvre_done done: one", next],
            &["two"],
        ),
        // On two links, where one comes too soon at first; the order is free.
        (
            &[
                (1, 1.0, &[0xB, 0xC]),
                (0, 100.0, &[0xA]),
                (1, 101.0, &[0xB]),
                (1, 101.1, &[0xC]),
                (0, 121.0, &[0xD]),
            ],
            &["manoeuvre_done done: two", next_one],
            &["one"],
        ),
        (
            &[
                (1, 1.0, &[0xB, 0xC]),
                (0, 100.0, &[0xA]),
                (0, 121.0, &[0xD]),
            ],
            &[],
            &["one", "two"],
        ),
        (
            &[
                (0, 1.0, &[0xA]),
                (1, 2.0, &[0xB, 0xC]),
                (0, 22.0, &[0xD]),
                (0, 23.0, one),
                (0, 25.0, two),
            ],
            &[
                "manoeuvre_done done: two",
                next_one,
                "manoeuvre_done done: one",
            ],
            &[],
        ),
    ];
    for (sent, expected, missing) in cases {
        let mut guide = begin();
        let said = said(&mut guide, sent);
        let fits = said
            .iter()
            .zip(*expected)
            .all(|(said, begin)| said.starts_with(begin));
        assert!(fits && said.len() == expected.len(), "{sent:?}: {said:?}");
        assert_eq!(guide.missing(), *missing, "{sent:?}");
    }
    // With one link only the first can be performed.
    assert_eq!(Guide::new(&plan, 1).missing(), ["one"]);
}

#[test]
fn however_much_comes_little_is_kept() {
    let mut guide = Guide::new(&[manoeuvre("one", &[(0, "0102", 0)])], 1);
    for t in 0..100 {
        assert!(guide.client_sent(0, t, &[1; 1000]).is_empty());
    }
    assert_eq!(guide.tails[0].0.len(), 2);
}
