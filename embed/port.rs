//! The client's end of a port in simulated time.

use std::io::{self, ErrorKind, Read, Write};
use std::time::Duration;

use rigsim_core::line::{ClientLine, MOST_IN_FLIGHT};
use rigsim_core::rig::PortId;
use rigsim_runner::{Run, RunError};
use serialport::{ClearBuffer, DataBits, FlowControl, Parity, SerialPort, StopBits};

use crate::error::Error;
use crate::port_state::PortState;
use crate::simulation::{Device, Simulation, State};

/// Longest wait of a read by default.
const TIMEOUT: Duration = Duration::from_secs(1);
/// Time that a look takes that finds nothing and must not wait, so that time passes for a client
/// that polls.
const LOOK: Duration = Duration::from_micros(100);

/// The client's end of a port of a [`Simulation`], for code that takes a `Box<dyn SerialPort>`.
/// Clones are the same port; it is closed when the last is dropped.
///
/// Nothing waits in real time. A read that has to wait advances simulated time until a byte has
/// arrived or its timeout is over; it returns what has arrived by then, often a single byte, as a
/// real port may. A write puts bytes on the line, where they take their time, and waits only when
/// 4096 are on their way; a flush waits until all have arrived. A read or write when the cable is
/// out fails with [`ErrorKind::BrokenPipe`], and the port has to be opened again.
///
/// Speed and stop bits are those of the client's end: with others than the device's, bytes are
/// garbled as on a line. Other than 8 data bits without parity is refused. Modem lines are those of
/// an adapter with a cable of three wires: inputs are off, outputs go nowhere.
///
/// A look that finds nothing and must not wait ([`SerialPort::bytes_to_read`], or a read with a
/// timeout of zero) takes 100 µs of simulated time, so that a client that polls gets on. Sleeping
/// in real time does not advance simulated time; [`Simulation::advance`] does.
pub struct ClientPort {
    simulation: Simulation,
    /// Index in the state, and which time that it was opened.
    index: usize,
    opened: u64,
    name: String,
    timeout: Duration,
}

impl Device {
    /// Opens its port, as a client does: set to the device's speed, with a timeout of a second.
    ///
    /// # Errors
    /// When it is open already, or its cable is out.
    pub fn open(&self) -> Result<ClientPort, Error> {
        self.open_link(0)
    }

    /// The same of its link with this index: 1 is a mecanum car's ROS link.
    ///
    /// # Errors
    /// When it has no such link, or as [`Device::open`].
    pub fn open_link(&self, link: usize) -> Result<ClientPort, Error> {
        let device = self.index;
        ClientPort::open(&self.simulation, PortId { device, link }, &self.name)
    }
}

impl ClientPort {
    fn open(simulation: &Simulation, id: PortId, name: &str) -> Result<Self, Error> {
        let mut state = simulation.state();
        let State { run, ports } = &mut *state;
        let index = ports.iter().position(|port| port.id == id);
        let (index, port) = index
            .and_then(|index| Some((index, ports.get_mut(index)?)))
            .ok_or_else(|| Error::NoSuchPort {
                wanted: format!("{name}, link {}", id.link),
                known: format!("{name}, link 0"),
            })?;
        let port_name = name.to_owned();
        if port.handles > 0 && !port.hung_up {
            return Err(Error::PortInUse { port: port_name });
        }
        if run.rig().cable_pulled(id) {
            return Err(Error::CablePulled { port: port_name });
        }
        run.attach(id, run.rig().now())?;
        port.line = port.device_line;
        run.set_line(id, port.line);
        port.handles = 1;
        port.opened += 1;
        let opened = port.opened;
        port.hung_up = false;
        port.unread.clear();
        drop(state);
        Ok(Self {
            simulation: simulation.clone(),
            index,
            opened,
            name: port_name,
            timeout: TIMEOUT,
        })
    }

    /// Does something at the port as it is now.
    fn with<T>(
        &self,
        act: impl FnOnce(&mut Run, &mut PortState) -> Result<T, RunError>,
    ) -> io::Result<T> {
        let mut state = self.simulation.state();
        let State { run, ports } = &mut *state;
        let port = &mut ports[self.index];
        port.update(run).map_err(io::Error::other)?;
        if port.hung_up || port.opened != self.opened {
            let why = format!("the cable of {} was pulled", self.name);
            return Err(io::Error::new(ErrorKind::BrokenPipe, why));
        }
        act(run, port).map_err(io::Error::other)
    }

    /// Advances time until `look` returns something, by `most` at most.
    fn wait<T>(
        &self,
        most: Duration,
        mut look: impl FnMut(&mut Run, &mut PortState) -> Result<Option<T>, RunError>,
    ) -> io::Result<T> {
        let due = self.simulation.now() + most;
        loop {
            if let Some(found) = self.with(&mut look)? {
                return Ok(found);
            }
            let mut state = self.simulation.state();
            let next = state.run.next_deadline();
            let is_over = state.run.rig().now() >= due;
            if is_over || next.is_none() {
                let why = format!("nothing happens at the port of {} in time", self.name);
                return Err(io::Error::new(ErrorKind::TimedOut, why));
            }
            let next = next.unwrap_or(due).min(due);
            state.advance(next).map_err(io::Error::other)?;
        }
    }

    fn set_line(&self, change: impl FnOnce(&mut ClientLine)) -> serialport::Result<()> {
        self.with(|run, port| {
            change(&mut port.line);
            run.set_line(port.id, port.line);
            Ok(())
        })
        .map_err(serialport::Error::from)
    }

    fn line(&self) -> serialport::Result<ClientLine> {
        Ok(self.with(|_, port| Ok(port.line))?)
    }
}

impl Read for ClientPort {
    fn read(&mut self, buf: &mut [u8]) -> io::Result<usize> {
        if buf.is_empty() {
            return Ok(0);
        }
        self.wait(self.timeout.max(LOOK), |_, port| {
            let count = port.unread.len().min(buf.len());
            for (to, from) in buf.iter_mut().zip(port.unread.drain(..count)) {
                *to = from;
            }
            Ok((count > 0).then_some(count))
        })
    }
}

impl Write for ClientPort {
    fn write(&mut self, buf: &[u8]) -> io::Result<usize> {
        if buf.is_empty() {
            return Ok(0);
        }
        self.wait(self.timeout, |run, port| {
            let count = run.rig().space(port.id).min(buf.len());
            if count == 0 {
                return Ok(None);
            }
            run.send(port.id, run.rig().now(), &buf[..count])?;
            Ok(Some(count))
        })
    }

    fn flush(&mut self) -> io::Result<()> {
        self.wait(Duration::MAX, |run, port| {
            Ok((run.rig().space(port.id) == MOST_IN_FLIGHT).then_some(()))
        })
    }
}

impl Drop for ClientPort {
    fn drop(&mut self) {
        let mut state = self.simulation.state();
        let State { run, ports } = &mut *state;
        let port = &mut ports[self.index];
        if port.opened != self.opened {
            return;
        }
        port.handles -= 1;
        if port.handles == 0 && !port.hung_up {
            // A simulation that cannot go on says so at the next call that advances it.
            let _ = run.detach(port.id, run.rig().now());
        }
    }
}

/// Refuses what a line of this simulator cannot be set to.
fn refuse<T>(what: &str) -> serialport::Result<T> {
    let kind = serialport::ErrorKind::InvalidInput;
    Err(serialport::Error::new(kind, format!("{what} is refused")))
}

impl SerialPort for ClientPort {
    fn name(&self) -> Option<String> {
        Some(self.name.clone())
    }

    fn baud_rate(&self) -> serialport::Result<u32> {
        Ok(self.line()?.baud)
    }

    fn data_bits(&self) -> serialport::Result<DataBits> {
        Ok(DataBits::Eight)
    }

    fn flow_control(&self) -> serialport::Result<FlowControl> {
        Ok(self.with(|_, port| Ok(port.flow_control))?)
    }

    fn parity(&self) -> serialport::Result<Parity> {
        Ok(Parity::None)
    }

    fn stop_bits(&self) -> serialport::Result<StopBits> {
        Ok(match self.line()?.stop_bits {
            2 => StopBits::Two,
            _ => StopBits::One,
        })
    }

    fn timeout(&self) -> Duration {
        self.timeout
    }

    fn set_baud_rate(&mut self, baud: u32) -> serialport::Result<()> {
        if baud == 0 {
            return refuse("a speed of 0 baud");
        }
        self.set_line(|line| line.baud = baud)
    }

    fn set_data_bits(&mut self, data_bits: DataBits) -> serialport::Result<()> {
        match data_bits {
            DataBits::Eight => Ok(()),
            _ => refuse("any number of data bits but 8"),
        }
    }

    fn set_flow_control(&mut self, flow_control: FlowControl) -> serialport::Result<()> {
        Ok(self.with(|_, port| {
            port.flow_control = flow_control;
            Ok(())
        })?)
    }

    fn set_parity(&mut self, parity: Parity) -> serialport::Result<()> {
        match parity {
            Parity::None => Ok(()),
            _ => refuse("a parity bit"),
        }
    }

    fn set_stop_bits(&mut self, stop_bits: StopBits) -> serialport::Result<()> {
        self.set_line(|line| {
            line.stop_bits = match stop_bits {
                StopBits::One => 1,
                StopBits::Two => 2,
            }
        })
    }

    fn set_timeout(&mut self, timeout: Duration) -> serialport::Result<()> {
        self.timeout = timeout;
        Ok(())
    }

    fn write_request_to_send(&mut self, _level: bool) -> serialport::Result<()> {
        Ok(())
    }

    fn write_data_terminal_ready(&mut self, _level: bool) -> serialport::Result<()> {
        Ok(())
    }

    fn read_clear_to_send(&mut self) -> serialport::Result<bool> {
        Ok(false)
    }

    fn read_data_set_ready(&mut self) -> serialport::Result<bool> {
        Ok(false)
    }

    fn read_ring_indicator(&mut self) -> serialport::Result<bool> {
        Ok(false)
    }

    fn read_carrier_detect(&mut self) -> serialport::Result<bool> {
        Ok(false)
    }

    fn bytes_to_read(&self) -> serialport::Result<u32> {
        let found = self.wait(LOOK, |_, port| {
            Ok(u32::try_from(port.unread.len())
                .ok()
                .filter(|count| *count > 0))
        });
        match found {
            Err(error) if error.kind() == ErrorKind::TimedOut => Ok(0),
            found => Ok(found?),
        }
    }

    fn bytes_to_write(&self) -> serialport::Result<u32> {
        let waiting = self.with(|run, port| Ok(MOST_IN_FLIGHT - run.rig().space(port.id)))?;
        Ok(u32::try_from(waiting).unwrap_or(u32::MAX))
    }

    /// Drops what has arrived. What was written is on the line already, and arrives.
    fn clear(&self, buffer: ClearBuffer) -> serialport::Result<()> {
        let input = matches!(buffer, ClearBuffer::Input | ClearBuffer::All);
        Ok(self.with(|_, port| {
            if input {
                port.unread.clear();
            }
            Ok(())
        })?)
    }

    fn try_clone(&self) -> serialport::Result<Box<dyn SerialPort>> {
        self.with(|_, port| {
            port.handles += 1;
            Ok(())
        })?;
        Ok(Box::new(Self {
            simulation: self.simulation.clone(),
            index: self.index,
            opened: self.opened,
            name: self.name.clone(),
            timeout: self.timeout,
        }))
    }

    fn set_break(&self) -> serialport::Result<()> {
        Ok(())
    }

    fn clear_break(&self) -> serialport::Result<()> {
        Ok(())
    }
}
