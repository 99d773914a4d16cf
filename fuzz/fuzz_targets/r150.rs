//! Sessions of operations with an R150.
#![no_main]

use libfuzzer_sys::fuzz_target;
use sim_testkit::session::{Devices, Session, play};

fuzz_target!(|session: Session| {
    let mut session = session;
    session.setup.devices = Devices::R150;
    let _ = play(&session);
});
