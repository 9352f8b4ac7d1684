//! Numbers in files: NumPy's arrays, tables of text, safetensors, the intensities of luminaires. JSON is read where its values become
//! those of the language.

pub mod ies;
mod integers;
pub mod npy;
pub mod safetensors;
pub mod table;

pub use integers::Rounded;

/// What was read of a file, and a sentence about each thing of it that is not done.
pub type Noted<T> = (T, Vec<String>);
