//! The syscalls that matter: their numbers, the filter that stops threads at them, and what handles them.

use libc::{BPF_ABS, BPF_JEQ, BPF_JMP, BPF_JSET, BPF_K, BPF_LD, BPF_RET, BPF_W, sock_filter};

use crate::traced::one_processor::{affinity, current};
use crate::traced::syscall::{Entry, Halt, Handling, failure, int};
use crate::traced::tracer::Tracer;

const ENOSYS: u32 = libc::ENOSYS.cast_unsigned();

/// Requests of `ioctl` that matter for ports. C libraries differ in their type.
const REQUESTS: &[u64] = &[
    libc::TCGETS as _,
    libc::TCGETA as _,
    libc::TCGETS2 as _,
    libc::TCSETS as _,
    libc::TCSETA as _,
    libc::TCSETS2 as _,
    libc::TCSETSW as _,
    libc::TCSETAW as _,
    libc::TCSETSW2 as _,
    libc::TCSETSF as _,
    libc::TCSETAF as _,
    libc::TCSETSF2 as _,
    libc::TCFLSH as _,
    libc::TCXONC as _,
    libc::TIOCMGET as _,
    libc::TIOCMBIS as _,
    libc::TIOCMBIC as _,
    libc::TIOCMSET as _,
    libc::FIONREAD as _,
    libc::TIOCGSERIAL as _,
    libc::TIOCSSERIAL as _,
    libc::TIOCMIWAIT as _,
    libc::TIOCGICOUNT as _,
    libc::FIOASYNC as _,
];

/// Action of the filter on a syscall that matters; all others are let through.
#[derive(Debug, Clone, Copy)]
enum Rule {
    Stop,
    /// The tracer sees it if that argument is one of these.
    If(u32, &'static [u64]),
    /// The tracer sees it if that argument has one of these bits.
    IfBits(u32, u32),
}

/// Decides how a syscall is handled.
type Handler = fn(&mut Tracer<'_>, Entry) -> Result<Handling, Halt>;

const CLOCK: Handler = |t, e| t.clock_call(e);
const POLL: Handler = |t, e| t.poll_call(e);
const SIGNAL: Handler = |t, e| t.signal_call(e);
const KILL: Handler = |t, e| t.kill_call(e);
/// Children, locks and queues.
const RETRIED: Handler = |t, e| t.retried_call(e);
/// What may wait for others, or is of a port.
const TRANSFER: Handler = |t, e| t.transfer_call(e);

/// Lists the syscalls that matter, each with its numbers, what the filter does with it, and its handler.
macro_rules! calls {
    ($($call:ident $numbers:tt $rule:expr => $handler:expr;)+) => {
        /// A syscall at which a thread is stopped.
        #[derive(Debug, Clone, Copy, PartialEq, Eq)]
        pub(crate) enum Syscall {
            $($call,)+
        }

        const RULES: &[(&[i64], Syscall, Rule, Handler)] =
            &[$((&$numbers, Syscall::$call, $rule, $handler),)+];
    };
}

calls! {
    // Those of processor time have other numbers, and stay as they are.
    ClockGettime [libc::SYS_clock_gettime] Rule::If(0, &[0, 1, 4, 5, 6, 7, 8, 9, 11]) => CLOCK;
    Gettimeofday [libc::SYS_gettimeofday] Rule::Stop => CLOCK;
    Time [libc::SYS_time] Rule::Stop => CLOCK;
    Times [libc::SYS_times] Rule::Stop => CLOCK;
    Settime [libc::SYS_clock_settime, libc::SYS_settimeofday] Rule::Stop => |_, _| Ok(failure(libc::EPERM));
    Adjtimex [libc::SYS_adjtimex] Rule::Stop => |t, e| t.adjust(e, e.a[0]);
    ClockAdjtime [libc::SYS_clock_adjtime] Rule::Stop => |t, e| t.adjust(e, e.a[1]);
    Sysinfo [libc::SYS_sysinfo] Rule::Stop => |t, e| t.uptime(e);
    Nanosleep [libc::SYS_nanosleep] Rule::Stop => |t, e| t.sleep(e);
    ClockNanosleep [libc::SYS_clock_nanosleep] Rule::Stop => |t, e| t.sleep(e);
    Poll [libc::SYS_poll] Rule::Stop => POLL;
    Ppoll [libc::SYS_ppoll] Rule::Stop => POLL;
    Select [libc::SYS_select] Rule::Stop => POLL;
    Pselect [libc::SYS_pselect6] Rule::Stop => POLL;
    EpollWait [libc::SYS_epoll_wait] Rule::Stop => POLL;
    EpollPwait [libc::SYS_epoll_pwait] Rule::Stop => POLL;
    EpollPwait2 [libc::SYS_epoll_pwait2] Rule::Stop => POLL;
    // EPOLL_CTL_ADD.
    EpollCtl [libc::SYS_epoll_ctl] Rule::If(1, &[1]) => |t, e| t.polled_by_kernel(e, int(e.a[2]));
    Pause [libc::SYS_pause] Rule::Stop => SIGNAL;
    Sigsuspend [libc::SYS_rt_sigsuspend] Rule::Stop => SIGNAL;
    Sigtimedwait [libc::SYS_rt_sigtimedwait] Rule::Stop => SIGNAL;
    // Of SIGSEGV.
    Sigaction [libc::SYS_rt_sigaction] Rule::If(0, &[11]) => |t, e| t.fault_action(e);
    Signalfd [libc::SYS_signalfd, libc::SYS_signalfd4] Rule::Stop => |t, _| t.signal_descriptor();
    Kill [libc::SYS_kill, libc::SYS_tkill, libc::SYS_rt_sigqueueinfo] Rule::Stop => KILL;
    Tgkill [libc::SYS_tgkill, libc::SYS_rt_tgsigqueueinfo] Rule::Stop => KILL;
    PidfdSendSignal [libc::SYS_pidfd_send_signal] Rule::Stop => KILL;
    Wait4 [libc::SYS_wait4] Rule::Stop => RETRIED;
    Waitid [libc::SYS_waitid] Rule::Stop => RETRIED;
    Flock [libc::SYS_flock] Rule::Stop => RETRIED;
    // F_SETLKW and F_OFD_SETLKW; and F_SETFL, which does not wait.
    Fcntl [libc::SYS_fcntl] Rule::If(1, &[7, 38, 4]) => |t, e| t.descriptor_control(e);
    Semop [libc::SYS_semop] Rule::Stop => RETRIED;
    Semtimedop [libc::SYS_semtimedop] Rule::Stop => RETRIED;
    Msgsnd [libc::SYS_msgsnd] Rule::Stop => RETRIED;
    Msgrcv [libc::SYS_msgrcv] Rule::Stop => RETRIED;
    Futex [libc::SYS_futex] Rule::Stop => |t, e| t.futex(e);
    Read [libc::SYS_read] Rule::Stop => TRANSFER;
    Readv [libc::SYS_readv] Rule::Stop => TRANSFER;
    Pread [libc::SYS_pread64] Rule::Stop => TRANSFER;
    Preadv [libc::SYS_preadv] Rule::Stop => TRANSFER;
    Preadv2 [libc::SYS_preadv2] Rule::Stop => TRANSFER;
    Write [libc::SYS_write] Rule::Stop => TRANSFER;
    Writev [libc::SYS_writev] Rule::Stop => TRANSFER;
    Pwritev2 [libc::SYS_pwritev2] Rule::Stop => TRANSFER;
    Recvfrom [libc::SYS_recvfrom] Rule::Stop => TRANSFER;
    Recvmsg [libc::SYS_recvmsg] Rule::Stop => TRANSFER;
    Recvmmsg [libc::SYS_recvmmsg] Rule::Stop => TRANSFER;
    Sendto [libc::SYS_sendto] Rule::Stop => TRANSFER;
    Sendmsg [libc::SYS_sendmsg] Rule::Stop => TRANSFER;
    Sendmmsg [libc::SYS_sendmmsg] Rule::Stop => TRANSFER;
    Accept [libc::SYS_accept, libc::SYS_accept4] Rule::Stop => TRANSFER;
    Splice [libc::SYS_splice] Rule::Stop => TRANSFER;
    Tee [libc::SYS_tee] Rule::Stop => TRANSFER;
    Vmsplice [libc::SYS_vmsplice] Rule::Stop => TRANSFER;
    Sendfile [libc::SYS_sendfile] Rule::Stop => TRANSFER;
    MqTimedsend [libc::SYS_mq_timedsend] Rule::Stop => TRANSFER;
    MqTimedreceive [libc::SYS_mq_timedreceive] Rule::Stop => TRANSFER;
    Ioctl [libc::SYS_ioctl] Rule::If(1, REQUESTS) => |t, e| t.request(e);
    // What takes descriptors away.
    Close [libc::SYS_close] Rule::Stop => |t, e| t.close(e, int(e.a[0])..=int(e.a[0]));
    CloseRange [libc::SYS_close_range] Rule::Stop => |t, e| t.close_range(e);
    Dup [libc::SYS_dup2, libc::SYS_dup3] Rule::Stop => |t, e| t.close(e, int(e.a[1])..=int(e.a[1]));
    Alarm [libc::SYS_alarm] Rule::Stop => |t, e| Ok(t.alarm(e));
    Setitimer [libc::SYS_setitimer] Rule::If(0, &[0]) => |t, e| t.interval_timer(e, Some(e.a[1]), e.a[2]);
    Getitimer [libc::SYS_getitimer] Rule::If(0, &[0]) => |t, e| t.interval_timer(e, None, e.a[1]);
    TimerCreate [libc::SYS_timer_create] Rule::Stop => |t, e| t.timer_create(e);
    TimerSettime [libc::SYS_timer_settime] Rule::Stop => |t, e| t.posix_timer(e, Some((e.a[1], e.a[2])), e.a[3]);
    TimerGettime [libc::SYS_timer_gettime] Rule::Stop => |t, e| t.posix_timer(e, None, e.a[1]);
    TimerGetoverrun [libc::SYS_timer_getoverrun] Rule::Stop => |t, e| t.timer_overrun(e);
    TimerDelete [libc::SYS_timer_delete] Rule::Stop => |t, e| Ok(t.timer_delete(e));
    TimerfdSettime [libc::SYS_timerfd_settime] Rule::Stop
        => |t, e| t.timer_descriptor(e, Some((e.a[1], e.a[2])), e.a[3]);
    TimerfdGettime [libc::SYS_timerfd_gettime] Rule::Stop => |t, e| t.timer_descriptor(e, None, e.a[1]);
    Getrandom [libc::SYS_getrandom] Rule::Stop => |t, e| t.random_bytes(e.tid, &[(e.a[0], e.a[1])]);
    Yield [libc::SYS_sched_yield] Rule::Stop => |t, e| Ok(t.give_way(e));
    Getaffinity [libc::SYS_sched_getaffinity] Rule::Stop => |_, e| affinity(e.tid, e.a[1], e.a[2]);
    Setaffinity [libc::SYS_sched_setaffinity] Rule::Stop => |_, _| Ok(Handling::Answer(0));
    Getcpu [libc::SYS_getcpu] Rule::Stop => |_, e| current(e.tid, e.a[0], e.a[1]);
    // Only after a stop by job control.
    Restart [libc::SYS_restart_syscall] Rule::Stop => |_, _| Ok(failure(libc::EINTR));
    Exit [libc::SYS_exit] Rule::Stop => |t, e| Ok(t.exit(e));
    ExitGroup [libc::SYS_exit_group] Rule::Stop => |t, e| Ok(t.exit_group(e));
    // CLONE_UNTRACED: no process leaves the tree.
    Clone [libc::SYS_clone] Rule::IfBits(0, 0x0080_0000) => |t, e| t.make_traced(e, 0x0080_0000);
    Ptrace [libc::SYS_ptrace] Rule::Stop => |t, _| Ok(t.refuse_debugger());
    // Answered as by a system that lacks them. futex_waitv, futex_wake, futex_wait and futex_requeue:
    Missing [449, 454, 455, 456,
        // It would tell in memory on which processor a thread runs.
        libc::SYS_rseq,
        // Its flags lie in memory.
        libc::SYS_clone3,
        // They wait for the kernel's own work, in its time.
        libc::SYS_io_uring_setup, libc::SYS_io_uring_enter, libc::SYS_io_uring_register,
        libc::SYS_io_setup] Rule::Stop => |t, e| Ok(t.lack(e));
}

/// The syscall with this number, and its handler.
pub(crate) fn call(number: i64) -> Option<(Syscall, Handler)> {
    let mut rules = RULES.iter();
    let (_, call, _, handler) = rules.find(|(numbers, ..)| numbers.contains(&number))?;
    Some((*call, *handler))
}

/// The filter that a client runs under.
pub(crate) fn filter(random: bool) -> Vec<sock_filter> {
    const AUDIT_ARCH_X86_64: u32 = 0xC000_003E;
    const X32: u32 = 0x4000_0000;
    /// Where in the data that a filter sees these lie.
    const NUMBER: u32 = 0;
    const ARCH: u32 = 4;
    const ARGUMENTS: u32 = 16;
    let statement = |code: u32, k: u32| sock_filter {
        code: u16::try_from(code).unwrap_or_default(),
        jt: 0,
        jf: 0,
        k,
    };
    let load = |from: u32| statement(BPF_LD | BPF_W | BPF_ABS, from);
    let give = |what: u32| statement(BPF_RET | BPF_K, what);
    // Goes on behind `skip` statements if the value is not that, or lacks those bits.
    let jump = |test: u32, value: u32, hit: usize, miss: usize| sock_filter {
        code: u16::try_from(BPF_JMP | test | BPF_K).unwrap_or_default(),
        jt: u8::try_from(hit).unwrap_or(u8::MAX),
        jf: u8::try_from(miss).unwrap_or(u8::MAX),
        k: value,
    };
    let mut program = vec![
        load(ARCH),
        // Syscalls of another architecture's programs; the tracer refuses those when they begin.
        jump(BPF_JEQ, AUDIT_ARCH_X86_64, 1, 0),
        give(libc::SECCOMP_RET_ERRNO | ENOSYS),
        load(NUMBER),
        jump(BPF_JSET, X32, 0, 1),
        give(libc::SECCOMP_RET_ERRNO | ENOSYS),
    ];
    let mut add = |number: i64, block: Vec<sock_filter>| {
        let number = u32::try_from(number).unwrap_or(u32::MAX);
        program.push(jump(BPF_JEQ, number, 0, block.len()));
        program.extend(block);
    };
    for (numbers, call, rule, _) in RULES {
        if *call == Syscall::Getrandom && !random {
            continue;
        }
        let argument = |index: u32| load(ARGUMENTS + 8 * index);
        let mut block = Vec::new();
        match rule {
            Rule::Stop => {}
            Rule::If(index, values) => {
                block.push(argument(*index));
                for (at, value) in values.iter().enumerate() {
                    // Over the others and the permission.
                    let value = u32::try_from(*value).unwrap_or(u32::MAX);
                    block.push(jump(BPF_JEQ, value, values.len() - at, 0));
                }
                block.push(give(libc::SECCOMP_RET_ALLOW));
            }
            Rule::IfBits(index, bits) => {
                block.push(argument(*index));
                block.push(jump(BPF_JSET, *bits, 1, 0));
                block.push(give(libc::SECCOMP_RET_ALLOW));
            }
        }
        block.push(give(libc::SECCOMP_RET_TRACE));
        for number in *numbers {
            add(*number, block.clone());
        }
    }
    program.push(give(libc::SECCOMP_RET_ALLOW));
    program
}
