//! Numbers in files: NumPy's arrays, tables of text, safetensors, the intensities of luminaires. JSON is read where its values become
//! those of the language.

pub mod ies;
pub mod npy;
pub mod safetensors;
pub mod table;
