//! Sessions of operations with a mecanum car.
#![no_main]

use libfuzzer_sys::fuzz_target;
use sim_testkit::session::{Devices, Session, play};

fuzz_target!(|session: Session| {
    let mut session = session;
    session.setup.devices = Devices::Mecanum;
    let _ = play(&session);
});
