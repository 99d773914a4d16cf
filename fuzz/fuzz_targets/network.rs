//! Bytes of a client on the network, raw and by RFC 2217.
#![no_main]

use libfuzzer_sys::fuzz_target;

fuzz_target!(|data: &[u8]| rigsim_testkit::network::play(data));
