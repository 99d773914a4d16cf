//! One processor, whatever the machine has and wherever a program looks: programs start as many
//! threads as they find processors.

use std::io;

use rustix::fs::SeekFrom;

use crate::traced::descriptor::Descriptor;
use crate::traced::memory::Memory;
use crate::traced::sys::Tid;
use crate::traced::syscall::{Halt, Handling, counted};

/// Processors on which a thread may run.
pub(crate) fn affinity(tid: Tid, length: u64, into: u64) -> Result<Handling, Halt> {
    if length < 8 {
        return Ok(Handling::Make);
    }
    Memory(tid).write(into, &1_u64.to_ne_bytes())?;
    Ok(Handling::Answer(8))
}

/// The one on which it runs, and the node of that; programs may ask for either.
pub(crate) fn current(tid: Tid, processor: u64, node: u64) -> Result<Handling, Halt> {
    for into in [processor, node] {
        if into != 0 {
            Memory(tid).write(into, &[0; 4])?;
        }
    }
    Ok(Handling::Answer(0))
}

/// Makes of what a file says of all processors what it would say of the first.
type First = fn(&str) -> String;

/// Files in which the system lists its processors.
const LISTS: [(&str, First); 5] = [
    ("/sys/devices/system/cpu/online", |_| "0\n".to_owned()),
    ("/sys/devices/system/cpu/possible", |_| "0\n".to_owned()),
    ("/sys/devices/system/cpu/present", |_| "0\n".to_owned()),
    ("/proc/cpuinfo", first_paragraph),
    ("/proc/stat", without_other_processors),
];

fn first_paragraph(text: &str) -> String {
    let end = text.find("\n\n").map_or(text.len(), |end| end + 2);
    text.get(..end).unwrap_or_default().to_owned()
}

/// Each processor has its own line, behind one for all of them.
fn without_other_processors(text: &str) -> String {
    let is_other = |line: &&str| {
        let number = line.strip_prefix("cpu").unwrap_or_default();
        number.starts_with(|c: char| c.is_ascii_digit()) && !number.starts_with("0 ")
    };
    let lines = text.split_inclusive('\n');
    lines.filter(|line| !is_other(line)).collect()
}

struct List {
    inode: (u64, u64),
    path: &'static str,
    first: First,
    /// Text that is being read of it, from the first read to the last.
    text: String,
}

pub(crate) struct Lists(Vec<List>);

impl Lists {
    pub(crate) fn new() -> Self {
        let list = |(path, first)| {
            let stat = rustix::fs::stat(path).ok()?;
            Some(List {
                inode: (stat.st_dev, stat.st_ino),
                path,
                first,
                text: String::new(),
            })
        };
        Self(LISTS.into_iter().filter_map(list).collect())
    }

    pub(crate) fn has(&self, descriptor: &Descriptor) -> bool {
        let inode = descriptor.status.inode;
        self.0.iter().any(|list| list.inode == inode)
    }

    /// Answers a read into these parts of a program's memory, at a place or where the last ended.
    pub(crate) fn read(
        &mut self,
        tid: Tid,
        descriptor: &Descriptor,
        parts: &[(u64, u64)],
        place: Option<u64>,
    ) -> Result<Option<Handling>, Halt> {
        let inode = descriptor.status.inode;
        let Some(list) = self.0.iter_mut().find(|list| list.inode == inode) else {
            return Ok(None);
        };
        let at = match place {
            Some(place) => place,
            None => rustix::fs::tell(&descriptor.file).map_err(io::Error::from)?,
        };
        if at == 0 {
            list.text = (list.first)(&std::fs::read_to_string(list.path)?);
        }
        let from = usize::try_from(at).unwrap_or(usize::MAX);
        let left = list.text.as_bytes().get(from..).unwrap_or_default();
        let written = Memory(tid).write_parts(parts, left)?;
        if place.is_none() {
            let behind = SeekFrom::Start(at.saturating_add(written as u64));
            rustix::fs::seek(&descriptor.file, behind).map_err(io::Error::from)?;
        }
        Ok(Some(Handling::Answer(counted(written))))
    }
}
