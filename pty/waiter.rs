//! Waiting for any of many ports, for something else to read, for a signal, or for the time to
//! pass.

use std::mem::MaybeUninit;
use std::num::NonZeroU64;
use std::sync::Arc;
use std::time::{Duration, Instant};

use rustix::event::{Timespec, epoll};
use rustix::fd::AsFd;
use rustix::io::Errno;
use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};

use crate::error::{PortError, PortErrorKind};
use crate::hub::{Hub, INOTIFY, Registration, SIGNALS};
use crate::port::Port;
use crate::signals::Signals;

/// Descriptors reported by one call of the system. More than these wait for
/// the next call; none is lost.
const EVENTS: usize = 256;
/// Descriptors that serving opens for a moment.
const HEADROOM: usize = 4;

/// Waits for events of ports and for signals.
#[derive(Debug)]
pub struct Waiter {
    hub: Arc<Hub>,
    signals: Option<Signals>,
    wake: Wake,
}

/// Reason for which [`Waiter::wait`] returned. Neither a port nor a signal means that the
/// time is up.
#[derive(Debug, Default)]
pub struct Wake {
    signalled: bool,
    ready: Vec<usize>,
}

impl Wake {
    /// Returns whether a signal has arrived that asks the program to stop.
    #[must_use]
    pub fn is_signalled(&self) -> bool {
        self.signalled
    }

    /// The tokens of the ports with events, each once, in ascending order.
    #[must_use]
    pub fn ready(&self) -> &[usize] {
        &self.ready
    }
}

impl Waiter {
    /// Makes a waiter for no ports yet.
    ///
    /// # Errors
    ///
    /// When the system's limits on descriptors or watches are reached.
    pub fn new() -> Result<Self, PortError> {
        Ok(Self {
            hub: Hub::new().map_err(waiting)?,
            signals: None,
            wake: Wake::default(),
        })
    }

    /// Makes sure that the few descriptors can be opened that ports need for a moment when clients
    /// come and go, so that a limit is met at the start and not while clients are served.
    ///
    /// # Errors
    ///
    /// When the limit on descriptors leaves no room for them.
    pub fn check_headroom(&self) -> Result<(), PortError> {
        let spare = (0..HEADROOM).map(|_| rustix::io::fcntl_dupfd_cloexec(self.hub.epoll(), 0));
        spare
            .collect::<Result<Vec<_>, _>>()
            .map(drop)
            .map_err(|errno| waiting(PortErrorKind::call("fcntl")(errno)))
    }

    /// Makes `SIGINT`, `SIGTERM`, `SIGHUP` and `SIGXCPU` end a wait instead of the
    /// program. Once the waiter is dropped they do nothing at all. A `SIGHUP`
    /// that was ignored from the start, as under `nohup`, stays ignored.
    ///
    /// # Errors
    ///
    /// When the system refuses.
    pub fn catch_signals(&mut self) -> Result<(), PortError> {
        if self.signals.is_some() {
            return Ok(());
        }
        let signals = Signals::catch().map_err(|reason| {
            waiting(PortErrorKind::System {
                call: "sigaction",
                reason,
            })
        })?;
        let data = epoll::EventData::new_u64(SIGNALS);
        epoll::add(self.hub.epoll(), &signals, data, epoll::EventFlags::IN)
            .map_err(PortErrorKind::call("epoll_ctl"))
            .map_err(waiting)?;
        self.signals = Some(signals);
        Ok(())
    }

    /// Waits for this port too, from now until it is dropped or added to
    /// another waiter. The first wait after this reports it once in any case.
    ///
    /// # Errors
    ///
    /// When the system refuses.
    pub fn add(&mut self, token: usize, port: &mut Box<dyn Port>) -> Result<(), PortError> {
        let registration = Registration::new(Arc::clone(&self.hub), token);
        registration.mark_ready();
        port.register(registration)
    }

    /// Makes waits also end when this can be read or has come to its end, under
    /// a token that no port has; until it is closed.
    ///
    /// # Errors
    ///
    /// When the system refuses.
    pub fn watch(&mut self, token: usize, source: impl AsFd) -> Result<(), PortError> {
        // A usize has no more than 64 bits here.
        let data = epoll::EventData::new_u64(token as u64);
        epoll::add(self.hub.epoll(), source, data, epoll::EventFlags::IN)
            .map_err(PortErrorKind::call("epoll_ctl"))
            .map_err(waiting)
    }

    /// Waits until a port has events, a signal arrives or `timeout` has passed,
    /// for ever with `None`.
    ///
    /// A port that is called ready must be read at least once, or the next
    /// wait may return at once.
    ///
    /// # Errors
    ///
    /// When the system refuses.
    pub fn wait(&mut self, timeout: Option<Duration>) -> Result<&Wake, PortError> {
        self.wake.ready.clear();
        self.wake.signalled = false;
        self.wait_for_events(timeout)?;
        self.hub.take_ready(&mut self.wake.ready);
        self.wake.ready.sort_unstable();
        self.wake.ready.dedup();
        Ok(&self.wake)
    }

    /// Waits for at most `timeout` until a port is ready or a signal has arrived.
    fn wait_for_events(&mut self, timeout: Option<Duration>) -> Result<(), PortError> {
        let begun = Instant::now();
        loop {
            let left = timeout.map(|timeout| timeout.saturating_sub(begun.elapsed()));
            let pending = self.hub.has_ready();
            self.take_events(if pending { Some(Duration::ZERO) } else { left })?;
            let found = pending
                || self.hub.has_ready()
                || self.wake.signalled
                || !self.wake.ready.is_empty();
            if found || left == Some(Duration::ZERO) {
                return Ok(());
            }
        }
    }

    /// Takes what the system reports within `timeout`, which may concern no port.
    fn take_events(&mut self, timeout: Option<Duration>) -> Result<(), PortError> {
        // A wait too long for the system's clock is one without an end.
        let timeout = timeout.and_then(|timeout| Timespec::try_from(timeout).ok());
        let mut space = [MaybeUninit::uninit(); EVENTS];
        let events = match epoll::wait(self.hub.epoll(), &mut space, timeout.as_ref()) {
            Ok((events, _)) => events,
            // A handler ran. Its pipe is readable by now, and the next wait returns at once.
            Err(Errno::INTR) => return Ok(()),
            Err(errno) => return Err(waiting(PortErrorKind::call("epoll_pwait2")(errno))),
        };
        for event in &*events {
            match event.data.u64() {
                INOTIFY => self.hub.drain().map_err(waiting)?,
                SIGNALS => self.wake.signalled |= self.signals.as_mut().is_some_and(Signals::take),
                // Tokens were made from a usize.
                token => self.wake.ready.extend(usize::try_from(token)),
            }
        }
        Ok(())
    }
}

/// Makes the waits of the calling thread end on time.
///
/// By default Linux ends them up to 50 µs late to save power, which is half a
/// byte at 115200 baud. Meant for the one thread that paces bytes.
///
/// # Errors
///
/// When the system refuses.
pub fn sharpen_timers() -> Result<(), PortError> {
    rustix::thread::set_current_timer_slack(NonZeroU64::new(1))
        .map_err(PortErrorKind::call("prctl"))
        .map_err(waiting)
}

/// Allows this process as many file descriptors as it may allow itself, if `count` are more than it has.
/// Programs that it starts get as many, so it is for a caller that needs them.
pub fn want_descriptors(count: u64) {
    let Rlimit { current, maximum } = getrlimit(Resource::Nofile);
    if current.is_some_and(|current| current < count) {
        let current = maximum;
        // Refused, it is as it was, and opening too many is an error.
        let _ = setrlimit(Resource::Nofile, Rlimit { current, maximum });
    }
}

fn waiting(kind: PortErrorKind) -> PortError {
    PortError::new("wait for", "ports and signals", kind)
}
