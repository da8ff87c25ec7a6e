//! See `targets::sparkplug`.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| targets::sparkplug::run(bytes));
