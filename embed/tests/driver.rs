//! A test of a client, as an owner of a driver for the R150 writes it: it takes a serial port, and
//! here gets one that needs no vehicle. The driver's first version works on a good day; the simulation
//! shows in milliseconds what it does when a byte of a reply is lost.

#![expect(clippy::unwrap_used, reason = "a test")]

use std::io::{self, ErrorKind};
use std::time::Duration;

use rigsim_embed::Simulation;
use serialport::{ClearBuffer, SerialPort};

const VERSION: [u8; 6] = [0xAA, 0x55, 0x00, 0xF0, 0xF7, 0x07];
const HEADER: [u8; 4] = [0xAA, 0x55, 0x08, 0xF0];
/// Header, length and command, both versions, CRC.
const REPLY: usize = 14;

/// Asks the module for its software version.
trait Driver {
    fn version(&mut self) -> io::Result<[u8; 4]>;
}

/// The first version: it collects bytes, and the next fourteen are a reply.
struct Hopeful(Box<dyn SerialPort>, Vec<u8>);

impl Driver for Hopeful {
    fn version(&mut self) -> io::Result<[u8; 4]> {
        self.0.write_all(&VERSION)?;
        while self.1.len() < REPLY {
            let mut some = [0; 64];
            let count = self.0.read(&mut some)?;
            self.1.extend(&some[..count]);
        }
        let reply: Vec<u8> = self.1.drain(..REPLY).collect();
        Ok([reply[8], reply[9], reply[10], reply[11]])
    }
}

/// The second: what is left of a reply is not taken for the next one, and a lost reply is asked for
/// again.
struct Careful(Box<dyn SerialPort>);

impl Driver for Careful {
    fn version(&mut self) -> io::Result<[u8; 4]> {
        for _ in 0..20 {
            self.0.clear(ClearBuffer::Input)?;
            self.0.write_all(&VERSION)?;
            let mut reply = [0; REPLY];
            match self.0.read_exact(&mut reply) {
                Ok(()) if reply[..4] == HEADER => {
                    return Ok([reply[8], reply[9], reply[10], reply[11]]);
                }
                Ok(()) => {}
                Err(error) if error.kind() == ErrorKind::TimedOut => {}
                Err(error) => return Err(error),
            }
        }
        Err(ErrorKind::TimedOut.into())
    }
}

/// What a driver reads a hundred times while one byte in twenty is lost, in some fifteen simulated
/// seconds.
fn hundred_versions(
    driver: fn(Box<dyn SerialPort>) -> Box<dyn Driver>,
) -> Vec<io::Result<[u8; 4]>> {
    let sim = Simulation::of("r150").unwrap();
    let r150 = sim.device("r150").unwrap();
    let mut port = r150.open().unwrap();
    port.set_timeout(Duration::from_millis(100)).unwrap();
    let mut driver = driver(Box::new(port));
    let good = driver.version().unwrap();
    let lost = r150.fault(r#"kind = "dropped-bytes", probability = 0.05, direction = "to-client""#);
    let lost = lost.unwrap();
    let mut found: Vec<_> = (0..100).map(|_| driver.version()).collect();
    assert!(lost.hits() > 10);
    found.retain(|version| !version.as_ref().is_ok_and(|version| *version == good));
    found
}

#[test]
fn the_hopeful_driver_takes_the_end_of_one_reply_for_the_beginning_of_the_next() {
    let wrong = hundred_versions(|port| Box::new(Hopeful(port, Vec::new())));
    let versions: Vec<[u8; 4]> = wrong.into_iter().flatten().collect();
    assert!(!versions.is_empty());
}

#[test]
fn the_careful_driver_reads_the_right_version_every_time() {
    let wrong = hundred_versions(|port| Box::new(Careful(port)));
    assert!(wrong.is_empty(), "{wrong:?}");
}
