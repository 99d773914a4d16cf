//! Starting the program so that it is traced from its first instruction on.

use std::ffi::{CString, OsStr, OsString};
use std::io::{self, Read as _, Write as _};
use std::os::fd::AsFd as _;
use std::os::unix::ffi::{OsStrExt as _, OsStringExt as _};
use std::os::unix::net::UnixStream;

use crate::traced::arch;
use crate::traced::sys::{self, Tid, child::Image};
use crate::traced::syscall::{call_name, int};
use crate::{Error, Program, copies};

/// A program that is starting: traced and resumed.
pub(crate) struct Starting {
    pub(crate) pid: Tid,
    /// Closed when the program begins; before that it carries the reason of a failure.
    line: UnixStream,
}

impl Starting {
    /// Waits until the program has begun or ended; returns why it did not begin, if so.
    pub(crate) fn failure(&mut self) -> Option<Error> {
        let mut failed = [0; 8];
        self.line.read_exact(&mut failed).ok()?;
        let failed = i64::from_ne_bytes(failed);
        let error = io::Error::from_raw_os_error(int(failed.cast_unsigned()));
        Some(match failed >> 32 {
            libc::SYS_execve => Error::NotStarted(error),
            call => unsupported(&call_name(call), &error),
        })
    }
}

/// Starts it; this thread is its tracer from then on.
pub(crate) fn start(program: &Program<'_>, random: bool) -> Result<Starting, Error> {
    let system = |what| move |error| Error::System { what, error };
    if let Some((call, error)) = sys::refused() {
        return Err(unsupported(call, &error));
    }
    let words = program.words.iter().map(|word| word.as_bytes().to_vec());
    let words = strings(words).map_err(Error::NotStarted)?;
    let none = || Error::NotStarted(io::Error::other("no program is named"));
    let file = words.first().ok_or_else(none)?;
    let environment = strings(environment(program)).map_err(Error::NotStarted)?;
    let input = std::fs::File::open("/dev/null").map_err(system("cannot open /dev/null"))?;
    let (mut line, theirs) =
        UnixStream::pair().map_err(system("cannot make a line to the program"))?;
    let image = Image::new(file, &words, &environment, arch::filter(random), random);
    let streams = (input.as_fd(), program.output.as_fd());
    let copies = copies::some();
    let pid = sys::child::fork(&image, theirs.as_fd(), streams)
        .map_err(system("cannot start a process for the program"))?;
    drop(theirs);
    // It fails if the process has been killed, which is found next.
    let _ = line.read_exact(&mut [0]);
    drop(copies);
    if let Err(error) = sys::seize(pid) {
        // It ends when the line does.
        drop(line);
        sys::reap(pid, true);
        return Err(unsupported("ptrace", &error));
    }
    line.write_all(b".")
        .map_err(system("cannot let the program begin"))?;
    Ok(Starting { pid, line })
}

fn unsupported(call: &str, error: &io::Error) -> Error {
    let scope = std::fs::read_to_string("/proc/sys/kernel/yama/ptrace_scope");
    let remedy = remedy(call, scope.unwrap_or_default().trim());
    Error::Unsupported(format!("this system refuses {call} ({error}), {remedy}"))
}

fn remedy(call: &str, scope: &str) -> &'static str {
    match (call, scope) {
        ("ptrace", "2" | "3") => {
            "since Yama forbids it: /proc/sys/kernel/yama/ptrace_scope has to be 0 or 1 (a 3 stays until \
             the next boot)"
        }
        _ => "which a container's seccomp profile has to allow",
    }
}

fn strings(bytes: impl Iterator<Item = Vec<u8>>) -> io::Result<Vec<CString>> {
    bytes
        .map(|bytes| CString::new(bytes).map_err(io::Error::from))
        .collect()
}

/// This program's environment, with the program's own variables.
fn environment(program: &Program<'_>) -> impl Iterator<Item = Vec<u8>> {
    let own = program.environment;
    let inherited = std::env::vars_os()
        .filter(|(name, _)| !own.iter().any(|(other, _)| name == OsStr::new(other)));
    let own = own
        .iter()
        .map(|(name, value)| (OsString::from(name), value.clone()));
    inherited.chain(own).map(|(mut name, value)| {
        name.push("=");
        name.push(value);
        name.into_vec()
    })
}

#[test]
fn what_refuses_ptrace_is_named() {
    let calls = [
        ("1", "ptrace"),
        ("2", "seccomp"),
        ("2", "ptrace"),
        ("3", "ptrace"),
    ];
    let is_yama = calls.map(|(scope, call)| remedy(call, scope).contains("Yama"));
    assert_eq!(is_yama, [false, false, true, true]);
}
