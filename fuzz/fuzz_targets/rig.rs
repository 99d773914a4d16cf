//! Rig files: refused in words, or their devices drive.
#![no_main]

use libfuzzer_sys::fuzz_target;
use rigsim_testkit::text;

fuzz_target!(|text: &str| text::rig(text));
