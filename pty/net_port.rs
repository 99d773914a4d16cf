//! A port that clients reach over the network: for containers and other systems, and for clients
//! that need the lines of a modem, which a pseudo-terminal does not have.
//!
//! What is connected is the far end of the cable. Bytes that a client has sent are taken ahead of
//! the line, as a bridge does, for what it says about them (purge) stands behind them in its
//! stream; they are kept here, up to a bound, beyond which the network holds them back.

use rigsim_settings::ClientLine;
use std::collections::VecDeque;
use std::fmt;
use std::io::{ErrorKind, Read as _};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::io::retry_on_intr;
use rustix::net::sockopt;

use crate::error::{PortError, PortErrorKind};
use crate::hub::{BOTH, IN, Registration};
use crate::net_decoder::{MOST_AHEAD, NetDecoder, Protocol};
use crate::port::{Counters, Event, Port};
use crate::pty_port::write_some;

/// Time that the end of one connection may take when the beginning of the next is known already:
/// both come by different processors.
const LONGEST_FAREWELL: Duration = Duration::from_millis(100);
/// After so long a silence a client is asked whether it is still there.
const SILENCE: Duration = Duration::from_secs(10);

/// Address to listen at, written `tcp://HOST:PORT` or `rfc2217://HOST:PORT`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ListenAddress {
    /// Protocol of its connections.
    pub protocol: Protocol,
    address: String,
}

impl ListenAddress {
    /// The address that `text` is, or `None` if it is not a URL of these kinds, but perhaps a path.
    ///
    /// # Errors
    ///
    /// Says in words what is missing.
    pub fn parse(text: &str) -> Option<Result<Self, String>> {
        let schemes = [("tcp", Protocol::Tcp), ("rfc2217", Protocol::Rfc2217)];
        let (scheme, rest) = text.split_once("://")?;
        let (_, protocol) = schemes.into_iter().find(|(name, _)| *name == scheme)?;
        let port = rest
            .rsplit_once(':')
            .map(|(host, port)| (host, port.parse::<u16>()));
        Some(match port {
            Some((host, Ok(_))) if !host.is_empty() => Ok(Self {
                protocol,
                address: rest.to_owned(),
            }),
            _ => Err(format!(
                "`{text}` lacks a host or a port; give both, as in {scheme}://127.0.0.1:2217"
            )),
        })
    }

    /// Returns whether `path` is a URL of these kinds.
    #[must_use]
    pub fn is_url(path: &Path) -> bool {
        path.to_str().and_then(Self::parse).is_some()
    }

    fn at(&self, address: SocketAddr) -> Self {
        Self {
            protocol: self.protocol,
            address: address.to_string(),
        }
    }
}

impl fmt::Display for ListenAddress {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let scheme = match self.protocol {
            Protocol::Tcp => "tcp",
            Protocol::Rfc2217 => "rfc2217",
        };
        write!(f, "{scheme}://{}", self.address)
    }
}

/// A port that waits for one client at a time to connect.
#[derive(Debug)]
pub(crate) struct NetPort {
    registration: Option<Registration>,
    listener: TcpListener,
    protocol: Protocol,
    public: bool,
    /// The URL that clients open.
    path: PathBuf,
    baud: u32,
    client: Option<Connection>,
    /// A client that came at this time while another is still there, as far as is known.
    next: Option<(TcpStream, Instant)>,
    counters: Counters,
}

impl NetPort {
    /// Listens at `address`, for a device that runs at `baud`. With port 0 the system chooses one,
    /// which [`path`](Port::path) tells.
    pub(crate) fn open(address: &ListenAddress, baud: u32) -> Result<Self, PortError> {
        let open = || -> std::io::Result<_> {
            let listener = TcpListener::bind(&address.address)?;
            listener.set_nonblocking(true)?;
            let local = listener.local_addr()?;
            Ok((listener, local))
        };
        let (listener, local) = open().map_err(|reason| {
            let kind = match reason.kind() {
                ErrorKind::AddrInUse => PortErrorKind::AddressInUse,
                ErrorKind::AddrNotAvailable => PortErrorKind::ForeignAddress,
                _ => PortErrorKind::System {
                    call: "listening",
                    reason,
                },
            };
            PortError::new("serve", address.to_string(), kind)
        })?;
        Ok(Self {
            registration: None,
            listener,
            protocol: address.protocol,
            public: !local.ip().is_loopback(),
            path: PathBuf::from(address.at(local).to_string()),
            baud,
            client: None,
            next: None,
            counters: Counters::default(),
        })
    }
}

impl Port for NetPort {
    fn path(&self) -> &Path {
        &self.path
    }

    fn is_public(&self) -> bool {
        self.public
    }

    fn is_attached(&self) -> bool {
        self.client.is_some()
    }

    fn counters(&self) -> Counters {
        self.counters
    }

    fn client_line(&self) -> Result<Option<ClientLine>, PortError> {
        Ok(Some(match &self.client {
            Some(client) => client.decoder.settings(),
            None => NetDecoder::new(self.protocol, self.baud).settings(),
        }))
    }

    fn read(&mut self, buf: &mut [u8]) -> Result<Event, PortError> {
        let event = self.next_event(buf)?;
        if let Some(registration) = &self.registration {
            registration.mark_polled(event == Some(Event::Idle));
        }
        Ok(event.unwrap_or(Event::Idle))
    }

    fn write(&mut self, bytes: &[u8]) -> Result<usize, PortError> {
        let Some(client) = &mut self.client else {
            self.counters.dropped_detached_bytes += bytes.len() as u64;
            return Ok(0);
        };
        let accepted = client.write(bytes);
        self.counters.sent(accepted, bytes);
        Ok(accepted)
    }

    fn register(&mut self, registration: Registration) -> Result<(), PortError> {
        if let Some(old) = self.registration.take() {
            old.forget(&self.listener);
            self.client
                .iter()
                .for_each(|client| old.forget(&client.stream));
        }
        let watch = || {
            registration.watch(&self.listener, IN)?;
            let mut clients = self.client.iter();
            clients.try_for_each(|client| registration.watch(&client.stream, BOTH))
        };
        watch().map_err(|kind| PortError::new("watch", &self.path, kind))?;
        self.registration = Some(registration);
        Ok(())
    }
}

impl NetPort {
    /// `None` if the port has to be looked at again to know.
    fn next_event(&mut self, buf: &mut [u8]) -> Result<Option<Event>, PortError> {
        let Some(client) = &mut self.client else {
            return self.accept().map(Some);
        };
        client.take_ahead();
        let taken = client.take(buf);
        if taken > 0 {
            self.counters.received(taken);
            return Ok(Some(Event::Data(taken)));
        }
        // What is left of a client that is gone will not be sent.
        if client.ended {
            self.client = None;
            return Ok(Some(Event::Detached));
        }
        // One at a time: a client that comes meanwhile is closed, unless the other turns out
        // to have left, which may not be reported yet.
        if self.next.is_none() {
            let next = self.listener.accept();
            self.next = next.ok().map(|(stream, _)| (stream, Instant::now()));
        }
        match &self.next {
            None => Ok(Some(Event::Idle)),
            Some((_, came)) if came.elapsed() > LONGEST_FAREWELL => {
                self.next = None;
                Ok(None)
            }
            Some(_) => Ok(None),
        }
    }

    fn accept(&mut self) -> Result<Event, PortError> {
        loop {
            let next = match self.next.take() {
                Some((stream, _)) => Ok(stream),
                None => self.listener.accept().map(|(stream, _)| stream),
            };
            let stream = match next {
                Ok(stream) => stream,
                Err(error) if error.kind() == ErrorKind::WouldBlock => return Ok(Event::Idle),
                // Gone again, or interrupted.
                Err(error)
                    if matches!(
                        error.kind(),
                        ErrorKind::ConnectionAborted | ErrorKind::Interrupted
                    ) =>
                {
                    continue;
                }
                Err(reason) => {
                    let call = "accept";
                    let kind = PortErrorKind::System { call, reason };
                    return Err(PortError::new("serve", &self.path, kind));
                }
            };
            let Ok(client) = Connection::new(stream, self.protocol, self.baud) else {
                continue;
            };
            if let Some(registration) = &self.registration {
                registration
                    .watch(&client.stream, BOTH)
                    .map_err(|kind| PortError::new("watch", &self.path, kind))?;
            }
            self.client = Some(client);
            self.counters.attached += 1;
            return Ok(Event::Attached);
        }
    }
}

/// A client that is connected.
#[derive(Debug)]
struct Connection {
    stream: TcpStream,
    decoder: NetDecoder,
    /// Bytes for the device.
    ahead: VecDeque<u8>,
    /// Bytes that were read and the decoder has not taken.
    input: VecDeque<u8>,
    ended: bool,
}

impl Connection {
    fn new(stream: TcpStream, protocol: Protocol, baud: u32) -> std::io::Result<Self> {
        stream.set_nonblocking(true)?;
        stream.set_nodelay(true)?;
        // One that has vanished must not keep the others out for ever.
        sockopt::set_socket_keepalive(&stream, true)?;
        sockopt::set_tcp_keepidle(&stream, SILENCE)?;
        sockopt::set_tcp_keepintvl(&stream, SILENCE)?;
        sockopt::set_tcp_keepcnt(&stream, 3)?;
        let mut connection = Self {
            stream,
            decoder: NetDecoder::new(protocol, baud),
            ahead: VecDeque::new(),
            input: VecDeque::new(),
            ended: false,
        };
        connection.flush();
        Ok(connection)
    }

    /// Takes what the client has sent, as far as there is room.
    fn take_ahead(&mut self) {
        let mut buf = [0; 1024];
        self.flush();
        while !self.ended && self.ahead.len() < MOST_AHEAD {
            if self.input.is_empty() {
                match self.stream.read(&mut buf) {
                    Ok(0) => self.ended = true,
                    Ok(n) => self.input.extend(&buf[..n]),
                    Err(error) if error.kind() == ErrorKind::WouldBlock => break,
                    Err(error) if error.kind() == ErrorKind::Interrupted => {}
                    // However it ended.
                    Err(_) => self.ended = true,
                }
            }
            let consumed = self
                .decoder
                .take(self.input.make_contiguous(), &mut self.ahead);
            self.input.drain(..consumed);
            self.flush();
            if consumed == 0 && !self.input.is_empty() {
                // The client does not read the answers to what it asks.
                break;
            }
        }
        self.ended |= self.ahead.len() >= MOST_AHEAD && has_ended(&self.stream);
    }

    fn take(&mut self, buf: &mut [u8]) -> usize {
        let count = self.ahead.len().min(buf.len());
        for (place, byte) in buf.iter_mut().zip(self.ahead.drain(..count)) {
            *place = byte;
        }
        count
    }

    /// Sends what the connection takes, and says how much that was.
    fn write(&mut self, bytes: &[u8]) -> usize {
        let mut accepted = 0;
        while accepted < bytes.len() {
            let taken = self.decoder.put(&bytes[accepted..]);
            accepted += taken;
            if !self.flush() && taken == 0 {
                break;
            }
        }
        accepted
    }

    /// Sends what there is to say, as much as the connection takes; says whether it took anything.
    fn flush(&mut self) -> bool {
        // If it has failed, reading tells.
        let written = write_some(&self.stream, self.decoder.output()).unwrap_or(0);
        self.decoder.consume_output(written);
        written > 0
    }
}

/// Returns whether the client has closed its side, be there something to read before or not.
fn has_ended(stream: &TcpStream) -> bool {
    let mut fds = [PollFd::new(stream, PollFlags::RDHUP)];
    let _ = retry_on_intr(|| poll(&mut fds, Some(&Timespec::default())));
    let ends = PollFlags::RDHUP | PollFlags::HUP | PollFlags::ERR;
    fds[0].revents().intersects(ends)
}
