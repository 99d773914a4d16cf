use std::time::Duration;

use rigsim_settings::SimTime;

use super::Adapter;
use crate::line::{ClientLine, SerialLine, UART_FIFO, Wire};
use crate::uart;

const BAUD: u32 = 115_200;

fn line(adapter: Adapter) -> SerialLine {
    let mut line = SerialLine::new(BAUD, Wire::Paced, adapter);
    line.attach(SimTime::ZERO);
    line
}

/// The reads of a client that reads whenever it can: time in µs and number of bytes.
fn reads(line: &mut SerialLine) -> Vec<(u64, usize)> {
    let mut reads = Vec::new();
    while let Some(at) = line.next_for_client() {
        let mut bytes = Vec::new();
        line.take_for_client(at, &mut bytes);
        if !bytes.is_empty() {
            reads.push((at.as_nanos() / 1000, bytes.len()));
        }
    }
    reads
}

fn reply(adapter: Adapter, at: u64, bytes: usize) -> Vec<(u64, usize)> {
    let mut line = line(adapter);
    assert_eq!(
        line.device_sends(SimTime::from_micros(at), &vec![7; bytes]),
        None
    );
    reads(&mut line)
}

#[test]
fn a_reply_comes_in_the_pieces_of_each_adapter() {
    // A byte takes 86.8 µs: twenty end at 1,736 µs.
    assert_eq!(reply(Adapter::Usb, 0, 20), [(1000, 11), (2000, 9)]);
    assert_eq!(reply(Adapter::Usb, 990, 1), [(2000, 1)]);
    let silence = (20 + 4) * 86_806 / 1000;
    assert_eq!(
        reply(Adapter::Uart, 0, 20),
        [(694, 8), (1388, 8), (silence, 4)]
    );
    assert_eq!(reply(Adapter::Bytes, 0, 20).len(), 20);
    // 62 bytes end at 5,382 µs, and the timer begins again in the next frame.
    assert_eq!(reply(Adapter::Ftdi, 0, 70), [(6000, 69), (22_000, 1)]);
    assert_eq!(reply(Adapter::Ftdi, 40_000, 5), [(48_000, 5)]);
}

#[test]
fn a_byte_that_ends_with_a_frame_is_in_it() {
    let mut line = SerialLine::new(10_000, Wire::Paced, Adapter::Usb);
    line.attach(SimTime::ZERO);
    line.set_client_line(SimTime::ZERO, ClientLine::at(10_000));
    line.device_sends(SimTime::ZERO, &[1, 2]);
    assert_eq!(reads(&mut line), [(1000, 1), (2000, 1)]);
}

#[test]
fn what_a_client_sends_begins_its_way_with_the_next_frame() {
    let byte = uart::byte_time(BAUD, 1);
    for adapter in Adapter::ALL {
        let mut line = line(adapter);
        let begins = match adapter {
            Adapter::Usb | Adapter::Ftdi => SimTime::from_millis(1),
            Adapter::Uart | Adapter::Bytes => SimTime::from_micros(300),
        };
        line.client_sends(SimTime::from_micros(300), &[1]);
        assert_eq!(line.next_for_device(), Some(begins + byte), "{adapter}");
        // At whole milliseconds it waits for nothing.
        line.client_sends(SimTime::from_millis(1), &[2]);
        let second = SimTime::from_millis(1).max(begins + byte);
        assert_eq!(line.take_for_device(begins + byte), Some(1));
        assert_eq!(line.next_for_device(), Some(second + byte), "{adapter}");
    }
}

#[test]
fn a_speed_that_changes_before_the_frame_spoils_nothing() {
    let mut line = line(Adapter::Usb);
    let at = SimTime::from_micros(300);
    line.set_client_line(at, ClientLine::at(9600));
    line.client_sends(at, &[1]);
    line.set_client_line(SimTime::from_micros(600), ClientLine::at(BAUD));
    let arrives = SimTime::from_millis(1) + uart::byte_time(BAUD, 1);
    assert_eq!(line.next_for_device(), Some(arrives));
    assert_eq!(line.take_for_device(arrives), Some(1));
}

#[test]
fn an_adapter_takes_its_buffer_and_sixteen_bytes_go_out_when_its_client_leaves() {
    for adapter in Adapter::ALL {
        let mut line = line(adapter);
        let buffer = match adapter {
            Adapter::Usb | Adapter::Ftdi => 128,
            Adapter::Uart | Adapter::Bytes => UART_FIFO,
        };
        assert_eq!(line.room(), 1 + buffer);
        line.client_sends(SimTime::ZERO, &[9; 300]);
        line.detach(SimTime::ZERO);
        let later = SimTime::from_secs(1);
        let sent = std::iter::from_fn(|| line.take_for_device(later)).count();
        assert_eq!(sent, 1 + UART_FIFO, "{adapter}");
    }
}

#[test]
fn what_an_adapter_holds_is_not_for_the_next_client() {
    let mut line = line(Adapter::Ftdi);
    line.device_sends(SimTime::ZERO, &[1, 2, 3]);
    let mut read = Vec::new();
    line.take_for_client(SimTime::from_millis(2), &mut read);
    assert!(read.is_empty());
    line.detach(SimTime::from_millis(3));
    line.attach(SimTime::from_millis(4));
    line.take_for_client(SimTime::from_secs(1), &mut read);
    assert!(read.is_empty());
}

#[test]
fn when_a_client_looks_does_not_change_when_bytes_come() {
    for adapter in Adapter::ALL {
        for look in [50, 86, 333, 1000] {
            let mut line = line(adapter);
            line.device_sends(SimTime::ZERO, &[7; 100]);
            let whole = reads(&mut line.clone());
            let mut now = SimTime::ZERO;
            let mut found = 0;
            while now < SimTime::from_millis(40) {
                let mut bytes = Vec::new();
                line.take_for_client(now, &mut bytes);
                found += bytes.len();
                let there = whole.iter().filter(|(at, _)| *at * 1000 <= now.as_nanos());
                // A read's time is cut to whole microseconds.
                let before = whole
                    .iter()
                    .filter(|(at, _)| (*at + 1) * 1000 <= now.as_nanos());
                let most: usize = there.map(|(_, count)| count).sum();
                let least: usize = before.map(|(_, count)| count).sum();
                assert!((least..=most).contains(&found), "{adapter} {look} {now}");
                now += Duration::from_micros(look);
            }
            assert_eq!(found, 100);
        }
    }
}

#[test]
fn an_instant_wire_has_no_adapter() {
    let mut line = SerialLine::new(BAUD, Wire::Instant, Adapter::Ftdi);
    line.attach(SimTime::ZERO);
    line.device_sends(SimTime::from_micros(300), &[1, 2]);
    assert_eq!(reads(&mut line), [(300, 2)]);
}
