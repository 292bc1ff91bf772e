#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| multidrop_fuzz::port_load(data));
