//! Streams of bytes to the decoders of the mecanum board's main link, and to its firmware.
#![no_main]

use libfuzzer_sys::fuzz_target;
use rigsim_testkit::stream::{Stream, mecanum};

fuzz_target!(|data: &[u8]| mecanum(&Stream::read(data)));
