//! The numbers of the syscalls that matter, and the filter that stops threads at them.

use libc::{BPF_ABS, BPF_JEQ, BPF_JMP, BPF_JSET, BPF_K, BPF_LD, BPF_RET, BPF_W, sock_filter};

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

/// Lists the syscalls that matter, by what handles them, each with its numbers and what is done with it.
macro_rules! calls {
    ($($group:ident { $($call:ident $numbers:tt $rule:expr;)+ })+) => {
        /// A syscall at which a thread is stopped.
        #[derive(Debug, Clone, Copy, PartialEq, Eq)]
        pub(crate) enum Syscall {
            $($($call,)+)+
        }

        /// Syscalls that are handled in one place.
        #[derive(Debug, Clone, Copy, PartialEq, Eq)]
        pub(crate) enum Group {
            $($group,)+
        }

        const RULES: &[(&[i64], (Group, Syscall), Rule)] =
            &[$($((&$numbers, (Group::$group, Syscall::$call), $rule),)+)+];
    };
}

calls! {
    Clock {
        // Those of processor time have other numbers, and stay as they are.
        ClockGettime [libc::SYS_clock_gettime] Rule::If(0, &[0, 1, 4, 5, 6, 7, 8, 9, 11]);
        ClockSettime [libc::SYS_clock_settime] Rule::Stop;
        Gettimeofday [libc::SYS_gettimeofday] Rule::Stop;
        Settimeofday [libc::SYS_settimeofday] Rule::Stop;
        Time [libc::SYS_time] Rule::Stop;
        Times [libc::SYS_times] Rule::Stop;
    }
    Sleep {
        Nanosleep [libc::SYS_nanosleep] Rule::Stop;
        ClockNanosleep [libc::SYS_clock_nanosleep] Rule::Stop;
    }
    Poll {
        Poll [libc::SYS_poll] Rule::Stop;
        Ppoll [libc::SYS_ppoll] Rule::Stop;
        Select [libc::SYS_select] Rule::Stop;
        Pselect [libc::SYS_pselect6] Rule::Stop;
        EpollWait [libc::SYS_epoll_wait] Rule::Stop;
        EpollPwait [libc::SYS_epoll_pwait] Rule::Stop;
        EpollPwait2 [libc::SYS_epoll_pwait2] Rule::Stop;
    }
    Signal {
        Pause [libc::SYS_pause] Rule::Stop;
        Sigsuspend [libc::SYS_rt_sigsuspend] Rule::Stop;
        Sigtimedwait [libc::SYS_rt_sigtimedwait] Rule::Stop;
    }
    Kill {
        Kill [libc::SYS_kill, libc::SYS_tkill, libc::SYS_rt_sigqueueinfo] Rule::Stop;
        Tgkill [libc::SYS_tgkill, libc::SYS_rt_tgsigqueueinfo] Rule::Stop;
        PidfdSendSignal [libc::SYS_pidfd_send_signal] Rule::Stop;
    }
    // Children, locks and queues.
    Retried {
        Wait4 [libc::SYS_wait4] Rule::Stop;
        Waitid [libc::SYS_waitid] Rule::Stop;
        Flock [libc::SYS_flock] Rule::Stop;
        // F_SETLKW and F_OFD_SETLKW; and F_SETFL, which does not wait.
        Fcntl [libc::SYS_fcntl] Rule::If(1, &[7, 38, 4]);
        Semop [libc::SYS_semop] Rule::Stop;
        Semtimedop [libc::SYS_semtimedop] Rule::Stop;
        Msgsnd [libc::SYS_msgsnd] Rule::Stop;
        Msgrcv [libc::SYS_msgrcv] Rule::Stop;
    }
    // What may wait for others, or is of a port.
    Transfer {
        Read [libc::SYS_read] Rule::Stop;
        Readv [libc::SYS_readv] Rule::Stop;
        Pread [libc::SYS_pread64] Rule::Stop;
        Preadv [libc::SYS_preadv] Rule::Stop;
        Preadv2 [libc::SYS_preadv2] Rule::Stop;
        Write [libc::SYS_write] Rule::Stop;
        Writev [libc::SYS_writev] Rule::Stop;
        Pwritev2 [libc::SYS_pwritev2] Rule::Stop;
        Recvfrom [libc::SYS_recvfrom] Rule::Stop;
        Recvmsg [libc::SYS_recvmsg] Rule::Stop;
        Recvmmsg [libc::SYS_recvmmsg] Rule::Stop;
        Sendto [libc::SYS_sendto] Rule::Stop;
        Sendmsg [libc::SYS_sendmsg] Rule::Stop;
        Sendmmsg [libc::SYS_sendmmsg] Rule::Stop;
        Accept [libc::SYS_accept, libc::SYS_accept4] Rule::Stop;
        Splice [libc::SYS_splice] Rule::Stop;
        Tee [libc::SYS_tee] Rule::Stop;
        Vmsplice [libc::SYS_vmsplice] Rule::Stop;
        Sendfile [libc::SYS_sendfile] Rule::Stop;
        MqTimedsend [libc::SYS_mq_timedsend] Rule::Stop;
        MqTimedreceive [libc::SYS_mq_timedreceive] Rule::Stop;
    }
    Other {
        Adjtimex [libc::SYS_adjtimex] Rule::Stop;
        ClockAdjtime [libc::SYS_clock_adjtime] Rule::Stop;
        Sysinfo [libc::SYS_sysinfo] Rule::Stop;
        // EPOLL_CTL_ADD.
        EpollCtl [libc::SYS_epoll_ctl] Rule::If(1, &[1]);
        Futex [libc::SYS_futex] Rule::Stop;
        // Of SIGSEGV.
        Sigaction [libc::SYS_rt_sigaction] Rule::If(0, &[11]);
        Signalfd [libc::SYS_signalfd, libc::SYS_signalfd4] Rule::Stop;
        Restart [libc::SYS_restart_syscall] Rule::Stop;
        Yield [libc::SYS_sched_yield] Rule::Stop;
        Getaffinity [libc::SYS_sched_getaffinity] Rule::Stop;
        Setaffinity [libc::SYS_sched_setaffinity] Rule::Stop;
        Getcpu [libc::SYS_getcpu] Rule::Stop;
        // Timers.
        Alarm [libc::SYS_alarm] Rule::Stop;
        Setitimer [libc::SYS_setitimer] Rule::If(0, &[0]);
        Getitimer [libc::SYS_getitimer] Rule::If(0, &[0]);
        TimerCreate [libc::SYS_timer_create] Rule::Stop;
        TimerSettime [libc::SYS_timer_settime] Rule::Stop;
        TimerGettime [libc::SYS_timer_gettime] Rule::Stop;
        TimerGetoverrun [libc::SYS_timer_getoverrun] Rule::Stop;
        TimerDelete [libc::SYS_timer_delete] Rule::Stop;
        TimerfdSettime [libc::SYS_timerfd_settime] Rule::Stop;
        TimerfdGettime [libc::SYS_timerfd_gettime] Rule::Stop;
        Ioctl [libc::SYS_ioctl] Rule::If(1, REQUESTS);
        // What takes descriptors away.
        Close [libc::SYS_close] Rule::Stop;
        CloseRange [libc::SYS_close_range] Rule::Stop;
        Dup [libc::SYS_dup2, libc::SYS_dup3] Rule::Stop;
        // What is random.
        Getrandom [libc::SYS_getrandom] Rule::Stop;
        // Processes.
        Exit [libc::SYS_exit] Rule::Stop;
        ExitGroup [libc::SYS_exit_group] Rule::Stop;
        // CLONE_UNTRACED: no process leaves the tree.
        Clone [libc::SYS_clone] Rule::IfBits(0, 0x0080_0000);
        Ptrace [libc::SYS_ptrace] Rule::Stop;
        // Answered as by a system that lacks them. futex_waitv, futex_wake, futex_wait and futex_requeue:
        Missing [449, 454, 455, 456,
            // It would tell in memory on which processor a thread runs.
            libc::SYS_rseq,
            // Its flags lie in memory.
            libc::SYS_clone3,
            // They wait for the kernel's own work, in its time.
            libc::SYS_io_uring_setup, libc::SYS_io_uring_enter, libc::SYS_io_uring_register,
            libc::SYS_io_setup] Rule::Stop;
    }
}

pub(crate) fn call(number: i64) -> Option<(Group, Syscall)> {
    let rule = RULES.iter().find(|rule| rule.0.contains(&number))?;
    Some(rule.1)
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
    for (numbers, call, rule) in RULES {
        if call.1 == Syscall::Getrandom && !random {
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
