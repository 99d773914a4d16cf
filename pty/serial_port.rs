//! The same device on a real serial port.

use rigsim_settings::ClientLine;
use std::os::fd::AsRawFd as _;
use std::path::{Path, PathBuf};

use rustix::fd::BorrowedFd;
use rustix::fs::{Mode, OFlags};
use rustix::io::{Errno, retry_on_intr};
use serialport::{DataBits, FlowControl, SerialPort as _, StopBits, TTYPort};

use crate::error::{PortError, PortErrorKind};
use crate::hub::{IN, Registration};
use crate::port::{Counters, Event, Port};
use crate::pty_port::write_some;

/// A real serial port, held exclusively: 8 data bits, no parity, no flow control.
#[derive(Debug)]
pub(crate) struct SerialPort {
    registration: Option<Registration>,
    tty: TTYPort,
    path: PathBuf,
    /// It has reported that, and was not unplugged.
    attached: bool,
    counters: Counters,
}

impl SerialPort {
    pub(crate) fn open(path: &Path, baud: u32) -> Result<Self, PortError> {
        let open = || {
            if baud == 0 {
                return Err(PortErrorKind::ZeroBaud);
            }
            let tty = serialport::new(path.to_string_lossy(), baud)
                .data_bits(DataBits::Eight)
                .parity(serialport::Parity::None)
                .stop_bits(StopBits::One)
                .flow_control(FlowControl::None)
                .open_native()
                .map_err(
                    |error| match system_error("opening the serial port", error) {
                        PortErrorKind::System { .. } if !is_terminal(path) => {
                            PortErrorKind::NotSerial
                        }
                        kind => kind,
                    },
                )?;
            let port = Self {
                registration: None,
                tty,
                path: path.to_owned(),
                attached: false,
                counters: Counters::default(),
            };
            // The library sets the port to blocking when it has opened it.
            let flags = rustix::fs::fcntl_getfl(port.fd()).map_err(PortErrorKind::call("fcntl"))?;
            rustix::fs::fcntl_setfl(port.fd(), flags | OFlags::NONBLOCK)
                .map_err(PortErrorKind::call("fcntl"))?;
            Ok(port)
        };
        open().map_err(|kind| PortError::new("open", path, kind))
    }

    fn next_event(&mut self, buf: &mut [u8]) -> Result<Event, PortError> {
        if !self.attached && self.counters.attached == 0 {
            self.attached = true;
            self.counters.attached = 1;
            return Ok(Event::Attached);
        }
        if buf.is_empty() {
            return Ok(Event::Idle);
        }
        match retry_on_intr(|| rustix::io::read(self.fd(), &mut *buf)) {
            Ok(n) if n > 0 => {
                self.counters.received(n);
                Ok(Event::Data(n))
            }
            Err(Errno::AGAIN) => Ok(Event::Idle),
            // A terminal in raw mode has no end of file other than its loss.
            Ok(_) => Err(self.lost("read from", "read", Errno::IO)),
            Err(errno) => Err(self.lost("read from", "read", errno)),
        }
    }

    fn lost(&mut self, action: &'static str, call: &'static str, errno: Errno) -> PortError {
        let kind = match errno {
            Errno::IO | Errno::NXIO | Errno::NODEV | Errno::BADF => {
                self.attached = false;
                PortErrorKind::Unplugged
            }
            errno => PortErrorKind::call(call)(errno),
        };
        PortError::new(action, &self.path, kind)
    }

    #[expect(
        unsafe_code,
        reason = "the serialport crate offers its descriptor only as a number"
    )]
    fn fd(&self) -> BorrowedFd<'_> {
        // SAFETY: the descriptor belongs to `self.tty`, which neither closes
        // nor changes it before it is dropped, and the borrow ends before.
        unsafe { BorrowedFd::borrow_raw(self.tty.as_raw_fd()) }
    }
}

impl Port for SerialPort {
    fn path(&self) -> &Path {
        &self.path
    }

    fn is_attached(&self) -> bool {
        self.attached
    }

    fn counters(&self) -> Counters {
        self.counters
    }

    fn client_line(&self) -> Result<Option<ClientLine>, PortError> {
        Ok(None)
    }

    fn set_line(&mut self, line: ClientLine) -> Result<(), PortError> {
        if line.baud == 0 {
            return Ok(());
        }
        let flow = match line.rts_cts {
            true => FlowControl::Hardware,
            false => FlowControl::None,
        };
        let stop_bits = match line.stop_bits {
            2 => StopBits::Two,
            _ => StopBits::One,
        };
        let tty = &mut self.tty;
        let set = tty
            .set_baud_rate(line.baud)
            .and_then(|()| tty.set_stop_bits(stop_bits))
            .and_then(|()| tty.set_flow_control(flow));
        set.map_err(|error| PortError::new("set", &self.path, system_error("tcsetattr", error)))
    }

    fn read(&mut self, buf: &mut [u8]) -> Result<Event, PortError> {
        let event = self.next_event(buf)?;
        if let Some(registration) = &self.registration {
            registration.mark_polled(event == Event::Idle);
        }
        Ok(event)
    }

    fn write(&mut self, bytes: &[u8]) -> Result<usize, PortError> {
        let accepted =
            write_some(self.fd(), bytes).map_err(|errno| self.lost("write to", "write", errno))?;
        self.counters.sent(accepted, bytes);
        Ok(accepted)
    }

    fn register(&mut self, registration: Registration) -> Result<(), PortError> {
        if let Some(old) = self.registration.take() {
            old.forget(self.fd());
        }
        registration
            .watch(self.fd(), IN)
            .map_err(|kind| PortError::new("watch", &self.path, kind))?;
        self.registration = Some(registration);
        Ok(())
    }
}

fn is_terminal(path: &Path) -> bool {
    let flags = OFlags::RDONLY | OFlags::NONBLOCK | OFlags::NOCTTY;
    rustix::fs::open(path, flags, Mode::empty()).is_ok_and(rustix::termios::isatty)
}

fn system_error(call: &'static str, error: serialport::Error) -> PortErrorKind {
    use std::io::ErrorKind;
    let kind = match error.kind() {
        serialport::ErrorKind::Io(kind) => kind,
        // What the library makes of EBUSY and of a lock held by another.
        serialport::ErrorKind::NoDevice => ErrorKind::ResourceBusy,
        _ => ErrorKind::Other,
    };
    match kind {
        ErrorKind::NotFound => PortErrorKind::NoSuchDevice,
        ErrorKind::PermissionDenied => PortErrorKind::NotPermitted,
        ErrorKind::ResourceBusy => PortErrorKind::Busy,
        _ => PortErrorKind::System {
            call,
            reason: error.into(),
        },
    }
}
