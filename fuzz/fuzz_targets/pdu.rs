//! See `targets::pdu`.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| targets::pdu::run(bytes));
