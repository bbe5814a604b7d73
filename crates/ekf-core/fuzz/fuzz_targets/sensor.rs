//! `cargo +nightly fuzz run sensor --features libfuzzer`
#![no_main]

use libfuzzer_sys::fuzz_target;

fuzz_target!(|data: &[u8]| ekf_core_fuzz::sensor::run(data));
