//! The same with tokio on two threads: whatever comes first, bytes or the time to drive.
use std::time::Duration;

use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::time::{Instant, interval, sleep};
use tokio_serial::{SerialPortBuilderExt, SerialStream};

const MOTORS: [u8; 10] = [0xAA, 0x55, 4, 0x12, 0x2C, 1, 0x2C, 1, 0x1E, 0xB4];
const JOB: Duration = Duration::from_millis(2500);

#[tokio::main(worker_threads = 2)]
async fn main() {
    // The port is another task's than the one that begins.
    tokio::spawn(work(Instant::now())).await.unwrap();
}

async fn work(start: Instant) {
    let path = std::env::var("SIM_R150_PORT").unwrap();
    let mut bytes = 0;
    let mut back = false;
    while start.elapsed() < JOB {
        let Ok(mut port) = tokio_serial::new(&path, 115_200).open_native_async() else {
            sleep(Duration::from_millis(30)).await;
            continue;
        };
        if back {
            println!("came back at {:?}", start.elapsed());
        }
        back = true;
        bytes += drive(&mut port, start).await;
    }
    println!("processors {}", std::thread::available_parallelism().unwrap());
    println!("bytes {bytes}");
}

/// Until the job is done or the cable is pulled; how much was heard.
async fn drive(port: &mut SerialStream, start: Instant) -> usize {
    let mut ticks = interval(Duration::from_millis(100));
    let mut buffer = [0; 64];
    let mut bytes = 0;
    while start.elapsed() < JOB {
        tokio::select! {
            heard = port.read(&mut buffer) => match heard {
                Ok(count) if count > 0 => bytes += count,
                _ => break,
            },
            _ = ticks.tick() => if port.write_all(&MOTORS).await.is_err() {
                break;
            },
        }
    }
    bytes
}
