#![no_main]

#[allow(dead_code)]
#[path = "../../tests/common/properties.rs"]
mod properties;

libfuzzer_sys::fuzz_target!(|text: &str| properties::parser(text));
