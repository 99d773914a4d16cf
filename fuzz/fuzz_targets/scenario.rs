//! Scenario files: refused in words, or played for a while.
#![no_main]

use libfuzzer_sys::fuzz_target;
use rigsim_testkit::text;

fuzz_target!(|text: &str| text::scenario(text));
