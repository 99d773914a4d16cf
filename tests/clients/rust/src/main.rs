//! Clients on `serialport`, `serial2` and `tokio-serial`: session KIND PORT

use std::io::{Read, Write};
use std::thread::sleep;
use std::time::Duration;

const SECONDS_5: Duration = Duration::from_secs(5);

fn frame(command: u8, parameters: &[u8]) -> Vec<u8> {
    let body = [&[command], parameters].concat();
    let crc = body.iter().fold(0xFFFF_u16, |crc, byte| {
        (0..8).fold(crc ^ u16::from(*byte), |crc, _| {
            crc >> 1 ^ if crc & 1 == 1 { 0x8408 } else { 0 }
        })
    });
    let length = u8::try_from(parameters.len()).unwrap();
    [&[0xAA, 0x55, length], &body[..], &(!crc).to_le_bytes()].concat()
}

fn ask(port: &mut (impl Read + Write), request: &[u8], length: usize) {
    port.write_all(request).unwrap();
    let mut reply = vec![0; length];
    port.read_exact(&mut reply).unwrap();
    assert_eq!((reply[0], reply[3]), (0xAA, request[3]), "{reply:02X?}");
}

fn drive(port: &mut (impl Read + Write)) {
    ask(port, &frame(0xF0, &[]), 14);
    for _ in 0..3 {
        ask(port, &frame(0x12, &[200, 0, 200, 0]), 14);
        sleep(Duration::from_millis(60));
    }
    ask(port, &frame(0x12, &[0; 4]), 14);
}

fn with_serialport(path: &str) {
    use serialport::{ClearBuffer, SerialPort};
    let mut port = serialport::new(path, 115_200).timeout(SECONDS_5).open_native().unwrap();
    drive(&mut port);
    port.set_baud_rate(9_600).unwrap();
    port.write_all(&frame(0xF0, &[])).unwrap();
    sleep(Duration::from_millis(200));
    port.set_baud_rate(115_200).unwrap();
    sleep(Duration::from_millis(100));
    port.clear(ClearBuffer::All).unwrap();
    ask(&mut port, &frame(0xF0, &[]), 14);
}

fn with_serial2(path: &str) {
    use serial2::{Settings, SerialPort};
    let at = |baud| {
        move |mut settings: Settings| {
            settings.set_raw();
            settings.set_baud_rate(baud)?;
            Ok(settings)
        }
    };
    let mut port = SerialPort::open(path, at(115_200)).unwrap();
    port.set_read_timeout(SECONDS_5).unwrap();
    drive(&mut port);
    let mut settings = port.get_configuration().unwrap();
    settings.set_baud_rate(9_600).unwrap();
    port.set_configuration(&settings).unwrap();
    port.write_all(&frame(0xF0, &[])).unwrap();
    sleep(Duration::from_millis(200));
    settings.set_baud_rate(115_200).unwrap();
    port.set_configuration(&settings).unwrap();
    sleep(Duration::from_millis(100));
    port.discard_buffers().unwrap();
    ask(&mut port, &frame(0xF0, &[]), 14);
}

async fn with_tokio(path: &str) {
    use tokio::io::{AsyncReadExt, AsyncWriteExt};
    use tokio_serial::SerialPortBuilderExt as _;
    use tokio_serial::{ClearBuffer, SerialPort as _};
    let mut port = tokio_serial::new(path, 115_200).open_native_async().unwrap();
    let version = frame(0xF0, &[]);
    let drive = frame(0x12, &[200, 0, 200, 0]);
    let stop = frame(0x12, &[0; 4]);
    for (at, request) in [&version, &drive, &drive, &stop, &version].into_iter().enumerate() {
        if at == 4 {
            port.set_baud_rate(9_600).unwrap();
            AsyncWriteExt::write_all(&mut port, request).await.unwrap();
            tokio::time::sleep(Duration::from_millis(200)).await;
            port.set_baud_rate(115_200).unwrap();
            tokio::time::sleep(Duration::from_millis(100)).await;
            port.clear(ClearBuffer::All).unwrap();
        }
        AsyncWriteExt::write_all(&mut port, request).await.unwrap();
        let mut reply = [0; 14];
        let read = AsyncReadExt::read_exact(&mut port, &mut reply);
        tokio::time::timeout(SECONDS_5, read).await.unwrap().unwrap();
        assert_eq!((reply[0], reply[3]), (0xAA, request[3]), "{reply:02X?}");
        tokio::time::sleep(Duration::from_millis(60)).await;
    }
}

fn main() {
    let arguments: Vec<String> = std::env::args().collect();
    let [_, kind, path] = &arguments[..] else {
        panic!("session serialport|serial2|tokio PORT");
    };
    for _ in 0..2 {
        match kind.as_str() {
            "serialport" => with_serialport(path),
            "serial2" => with_serial2(path),
            "tokio" => {
                let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build();
                runtime.unwrap().block_on(with_tokio(path));
            }
            other => panic!("{other}?"),
        }
    }
}
