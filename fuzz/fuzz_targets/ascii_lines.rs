//! Streams of bytes to the decoder of the ROS link's lines, and to the mecanum board's firmware.
#![no_main]

use libfuzzer_sys::fuzz_target;
use rigsim_testkit::stream::{Stream, ascii};

fuzz_target!(|data: &[u8]| ascii(&Stream::read(data)));
