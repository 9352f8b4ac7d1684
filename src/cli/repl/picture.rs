//! Images in a terminal: two pixels a character, upper half block over background colour.

use crate::image::Image;

/// The image at most `columns` characters wide, in 24-bit colour: values clamped to 0..1 and sRGB-encoded. One channel
/// is grey, two are red and green; rows end with a reset.
pub fn half_blocks(image: &Image, columns: usize) -> String {
    if image.width == 0 || image.height == 0 || image.channels == 0 || columns == 0 {
        return String::new();
    }
    let width = image.width.min(columns);
    let height = ((image.height * width + image.width / 2) / image.width).max(1);
    let mut out = String::new();
    for row in (0..height).step_by(2) {
        for column in 0..width {
            let top = color(image, column, row, width, height);
            let bottom = if row + 1 < height { color(image, column, row + 1, width, height) } else { [0; 3] };
            let ([r, g, b], [br, bg, bb]) = (top, bottom);
            out.push_str(&format!("\x1b[38;2;{r};{g};{b};48;2;{br};{bg};{bb}m▀"));
        }
        out.push_str("\x1b[0m\n");
    }
    out
}

/// Mean of the pixels that one cell covers.
fn color(image: &Image, column: usize, row: usize, width: usize, height: usize) -> [u8; 3] {
    let span = |i: usize, n: usize, size: usize| {
        let start = i * size / n;
        start..((i + 1) * size / n).clamp(start + 1, size.max(start + 1))
    };
    let mut sum = [0.0_f64; 3];
    let mut count = 0.0;
    for y in span(row, height, image.height) {
        for x in span(column, width, image.width) {
            let pixel = image.pixel(x.min(image.width - 1), y.min(image.height - 1));
            for (c, total) in sum.iter_mut().enumerate() {
                let value = match image.channels {
                    1 => pixel[0],
                    n if c < n => pixel[c],
                    _ => 0.0,
                };
                *total += f64::from(value);
            }
            count += 1.0;
        }
    }
    sum.map(|total| srgb(total / count))
}

fn srgb(linear: f64) -> u8 {
    let x = if linear.is_nan() { 0.0 } else { linear.clamp(0.0, 1.0) };
    let encoded = if x <= 0.003_130_8 { 12.92 * x } else { 1.055 * x.powf(1.0 / 2.4) - 0.055 };
    (encoded * 255.0).round() as u8
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_pixels_share_a_character() {
        let mut image = Image::new(1, 2, 3);
        image.pixel_mut(0, 0).copy_from_slice(&[1.0, 0.0, 0.0]);
        image.pixel_mut(0, 1).copy_from_slice(&[0.0, 0.0, f32::NAN]);
        assert_eq!(half_blocks(&image, 80), "\x1b[38;2;255;0;0;48;2;0;0;0m▀\x1b[0m\n");
    }

    #[test]
    fn large_images_shrink_and_odd_ones_do_not_break() {
        let picture = half_blocks(&Image::new(301, 77, 1), 40);
        assert_eq!(picture.lines().count(), 5);
        assert!(picture.lines().all(|l| l.matches('▀').count() == 40));
        assert_eq!(half_blocks(&Image::new(0, 5, 3), 40), "");
        for (w, h) in [(1, 1), (3, 1), (1, 3), (1000, 1), (1, 7)] {
            assert!(!half_blocks(&Image::new(w, h, 2), 33).is_empty());
        }
    }
}
