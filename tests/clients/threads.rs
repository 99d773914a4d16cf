//! Drives with one thread, listens with another; a channel with a timeout reports the loss.
use std::fs::{File, OpenOptions};
use std::io::{Read, Write};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::time::{Duration, Instant};

const MOTORS: [u8; 10] = [0xAA, 0x55, 4, 0x12, 0x2C, 1, 0x2C, 1, 0x1E, 0xB4];

fn connect() -> File {
    let path = std::env::var_os("SIM_R150_PORT").unwrap();
    loop {
        if let Ok(port) = OpenOptions::new().read(true).write(true).open(&path) {
            return port;
        }
        std::thread::sleep(Duration::from_millis(30));
    }
}

fn main() {
    let start = Instant::now();
    let mut bytes = 0;
    let mut back = false;
    'ports: while start.elapsed() < Duration::from_millis(2500) {
        let mut port = connect();
        if back {
            println!("came back at {:?}", start.elapsed());
        }
        back = true;
        let (sender, receiver) = channel();
        let mut reading = port.try_clone().unwrap();
        std::thread::spawn(move || {
            let mut buffer = [0; 64];
            loop {
                match reading.read(&mut buffer) {
                    Ok(count) if count > 0 => sender.send(count).unwrap_or_default(),
                    _ => return,
                }
            }
        });
        let mut next = Instant::now();
        while start.elapsed() < Duration::from_millis(2500) {
            if Instant::now() >= next {
                if port.write_all(&MOTORS).is_err() {
                    continue 'ports;
                }
                next += Duration::from_millis(100);
            }
            match receiver.recv_timeout(next - Instant::now()) {
                Ok(count) => bytes += count,
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => continue 'ports,
            }
        }
    }
    println!("processors {}", std::thread::available_parallelism().unwrap());
    println!("bytes {bytes}");
}
