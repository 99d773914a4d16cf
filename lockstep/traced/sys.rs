//! Syscalls for which no library has a suitable wrapper.
//!
//! `nix` has most of them, but its `waitpid` loses stops for real-time signals, which every
//! `pthread_cancel` and every POSIX timer of glibc sends.
#![expect(
    unsafe_code,
    reason = "tracing has no safe interface; each call says why it is sound"
)]

#[path = "sys/child.rs"]
pub(crate) mod child;
#[path = "sys/counter.rs"]
pub(crate) mod counter;

use std::io;
use std::mem::MaybeUninit;
use std::os::fd::AsFd;
use std::ptr;
use std::time::Duration;

use rustix::ioctl::{Getter, ioctl};
use rustix::process::{self, Pid, Signal, WaitOptions};
use rustix::time::{ClockId, clock_gettime};

/// The number of a thread, as the system knows it.
pub(crate) type Tid = libc::pid_t;

fn check(result: libc::c_long) -> io::Result<libc::c_long> {
    if result < 0 {
        Err(io::Error::last_os_error())
    } else {
        Ok(result)
    }
}

/// The device of the terminal to which a descriptor leads, also through `/dev/tty`.
pub(crate) fn terminal_of(file: impl AsFd) -> Option<u64> {
    const TIOCGDEV: rustix::ioctl::Opcode = 0x8004_5432;
    // SAFETY: TIOCGDEV writes one unsigned int through its argument, which lives for the call.
    let device = unsafe { ioctl(file, Getter::<TIOCGDEV, libc::c_uint>::new()) };
    device.ok().map(u64::from)
}

/// A request of ptrace, as the C library declares it.
#[cfg(target_env = "musl")]
type Request = libc::c_int;
#[cfg(not(target_env = "musl"))]
type Request = libc::c_uint;

/// A request whose address and data are plain numbers.
fn request(request: Request, tid: Tid, address: usize, data: usize) -> io::Result<()> {
    // SAFETY: none of the requests that are made through here writes to this program's memory.
    check(unsafe { libc::ptrace(request, tid, address, data) }).map(drop)
}

/// Begins to trace a thread and whatever it starts; all of them are killed when this thread ends.
pub(crate) fn seize(tid: Tid) -> io::Result<()> {
    let options = libc::PTRACE_O_EXITKILL
        | libc::PTRACE_O_TRACECLONE
        | libc::PTRACE_O_TRACEFORK
        | libc::PTRACE_O_TRACEVFORK
        | libc::PTRACE_O_TRACEEXEC
        | libc::PTRACE_O_TRACESECCOMP
        | libc::PTRACE_O_TRACESYSGOOD;
    let options = usize::try_from(options).unwrap_or_default();
    request(libc::PTRACE_SEIZE, tid, 0, options)
}

/// Resumes a stopped thread, with a signal if that is not 0.
pub(crate) fn resume(tid: Tid, signal: i32) -> io::Result<()> {
    let signal = usize::try_from(signal).unwrap_or_default();
    request(libc::PTRACE_CONT, tid, 0, signal)
}

/// The same to the end of its syscall, or to the beginning of the next.
pub(crate) fn resume_to_syscall_stop(tid: Tid) -> io::Result<()> {
    request(libc::PTRACE_SYSCALL, tid, 0, 0)
}

/// Leaves a thread stopped by job control until it is continued.
pub(crate) fn listen(tid: Tid) -> io::Result<()> {
    request(libc::PTRACE_LISTEN, tid, 0, 0)
}

pub(crate) fn registers(tid: Tid) -> io::Result<libc::user_regs_struct> {
    let mut registers = MaybeUninit::<libc::user_regs_struct>::uninit();
    // SAFETY: the request fills the whole structure, and it is read only if it did.
    unsafe {
        check(libc::ptrace(
            libc::PTRACE_GETREGS,
            tid,
            0,
            registers.as_mut_ptr(),
        ))?;
        Ok(registers.assume_init())
    }
}

pub(crate) fn set_registers(tid: Tid, registers: &libc::user_regs_struct) -> io::Result<()> {
    // SAFETY: the request only reads the structure.
    check(unsafe { libc::ptrace(libc::PTRACE_SETREGS, tid, 0, ptr::from_ref(registers)) }).map(drop)
}

/// Message of the event that a thread has stopped for.
pub(crate) fn event_message(tid: Tid) -> io::Result<Tid> {
    let mut message: libc::c_ulong = 0;
    // SAFETY: the request writes one number, which outlives the call.
    check(unsafe {
        libc::ptrace(
            libc::PTRACE_GETEVENTMSG,
            tid,
            0,
            ptr::from_mut(&mut message),
        )
    })?;
    Tid::try_from(message).map_err(io::Error::other)
}

/// Waits for a stop or the end of a thread that this thread traces, or of this one; `None` if there is
/// none and `block` is not set.
pub(crate) fn wait(one: Option<Tid>, block: bool) -> io::Result<Option<(Tid, i32)>> {
    let options = (libc::__WALL | libc::__WNOTHREAD).cast_unsigned();
    let mut options = WaitOptions::from_bits_retain(options);
    options.set(WaitOptions::NOHANG, !block);
    if block {
        counter::hide();
    }
    let found = match one {
        Some(tid) => process::waitpid(Pid::from_raw(tid), options),
        None => process::wait(options),
    };
    Ok(found?.map(|(tid, status)| (tid.as_raw_nonzero().get(), status.as_raw())))
}

/// Reaps a child of this program if it has ended; with `soon`, waits for it.
pub(crate) fn reap(pid: Tid, soon: bool) {
    let mut options = WaitOptions::from_bits_retain(libc::__WALL.cast_unsigned());
    options.set(WaitOptions::NOHANG, !soon);
    // Whether it has been reaped before makes no difference.
    let _ = process::waitpid(Pid::from_raw(pid), options);
}

/// Parts of a program's memory: addresses, and how many bytes.
pub(crate) type Parts = [(u64, u64)];

/// Reads parts of the memory of a stopped thread; returns how much of it could be read.
pub(crate) fn read_memory(tid: Tid, parts: &Parts, bytes: &mut [u8]) -> io::Result<usize> {
    let (local, remote) = (vector(bytes.as_mut_ptr(), bytes.len()), vectors(parts));
    let (from, count) = (remote.as_ptr(), remote.len() as libc::c_ulong);
    // SAFETY: the local part is a slice that may be written; the system checks the remote ones.
    let count = unsafe { libc::process_vm_readv(tid, &raw const local, 1, from, count, 0) };
    usize::try_from(count).map_err(|_| io::Error::last_os_error())
}

/// Writes parts of the memory of a stopped thread; returns how much of it could be written.
pub(crate) fn write_memory(tid: Tid, parts: &Parts, bytes: &[u8]) -> io::Result<usize> {
    let (local, remote) = (
        vector(bytes.as_ptr().cast_mut(), bytes.len()),
        vectors(parts),
    );
    let (to, count) = (remote.as_ptr(), remote.len() as libc::c_ulong);
    // SAFETY: the local part is only read; the system checks the remote ones.
    let count = unsafe { libc::process_vm_writev(tid, &raw const local, 1, to, count, 0) };
    usize::try_from(count).map_err(|_| io::Error::last_os_error())
}

fn vector(base: *mut u8, length: usize) -> libc::iovec {
    libc::iovec {
        iov_base: base.cast(),
        iov_len: length,
    }
}

fn vectors(parts: &Parts) -> Vec<libc::iovec> {
    let number = |number: u64| usize::try_from(number).unwrap_or_default();
    let one = |(base, length): &(u64, u64)| {
        vector(ptr::without_provenance_mut(number(*base)), number(*length))
    };
    parts.iter().map(one).collect()
}

/// Writes whole words of a stopped thread's memory, also where the program itself may not write.
pub(crate) fn poke(tid: Tid, address: u64, bytes: &[u8]) -> io::Result<()> {
    for (at, word) in (address..).step_by(8).zip(bytes.chunks_exact(8)) {
        let word = word
            .try_into()
            .map(usize::from_ne_bytes)
            .unwrap_or_default();
        let at = usize::try_from(at).unwrap_or_default();
        request(libc::PTRACE_POKEDATA, tid, at, word)?;
    }
    Ok(())
}

/// Sends a signal to a process, if it still exists.
pub(crate) fn kill(pid: Tid, signal: Signal) {
    if let Some(pid) = Pid::from_raw(pid) {
        let _ = process::kill_process(pid, signal);
    }
}

/// Sends the signal of a POSIX timer to a process, or to one of its threads.
pub(crate) fn queue_timer_signal(
    pid: Tid,
    tid: Option<Tid>,
    signal: i32,
    timer: i32,
    value: u64,
) -> io::Result<()> {
    // As the system lays `siginfo_t` out for timers: signal, code, timer, value; 128 bytes.
    let mut info = [0_u64; 16];
    let words = [signal, libc::SI_TIMER, timer].map(|word| u64::from(word.cast_unsigned()));
    [info[0], info[1], info[2], info[3]] = [words[0], words[1], words[2], value];
    let info = info.as_ptr();
    // SAFETY: the structure is as long as the system reads, and is only read.
    let result = unsafe {
        match tid {
            None => libc::syscall(libc::SYS_rt_sigqueueinfo, pid, signal, info),
            Some(tid) => libc::syscall(libc::SYS_rt_tgsigqueueinfo, pid, tid, signal, info),
        }
    };
    check(result).map(drop)
}

/// Returns whether the signal of a POSIX timer waits to be taken by a stopped thread, or by its process.
pub(crate) fn has_timer_signal(tid: Tid, timer: i32, shared: bool) -> bool {
    /// More signals rarely wait.
    const MOST: usize = 32;
    const PEEK_SIGINFO: Request = 0x4209;
    let mut infos = [[0_u64; 16]; MOST];
    // The number of the first, then flags and how many.
    let from = [0, u64::from(shared) | (MOST as u64) << 32];
    // SAFETY: the request reads the two numbers, and writes no more than so many structures of 128 bytes.
    let count = unsafe { libc::ptrace(PEEK_SIGINFO, tid, from.as_ptr(), infos.as_mut_ptr()) };
    let count = usize::try_from(count).unwrap_or(0);
    let words = [libc::SI_TIMER, timer].map(|word| u64::from(word.cast_unsigned()));
    let mut infos = infos.iter().take(count);
    infos.any(|info| [info[1] & 0xFFFF_FFFF, info[2] & 0xFFFF_FFFF] == words)
}

/// The clock of a process's processor time, as the kernel numbers them (`CPUCLOCK_SCHED`).
pub(crate) fn clock_of_process(pid: Tid) -> libc::clockid_t {
    !pid << 3 | 2
}

/// Time of a clock that goes by milliseconds, which the system reads without the [`counter`].
pub(crate) fn coarse_time() -> Duration {
    let now = clock_gettime(ClockId::MonotonicCoarse);
    Duration::try_from(now).unwrap_or_default()
}

/// Time that a clock of processor time shows; `None` if what it is of has gone.
pub(crate) fn processor_time(clock: libc::clockid_t) -> Option<Duration> {
    let mut time = libc::timespec {
        tv_sec: 0,
        tv_nsec: 0,
    };
    // SAFETY: the structure outlives the call.
    check(unsafe { libc::clock_gettime(clock, &raw mut time) }.into()).ok()?;
    let seconds = u64::try_from(time.tv_sec).ok()?;
    Some(Duration::new(seconds, u32::try_from(time.tv_nsec).ok()?))
}

/// Exchanges the signals that a stopped thread blocks for these; returns those.
pub(crate) fn set_blocked(tid: Tid, mask: u64) -> io::Result<u64> {
    const LENGTH: usize = size_of::<u64>();
    let mut before = 0_u64;
    // SAFETY: the requests write and read as many bytes as they are given, of a number that outlives
    // the syscall.
    unsafe {
        let to = ptr::from_mut(&mut before);
        check(libc::ptrace(libc::PTRACE_GETSIGMASK as _, tid, LENGTH, to))?;
        let from = ptr::from_ref(&mask);
        check(libc::ptrace(
            libc::PTRACE_SETSIGMASK as _,
            tid,
            LENGTH,
            from,
        ))?;
    }
    Ok(before)
}

/// Interval at which a wait for a thread is interrupted to read the real clock.
pub(crate) const TICK: Duration = Duration::from_millis(20);

/// Interrupts waits of this thread again and again, so that it can read the clock; until it is
/// dropped.
pub(crate) struct Ticks(libc::timer_t);

extern "C" fn nothing(_signal: i32) {}

impl Ticks {
    /// Begins. The signal is one that no other program sends to this program, and that would be ignored.
    pub(crate) fn start() -> io::Result<Self> {
        // SAFETY: the handler does nothing, so that it may run at any time, and may be set again; without
        // SA_RESTART a wait ends with EINTR. All fields of the structure may be zero.
        unsafe {
            let mut action: libc::sigaction = std::mem::zeroed();
            action.sa_sigaction = nothing as extern "C" fn(i32) as usize;
            check(libc::sigaction(libc::SIGURG, &raw const action, ptr::null_mut()).into())?;
        }
        let every = libc::timespec {
            tv_sec: 0,
            tv_nsec: TICK.subsec_nanos().into(),
        };
        let times = libc::itimerspec {
            it_interval: every,
            it_value: every,
        };
        // SAFETY: all fields of the event may be zero, and those that matter are set; the timer is
        // deleted once, on drop.
        unsafe {
            let mut event: libc::sigevent = std::mem::zeroed();
            event.sigev_notify = libc::SIGEV_THREAD_ID;
            event.sigev_signo = libc::SIGURG;
            event.sigev_notify_thread_id = libc::gettid();
            let mut timer: libc::timer_t = ptr::null_mut();
            let made = libc::timer_create(libc::CLOCK_MONOTONIC, &raw mut event, &raw mut timer);
            check(made.into())?;
            let ticks = Self(timer);
            let set = libc::timer_settime(timer, 0, &raw const times, ptr::null_mut());
            check(set.into())?;
            Ok(ticks)
        }
    }
}

impl Drop for Ticks {
    fn drop(&mut self) {
        // SAFETY: the timer was made by `start` and is deleted only here.
        unsafe { libc::timer_delete(self.0) };
    }
}

/// Asks the system for what [`seize`] leaves open: the name of a syscall that it refuses, if there is one.
pub(crate) fn refused() -> Option<(&'static str, io::Error)> {
    const GET_ACTION_AVAIL: libc::c_uint = 2;
    let action = libc::SECCOMP_RET_TRACE;
    // SAFETY: takes numbers, and one that is only read and outlives the call.
    let seccomp =
        unsafe { libc::syscall(libc::SYS_seccomp, GET_ACTION_AVAIL, 0, &raw const action) };
    let from = ptr::from_ref(&action).addr() as u64;
    let read = read_memory(std::process::id().cast_signed(), &[(from, 4)], &mut [0; 4]);
    check(seccomp)
        .err()
        .map(|error| ("seccomp", error))
        .or_else(|| {
            let error = read.err()?;
            Some(("process_vm_readv", error))
        })
}

pub(crate) fn interrupt(tid: Tid) -> io::Result<()> {
    request(libc::PTRACE_INTERRUPT, tid, 0, 0)
}
