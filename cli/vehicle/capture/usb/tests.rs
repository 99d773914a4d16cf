use std::process::Command;

use super::*;

/// A block of a pcapng file, as its description has it.
fn block(kind: u32, body: &[u8]) -> Vec<u8> {
    let padding = body.len().next_multiple_of(4) - body.len();
    let length = u32::try_from(12 + body.len() + padding)
        .unwrap()
        .to_le_bytes();
    [
        &kind.to_le_bytes()[..],
        &length,
        body,
        &vec![0; padding],
        &length,
    ]
    .concat()
}

/// A file of packets with times in ns, of a link type.
fn pcapng(kind: u16, packets: &[(u64, Vec<u8>)]) -> Vec<u8> {
    let section = [
        &0x1A2B_3C4D_u32.to_le_bytes()[..],
        &[1, 0, 0, 0],
        &[0xFF; 8],
    ]
    .concat();
    // Times are in ns, by an option.
    let interface = [
        &kind.to_le_bytes()[..],
        &[0; 6],
        &[9, 0, 1, 0, 9, 0, 0, 0],
        &[0; 4],
    ]
    .concat();
    let packet = |(time, data): &(u64, Vec<u8>)| {
        let [high, low] = [time >> 32, time & 0xFFFF_FFFF].map(|half| u32::try_from(half).unwrap());
        let length = u32::try_from(data.len()).unwrap();
        let head = [0, high, low, length, length]
            .map(u32::to_le_bytes)
            .concat();
        block(6, &[head, data.clone()].concat())
    };
    let packets = packets.iter().map(packet).collect::<Vec<_>>().concat();
    [block(0x0A0D_0D0A, &section), block(1, &interface), packets].concat()
}

/// A packet of usbmon with device 5 at bus 1: its kind, transfer, endpoint, and data.
fn usbmon_packet(kind: u8, transfer: u8, endpoint: u8, data: &[u8]) -> Vec<u8> {
    let length = u32::try_from(data.len()).unwrap().to_le_bytes();
    let flags = if data.is_empty() { *b"-<" } else { *b"-\0" };
    let mut packet = vec![0; 8];
    packet.extend([kind, transfer, endpoint, 5, 1, 0, flags[0], flags[1]]);
    packet.extend([0; 16]);
    packet.extend([&length[..], &length].concat());
    packet.resize(64, 0);
    packet.extend(data);
    packet
}

const BEGIN: u64 = 1_700_000_000_000_000_000;

/// A request and its reply through an adapter, with what stands around them.
fn capture(replies: &[&[u8]]) -> Vec<(u64, Vec<u8>)> {
    let mut packets = vec![
        usbmon_packet(b'S', 2, 0x80, &[]),
        usbmon_packet(b'S', 3, 0x82, &[]),
        usbmon_packet(b'S', 3, 0x02, &[0xAA, 0x55, 0, 7]),
        usbmon_packet(b'C', 3, 0x02, &[]),
        usbmon_packet(b'C', 1, 0x81, &[0xA1, 0x20]),
    ];
    packets.extend(
        replies
            .iter()
            .map(|reply| usbmon_packet(b'C', 3, 0x82, reply)),
    );
    let at = (BEGIN..).step_by(1_000_001);
    at.zip(packets).collect()
}

/// Bytes to the vehicle and from it.
fn both(rows: &[Row]) -> [Vec<u8>; 2] {
    [true, false].map(|by_client| {
        let rows = rows.iter().filter(|row| row.by_client == by_client);
        rows.flat_map(|row| row.bytes.clone()).collect()
    })
}

#[test]
fn bulk_data_pass_both_ways_with_their_times() {
    let file = pcapng(220, &capture(&[&[0xAA, 0x55], &[1, 7]]));
    let rows = read(&*file, &[], 2).unwrap();
    assert_eq!(
        both(&rows),
        [vec![0xAA, 0x55, 0, 7], vec![0xAA, 0x55, 1, 7]]
    );
    assert_eq!(rows[0].at, i128::from(BEGIN + 2 * 1_000_001));
    assert_eq!(rows[2].at, i128::from(BEGIN + 6 * 1_000_001));
    // Another program reads the same.
    let path = tempfile::tempdir().unwrap();
    let path = path.path().join("capture.pcapng");
    std::fs::write(&path, &file).unwrap();
    let mut tshark = Command::new("tshark");
    tshark.args([
        "-Y",
        "usb.transfer_type == 3 && usb.capdata",
        "-T",
        "fields",
    ]);
    tshark.args([
        "-e",
        "frame.time_epoch",
        "-e",
        "usb.dst",
        "-e",
        "usb.capdata",
        "-r",
    ]);
    let Ok(output) = tshark.arg(&path).output() else {
        return;
    };
    let text = String::from_utf8(output.stdout).unwrap();
    let row = |row: &Row| {
        let to = if row.by_client { "1.5.2" } else { "host" };
        let bytes: String = row.bytes.iter().map(|byte| format!("{byte:02x}")).collect();
        format!(
            "{}.{:09}\t{to}\t{bytes}\n",
            row.at / 1_000_000_000,
            row.at % 1_000_000_000
        )
    };
    assert_eq!(text, rows.iter().map(row).collect::<String>());
}

#[test]
fn the_state_of_an_adapter_of_ftdi_is_no_data() {
    let data: Vec<u8> = (0..150).collect();
    for size in [64, 512] {
        let packets = data
            .chunks(size - 2)
            .map(|part| [&[0x01, 0x60], part].concat());
        let transfer = packets.collect::<Vec<_>>().concat();
        let replies: [&[u8]; 3] = [&[0x01, 0x60], &transfer, &[0x31, 0x00, 0xFF]];
        let rows = read(&*pcapng(220, &capture(&replies)), &[], 1).unwrap();
        let [_, from] = both(&rows);
        assert_eq!(from, [&data[..], &[0xFF]].concat(), "packets of {size}");
    }
}

#[test]
fn usbpcap_and_older_files_are_read_too() {
    // A head of 27 bytes, with what it says: answered, bus, device, endpoint, transfer, length.
    let packet = |info: u8, endpoint, data: &[u8]| {
        let mut packet = vec![27, 0];
        packet.resize(16, 0);
        packet.extend([info, 2, 0, 9, 0, endpoint, 3]);
        packet.extend(u32::try_from(data.len()).unwrap().to_le_bytes());
        packet.extend(data);
        packet
    };
    let packets = [
        packet(0, 2, b"ask"),
        packet(1, 2, b""),
        packet(0, 0x81, b""),
        packet(1, 0x81, b"say"),
    ];
    let packets: Vec<(u64, Vec<u8>)> = (BEGIN..).zip(packets).collect();
    let rows = read(&*pcapng(249, &packets), &["2.9".to_owned()], 1).unwrap();
    assert_eq!(both(&rows), [b"ask", b"say"]);
    // Most significant byte first, in µs, with a head of 48 bytes.
    let mut packet = usbmon_packet(b'S', 3, 1, b"ask");
    packet.drain(48..64);
    packet[12..14].reverse();
    packet[32..36].reverse();
    let head: [u32; 6] = [0xA1B2_C3D4, 0x0002_0004, 0, 0, 0xFFFF, 189];
    let own: [u32; 4] = [
        7,
        5,
        packet.len().try_into().unwrap(),
        packet.len().try_into().unwrap(),
    ];
    let words = [&head[..], &own].concat();
    let file = [
        words.into_iter().flat_map(u32::to_be_bytes).collect(),
        packet,
    ]
    .concat();
    let rows = read(&*file, &[], 1).unwrap();
    assert_eq!((rows[0].at, &*rows[0].bytes), (7_000_005_000, &b"ask"[..]));
}

#[test]
fn what_is_wrong_with_a_capture_is_named() {
    let good = pcapng(220, &capture(&[&[0xAA]]));
    let cut = |packet: &[u8]| pcapng(220, &[(0, packet[..packet.len() - 1].to_vec())]);
    let mut others = capture(&[&[0xAA]]);
    others[2].1[11] = 6;
    for (file, chosen, why) in [
        (
            pcapng(1, &[(0, vec![0; 60])]),
            "",
            "packet 1 has link type 1; allowed: 189, 220 and 249",
        ),
        (pcapng(220, &[]), "", "it has no bulk transfers of USB"),
        (
            cut(&usbmon_packet(b'S', 3, 2, b"ask")),
            "",
            "packet 1 is cut off",
        ),
        (
            pcapng(220, &others),
            "",
            "of at most 1 links with --usb; it has 1.5, 1.6",
        ),
        (good.clone(), "1.7", "with --usb; it has 1.5"),
        (
            b"seconds,direction,bytes\n".to_vec(),
            "",
            "not a pcap or pcapng file",
        ),
        (Vec::new(), "", "not a pcap or pcapng file"),
        (
            good.clone(),
            "1.5 1.5",
            "name the device of each of at most 2",
        ),
    ] {
        let chosen: Vec<String> = chosen.split_whitespace().map(str::to_owned).collect();
        let error = read(&*file, &chosen, chosen.len().max(1))
            .err()
            .unwrap()
            .to_string();
        assert!(error.contains(why), "{error}, not {why}");
    }
    // What is whole of a file that is cut off is read.
    let rows = read(&good[..good.len() - 10], &[], 1).unwrap();
    assert_eq!(both(&rows), [vec![0xAA, 0x55, 0, 7], Vec::new()]);
    // However it is torn or garbled, it is read or refused.
    for at in (0..good.len()).step_by(13) {
        let _ = read(&good[..at], &[], 1);
        let mut garbled = good.clone();
        garbled[at] ^= 0xFF;
        let _ = read(&*garbled, &[], 1);
    }
}
