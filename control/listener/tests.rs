use super::*;
use crate::connection::next_messages;

fn read(query: &str) -> Result<Wants, Refusal> {
    let query: Vec<(String, String)> = form_urlencoded::parse(query.as_bytes())
        .into_owned()
        .collect();
    Wants::read(&query)
}

#[test]
fn wants_are_read() {
    let wants = read("names=a.b,%20c&rate=20&names=d&picture=60&traffic=1").unwrap();
    assert_eq!(wants.names, ["a.b", "c", "d"]);
    assert_eq!(wants.values_every, Some(Duration::from_millis(50)));
    assert!(wants.picture_every.is_some() && wants.traffic);
    assert_eq!(read("").unwrap(), Wants::default());
    for wrong in [
        "rate=0",
        "rate=61",
        "rate=nan",
        "picture=-1",
        "traffic=2",
        "nmaes=a",
    ] {
        assert_eq!(read(wrong).unwrap_err().status, 400, "{wrong}");
    }
    let many = format!("names={}", vec!["a"; MOST_NAMES + 1].join(","));
    assert!(read(&many).is_err());
}

#[test]
fn a_reader_that_does_not_read_is_never_waited_for_and_learns_what_it_lost() {
    let socket = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let stream = std::net::TcpStream::connect(socket.local_addr().unwrap()).unwrap();
    let (listener, messages) = Listener::new(Wants::default(), Watch::new(stream, Arc::default()));
    let message = Message::new("log", || serde_json::json!({"a": "b\nc"}));
    assert_eq!(message.text(), "event: log\ndata: {\"a\":\"b\\nc\"}\n\n");
    for _ in 0..MOST_MESSAGES + 7 {
        assert!(listener.send(&message));
    }
    let (mut text, mut count) = (Vec::new(), 0);
    while count < MOST_MESSAGES as u64 {
        let mut some = Vec::new();
        count += next_messages(&messages, &listener.watch, &mut some).0;
        text.extend(some);
    }
    let text = String::from_utf8(text).unwrap();
    assert_eq!(text.matches("event: log\n").count(), MOST_MESSAGES);
    let lost = "event: lost\ndata: {\"messages\":7}\n";
    assert_eq!(text.matches(lost).count(), 1, "it is reported once");
    drop(messages);
    assert!(!listener.send(&message));
}
