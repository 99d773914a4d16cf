//! Syscalls on ports: reads, writes, and requests.

use crate::port::Port;
use crate::traced::clock::nanoseconds;
use crate::traced::descriptor::Descriptor;
use crate::traced::memory::{Memory, whole_length};
use crate::traced::sys::Tid;
use crate::traced::syscall::{Entry, Halt, Handling, counted, failure, int};
use crate::traced::tracer::Tracer;
use crate::traced::wait::Wait;
use crate::{copies, modem};

/// Most bytes of one write that are taken; the syscall then says that it was so many.
const MOST_WRITTEN: usize = 1 << 20;

impl Tracer<'_> {
    /// A read of a port into these parts of the client's memory.
    pub(crate) fn read_port(
        &mut self,
        entry: Entry,
        index: usize,
        descriptor: &Descriptor,
        into: Vec<(u64, u64)>,
    ) -> Result<Handling, Halt> {
        let port = &mut self.ports[index];
        // Room from an earlier read belongs to bytes that still wait.
        port.top_up()?;
        let (rule, unread, count) = (port.read_rule(), port.unread(), room(&into));
        let is_there = count == 0 || port.can_be_read(rule, count);
        let at_once = rule.never_waits() || !is_there && descriptor.is_nonblocking();
        if unread == 0
            && at_once
            && let Some(backs_off) = self.query(entry)
        {
            return Ok(backs_off);
        }
        if is_there || at_once {
            return self.receive(entry.tid, index, &into).map(Handling::Answer);
        }
        let patience = rule
            .patience
            .filter(|_| rule.least == Some(0) || unread > 0);
        let deadline = patience.map(|patience| self.now.saturating_add(nanoseconds(patience)));
        let wait = Wait::PortRead {
            port: index,
            device: descriptor.status.device,
            seen: unread,
            rule,
            into,
        };
        Ok(Handling::Block(wait, deadline))
    }

    /// Passes a client what it can read of a port; returns the result of its read.
    pub(crate) fn receive(
        &mut self,
        tid: Tid,
        index: usize,
        into: &[(u64, u64)],
    ) -> Result<i64, Halt> {
        let port = &mut self.ports[index];
        match port.read(room(into)) {
            Some(bytes) => Ok(counted(Memory(tid).write_parts(into, &bytes)?)),
            None if port.read_rule().never_waits() || room(into) == 0 => Ok(0),
            None => Ok(-i64::from(libc::EAGAIN)),
        }
    }

    /// A write of these parts of the client's memory to a port.
    pub(crate) fn write_port(
        &mut self,
        entry: Entry,
        index: usize,
        descriptor: &Descriptor,
        parts: &[(u64, u64)],
    ) -> Result<Handling, Halt> {
        let mut bytes = Vec::new();
        for (address, length) in parts {
            let length = usize::try_from(*length).unwrap_or(usize::MAX);
            let from = bytes.len();
            bytes.resize(from + length.min(MOST_WRITTEN - from), 0);
            Memory(entry.tid).read(*address, bytes.get_mut(from..).unwrap_or_default())?;
        }
        let count = bytes.len();
        bytes = self.ports[index].cooked(&bytes);
        let sent = self.send_to_world(index, &bytes)?;
        if sent == bytes.len() {
            return Ok(Handling::Answer(counted(count)));
        }
        if descriptor.is_nonblocking() {
            if sent > 0 {
                return Ok(Handling::Answer(counted(sent.min(count))));
            }
            return Ok(self.query(entry).unwrap_or(failure(libc::EAGAIN)));
        }
        let wait = Wait::PortWrite {
            port: index,
            device: descriptor.status.device,
            bytes,
            sent,
            count,
        };
        Ok(Handling::Block(wait, None))
    }

    /// Passes bytes to the world; returns how many it took.
    pub(crate) fn send_to_world(&mut self, index: usize, bytes: &[u8]) -> Result<usize, Halt> {
        let Some(line) = self.ports[index].line()? else {
            return Ok(bytes.len());
        };
        if bytes.is_empty() || self.ports[index].is_stopped() {
            return Ok(0);
        }
        let sent = self.world.sent(index, line, self.now, bytes)?;
        self.ports[index].has_sent(sent == bytes.len());
        Ok(sent)
    }

    /// Sends the world a terminal's own output, such as an echo.
    pub(crate) fn send_echoes(&mut self) -> Result<(), Halt> {
        for index in 0..self.ports.len() {
            if self.ports[index].is_open() {
                let echo = self.ports[index].take_echo();
                // Without room, bytes are lost, as on a full line.
                self.send_to_world(index, &echo)?;
            }
        }
        Ok(())
    }

    /// A descriptor is added to an epoll, or is to send signals: the kernel polls it.
    pub(crate) fn polled_by_kernel(&mut self, entry: Entry, fd: i32) -> Result<Handling, Halt> {
        self.pass(entry.tid, [fd])?;
        let descriptor = self.descriptor(entry.process, fd).ok_or(Halt::Make)?;
        if let Some(index) = self.port_of(&descriptor) {
            self.ports[index].need_signs()?;
        }
        Ok(Handling::Make)
    }

    /// A request to a port, or one that only queries.
    pub(crate) fn request(&mut self, entry: Entry) -> Result<Handling, Halt> {
        let [fd, request, argument, ..] = entry.a;
        let request = (request & 0xFFFF_FFFF) as libc::Ioctl;
        if request == libc::FIOASYNC {
            return self.polled_by_kernel(entry, int(fd));
        }
        self.pass(entry.tid, [int(fd)])?;
        let port = self
            .descriptor(entry.process, int(fd))
            .and_then(|descriptor| self.port_of(&descriptor));
        self.poll_ports()?;
        if request == libc::FIONREAD
            && let Some(backs_off) = self.query(entry)
        {
            return Ok(backs_off);
        }
        let index = port.ok_or(Halt::Make)?;
        let memory = Memory(entry.tid);
        let port = &mut self.ports[index];
        match request {
            libc::FIONREAD => {
                port.top_up()?;
                let unread = u32::try_from(port.unread()).unwrap_or(u32::MAX);
                memory.write(argument, &unread.to_ne_bytes())?;
            }
            libc::TCSETS
            | libc::TCSETA
            | libc::TCSETS2
            | libc::TCSETSW
            | libc::TCSETAW
            | libc::TCSETSW2 => {
                port.forget_settings();
                return Ok(Handling::Make);
            }
            libc::TCSETSF | libc::TCSETAF | libc::TCSETSF2 => {
                port.forget_settings();
                port.flush_input();
                return Ok(Handling::Make);
            }
            libc::TCXONC if port.flow(argument) => return Ok(Handling::Make),
            libc::TCXONC => {}
            libc::TCFLSH => {
                if matches!(argument, 0 | 2) {
                    port.flush_input();
                }
                return Ok(Handling::Make);
            }
            libc::TIOCMGET => {
                memory.write(argument, &(port.modem | modem::READ).to_ne_bytes())?;
            }
            libc::TIOCMBIS | libc::TIOCMBIC | libc::TIOCMSET => {
                let given = memory.read_u32(argument)? & (modem::DTR | modem::RTS);
                let lines = match request {
                    libc::TIOCMBIS => port.modem | given,
                    libc::TIOCMBIC => port.modem & !given,
                    _ => given,
                };
                if lines != port.modem {
                    port.modem = lines;
                    self.world.modem_lines(index, self.now, lines)?;
                }
            }
            libc::TIOCMIWAIT => return Ok(Handling::Block(Wait::Forever, None)),
            // Counters of changes and errors: none.
            libc::TIOCGICOUNT => memory.write(argument, &[0; 80])?,
            libc::TIOCGSERIAL => {
                // An adapter: type 16550A with its queue of 16 bytes, at 115200 baud.
                let mut serial = [0_u32; 18];
                serial[0] = 4;
                serial[5] = 16;
                serial[7] = 115_200;
                let bytes: Vec<u8> = serial.iter().flat_map(|word| word.to_ne_bytes()).collect();
                memory.write(argument, &bytes)?;
            }
            libc::TIOCSSERIAL => {}
            _ => return Ok(Handling::Make),
        }
        Ok(Handling::Answer(0))
    }

    /// Reports to the world which ports have been opened and closed, if any may have been.
    pub(crate) fn poll_ports(&mut self) -> Result<(), Halt> {
        if !self.descriptors.ports_used.take() {
            return Ok(());
        }
        let _copies = copies::none();
        let by_tty = self.ports.iter().any(|port| port.by_tty.get());
        if !by_tty && !Port::any_changes(self.ports) {
            return Ok(());
        }
        for index in 0..self.ports.len() {
            let changes = self.ports[index].changes();
            if changes.is_empty() && !self.ports[index].by_tty.get() {
                continue;
            }
            let by_tty = self.holds_port(index, true);
            self.ports[index].by_tty.set(by_tty);
            for is_open in changes {
                if is_open {
                    self.port_opened(index)?;
                } else if !by_tty || self.ports[index].opened > 1 {
                    self.port_closed(index)?;
                }
            }
            // The system reports two opens in a row as one, and none of `/dev/tty`.
            let held = by_tty || self.holds_port(index, false);
            let opened = self.ports[index].opened;
            if held && opened == 0 {
                self.port_opened(index)?;
            } else if !held && opened > 0 {
                self.ports[index].opened = 1;
                self.port_closed(index)?;
            }
        }
        Ok(())
    }

    /// No thread is left, so no port is open. The system may report that later: a process that another thread of
    /// this program starts has copies of the duplicates until it calls exec.
    pub(crate) fn close_ports(&mut self) -> Result<(), Halt> {
        self.descriptors.ports_used.set(true);
        self.poll_ports()?;
        for index in 0..self.ports.len() {
            self.ports[index].opened = self.ports[index].opened.min(1);
            self.port_closed(index)?;
        }
        Ok(())
    }

    fn port_opened(&mut self, index: usize) -> Result<(), Halt> {
        let port = &mut self.ports[index];
        port.opened += 1;
        if port.opened == 1 {
            // An adapter raises both.
            port.modem = modem::DTR | modem::RTS;
            self.schedule.happened += 1;
            self.world.opened(index, self.now)?;
        }
        Ok(())
    }

    fn port_closed(&mut self, index: usize) -> Result<(), Halt> {
        let port = &mut self.ports[index];
        if port.opened == 0 {
            return Ok(());
        }
        port.opened -= 1;
        if port.opened == 0 {
            port.forget_client();
            self.schedule.happened += 1;
            self.world.closed(index, self.now)?;
        }
        Ok(())
    }
}

/// Bytes for which there is room.
pub(crate) fn room(parts: &[(u64, u64)]) -> usize {
    usize::try_from(whole_length(parts)).unwrap_or(usize::MAX)
}
