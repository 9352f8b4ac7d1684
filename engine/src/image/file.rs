//! Reads image files (PNG, JPEG, Radiance HDR, OpenEXR) and writes PNG, HDR and EXR. Saving is atomic.

use std::path::Path;

use image::metadata::Orientation;

pub use crate::files::{describe_io, is_file, read_bytes, write_atomically};

pub use super::hdr::BRIGHTEST;
pub use super::png::Clipped;

use super::{Image, ImageError, exr, hdr, jpeg, png};

/// The encoding of the integers in PNG and JPEG files.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Encoding {
    /// As the file declares (PNG's gAMA and sRGB chunks), and sRGB if it does not, for any bit depth.
    AsFile,
    /// sRGB-encoded colours: decoded to linear values, except alpha.
    Srgb,
    /// Data such as roughness, normals and masks: only scaled to 0..1.
    Linear,
}

/// An image, and notes about features of its file that are not supported.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Decoded {
    /// The image, in linear values.
    pub image: Image,
    /// One sentence for each feature that is not supported.
    pub notes: Vec<String>,
}

/// Extensions of the files that [`load`] reads.
pub const READABLE: [&str; 5] = ["png", "jpg", "jpeg", "hdr", "exr"];
/// Extensions of the files that [`save`] writes.
pub const WRITABLE: [&str; 3] = ["png", "hdr", "exr"];

/// Reads an image and orients it by its EXIF data. Grey files have 1 channel, colours 3, with alpha 4. Of an EXR file one layer is read:
/// the named one, or the first with colours; a file without colours gives all its channels, ordered by name.
pub fn load(path: &Path, encoding: Encoding, layer: Option<&str>) -> Result<Decoded, ImageError> {
    let extension = extension(path);
    if !READABLE.contains(&extension.as_str()) {
        let path = path.display().to_string();
        return Err(ImageError::UnsupportedExtension { path, action: "reading", extension, extensions: &READABLE });
    }
    let failed = |message: String| ImageError::File { path: path.display().to_string(), message };
    let bytes = read_bytes(path).map_err(failed)?;
    decode(&bytes, encoding, layer).map_err(|e| failed(e.to_string()))
}

/// Writes an image in the format of the extension: PNG in 8 bits, sRGB-encoded and clipped to 0..1; HDR and EXR linear. The error is
/// [`ImageError::File`] only where the file could not be written.
pub fn save(path: &Path, image: &Image) -> Result<(), ImageError> {
    let extension = extension(path);
    let failed = |message: String| ImageError::File { path: path.display().to_string(), message };
    let bytes = match extension.as_str() {
        "png" => png::encode(image),
        "hdr" => hdr::encode(image),
        "exr" => exr::encode(image),
        _ => {
            let path = path.display().to_string();
            return Err(ImageError::UnsupportedExtension { path, action: "writing", extension, extensions: &WRITABLE });
        }
    }?;
    write_atomically(path, &bytes).map_err(|e| failed(describe_io(&e)))
}

/// Writes images of one size as an animation, an animated PNG file.
pub fn save_animation(path: &Path, frames: &[Image]) -> Result<(), ImageError> {
    let failed = |message: String| ImageError::File { path: path.display().to_string(), message };
    let bytes = png::encode_animation(frames)?;
    write_atomically(path, &bytes).map_err(|e| failed(describe_io(&e)))
}

/// Decodes the bytes of an image file; the format is recognised by its first bytes.
pub fn decode(bytes: &[u8], encoding: Encoding, layer: Option<&str>) -> Result<Decoded, ImageError> {
    let is = |magic: &[u8]| bytes.starts_with(magic);
    let is_exr = is(&[0x76, 0x2f, 0x31, 0x01]);
    if let (Some(layer), false) = (layer, is_exr) {
        return Err(ImageError::Argument(format!("only EXR files have layers; this one has no “{layer}”")));
    }
    let mut decoded = match () {
        () if is_exr => exr::decode(bytes, layer)?,
        () if is(b"\x89PNG\r\n\x1a\n") => png::decode(bytes, encoding)?,
        () if is(&[0xff, 0xd8, 0xff]) => jpeg::decode(bytes, encoding)?,
        () if hdr::MAGIC.iter().any(|magic| is(magic)) => hdr::decode(bytes)?,
        () => {
            let empty = if bytes.is_empty() { "; the file is empty" } else { "" };
            return Err(ImageError::Argument(format!("this is no PNG, JPEG, HDR or EXR image{empty}")));
        }
    };
    decoded.notes.extend(not_finite(&decoded.image));
    Ok(decoded)
}

/// Pixels with a channel of which that is true: how many, and the place [x, y] of the first, from the top left.
fn pixels_with(image: &Image, is_so: impl Fn(f32) -> bool) -> Option<(usize, [usize; 2])> {
    let mut all = image.data.chunks_exact(image.channels.max(1)).map(|pixel| pixel.iter().any(|x| is_so(*x)));
    let at = all.position(|is_so| is_so)?;
    Some((1 + all.filter(|is_so| *is_so).count(), [at % image.width, at / image.width]))
}

/// Pixels with a channel that is no number, of which PNG and HDR files know nothing: they are black there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NotNumbers {
    /// How many there are.
    pub count: usize,
    /// Column and row of the first, from the top left.
    pub first: [usize; 2],
}

impl NotNumbers {
    /// Of an image; `None` if all its pixels are numbers.
    pub fn of(image: &Image) -> Option<NotNumbers> {
        pixels_with(image, f32::is_nan).map(|(count, first)| NotNumbers { count, first })
    }
}

/// Pixels of an image with a negative colour, which an HDR file does not hold: how many, and the least of their values.
pub fn negatives(image: &Image) -> Option<(usize, f32)> {
    let (count, _) = pixels_with(image, |x| x < 0.0)?;
    Some((count, image.data.iter().copied().fold(0.0, f32::min)))
}

/// A note about pixels that are not finite: the first of them and the number of others. Everything computed from them would be NaN or
/// infinite.
fn not_finite(image: &Image) -> Option<String> {
    let (count, [x, y]) = pixels_with(image, |x| !x.is_finite())?;
    let at = y * image.width + x;
    let value = image.data[at * image.channels..].iter().find(|x| !x.is_finite())?;
    let value = if value.is_nan() { "NaN" } else { "infinite" };
    Some(match count {
        1 => format!("the image's pixel [{x}, {y}] is {value}"),
        n => format!("{n} of the image's pixels are not finite; the first, [{x}, {y}], is {value}"),
    })
}

/// The PNG file of an image of 1 to 4 channels, in 8 bits, sRGB-encoded; two become red and green.
pub fn encode_png(image: &Image) -> Result<Vec<u8>, ImageError> {
    png::encode(image)
}

/// As [`encode_png`], in 16 bits, with colours that are sRGB-encoded or linear.
pub fn encode_wide_png(image: &Image, encoding: Encoding) -> Result<Vec<u8>, ImageError> {
    png::encode_wide(image, encoding)
}

/// A PNG file whose samples are these bytes, rows of one channel or three.
pub fn encode_bytes(width: usize, height: usize, channels: usize, bytes: &[u8]) -> Result<Vec<u8>, ImageError> {
    png::encode_bytes(width, height, channels, bytes)
}

/// The image oriented by EXIF data; unchanged if there are none, or they cannot be read.
pub(super) fn oriented(image: Image, exif: Option<&[u8]>) -> Result<Image, ImageError> {
    let orientation = exif.and_then(Orientation::from_exif_chunk).unwrap_or(Orientation::NoTransforms);
    let (w, h) = (image.width, image.height);
    // The source of the pixel at (x, y).
    let from: fn(usize, usize, usize, usize) -> (usize, usize) = match orientation {
        Orientation::NoTransforms => return Ok(image),
        Orientation::FlipHorizontal => |x, y, w, _| (w - 1 - x, y),
        Orientation::Rotate180 => |x, y, w, h| (w - 1 - x, h - 1 - y),
        Orientation::FlipVertical => |x, y, _, h| (x, h - 1 - y),
        Orientation::Rotate90FlipH => |x, y, _, _| (y, x),
        Orientation::Rotate90 => |x, y, _, h| (y, h - 1 - x),
        Orientation::Rotate270FlipH => |x, y, w, h| (w - 1 - y, h - 1 - x),
        Orientation::Rotate270 => |x, y, w, _| (w - 1 - y, x),
    };
    let sideways = matches!(
        orientation,
        Orientation::Rotate90FlipH | Orientation::Rotate90 | Orientation::Rotate270FlipH | Orientation::Rotate270
    );
    let (width, height) = if sideways { (h, w) } else { (w, h) };
    crate::memory::ask_for::<f32>(image.data.len())?;
    let mut data = Vec::with_capacity(image.data.len());
    for y in 0..height {
        for x in 0..width {
            let (x, y) = from(x, y, w, h);
            data.extend_from_slice(image.pixel(x, y));
        }
    }
    Ok(Image { width, height, channels: image.channels, data })
}

/// A note about a colour profile other than sRGB, which is not applied.
pub(super) fn profile_note(format: &str, profile: &[u8]) -> Option<String> {
    let has = |name: &[u8]| profile.windows(name.len()).any(|w| w == name);
    // The profile's description is ASCII or UTF-16, depending on the profile's version.
    let is_srgb = has(b"sRGB") || has(b"\0s\0R\0G\0B");
    let note = format!("the {format} file has a colour profile, which is not done: its colours are taken as sRGB");
    (!is_srgb).then_some(note)
}

/// The extension in lower case, "" if there is none.
fn extension(path: &Path) -> String {
    path.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::super::exr::encode as encode_exr;
    use super::super::filter::linear_to_srgb;
    use super::super::hdr::encode as encode_hdr;
    use super::*;

    fn gradient(width: usize, height: usize, channels: usize) -> Image {
        let mut image = Image::new(width, height, channels);
        let n = image.data.len() as f32;
        image.data.iter_mut().enumerate().for_each(|(i, v)| *v = i as f32 / n);
        image
    }

    #[test]
    fn exr_keeps_every_number() {
        for channels in [1, 2, 3, 4, 7, 12] {
            let mut image = gradient(5, 4, channels);
            image.data[3] = -1e9;
            image.data[2] = f32::INFINITY;
            assert_eq!(
                decode(&encode_exr(&image).unwrap(), Encoding::Srgb, None).unwrap().image,
                image,
                "{channels} channels"
            );
        }
    }

    #[test]
    fn png_keeps_colours_within_a_step() {
        for channels in [1, 3, 4] {
            let image = gradient(9, 7, channels);
            let back = decode(&encode_png(&image).unwrap(), Encoding::Srgb, None).unwrap().image;
            assert_eq!((back.width, back.height, back.channels), (9, 7, channels));
            for (k, (a, b)) in image.data.iter().zip(&back.data).enumerate() {
                let encoded = |v: f32| if k % channels == 3 { v as f64 } else { linear_to_srgb(v as f64) };
                assert!((encoded(*a) - encoded(*b)).abs() <= 0.5 / 255.0 + 1e-5, "{a} {b}");
            }
        }
        let grey = Image { width: 1, height: 1, channels: 1, data: vec![0.21404] };
        let png = encode_png(&grey).unwrap();
        assert!((decode(&png, Encoding::Linear, None).unwrap().image.data[0] - 0.5).abs() < 0.003);
        let wild = Image { width: 4, height: 1, channels: 1, data: vec![f32::NAN, -3.0, f32::INFINITY, 1e9] };
        assert_eq!(
            decode(&encode_png(&wild).unwrap(), Encoding::Linear, None).unwrap().image.data,
            [0.0, 0.0, 1.0, 1.0]
        );
        assert!(encode_png(&gradient(2, 2, 5)).is_err());
    }

    #[test]
    fn png_of_16_bits_is_read_in_16_bits() {
        let mut png = Vec::new();
        let samples: Vec<u8> = [1u16, 30000, 65535, 7].iter().flat_map(|v| v.to_be_bytes()).collect();
        let mut encoder = ::png::Encoder::new(&mut png, 2, 2);
        encoder.set_color(::png::ColorType::Grayscale);
        encoder.set_depth(::png::BitDepth::Sixteen);
        encoder.write_header().unwrap().write_image_data(&samples).unwrap();
        let image = decode(&png, Encoding::Linear, None).unwrap().image;
        assert_eq!(image.channels, 1);
        assert!((image.data[0] * 65535.0 - 1.0).abs() < 1e-3 && (image.data[1] * 65535.0 - 30000.0).abs() < 1e-2);
    }

    #[test]
    fn jpeg_and_hdr_are_read() {
        let mut jpeg = Vec::new();
        let encoder = jpeg_encoder::Encoder::new(&mut jpeg, 90);
        encoder.encode(&[188; 16 * 16 * 3], 16, 16, jpeg_encoder::ColorType::Rgb).unwrap();
        let image = decode(&jpeg, Encoding::Srgb, None).unwrap().image;
        assert!(image.data.iter().all(|v| (v - 0.5).abs() < 0.02));

        let mut bright = gradient(9, 3, 3);
        bright.data.iter_mut().for_each(|v| *v = *v * 50.0 + 1.0);
        let back = decode(&encode_hdr(&bright).unwrap(), Encoding::Srgb, None).unwrap().image;
        assert!(bright.data.iter().zip(&back.data).all(|(a, b)| (a - b).abs() < 0.01 * 51.0));
    }

    #[test]
    fn saving_is_whole_or_not_at_all() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.exr");
        save(&path, &gradient(3, 3, 3)).unwrap();
        assert_eq!(load(&path, Encoding::Srgb, None).unwrap().image, gradient(3, 3, 3));
        save(&path, &gradient(2, 2, 3)).unwrap();
        assert_eq!(load(&path, Encoding::Srgb, None).unwrap().image, gradient(2, 2, 3));
        // A target that cannot be replaced leaves nothing behind.
        let taken = folder.path().join("taken.png");
        fs::create_dir(&taken).unwrap();
        fs::write(taken.join("x"), "x").unwrap();
        assert!(save(&taken, &gradient(2, 2, 3)).is_err());
        assert!(save(&folder.path().join("missing/a.png"), &gradient(2, 2, 3)).is_err());
        let mut names: Vec<_> = fs::read_dir(folder.path()).unwrap().map(|e| e.unwrap().file_name()).collect();
        names.sort();
        assert_eq!(names, ["a.exr", "taken.png"]);
    }

    #[test]
    fn errors_say_what_is_wrong() {
        let folder = tempfile::tempdir().unwrap();
        let message = |name: &str, bytes: Option<&[u8]>| {
            let path = folder.path().join(name);
            if let Some(bytes) = bytes {
                fs::write(&path, bytes).unwrap();
            }
            let text = load(&path, Encoding::Srgb, None).unwrap_err().to_string();
            text.replace(&format!("{}/", folder.path().display()), "")
        };
        assert_eq!(message("a.png", None), "a.png: there is no such file or folder");
        assert_eq!(
            message("a.webp", None),
            "a.webp: reading “.webp” is not supported; supported are .png, .jpg, .jpeg, .hdr, .exr"
        );
        assert!(message("empty.png", Some(b"")).contains("the file is empty"));
        assert!(message("text.exr", Some(b"hello")).contains("no PNG, JPEG, HDR or EXR"));
        let png = encode_png(&gradient(9, 9, 3)).unwrap();
        assert!(message("short.png", Some(&png[..png.len() / 2])).contains("damaged"));
        let exr = encode_exr(&gradient(9, 9, 3)).unwrap();
        assert!(message("short.exr", Some(&exr[..exr.len() / 2])).contains("damaged"));
        fs::create_dir(folder.path().join("folder.png")).unwrap();
        assert_eq!(message("folder.png", None), "folder.png: this is a folder, not a file");
        let text = save(Path::new("x.jpg"), &gradient(1, 1, 3)).unwrap_err().to_string();
        assert_eq!(text, "x.jpg: writing “.jpg” is not supported; supported are .png, .hdr, .exr");
    }

    #[test]
    fn damaged_files_never_panic() {
        let image = gradient(13, 11, 3);
        let mut jpeg = Vec::new();
        let encoder = jpeg_encoder::Encoder::new(&mut jpeg, 90);
        encoder.encode(&[0; 16 * 16 * 3], 16, 16, jpeg_encoder::ColorType::Rgb).unwrap();
        let files = [encode_png(&image), encode_hdr(&image), encode_exr(&image), Ok(jpeg)];
        let mut state = 12345u64;
        let mut next = |n: usize| {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (state >> 33) as usize % n
        };
        for file in files.map(Result::unwrap) {
            for round in 0..400 {
                let mut bytes = file.clone();
                for _ in 0..1 + round % 4 {
                    // Headers matter most.
                    let at = if next(2) == 0 { next(bytes.len().min(400)) } else { next(bytes.len()) };
                    bytes[at] = [0, 255, 127, 128, next(256) as u8][next(5)];
                }
                if round % 5 == 0 {
                    bytes.truncate(next(bytes.len()));
                }
                // Damage may go unnoticed; then the image is an image.
                if let Ok(decoded) = decode(&bytes, Encoding::AsFile, None) {
                    decoded.image.check().unwrap();
                }
            }
        }
    }
}
