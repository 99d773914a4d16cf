//! Traces: replayed for a while, or refused in words.
#![no_main]

use libfuzzer_sys::fuzz_target;
use rigsim_testkit::trace;

fuzz_target!(|text: &str| trace::play(text));
