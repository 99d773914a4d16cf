//! Sessions of operations with a mecanum car.
#![no_main]

use libfuzzer_sys::fuzz_target;
use rigsim_testkit::alone;
use rigsim_testkit::session::{Session, play};

fuzz_target!(|session: Session| {
    let _ = play(alone("mecanum"), &session);
});
