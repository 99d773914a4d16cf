//! Actions of a child between fork and exec.

use super::{Tid, check};
use std::ffi::{CString, c_char};
use std::io;
use std::os::fd::{AsRawFd as _, BorrowedFd, RawFd};
use std::ptr;

use rustix::process::{TimeStampCounterReadability, set_time_stamp_counter_readability, setpgid};
use rustix::stdio::{dup2_stderr, dup2_stdin, dup2_stdout};
use rustix::thread::set_no_new_privs;

/// All that a child needs, prepared before the fork: a child must not allocate.
pub(crate) struct Image<'a> {
    file: &'a CString,
    words: Vec<*const c_char>,
    environment: Vec<*const c_char>,
    filter: Vec<libc::sock_filter>,
    fixed_addresses: bool,
}

impl<'a> Image<'a> {
    pub(crate) fn new(
        file: &'a CString,
        words: &'a [CString],
        environment: &'a [CString],
        filter: Vec<libc::sock_filter>,
        fixed_addresses: bool,
    ) -> Self {
        let pointers = |strings: &[CString]| {
            let pointers = strings.iter().map(|string| string.as_ptr());
            pointers.chain([ptr::null()]).collect()
        };
        Self {
            file,
            words: pointers(words),
            environment: pointers(environment),
            filter,
            fixed_addresses,
        }
    }
}

/// Forks. The child keeps only these streams and `line`. It sends a byte on `line`, waits until it is traced,
/// and calls exec. Then `line` is closed, or carries the number of the failed syscall, above the error number.
pub(crate) fn fork(
    image: &Image<'_>,
    line: BorrowedFd<'_>,
    (input, output): (BorrowedFd<'_>, BorrowedFd<'_>),
) -> io::Result<Tid> {
    // SAFETY: the child makes plain syscalls only, takes no lock and no memory, and never returns.
    let pid = check(unsafe { libc::fork() }.into())?;
    if pid != 0 {
        return Tid::try_from(pid).map_err(io::Error::other);
    }
    let streams = dup2_stdin(input)
        .and_then(|()| dup2_stdout(output))
        .and_then(|()| dup2_stderr(output));
    close_others(line.as_raw_fd());
    let mut go = [0];
    let _ = rustix::io::write(line, &go);
    if rustix::io::read(line, &mut go) == Ok(1) {
        let prepared = streams.map_err(failed(libc::SYS_dup2));
        let (call, number) = match prepared.and_then(|()| prepare(image)) {
            Ok(()) => {
                let (words, environment) = (image.words.as_ptr(), image.environment.as_ptr());
                // SAFETY: all strings end with a null, and so do the lists of them.
                unsafe { libc::execvpe(image.file.as_ptr(), words, environment) };
                failed(libc::SYS_execve)(io::Error::last_os_error())
            }
            Err(failure) => failure,
        };
        let failure = call << 32 | i64::from(number);
        let _ = rustix::io::write(line, &failure.to_ne_bytes());
    }
    // SAFETY: nothing of this program is run.
    unsafe { libc::_exit(127) }
}

fn close_others(line: RawFd) {
    for (first, last) in [(3, line - 1), (line + 1, RawFd::MAX)] {
        if first <= last {
            // SAFETY: takes numbers; nothing in the child uses those that are closed.
            unsafe { libc::syscall(libc::SYS_close_range, first, last, 0) };
        }
    }
}

/// Makes an error the numbers of the syscall and of the error.
fn failed<E: Into<io::Error>>(call: i64) -> impl FnOnce(E) -> (i64, i32) {
    move |error| (call, error.into().raw_os_error().unwrap_or(libc::EINVAL))
}

fn prepare(image: &Image<'_>) -> Result<(), (i64, i32)> {
    let program = libc::sock_fprog {
        len: u16::try_from(image.filter.len()).map_err(|_| (libc::SYS_seccomp, libc::EINVAL))?,
        filter: image.filter.as_ptr().cast_mut(),
    };
    // Ctrl-C is for the tracer, which then ends it.
    setpgid(None, None).map_err(failed(libc::SYS_setpgid))?;
    set_time_stamp_counter_readability(TimeStampCounterReadability::RaiseSIGSEGV)
        .and_then(|()| set_no_new_privs(true))
        .map_err(failed(libc::SYS_prctl))?;
    // SAFETY: takes numbers, a set that is filled before, and a filter that outlives the call.
    unsafe {
        // The child does not inherit ignored or blocked signals.
        libc::signal(libc::SIGPIPE, libc::SIG_DFL);
        let mut none = std::mem::MaybeUninit::<libc::sigset_t>::uninit();
        libc::sigemptyset(none.as_mut_ptr());
        libc::sigprocmask(libc::SIG_SETMASK, none.as_ptr(), ptr::null_mut());
        if image.fixed_addresses {
            // Where the system refuses it, addresses are random, which the tracer finds and reports.
            let persona = libc::personality(0xFFFF_FFFF) | libc::ADDR_NO_RANDOMIZE;
            libc::personality(persona.unsigned_abs().into());
        }
        let set = libc::SECCOMP_SET_MODE_FILTER;
        let call = libc::SYS_seccomp;
        check(libc::syscall(call, set, 0, &raw const program)).map_err(failed(call))?;
    }
    Ok(())
}
