//! Images in a terminal: by the protocol that it knows, or two pixels a character.

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD as BASE64;

use crate::eval::number_text;
use crate::image::Image;
use crate::image::colormap::Colormap;
use crate::image::file::encode_bytes;
use crate::image::filter::linear_to_srgb;

/// Columns of a picture made of characters.
const COLUMNS: usize = 64;
/// Pictures made of pixels have sides between these: larger ones shrink, the pixels of smaller ones grow.
const LEAST_SIDE: usize = 256;
const LARGEST_SIDE: usize = 640;
/// Most base64 in a piece of kitty's protocol.
const PIECE: usize = 4096;

/// How a terminal is told of an image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Protocol {
    /// <https://sw.kovidgoyal.net/kitty/graphics-protocol>
    Kitty,
    /// <https://iterm2.com/documentation-images.html>
    Iterm,
    /// Graphics of the VT340, which many terminals know.
    Sixel,
    /// Upper half blocks over a background colour.
    Blocks,
}

impl Protocol {
    /// What the environment says of the terminal. `DSCENE_IMAGES` has the last word.
    pub fn of_terminal(variable: impl Fn(&str) -> Option<String>) -> Protocol {
        let has = |name: &str| variable(name).is_some_and(|value| !value.is_empty());
        let text = |name: &str| variable(name).unwrap_or_default();
        match text("DSCENE_IMAGES").as_str() {
            "kitty" => return Protocol::Kitty,
            "iterm" => return Protocol::Iterm,
            "sixel" => return Protocol::Sixel,
            "blocks" => return Protocol::Blocks,
            _ => {}
        }
        let (term, program) = (text("TERM"), text("TERM_PROGRAM"));
        // Multiplexers pass characters on and not images.
        if has("TMUX") || has("STY") || term.starts_with("tmux") || term.starts_with("screen") {
            return Protocol::Blocks;
        }
        let knows_kitty = term.contains("kitty") || term.contains("ghostty") || program == "ghostty";
        if knows_kitty || has("KITTY_WINDOW_ID") || has("KONSOLE_VERSION") {
            return Protocol::Kitty;
        }
        if ["iTerm.app", "WezTerm", "mintty"].contains(&program.as_str()) || text("LC_TERMINAL") == "iTerm2" {
            return Protocol::Iterm;
        }
        if ["foot", "mlterm", "contour", "yaft"].iter().any(|name| term.starts_with(name)) || term.contains("sixel") {
            return Protocol::Sixel;
        }
        Protocol::Blocks
    }
}

/// The image as text that draws it: values clamped to 0..1 and sRGB-encoded. One channel is grey, two are red and green.
pub fn drawn(image: &Image, protocol: Protocol) -> String {
    if image.width == 0 || image.height == 0 || image.channels == 0 {
        return String::new();
    }
    if protocol == Protocol::Blocks {
        return half_blocks(image, COLUMNS);
    }
    let longest = image.width.max(image.height);
    let scaled = |side: usize| match longest {
        n if n > LARGEST_SIDE => (side * LARGEST_SIDE / n).max(1),
        n => side * LEAST_SIDE.div_ceil(n),
    };
    let (width, height) = (scaled(image.width), scaled(image.height));
    let pixels = resized(image, width, height);
    if protocol == Protocol::Sixel {
        return sixel(&pixels, width);
    }
    // Of positive size and three channels, it has a PNG file.
    let Ok(png) = encode_bytes(width, height, 3, pixels.as_flattened()) else { return String::new() };
    let encoded = BASE64.encode(&png);
    if protocol == Protocol::Iterm {
        return format!("\x1b]1337;File=inline=1;size={}:{encoded}\x07", png.len());
    }
    let mut out = String::new();
    let pieces = encoded.len().div_ceil(PIECE);
    for (i, piece) in encoded.as_bytes().chunks(PIECE).enumerate() {
        // Transmit and display a PNG file, and answer nothing, which would be taken for keys.
        let what = if i == 0 { "a=T,f=100,q=2," } else { "" };
        let more = u8::from(i + 1 < pieces);
        out.push_str(&format!("\x1b_G{what}m={more};{}\x1b\\", String::from_utf8_lossy(piece)));
    }
    out
}

/// Values on both sides of zero as colours of a diverging map, and what its ends stand for. Channels are taken together by their mean; a
/// thousandth of the pixels may lie beyond the ends, or the glints of a noisy derivative would leave the rest white.
pub fn signed(image: &Image) -> (Image, String) {
    let mean = |pixel: &[f32]| pixel.iter().map(|x| f64::from(*x)).sum::<f64>() / pixel.len() as f64;
    let values: Vec<f64> = image.data.chunks_exact(image.channels.max(1)).map(mean).collect();
    let mut sizes: Vec<f64> = values.iter().map(|x| x.abs()).filter(|x| x.is_finite()).collect();
    sizes.sort_unstable_by(f64::total_cmp);
    let end = sizes.get((sizes.len() * 999 / 1000).min(sizes.len().saturating_sub(1))).copied().unwrap_or(0.0);
    let end = if end > 0.0 { end } else { sizes.last().copied().unwrap_or(0.0) };
    let colours = Colormap::Diverging.colours();
    let last = (colours.len() - 1) as f64;
    let colour = |x: f64| {
        let t = if end > 0.0 && x.is_finite() { 0.5 + 0.5 * (x / end).clamp(-1.0, 1.0) } else { 0.5 };
        colours[(t * last).round() as usize].map(|c| c as f32)
    };
    let data = values.iter().flat_map(|x| colour(*x)).collect();
    let legend = match end > 0.0 {
        true => format!("blue −{0} … white 0 … red {0}", number_text(end)),
        false => "zero everywhere".to_owned(),
    };
    (Image { channels: 3, data, ..*image }, legend)
}

/// The image at most `columns` characters wide, in 24-bit colour; rows end with a reset.
pub fn half_blocks(image: &Image, columns: usize) -> String {
    if image.width == 0 || image.height == 0 || image.channels == 0 || columns == 0 {
        return String::new();
    }
    let width = image.width.min(columns);
    let height = ((image.height * width + image.width / 2) / image.width).max(1);
    let pixels = resized(image, width, height);
    let mut out = String::new();
    for rows in pixels.chunks(2 * width) {
        let (top, bottom) = rows.split_at(width);
        for (column, [r, g, b]) in top.iter().enumerate() {
            let [br, bg, bb] = bottom.get(column).copied().unwrap_or([0; 3]);
            out.push_str(&format!("\x1b[38;2;{r};{g};{b};48;2;{br};{bg};{bb}m▀"));
        }
        out.push_str("\x1b[0m\n");
    }
    out
}

/// The pixels of the image at another size, each the mean of what it covers.
fn resized(image: &Image, width: usize, height: usize) -> Vec<[u8; 3]> {
    let at = |i: usize| color(image, i % width, i / width, width, height);
    (0..width * height).map(at).collect()
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
    (linear_to_srgb(x) * 255.0).round() as u8
}

/// Levels of each of the three colours of a sixel image.
const LEVELS: usize = 6;

/// Rows of six pixels, one colour after the other: a character has a bit for each of its six pixels that have the colour. 216 colours,
/// between which an ordered pattern mixes (Bayer 1973).
fn sixel(pixels: &[[u8; 3]], width: usize) -> String {
    const PATTERN: [[usize; 4]; 4] = [[0, 8, 2, 10], [12, 4, 14, 6], [3, 11, 1, 9], [15, 7, 13, 5]];
    let level = |value: u8, x: usize, y: usize| {
        let threshold = (PATTERN[y % 4][x % 4] as f64 + 0.5) / 16.0;
        let exact = f64::from(value) / 255.0 * (LEVELS - 1) as f64;
        ((exact + threshold) as usize).min(LEVELS - 1)
    };
    let number = |i: usize| {
        let [r, g, b] = pixels[i].map(|value| level(value, i % width, i / width));
        (r * LEVELS + g) * LEVELS + b
    };
    let numbers: Vec<usize> = (0..pixels.len()).map(number).collect();
    let mut out = format!("\x1bP0;1q\"1;1;{width};{}", pixels.len() / width);
    let percent = |level: usize| level * 100 / (LEVELS - 1);
    for i in 0..LEVELS.pow(3) {
        let (r, g, b) = (i / LEVELS / LEVELS, i / LEVELS % LEVELS, i % LEVELS);
        out.push_str(&format!("#{i};2;{};{};{}", percent(r), percent(g), percent(b)));
    }
    for band in numbers.chunks(6 * width) {
        let mut used: Vec<usize> = band.to_vec();
        used.sort_unstable();
        used.dedup();
        for colour in used {
            out.push_str(&format!("#{colour}"));
            let bits =
                |x: usize| (0..6).filter(|row| band.get(row * width + x) == Some(&colour)).map(|row| 1u8 << row).sum();
            let bits: Vec<u8> = (0..width).map(bits).collect();
            for run in bits.chunk_by(|a, b| a == b) {
                let character = char::from(b'?' + run[0]);
                match run.len() {
                    1..=3 => (0..run.len()).for_each(|_| out.push(character)),
                    n => out.push_str(&format!("!{n}{character}")),
                }
            }
            out.push('$');
        }
        out.push('-');
    }
    out.push_str("\x1b\\");
    out
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

    #[test]
    fn terminals_get_the_protocol_that_they_know() {
        let of = |variables: &[(&str, &str)]| {
            Protocol::of_terminal(|name| variables.iter().find(|(n, _)| *n == name).map(|(_, v)| (*v).to_owned()))
        };
        assert_eq!(of(&[("TERM", "xterm-256color")]), Protocol::Blocks);
        assert_eq!(of(&[("TERM", "xterm-kitty")]), Protocol::Kitty);
        assert_eq!(of(&[("TERM_PROGRAM", "WezTerm")]), Protocol::Iterm);
        assert_eq!(of(&[("TERM", "foot")]), Protocol::Sixel);
        // Within tmux it is tmux that draws, whatever is around it.
        assert_eq!(of(&[("TERM", "tmux-256color"), ("KITTY_WINDOW_ID", "1"), ("TMUX", "/tmp/x")]), Protocol::Blocks);
        assert_eq!(of(&[("TMUX", "/tmp/x"), ("DSCENE_IMAGES", "sixel")]), Protocol::Sixel);
    }

    /// The PNG file in a text that draws it, decoded.
    fn decoded(base64: &str) -> Image {
        let bytes = BASE64.decode(base64).unwrap();
        crate::image::file::decode(&bytes, crate::image::file::Encoding::Srgb, None).unwrap().image
    }

    #[test]
    fn kitty_and_iterm_get_a_png_file_of_the_picture() {
        let mut image = Image::new(700, 300, 3);
        for (i, x) in image.data.iter_mut().enumerate() {
            // Noise, so that the file is long.
            *x = (i * 2_654_435_761 % 1_000_003) as f32 / 1_000_003.0;
        }
        image.pixel_mut(0, 0).copy_from_slice(&[1.0, 0.0, 0.0]);
        let kitty = drawn(&image, Protocol::Kitty);
        let pieces: Vec<&str> = kitty.split_terminator("\x1b\\").collect();
        assert!(pieces.len() > 3 && pieces[0].starts_with("\x1b_Ga=T,f=100,q=2,m=1;"));
        assert!(pieces[1..pieces.len() - 1].iter().all(|p| p.starts_with("\x1b_Gm=1;") && p.len() <= PIECE + 9));
        assert!(pieces[pieces.len() - 1].starts_with("\x1b_Gm=0;"));
        let whole: String = pieces.iter().filter_map(|p| p.split_once(';').map(|(_, data)| data)).collect();
        let found = decoded(&whole);
        assert_eq!((found.width, found.height, found.channels), (640, 274, 3));
        let small = Image { width: 2, height: 1, channels: 1, data: vec![1.0, 0.0] };
        let iterm = drawn(&small, Protocol::Iterm);
        let data = iterm.strip_prefix("\x1b]1337;File=inline=1;size=").and_then(|t| t.strip_suffix('\x07')).unwrap();
        let found = decoded(data.split_once(':').unwrap().1);
        // Pixels of small images grow.
        assert_eq!((found.width, found.height), (256, 128));
        assert_eq!((found.pixel(127, 5)[0], found.pixel(128, 5)[0]), (1.0, 0.0));
        assert_eq!(drawn(&Image::new(0, 5, 3), Protocol::Kitty), "");
    }

    /// What a terminal makes of a sixel image: the number of the colour at each pixel.
    fn painted(text: &str, width: usize, height: usize) -> Vec<usize> {
        let body = text.split_once(&format!("\"1;1;{width};{height}")).unwrap().1.strip_suffix("\x1b\\").unwrap();
        let mut found = vec![usize::MAX; width * height];
        let (mut x, mut band, mut colour, mut repeat) = (0, 0, 0, 1);
        let mut chars = body.chars().peekable();
        let number = |chars: &mut std::iter::Peekable<std::str::Chars<'_>>| {
            let mut n = 0;
            while let Some(digit) = chars.peek().and_then(|c| c.to_digit(10)) {
                n = 10 * n + digit as usize;
                chars.next();
            }
            n
        };
        while let Some(c) = chars.next() {
            match c {
                '#' => {
                    colour = number(&mut chars);
                    while chars.next_if_eq(&';').is_some() {
                        number(&mut chars);
                    }
                }
                '!' => repeat = number(&mut chars),
                '$' => x = 0,
                '-' => (x, band) = (0, band + 1),
                c => {
                    let bits = c as usize - '?' as usize;
                    for at in x..x + repeat {
                        for row in (0..6).filter(|row| bits & (1 << row) != 0) {
                            found[(6 * band + row) * width + at] = colour;
                        }
                    }
                    (x, repeat) = (x + repeat, 1);
                }
            }
        }
        found
    }

    #[test]
    fn sixels_paint_every_pixel() {
        let pixels: Vec<[u8; 3]> = (0..13 * 8).map(|i| if i % 13 < 7 { [255, 0, 0] } else { [0, 0, 255] }).collect();
        let found = painted(&sixel(&pixels, 13), 13, 8);
        let wanted: Vec<usize> = (0..13 * 8).map(|i| if i % 13 < 7 { 5 * 36 } else { 5 }).collect();
        assert_eq!(found, wanted);
    }

    #[test]
    fn derivatives_are_blue_below_zero_and_red_above() {
        let image =
            Image { width: 3, height: 1, channels: 3, data: vec![-2.0, -2.0, -2.0, 0.0, 0.0, 0.0, 4.0, 0.0, 2.0] };
        let (picture, legend) = signed(&image);
        assert_eq!(legend, "blue −2 … white 0 … red 2");
        let [low, zero, high] = [0, 1, 2].map(|x| picture.pixel(x, 0).to_vec());
        assert!(low[2] > 2.0 * low[0] && high[0] > 2.0 * high[2], "{low:?} {high:?}");
        assert!(zero.iter().all(|c| *c > 0.9), "{zero:?}");
        assert_eq!(signed(&Image::new(2, 2, 1)).1, "zero everywhere");
    }
}
