//! Captures of other programs, read into a recording.

mod usb;

use std::io::Read;

use anyhow::{Context as _, anyhow};
use rigsim_core::event::read_hex;
use rigsim_runner::trace::{Hexed, MOST_BYTES, PortRecord, Record};

use super::end;

/// Reads `seconds,direction,bytes` on each line; a heading, which begins with a letter, empty lines and comments
/// that begin with `#` are skipped.
pub(super) fn of_text(text: &str, links: usize) -> anyhow::Result<Vec<Record>> {
    let text = text.trim_start_matches('\u{feff}');
    let lines = text.lines().map(str::trim).enumerate();
    let rows = lines.filter(|(_, line)| !line.is_empty() && !line.starts_with('#'));
    let mut rows = rows.peekable();
    rows.next_if(|(_, line)| {
        line.trim_start_matches('"')
            .starts_with(char::is_alphabetic)
    });
    let row = |(number, line)| {
        let place = format!("line {}", number + 1);
        Ok((row(line, links).with_context(|| place.clone())?, place))
    };
    let rows = rows.map(row).collect::<anyhow::Result<Vec<_>>>()?;
    if rows.is_empty() {
        return Err(anyhow!(
            "it has no lines; each is `seconds,direction,bytes`"
        ));
    }
    records(rows, links)
}

/// Reads a pcap or pcapng file of USB; `chosen` has the device of each link.
pub(super) fn of_usb(
    file: impl Read + Send,
    chosen: &[String],
    links: usize,
) -> anyhow::Result<Vec<Record>> {
    let rows = usb::read(file, chosen, links)?.into_iter();
    records(rows.map(|row| (row, String::new())), links)
}

/// Rows with their places as records, with times that count from the first; the last record is the end.
fn records(
    rows: impl IntoIterator<Item = (Row, String)>,
    links: usize,
) -> anyhow::Result<Vec<Record>> {
    let attach = |link| Record::Attach {
        t: 0,
        port: PortRecord(0, link),
    };
    let mut records: Vec<Record> = (0..links).map(attach).collect();
    let (mut begin, mut last) = (None, 0);
    for (row, place) in rows {
        let at = row.at - *begin.get_or_insert(row.at) + 1_000_000;
        let t = u64::try_from(at).ok().filter(|t| *t >= last);
        let t = t.with_context(|| format!("{place}: time goes back"))?;
        last = t;
        let port = PortRecord(0, row.link);
        records.extend(row.bytes.chunks(MOST_BYTES).map(|bytes| {
            let bytes = Hexed(bytes.to_vec());
            match row.by_client {
                true => Record::In { t, port, bytes },
                false => Record::Out {
                    t,
                    dt: 0,
                    port,
                    bytes,
                },
            }
        }));
    }
    records.push(end(last));
    Ok(records)
}

struct Row {
    /// ns since an arbitrary time.
    at: i128,
    by_client: bool,
    link: usize,
    bytes: Vec<u8>,
}

fn row(line: &str, links: usize) -> anyhow::Result<Row> {
    let mut cells = line
        .splitn(3, ',')
        .map(|cell| cell.trim().trim_matches('"'));
    let mut cell = || cells.next().unwrap_or_default();
    let (seconds, direction, bytes) = (cell(), cell(), cell());
    let (side, link) = direction.split_once(':').unwrap_or((direction, "0"));
    let link: usize = link
        .parse()
        .ok()
        .filter(|link| *link < links)
        .ok_or_else(|| {
            anyhow!(
                "there is no link `{link}`; this --device has 0 to {}",
                links - 1
            )
        })?;
    let by_client = match side {
        "client" => true,
        "vehicle" => false,
        _ => {
            return Err(anyhow!(
                "`{side}` is not a direction; allowed: client, vehicle"
            ));
        }
    };
    let digits = bytes.chars().filter(|c| !c.is_ascii_whitespace());
    let read = read_hex(digits).filter(|read| !read.is_empty());
    Ok(Row {
        at: nanoseconds(seconds).ok_or_else(|| anyhow!("`{seconds}` is not a time in seconds"))?,
        by_client,
        link,
        bytes: read
            .ok_or_else(|| anyhow!("`{bytes}` is not bytes: pairs of hexadecimal digits"))?,
    })
}

/// Decimal seconds, exactly, so that times since 1970 keep their nanoseconds.
fn nanoseconds(seconds: &str) -> Option<i128> {
    let (whole, part) = seconds.split_once('.').unwrap_or((seconds, ""));
    let digits = part.bytes().all(|byte| byte.is_ascii_digit());
    let nanos: i128 = format!("{part:0<9.9}").parse().ok().filter(|_| digits)?;
    let whole: u64 = whole.parse().ok()?;
    Some(i128::from(whole) * 1_000_000_000 + nanos)
}

#[cfg(test)]
mod tests;
