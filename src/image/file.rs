//! Image files: PNG, JPEG, Radiance HDR and OpenEXR in; PNG, HDR and EXR out. Saving is atomic.

use std::io::Cursor;
use std::path::Path;

use exr::prelude::{self as openexr, ReadChannels, ReadLayers, WritableImage};
use image::{DynamicImage, ImageFormat, ImageReader};

pub use crate::files::{describe_io, read_bytes, write_atomically};

use super::filter::{linear_to_srgb, srgb_to_linear};
use super::{Image, ImageError, check_size};

/// How the integers of PNG and JPEG files are meant.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Encoding {
    /// Colours, sRGB-encoded: decoded to linear (but for alpha).
    Srgb,
    /// Numbers (roughness, normals, masks): only scaled to 0..1.
    Linear,
}

/// Extensions of the files that [`load`] reads.
pub const READABLE: [&str; 5] = ["png", "jpg", "jpeg", "hdr", "exr"];
/// Extensions of the files that [`save`] writes.
pub const WRITABLE: [&str; 3] = ["png", "hdr", "exr"];

/// Reads an image. Grey files have 1 channel, colours 3, with alpha 4; EXR files have theirs, in the order R, G, B, A and
/// then the others by name.
pub fn load(path: &Path, encoding: Encoding) -> Result<Image, ImageError> {
    let extension = extension(path);
    if !READABLE.contains(&extension.as_str()) {
        let path = path.display().to_string();
        return Err(ImageError::UnsupportedExtension { path, action: "reading", extension, extensions: &READABLE });
    }
    let failed = |message: String| ImageError::File { path: path.display().to_string(), message };
    let bytes = read_bytes(path).map_err(failed)?;
    decode(&bytes, encoding).map_err(|e| failed(e.to_string()))
}

/// Writes an image in the format of the extension: PNG in 8 bits, sRGB-encoded and clipped to 0..1; HDR and EXR linear.
pub fn save(path: &Path, image: &Image) -> Result<(), ImageError> {
    let extension = extension(path);
    let failed = |message: String| ImageError::File { path: path.display().to_string(), message };
    let bytes = match extension.as_str() {
        "png" => encode_png(image),
        "hdr" => encode_hdr(image),
        "exr" => encode_exr(image),
        _ => {
            let path = path.display().to_string();
            return Err(ImageError::UnsupportedExtension { path, action: "writing", extension, extensions: &WRITABLE });
        }
    }
    .map_err(|e| failed(e.to_string()))?;
    write_atomically(path, &bytes).map_err(|e| failed(describe_io(&e)))
}

/// Decodes the bytes of an image file, whose format its first bytes tell.
pub fn decode(bytes: &[u8], encoding: Encoding) -> Result<Image, ImageError> {
    if bytes.starts_with(&[0x76, 0x2f, 0x31, 0x01]) {
        return decode_exr(bytes);
    }
    let mut reader = ImageReader::new(Cursor::new(bytes))
        .with_guessed_format()
        .map_err(|e| ImageError::Argument(format!("the file cannot be read: {e}")))?;
    if !matches!(reader.format(), Some(ImageFormat::Png | ImageFormat::Jpeg | ImageFormat::Hdr)) {
        let empty = if bytes.is_empty() { "; the file is empty" } else { "" };
        return Err(ImageError::Argument(format!("this is no PNG, JPEG, HDR or EXR image{empty}")));
    }
    let mut limits = image::Limits::default();
    (limits.max_image_width, limits.max_image_height) = (Some(1 << 20), Some(1 << 20));
    limits.max_alloc = Some(4 << 30);
    reader.limits(limits);
    let decoded = reader.decode().map_err(|e| ImageError::Argument(format!("the image is damaged: {e}")))?;
    from_dynamic(decoded, encoding)
}

/// The PNG file of an image of 1 to 4 channels; two become red and green.
pub fn encode_png(image: &Image) -> Result<Vec<u8>, ImageError> {
    use image::ImageEncoder;
    image.check()?;
    let (width, height) = (image.width as u32, image.height as u32);
    let color = match image.channels {
        1 => image::ExtendedColorType::L8,
        2 | 3 => image::ExtendedColorType::Rgb8,
        4 => image::ExtendedColorType::Rgba8,
        n => {
            return Err(ImageError::Argument(format!(
                "a PNG file holds 1 to 4 channels, not {n}; save as .exr instead"
            )));
        }
    };
    // Clipped; not-a-number becomes black.
    let byte = |v: f32| (v.clamp(0.0, 1.0) * 255.0 + 0.5) as u8;
    let pixels: Vec<u8> = image
        .data
        .chunks_exact(image.channels)
        .flat_map(|pixel| {
            let alpha = pixel.get(3).map(|&a| byte(a));
            let blue = (pixel.len() == 2).then_some(0);
            let color = pixel.iter().take(3).map(|&v| byte(linear_to_srgb(v as f64) as f32));
            color.chain(blue).chain(alpha).collect::<Vec<_>>()
        })
        .collect();
    let mut bytes = Vec::new();
    let written = image::codecs::png::PngEncoder::new(&mut bytes).write_image(&pixels, width, height, color);
    written.map_err(|e| ImageError::Argument(format!("the PNG file cannot be made: {e}")))?;
    Ok(bytes)
}

/// The Radiance HDR file of an image; alpha is dropped, grey becomes a colour.
pub fn encode_hdr(image: &Image) -> Result<Vec<u8>, ImageError> {
    image.check()?;
    if !matches!(image.channels, 1 | 3 | 4) {
        let n = image.channels;
        return Err(ImageError::Argument(format!("an HDR file holds colours, not {n} channels; save as .exr instead")));
    }
    let at = |pixel: &[f32], c: usize| pixel[if pixel.len() == 1 { 0 } else { c }].max(0.0);
    let pixels: Vec<image::Rgb<f32>> =
        image.data.chunks_exact(image.channels).map(|p| image::Rgb([at(p, 0), at(p, 1), at(p, 2)])).collect();
    let mut bytes = Vec::new();
    let encoder = image::codecs::hdr::HdrEncoder::new(&mut bytes);
    let written = encoder.encode(&pixels, image.width, image.height);
    written.map_err(|e| ImageError::Argument(format!("the HDR file cannot be made: {e}")))?;
    Ok(bytes)
}

/// The OpenEXR file of an image, 32-bit floats: Y, RG, RGB, RGBA, or numbered channels.
pub fn encode_exr(image: &Image) -> Result<Vec<u8>, ImageError> {
    image.check()?;
    let name = |c: usize| match image.channels {
        1 => "Y".to_string(),
        2..=4 => ["R", "G", "B", "A"][c].to_string(),
        _ => format!("channel.{c:04}"),
    };
    let channels = (0..image.channels)
        .map(|c| {
            let samples = image.data.iter().skip(c).step_by(image.channels).copied().collect();
            openexr::AnyChannel::new(name(c).as_str(), openexr::FlatSamples::F32(samples))
        })
        .collect();
    let encoding = openexr::Encoding {
        compression: openexr::Compression::ZIP16,
        blocks: openexr::Blocks::ScanLines,
        line_order: openexr::LineOrder::Increasing,
    };
    let layer = openexr::Layer::new(
        (image.width, image.height),
        openexr::LayerAttributes::default(),
        encoding,
        openexr::AnyChannels::sort(channels),
    );
    let mut bytes = Cursor::new(Vec::new());
    let written = openexr::Image::from_layer(layer).write().non_parallel().to_buffered(&mut bytes);
    written.map_err(|e| ImageError::Argument(format!("the EXR file cannot be made: {e}")))?;
    Ok(bytes.into_inner())
}

/// The extension in lower case, "" if there is none.
fn extension(path: &Path) -> String {
    path.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default()
}

fn from_dynamic(decoded: DynamicImage, encoding: Encoding) -> Result<Image, ImageError> {
    let (width, height) = (decoded.width() as usize, decoded.height() as usize);
    let floating = matches!(decoded, DynamicImage::ImageRgb32F(_) | DynamicImage::ImageRgba32F(_));
    let color = decoded.color();
    let (channels, mut data) = match (color.has_color(), color.has_alpha()) {
        (false, false) => (1, decoded.into_luma16().into_raw().iter().map(|&v| v as f32 / 65535.0).collect::<Vec<_>>()),
        (_, false) => (3, decoded.into_rgb32f().into_raw()),
        (_, true) => (4, decoded.into_rgba32f().into_raw()),
    };
    check_size(width, height, channels)?;
    if encoding == Encoding::Srgb && !floating {
        let colors = data.chunks_exact_mut(channels).flat_map(|pixel| pixel.iter_mut().take(3));
        colors.for_each(|v| *v = srgb_to_linear(*v as f64) as f32);
    }
    Ok(Image { width, height, channels, data })
}

fn decode_exr(bytes: &[u8]) -> Result<Image, ImageError> {
    let damaged =
        |e: openexr::Error| ImageError::Argument(format!("the EXR image is damaged or of an unknown kind: {e}"));
    // The header first, so that no pixel is allocated for a size that cannot be meant.
    let meta = exr::meta::MetaData::read_from_buffered(Cursor::new(bytes), true).map_err(damaged)?;
    for header in &meta.headers {
        check_size(header.layer_size.0, header.layer_size.1, header.channels.list.len())?;
    }
    let image = openexr::read()
        .no_deep_data()
        .largest_resolution_level()
        .all_channels()
        .first_valid_layer()
        .all_attributes()
        .non_parallel()
        .from_buffered(Cursor::new(bytes))
        .map_err(damaged)?;
    let layer = image.layer_data;
    let (width, height) = (layer.size.0, layer.size.1);
    let mut channels: Vec<_> = layer.channel_data.list.iter().collect();
    let order = |name: &str| ["R", "G", "B", "A"].iter().position(|n| *n == name).unwrap_or(4);
    channels.sort_by_key(|c| (order(&c.name.to_string()), c.name.to_string()));
    let numbers = check_size(width, height, channels.len())?;
    let mut data = vec![0.0; numbers];
    for (c, channel) in channels.iter().enumerate() {
        let samples: Vec<f32> = channel.sample_data.values_as_f32().collect();
        if samples.len() != width * height {
            let name = &channel.name;
            return Err(ImageError::Argument(format!(
                "channel {name} of the EXR image is subsampled, which is not supported"
            )));
        }
        data.iter_mut().skip(c).step_by(channels.len()).zip(samples).for_each(|(to, from)| *to = from);
    }
    Ok(Image { width, height, channels: channels.len(), data })
}

#[cfg(test)]
mod tests {
    use std::fs;

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
            assert_eq!(decode(&encode_exr(&image).unwrap(), Encoding::Srgb).unwrap(), image, "{channels} channels");
        }
    }

    #[test]
    fn png_keeps_colours_within_a_step() {
        for channels in [1, 3, 4] {
            let image = gradient(9, 7, channels);
            let back = decode(&encode_png(&image).unwrap(), Encoding::Srgb).unwrap();
            assert_eq!((back.width, back.height, back.channels), (9, 7, channels));
            for (k, (a, b)) in image.data.iter().zip(&back.data).enumerate() {
                let encoded = |v: f32| if k % channels == 3 { v as f64 } else { linear_to_srgb(v as f64) };
                assert!((encoded(*a) - encoded(*b)).abs() <= 0.5 / 255.0 + 1e-5, "{a} {b}");
            }
        }
        let grey = Image { width: 1, height: 1, channels: 1, data: vec![0.21404] };
        let png = encode_png(&grey).unwrap();
        assert!((decode(&png, Encoding::Linear).unwrap().data[0] - 0.5).abs() < 0.003);
        let wild = Image { width: 4, height: 1, channels: 1, data: vec![f32::NAN, -3.0, f32::INFINITY, 1e9] };
        assert_eq!(decode(&encode_png(&wild).unwrap(), Encoding::Linear).unwrap().data, [0.0, 0.0, 1.0, 1.0]);
        assert!(encode_png(&gradient(2, 2, 5)).is_err());
    }

    #[test]
    fn png_of_16_bits_is_read_in_16_bits() {
        use image::ImageEncoder;
        let mut png = Vec::new();
        let samples: Vec<u8> = [1u16, 30000, 65535, 7].iter().flat_map(|v| v.to_ne_bytes()).collect();
        let encoder = image::codecs::png::PngEncoder::new(&mut png);
        encoder.write_image(&samples, 2, 2, image::ExtendedColorType::L16).unwrap();
        let image = decode(&png, Encoding::Linear).unwrap();
        assert_eq!(image.channels, 1);
        assert!((image.data[0] * 65535.0 - 1.0).abs() < 1e-3 && (image.data[1] * 65535.0 - 30000.0).abs() < 1e-2);
    }

    #[test]
    fn jpeg_and_hdr_are_read() {
        let mut jpeg = Vec::new();
        let pixels = image::RgbImage::from_pixel(16, 16, image::Rgb([188, 188, 188]));
        pixels.write_to(&mut Cursor::new(&mut jpeg), ImageFormat::Jpeg).unwrap();
        let image = decode(&jpeg, Encoding::Srgb).unwrap();
        assert!(image.data.iter().all(|v| (v - 0.5).abs() < 0.02));

        let mut bright = gradient(9, 3, 3);
        bright.data.iter_mut().for_each(|v| *v = *v * 50.0 + 1.0);
        let back = decode(&encode_hdr(&bright).unwrap(), Encoding::Srgb).unwrap();
        assert!(bright.data.iter().zip(&back.data).all(|(a, b)| (a - b).abs() < 0.01 * 51.0));
    }

    #[test]
    fn saving_is_whole_or_not_at_all() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.exr");
        save(&path, &gradient(3, 3, 3)).unwrap();
        assert_eq!(load(&path, Encoding::Srgb).unwrap(), gradient(3, 3, 3));
        save(&path, &gradient(2, 2, 3)).unwrap();
        assert_eq!(load(&path, Encoding::Srgb).unwrap(), gradient(2, 2, 3));
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
            let text = load(&path, Encoding::Srgb).unwrap_err().to_string();
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
        image::RgbImage::new(16, 16).write_to(&mut Cursor::new(&mut jpeg), ImageFormat::Jpeg).unwrap();
        let files = [encode_png(&image), encode_hdr(&image), encode_exr(&image), Ok(jpeg)];
        let mut state = 12345u64;
        let mut next = |n: usize| {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (state >> 33) as usize % n
        };
        for file in files.map(Result::unwrap) {
            for round in 0..3000 {
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
                if let Ok(image) = decode(&bytes, Encoding::Srgb) {
                    image.check().unwrap();
                }
            }
        }
    }
}
