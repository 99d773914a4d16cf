//! A pseudo-terminal in step with its client: all bytes written to it can be read at once.

mod pair;

use std::cell::Cell;
use std::collections::VecDeque;
use std::io;
use std::os::fd::OwnedFd;
use std::path::{Path, PathBuf};

use rigsim_settings::ClientLine;
use rustix::event::{PollFd, PollFlags};
use rustix::termios::{Action, LocalModes};

use pair::{MOST_READ, Pair};
pub(crate) use pair::{ReadRule, poll};

/// Most bytes that go to the kernel at once; its own limit is 4095.
const MOST_IN_KERNEL: usize = 3072;
/// Size of the client's input buffer; further bytes are lost, as on a real port.
const MOST_WAITING: usize = 20_480;
/// Most pseudo-terminals that are kept after their cables were pulled.
const MOST_FORMER: usize = 64;

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

/// A port that clients of a run open under the path of a link.
#[derive(Default)]
pub struct Port {
    link: PathBuf,
    baud: u32,
    pair: Option<Pair>,
    /// Bytes that have arrived, before the terminal's line editing.
    arrived: VecDeque<u8>,
    /// Bytes that the client can read.
    ready: VecDeque<u8>,
    /// Lengths of the lines in these bytes with `ICANON`. An end of file has length 0.
    lines: Option<VecDeque<usize>>,
    /// A client uses an epoll or `O_ASYNC` signals: the kernel has to know whether there are bytes.
    needs_sign: bool,
    /// The kernel has sent the signal, if one was due.
    pub(crate) has_signalled: bool,
    /// The kernel has placeholder bytes for those that wait.
    has_sign: bool,
    /// The client has stopped its output (`tcflow`).
    is_stopped: bool,
    /// The client has stopped or started its input (`tcflow`): the terminal sends a byte.
    flows: bool,
    /// The world had no room for the client's bytes.
    is_full: bool,
    lost: u64,
    /// Open descriptions of it that clients hold.
    pub(crate) opened: usize,
    /// A client may have it open through `/dev/tty`, which no watch reports.
    pub(crate) by_tty: Cell<bool>,
    pub(crate) modem: u32,
    /// Client's ends of ports whose cable was pulled. While they are open, the system does not reuse their
    /// numbers. So no client with an old path opens the port of another run.
    former: VecDeque<OwnedFd>,
}

impl Port {
    /// Creates a port at `baud`. `link` must not exist; it leads to the port while the cable is in.
    ///
    /// # Errors
    /// When the system refuses a pseudo-terminal or the link.
    pub fn new(link: PathBuf, baud: u32) -> io::Result<Self> {
        let mut port = Self::default();
        (port.link, port.baud) = (link, baud);
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

    /// Bytes lost since the last query because the client did not read.
    pub fn take_lost(&mut self) -> u64 {
        std::mem::take(&mut self.lost)
    }

    /// Plugs the cable in: the link leads to a new pseudo-terminal.
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

    /// Pulls the cable: a client that has it open gets a hang-up, and the path is gone. Returns whether it was
    /// open.
    ///
    /// # Errors
    /// When the hang-up has not arrived within a minute.
    pub fn unplug(&mut self) -> io::Result<bool> {
        let Some(pair) = self.remove() else {
            return Ok(false);
        };
        self.forget_bytes();
        self.forget_flow();
        (self.needs_sign, self.has_sign) = (false, false);
        self.former.push_back(pair.hang_up()?);
        if self.former.len() > MOST_FORMER {
            self.former.pop_front();
        }
        Ok(std::mem::take(&mut self.opened) > 0)
    }

    /// Closes both ends and removes the path.
    fn remove(&mut self) -> Option<Pair> {
        let pair = self.pair.take()?;
        // If another program has removed it, it is gone as it should be.
        let _ = std::fs::remove_file(&self.link);
        Some(pair)
    }

    /// Sends the client bytes, which it can read when this returns.
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

    /// Passes new bytes through the terminal's line editing, if it is on, and updates the kernel's placeholder for
    /// an epoll.
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
            // The rest of an incomplete line.
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
        let pair = self.pair.as_ref();
        self.is_stopped || pair.is_some_and(|pair| !pair.is_raw() && !pair.has_room())
    }

    /// The client stops or starts its output or its input (`tcflow`); returns whether the kernel must do it.
    pub(crate) fn flow(&mut self, action: u64) -> bool {
        match action {
            0 | 1 => self.is_stopped = action == 0,
            _ => self.flows = true,
        }
        action != 1 || !(self.is_full && self.needs_sign)
    }

    /// An epoll watches it, or it must send signals.
    pub(crate) fn need_signs(&mut self) -> io::Result<()> {
        self.needs_sign = true;
        if self.is_full {
            self.sign_room(Action::OOff);
        }
        self.top_up()
    }

    /// The world has taken the client's bytes, or as many as there was room for. An epoll sees an edge.
    pub(crate) fn has_sent(&mut self, all: bool) {
        if !std::mem::replace(&mut self.is_full, !all) {
            self.sign_room(Action::OOff);
        }
        if all {
            self.sign_room(Action::OOn);
        } else if let Some(pair) = self.pair.as_ref().filter(|_| self.needs_sign) {
            pair.want_room();
        }
    }

    /// The world may have room again.
    pub(crate) fn make_room(&mut self) {
        if std::mem::take(&mut self.is_full) && !self.is_stopped {
            self.has_signalled |= self.needs_sign;
            self.sign_room(Action::OOn);
        }
    }

    fn sign_room(&self, action: Action) {
        if let Some(pair) = self.pair.as_ref().filter(|_| self.needs_sign) {
            pair.flow(action);
        }
    }

    /// Settings by the client.
    ///
    /// # Errors
    /// When the system reports an error.
    pub fn line(&self) -> io::Result<Option<ClientLine>> {
        let settings = self.pair.as_ref().map(Pair::settings).transpose()?;
        Ok(settings.map(|(_, line)| *line))
    }

    /// Returns whether it is the character device with this number.
    pub(crate) fn is_device(&self, device: u64) -> bool {
        self.pair.as_ref().is_some_and(|pair| pair.device == device)
    }

    /// Returns whether clients may have opened or closed one of these since the last query.
    pub(crate) fn any_changes(ports: &[Self]) -> bool {
        let watches = ports.iter().filter_map(|port| port.pair.as_ref());
        let polls = watches.map(|pair| PollFd::new(&pair.watch, PollFlags::IN));
        poll(&mut polls.collect::<Vec<_>>())
    }

    /// Opens (`true`) and closes (`false`) by clients since the last query.
    pub(crate) fn changes(&self) -> Vec<bool> {
        self.pair.as_ref().map_or(Vec::new(), Pair::changes)
    }

    /// The last client has left: its unread bytes and its settings are discarded.
    pub(crate) fn forget_client(&mut self) {
        self.forget_bytes();
        // An epoll may watch it for the next client already, so it needs signs as before.
        self.has_sign = false;
        self.forget_flow();
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

    fn forget_flow(&mut self) {
        (self.is_stopped, self.flows, self.is_full) = (false, false, false);
        self.modem = 0;
    }

    /// The client discards its unread bytes.
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
            pair.flush();
        }
    }

    pub(crate) fn read_rule(&self) -> ReadRule {
        let pair = self.pair.as_ref();
        pair.map_or(ReadRule::ANY, Pair::read_rule)
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

    /// Returns whether a descriptor's path, as the system reports it, leads to it.
    pub(crate) fn leads_to(&self, path: &str) -> bool {
        std::fs::read_link(&self.link).is_ok_and(|node| node.as_os_str() == path)
    }

    /// Result of a poll.
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

    /// Takes the bytes of a read, up to the end of the line with `ICANON`; `None` if the read has to wait.
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
        let pair = self.pair.as_ref();
        pair.map_or_else(|| bytes.to_vec(), |pair| pair.cooked(bytes))
    }

    /// Bytes that the terminal itself sends, such as an echo.
    pub(crate) fn take_echo(&self) -> Vec<u8> {
        let pair = self.pair.as_ref();
        let pair = pair.filter(|pair| self.flows || !pair.is_raw());
        pair.map_or(Vec::new(), Pair::echo)
    }
}

impl Drop for Port {
    fn drop(&mut self) {
        self.remove();
    }
}
