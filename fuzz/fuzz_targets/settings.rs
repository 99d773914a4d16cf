//! Settings files: refused in words, or both devices drive with them.
#![no_main]

use libfuzzer_sys::fuzz_target;
use rigsim_testkit::text;

fuzz_target!(|text: &str| text::settings(text));
