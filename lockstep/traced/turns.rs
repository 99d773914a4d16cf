//! Turns: one thread runs at a time, until it waits.

use rand_pcg::rand_core::Rng as _;

use crate::traced::arch::{self, Registers};
use crate::traced::memory::Memory;
use crate::traced::proc::name_of;
use crate::traced::sys::{self, Tid};
use crate::traced::syscall::{Entry, Halt, Handling};
use crate::traced::tracer::Tracer;
use crate::traced::tree::{Shown, State, Thread};
use crate::traced::wait::{Block, Resume, Wait};

/// Simulated time that a query or another syscall costs if there are too many.
const BACK_OFF: u64 = 20_000;

/// Simulated time that passes when a thread has computed for long, and after each further interval.
const PREEMPTED: u64 = 10_000_000;

/// Free queries of a thread; simulated time that passes otherwise restores as many as it would pay for.
const FREE_QUERIES: u32 = 1000;

/// The same for the syscalls of all threads, which take no time while threads only wake one another.
const FREE_CALLS: u32 = 20_000;

impl Tracer<'_> {
    /// The next thread: the one that ran last, else the first that can run; or a random one.
    pub(crate) fn next(&mut self) -> Option<Tid> {
        let current = self.schedule.current;
        let can = |tid: &Tid| self.tree.threads.get(tid).is_some_and(Thread::is_ready);
        if self.schedule.choices.is_none()
            && let Some(tid) = current.filter(can)
        {
            return Some(tid);
        }
        let ready = self.tree.all(Thread::is_ready);
        match &mut self.schedule.choices {
            // Where there is a choice.
            Some(choices) if ready.len() > 1 => {
                let at = choices.next_u64() % ready.len() as u64;
                ready.get(usize::try_from(at).ok()?).copied()
            }
            _ => {
                let turn = |tid: &Tid| self.tree.threads.get(tid).map(|thread| thread.turn);
                ready.into_iter().min_by_key(turn)
            }
        }
    }

    pub(crate) fn resume(&mut self, tid: Tid) -> Result<(), Halt> {
        let Some(thread) = self.tree.threads.get_mut(&tid) else {
            return Ok(());
        };
        let State::Ready(resume) = thread.state else {
            return Ok(());
        };
        thread.state = State::Running;
        thread.turn = 0;
        self.schedule.happened += 1;
        self.processor.share(&self.tree.threads);
        match resume {
            Resume::Go(signal) => {
                self.close_kept(tid)?;
                self.show_clocks(tid)?;
                sys::resume(tid, signal)?;
            }
            Resume::TimeStamp { length } => {
                let mut registers = Registers::of(tid)?;
                registers.read_time_stamp(length, self.clocks.monotonic(self.now));
                registers.set(tid)?;
                self.show_clocks(tid)?;
                sys::resume(tid, 0)?;
            }
            Resume::Syscall { backed_off } => {
                self.report.calls += 1;
                self.tree.thread(tid)?.preempted = false;
                let registers = Registers::of(tid)?;
                // A repeated syscall has been counted already.
                let action =
                    if !backed_off && counted(&mut self.schedule.paid, self.now, FREE_CALLS) {
                        Ok(self.back_off())
                    } else {
                        self.call(tid, registers, backed_off)
                    };
                self.act(tid, registers, action)?;
            }
        }
        self.wait_for_current().map_err(Halt::Failed)
    }

    /// Applies the handling of a syscall.
    fn act(
        &mut self,
        tid: Tid,
        mut registers: Registers,
        action: Result<Handling, Halt>,
    ) -> Result<(), Halt> {
        match action {
            Ok(Handling::Make) | Err(Halt::Make) => {
                self.show_clocks(tid)?;
                sys::resume(tid, 0)?;
            }
            Err(Halt::Again) => {
                registers.make_again();
                registers.set(tid)?;
                sys::resume(tid, 0)?;
            }
            Err(halt) => return Err(halt),
            Ok(Handling::Answer(result)) => {
                registers.answer(tid, result)?;
                self.tree.set_state(tid, State::Ready(Resume::Go(0)));
            }
            Ok(Handling::Block(wait, deadline)) => self.block(tid, registers, wait, deadline),
        }
        Ok(())
    }

    pub(crate) fn block(
        &mut self,
        tid: Tid,
        registers: Registers,
        wait: Wait,
        deadline: Option<u64>,
    ) {
        self.schedule.waits += 1;
        // A wait that is already over counts as a query of the clock.
        let queries = deadline.is_some_and(|deadline| deadline <= self.now);
        let block = Block {
            registers,
            wait,
            deadline: deadline.map(|deadline| deadline.max(self.now)),
            since: self.schedule.waits,
            polled_at: self.schedule.happened,
        };
        if queries {
            self.queries_much(tid);
        }
        self.tree.set_state(tid, State::Blocked(Box::new(block)));
    }

    /// A thread queries while no time passes: it may wait for nothing, or for threads that also only query. After
    /// many queries, each takes a little time. `None` if it may be answered at once.
    pub(crate) fn query(&mut self, entry: Entry) -> Option<Handling> {
        let backs_off = !entry.backed_off && self.queries_much(entry.tid);
        backs_off.then(|| self.back_off())
    }

    fn back_off(&self) -> Handling {
        let again = Resume::Syscall { backed_off: true };
        Handling::Block(Wait::BackOff(again), Some(self.now + BACK_OFF))
    }

    /// Counts a query; returns whether the thread has made too many.
    fn queries_much(&mut self, tid: Tid) -> bool {
        let thread = self.tree.threads.get_mut(&tid);
        thread.is_some_and(|thread| counted(&mut thread.paid, self.now, FREE_QUERIES))
    }

    /// A thread is at an instruction that reads the time stamp counter, which is a query of the clock.
    pub(crate) fn time_stamp(&mut self, tid: Tid, length: u64) -> Result<(), Halt> {
        let registers = Registers::of(tid)?;
        self.restore_fault_action(tid)?;
        if self.queries_much(tid) {
            let again = Wait::BackOff(Resume::TimeStamp { length });
            self.block(tid, registers, again, Some(self.now + BACK_OFF));
        } else {
            self.tree
                .set_state(tid, State::Ready(Resume::TimeStamp { length }));
        }
        Ok(())
    }

    /// A thread has computed for so long that it may wait for another in memory: time advances. How far it has
    /// come by then depends on the machine.
    pub(crate) fn preempt(&mut self, tid: Tid) -> Result<(), Halt> {
        let what = format!("{}, which computed for long", name_of(tid));
        self.report.outside.insert(what);
        let again = Wait::BackOff(Resume::Go(0));
        let registers = Registers::of(tid)?;
        self.block(tid, registers, again, Some(self.now + PREEMPTED));
        Ok(())
    }

    /// `sched_yield`: the others that can run have their turns first.
    pub(crate) fn give_way(&mut self, entry: Entry) -> Handling {
        if let Some(backs_off) = self.query(entry) {
            return backs_off;
        }
        self.schedule.turns += 1;
        let turn = self.schedule.turns;
        if let Ok(thread) = self.tree.thread(entry.tid) {
            thread.turn = turn;
        }
        self.schedule.current = None;
        Handling::Answer(0)
    }

    /// Writes the clocks in a program's own memory, before it goes on.
    fn show_clocks(&mut self, tid: Tid) -> Result<(), Halt> {
        let Some(thread) = self.tree.threads.get(&tid) else {
            return Ok(());
        };
        let process = self.tree.processes.get_mut(&thread.process);
        let Some(clocks) = process.and_then(|process| process.clocks.as_mut()) else {
            return Ok(());
        };
        let shown = Shown {
            real: self.clocks.real(self.now),
            monotonic: self.clocks.monotonic(self.now),
            // After many queries, a thread makes a syscall.
            queries: if thread.paid < self.now + u64::from(FREE_QUERIES) * BACK_OFF {
                FREE_QUERIES
            } else {
                0
            },
        };
        if clocks.shown != Some(shown) {
            let times = (shown.real, shown.monotonic);
            arch::write_clocks(Memory(tid), clocks.page, shown.queries, times)?;
            clocks.shown = Some(shown);
        }
        Ok(())
    }
}

/// Counts one more syscall in `paid`; returns whether that is further ahead of simulated time than the free
/// ones allow.
fn counted(paid: &mut u64, now: u64, free: u32) -> bool {
    let most = now + u64::from(free) * BACK_OFF;
    *paid = (now.max(*paid) + BACK_OFF).min(most + BACK_OFF);
    *paid > most
}
