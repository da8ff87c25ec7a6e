//! See `targets::modbus_tcp`.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| targets::modbus_tcp::run(bytes));
