//! What the firmware of every device has around its program: supply, boot, bugs, and queues of what it
//! sends and reports.

use std::borrow::Cow;
use std::time::Duration;

use rigsim_settings::{SimTime, show_duration};

use crate::defects::{DefectCounts, Defects};
use crate::event::{Code, EventKind, code};
use crate::newest::Newest;

/// Most events kept until they are taken; the oldest go first.
const MOST_EVENTS: usize = 1024;

/// State around a program that sends `O` and has a status `S`.
#[derive(Debug, Clone)]
pub struct Shell<O, S> {
    pub(crate) defects: Defects,
    pub(crate) counts: DefectCounts,
    /// The status that is reported in place of the present one.
    pub(crate) stuck_status: Option<S>,
    /// Time at which the firmware is up, while it is not.
    pub(crate) boot_due: Option<SimTime>,
    /// The latest time that it knows: what turns out to have been due before that, as when it hung, is
    /// done then.
    not_before: SimTime,
    output: Newest<O>,
    events: Newest<(SimTime, EventKind)>,
}

impl<O, S> Shell<O, S> {
    /// A firmware that is up. Of more outputs than these the oldest are lost.
    pub(crate) fn new(most_outputs: usize) -> Self {
        Self {
            defects: Defects::default(),
            counts: DefectCounts::default(),
            stuck_status: None,
            boot_due: None,
            not_before: SimTime::ZERO,
            output: Newest::new(most_outputs),
            events: Newest::new(MOST_EVENTS),
        }
    }

    pub(crate) fn send(&mut self, output: O) {
        self.output.push(output);
    }

    /// Reports an event that is its code and its words.
    pub(crate) fn emit(&mut self, now: SimTime, code: Code, text: impl Into<Cow<'static, str>>) {
        self.report(now, EventKind::new(code, text));
    }

    pub(crate) fn report(&mut self, now: SimTime, event: EventKind) {
        self.events.push((now, event));
    }

    /// Returns the time by which the next reply, packet or line is late.
    pub(crate) fn slowness(&mut self) -> Duration {
        self.counts.slow += u64::from(!self.defects.slow.is_zero());
        self.defects.slow
    }
}

/// A firmware: a program in a [`Shell`].
pub trait Firmware {
    /// What it sends.
    type Output;
    /// The status that it may no longer update.
    type Status;
    /// Its name in events, with its article.
    const NAME: &'static str;

    /// Returns the shell.
    fn shell(&self) -> &Shell<Self::Output, Self::Status>;

    /// Returns the shell, to change.
    fn shell_mut(&mut self) -> &mut Shell<Self::Output, Self::Status>;

    /// Returns whether it had a supply when that was last measured.
    fn has_supply(&self) -> bool;

    /// Returns the time of what the program next does by itself; it is up.
    fn due(&self) -> Option<SimTime>;

    /// Does what is due at `now` and not earlier; it is up.
    fn serve(&mut self, now: SimTime);

    /// Begins the program.
    fn start(&mut self, now: SimTime);

    /// Loses everything that the program knows.
    fn forget(&mut self);

    /// Returns the status of `now`.
    fn status_to_keep(&self, now: SimTime) -> Self::Status;

    /// Takes a watchdog into use again that did not fire.
    fn mend_watchdog(&mut self, now: SimTime);

    /// Returns whether the firmware has a supply and is up.
    fn runs(&self) -> bool {
        self.has_supply() && self.shell().boot_due.is_none()
    }

    /// Does everything that is due by `now`.
    fn advance(&mut self, now: SimTime) {
        // Each round removes the deadline that it serves or moves it later.
        while let Some(due) = self.next_deadline().filter(|due| *due <= now) {
            let now = due.max(self.shell().not_before);
            match self.shell().boot_due {
                Some(_) => self.boot(now),
                None => self.serve(now),
            }
        }
    }

    /// Does what is due before `now`, so that what happens at `now` comes before its deadlines.
    fn advance_before(&mut self, now: SimTime) {
        if let Some(nanos) = now.as_nanos().checked_sub(1) {
            self.advance(SimTime::from_nanos(nanos));
        }
        self.shell_mut().not_before = now;
    }

    /// Time at which something next happens by itself. A firmware that hangs does not even boot.
    fn next_deadline(&self) -> Option<SimTime> {
        let shell = self.shell();
        match shell.boot_due {
            Some(_) => shell.boot_due.filter(|_| !shell.defects.hung),
            None => self.due(),
        }
    }

    /// Returns whether output or events wait to be taken.
    fn has_output(&self) -> bool {
        !self.shell().output.is_empty() || !self.shell().events.is_empty()
    }

    /// Takes the next frame, packet or line.
    fn poll_output(&mut self) -> Option<Self::Output> {
        self.shell_mut().output.pop()
    }

    /// Takes the next event and when it happened.
    fn poll_event(&mut self) -> Option<(SimTime, EventKind)> {
        self.shell_mut().events.pop()
    }

    /// Returns whether the firmware takes bytes that have arrived.
    fn hears(&mut self, bytes: usize) -> bool {
        let runs = self.runs();
        let shell = self.shell_mut();
        if shell.defects.hung && runs {
            shell.counts.hung += bytes as u64;
        }
        runs && !shell.defects.hung
    }

    /// Without a supply the firmware forgets everything; with one again it boots.
    fn update_supply(&mut self, now: SimTime, had_supply: bool, boot_time: Duration) {
        match (had_supply, self.has_supply()) {
            (true, false) => {
                self.forget();
                self.shell_mut().boot_due = None;
                self.emit_power_lost(now);
            }
            (false, true) => {
                self.shell_mut().boot_due = Some(now + boot_time);
                self.boot(now);
            }
            _ => {}
        }
    }

    /// Reports that its supply is gone.
    fn emit_power_lost(&mut self, now: SimTime) {
        let text = format!("{} lost its supply and is silent", Self::NAME);
        self.shell_mut().emit(now, code::POWER_LOST, text);
    }

    /// Begins the program if it is time.
    fn boot(&mut self, now: SimTime) {
        let boot_due = &mut self.shell_mut().boot_due;
        if boot_due.take_if(|due| *due <= now).is_some() {
            self.start(now);
            let text = format!("{} has started", Self::NAME);
            self.shell_mut().emit(now, code::STARTED, text);
        }
    }

    /// The firmware restarts, and is up after `boot`; says whether it ran.
    fn reset(&mut self, now: SimTime, boot: Duration) -> bool {
        self.advance_before(now);
        if !self.has_supply() {
            return false;
        }
        self.forget();
        self.shell_mut().boot_due = Some(now + boot);
        let (name, silence) = (Self::NAME, show_duration(boot));
        let text = format!("{name}'s firmware restarts; it is silent for {silence}");
        self.shell_mut().emit(now, code::FIRMWARE_RESET, text);
        true
    }

    /// Replaces all that is wrong with the firmware.
    fn set_defects(&mut self, now: SimTime, defects: Defects) {
        self.advance_before(now);
        if self.shell().defects.watchdog_off && !defects.watchdog_off {
            self.mend_watchdog(now);
        }
        let status = match &self.shell().stuck_status {
            None if defects.stuck_status => Some(self.status_to_keep(now)),
            _ => None,
        };
        let shell = self.shell_mut();
        if !defects.stuck_status {
            shell.stuck_status = None;
        } else if status.is_some() {
            shell.stuck_status = status;
        }
        shell.defects = defects;
    }

    /// Number of times that each defect has had an effect.
    fn defect_counts(&self) -> &DefectCounts {
        &self.shell().counts
    }
}
