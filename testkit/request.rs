//! Input of a client of the control socket.

use rigsim_control::http::{self, Head, MOST_BODY, MOST_HEAD};

/// Most bytes of a refusal's words.
const MOST_WORDS: usize = 300;

/// Plays any bytes as the beginning of a connection.
///
/// # Promises
/// Any bytes are a request, the beginning of one, or refused with a status that names the
/// client, in few words. However they are split, the same comes of them: what is a request as soon as its
/// head is complete stays the same whatever follows, and what is refused is never a request later.
/// Nothing waits for more than the longest head, and no body is longer than the longest.
pub fn play(bytes: &[u8]) {
    let mut complete: Option<(Head, usize)> = None;
    let mut is_refused = false;
    // Each place at which a head may end, and some at which it does not.
    let ends = bytes.iter().enumerate().filter(|(_, byte)| **byte == b'\n');
    let ends = ends.map(|(at, _)| at + 1);
    let some = (0..bytes.len()).step_by(bytes.len() / 16 + 1);
    let mut places: Vec<usize> = ends.chain(some).chain([bytes.len()]).collect();
    places.sort_unstable();
    for place in places.into_iter().take(200) {
        match http::head(&bytes[..place]) {
            Ok(Some((head, length))) => {
                assert!(!is_refused, "what was refused is a request later");
                assert!(length <= place && length <= MOST_HEAD, "a head of {length}");
                assert!(head.body <= MOST_BODY, "a body of {}", head.body);
                let now = (head, length);
                assert!(complete.as_ref().is_none_or(|before| *before == now));
                complete = Some(now);
            }
            Ok(None) => {
                assert!(complete.is_none(), "a request is none later");
                assert!(place < MOST_HEAD, "{place} bytes wait for more");
            }
            Err(refusal) => {
                assert!(complete.is_none(), "a request is refused later");
                assert!((400..500).contains(&refusal.status), "{refusal:?}");
                assert!(refusal.why.len() <= MOST_WORDS, "{refusal:?}");
                is_refused = true;
            }
        }
    }
}
