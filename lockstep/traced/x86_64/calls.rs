//! The numbers of the calls that matter, and the filter that stops threads at them.

use libc::{BPF_ABS, BPF_JEQ, BPF_JMP, BPF_JSET, BPF_K, BPF_LD, BPF_RET, BPF_W, sock_filter};

use crate::traced::call::{Call, Rule};

const ENOSYS: u32 = libc::ENOSYS.cast_unsigned();

/// What is stopped, refused or let through; everything else is let through.
const RULES: &[(i64, Call, Rule)] = &[
    // Clocks. Those of processor time have other numbers, and stay as they are.
    (
        libc::SYS_clock_gettime,
        Call::ClockGettime,
        Rule::If(0, &[0, 1, 4, 5, 6, 7, 8, 9, 11]),
    ),
    (libc::SYS_clock_settime, Call::ClockSettime, Rule::Stop),
    (libc::SYS_gettimeofday, Call::Gettimeofday, Rule::Stop),
    (libc::SYS_settimeofday, Call::Settimeofday, Rule::Stop),
    (libc::SYS_time, Call::Time, Rule::Stop),
    (libc::SYS_times, Call::Times, Rule::Stop),
    // Sleeps and waits.
    (libc::SYS_nanosleep, Call::Nanosleep, Rule::Stop),
    (libc::SYS_clock_nanosleep, Call::ClockNanosleep, Rule::Stop),
    (libc::SYS_poll, Call::Poll, Rule::Stop),
    (libc::SYS_ppoll, Call::Ppoll, Rule::Stop),
    (libc::SYS_select, Call::Select, Rule::Stop),
    (libc::SYS_pselect6, Call::Pselect, Rule::Stop),
    (libc::SYS_epoll_wait, Call::EpollWait, Rule::Stop),
    (libc::SYS_epoll_pwait, Call::EpollPwait, Rule::Stop),
    (libc::SYS_epoll_pwait2, Call::EpollPwait2, Rule::Stop),
    (libc::SYS_futex, Call::Futex, Rule::Stop),
    (449, Call::Refused, Rule::Fail(ENOSYS)), // futex_waitv
    (454, Call::Refused, Rule::Fail(ENOSYS)), // futex_wake
    (455, Call::Refused, Rule::Fail(ENOSYS)), // futex_wait
    (456, Call::Refused, Rule::Fail(ENOSYS)), // futex_requeue
    (libc::SYS_pause, Call::Pause, Rule::Stop),
    (libc::SYS_rt_sigsuspend, Call::Sigsuspend, Rule::Stop),
    (libc::SYS_rt_sigtimedwait, Call::Sigtimedwait, Rule::Stop),
    (libc::SYS_wait4, Call::Wait4, Rule::Stop),
    (libc::SYS_waitid, Call::Waitid, Rule::Stop),
    (libc::SYS_flock, Call::Flock, Rule::Stop),
    // F_SETLKW and F_OFD_SETLKW.
    (libc::SYS_fcntl, Call::Fcntl, Rule::If(1, &[7, 38])),
    (libc::SYS_semop, Call::Semop, Rule::Stop),
    (libc::SYS_semtimedop, Call::Semtimedop, Rule::Stop),
    (libc::SYS_msgsnd, Call::Msgsnd, Rule::Stop),
    (libc::SYS_msgrcv, Call::Msgrcv, Rule::Stop),
    (libc::SYS_mq_timedsend, Call::MqTimedsend, Rule::Stop),
    (libc::SYS_mq_timedreceive, Call::MqTimedreceive, Rule::Stop),
    (libc::SYS_restart_syscall, Call::Restart, Rule::Stop),
    (libc::SYS_sched_yield, Call::Yield, Rule::Stop),
    (libc::SYS_sched_getaffinity, Call::Getaffinity, Rule::Stop),
    (libc::SYS_sched_setaffinity, Call::Setaffinity, Rule::Stop),
    (libc::SYS_getcpu, Call::Getcpu, Rule::Stop),
    // It would tell in memory on which processor a thread runs.
    (libc::SYS_rseq, Call::Refused, Rule::Fail(ENOSYS)),
    // Timers.
    (libc::SYS_alarm, Call::Alarm, Rule::Stop),
    (libc::SYS_setitimer, Call::Setitimer, Rule::If(0, &[0])),
    (libc::SYS_getitimer, Call::Getitimer, Rule::If(0, &[0])),
    (libc::SYS_timer_create, Call::TimerCreate, Rule::Stop),
    (libc::SYS_timer_settime, Call::TimerSettime, Rule::Stop),
    (libc::SYS_timer_gettime, Call::TimerGettime, Rule::Stop),
    (libc::SYS_timer_delete, Call::TimerDelete, Rule::Stop),
    (libc::SYS_timerfd_settime, Call::TimerfdSettime, Rule::Stop),
    (libc::SYS_timerfd_gettime, Call::TimerfdGettime, Rule::Stop),
    // What may wait for others, or is of a port.
    (libc::SYS_read, Call::Read, Rule::Stop),
    (libc::SYS_readv, Call::Readv, Rule::Stop),
    (libc::SYS_pread64, Call::Pread, Rule::Stop),
    (libc::SYS_preadv, Call::Preadv, Rule::Stop),
    (libc::SYS_preadv2, Call::Preadv2, Rule::Stop),
    (libc::SYS_write, Call::Write, Rule::Stop),
    (libc::SYS_writev, Call::Writev, Rule::Stop),
    (libc::SYS_recvfrom, Call::Recvfrom, Rule::Stop),
    (libc::SYS_recvmsg, Call::Recvmsg, Rule::Stop),
    (libc::SYS_recvmmsg, Call::Recvmmsg, Rule::Stop),
    (libc::SYS_sendto, Call::Sendto, Rule::Stop),
    (libc::SYS_sendmsg, Call::Sendmsg, Rule::Stop),
    (libc::SYS_sendmmsg, Call::Sendmmsg, Rule::Stop),
    (libc::SYS_accept, Call::Accept, Rule::Stop),
    (libc::SYS_accept4, Call::Accept, Rule::Stop),
    (libc::SYS_splice, Call::Splice, Rule::Stop),
    (libc::SYS_sendfile, Call::Sendfile, Rule::Stop),
    (
        libc::SYS_ioctl,
        Call::Ioctl,
        Rule::If(1, crate::traced::call::REQUESTS),
    ),
    // What is random.
    (libc::SYS_getrandom, Call::Getrandom, Rule::Stop),
    // Processes.
    (libc::SYS_kill, Call::Kill, Rule::Stop),
    (libc::SYS_tkill, Call::Kill, Rule::Stop),
    (libc::SYS_tgkill, Call::Tgkill, Rule::Stop),
    (libc::SYS_rt_sigqueueinfo, Call::Kill, Rule::Stop),
    (libc::SYS_rt_tgsigqueueinfo, Call::Tgkill, Rule::Stop),
    (
        libc::SYS_pidfd_send_signal,
        Call::PidfdSendSignal,
        Rule::Stop,
    ),
    (libc::SYS_exit, Call::Exit, Rule::Stop),
    (libc::SYS_exit_group, Call::ExitGroup, Rule::Stop),
    // Nobody leaves the tree; the flag of clone3 lies in memory, and libraries do without it.
    (libc::SYS_clone, Call::Clone, Rule::IfBits(0, 0x0080_0000)),
    (libc::SYS_clone3, Call::Refused, Rule::Fail(ENOSYS)),
    (libc::SYS_ptrace, Call::Ptrace, Rule::Stop),
    (libc::SYS_io_uring_setup, Call::Refused, Rule::Fail(ENOSYS)),
    (libc::SYS_io_uring_enter, Call::Refused, Rule::Fail(ENOSYS)),
    (
        libc::SYS_io_uring_register,
        Call::Refused,
        Rule::Fail(ENOSYS),
    ),
];

/// Call of a number.
pub(crate) fn call(number: i64) -> Option<Call> {
    let rule = RULES.iter().find(|rule| rule.0 == number)?;
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
        // Calls of another architecture's programs; the tracer refuses those when they begin.
        jump(BPF_JEQ, AUDIT_ARCH_X86_64, 1, 0),
        give(libc::SECCOMP_RET_ERRNO | ENOSYS),
        load(NUMBER),
        jump(BPF_JSET, X32, 0, 1),
        give(libc::SECCOMP_RET_ERRNO | ENOSYS),
    ];
    for (number, call, rule) in RULES {
        if *call == Call::Getrandom && !random {
            continue;
        }
        let number = u32::try_from(*number).unwrap_or(u32::MAX);
        let argument = |index: u32| ARGUMENTS + 8 * index;
        let mut block = Vec::new();
        match rule {
            Rule::Stop => block.push(give(libc::SECCOMP_RET_TRACE)),
            Rule::Fail(errno) => block.push(give(libc::SECCOMP_RET_ERRNO | errno)),
            Rule::If(index, values) => {
                block.push(load(argument(*index)));
                for (at, value) in values.iter().enumerate() {
                    // Over the others and the permission.
                    block.push(jump(BPF_JEQ, *value, values.len() - at, 0));
                }
                block.push(give(libc::SECCOMP_RET_ALLOW));
                block.push(give(libc::SECCOMP_RET_TRACE));
            }
            Rule::IfBits(index, bits) => {
                block.push(load(argument(*index)));
                block.push(jump(BPF_JSET, *bits, 1, 0));
                block.push(give(libc::SECCOMP_RET_ALLOW));
                block.push(give(libc::SECCOMP_RET_TRACE));
            }
        }
        program.push(jump(BPF_JEQ, number, 0, block.len()));
        program.extend(block);
    }
    program.push(give(libc::SECCOMP_RET_ALLOW));
    program
}
