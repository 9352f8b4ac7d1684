//! Bitmap textures, bilinear, with derivatives in the texels and in uv.

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Wrap {
    Repeat,
    Clamp,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Filter {
    Bilinear,
    Nearest,
}

/// A bitmap; row 0 is the top (v = 0). 1×1 is a constant.
#[derive(Clone, Debug, PartialEq)]
pub struct Texture {
    pub width: usize,
    pub height: usize,
    /// 1 or 3.
    pub channels: usize,
    /// `data[(y * width + x) * channels + c]`.
    pub data: Vec<f32>,
    pub wrap: Wrap,
    pub filter: Filter,
}
