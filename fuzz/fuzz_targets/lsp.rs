//! Input that begins like a message is a session as it stands; all else is a text that is opened, asked about and edited.
#![no_main]

#[allow(dead_code)]
#[path = "../../tests/common/properties.rs"]
mod properties;
#[allow(dead_code)]
#[path = "../../tests/common/typed.rs"]
mod typed;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    if bytes.starts_with(b"Content-") {
        properties::lsp(bytes);
    } else if let Ok(text) = std::str::from_utf8(bytes) {
        // Places follow from the text.
        let mut state = bytes.iter().fold(1_u64, |hash, byte| hash.wrapping_mul(0x100_0000_01b3) ^ u64::from(*byte));
        let dice = |n: usize| {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 33) as usize % n.max(1)
        };
        properties::lsp(&properties::session(text, dice));
    }
});
