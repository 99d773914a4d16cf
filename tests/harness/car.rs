//! Clients of the mecanum car's two links, written from the article and sharing no code with the
//! program under test.

use std::io::{ErrorKind, Read as _, Write as _};
use std::path::Path;
use std::time::{Duration, Instant};

use serialport::{SerialPort as _, TTYPort};

use super::client::Client;
use super::wire::{i16_at, u32_at};
use super::{PATIENCE, until};

/// Values of `moving_idx`.
pub const FORWARD: u8 = 0;
pub const STRAFE: u8 = 2;

/// A status packet, in the article's units.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Status {
    pub seq: u8,
    pub v: [i16; 2],
    pub axis: [i16; 2],
    pub ori: i16,
    pub rfid: u32,
    pub magn: u16,
    pub infra: u8,
    pub ut_f: [u16; 4],
    pub ut_b: [u16; 4],
    pub moto_state: u8,
    pub mile: u16,
}

impl Status {
    const LENGTH: usize = 39;

    fn decode(bytes: &[u8]) -> Self {
        let u16_at = |at| i16_at(bytes, at).cast_unsigned();
        assert_eq!(bytes[..2], [0, 39], "not a status packet: {bytes:02X?}");
        Self {
            seq: bytes[2],
            v: [3, 5].map(|at| i16_at(bytes, at)),
            axis: [7, 9].map(|at| i16_at(bytes, at)),
            ori: i16_at(bytes, 11),
            rfid: u32_at(bytes, 13),
            magn: u16_at(17),
            infra: bytes[19],
            ut_f: [20, 22, 24, 26].map(u16_at),
            ut_b: [28, 30, 32, 34].map(u16_at),
            moto_state: bytes[36],
            mile: u16_at(37),
        }
    }
}

/// A motion packet that preempts: distance in 1/10 revolution, speed in 1/10 r/min.
pub fn motion(moving_idx: u8, s: u16, v: i16) -> Vec<u8> {
    let mut bytes = vec![0, 9, 0, 1, moving_idx];
    bytes.extend(s.to_le_bytes());
    bytes.extend(v.to_le_bytes());
    bytes
}

/// The on-board Android's end of the main link.
pub struct MainClient(Stream);

impl MainClient {
    pub fn open(path: &Path) -> Self {
        Self(Stream::open(path, 115_200))
    }

    pub fn send(&mut self, bytes: &[u8]) {
        self.0.send(bytes);
    }

    /// The next status packet. The first may have begun before this client was there; from then on
    /// anything but one packet after the other is a failure.
    pub fn status(&mut self) -> Status {
        let stream = &mut self.0;
        stream.fill(Status::LENGTH);
        while !stream.synchronised && stream.unread[..2] != [0, 39] {
            stream.unread.remove(0);
            stream.fill(Status::LENGTH);
        }
        stream.synchronised = true;
        let packet: Vec<u8> = stream.unread.drain(..Status::LENGTH).collect();
        Status::decode(&packet)
    }

    /// Waits until a motion has begun and ended.
    pub fn finish(&mut self) -> Status {
        let start = Instant::now();
        let mut begun = false;
        loop {
            let status = self.status();
            if begun && status.moto_state == 0 {
                return status;
            }
            begun |= status.moto_state != 0;
            assert!(start.elapsed() < PATIENCE, "no end of it: {status:?}");
        }
    }
}

/// The external computer's end of the ROS link.
pub struct RosClient(Stream);

impl RosClient {
    pub fn open(path: &Path) -> Self {
        Self(Stream::open(path, 9600))
    }

    pub fn send(&mut self, line: &str) {
        self.0.send(line.as_bytes());
    }

    /// The next report: speed in 1/100 revolution a second, mileage in 1/100 revolution. The first
    /// line may have begun before this client was there; anything else that is not a report is a
    /// failure.
    pub fn report(&mut self) -> (i64, i64) {
        if !self.0.synchronised {
            self.line();
            self.0.synchronised = true;
        }
        let line = self.line();
        let number = |word: &str, letter| word.strip_prefix(letter)?.parse::<i64>().ok();
        let read = |line: &str| {
            let (speed, mileage) = line.strip_suffix(" \n")?.split_once(' ')?;
            Some((number(speed, 'V')?, number(mileage, 'S')?))
        };
        read(&line).unwrap_or_else(|| panic!("not a report: {line:?}"))
    }

    fn line(&mut self) -> String {
        let mut length = 0;
        loop {
            length += 1;
            self.0.fill(length);
            if self.0.unread[length - 1] == b'\n' {
                let line = self.0.unread.drain(..length).collect();
                return String::from_utf8(line).expect("a line is text");
            }
        }
    }
}

/// A port and what has come through it.
struct Stream {
    port: TTYPort,
    unread: Vec<u8>,
    /// Where the next packet or line begins is known.
    synchronised: bool,
}

impl Stream {
    fn open(path: &Path, baud: u32) -> Self {
        let mut port = None;
        // The client before this one may keep others out for a moment.
        until("the port can be opened", || {
            port = Client::try_open(path, baud).ok();
            port.is_some()
        });
        let mut port = port.unwrap();
        port.set_timeout(Duration::from_millis(100)).unwrap();
        Self {
            port,
            unread: Vec::new(),
            synchronised: false,
        }
    }

    fn send(&mut self, bytes: &[u8]) {
        self.port.write_all(bytes).expect("the client can write");
    }

    /// Waits until so many bytes are there.
    fn fill(&mut self, length: usize) {
        let start = Instant::now();
        let mut bytes = [0; 256];
        while self.unread.len() < length {
            assert!(start.elapsed() < PATIENCE, "nothing more comes");
            match self.port.read(&mut bytes) {
                Ok(count) => self.unread.extend(&bytes[..count]),
                Err(error) if error.kind() == ErrorKind::TimedOut => {}
                Err(error) => panic!("the client cannot read: {error}"),
            }
        }
    }
}
