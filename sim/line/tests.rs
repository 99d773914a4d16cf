use proptest::prelude::*;

use super::*;
use std::time::Duration;

use crate::uart;

fn arrivals(line: &mut SerialLine) -> Vec<(u64, u8)> {
    let mut found = Vec::new();
    while let Some(at) = line.next_for_device() {
        assert_eq!(line.take_for_device(at - Duration::from_nanos(1)), None);
        // What is sent at another speed may be nothing at the receiver.
        if let Some(byte) = line.take_for_device(at) {
            found.push((at.as_nanos(), byte));
        }
    }
    found
}

#[test]
fn bytes_take_ten_bits_each_and_queue_behind_one_another() {
    let mut line = SerialLine::new(115_200, Wire::Paced, Adapter::Bytes);
    line.client_sends(SimTime::ZERO, &[1, 2]);
    line.client_sends(SimTime::from_micros(10), &[3]);
    assert_eq!(
        arrivals(&mut line),
        [(86_806, 1), (173_612, 2), (260_418, 3)]
    );
}

#[test]
fn an_instant_wire_takes_no_time() {
    let mut line = SerialLine::new(115_200, Wire::Instant, Adapter::Bytes);
    line.client_sends(SimTime::from_millis(1), &[1, 2]);
    assert_eq!(arrivals(&mut line), [(1_000_000, 1), (1_000_000, 2)]);
}

#[test]
fn a_baud_mismatch_is_reported_once_for_each_speed_and_its_end_too() {
    let mut line = SerialLine::new(115_200, Wire::Paced, Adapter::Bytes);
    line.attach(SimTime::ZERO);
    let reported = event::baud_mismatch(9600, 115_200);
    let matched = event::baud_matched(115_200);
    let mut set = |baud| {
        let set = line.set_client_line(SimTime::ZERO, ClientLine::at(baud));
        (set, line.client_sends(SimTime::ZERO, &[0xAA]))
    };
    assert_eq!(set(9600), (None, vec![reported]));
    assert_eq!(set(9600), (None, vec![]));
    assert_eq!(set(115_200), (Some(matched), vec![]));
    assert_eq!(set(19_200).1.len(), 1);
    assert_eq!(set(38_400).1.len(), 1);
}

#[test]
fn a_port_that_echoes_or_sends_two_stop_bits_is_reported_once_for_each_client() {
    let mut line = SerialLine::new(115_200, Wire::Paced, Adapter::Bytes);
    for _ in 0..2 {
        line.attach(SimTime::ZERO);
        let good = ClientLine::at(115_200);
        line.set_client_line(SimTime::ZERO, ClientLine { raw: false, ..good });
        let reported = line.client_sends(SimTime::ZERO, &[0xAA]);
        assert_eq!(reported, [event::not_raw()]);
        assert_eq!(line.client_sends(SimTime::ZERO, &[0xAA]), []);
        line.set_client_line(
            SimTime::ZERO,
            ClientLine {
                stop_bits: 2,
                ..good
            },
        );
        let reported = line.client_sends(SimTime::ZERO, &[0xAA]);
        let two = event::stop_bits(2);
        assert_eq!(reported, [two]);
        assert_eq!(line.client_sends(SimTime::ZERO, &[0xAA]), []);
        line.detach(SimTime::ZERO);
    }
}

#[test]
fn with_two_stop_bits_a_byte_takes_eleven() {
    let mut line = SerialLine::new(10_000, Wire::Paced, Adapter::Bytes);
    line.attach(SimTime::ZERO);
    let two = ClientLine {
        stop_bits: 2,
        ..ClientLine::at(10_000)
    };
    line.set_client_line(SimTime::ZERO, two);
    let _ = line.client_sends(SimTime::ZERO, &[1, 2]);
    assert_eq!(line.device_sends(SimTime::ZERO, &[3]), None);
    // The device's bytes take ten.
    let ten = SimTime::ZERO + Duration::from_micros(1000);
    assert_eq!(line.next_for_client(), Some(ten));
    let arrives = SimTime::ZERO + Duration::from_micros(1100);
    let before = SimTime::from_nanos(arrives.as_nanos() - 1);
    assert_eq!(line.take_for_device(before), None);
    assert_eq!(line.take_for_device(arrives), Some(1));
    let after = arrives + Duration::from_micros(1100);
    assert_eq!(line.take_for_device(after), Some(2));
}

#[test]
fn what_does_not_fit_is_lost_and_reported() {
    let mut line = SerialLine::new(115_200, Wire::Paced, Adapter::Bytes);
    let reported = line.client_sends(SimTime::ZERO, &[0; MOST_IN_FLIGHT + 3]);
    assert_eq!(reported, [event::sent_too_much(3)]);
    assert_eq!(line.room(), 0);
    assert_eq!(arrivals(&mut line).len(), MOST_IN_FLIGHT);
}

#[test]
fn a_mismatch_garbles_both_ways() {
    let mut line = SerialLine::new(115_200, Wire::Instant, Adapter::Bytes);
    line.attach(SimTime::ZERO);
    line.set_client_line(SimTime::ZERO, ClientLine::at(57_600));
    line.client_sends(SimTime::ZERO, &[0xAA, 0x55]);
    let mut at_device = Vec::new();
    while let Some(byte) = line.take_for_device(SimTime::ZERO) {
        at_device.push(byte);
    }
    assert!(!at_device.is_empty());
    assert_ne!(at_device, [0xAA, 0x55]);
    line.device_sends(SimTime::ZERO, &[0xAA, 0x55, 0x01]);
    let mut at_client = Vec::new();
    line.take_for_client(SimTime::ZERO, &mut at_client);
    assert_ne!(at_client, [0xAA, 0x55, 0x01]);
}

#[test]
fn a_mismatch_of_a_client_that_only_listens_is_reported_with_the_second_frame() {
    let mut line = SerialLine::new(115_200, Wire::Paced, Adapter::Bytes);
    let frame = |line: &mut SerialLine| line.device_sends(SimTime::ZERO, &[0x00, 0x27]);
    line.attach(SimTime::ZERO);
    line.set_client_line(SimTime::ZERO, ClientLine::at(9_600));
    assert_eq!(frame(&mut line), None);
    let (client, device) = (9_600, 115_200);
    let wrong = event::baud_mismatch(client, device);
    assert_eq!(frame(&mut line), Some(wrong));
    assert_eq!(frame(&mut line), None);
    assert_eq!(line.client_sends(SimTime::ZERO, &[0]), []);
    // One that sets its speed in time has done nothing wrong.
    line.set_client_line(SimTime::ZERO, ClientLine::at(19_200));
    assert_eq!(frame(&mut line), None);
    line.set_client_line(SimTime::ZERO, ClientLine::at(115_200));
    assert_eq!([frame(&mut line), frame(&mut line)], [None, None]);
}

#[test]
fn the_pieces_in_which_a_burst_is_handed_over_change_nothing() {
    let bytes: Vec<u8> = (0..=255).map(|byte: u8| byte.wrapping_mul(37)).collect();
    for baud in [4_800, 57_600, 110_000, 230_400, 921_600] {
        let whole = {
            let mut line = SerialLine::new(115_200, Wire::Paced, Adapter::Bytes);
            line.set_client_line(SimTime::ZERO, ClientLine::at(baud));
            line.client_sends(SimTime::ZERO, &bytes);
            arrivals(&mut line)
        };
        for piece in [1, 3, 17, 100] {
            let mut line = SerialLine::new(115_200, Wire::Paced, Adapter::Bytes);
            line.set_client_line(SimTime::ZERO, ClientLine::at(baud));
            let mut now = SimTime::ZERO;
            let mut found = Vec::new();
            for piece in bytes.chunks(piece) {
                while let Some(at) = line.next_for_device().filter(|at| *at <= now) {
                    found.extend(line.take_for_device(at).map(|byte| (at.as_nanos(), byte)));
                }
                line.client_sends(now, piece);
                // Just before the line would be idle.
                let count = u32::try_from(piece.len()).unwrap();
                now += uart::byte_time(baud, 1) * count - Duration::from_nanos(1);
            }
            found.extend(arrivals(&mut line));
            assert_eq!(found, whole, "{baud} baud in pieces of {piece}");
        }
    }
}

#[test]
fn on_a_full_line_the_oldest_reply_that_has_not_begun_its_way_gives_way() {
    let mut line = SerialLine::new(115_200, Wire::Paced, Adapter::Bytes);
    line.attach(SimTime::ZERO);
    let reply = |number: usize| [u8::try_from(number).unwrap(); 82];
    let fits = MOST_IN_FLIGHT / 82;
    for number in 0..fits {
        assert_eq!(line.device_sends(SimTime::ZERO, &reply(number)), None);
    }
    let dropped = event::reply_dropped(82);
    let reported = line.device_sends(SimTime::ZERO, &reply(fits));
    assert_eq!(reported, Some(dropped));
    let mut read = Vec::new();
    line.take_for_client(SimTime::from_secs(10), &mut read);
    let carried = [0].into_iter().chain(2..=fits);
    assert_eq!(read, carried.flat_map(reply).collect::<Vec<u8>>());
}

#[test]
fn what_can_never_fit_is_dropped_itself() {
    let mut line = SerialLine::new(115_200, Wire::Paced, Adapter::Bytes);
    line.attach(SimTime::ZERO);
    let bytes = MOST_IN_FLIGHT + 1;
    let reported = line.device_sends(SimTime::ZERO, &vec![0; bytes]);
    assert_eq!(reported, Some(event::reply_dropped(bytes)));
    assert_eq!(line.device_sends(SimTime::ZERO, &[1]), None);
}

proptest! {
    /// Replies begin with their length and with a number that the rest of them repeats.
    #[test]
    fn replies_stay_whole_and_in_order_and_the_last_one_arrives(
        instant in any::<bool>(),
        doings in prop::collection::vec((2_u8..=82, 0_u64..2_000, any::<bool>()), 1..400),
    ) {
        let wire = if instant { Wire::Instant } else { Wire::Paced };
        let mut line = SerialLine::new(115_200, wire, Adapter::Bytes);
        line.attach(SimTime::ZERO);
        let (mut now, mut read, mut sent, mut lost) = (SimTime::ZERO, Vec::new(), 0, 0);
        for (place, (length, pause, reads)) in doings.iter().enumerate() {
            now += Duration::from_micros(*pause);
            if *reads {
                line.take_for_client(now, &mut read);
            }
            let mut reply = vec![u8::try_from(place % 251).unwrap(); usize::from(*length)];
            reply[0] = *length;
            sent += reply.len();
            match line.device_sends(now, &reply) {
                None => {}
                Some(event) if event.code() == code::LINE_FULL => {
                    lost += usize::try_from(event.lost_bytes).unwrap();
                }
                reported => prop_assert!(false, "{reported:?}"),
            }
        }
        line.take_for_client(now + Duration::from_secs(10), &mut read);
        prop_assert_eq!(read.len() + lost, sent);
        let (mut at, mut place) = (0, None);
        while at < read.len() {
            let reply = &read[at..at + usize::from(read[at])];
            let begin = place.map_or(0, |place| place + 1);
            let same = |(own, (length, ..)): (usize, &(u8, u64, bool))| {
                let number = u8::try_from(own % 251).unwrap();
                *length == reply[0] && reply[1..].iter().all(|byte| *byte == number)
            };
            let own = doings[begin..].iter().enumerate().map(|(own, doing)| (own + begin, doing));
            place = own.clone().find(|doing| same(*doing)).map(|(own, _)| own);
            prop_assert!(place.is_some(), "{reply:?} is none of those that follow {begin}");
            at += reply.len();
        }
        prop_assert_eq!(place, Some(doings.len() - 1));
    }
}

#[test]
fn what_a_client_s_uart_holds_still_goes_out_when_it_leaves_and_the_rest_does_not() {
    let mut line = SerialLine::new(115_200, Wire::Paced, Adapter::Bytes);
    line.attach(SimTime::ZERO);
    assert_eq!(line.room(), 1 + UART_FIFO);
    line.client_sends(SimTime::ZERO, &[9; 100]);
    assert_eq!(line.room(), 0);
    let byte = uart::byte_time(115_200, 1);
    let left = SimTime::ZERO + byte * 10;
    let before = std::iter::from_fn(|| line.take_for_device(left)).count();
    assert_eq!(before, 10);
    line.detach(left);
    assert_eq!(line.room(), 0);
    let after = arrivals(&mut line);
    assert_eq!(after.len(), 1 + UART_FIFO);
    let last = byte * u32::try_from(11 + UART_FIFO).unwrap();
    assert_eq!(after.last().unwrap().0, (SimTime::ZERO + last).as_nanos());
}

#[test]
fn what_arrives_is_for_the_client_that_is_there_by_then() {
    let mut line = SerialLine::new(115_200, Wire::Paced, Adapter::Bytes);
    let byte = uart::byte_time(115_200, 1);
    let at = |bytes: u32| SimTime::ZERO + byte * bytes;
    line.attach(SimTime::ZERO);
    line.device_sends(SimTime::ZERO, &[1, 2, 3, 4, 5]);
    let mut read = Vec::new();
    line.take_for_client(at(1), &mut read);
    assert_eq!(read, [1]);
    // The second has arrived and is not read, no client is there for the third and the fourth.
    line.detach(at(2));
    assert_eq!(line.next_for_client(), None);
    line.attach(at(4));
    read.clear();
    line.take_for_client(at(5), &mut read);
    assert_eq!(read, [5]);
}

#[test]
fn bytes_go_at_the_speed_that_is_set_when_their_turn_comes() {
    let mut line = SerialLine::new(115_200, Wire::Paced, Adapter::Bytes);
    line.attach(SimTime::ZERO);
    line.set_client_line(SimTime::ZERO, ClientLine::at(9600));
    line.client_sends(SimTime::ZERO, &[0; 17]);
    let (slow, fast) = (uart::byte_time(9600, 1), uart::byte_time(115_200, 1));
    // In the middle of the first one.
    line.set_client_line(SimTime::ZERO + slow / 2, ClientLine::at(115_200));
    let arrived = arrivals(&mut line);
    // What was left of the first went at the new speed.
    let last = SimTime::ZERO + slow / 2 + fast / 2 + fast * 16;
    assert!(arrived.last().unwrap().0.abs_diff(last.as_nanos()) <= 1);
    assert!(arrived.len() >= 16, "{arrived:?}");
}

#[test]
fn a_byte_that_met_another_speed_on_its_way_is_spoilt_and_the_next_is_whole() {
    let sent = [0xAA, 0x55, 0x00, 0x07, 0xC7, 0x84];
    for (slow, share) in [(50, 0.01), (110, 0.33), (9600, 0.5), (110, 0.99)] {
        let byte = uart::byte_time(slow, 1);
        let change = SimTime::ZERO + byte.mul_f64(share);
        // From the client to the device, from the slow speed to the right one.
        let mut line = SerialLine::new(115_200, Wire::Paced, Adapter::Bytes);
        line.attach(SimTime::ZERO);
        line.set_client_line(SimTime::ZERO, ClientLine::at(slow));
        line.client_sends(SimTime::ZERO, &sent);
        line.set_client_line(change, ClientLine::at(115_200));
        let heard: Vec<u8> = arrivals(&mut line).iter().map(|(_, byte)| *byte).collect();
        assert_ne!(heard, sent, "{slow} {share}");
        assert!(heard.ends_with(&sent[1..]), "{slow} {share}: {heard:?}");
        // To the client, which has the right speed only at the end of the first byte.
        let mut line = SerialLine::new(slow, Wire::Paced, Adapter::Bytes);
        line.attach(SimTime::ZERO);
        line.set_client_line(SimTime::ZERO, ClientLine::at(115_200));
        line.device_sends(SimTime::ZERO, &sent);
        line.set_client_line(change, ClientLine::at(slow));
        let mut heard = Vec::new();
        line.take_for_client(SimTime::ZERO + byte * 7, &mut heard);
        assert_ne!(heard, sent, "{slow} {share}");
        assert!(heard.ends_with(&sent[1..]), "{slow} {share}: {heard:?}");
    }
}

#[test]
fn what_a_slow_client_has_left_is_gone_soon_after_the_next_one_sets_its_speed() {
    let mut line = SerialLine::new(115_200, Wire::Paced, Adapter::Bytes);
    line.attach(SimTime::ZERO);
    line.set_client_line(SimTime::ZERO, ClientLine::at(50));
    line.client_sends(
        SimTime::ZERO,
        &[0xAA, 0x55, 0x00, 0x07, 0xC7, 0x84].repeat(2),
    );
    let left = SimTime::from_millis(30);
    line.detach(left);
    line.attach(left);
    line.set_client_line(left, ClientLine::at(115_200));
    let last = arrivals(&mut line).last().unwrap().0;
    assert!(last < SimTime::from_millis(32).as_nanos(), "{last}");
}

#[test]
fn a_client_that_changes_its_speed_hears_what_follows() {
    for wire in [Wire::Paced, Wire::Instant] {
        let mut line = SerialLine::new(9600, wire, Adapter::Bytes);
        line.attach(SimTime::ZERO);
        line.set_client_line(SimTime::ZERO, ClientLine::at(115_200));
        line.device_sends(SimTime::ZERO, &[0x56, 0x35]);
        let set = SimTime::from_millis(100);
        line.set_client_line(set, ClientLine::at(9600));
        let mut read = Vec::new();
        line.take_for_client(set, &mut read);
        assert_ne!(read, [0x56, 0x35]);
        read.clear();
        line.device_sends(set, &[0x56, 0x35]);
        line.take_for_client(SimTime::from_millis(200), &mut read);
        assert_eq!(read, [0x56, 0x35]);
    }
}

#[test]
fn at_speed_0_nothing_passes_and_nothing_waits() {
    let mut line = SerialLine::new(115_200, Wire::Paced, Adapter::Bytes);
    line.attach(SimTime::ZERO);
    line.client_sends(SimTime::ZERO, &[1, 2, 3]);
    let hung_up = line.set_client_line(SimTime::ZERO, ClientLine::at(0));
    assert_eq!(hung_up, Some(event::hung_up()));
    assert_eq!(line.client_sends(SimTime::from_micros(1), &[4, 5]), []);
    line.device_sends(SimTime::ZERO, &[6]);
    let byte = uart::byte_time(115_200, 1);
    let end = SimTime::ZERO + byte;
    assert_eq!(line.next_for_device(), Some(end));
    // Its end comes when there is no speed any more.
    assert_eq!(line.take_for_device(end), None);
    assert_eq!(line.next_for_device(), None);
    let mut read = Vec::new();
    line.take_for_client(end, &mut read);
    assert!(read.is_empty());
    line.set_client_line(end, ClientLine::at(115_200));
    line.client_sends(end, &[7]);
    assert_eq!(arrivals(&mut line), [((end + byte).as_nanos(), 7)]);
}

#[test]
fn bytes_that_an_adapter_holds_are_lost_when_the_port_hangs_up() {
    let mut line = SerialLine::new(115_200, Wire::Paced, Adapter::Usb);
    line.attach(SimTime::ZERO);
    let now = SimTime::from_micros(10);
    line.client_sends(now, &[1, 2]);
    line.set_client_line(now, ClientLine::at(0));
    assert_eq!(line.next_for_device(), None);
    line.set_client_line(now, ClientLine::at(115_200));
    line.client_sends(now, &[3]);
    let frame = SimTime::from_millis(1);
    let byte = uart::byte_time(115_200, 1);
    assert_eq!(arrivals(&mut line), [((frame + byte).as_nanos(), 3)]);
}

#[test]
fn parity_and_flow_control_are_reported_once_for_each_client() {
    let mut line = SerialLine::new(115_200, Wire::Paced, Adapter::Bytes);
    for _ in 0..2 {
        line.attach(SimTime::ZERO);
        let set = ClientLine {
            parity: true,
            rts_cts: true,
            ..ClientLine::at(115_200)
        };
        line.set_client_line(SimTime::ZERO, set);
        let reported = line.client_sends(SimTime::ZERO, &[0xAA]);
        assert_eq!(reported, [event::parity(), event::flow_control()]);
        assert_eq!(line.client_sends(SimTime::ZERO, &[0xAA]), []);
    }
}
