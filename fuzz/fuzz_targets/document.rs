//! Scenario, rig and world files made of choices: refused in words, or played to their end.
#![no_main]

use libfuzzer_sys::fuzz_target;
use rigsim_testkit::document;

fuzz_target!(|choices: &[u8]| document::play(choices));
