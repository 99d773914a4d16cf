//! Captures of USB adapters, as Wireshark, tcpdump and USBPcap write them.

use std::collections::BTreeMap;
use std::io::Read;

use anyhow::{Context as _, anyhow, bail, ensure};
use pcap_parser::{Block, Linktype, PcapBlockOwned, PcapError, create_reader};

use super::Row;
use crate::print::complain;

/// Limits of a file and of a block in it, bytes.
const MOST_BYTES: u64 = 1 << 30;
const MOST_BLOCK: usize = 1 << 20;
/// Packet sizes of USB at full speed and at high speed, bytes.
const PACKETS: [usize; 2] = [64, 512];

/// Bus and number of a device.
type Device = (u16, u16);

/// Reads what passed between a computer and its adapters; `chosen` has one for each link, as `1.5` for
/// device 5 at bus 1.
pub(super) fn read(
    file: impl Read + Send,
    chosen: &[String],
    links: usize,
) -> anyhow::Result<Vec<Row>> {
    let mut devices = transfers(file.take(MOST_BYTES))?;
    devices.values_mut().for_each(remove_status);
    devices.retain(|_, rows| !rows.is_empty());
    let name = |(bus, device): &Device| format!("{bus}.{device}");
    let names: Vec<String> = devices.keys().map(name).collect();
    ensure!(!names.is_empty(), "it has no bulk transfers of USB");
    let chosen = match chosen {
        [] if names.len() == 1 => &names,
        _ => chosen,
    };
    ensure!(
        (1..=links).contains(&chosen.len())
            && chosen.iter().all(|one| names.contains(one))
            && (1..chosen.len()).all(|at| !chosen[..at].contains(&chosen[at])),
        "name the device of each of at most {links} links with --usb; it has {}",
        names.join(", ")
    );
    let mut rows = Vec::new();
    for (device, of_one) in devices {
        if let Some(link) = chosen.iter().position(|one| *one == name(&device)) {
            rows.extend(of_one.into_iter().map(|row| Row { link, ..row }));
        }
    }
    rows.sort_by_key(|row| row.at);
    Ok(rows)
}

/// All bulk transfers with bytes.
fn transfers(file: impl Read + Send) -> anyhow::Result<BTreeMap<Device, Vec<Row>>> {
    let in_words = |error: PcapError<_>| anyhow!("it is not a pcap or pcapng file: {error:?}");
    let mut reader = create_reader(MOST_BLOCK, file).map_err(in_words)?;
    let mut devices = BTreeMap::<Device, Vec<Row>>::new();
    // Link type, fractions of a second, offset in s.
    let mut interfaces: Vec<(Linktype, u64, i64)> = Vec::new();
    let (mut is_big, mut number) = (false, 0);
    loop {
        let (size, block) = match reader.next() {
            Ok(next) => next,
            Err(PcapError::Eof) => return Ok(devices),
            // The end of the file and a block that is too long are separate errors.
            Err(PcapError::Incomplete(_)) => {
                let filled = reader.refill();
                filled.map_err(|error| anyhow!("it cannot be read: {error:?}"))?;
                continue;
            }
            Err(PcapError::UnexpectedEof) if number > 0 => {
                complain(&format!(
                    "warning: the capture is cut off behind packet {number}; the rest is left out"
                ));
                return Ok(devices);
            }
            Err(error) => bail!("behind packet {number}: {error:?}"),
        };
        let packet = match &block {
            PcapBlockOwned::NG(Block::SectionHeader(section)) => {
                is_big = section.big_endian();
                interfaces.clear();
                None
            }
            PcapBlockOwned::NG(Block::InterfaceDescription(one)) => {
                let parts = one.ts_resolution().unwrap_or(1_000_000);
                interfaces.push((one.linktype, parts, one.if_tsoffset));
                None
            }
            PcapBlockOwned::NG(Block::EnhancedPacket(packet)) => {
                let time = u64::from(packet.ts_high) << 32 | u64::from(packet.ts_low);
                Some((packet.if_id, time, packet.caplen, packet.data))
            }
            PcapBlockOwned::LegacyHeader(header) => {
                is_big = header.is_bigendian();
                let parts = if header.is_nanosecond_precision() {
                    1_000_000_000
                } else {
                    1_000_000
                };
                interfaces = vec![(header.network, parts, 0)];
                None
            }
            PcapBlockOwned::Legacy(packet) => {
                let parts = interfaces.first().map_or(1, |one| one.1);
                let time = u64::from(packet.ts_sec) * parts + u64::from(packet.ts_usec);
                Some((0, time, packet.caplen, packet.data))
            }
            PcapBlockOwned::NG(_) => None,
        };
        if let Some((interface, time, length, data)) = packet {
            number += 1;
            let interface = interfaces.get(interface as usize);
            let &(kind, parts, offset) =
                interface.with_context(|| format!("packet {number} is of no interface"))?;
            let data = data.get(..length as usize).unwrap_or(data);
            let found = match kind.0 {
                189 => usbmon(data, 48, is_big),
                220 => usbmon(data, 64, is_big),
                249 => usbpcap(data),
                other => bail!(
                    "packet {number} has link type {other}; allowed: 189, 220 and 249, of USB"
                ),
            };
            if let Some((device, by_client, bytes)) = found {
                let bytes = bytes
                    .with_context(|| format!("packet {number} is cut off: capture it whole"))?;
                let at = i128::from(time) * 1_000_000_000 / i128::from(parts)
                    + i128::from(offset) * 1_000_000_000;
                let bytes = bytes.to_vec();
                devices.entry(device).or_default().push(Row {
                    at,
                    by_client,
                    link: 0,
                    bytes,
                });
            }
        }
        reader.consume(size);
    }
}

/// A number of two or four bytes.
fn number(data: &[u8], at: usize, size: usize, is_big: bool) -> Option<usize> {
    let digit = |sum, byte: &u8| sum << 8 | usize::from(*byte);
    let bytes = data.get(at..at + size)?;
    Some(match is_big {
        true => bytes.iter().fold(0, digit),
        false => bytes.iter().rev().fold(0, digit),
    })
}

/// Device, direction (`true`: from the computer) and bytes of a bulk transfer, if it is complete.
type Bulk<'d> = Option<(Device, bool, Option<&'d [u8]>)>;

/// A packet of Linux: a header in the computer's byte order, then the data.
fn usbmon(data: &[u8], head: usize, is_big: bool) -> Bulk<'_> {
    let [kind, transfer, endpoint, device] = *data.get(8..12)?.first_chunk()?;
    let by_client = endpoint & 0x80 == 0;
    // Outgoing data comes with the submission, incoming data with the completion.
    if transfer != 3 || kind != if by_client { b'S' } else { b'C' } {
        return None;
    }
    let [bus, length] = [number(data, 12, 2, is_big)?, number(data, 32, 4, is_big)?];
    let device = (u16::try_from(bus).ok()?, u16::from(device));
    (length > 0).then(|| (device, by_client, data.get(head..head + length)))
}

/// A packet of Windows: a header with its length, little-endian, then the data.
fn usbpcap(data: &[u8]) -> Bulk<'_> {
    let [bus, device] = [17, 19].map(|at| number(data, at, 2, false));
    let [endpoint, transfer] = *data.get(21..23)?.first_chunk()?;
    let (head, length) = (number(data, 0, 2, false)?, number(data, 23, 4, false)?);
    let by_client = endpoint & 0x80 == 0;
    // Set in replies of the device.
    let is_answer = data[16] & 1 == 1;
    if transfer != 3 || is_answer == by_client || length == 0 {
        return None;
    }
    let device = (u16::try_from(bus?).ok()?, u16::try_from(device?).ok()?);
    Some((device, by_client, data.get(head..head + length)))
}

/// Removes the two status bytes that an FTDI adapter puts before the data of each packet, also without data.
/// The lower half of the first is constant.
fn remove_status(rows: &mut Vec<Row>) {
    let came = || rows.iter().filter(|row| !row.by_client);
    let is_status = |packet: &[u8]| packet.len() >= 2 && packet[0] & 0x0F == 1;
    let is_all = |size: &&usize| came().all(|row| row.bytes.chunks(**size).all(is_status));
    let size = PACKETS
        .iter()
        .find(is_all)
        .filter(|_| came().next().is_some());
    if let Some(size) = size {
        for row in rows.iter_mut().filter(|row| !row.by_client) {
            row.bytes = row
                .bytes
                .chunks(*size)
                .flat_map(|packet| &packet[2..])
                .copied()
                .collect();
        }
    }
    rows.retain(|row| !row.bytes.is_empty());
}

#[cfg(test)]
mod tests;
