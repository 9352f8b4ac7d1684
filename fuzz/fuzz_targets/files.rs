//! The first byte chooses the ending of the file that the others are.
#![no_main]

#[allow(dead_code)]
#[path = "../../tests/common/properties.rs"]
mod properties;
#[allow(dead_code)]
#[path = "../../tests/common/typed.rs"]
mod typed;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    let Some((first, bytes)) = bytes.split_first() else { return };
    dscene::memory::set_limit(1 << 30);
    let folder = std::env::temp_dir().join(format!("dscene-fuzz-{}", std::process::id()));
    let _ = std::fs::create_dir_all(&folder);
    let ending = properties::ENDINGS[usize::from(*first) % properties::ENDINGS.len()];
    properties::file(ending, bytes, &folder);
});
