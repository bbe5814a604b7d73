//! `cargo +nightly fuzz run record --features libfuzzer`
#![no_main]

use libfuzzer_sys::fuzz_target;

fuzz_target!(|data: &[u8]| ekf_core_fuzz::record::run(data));
