//! See `targets::setup_body`.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| targets::setup_body::run(bytes));
