//! Writes `src/` anew from `grammar.js`, as `tree-sitter generate --abi 14` does: the oldest format that is read everywhere.

use tree_sitter_generate::{OptLevel, generate_parser_in_directory};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let folder = env!("CARGO_MANIFEST_DIR");
    generate_parser_in_directory(
        folder,
        None::<&str>,
        None::<&str>,
        14,
        None,
        Some("node"),
        true,
        OptLevel::default(),
    )?;
    Ok(())
}
