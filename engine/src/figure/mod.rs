//! Figures: curves over two axes, as SVG and as pixels. `layout` makes marks of a figure (lines, areas, dots, words), which `svg` writes
//! and `raster` draws; there words are made of strokes (`letters`), since no font comes with the program.

mod axis;
mod layout;
mod letters;
mod raster;
mod svg;

use serde::{Deserialize, Serialize};

/// Curves over two axes.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Figure {
    /// Above all else; may be empty.
    pub title: String,
    /// From left to right.
    pub x: Axis,
    /// From below to above.
    pub y: Axis,
    /// In the order of their colours.
    pub curves: Vec<Curve>,
    /// Width and height in pixels of the SVG; those of the PNG are twice as many.
    pub size: [f64; 2],
}

/// An axis, whose range follows from what is drawn.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Axis {
    /// What it shows, and in which unit; may be empty.
    pub label: String,
    /// Equal ratios are equally far apart.
    pub log: bool,
}

/// A curve, with a name beside others.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Curve {
    /// In the key; may be empty.
    pub name: String,
    /// In the order in which they are joined.
    pub points: Vec<Point>,
}

/// A point of a curve. Where a coordinate is not finite, or has no logarithm on a logarithmic axis, the curve has a gap.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Point {
    /// Along the axis from left to right, in its unit.
    pub x: f64,
    /// Along the axis from below to above, in its unit.
    pub y: f64,
    /// How far the band around the curve reaches up and down; NaN where there is none.
    pub error: f64,
}

/// The figure as the text of an SVG file.
pub fn svg(figure: &Figure) -> String {
    svg::write(figure.size, &figure.title, &layout::marks(figure))
}

/// The figure as a PNG file.
pub fn png(figure: &Figure) -> Result<Vec<u8>, crate::image::ImageError> {
    raster::draw(figure.size, &layout::marks(figure)).encoded()
}

/// Something to draw. Lengths are in pixels of the SVG, from the top left.
#[derive(Clone, Debug, PartialEq)]
enum Mark {
    Line { role: Role, points: Vec<[f64; 2]>, colour: Colour, width: f64, dashed: bool },
    Area { points: Vec<[f64; 2]>, colour: Colour, opacity: f64 },
    Dot { at: [f64; 2], radius: f64, colour: Colour },
    Words(Words),
}

#[derive(Clone, Debug, PartialEq)]
struct Words {
    text: String,
    /// On the baseline, at the start, in the middle or at the end of the words.
    at: [f64; 2],
    anchor: Anchor,
    /// Read from bottom to top.
    upright: bool,
    /// The height of a line of words; capitals are 0.7 of it.
    size: f64,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Anchor {
    Start,
    Middle,
    End,
}

/// What a line is, which SVG says as its class.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Role {
    Grid,
    Tick,
    Axis,
    Curve,
    Key,
}

/// Red, green and blue, as sRGB stores them.
type Colour = [u8; 3];

const INK: Colour = [0x22, 0x22, 0x22];

#[cfg(test)]
mod tests;
