//! See `targets::line`.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| targets::line::run(bytes));
