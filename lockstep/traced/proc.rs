//! What the system says of processes in files under `/proc`.

use std::path::PathBuf;

use rustix::event::PollFlags;

use crate::traced::sys::Tid;

pub(crate) fn name_of(tid: Tid) -> String {
    let name = std::fs::read_to_string(format!("/proc/{tid}/comm")).unwrap_or_default();
    name.trim_end().to_owned()
}

/// What is behind this name in a file of the system.
fn field(path: &str, name: &str) -> Option<String> {
    let text = std::fs::read_to_string(path).ok()?;
    let value = text.lines().find_map(|line| line.strip_prefix(name))?;
    Some(value.trim().to_owned())
}

/// The number of a thread in the namespace that its process is in.
pub(crate) fn own_number_of(process: Tid, tid: Tid) -> Option<Tid> {
    let numbers = field(&format!("/proc/{process}/task/{tid}/status"), "NSpid:")?;
    numbers.split_whitespace().last()?.parse().ok()
}

/// The number of descriptors that the system's table of a process has room for.
pub(crate) fn table_size(process: Tid) -> Option<usize> {
    let size = field(&format!("/proc/{process}/status"), "FDSize:")?;
    size.parse().ok()
}

/// The letter that says what the kernel has a thread do.
pub(crate) fn kernel_state(process: Tid, tid: Tid) -> Option<char> {
    let stat = std::fs::read_to_string(format!("/proc/{process}/task/{tid}/stat")).ok()?;
    // The name before it is in parentheses, and may hold any character.
    stat.rsplit_once(')')?.1.trim_start().chars().next()
}

/// Returns whether a thread sleeps until the named pipe that it opens is opened at its other end.
pub(crate) fn opens_pipe(process: Tid, tid: Tid) -> bool {
    // The name of the kernel's function.
    std::fs::read_to_string(format!("/proc/{process}/task/{tid}/wchan"))
        .is_ok_and(|place| place == "wait_for_partner")
}

/// The part of a process's memory that holds an address: where it begins, and what the system says of
/// it (`proc_pid_maps(5)`) from its rights on.
pub(crate) fn mapping(process: Tid, address: u64) -> Option<(u64, String)> {
    let maps = std::fs::read_to_string(format!("/proc/{process}/maps")).ok()?;
    maps.lines().find_map(|line| {
        let (ends, rest) = line.split_once(' ')?;
        let (from, to) = ends.split_once('-')?;
        let (from, to) = (number(from)?, number(to)?);
        (from..to)
            .contains(&address)
            .then(|| (from, rest.to_owned()))
    })
}

/// A number as the system writes addresses.
pub(crate) fn number(text: &str) -> Option<u64> {
    u64::from_str_radix(text, 16).ok()
}

/// The syscall in which a thread sleeps, and its arguments; `None` if it is in none.
pub(crate) fn syscall_of(process: Tid, tid: Tid) -> Option<(i64, [u64; 6])> {
    let text = std::fs::read_to_string(format!("/proc/{process}/task/{tid}/syscall")).ok()?;
    let mut words = text.split_whitespace();
    // A word if it runs, and -1 if it waits for its memory.
    let call = words.next()?.parse().ok().filter(|call| *call >= 0)?;
    let mut arguments = [0; 6];
    for (argument, word) in arguments.iter_mut().zip(words) {
        *argument = number(word.strip_prefix("0x")?)?;
    }
    Some((call, arguments))
}

pub(crate) fn path_of(process: Tid, fd: i32) -> Option<PathBuf> {
    std::fs::read_link(format!("/proc/{process}/fd/{fd}")).ok()
}

pub(crate) fn files_of(pid: Tid) -> impl Iterator<Item = PathBuf> {
    let entries = std::fs::read_dir(format!("/proc/{pid}/fd"));
    let entries = entries.into_iter().flatten();
    entries.filter_map(|entry| entry.ok().map(|entry| entry.path()))
}

pub(crate) fn own_pid() -> Tid {
    rustix::process::getpid().as_raw_nonzero().get()
}

/// The numbers of a process's descriptors.
pub(crate) fn descriptors_of(pid: Tid) -> impl Iterator<Item = i32> {
    files_of(pid).filter_map(|path| path.file_name()?.to_str()?.parse().ok())
}

/// The text under this name in what the system says of a descriptor.
pub(crate) fn info_of(process: Tid, fd: i32, name: &str) -> Option<String> {
    field(&format!("/proc/{process}/fdinfo/{fd}"), name)
}

pub(crate) fn members_of_epoll(process: Tid, fd: i32) -> Vec<(i32, PollFlags)> {
    let text = std::fs::read_to_string(format!("/proc/{process}/fdinfo/{fd}"));
    let text = text.unwrap_or_default();
    text.lines()
        .filter_map(|line| {
            let mut words = line.strip_prefix("tfd:")?.split_whitespace();
            let fd = words.next()?.parse().ok()?;
            let events = words.skip_while(|word| *word != "events:").nth(1)?;
            let events = u32::from_str_radix(events, 16).ok()?;
            let events = u16::try_from(events & 0xFFFF).ok()?;
            Some((fd, PollFlags::from_bits_truncate(events)))
        })
        .collect()
}

/// The signals of a thread, as sets with signal 1 in the lowest bit.
pub(crate) struct Signals {
    pub(crate) pending: u64,
    pub(crate) blocked: u64,
    pub(crate) ignored: u64,
    pub(crate) caught: u64,
}

impl Signals {
    pub(crate) fn of(process: Tid, tid: Tid) -> Option<Self> {
        let text = std::fs::read_to_string(format!("/proc/{process}/task/{tid}/status")).ok()?;
        let set = |name: &str| {
            let line = text.lines().find_map(|line| line.strip_prefix(name));
            line.and_then(|set| number(set.trim())).unwrap_or(0)
        };
        Some(Self {
            pending: set("SigPnd:") | set("ShdPnd:"),
            blocked: set("SigBlk:"),
            ignored: set("SigIgn:"),
            caught: set("SigCgt:"),
        })
    }

    /// Those that would interrupt a wait. `mask` takes the place of what is blocked.
    pub(crate) fn interrupting(&self, mask: Option<u64>) -> u64 {
        /// SIGCHLD, SIGCONT, SIGURG and SIGWINCH do nothing unless they are caught.
        const USUALLY_IGNORED: u64 = 1 << 16 | 1 << 17 | 1 << 22 | 1 << 27;
        let ignored = self.ignored | (USUALLY_IGNORED & !self.caught);
        self.pending & !mask.unwrap_or(self.blocked) & !ignored
    }
}
