//! See `targets::mqtt`.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| targets::mqtt::run(bytes));
