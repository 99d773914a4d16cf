//! Bytes that clients of the control socket send.
#![no_main]

use libfuzzer_sys::fuzz_target;

fuzz_target!(|data: &[u8]| rigsim_testkit::request::play(data));
