//! Starting the program so that it is traced from its first instruction on.
#![expect(
    unsafe_code,
    reason = "what a child does before exec has no safe interface"
)]

use std::io::{self, Read as _, Write as _};
use std::os::fd::AsRawFd as _;
use std::os::unix::net::UnixStream;
use std::os::unix::process::CommandExt as _;
use std::process::{Child, Command, Stdio};
use std::thread::JoinHandle;
use std::time::Duration;

use crate::traced::arch;
use crate::traced::sys::{self, Tid};
use crate::{Error, Program};

/// How long a child may take to fork.
const PATIENCE: Duration = Duration::from_secs(20);

/// A program on its way: traced, and let go.
pub(crate) struct Starting {
    pub(crate) pid: Tid,
    /// Ends when the program has begun or could not.
    spawning: JoinHandle<io::Result<Child>>,
}

impl Starting {
    /// Why the program did not begin, if it did not; it has, or has ended.
    pub(crate) fn failure(self) -> Option<io::Error> {
        match self.spawning.join() {
            Ok(Ok(_)) => None,
            Ok(Err(error)) => Some(error),
            Err(_) => Some(io::Error::other("the thread that starts it panicked")),
        }
    }
}

/// Starts it; this thread is its tracer from then on.
pub(crate) fn start(program: Program<'_>, random: bool) -> Result<Starting, Error> {
    let system = |what| move |error| Error::System { what, error };
    let (name, arguments) = program
        .words
        .split_first()
        .ok_or_else(|| Error::NotStarted(io::Error::other("no program is named")))?;
    let (mut ours, theirs) =
        UnixStream::pair().map_err(system("cannot make a line to the program"))?;
    ours.set_read_timeout(Some(PATIENCE))
        .map_err(system("cannot make a line to the program"))?;
    let errors = program
        .output
        .try_clone()
        .map_err(system("cannot share the program's output"))?;
    let mut command = Command::new(name);
    command
        .args(arguments)
        .envs(
            program
                .environment
                .iter()
                .map(|(name, value)| (name, value)),
        )
        .stdin(Stdio::null())
        .stdout(program.output)
        .stderr(errors)
        // Ctrl-C is for the tracer, which then ends it.
        .process_group(0);
    let (line, other) = (theirs.as_raw_fd(), ours.as_raw_fd());
    let filter = arch::filter(random);
    let set_up = move || {
        sys::child::wait_to_be_traced(line, other)?;
        sys::child::set_up(&filter, random)
    };
    // SAFETY: the closure makes plain calls only, and takes no lock and no memory.
    unsafe { command.pre_exec(set_up) };
    // It returns only when the program has begun, for which somebody must trace it.
    let spawning = std::thread::Builder::new()
        .name("start of the client".to_owned())
        .spawn(move || {
            let child = command.spawn();
            drop(theirs);
            child
        })
        .map_err(system("cannot start a thread"))?;
    let mut number = [0; 4];
    if let Err(error) = ours.read_exact(&mut number) {
        // The child has not come to be, and spawning says why.
        return Err(match spawning.join() {
            Ok(Err(error)) => Error::NotStarted(error),
            _ => Error::System {
                what: "the program does not begin",
                error,
            },
        });
    }
    let pid = Tid::from_ne_bytes(number);
    if let Err(error) = sys::seize(pid) {
        // It ends when the line does.
        drop(ours);
        let _ = spawning.join();
        return Err(Error::Unsupported(format!(
            "this system does not let a program be traced ({error})"
        )));
    }
    ours.write_all(b".")
        .map_err(system("cannot let the program begin"))?;
    Ok(Starting { pid, spawning })
}
