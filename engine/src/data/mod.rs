//! Numbers in files: NumPy's arrays, tables of text and safetensors. JSON is read where its values become those of the language.

pub mod npy;
pub mod safetensors;
pub mod table;
