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

/// Forks. The child waits at `line` until it is traced, and becomes the program with these streams;
/// `line` is closed then, or tells the number of the error, less than 0 if the system forbids what
/// has to be done before. `theirs` is its other end.
pub(crate) fn fork(
    image: &Image<'_>,
    (line, theirs): (RawFd, RawFd),
    (input, output): (RawFd, RawFd),
) -> io::Result<Tid> {
    // SAFETY: the child makes plain calls only, takes no lock and no memory, and never returns.
    unsafe {
        let parent = libc::getpid();
        let pid = check(libc::fork().into())?;
        if pid != 0 {
            return Tid::try_from(pid).map_err(io::Error::other);
        }
        libc::close(theirs);
        wait_to_be_traced(line, parent);
        let number = |error: io::Error| error.raw_os_error().unwrap_or(libc::EINVAL);
        let failed = match prepare(image, input, output) {
            Ok(()) => {
                let (words, environment) = (image.words.as_ptr(), image.environment.as_ptr());
                libc::execve(image.file.as_ptr(), words, environment);
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
unsafe fn wait_to_be_traced(line: RawFd, parent: Tid) {
    let mut poll = libc::pollfd {
        fd: line,
        events: libc::POLLIN,
        revents: 0,
    };
    let mut go = 0_u8;
    // SAFETY: the structure and the byte outlive the calls.
    unsafe {
        // Another child may hold the other end open when the tracer is killed.
        while libc::poll(&raw mut poll, 1, 50) != 1 {
            if libc::getppid() != parent {
                libc::_exit(127);
            }
        }
        if libc::read(line, (&raw mut go).cast(), 1) != 1 {
            libc::_exit(127);
        }
    }
}

/// # Safety
/// Only for a child that has been forked.
unsafe fn prepare(image: &Image<'_>, input: RawFd, output: RawFd) -> io::Result<()> {
    let program = libc::sock_fprog {
        len: u16::try_from(image.filter.len()).map_err(|_| io::ErrorKind::InvalidInput)?,
        filter: image.filter.as_ptr().cast_mut(),
    };
    // SAFETY: takes numbers, and a filter that is only read and outlives the call.
    unsafe {
        // Ctrl-C is for the tracer, which then ends it.
        check(libc::setpgid(0, 0).into())?;
        check(libc::dup2(input, 0).into())?;
        check(libc::dup2(output, 1).into())?;
        check(libc::dup2(output, 2).into())?;
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
