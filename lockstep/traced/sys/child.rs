//! Actions of a child between fork and exec.

use super::{Tid, check};
use std::ffi::{CString, c_char};
use std::io;
use std::os::fd::RawFd;
use std::ptr;

/// All that a child needs, made before it comes to be: it must take no memory.
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

/// Forks. The child has no descriptors but these streams and `line`, where it reports that with a byte and
/// waits until it is traced. Then it becomes the program; `line` is closed, or tells the number of the
/// error, less than 0 if the system forbids what has to be done before.
pub(crate) fn fork(
    image: &Image<'_>,
    line: RawFd,
    (input, output): (RawFd, RawFd),
) -> io::Result<Tid> {
    // SAFETY: the child makes plain calls only, takes no lock and no memory, and never returns.
    unsafe {
        let pid = check(libc::fork().into())?;
        if pid != 0 {
            return Tid::try_from(pid).map_err(io::Error::other);
        }
        let streams = set_streams(input, output);
        close_others(line);
        let mut go = 0_u8;
        libc::write(line, (&raw const go).cast(), 1);
        if libc::read(line, (&raw mut go).cast(), 1) != 1 {
            libc::_exit(127);
        }
        let number = |error: io::Error| error.raw_os_error().unwrap_or(libc::EINVAL);
        let failed = match streams.and_then(|()| prepare(image)) {
            Ok(()) => {
                let (words, environment) = (image.words.as_ptr(), image.environment.as_ptr());
                libc::execvpe(image.file.as_ptr(), words, environment);
                number(io::Error::last_os_error())
            }
            Err(error) => -number(error),
        };
        let failed = failed.to_ne_bytes();
        libc::write(line, failed.as_ptr().cast(), failed.len());
        libc::_exit(127)
    }
}

/// # Safety
/// Only for a child that has been forked.
unsafe fn set_streams(input: RawFd, output: RawFd) -> io::Result<()> {
    // SAFETY: takes numbers.
    unsafe {
        check(libc::dup2(input, 0).into())?;
        check(libc::dup2(output, 1).into())?;
        check(libc::dup2(output, 2).into())?;
    }
    Ok(())
}

/// # Safety
/// Only for a child that has been forked.
unsafe fn close_others(line: RawFd) {
    /// Descriptors that are closed one by one, by a kernel before 5.9.
    const MOST: RawFd = 1 << 16;
    for (first, last) in [(3, line - 1), (line + 1, RawFd::MAX)] {
        // SAFETY: takes numbers.
        unsafe {
            if first <= last && libc::syscall(libc::SYS_close_range, first, last, 0) != 0 {
                for one in first..=last.min(MOST) {
                    libc::close(one);
                }
            }
        }
    }
}

/// # Safety
/// Only for a child that has been forked.
unsafe fn prepare(image: &Image<'_>) -> io::Result<()> {
    let program = libc::sock_fprog {
        len: u16::try_from(image.filter.len()).map_err(|_| io::ErrorKind::InvalidInput)?,
        filter: image.filter.as_ptr().cast_mut(),
    };
    // SAFETY: takes numbers, and a filter that is only read and outlives the call.
    unsafe {
        // Ctrl-C is for the tracer, which then ends it.
        check(libc::setpgid(0, 0).into())?;
        // What this program ignores or blocks is its own affair.
        libc::signal(libc::SIGPIPE, libc::SIG_DFL);
        let mut none = std::mem::MaybeUninit::<libc::sigset_t>::uninit();
        libc::sigemptyset(none.as_mut_ptr());
        libc::sigprocmask(libc::SIG_SETMASK, none.as_ptr(), ptr::null_mut());
        if image.fixed_addresses {
            // Where the system refuses it, addresses are random, which the tracer finds and reports.
            let persona = libc::personality(0xFFFF_FFFF) | libc::ADDR_NO_RANDOMIZE;
            libc::personality(persona.unsigned_abs().into());
        }
        check(libc::prctl(libc::PR_SET_TSC, libc::PR_TSC_SIGSEGV).into())?;
        check(libc::prctl(libc::PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0).into())?;
        let set = libc::SECCOMP_SET_MODE_FILTER;
        check(libc::syscall(libc::SYS_seccomp, set, 0, &raw const program))?;
    }
    Ok(())
}
