//! Sessions of operations with an R150 and a mecanum car in each other's way.
#![no_main]

use libfuzzer_sys::fuzz_target;
use rigsim_testkit::SHIPPED;
use rigsim_testkit::session::{Session, play};

fuzz_target!(|session: Session| {
    let _ = play(SHIPPED, &session);
});
