//! See `targets::model`.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| targets::model::run(bytes));
