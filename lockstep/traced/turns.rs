//! Turns: one thread runs at a time, until it waits.

use crate::traced::arch::{self, Registers};
use crate::traced::entry::Entry;
use crate::traced::memory::Memory;
use crate::traced::sys::{self, Tid};
use crate::traced::tracer::{Halt, Handling, Tracer};
use crate::traced::tree::{Resume, Shown, State, Thread};
use crate::traced::wait::{Hold, Wait};

/// Time that one ask costs a thread that does nothing but ask.
const CREEP: u64 = 20_000;

/// Asks in a row that cost nothing.
const FREE_ASKS: u32 = 1000;

impl Tracer<'_> {
    /// Thread to go on: the one that ran last, or the first of those that can.
    pub(crate) fn next(&self) -> Option<Tid> {
        if let Some(tid) = self.current
            && self.threads.get(&tid).is_some_and(Thread::is_ready)
        {
            return Some(tid);
        }
        let ready = self.threads.iter().filter(|(_, thread)| thread.is_ready());
        let first = ready.min_by_key(|(_, thread)| (thread.turn, thread.number));
        first.map(|(tid, _)| *tid)
    }

    pub(crate) fn resume(&mut self, tid: Tid) -> Result<(), Halt> {
        let Some(thread) = self.threads.get_mut(&tid) else {
            return Ok(());
        };
        let State::Ready(resume) = thread.state else {
            return Ok(());
        };
        thread.state = State::Running;
        thread.turn = 0;
        if !thread.retries {
            self.happened += 1;
        }
        let has_end = thread.at_end.is_some();
        self.share_processor();
        match resume {
            Resume::Go(signal) if has_end => {
                sys::go_on_to_end_of_call(tid, signal)?;
            }
            Resume::Go(signal) => {
                self.show_clocks(tid)?;
                sys::go_on(tid, signal)?;
            }
            Resume::Call { crept } => {
                self.calls += 1;
                let registers = Registers::of(tid)?;
                let action = match self.call(tid, registers, crept) {
                    Err(Halt::Fault) => Handling::Make,
                    action => action?,
                };
                self.act(tid, registers, action)?;
            }
        }
        self.wait_for_current().map_err(Halt::Failed)
    }

    /// Does with a call what has been decided.
    fn act(&mut self, tid: Tid, mut registers: Registers, action: Handling) -> Result<(), Halt> {
        match action {
            Handling::Make => {
                self.show_clocks(tid)?;
                sys::go_on(tid, 0)?;
            }
            Handling::Answer(result) => {
                registers.answer(result);
                registers.set(tid)?;
                self.set_state(tid, State::Ready(Resume::Go(0)));
            }
            Handling::Hold(wait, deadline) => self.hold(tid, registers, wait, deadline),
            Handling::ToEnd(changed, at_end) => {
                changed.set(tid)?;
                self.look_at_end(tid, at_end);
                sys::go_on_to_end_of_call(tid, 0)?;
            }
        }
        Ok(())
    }

    pub(crate) fn hold(
        &mut self,
        tid: Tid,
        registers: Registers,
        wait: Wait,
        deadline: Option<u64>,
    ) {
        self.waits += 1;
        let hold = Hold {
            registers,
            wait,
            deadline,
            since: self.waits,
            looked_at: self.happened,
        };
        let creeps = matches!(hold.wait, Wait::Creep);
        if let Some(thread) = self.threads.get_mut(&tid) {
            if !creeps {
                thread.asks = 0;
            }
            thread.state = State::Held(Box::new(hold));
        }
    }

    pub(crate) fn set_state(&mut self, tid: Tid, state: State) {
        if let Some(thread) = self.threads.get_mut(&tid) {
            thread.state = state;
        }
    }

    /// A thread asks and waits for nothing; after many of these each takes a little time. `None` if
    /// it may be answered at once.
    pub(crate) fn ask(&mut self, entry: Entry) -> Option<Handling> {
        let thread = self.threads.get_mut(&entry.tid)?;
        thread.asks = thread.asks.saturating_add(1);
        if entry.crept || thread.asks <= FREE_ASKS {
            return None;
        }
        Some(Handling::Hold(Wait::Creep, Some(self.now + CREEP)))
    }

    /// A thread lets the others go first.
    pub(crate) fn give_way(&mut self, tid: Tid) {
        self.turns += 1;
        let turn = self.turns;
        if let Some(thread) = self.threads.get_mut(&tid) {
            thread.turn = turn;
        }
        self.current = None;
    }

    /// Has the clocks in a program's own memory show what they should, before it goes on.
    fn show_clocks(&mut self, tid: Tid) -> Result<(), Halt> {
        let Some(thread) = self.threads.get(&tid) else {
            return Ok(());
        };
        let process = self.processes.get_mut(&thread.process);
        let Some(clocks) = process.and_then(|process| process.clocks.as_mut()) else {
            return Ok(());
        };
        let shown = Shown {
            real: self.clocks.real(self.now),
            monotonic: self.clocks.monotonic(self.now),
            // Who has asked much, and waited for nothing since, has to ask here.
            asks: if thread.asks < FREE_ASKS {
                FREE_ASKS
            } else {
                0
            },
        };
        if clocks.shown != Some(shown) {
            let times = (shown.real, shown.monotonic);
            arch::write_clocks(Memory(tid), clocks.page, shown.asks, times)?;
            clocks.shown = Some(shown);
        }
        Ok(())
    }
}
