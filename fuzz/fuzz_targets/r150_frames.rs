//! Streams of bytes to the R150's decoder and firmware.
#![no_main]

use libfuzzer_sys::fuzz_target;
use rigsim_testkit::stream::{Stream, r150};

fuzz_target!(|data: &[u8]| r150(&Stream::read(data)));
