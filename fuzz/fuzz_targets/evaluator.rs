#![no_main]

#[allow(dead_code)]
#[path = "../../tests/common/properties.rs"]
mod properties;
#[allow(dead_code)]
#[path = "../../tests/common/typed.rs"]
mod typed;

libfuzzer_sys::fuzz_target!(|text: &str| {
    dscene::memory::set_limit(512 << 20);
    properties::evaluator(text);
});
