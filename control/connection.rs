//! One connection: requests, answers, and the stream of events.

use std::io::{self, ErrorKind, Read as _, Write as _};
use std::net::{Shutdown, TcpStream};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use crossbeam_channel::{Receiver, RecvTimeoutError};
use serde_json::{Value, json};

use crate::http::{self, Head};
use crate::listener::{Message, flag, names, unknown};
use crate::page;
use crate::watch::{Watch, wait_readable};
use crate::{Ask, Listener, Refusal, Reply, Shared, Wants};

/// Time for a request to arrive, and for an answer to be taken.
const PATIENCE: Duration = Duration::from_secs(5);
/// Time for the reader of a stream to take what is written at a time.
const STREAM_PATIENCE: Duration = Duration::from_secs(15);
/// Time for which a connection may be idle.
const IDLE: Duration = Duration::from_secs(60);
/// Time for a client to take its last words, once the simulation has ended.
const PARTING: Duration = Duration::from_secs(1);
/// After which silence a stream says that it is still there.
const SIGN_OF_LIFE: Duration = Duration::from_secs(5);
/// Time between two looks whether a client still waits, or the simulation has ended.
const LOOK: Duration = Duration::from_millis(100);
/// Bytes that wait in the system for a slow reader, so that it hears soon that it is slow.
const SEND_BUFFER: usize = 64 << 10;
/// Most bytes of a stream that are written at a time.
const MOST_AT_ONCE: usize = 64 << 10;

const STEP_METHODS: &str = "GET, POST or DELETE";

/// Serves a client until it leaves, or takes too long.
pub(crate) fn serve(stream: TcpStream, shared: &Shared, watch: &Arc<Watch>) {
    // A client that leaves early needs no answer.
    let _ = Connection::new(stream, shared, watch).and_then(Connection::serve);
}

/// Refuses a client because there are too many.
pub(crate) fn turn_away(stream: &TcpStream) {
    let refusal = Refusal::new(503, "too many connections");
    let _ = stream.set_nonblocking(true);
    let _ = (&*stream).write(&answer_bytes(&Err(refusal), 200, false));
    let _ = stream.shutdown(Shutdown::Write);
}

struct Connection<'a> {
    stream: TcpStream,
    shared: &'a Shared,
    watch: &'a Arc<Watch>,
    /// Bytes that have come and are not yet used.
    buffer: Vec<u8>,
}

/// A request with its body, nothing at the end, or what is wrong with it.
type Arrived = Result<Option<(Head, Vec<u8>)>, Refusal>;

/// A question, and the status of its answer if it goes well.
type Asked = (Ask, u16);

impl<'a> Connection<'a> {
    fn new(stream: TcpStream, shared: &'a Shared, watch: &'a Arc<Watch>) -> io::Result<Self> {
        stream.set_nodelay(true)?;
        rustix::net::sockopt::set_socket_send_buffer_size(&stream, SEND_BUFFER)?;
        Ok(Self {
            stream,
            shared,
            watch,
            buffer: Vec::new(),
        })
    }

    fn serve(mut self) -> io::Result<()> {
        while !self.shared.stop.load(Ordering::Relaxed) {
            let (head, body) = match self.request()? {
                Ok(Some(request)) => request,
                Ok(None) => return Ok(()),
                Err(refusal) => return self.refuse_and_close(refusal),
            };
            self.shared.pace.wait();
            if let Err(refusal) = self.shared.guard.check_site(&head) {
                return self.refuse_and_close(refusal);
            }
            let file = page::find(&head.path).filter(|_| head.method == "GET");
            if let Some((mime, text)) = file {
                self.write(&with_body(200, mime, text, head.stays))?;
            } else if let Err(refusal) = self.shared.guard.check_token(&head) {
                return self.refuse_and_close(refusal);
            } else if head.path == ["v1", "events"] && head.method == "GET" {
                return self.events(&head);
            } else if head.path == ["v1", "schema"] && head.method == "GET" {
                let reply = no_query(&head).map(|()| self.shared.schema.clone());
                self.write(&answer_bytes(&reply, 200, head.stays))?;
            } else {
                let (reply, status) = match route(&head, &body) {
                    Ok((ask, status)) => (self.ask(ask)?, status),
                    Err(refusal) => (Err(refusal), 200),
                };
                self.write(&answer_bytes(&reply, status, head.stays))?;
            }
            if !head.stays {
                break;
            }
        }
        self.stream.shutdown(Shutdown::Both)
    }

    /// The next request with its body; nothing at the end.
    fn request(&mut self) -> io::Result<Arrived> {
        let mut until = Instant::now() + IDLE;
        let mut begun = false;
        let (head, length) = loop {
            if !self.buffer.is_empty() {
                match http::head(&self.buffer) {
                    Ok(Some(head)) => break head,
                    Ok(None) => {}
                    Err(refusal) => return Ok(Err(refusal)),
                }
                if !std::mem::replace(&mut begun, true) {
                    until = Instant::now() + PATIENCE;
                }
            }
            match self.read_more(until)? {
                Some(0) => return Ok(Ok(None)),
                None if begun => return Ok(Err(Refusal::new(408, "the request does not come"))),
                None => return Ok(Ok(None)),
                Some(_) => {}
            }
        };
        self.buffer.drain(..length);
        if head.waits && self.buffer.is_empty() {
            self.write(b"HTTP/1.1 100 Continue\r\n\r\n")?;
        }
        let until = Instant::now() + PATIENCE;
        while self.buffer.len() < head.body {
            match self.read_more(until)? {
                Some(0) => return Ok(Ok(None)),
                None => return Ok(Err(Refusal::new(408, "the body does not come"))),
                Some(_) => {}
            }
        }
        let body = self.buffer.drain(..head.body).collect();
        Ok(Ok(Some((head, body))))
    }

    /// Reads what comes before `until`; nothing if that has passed, and 0 at the end.
    fn read_more(&mut self, until: Instant) -> io::Result<Option<usize>> {
        let mut bytes = [0; 4096];
        loop {
            let left = until.saturating_duration_since(Instant::now());
            if left.is_zero() {
                return Ok(None);
            }
            self.watch.is_idle();
            let ready = wait_readable(&self.stream, Some(left));
            self.watch.is_busy();
            if ready? {
                let count = self.stream.read(&mut bytes)?;
                self.buffer.extend_from_slice(&bytes[..count]);
                return Ok(Some(count));
            }
        }
    }

    /// Asks the simulation, and waits as long as the client does.
    fn ask(&mut self, ask: Ask) -> io::Result<Reply> {
        let answered = match self.shared.ask(ask, self.watch) {
            Ok(answered) => answered,
            Err(refusal) => return Ok(Err(refusal)),
        };
        loop {
            match answered.recv_timeout(LOOK) {
                Ok(reply) => return Ok(reply),
                Err(RecvTimeoutError::Disconnected) => {
                    return Ok(Err(Refusal::new(503, "the simulation has ended")));
                }
                Err(RecvTimeoutError::Timeout) if self.has_left()? => {
                    return Err(ErrorKind::ConnectionAborted.into());
                }
                Err(RecvTimeoutError::Timeout) => {}
            }
        }
    }

    fn has_left(&self) -> io::Result<bool> {
        Ok(wait_readable(&self.stream, Some(Duration::ZERO))? && self.stream.peek(&mut [0])? == 0)
    }

    /// Sends events until the client leaves.
    fn events(&mut self, head: &Head) -> io::Result<()> {
        let wants = match Wants::read(&head.query) {
            Ok(wants) => wants,
            Err(refusal) => return self.refuse_and_close(refusal),
        };
        let (listener, messages) = Listener::new(wants, Arc::clone(self.watch));
        if let Err(refusal) = self.ask(Ask::Listen(listener))? {
            return self.refuse_and_close(refusal);
        }
        let fields = "Content-Type: text/event-stream\r\nConnection: close";
        self.write(head_text(200, fields).as_bytes())?;
        self.watch.is_stream();
        let mut text = Vec::new();
        // Also at the end: messages that wait, and the end itself, are still to be written.
        loop {
            text.clear();
            let (count, more) = next_messages(&messages, self.watch, &mut text);
            self.write_within(&text, STREAM_PATIENCE)?;
            self.watch.written(count);
            if !more {
                break;
            }
        }
        self.stream.shutdown(Shutdown::Both)
    }

    fn refuse_and_close(&mut self, refusal: Refusal) -> io::Result<()> {
        self.write(&answer_bytes(&Err(refusal), 200, false))?;
        self.stream.shutdown(Shutdown::Write)?;
        // A connection that is closed before all has been read would take the answer with it.
        let until = Instant::now() + LOOK;
        let mut left = http::MOST_BODY;
        while let Some(count) = self.read_more(until)?.filter(|count| *count > 0) {
            self.buffer.clear();
            left = left.saturating_sub(count);
            if left == 0 {
                break;
            }
        }
        Ok(())
    }

    fn write(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.write_within(bytes, PATIENCE)
    }

    /// Writes all, or fails when the client takes too long; at the end it is waited for no longer than
    /// [`PARTING`].
    fn write_within(&mut self, mut bytes: &[u8], patience: Duration) -> io::Result<()> {
        let mut until = Instant::now() + patience;
        let mut is_parting = false;
        while !bytes.is_empty() {
            let now = Instant::now();
            if !is_parting && self.shared.stop.load(Ordering::Relaxed) {
                is_parting = true;
                until = until.min(now + PARTING);
            }
            let left = until.saturating_duration_since(now);
            if left.is_zero() {
                return Err(ErrorKind::TimedOut.into());
            }
            self.stream.set_write_timeout(Some(left.min(LOOK)))?;
            match self.stream.write(bytes) {
                Ok(0) => return Err(ErrorKind::WriteZero.into()),
                Ok(count) => bytes = &bytes[count..],
                Err(error) if is_timeout(&error) || error.kind() == ErrorKind::Interrupted => {}
                Err(error) => return Err(error),
            }
        }
        Ok(())
    }
}

/// Waits for messages and takes what there are; says how many, and whether more may come.
pub(super) fn next_messages(
    messages: &Receiver<Message>,
    watch: &Watch,
    text: &mut Vec<u8>,
) -> (u64, bool) {
    let mut count = 0;
    let first = messages.recv_timeout(SIGN_OF_LIFE);
    let more = !matches!(first, Err(RecvTimeoutError::Disconnected));
    match first {
        Ok(message) => {
            count += 1;
            text.extend_from_slice(message.text().as_bytes());
        }
        Err(RecvTimeoutError::Timeout) => text.extend_from_slice(b": still there\n\n"),
        Err(RecvTimeoutError::Disconnected) => {}
    }
    while text.len() < MOST_AT_ONCE
        && let Ok(message) = messages.try_recv()
    {
        count += 1;
        text.extend_from_slice(message.text().as_bytes());
    }
    let lost = watch.lost.swap(0, Ordering::Relaxed);
    if lost > 0 {
        let message = Message::new("lost", move || json!({ "messages": lost }));
        text.extend_from_slice(message.text().as_bytes());
    }
    if !more {
        text.extend_from_slice(b"event: end\ndata: {}\n\n");
    }
    (count, more)
}

/// From a request to what is asked.
fn route(head: &Head, body: &[u8]) -> Result<Asked, Refusal> {
    let path: Vec<&str> = head.path.iter().map(String::as_str).collect();
    let method = head.method.as_str();
    match (path.as_slice(), method) {
        (["v1", "steps"], "POST") => Ok((add(head, body)?, 201)),
        (["v1", "steps"], "GET") => plain(head, Ask::Steps(None)),
        (["v1", "steps"], "DELETE") => plain(head, Ask::Clear(None)),
        (["v1", "steps", name], "GET") => plain(head, Ask::Steps(Some((*name).to_owned()))),
        (["v1", "steps", name], "DELETE") => plain(head, Ask::Clear(Some((*name).to_owned()))),
        (["v1", "names"], "GET") => Ok((wanted_names(head)?, 200)),
        (["v1", "state"], "GET") => plain(head, Ask::State),
        (["v1", "time"], "POST") => plain(head, Ask::Time(read_json(body)?)),
        (["v1", "published"], "POST") => plain(head, Ask::Publish(read_json(body)?)),
        (["v1", "steps"] | ["v1", "steps", _], _) => Err(wrong_method(STEP_METHODS)),
        (["v1", "names" | "state" | "schema" | "events"], _) => Err(wrong_method("GET")),
        (["v1", "time" | "published"], _) => Err(wrong_method("POST")),
        _ => Err(Refusal::new(
            404,
            "nothing is here; there are /v1/steps, /v1/names, /v1/state, /v1/events, /v1/time, \
             /v1/published and /v1/schema",
        )),
    }
}

fn wrong_method(allowed: &str) -> Refusal {
    Refusal::new(405, format!("the method has to be {allowed}"))
}

fn plain(head: &Head, ask: Ask) -> Result<Asked, Refusal> {
    no_query(head).map(|()| (ask, 200))
}

fn no_query(head: &Head) -> Result<(), Refusal> {
    match head.query.first() {
        Some((name, _)) => Err(unknown(name, "none")),
        None => Ok(()),
    }
}

/// The values of the one parameter that is allowed.
fn values<'h>(head: &'h Head, allowed: &str) -> Result<Vec<&'h str>, Refusal> {
    let values = head.query.iter().map(|(name, value)| {
        let value = (name == allowed).then_some(value.as_str());
        value.ok_or_else(|| unknown(name, allowed))
    });
    values.collect()
}

fn add(head: &Head, body: &[u8]) -> Result<Ask, Refusal> {
    let mut wait = false;
    for value in values(head, "wait")? {
        wait = flag("wait", value)?;
    }
    let step = read_json(body)?;
    Ok(Ask::Add { step, wait })
}

fn wanted_names(head: &Head) -> Result<Ask, Refusal> {
    let lists = values(head, "names")?.into_iter();
    Ok(Ask::Names(lists.flat_map(names).collect()))
}

fn read_json(body: &[u8]) -> Result<Value, Refusal> {
    crate::json::read(body)
        .map_err(|error| Refusal::new(400, format!("cannot read the body: {error}")))
}

fn is_timeout(error: &io::Error) -> bool {
    matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut)
}

/// A head for any answer; browsers are to keep nothing, guess nothing, and run only what is ours.
fn head_text(status: u16, fields: &str) -> String {
    let reason = http::reason(status);
    format!(
        "HTTP/1.1 {status} {reason}\r\n{fields}\r\nCache-Control: no-store\r\n\
         X-Content-Type-Options: nosniff\r\nReferrer-Policy: no-referrer\r\n\
         Cross-Origin-Resource-Policy: same-origin\r\n\
         Content-Security-Policy: default-src 'none'; script-src 'self'; style-src 'self'; \
         connect-src 'self'; img-src 'self' data:; base-uri 'none'; form-action 'none'; \
         frame-ancestors 'none'\r\n\r\n"
    )
}

fn with_body(status: u16, mime: &str, body: &str, stays: bool) -> Vec<u8> {
    let connection = if stays { "keep-alive" } else { "close" };
    let asks = if status == 401 {
        "\r\nWWW-Authenticate: Bearer"
    } else {
        ""
    };
    let fields = format!(
        "Content-Type: {mime}\r\nContent-Length: {}\r\nConnection: {connection}{asks}",
        body.len()
    );
    let mut bytes = head_text(status, &fields).into_bytes();
    bytes.extend_from_slice(body.as_bytes());
    bytes
}

fn answer_bytes(reply: &Reply, status: u16, stays: bool) -> Vec<u8> {
    let (status, body) = match reply {
        Ok(value) => (status, value.to_string()),
        Err(refusal) => {
            let value = json!({ "error": refusal.why });
            (refusal.status, value.to_string())
        }
    };
    with_body(status, "application/json", &format!("{body}\n"), stays)
}
