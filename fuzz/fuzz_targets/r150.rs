//! Sessions of operations with an R150.
#![no_main]

use libfuzzer_sys::fuzz_target;
use rigsim_testkit::alone;
use rigsim_testkit::session::{Session, play};

fuzz_target!(|session: Session| {
    let _ = play(alone("r150"), &session);
});
