//! The socket with a simulation that is none behind it.

use std::fs;

use serde_json::json;

use super::*;
use client::{CallError, Client};
use watch::MOST_CONNECTIONS;

/// Time for what takes a moment, on a machine that is busy with something else.
const PATIENCE: Duration = Duration::from_secs(60);

/// Serves what `answer` says until it is dropped.
struct Served {
    url: String,
    address: SocketAddr,
    shared: Arc<Shared>,
    stop: Arc<AtomicBool>,
    thread: Option<thread::JoinHandle<()>>,
}

impl Served {
    fn with(mut answer: impl FnMut(Ask) -> Option<Reply> + Send + 'static) -> Self {
        let control =
            Control::open("127.0.0.1:0".parse().unwrap(), Box::new(|| json!("forms"))).unwrap();
        let (url, address) = (control.url(), control.shared.guard.address);
        let shared = Arc::clone(&control.shared);
        let stop = Arc::new(AtomicBool::new(false));
        let stopped = Arc::clone(&stop);
        let thread = thread::spawn(move || {
            let mut kept = Vec::new();
            while !stopped.load(Ordering::Relaxed) {
                if let Ok(request) = control.requests.recv_timeout(Duration::from_millis(10)) {
                    let Request { ask, answer: way } = request;
                    match answer(ask) {
                        Some(reply) => way.give(reply),
                        None => kept.push(way),
                    }
                }
            }
        });
        Self {
            url,
            address,
            shared,
            stop,
            thread: Some(thread),
        }
    }

    fn echo() -> Self {
        Self::with(|ask| Some(Ok(json!(format!("{ask:?}")))))
    }

    fn client(&self) -> Client {
        Client::new(&self.url).unwrap()
    }

    fn raw(&self, text: &[u8]) -> String {
        let mut stream = TcpStream::connect(self.address).unwrap();
        stream.write_all(text).unwrap();
        let mut answer = String::new();
        stream.read_to_string(&mut answer).unwrap();
        answer
    }

    fn token(&self) -> &str {
        self.url.split_once("token=").unwrap().1
    }
}

impl Drop for Served {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            thread.join().unwrap();
        }
    }
}

#[test]
fn each_call_is_handed_on() {
    let served = Served::echo();
    let client = served.client();
    let asked = |method, path, body: Option<Value>| {
        let answer = client.call(method, path, body.as_ref()).unwrap();
        answer.as_str().unwrap().to_owned()
    };
    let step = json!({"fault": {"kind": "x"}});
    let added = asked("POST", "/v1/steps?wait=true", Some(step));
    assert!(
        added.starts_with("Add") && added.contains("wait: true"),
        "{added}"
    );
    assert_eq!(asked("GET", "/v1/steps", None), "Steps(None)");
    let name = format!("/v1/steps/{}", client::escape("a b/c"));
    assert_eq!(asked("DELETE", &name, None), "Clear(Some(\"a b/c\"))");
    assert_eq!(asked("DELETE", "/v1/steps", None), "Clear(None)");
    assert_eq!(
        asked("GET", "/v1/names?names=a,b", None),
        "Names([\"a\", \"b\"])"
    );
    assert_eq!(asked("GET", "/v1/state", None), "State");
    assert_eq!(asked("GET", "/v1/schema", None), "forms");
    assert_eq!(
        asked("POST", "/v1/time", Some(json!("pause"))),
        "Time(String(\"pause\"))"
    );
}

#[test]
fn a_connection_takes_several_requests() {
    let served = Served::echo();
    let one = format!(
        "GET /v1/state HTTP/1.1\r\nHost: {}\r\nAuthorization: Bearer {}\r\n",
        served.address,
        served.token()
    );
    let answer = served.raw(format!("{one}\r\n{one}\r\n{one}Connection: close\r\n\r\n").as_bytes());
    assert_eq!(answer.matches("\"State\"").count(), 3, "{answer}");
}

#[test]
fn what_must_not_or_cannot_be_asked_is_refused() {
    let served = Served::echo();
    let (host, token) = (served.address.to_string(), served.token().to_owned());
    let status = |request: &str, host: &str, more: &str| -> u16 {
        let text = format!("{request} HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n{more}\r\n");
        let answer = served.raw(text.as_bytes());
        answer.split(' ').nth(1).unwrap().parse().unwrap()
    };
    let bearer = format!("Authorization: Bearer {token}\r\n");
    assert_eq!(status("GET /v1/state", &host, &bearer), 200);
    assert_eq!(status("GET /v1/state", &host, ""), 401);
    assert_eq!(
        status("GET /v1/state", &host, "Authorization: Bearer no\r\n"),
        401
    );
    assert_eq!(status("GET /v1/state", "evil.example", &bearer), 403);
    assert_eq!(status("GET /", "evil.example", ""), 403);
    let foreign = format!("{bearer}Origin: http://evil.example\r\n");
    assert_eq!(status("GET /v1/state", &host, &foreign), 403);
    assert_eq!(status("OPTIONS /v1/state", &host, &foreign), 403);
    assert_eq!(status("GET /v1/nothing", &host, &bearer), 404);
    assert_eq!(status("PUT /v1/steps", &host, &bearer), 405);
    assert_eq!(status("POST /v1/time", &host, &bearer), 400);
    assert_eq!(status("GET /v1/state?x=1", &host, &bearer), 400);
    assert_eq!(status("GET /v1/events?rate=99", &host, &bearer), 400);
    let long = format!("{bearer}Content-Length: 70000\r\n");
    assert_eq!(status("POST /v1/steps", &host, &long), 413);
    assert_eq!(status("GET /", &host, ""), 200);
    assert_eq!(status("GET /page.js", &host, ""), 200);
}

#[test]
fn a_page_may_run_only_what_is_ours() {
    let served = Served::echo();
    let text = format!(
        "GET / HTTP/1.1\r\nHost: {}\r\nConnection: close\r\n\r\n",
        served.address
    );
    let answer = served.raw(text.as_bytes());
    assert!(answer.contains("default-src 'none'; script-src 'self'"));
    assert!(!answer.contains("Access-Control"));
    assert!(!answer.contains(served.token()));
}

#[test]
fn more_connections_than_allowed_are_turned_away_and_come_back_later() {
    let served = Served::echo();
    let idle: Vec<TcpStream> = (0..MOST_CONNECTIONS)
        .map(|_| TcpStream::connect(served.address).unwrap())
        .collect();
    let begun = Instant::now();
    let refused = || {
        matches!(
            served.client().call("GET", "/v1/state", None),
            Err(CallError::Refused { status: 503, .. } | CallError::Io(..))
        )
    };
    while !refused() {
        assert!(begun.elapsed() < Duration::from_secs(60));
    }
    drop(idle);
    while refused() {
        assert!(begun.elapsed() < Duration::from_secs(60));
    }
}

#[test]
fn a_stream_tells_and_ends() {
    let listeners = Arc::new(std::sync::Mutex::new(Vec::new()));
    let kept = Arc::clone(&listeners);
    let served = Served::with(move |ask| {
        if let Ask::Listen(listener) = ask {
            listener.send(&Message::new("log", || json!({"n": 1})));
            kept.lock().unwrap().push(listener);
        }
        Some(Ok(json!(null)))
    });
    let mut got = Vec::new();
    served
        .client()
        .events("/v1/events?traffic=1", |kind, data| {
            got.push(format!("{kind} {data}"));
            listeners.lock().unwrap().clear();
            true
        })
        .unwrap();
    assert_eq!(got, ["log {\"n\":1}", "end {}"]);
}

#[test]
fn the_end_has_been_sent_when_the_control_is_gone() {
    let asked = Arc::new(std::sync::Mutex::new(Vec::new()));
    let kept = Arc::clone(&asked);
    let served = Served::with(move |ask| {
        let reply = matches!(ask, Ask::Listen(_)).then(|| Ok(json!(null)));
        kept.lock().unwrap().push(ask);
        reply
    });
    let ask = |path: &str| {
        let mut stream = TcpStream::connect(served.address).unwrap();
        let text = format!(
            "GET {path} HTTP/1.1\r\nHost: {}\r\nAuthorization: Bearer {}\r\n\r\n",
            served.address,
            served.token()
        );
        stream.write_all(text.as_bytes()).unwrap();
        stream
    };
    let mut stream = ask("/v1/events");
    let mut waiting = ask("/v1/state");
    while asked.lock().unwrap().len() < 2 {
        thread::sleep(Duration::from_millis(1));
    }
    asked.lock().unwrap().clear();
    drop(served);
    for (stream, end) in [(&mut stream, "event: end"), (&mut waiting, "503")] {
        stream.set_nonblocking(true).unwrap();
        let mut text = String::new();
        stream.read_to_string(&mut text).unwrap();
        assert!(text.contains(end), "{text}");
    }
}

#[test]
fn no_idle_client_is_waited_for_at_the_end() {
    for _ in 0..10 {
        let served = Served::echo();
        served.client().call("GET", "/v1/state", None).unwrap();
        let idle: Vec<TcpStream> = (0..5)
            .map(|_| TcpStream::connect(served.address).unwrap())
            .collect();
        let control = Arc::clone(&served.shared);
        drop(served);
        assert!(control.connections.are_gone());
        drop(idle);
    }
}

#[test]
fn a_reader_that_stops_reading_is_let_go() {
    let listeners = Arc::new(std::sync::Mutex::new(Vec::new()));
    let kept = Arc::clone(&listeners);
    let served = Served::with(move |ask| {
        if let Ask::Listen(listener) = ask {
            kept.lock().unwrap().push(listener);
        }
        Some(Ok(json!(null)))
    });
    let mut stream = TcpStream::connect(served.address).unwrap();
    let text = format!(
        "GET /v1/events HTTP/1.1\r\nHost: {}\r\nAuthorization: Bearer {}\r\n\r\n",
        served.address,
        served.token()
    );
    stream.write_all(text.as_bytes()).unwrap();
    let message = Message::new("log", || json!("x".repeat(10_000)));
    let begun = Instant::now();
    // It gets as much as it takes; then its connection is given up, which the sender learns.
    loop {
        assert!(begun.elapsed() < Duration::from_secs(60));
        let listeners = listeners.lock().unwrap();
        if listeners
            .first()
            .is_some_and(|listener: &Listener| !listener.send(&message))
        {
            break;
        }
        drop(listeners);
        thread::sleep(Duration::from_millis(1));
    }
}

#[test]
fn who_waits_for_an_answer_learns_of_the_end() {
    let asked = Arc::new(AtomicBool::new(false));
    let is_asked = Arc::clone(&asked);
    let served = Served::with(move |_| {
        is_asked.store(true, Ordering::Relaxed);
        None
    });
    let client = served.client();
    let asking = thread::spawn(move || client.call("GET", "/v1/state", None));
    let begun = Instant::now();
    while !asked.load(Ordering::Relaxed) {
        assert!(begun.elapsed() < Duration::from_secs(60));
        thread::sleep(Duration::from_millis(1));
    }
    drop(served);
    let error = asking.join().unwrap().unwrap_err();
    assert!(
        matches!(error, CallError::Refused { status: 503, .. }),
        "{error}"
    );
}

/// Waits until all that was sent is at the other end: a busy system takes it along when it can.
fn wait_until_arrived(stream: &TcpStream) {
    let own = format!(":{:04X}", stream.local_addr().unwrap().port());
    let is_waiting = |line: &str| {
        let words: Vec<&str> = line.split_whitespace().collect();
        words[1].ends_with(&own) && !words[4].starts_with("00000000:")
    };
    let begun = Instant::now();
    while fs::read_to_string("/proc/net/tcp")
        .unwrap()
        .lines()
        .skip(1)
        .any(is_waiting)
    {
        assert!(begun.elapsed() < PATIENCE);
        thread::sleep(Duration::from_millis(1));
    }
}

#[test]
fn a_pending_request_is_answered_however_many_others_go_on_asking() {
    let control = Control::open("127.0.0.1:0".parse().unwrap(), Box::new(|| json!("forms")));
    let control = control.unwrap();
    let address = control.shared.guard.address;
    let url = control.url();
    let token = url.split_once("token=").unwrap().1;
    let text = format!(
        "GET /v1/state HTTP/1.1\r\nHost: {address}\r\nAuthorization: Bearer {token}\r\n\r\n"
    );
    thread::scope(|scope| {
        for _ in 0..4 {
            scope.spawn(|| {
                let client = Client::new(&url).unwrap();
                while client.call("GET", "/v1/steps", None).is_ok() {}
            });
        }
        for _ in 0..100 {
            let mut stream = TcpStream::connect(address).unwrap();
            stream.write_all(text.as_bytes()).unwrap();
            wait_until_arrived(&stream);
            let mut settling = control.settling();
            while !settling.is_over() {
                if let Some(request) = settling.request(&control, Duration::from_millis(10)) {
                    let Request { ask, answer: way } = request;
                    way.give(Ok(json!(format!("{ask:?}"))));
                }
            }
            // A request without an answer by now gets none. The answer may be on its way, though.
            stream.set_read_timeout(Some(PATIENCE)).unwrap();
            let mut answer = [0; 4096];
            let count = stream.read(&mut answer).unwrap();
            let answer = String::from_utf8_lossy(&answer[..count]);
            assert!(answer.contains("\"State\""), "{answer}");
        }
        // The others learn that it is over.
        drop(control);
    });
}
