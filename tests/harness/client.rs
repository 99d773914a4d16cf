//! A client as users write them, on the `serialport` crate.

use std::io::{ErrorKind, Read as _, Write as _};
use std::path::Path;
use std::time::{Duration, Instant};

use serialport::{SerialPort as _, TTYPort};

use super::wire::{Parsed, frame, parse};
use super::{PATIENCE, until};

/// Speed of the R150's line.
pub const BAUD: u32 = 115_200;

/// A reply's command and parameters.
pub type Reply = (u8, Vec<u8>);

/// A program that talks to the module.
pub struct Client {
    port: TTYPort,
    unread: Vec<u8>,
}

impl Client {
    /// Opens the port at the right speed.
    pub fn open(path: &Path) -> Self {
        Self::open_at(path, BAUD)
    }

    /// Opens the port at any speed.
    pub fn open_at(path: &Path, baud: u32) -> Self {
        let mut port = Err(serialport::Error::new(serialport::ErrorKind::Unknown, ""));
        // The crate opens exclusively, and unless root runs the tests, the client before this one
        // keeps others out until the simulator has noticed that it is gone.
        until("the port can be opened", || {
            port = Self::try_open(path, baud);
            port.is_ok()
        });
        Self::over(port.unwrap())
    }

    /// Opens the port if that is possible now.
    pub fn try_open(path: &Path, baud: u32) -> serialport::Result<TTYPort> {
        serialport::new(path.to_string_lossy(), baud).open_native()
    }

    /// Talks over a port that is open.
    pub fn over(port: TTYPort) -> Self {
        Self {
            port,
            unread: Vec::new(),
        }
    }

    /// Sends bytes as they are.
    pub fn send(&mut self, bytes: &[u8]) {
        self.port.set_timeout(PATIENCE).unwrap();
        self.port.write_all(bytes).expect("the client can write");
    }

    /// Sends what fits, and says how much that was.
    pub fn send_some(&mut self, bytes: &[u8]) -> usize {
        // The shortest time in which the crate looks at all.
        self.port.set_timeout(Duration::from_millis(1)).unwrap();
        match self.port.write(bytes) {
            Ok(count) => count,
            Err(error) if error.kind() == ErrorKind::TimedOut => 0,
            Err(error) => panic!("the client cannot write: {error}"),
        }
    }

    /// The next reply, if it begins within `patience`. Anything but a valid frame is a failure.
    pub fn receive_within(&mut self, patience: Duration) -> Option<Reply> {
        let start = Instant::now();
        loop {
            match parse(&self.unread) {
                Parsed::Frame(command, parameters, length) => {
                    self.unread.drain(..length);
                    return Some((command, parameters));
                }
                Parsed::Invalid => panic!("not a frame: {:02X?}", self.unread),
                Parsed::Partial => {}
            }
            // What has begun must end, however slow the machine is.
            let patience = if self.unread.is_empty() {
                patience
            } else {
                PATIENCE
            };
            let left = patience.checked_sub(start.elapsed())?;
            let new = self.read_some(left);
            self.unread.extend(new);
        }
    }

    /// The next reply, which must come.
    pub fn receive(&mut self) -> Reply {
        self.receive_within(PATIENCE).expect("a reply comes")
    }

    /// Sends a request; the very next reply must be to it.
    pub fn ask(&mut self, command: u8, parameters: &[u8]) -> Vec<u8> {
        self.send(&frame(command, parameters));
        let (answered, reply) = self.receive();
        assert_eq!(answered, command, "{reply:02X?} is not the reply");
        reply
    }

    /// Nothing that came before was answered: the reply to a heartbeat is the next.
    pub fn expect_silence_until_heartbeat(&mut self) {
        assert_eq!(self.ask(0x07, &[]), [1]);
    }

    /// Throws away what has come, as `reset_input_buffer` of pyserial does.
    pub fn reset_input(&mut self) {
        self.port.clear(serialport::ClearBuffer::Input).unwrap();
        self.unread.clear();
    }

    /// Throws away what has come until a valid reply to `command` stands in the stream, if that
    /// comes within `patience`. It may stand behind the beginning of a reply to another client.
    pub fn skip_to(&mut self, command: u8, patience: Duration) -> Option<Vec<u8>> {
        let start = Instant::now();
        loop {
            match parse(&self.unread) {
                Parsed::Frame(found, parameters, length) => {
                    self.unread.drain(..length);
                    if found == command {
                        return Some(parameters);
                    }
                    continue;
                }
                Parsed::Invalid => {
                    self.unread.remove(0);
                    continue;
                }
                Parsed::Partial => {}
            }
            let is_reply = |at: &usize| matches!(parse(&self.unread[*at..]), Parsed::Frame(found, ..) if found == command);
            if let Some(at) = (1..self.unread.len()).find(is_reply) {
                self.unread.drain(..at);
                continue;
            }
            let left = patience.checked_sub(start.elapsed())?;
            let new = self.read_some(left);
            self.unread.extend(new);
        }
    }

    /// The next bytes, so many of them.
    pub fn read_count(&mut self, count: usize) -> Vec<u8> {
        let mut bytes = vec![0; count];
        self.port.set_timeout(PATIENCE).unwrap();
        self.port.read_exact(&mut bytes).expect("they come");
        bytes
    }

    /// Whatever arrives within this time.
    pub fn read_for(&mut self, time: Duration) -> Vec<u8> {
        let start = Instant::now();
        let mut bytes = std::mem::take(&mut self.unread);
        while let Some(left) = time.checked_sub(start.elapsed()) {
            bytes.extend(self.read_some(left));
        }
        bytes
    }

    /// Bytes as soon as there are any, or none after `patience`.
    fn read_some(&mut self, patience: Duration) -> Vec<u8> {
        // The crate waits in whole milliseconds.
        let timeout = patience.max(Duration::from_millis(1));
        self.port.set_timeout(timeout).unwrap();
        let mut bytes = [0; 4096];
        match self.port.read(&mut bytes) {
            Ok(count) => bytes[..count].to_vec(),
            Err(error) if error.kind() == ErrorKind::TimedOut => Vec::new(),
            Err(error) => panic!("the client cannot read: {error}"),
        }
    }
}
