//! The dscene language for tree-sitter.

use tree_sitter_language::LanguageFn;

unsafe extern "C" {
    fn tree_sitter_dscene() -> *const ();
}

/// What `tree_sitter::Parser::set_language` takes, by `into()`.
// SAFETY: the function is that of src/parser.c, which returns a pointer to a language that lives for ever.
pub const LANGUAGE: LanguageFn = unsafe { LanguageFn::from_raw(tree_sitter_dscene) };

pub const HIGHLIGHTS_QUERY: &str = include_str!("../../queries/highlights.scm");
pub const FOLDS_QUERY: &str = include_str!("../../queries/folds.scm");
pub const LOCALS_QUERY: &str = include_str!("../../queries/locals.scm");
