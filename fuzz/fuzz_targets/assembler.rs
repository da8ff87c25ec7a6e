//! See `targets::assembler`.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| targets::assembler::run(bytes));
