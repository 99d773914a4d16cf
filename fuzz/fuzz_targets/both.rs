//! Sessions of operations with an R150 and a mecanum car in each other's way.
#![no_main]

use libfuzzer_sys::fuzz_target;
use sim_testkit::session::{Devices, Session, play};

fuzz_target!(|session: Session| {
    let mut session = session;
    session.setup.devices = Devices::Both;
    let _ = play(&session);
});
