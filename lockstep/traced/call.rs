//! The calls that matter, whatever their numbers are.

/// A call at which a thread is stopped.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Call {
    ClockGettime,
    ClockSettime,
    Gettimeofday,
    Settimeofday,
    Time,
    Times,
    Nanosleep,
    ClockNanosleep,
    Poll,
    Ppoll,
    Select,
    Pselect,
    EpollWait,
    EpollPwait,
    EpollPwait2,
    Futex,
    Pause,
    Sigsuspend,
    Sigtimedwait,
    Wait4,
    Waitid,
    Flock,
    Fcntl,
    Semop,
    Semtimedop,
    Msgsnd,
    Msgrcv,
    MqTimedsend,
    MqTimedreceive,
    Restart,
    Yield,
    Getaffinity,
    Setaffinity,
    Getcpu,
    Alarm,
    Setitimer,
    Getitimer,
    TimerCreate,
    TimerSettime,
    TimerGettime,
    TimerDelete,
    TimerfdSettime,
    TimerfdGettime,
    Read,
    Readv,
    Pread,
    Preadv,
    Preadv2,
    Write,
    Writev,
    Recvfrom,
    Recvmsg,
    Recvmmsg,
    Sendto,
    Sendmsg,
    Sendmmsg,
    Accept,
    Splice,
    Sendfile,
    Ioctl,
    Getrandom,
    Kill,
    Tgkill,
    PidfdSendSignal,
    Exit,
    ExitGroup,
    Clone,
    Ptrace,
    /// The filter answers it.
    Refused,
}

/// Action of the filter on a call.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Rule {
    /// The tracer sees it.
    Stop,
    /// It fails with this number.
    Fail(u32),
    /// The tracer sees it if that argument is one of these.
    If(u32, &'static [u32]),
    /// The tracer sees it if that argument has one of these bits.
    IfBits(u32, u32),
}

/// Requests of `ioctl` that matter for ports.
pub(crate) mod request {
    pub(crate) const TCSETSF: u32 = 0x5404;
    pub(crate) const TCSETAF: u32 = 0x5408;
    pub(crate) const TCSETSF2: u32 = 0x402C_542D;
    pub(crate) const TCFLSH: u32 = 0x540B;
    pub(crate) const TIOCMGET: u32 = 0x5415;
    pub(crate) const TIOCMBIS: u32 = 0x5416;
    pub(crate) const TIOCMBIC: u32 = 0x5417;
    pub(crate) const TIOCMSET: u32 = 0x5418;
    pub(crate) const FIONREAD: u32 = 0x541B;
    pub(crate) const TIOCGSERIAL: u32 = 0x541E;
    pub(crate) const TIOCSSERIAL: u32 = 0x541F;
    pub(crate) const TIOCMIWAIT: u32 = 0x545C;
    pub(crate) const TIOCGICOUNT: u32 = 0x545D;
}

/// All of them.
pub(crate) const REQUESTS: &[u32] = &[
    request::TCSETSF,
    request::TCSETAF,
    request::TCSETSF2,
    request::TCFLSH,
    request::TIOCMGET,
    request::TIOCMBIS,
    request::TIOCMBIC,
    request::TIOCMSET,
    request::FIONREAD,
    request::TIOCGSERIAL,
    request::TIOCSSERIAL,
    request::TIOCMIWAIT,
    request::TIOCGICOUNT,
];
