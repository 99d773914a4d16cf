//! Limits that the system puts on a process.

use std::io;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};
use signal_hook::consts::SIGXFSZ;

/// Has a write beyond the limit of file sizes (`RLIMIT_FSIZE`) be an error, as on a full disk, instead of
/// ending the program. Programs that it starts are ended as ever.
///
/// # Errors
/// When the system refuses.
pub fn survive_full_files() -> io::Result<()> {
    // A handler, and not to ignore it, since what is ignored stays so in programs that are started.
    signal_hook::flag::register(SIGXFSZ, Arc::new(AtomicBool::new(false))).map(drop)
}

/// Allows this process as many file descriptors as it may allow itself, if `count` are more than it has.
/// Programs that it starts get as many, so it is for who needs them.
pub fn want_descriptors(count: u64) {
    let Rlimit { current, maximum } = getrlimit(Resource::Nofile);
    if current.is_some_and(|current| current < count) {
        let current = maximum;
        // Refused, it is as it was, and whoever opens too many is told.
        let _ = setrlimit(Resource::Nofile, Rlimit { current, maximum });
    }
}
