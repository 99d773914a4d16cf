//! A pseudo-terminal in step with its client: whatever has been written to it is there to be read.

use std::cell::OnceCell;
use std::collections::VecDeque;
use std::io;
use std::mem::MaybeUninit;
use std::os::fd::OwnedFd;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use rigsim_settings::ClientLine;
use rustix::event::{PollFd, PollFlags, Timespec};
use rustix::fs::inotify::{self, CreateFlags, ReadFlags, WatchFlags};
use rustix::fs::{CWD, Mode, OFlags};
use rustix::io::retry_on_intr;
use rustix::termios::{
    Action, LocalModes, OptionalActions, OutputModes, QueueSelector, SpecialCodeIndex, Termios,
};

/// Most bytes that go to the kernel at once, whose own limit is 4095.
const MOST_IN_KERNEL: usize = 3072;
/// Most bytes that a client can read at once, as the kernel has it for terminals.
const MOST_READ: usize = 4095;
/// Most bytes that wait for the client to read; what is beyond is lost, as with a real port.
const MOST_WAITING: usize = 20_480;
/// Most pseudo-terminals of pulled cables that are kept.
const MOST_FORMER: usize = 64;
/// Time that a hang-up may take through the kernel. It is a matter of microseconds, unless the machine
/// has no time for this program.
const PATIENCE: Duration = Duration::from_secs(60);

/// Modem lines, as `TIOCM_*` has them.
pub mod modem {
    /// Data terminal ready: set by the client.
    pub const DTR: u32 = 0x002;
    /// Request to send: set by the client.
    pub const RTS: u32 = 0x004;
    /// Lines that an adapter with a cable of three wires reads: clear to send, carrier, data set
    /// ready.
    pub const READ: u32 = 0x020 | 0x040 | 0x100;
}

/// Rule by which a read comes to its end.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct ReadRule {
    /// Bytes that it waits for, `VMIN`; `None` if it waits for a line.
    pub(crate) least: Option<usize>,
    pub(crate) patience: Option<Duration>,
}

impl ReadRule {
    /// A read returns at once, whatever is there.
    pub(crate) fn never_waits(self) -> bool {
        self.least == Some(0) && self.patience.is_none()
    }
}

/// A port that clients of a run open under the path of a link.
pub struct Port {
    link: PathBuf,
    baud: u32,
    pair: Option<Pair>,
    /// Bytes that have arrived, and that the terminal has not edited yet.
    arrived: VecDeque<u8>,
    /// Bytes that the client can read.
    ready: VecDeque<u8>,
    /// Lengths of the lines that these are, of a terminal that has lines (`ICANON`). An end of file has none.
    lines: Option<VecDeque<usize>>,
    /// A client polls it by an epoll or is sent a signal (`O_ASYNC`): the kernel has to know whether there
    /// are bytes.
    pub(crate) needs_sign: bool,
    /// The kernel has sent a signal, if it was to send any.
    pub(crate) has_signalled: bool,
    /// The kernel has bytes that stand for those that wait.
    has_sign: bool,
    /// The client has stopped its output or its input (`tcflow`), or started it again.
    pub(crate) flows: bool,
    /// The world has had no room for what the client wrote.
    is_full: bool,
    lost: u64,
    /// Open descriptions of it that clients hold.
    pub(crate) opened: usize,
    pub(crate) modem: u32,
    /// Client's ends of those whose cable has been pulled. The system gives their numbers to no other program
    /// as long as they are open, so no client that has kept such a path opens the port of another run.
    former: VecDeque<OwnedFd>,
}

/// Both ends of a pseudo-terminal. Our own descriptor of the client's end lets us see what it sees.
struct Pair {
    master: OwnedFd,
    defaults: Termios,
    slave: OwnedFd,
    device: u64,
    watch: OwnedFd,
    /// Its settings, once they have been asked for, until the client changes them.
    settings: OnceCell<(Termios, ClientLine)>,
}

impl Port {
    /// A port at `baud`; `link` must not exist, and leads to it while the cable is in.
    ///
    /// # Errors
    /// When the system refuses a pseudo-terminal or the link.
    pub fn new(link: PathBuf, baud: u32) -> io::Result<Self> {
        let mut port = Self {
            link,
            baud,
            pair: None,
            arrived: VecDeque::new(),
            ready: VecDeque::new(),
            lines: None,
            needs_sign: false,
            has_signalled: false,
            has_sign: false,
            flows: false,
            is_full: false,
            lost: 0,
            opened: 0,
            modem: 0,
            former: VecDeque::new(),
        };
        port.plug()?;
        Ok(port)
    }

    /// Path at which a client finds it.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.link
    }

    /// Returns whether a client has it open.
    #[must_use]
    pub fn is_open(&self) -> bool {
        self.opened > 0
    }

    /// Returns whether the cable is in.
    #[must_use]
    pub fn is_plugged(&self) -> bool {
        self.pair.is_some()
    }

    /// Bytes lost since the last time, because the client did not read.
    pub fn take_lost(&mut self) -> u64 {
        std::mem::take(&mut self.lost)
    }

    /// Puts the cable in; another pseudo-terminal is behind the link then.
    ///
    /// # Errors
    /// When the system refuses a pseudo-terminal or the link.
    pub fn plug(&mut self) -> io::Result<()> {
        if self.pair.is_some() {
            return Ok(());
        }
        let (pair, node) = Pair::open(self.baud)?;
        std::os::unix::fs::symlink(node, &self.link)?;
        self.pair = Some(pair);
        Ok(())
    }

    /// Pulls the cable: a client that has it open finds its end, and no client finds it any more. Says
    /// whether it was open.
    ///
    /// # Errors
    /// When the client's end has not come in a minute.
    pub fn unplug(&mut self) -> io::Result<bool> {
        let Some(pair) = self.remove() else {
            return Ok(false);
        };
        self.forget_bytes();
        (self.needs_sign, self.has_sign) = (false, false);
        (self.flows, self.is_full, self.modem) = (false, false, 0);
        self.former.push_back(pair.hang_up()?);
        if self.former.len() > MOST_FORMER {
            self.former.pop_front();
        }
        Ok(std::mem::take(&mut self.opened) > 0)
    }

    /// Takes both ends away, so that no client finds them any more.
    fn remove(&mut self) -> Option<Pair> {
        let pair = self.pair.take()?;
        // If another program has removed it, it is gone as it should be.
        let _ = std::fs::remove_file(&self.link);
        Some(pair)
    }

    /// Hands the client bytes; they are there to be read when this returns.
    ///
    /// # Errors
    /// When the pseudo-terminal does not take them.
    pub fn deliver(&mut self, bytes: &[u8]) -> io::Result<()> {
        if !self.is_open() || self.pair.is_none() {
            return Ok(());
        }
        let waiting = self.arrived.len() + self.ready.len();
        let (kept, lost) = bytes.split_at(bytes.len().min(MOST_WAITING.saturating_sub(waiting)));
        self.lost += lost.len() as u64;
        self.arrived.extend(kept);
        if !kept.is_empty() {
            // What arrives is a new edge for an epoll, and a new signal, though other bytes wait already.
            self.take_sign();
        }
        self.top_up()
    }

    /// Passes what has arrived through the terminal, if that edits it, and brings the kernel's end to what waits:
    /// whether there are any bytes, for an epoll.
    pub(crate) fn top_up(&mut self) -> io::Result<()> {
        if !self.arrived.is_empty() && !self.is_readable() {
            self.take_sign();
        }
        let Some(pair) = &self.pair else {
            return Ok(());
        };
        let (termios, line) = pair.settings()?;
        let has_lines = termios.local_modes.contains(LocalModes::ICANON);
        if has_lines != self.lines.is_some() {
            // What is left of a line that has not come to its end.
            self.ready.extend(pair.edited(false)?.concat());
            let one_line = VecDeque::from_iter(Some(self.ready.len()).filter(|length| *length > 0));
            self.lines = has_lines.then_some(one_line);
        }
        if line.raw {
            self.ready.append(&mut self.arrived);
        }
        // A sign must not be behind the beginning of a line.
        let signs_lines = has_lines && self.needs_sign;
        while !(self.arrived.is_empty() || signs_lines && self.is_readable()) {
            let count = self
                .arrived
                .len()
                .min(if signs_lines { 1 } else { MOST_IN_KERNEL });
            let bytes: Vec<u8> = self.arrived.drain(..count).collect();
            if pair.discards(termios, &bytes) {
                self.ready.clear();
                self.lines.iter_mut().for_each(VecDeque::clear);
            }
            pair.write(&bytes)?;
            for part in pair.edited(has_lines)? {
                self.lines
                    .iter_mut()
                    .for_each(|lines| lines.push_back(part.len()));
                self.ready.extend(part);
            }
        }
        let wants_sign = self.needs_sign && self.is_readable();
        if self.has_sign && !wants_sign {
            self.take_sign();
        } else if wants_sign && !self.has_sign {
            (self.has_sign, self.has_signalled) = (true, true);
            let least = self.read_rule().least.unwrap_or(1).max(1);
            pair.sign(termios, least)?;
        }
        Ok(())
    }

    /// Returns whether the terminal keeps back what the client writes.
    pub(crate) fn is_stopped(&self) -> bool {
        self.pair.as_ref().is_some_and(|pair| {
            (self.flows || !pair.is_raw()) && !poll(&mut [PollFd::new(&pair.slave, PollFlags::OUT)])
        })
    }

    /// The world has no room for what the client writes, or may have again. An epoll finds that, too.
    pub(crate) fn set_full(&mut self, is_full: bool) {
        if std::mem::replace(&mut self.is_full, is_full) != is_full
            && self.needs_sign
            && let Some(pair) = &self.pair
        {
            self.flows = true;
            let action = if is_full { Action::OOff } else { Action::OOn };
            // It cannot fail on a terminal that is there.
            let _ = rustix::termios::tcflow(&pair.slave, action);
        }
    }

    /// Settings by the client.
    ///
    /// # Errors
    /// When the system cannot tell.
    pub fn line(&self) -> io::Result<Option<ClientLine>> {
        let settings = self.pair.as_ref().map(Pair::settings).transpose()?;
        Ok(settings.map(|(_, line)| *line))
    }

    /// Returns whether it is the character device with this number.
    pub(crate) fn is_device(&self, device: u64) -> bool {
        self.pair.as_ref().is_some_and(|pair| pair.device == device)
    }

    /// Returns whether clients may have opened or closed one of these since the last time.
    pub(crate) fn any_changes(ports: &[Self]) -> bool {
        let watches = ports.iter().filter_map(|port| port.pair.as_ref());
        let polls = watches.map(|pair| PollFd::new(&pair.watch, PollFlags::IN));
        poll(&mut polls.collect::<Vec<_>>())
    }

    /// Opens (`true`) and closes by clients since the last time.
    pub(crate) fn changes(&mut self) -> Vec<bool> {
        let mut changes = Vec::new();
        let Some(pair) = &self.pair else {
            return changes;
        };
        let mut buffer = [MaybeUninit::uninit(); 2048];
        let mut reader = inotify::Reader::new(&pair.watch, &mut buffer);
        while let Ok(event) = reader.next() {
            let closed = ReadFlags::CLOSE_WRITE | ReadFlags::CLOSE_NOWRITE;
            if event.events().contains(ReadFlags::OPEN) {
                changes.push(true);
            } else if event.events().intersects(closed) {
                changes.push(false);
            }
        }
        changes
    }

    /// The last client has left; what it has not read, and what it has set, is not for the next.
    pub(crate) fn forget_client(&mut self) {
        self.forget_bytes();
        // An epoll may watch it for the next client already, so it needs signs as before.
        self.has_sign = false;
        (self.flows, self.is_full, self.modem) = (false, false, 0);
        if let Some(pair) = &mut self.pair {
            pair.settings.take();
            pair.restore();
        }
    }

    fn forget_bytes(&mut self) {
        self.arrived.clear();
        self.ready.clear();
        self.lines = None;
    }

    /// The client throws away what it has not read.
    pub(crate) fn flush_input(&mut self) {
        self.forget_bytes();
        self.take_sign();
    }

    /// The client changes the settings.
    pub(crate) fn forget_settings(&mut self) {
        self.take_sign();
        if let Some(pair) = &mut self.pair {
            pair.settings.take();
        }
    }

    fn take_sign(&mut self) {
        if let Some(pair) = &self.pair
            && std::mem::take(&mut self.has_sign)
        {
            // It cannot fail on a terminal that is there.
            let _ = rustix::termios::tcflush(&pair.slave, QueueSelector::IFlush);
        }
    }

    fn termios(&self) -> Option<&Termios> {
        let (termios, _) = self.pair.as_ref()?.settings().ok()?;
        Some(termios)
    }

    pub(crate) fn read_rule(&self) -> ReadRule {
        let (mut least, mut patience) = (Some(1), None);
        if let Some(termios) = self.termios() {
            let is_raw = !termios.local_modes.contains(LocalModes::ICANON);
            let [min, tenths] = [SpecialCodeIndex::VMIN, SpecialCodeIndex::VTIME]
                .map(|index| termios.special_codes[index]);
            least = is_raw.then_some(min.into());
            patience =
                (is_raw && tenths > 0).then(|| Duration::from_millis(100 * u64::from(tenths)));
        }
        ReadRule { least, patience }
    }

    /// Bytes that the client could read at once.
    pub(crate) fn unread(&self) -> usize {
        self.ready.len().min(MOST_READ)
    }

    /// Returns whether a read of so many bytes ends at once.
    pub(crate) fn can_be_read(&self, rule: ReadRule, count: usize) -> bool {
        match rule.least {
            _ if rule.never_waits() => true,
            None => self.is_readable(),
            Some(least) => self.unread() >= least.min(count).max(1),
        }
    }

    /// Returns whether a descriptor's path, as the system tells it, leads to it.
    pub(crate) fn leads_to(&self, path: &str) -> bool {
        std::fs::read_link(&self.link).is_ok_and(|node| node.as_os_str() == path)
    }

    /// What a poll says of it.
    pub(crate) fn readiness(&self) -> PollFlags {
        let mut found = PollFlags::empty();
        found.set(
            PollFlags::OUT | PollFlags::WRNORM,
            !self.is_full && !self.is_stopped(),
        );
        found.set(PollFlags::IN | PollFlags::RDNORM, self.is_readable());
        found
    }

    fn is_readable(&self) -> bool {
        let rule = self.read_rule();
        match &self.lines {
            Some(lines) => !lines.is_empty(),
            None => {
                let least = rule.least.filter(|_| rule.patience.is_none());
                self.ready.len() >= least.unwrap_or(1).max(1)
            }
        }
    }

    /// Takes what the client could read, of one line if it reads lines; `None` if it would have to wait.
    pub(crate) fn read(&mut self, most: usize) -> Option<Vec<u8>> {
        let mut count = most.min(MOST_READ).min(self.ready.len());
        if let Some(lines) = &mut self.lines {
            let line = lines.front_mut()?;
            count = count.min(*line);
            *line -= count;
            if *line == 0 {
                lines.pop_front();
            }
        } else if self.ready.is_empty() {
            return None;
        }
        Some(self.ready.drain(..count).collect())
    }

    /// Bytes that a terminal makes of those that are written to it.
    pub(crate) fn cooked(&self, bytes: &[u8]) -> Vec<u8> {
        let modes = self.termios().map(|termios| termios.output_modes);
        let modes = modes.unwrap_or(OutputModes::empty());
        let has = |mode| modes.contains(OutputModes::OPOST | mode);
        let cooked = bytes.iter().flat_map(|&byte| match byte {
            b'\n' if has(OutputModes::ONLCR) => [Some(b'\r'), Some(byte)],
            b'\r' if has(OutputModes::OCRNL) => [Some(b'\n'), None],
            // As the kernel has it, letters of Latin-1.
            b'a'..=b'z' | 0xDF..=0xF6 | 0xF8.. if has(OutputModes::OLCUC) => {
                [Some(byte - 0x20), None]
            }
            _ => [Some(byte), None],
        });
        cooked.flatten().collect()
    }

    /// Bytes that the terminal itself sends, as an echo of what came.
    pub(crate) fn take_echo(&self) -> Vec<u8> {
        let pair = self.pair.as_ref();
        let pair = pair.filter(|pair| self.flows || !pair.is_raw());
        let echo = pair.and_then(|pair| read(&pair.master, MOST_READ));
        echo.unwrap_or_default()
    }
}

impl Drop for Port {
    fn drop(&mut self) {
        self.remove();
    }
}

/// Returns whether any of these is ready.
pub(crate) fn poll(polls: &mut [PollFd<'_>]) -> bool {
    rustix::event::poll(polls, Some(&Timespec::default())).is_ok_and(|count| count > 0)
}

/// Takes what is there; `None` if that fails.
fn read(from: &OwnedFd, most: usize) -> Option<Vec<u8>> {
    let mut bytes = vec![0; most];
    let count = retry_on_intr(|| rustix::io::read(from, &mut bytes[..])).ok()?;
    bytes.truncate(count);
    Some(bytes)
}

impl Pair {
    fn open(baud: u32) -> io::Result<(Self, PathBuf)> {
        let setup = rigsim_pty::PtySetup::raw(baud);
        let (master, node, defaults) =
            rigsim_pty::open_terminal(&setup).map_err(io::Error::other)?;
        let flags = OFlags::RDWR | OFlags::NOCTTY | OFlags::CLOEXEC | OFlags::NONBLOCK;
        let slave = rustix::fs::openat(CWD, &node, flags, Mode::empty())?;
        let device = rustix::fs::fstat(&slave)?.st_rdev;
        let watch = inotify::init(CreateFlags::NONBLOCK | CreateFlags::CLOEXEC)?;
        let events = WatchFlags::OPEN | WatchFlags::CLOSE_WRITE | WatchFlags::CLOSE_NOWRITE;
        inotify::add_watch(&watch, &node, events)?;
        let pair = Self {
            master,
            defaults,
            slave,
            device,
            watch,
            settings: OnceCell::new(),
        };
        Ok((pair, node))
    }

    fn settings(&self) -> io::Result<&(Termios, ClientLine)> {
        if let Some(known) = self.settings.get() {
            return Ok(known);
        }
        let line = rigsim_pty::line_of(&self.slave)?;
        let termios = rustix::termios::tcgetattr(&self.slave)?;
        Ok(self.settings.get_or_init(|| (termios, line)))
    }

    fn is_raw(&self) -> bool {
        self.settings().is_ok_and(|(_, line)| line.raw)
    }

    /// Makes the terminal what it was before any client came. None of it fails on a terminal that is there.
    fn restore(&self) {
        let _ = rustix::termios::tcsetattr(&self.slave, OptionalActions::Now, &self.defaults);
        let _ = rigsim_pty::restore_end(&self.slave);
    }

    /// Writes to the client's end, which has room for what goes there at once.
    fn write(&self, mut bytes: &[u8]) -> io::Result<()> {
        while !bytes.is_empty() {
            // The tick of the tracer interrupts it now and then.
            let count = retry_on_intr(|| rustix::io::write(&self.master, bytes))?;
            bytes = bytes.get(count..).unwrap_or_default();
        }
        Ok(())
    }

    /// Takes what the terminal has made of all that was written: lines, or bytes.
    fn edited(&self, has_lines: bool) -> io::Result<Vec<Vec<u8>>> {
        let mut parts = Vec::new();
        // A poll that finds nothing waits until the terminal has dealt with what was written. A read that does
        // not wait takes what is there, whatever VMIN says.
        while poll(&mut [PollFd::new(&self.slave, PollFlags::IN)]) || !has_lines {
            match read(&self.slave, MOST_READ) {
                Some(bytes) if has_lines || !bytes.is_empty() => parts.push(bytes),
                _ => break,
            }
        }
        Ok(parts)
    }

    /// Returns whether one of these bytes is a signal (`ISIG`), which throws away what has not been read.
    fn discards(&self, termios: &Termios, bytes: &[u8]) -> bool {
        let codes = [
            SpecialCodeIndex::VINTR,
            SpecialCodeIndex::VQUIT,
            SpecialCodeIndex::VSUSP,
        ]
        .map(|code| termios.special_codes[code]);
        let modes = termios.local_modes;
        // Zero is none.
        modes.contains(LocalModes::ISIG)
            && !modes.contains(LocalModes::NOFLSH)
            && bytes.iter().any(|byte| *byte != 0 && codes.contains(byte))
    }

    /// Writes so many bytes of no meaning, for which the terminal neither waits for a line nor sends an echo.
    fn sign(&self, termios: &Termios, count: usize) -> io::Result<()> {
        let set = |termios: &Termios| {
            rustix::termios::tcsetattr(&self.slave, OptionalActions::Now, termios)
        };
        let mut plain = termios.clone();
        plain.local_modes = LocalModes::empty();
        let is_plain = !termios
            .local_modes
            .intersects(LocalModes::ICANON | LocalModes::ECHO);
        if !is_plain {
            set(&plain)?;
        }
        self.write(&vec![0; count])?;
        poll(&mut [PollFd::new(&self.slave, PollFlags::IN)]);
        if !is_plain {
            set(termios)?;
        }
        Ok(())
    }

    /// Closes the master and returns the other end when that is hung up for the clients that have it open: until
    /// then a read there fails, and from then on it finds the end. A process that another thread of
    /// this program starts has the master open as well, until it has become another program.
    fn hang_up(self) -> io::Result<OwnedFd> {
        drop(self.master);
        let begun = Instant::now();
        while begun.elapsed() < PATIENCE {
            let mut slave = [PollFd::new(&self.slave, PollFlags::IN)];
            if poll(&mut slave) && slave[0].revents().contains(PollFlags::ERR) {
                return Ok(self.slave);
            }
            std::thread::yield_now();
        }
        Err(io::Error::other(
            "the client does not find that its cable has been pulled: another process has the other \
             end of its pseudo-terminal open",
        ))
    }
}
