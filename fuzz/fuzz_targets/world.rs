//! World files: refused in words, or both devices drive in them.
#![no_main]

use libfuzzer_sys::fuzz_target;
use rigsim_testkit::text;

fuzz_target!(|text: &str| text::world(text));
