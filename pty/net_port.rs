//! A port that clients reach over the network: for containers and other systems, and for clients
//! that need the lines of a modem, which a pseudo-terminal does not have.
//!
//! What is connected is the far end of the cable. Bytes that a client has sent are taken ahead of
//! the line, as a bridge does, for what it says about them (purge) stands behind them in its
//! stream; they are kept here, up to a bound, beyond which the network holds them back.

use std::collections::VecDeque;
use std::fmt;
use std::io::{ErrorKind, Read as _};
use std::net::{SocketAddr, TcpListener, TcpStream, ToSocketAddrs as _};
use std::path::{Path, PathBuf};
use std::time::Duration;

use rfc2217::{FlowControl, ModemState, PortSettings, Progress, Purge, Server, ServerEvent};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::io::retry_on_intr;
use rustix::net::sockopt;

use crate::error::{PortError, PortErrorKind};
use crate::hub::{BOTH, IN, Registration};
use crate::line::{LineSettings, Parity};
use crate::port::{Counters, Event, Written};
use crate::pty_port::write_some;

/// Bytes kept ahead of the line, as many as drivers of serial ports keep.
const MOST_AHEAD: usize = 4096;
/// After so long a silence a client is asked whether it is still there.
const SILENCE: Duration = Duration::from_secs(10);

/// How bytes go over the connection.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Protocol {
    /// As they are. The client cannot set the line.
    Tcp,
    /// With the settings and lines of a serial port, RFC 2217.
    Rfc2217,
}

/// Where to listen, written `tcp://HOST:PORT` or `rfc2217://HOST:PORT`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ListenAddress {
    /// How bytes go over the connection.
    pub protocol: Protocol,
    address: String,
}

impl ListenAddress {
    /// The address that `text` is, or `None` if it is no URL of these kinds, but a path perhaps.
    ///
    /// # Errors
    ///
    /// What is missing, in words.
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

    /// Whether `path` is a URL of these kinds.
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
pub struct NetPort {
    registration: Option<Registration>,
    listener: TcpListener,
    address: ListenAddress,
    local: bool,
    path: PathBuf,
    baud: u32,
    client: Option<Connection>,
    /// Has come in the place of one whose end was not read yet.
    next: Option<TcpStream>,
    counters: Counters,
}

impl NetPort {
    /// Listens at `address`, for a device that runs at `baud`. With port 0 the system chooses one,
    /// which [`address`](Self::address) tells.
    ///
    /// # Errors
    ///
    /// When the address is not this machine's, is taken, or the system refuses.
    pub fn open(address: &ListenAddress, baud: u32) -> Result<Self, PortError> {
        let open = || -> std::io::Result<_> {
            let listener = bind(&address.address)?;
            listener.set_nonblocking(true)?;
            let local = listener.local_addr()?;
            Ok((listener, local))
        };
        let (listener, local) = open().map_err(|source| {
            let kind = match source.kind() {
                ErrorKind::AddrInUse => PortErrorKind::AddressInUse,
                ErrorKind::AddrNotAvailable => PortErrorKind::ForeignAddress,
                _ => PortErrorKind::System {
                    call: "listening",
                    source,
                },
            };
            PortError::new("serve", address.to_string(), kind)
        })?;
        let address = address.at(local);
        Ok(Self {
            registration: None,
            listener,
            local: local.ip().is_loopback(),
            path: PathBuf::from(address.to_string()),
            address,
            baud,
            client: None,
            next: None,
            counters: Counters::default(),
        })
    }

    /// Where it listens.
    #[must_use]
    pub fn address(&self) -> &ListenAddress {
        &self.address
    }

    /// Whether only this machine can connect.
    #[must_use]
    pub fn is_local(&self) -> bool {
        self.local
    }

    /// The URL that clients open.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Whether a client is connected, as far as events were reported.
    #[must_use]
    pub fn is_attached(&self) -> bool {
        self.client.is_some()
    }

    /// Totals since the port was opened.
    #[must_use]
    pub fn counters(&self) -> Counters {
        self.counters
    }

    /// The line settings that the client has asked for.
    #[must_use]
    pub fn client_line(&self) -> LineSettings {
        let asked = self.client.as_ref().map(Connection::settings);
        asked.unwrap_or(settings_of(&own_settings(self.baud)))
    }

    /// Reports the next piece of news; see [`Port::read`](crate::Port::read).
    ///
    /// # Errors
    ///
    /// When the system refuses.
    pub fn read(&mut self, buf: &mut [u8]) -> Result<Event, PortError> {
        let event = self.next_event(buf)?;
        if let Some(registration) = &self.registration {
            registration.note(event == Event::Idle);
        }
        Ok(event)
    }

    /// Sends what fits and drops the rest; see
    /// [`Port::write`](crate::Port::write).
    pub fn write(&mut self, bytes: &[u8]) -> Written {
        let Some(client) = &mut self.client else {
            self.counters.dropped_detached_bytes += bytes.len() as u64;
            return Written {
                accepted: 0,
                dropped: bytes.len(),
            };
        };
        let accepted = client.write(bytes);
        let written = Written {
            accepted,
            dropped: bytes.len() - accepted,
        };
        self.counters.written(written);
        written
    }

    pub(crate) fn register(&mut self, registration: Registration) -> Result<(), PortError> {
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

    fn next_event(&mut self, buf: &mut [u8]) -> Result<Event, PortError> {
        let Some(client) = &mut self.client else {
            return self.accept();
        };
        client.take_ahead();
        let taken = client.take(buf);
        if taken > 0 {
            self.counters.received(taken);
            return Ok(Event::Data(taken));
        }
        // What is left of a client that is gone will not be sent.
        if client.ended {
            self.client = None;
            return Ok(Event::Detached);
        }
        // One at a time: whoever comes meanwhile is told so by being let go, unless the other has left
        // since it was read.
        while let (None, Ok((stream, _))) = (&self.next, self.listener.accept()) {
            self.next = has_ended(&client.stream).then_some(stream);
        }
        match self.next {
            Some(_) => self.next_event(buf),
            None => Ok(Event::Idle),
        }
    }

    fn accept(&mut self) -> Result<Event, PortError> {
        loop {
            let next = match self.next.take() {
                Some(stream) => Ok(stream),
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
                Err(source) => {
                    let call = "accept";
                    let kind = PortErrorKind::System { call, source };
                    return Err(PortError::new("serve", &self.path, kind));
                }
            };
            let Ok(client) = Connection::new(stream, self.address.protocol, self.baud) else {
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

/// As the standard library does, but without the wait for a name server to matter more than once.
fn bind(address: &str) -> std::io::Result<TcpListener> {
    let addresses: Vec<SocketAddr> = address.to_socket_addrs()?.collect();
    TcpListener::bind(&addresses[..])
}

/// A client that is connected.
#[derive(Debug)]
struct Connection {
    stream: TcpStream,
    decoder: Decoder,
    /// Bytes for the device.
    ahead: VecDeque<u8>,
    /// What was read and the decoder has not taken.
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
            decoder: Decoder::new(protocol, baud),
            ahead: VecDeque::new(),
            input: VecDeque::new(),
            ended: false,
        };
        connection.flush();
        Ok(connection)
    }

    fn settings(&self) -> LineSettings {
        settings_of(&self.decoder.settings)
    }

    /// Takes what the client has sent, as far as there is room.
    fn take_ahead(&mut self) {
        let mut buf = [0; 1024];
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
        let Some(server) = &mut self.decoder.server else {
            // If it has failed, reading tells.
            return write_some(&self.stream, bytes).unwrap_or(0);
        };
        let mut accepted = 0;
        while accepted < bytes.len() {
            // With flow suspended by the client, nothing.
            let taken = server.try_write_data(&bytes[accepted..]).unwrap_or(0);
            accepted += taken;
            let written = write_some(&self.stream, server.output()).unwrap_or(0);
            server.consume_output(written);
            if taken == 0 && written == 0 {
                break;
            }
        }
        accepted
    }

    /// Sends what the protocol has to say.
    fn flush(&mut self) {
        if let Some(server) = &mut self.decoder.server
            && server.has_output()
        {
            let written = write_some(&self.stream, server.output()).unwrap_or(0);
            server.consume_output(written);
        }
    }
}

/// Whether the client has closed its side, be there something to read before or not.
fn has_ended(stream: &TcpStream) -> bool {
    let mut fds = [PollFd::new(stream, PollFlags::RDHUP)];
    let _ = retry_on_intr(|| poll(&mut fds, Some(&Timespec::default())));
    let ends = PollFlags::RDHUP | PollFlags::HUP | PollFlags::ERR;
    fds[0].revents().intersects(ends)
}

/// What a client says: bytes for the device, and with RFC 2217 settings and lines.
#[derive(Debug)]
struct Decoder {
    /// `None` where all are bytes for the device.
    server: Option<Server>,
    settings: PortSettings,
    lines: ModemState,
}

impl Decoder {
    fn new(protocol: Protocol, baud: u32) -> Self {
        let settings = own_settings(baud);
        let mut decoder = Self {
            server: (protocol == Protocol::Rfc2217)
                .then(|| Server::new(settings).with_signature("sim")),
            settings,
            lines: ModemState::DSR | ModemState::CD | ModemState::CTS,
        };
        decoder.tell_lines();
        decoder
    }

    /// Takes of `input` what there is room for; says how much.
    fn take(&mut self, input: &[u8], ahead: &mut VecDeque<u8>) -> usize {
        let room = MOST_AHEAD.saturating_sub(ahead.len());
        let Some(server) = &mut self.server else {
            let count = input.len().min(room);
            ahead.extend(&input[..count]);
            return count;
        };
        let mut payload = [0; 256];
        let most = room.min(payload.len());
        let Progress {
            consumed,
            payload_len,
            ..
        } = server.receive_into(input, &mut payload[..most]);
        ahead.extend(&payload[..payload_len]);
        while let Some(event) = self.server.as_mut().and_then(Server::poll_event) {
            self.act(&event, ahead);
        }
        consumed
    }

    fn act(&mut self, event: &ServerEvent, ahead: &mut VecDeque<u8>) {
        match event {
            ServerEvent::SettingsChanged(settings) => self.settings = *settings,
            ServerEvent::Purge(Purge::Transmit | Purge::Both) => ahead.clear(),
            // A receiver takes a line that stays low for a byte 0 whose stop bit is wrong.
            ServerEvent::Break(true) => ahead.push_back(0),
            // As in many a plug, what the client drives is led back to it.
            ServerEvent::Dtr(on) => self.set_lines(ModemState::DSR | ModemState::CD, *on),
            ServerEvent::Rts(on) => self.set_lines(ModemState::CTS, *on),
            _ => {}
        }
    }

    fn set_lines(&mut self, lines: ModemState, on: bool) {
        let others = self.lines.bits() & !lines.bits();
        let driven = if on { lines.bits() } else { 0 };
        self.lines = ModemState::from_bits(others | driven);
        self.tell_lines();
    }

    fn tell_lines(&mut self) {
        if let Some(server) = &mut self.server {
            // Where there is no room to tell it, the client does not read and can ask later.
            let _ = server.try_set_modem_state(self.lines);
        }
    }
}

fn own_settings(baud: u32) -> PortSettings {
    PortSettings {
        baud_rate: baud,
        ..PortSettings::default()
    }
}

fn settings_of(asked: &PortSettings) -> LineSettings {
    LineSettings {
        baud: asked.baud_rate,
        data_bits: match asked.data_bits {
            rfc2217::DataBits::Five => 5,
            rfc2217::DataBits::Six => 6,
            rfc2217::DataBits::Seven => 7,
            _ => 8,
        },
        parity: match asked.parity {
            rfc2217::Parity::None => Parity::None,
            rfc2217::Parity::Even => Parity::Even,
            _ => Parity::Odd,
        },
        stop_bits: match asked.stop_bits {
            rfc2217::StopBits::One => 1,
            _ => 2,
        },
        rts_cts: asked.flow_control == FlowControl::RtsCts,
        raw: true,
    }
}
