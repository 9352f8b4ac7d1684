//! Numbers in files: NumPy's arrays and tables of text. JSON is read where its values become those of the language.

pub mod npy;
pub mod table;
