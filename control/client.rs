//! A client, for the command line.

use std::io::{self, BufRead, BufReader, ErrorKind, Read, Write as _};
use std::net::TcpStream;
use std::time::Duration;

use serde_json::Value;

/// Most bytes of the head of an answer.
const MOST_HEAD: usize = 16 << 10;
/// Most bytes of an answer, and of a line of a stream.
const MOST_BYTES: u64 = 64 << 20;
/// Time for a connection to be made.
const CONNECT: Duration = Duration::from_secs(5);

/// Reason for which a call has come to nothing.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum CallError {
    /// The URL is not one that a simulator prints.
    #[error("\"{0}\" is not the URL of a simulator, as http://127.0.0.1:4000/#token=…")]
    Url(String),
    /// There is no connection, or it has ended.
    #[error("the simulator at {0} does not answer: {1}")]
    Io(String, io::Error),
    /// The simulator refuses.
    #[error("{why}")]
    Refused {
        /// As in HTTP.
        status: u16,
        /// Its words.
        why: String,
    },
}

/// A simulator to be asked.
#[derive(Debug, Clone)]
pub struct Client {
    host: String,
    token: String,
}

impl Client {
    /// The simulator at a URL with its token, as it prints it.
    ///
    /// # Errors
    /// When it is not such a URL.
    pub fn new(url: &str) -> Result<Self, CallError> {
        let parts = url
            .trim()
            .strip_prefix("http://")
            .and_then(|rest| rest.split_once("/#token="));
        let plain = |text: &str| text.bytes().all(|byte| byte.is_ascii_graphic());
        match parts {
            Some((host, token)) if plain(host) && plain(token) => Ok(Self {
                host: host.to_owned(),
                token: token.to_owned(),
            }),
            _ => Err(CallError::Url(url.chars().take(200).collect())),
        }
    }

    /// Asks, and waits for the answer however long it takes.
    ///
    /// # Errors
    /// When there is no answer, or it is a refusal.
    pub fn call(&self, method: &str, path: &str, body: Option<&Value>) -> Result<Value, CallError> {
        let io = |error| CallError::Io(self.host.clone(), error);
        let (status, answer) = self.send(method, path, body).map_err(io)?;
        let value = read_json(answer).map_err(io)?;
        match status {
            200..300 => Ok(value),
            _ => Err(refused(status, &value)),
        }
    }

    /// Takes the events of a stream, kind and data, until `take` has enough or the stream ends.
    ///
    /// # Errors
    /// When there is no answer, or it is a refusal.
    pub fn events(
        &self,
        path: &str,
        mut take: impl FnMut(&str, &str) -> bool,
    ) -> Result<(), CallError> {
        let io = |error| CallError::Io(self.host.clone(), error);
        let (status, mut answer) = self.send("GET", path, None).map_err(io)?;
        if status != 200 {
            return Err(refused(status, &read_json(answer).map_err(io)?));
        }
        let mut kind = String::new();
        loop {
            let mut line = String::new();
            let count = (&mut answer)
                .take(MOST_BYTES)
                .read_line(&mut line)
                .map_err(io)?;
            if count == 0 {
                return Ok(());
            }
            let line = line.trim_end_matches('\n');
            if let Some(name) = line.strip_prefix("event: ") {
                kind = name.to_owned();
            } else if let Some(data) = line.strip_prefix("data: ")
                && !take(&kind, data)
            {
                return Ok(());
            }
        }
    }

    fn send(
        &self,
        method: &str,
        path: &str,
        body: Option<&Value>,
    ) -> io::Result<(u16, BufReader<TcpStream>)> {
        let address = self
            .host
            .parse()
            .map_err(|_| io::Error::new(ErrorKind::InvalidInput, "that is not an address"))?;
        let mut stream = TcpStream::connect_timeout(&address, CONNECT)?;
        stream.set_nodelay(true)?;
        let body = body.map(Value::to_string).unwrap_or_default();
        let head = format!(
            "{method} {path} HTTP/1.1\r\nHost: {}\r\nAuthorization: Bearer {}\r\n\
             Content-Length: {}\r\nConnection: close\r\n\r\n",
            self.host,
            self.token,
            body.len()
        );
        stream.write_all(head.as_bytes())?;
        stream.write_all(body.as_bytes())?;
        let mut answer = BufReader::new(stream);
        let status = read_head(&mut answer)?;
        Ok((status, answer))
    }
}

/// Escapes what may not stand in a path.
#[must_use]
pub fn escape(part: &str) -> String {
    let escaped: String = form_urlencoded::byte_serialize(part.as_bytes()).collect();
    escaped.replace('+', "%20")
}

fn read_json(answer: impl Read) -> io::Result<Value> {
    let mut text = String::new();
    answer.take(MOST_BYTES).read_to_string(&mut text)?;
    serde_json::from_str(&text).map_err(io::Error::other)
}

fn refused(status: u16, answer: &Value) -> CallError {
    let why = answer["error"].as_str().unwrap_or("it says no more");
    CallError::Refused {
        status,
        why: why.to_owned(),
    }
}

/// Reads a head and returns its status.
fn read_head(answer: &mut impl BufRead) -> io::Result<u16> {
    let mut head = Vec::new();
    while !head.ends_with(b"\r\n\r\n") {
        let mut byte = [0];
        answer.read_exact(&mut byte)?;
        head.push(byte[0]);
        if head.len() > MOST_HEAD {
            return Err(ErrorKind::InvalidData.into());
        }
    }
    let mut fields = [httparse::EMPTY_HEADER; 64];
    let mut response = httparse::Response::new(&mut fields);
    response.parse(&head).map_err(io::Error::other)?;
    response.code.ok_or_else(|| ErrorKind::InvalidData.into())
}

#[cfg(test)]
mod tests;
