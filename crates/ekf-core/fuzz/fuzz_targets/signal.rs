//! `cargo +nightly fuzz run signal --features libfuzzer`
#![no_main]

use libfuzzer_sys::fuzz_target;

fuzz_target!(|data: &[u8]| ekf_core_fuzz::signal::run(data));
