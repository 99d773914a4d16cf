use super::*;

fn read(text: &str) -> Head {
    head(text.as_bytes()).unwrap().unwrap().0
}

fn status(text: &[u8]) -> u16 {
    head(text).unwrap_err().status
}

#[test]
fn a_head_is_read_when_it_is_complete() {
    let text = "POST /v1/steps/a%20b+c%2Fd?wait=1&name=x%26y&name=z+w HTTP/1.1\r\nHost: h:1\r\n\
                Content-Length: 12\r\nExpect: 100-continue\r\n\r\nbody";
    for end in 0..text.len() - 4 {
        assert_eq!(head(&text.as_bytes()[..end]), Ok(None));
    }
    let (head, length) = head(text.as_bytes()).unwrap().unwrap();
    assert_eq!(&text[length..], "body");
    assert_eq!(head.path, ["v1", "steps", "a b+c/d"]);
    let query: Vec<(&str, &str)> = head
        .query
        .iter()
        .map(|(name, value)| (name.as_str(), value.as_str()))
        .collect();
    assert_eq!(query, [("wait", "1"), ("name", "x&y"), ("name", "z w")]);
    assert_eq!((head.body, head.stays, head.waits), (12, true, true));
    assert_eq!(head.host.as_deref(), Some("h:1"));
}

#[test]
fn a_connection_ends_as_it_is_asked_to() {
    assert!(!read("GET / HTTP/1.0\r\n\r\n").stays);
    assert!(!read("GET / HTTP/1.1\r\nConnection: x, Close\r\n\r\n").stays);
    assert!(read("GET / HTTP/1.1\r\nConnection: keep-alive\r\n\r\n").stays);
}

#[test]
fn what_is_too_much_or_ambiguous_is_refused() {
    let with = |fields: &str| status(format!("GET / HTTP/1.1\r\n{fields}\r\n\r\n").as_bytes());
    assert_eq!(with("Content-Length: 65537"), 413);
    assert_eq!(with("Content-Length: 99999999999999999999999"), 413);
    assert_eq!(with("Content-Length: -1"), 400);
    assert_eq!(with("Content-Length: +1"), 400);
    assert_eq!(with("Content-Length: 1\r\nContent-Length: 1"), 400);
    assert_eq!(with("Transfer-Encoding: chunked"), 411);
    assert_eq!(with("Host: a\r\nHost: a"), 400);
    assert_eq!(status(b"GET / HTTP/1.1\r\nHost: \xFF\r\n\r\n"), 400);
    assert_eq!(with(&"X: y\r\n".repeat(65)), 431);
    assert_eq!(status(b"GET http://h/ HTTP/1.1\r\n\r\n"), 400);
    assert_eq!(status(b"\x16\x03\x01\x02\x00"), 400);
    assert_eq!(
        status(format!("GET /{} HTTP/1.1\r\n\r\n", "a/".repeat(64)).as_bytes()),
        414
    );
    assert_eq!(
        status(format!("GET /{}", "a".repeat(MOST_HEAD)).as_bytes()),
        431
    );
}
