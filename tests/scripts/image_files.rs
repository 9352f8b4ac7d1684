//! What image files say beside their pixels: windows and layers of EXR, orientation, gamma, exposure, inks. Every file is made here.

use std::fs;
use std::io::Cursor;
use std::path::Path;

use assert_cmd::Command;
use dscene::image::Image;
use dscene::image::file::{self, Decoded, Encoding, decode};
use dscene::tape::Tensor;
use exr::image::Encoding as Storage;
use exr::prelude::*;

fn read(bytes: &[u8]) -> Decoded {
    decode(bytes, Encoding::AsFile, None).unwrap()
}

fn near(found: &[f32], expected: &[f32], tolerance: f32) {
    assert_eq!(found.len(), expected.len(), "{found:?} {expected:?}");
    let fits = found.iter().zip(expected).all(|(a, b)| (a - b).abs() <= tolerance * b.abs().max(1.0));
    assert!(fits, "{found:?} is not {expected:?}");
}

// ---- OpenEXR -------------------------------------------------------------------------------------------------------

/// A part of constant channels: their names and values.
fn part(
    name: Option<&str>,
    size: (usize, usize),
    at: (i32, i32),
    channels: &[(&str, f32)],
) -> Layer<AnyChannels<FlatSamples>> {
    let list =
        channels.iter().map(|(name, value)| AnyChannel::new(*name, FlatSamples::F32(vec![*value; size.0 * size.1])));
    let mut attributes = LayerAttributes::default().with_position(Vec2(at.0, at.1));
    attributes.layer_name = name.map(Text::from);
    Layer::new(size, attributes, Storage::UNCOMPRESSED, AnyChannels::sort(list.collect()))
}

fn exr_file(display: Option<((i32, i32), (usize, usize))>, parts: Vec<Layer<AnyChannels<FlatSamples>>>) -> Vec<u8> {
    let window = match display {
        Some((position, size)) => IntegerBounds::new(Vec2(position.0, position.1), Vec2(size.0, size.1)),
        None => IntegerBounds::from_dimensions(parts[0].size),
    };
    let mut bytes = Cursor::new(Vec::new());
    let image = exr::image::Image::from_layers(ImageAttributes::new(window), parts);
    image.write().non_parallel().to_buffered(&mut bytes).unwrap();
    bytes.into_inner()
}

#[test]
fn pixels_that_are_no_numbers_are_told_once_a_file() {
    let file = |values: Vec<f32>| {
        let y = AnyChannel::new("Y", FlatSamples::F32(values));
        let channels = AnyChannels::sort([y].into_iter().collect());
        let layer = Layer::new((2, 2), LayerAttributes::default(), Storage::UNCOMPRESSED, channels);
        read(&exr_file(None, vec![layer])).notes
    };
    assert!(file(vec![1.0, 2.0, 3.0, 4.0]).is_empty());
    assert_eq!(file(vec![1.0, f32::NAN, 3.0, 4.0]), ["the image's pixel [1, 0] is NaN"]);
    let several = file(vec![1.0, 2.0, f32::INFINITY, f32::NAN]);
    assert_eq!(several, ["2 of the image's pixels are not finite; the first, [0, 1], is infinite"]);
}

#[test]
fn an_exr_image_is_its_display_window() {
    // Data of 2×2 pixels whose first stands at (1, 0) of a window that begins at (−3, −2).
    let data = AnyChannel::new("Y", FlatSamples::F32(vec![1.0, 2.0, 3.0, 4.0]));
    let attributes = LayerAttributes::default().with_position(Vec2(-2, -2));
    let layer = Layer::new((2, 2), attributes, Storage::UNCOMPRESSED, AnyChannels::sort([data].into_iter().collect()));
    let found = read(&exr_file(Some(((-3, -2), (4, 3))), vec![layer.clone()]));
    assert_eq!((found.image.width, found.image.height, found.image.channels), (4, 3, 1));
    assert_eq!(found.image.data, [0.0, 1.0, 2.0, 0.0, 0.0, 3.0, 4.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
    assert!(
        found.notes[0].contains("data for 2×2 pixels from (1, 0) of its display window of 4×3"),
        "{:?}",
        found.notes
    );
    // A window within the data crops them.
    let found = read(&exr_file(Some(((-1, -1), (1, 1))), vec![layer.clone()]));
    assert_eq!((found.image.width, found.image.height, &found.image.data[..]), (1, 1, &[4.0][..]));
    assert!(found.notes[0].contains("around its display window"), "{:?}", found.notes);
    // The same window wherever it lies is no news.
    let found = read(&exr_file(Some(((-2, -2), (2, 2))), vec![layer]));
    assert_eq!((found.image.data, found.notes), (vec![1.0, 2.0, 3.0, 4.0], vec![]));
}

#[test]
fn the_first_layer_with_colours_is_read_and_the_others_are_named() {
    let parts = vec![
        part(Some("VL.Depth"), (2, 1), (0, 0), &[("Z", 9.0)]),
        part(
            Some("VL"),
            (2, 1),
            (0, 0),
            &[
                ("VL.Combined.R", 0.1),
                ("VL.Combined.G", 0.2),
                ("VL.Combined.B", 0.3),
                ("VL.Combined.A", 0.4),
                ("VL.Mist.M", 0.5),
            ],
        ),
    ];
    let bytes = exr_file(None, parts);
    let found = read(&bytes);
    assert_eq!(found.image.channels, 4);
    assert_eq!(found.image.pixel(1, 0), [0.1, 0.2, 0.3, 0.4]);
    assert_eq!(found.notes.len(), 1);
    assert!(found.notes[0].contains("not “VL.Depth”, “VL.Mist”"), "{:?}", found.notes);
    let layer = |name: &str| decode(&bytes, Encoding::AsFile, Some(name)).map(|d| d.image.data);
    assert_eq!(layer("VL.Depth").unwrap(), [9.0, 9.0]);
    assert_eq!(layer("vl.mist").unwrap(), [0.5, 0.5]);
    assert_eq!(layer("VL.Combined.G").unwrap(), [0.2, 0.2]);
    let missing = layer("Normal").unwrap_err().to_string();
    assert_eq!(missing, "the EXR file has no layer “Normal”; it has “VL.Depth”, “VL.Combined”, “VL.Mist”");
}

#[test]
fn names_of_channels_say_what_they_are() {
    let one = |channels: &[(&str, f32)]| read(&exr_file(None, vec![part(None, (1, 1), (0, 0), channels)]));
    let lower = one(&[("r", 0.1), ("g", 0.2), ("b", 0.3), ("a", 0.4)]);
    assert_eq!((lower.image.data, lower.notes), (vec![0.1, 0.2, 0.3, 0.4], vec![]));
    let words = one(&[("Red", 0.1), ("Green", 0.2), ("Blue", 0.3)]);
    assert_eq!(words.image.data, [0.1, 0.2, 0.3]);
    // Depth is not alpha.
    let depth = one(&[("R", 0.1), ("G", 0.2), ("B", 0.3), ("Z", 7.0)]);
    assert_eq!((depth.image.channels, &depth.image.data[..]), (3, &[0.1, 0.2, 0.3][..]));
    assert!(depth.notes[0].contains("only R, G, B are read, not “Z”"), "{:?}", depth.notes);
    // Positions have a Y that is no luminance.
    let position = one(&[("P.X", 1.0), ("P.Y", 2.0), ("P.Z", 3.0)]);
    assert_eq!(position.image.data, [1.0, 2.0, 3.0]);
    // R = 0.5, G = 0.25, B = 1 as luminance and chroma.
    let y = 0.2126 * 0.5 + 0.7152 * 0.25 + 0.0722;
    let chroma = one(&[("Y", y), ("RY", (0.5 - y) / y), ("BY", (1.0 - y) / y)]);
    near(&chroma.image.data, &[0.5, 0.25, 1.0], 1e-5);
}

// ---- PNG and JPEG --------------------------------------------------------------------------------------------------

/// A grey 2×1 PNG with chunks of its own before the pixels.
fn png_file(depth: png::BitDepth, data: &[u8], set: impl FnOnce(&mut png::Info)) -> Vec<u8> {
    let mut info = png::Info::with_size(2, 1);
    info.bit_depth = depth;
    info.color_type = png::ColorType::Grayscale;
    set(&mut info);
    let mut bytes = Vec::new();
    let mut writer = png::Encoder::with_info(&mut bytes, info).unwrap().write_header().unwrap();
    writer.write_image_data(data).unwrap();
    writer.finish().unwrap();
    bytes
}

/// IEC 61966-2-1.
fn srgb(v: f32) -> f32 {
    if v <= 0.040_45 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) }
}

#[test]
fn png_is_srgb_at_any_depth_unless_it_or_the_call_says_otherwise() {
    use png::BitDepth::{Eight, Sixteen};
    let v = [0.2f32, 0.8];
    let eight: Vec<u8> = v.iter().map(|v| (v * 255.0) as u8).collect();
    let sixteen: Vec<u8> = v.iter().flat_map(|v| ((v * 65535.0) as u16).to_be_bytes()).collect();
    for (depth, data) in [(Eight, &eight), (Sixteen, &sixteen)] {
        let plain = png_file(depth, data, |_| {});
        near(&read(&plain).image.data, &v.map(srgb), 1e-4);
        near(&decode(&plain, Encoding::Linear, None).unwrap().image.data, &v, 1e-4);
        let gamma = |g: f32| png_file(depth, data, |info| info.source_gamma = Some(png::ScaledFloat::new(g)));
        near(&read(&gamma(1.0)).image.data, &v, 1e-4);
        near(&read(&gamma(0.5)).image.data, &v.map(|v| v * v), 1e-4);
        near(&decode(&gamma(1.0), Encoding::Srgb, None).unwrap().image.data, &v.map(srgb), 1e-4);
        // The sRGB chunk wins.
        let both = png_file(depth, data, |info| {
            info.srgb = Some(png::SrgbRenderingIntent::Perceptual);
            info.source_gamma = Some(png::ScaledFloat::new(1.0));
        });
        near(&read(&both).image.data, &v.map(srgb), 1e-4);
    }
    let profiled = png_file(Eight, &eight, |info| info.icc_profile = Some(b"Display P3".to_vec().into()));
    assert!(read(&profiled).notes[0].contains("colour profile"));
}

/// EXIF data that hold an orientation and nothing else: a TIFF header and one directory entry.
fn exif(orientation: u8) -> Vec<u8> {
    let mut bytes = b"II*\0\x08\0\0\0\x01\0\x12\x01\x03\0\x01\0\0\0".to_vec();
    bytes.extend([orientation, 0, 0, 0, 0, 0, 0, 0]);
    bytes
}

#[test]
fn photos_are_turned_upright() {
    // Three by two blocks of 16 pixels: what stands where once the file is turned.
    let (a, b, c, d, e, f) = (20u8, 60, 100, 140, 180, 220);
    let upright: [(u8, &[&[u8]]); 8] = [
        (1, &[&[a, b, c], &[d, e, f]]),
        (2, &[&[c, b, a], &[f, e, d]]),
        (3, &[&[f, e, d], &[c, b, a]]),
        (4, &[&[d, e, f], &[a, b, c]]),
        (5, &[&[a, d], &[b, e], &[c, f]]),
        (6, &[&[d, a], &[e, b], &[f, c]]),
        (7, &[&[f, c], &[e, b], &[d, a]]),
        (8, &[&[c, f], &[b, e], &[a, d]]),
    ];
    let stored = [[a, b, c], [d, e, f]];
    for (orientation, rows) in upright {
        let pixels: Vec<u8> = (0..32 * 48).map(|i| stored[i / 48 / 16][i % 48 / 16]).collect();
        let mut jpeg = Vec::new();
        let mut encoder = jpeg_encoder::Encoder::new(&mut jpeg, 100);
        encoder.add_exif_metadata(&exif(orientation)).unwrap();
        encoder.encode(&pixels, 48, 32, jpeg_encoder::ColorType::Luma).unwrap();
        let mut png = Vec::new();
        let mut info = png::Info::with_size(48, 32);
        info.exif_metadata = Some(exif(orientation).into());
        let mut writer = png::Encoder::with_info(&mut png, info).unwrap().write_header().unwrap();
        writer.write_image_data(&pixels).unwrap();
        writer.finish().unwrap();
        for (name, bytes) in [("JPEG", jpeg), ("PNG", png)] {
            let image = decode(&bytes, Encoding::Linear, None).unwrap().image;
            assert_eq!((image.height, image.width), (16 * rows.len(), 16 * rows[0].len()), "{name} {orientation}");
            for (y, row) in rows.iter().enumerate() {
                for (x, value) in row.iter().enumerate() {
                    let found = image.pixel(16 * x + 8, 16 * y + 8)[0] * 255.0;
                    assert!((found - f32::from(*value)).abs() < 3.0, "{name} {orientation}: {found} at ({x}, {y})");
                }
            }
        }
    }
}

/// Without a segment of that marker.
fn without_segment(jpeg: &[u8], marker: u8) -> Vec<u8> {
    let (mut at, mut out) = (2, jpeg[..2].to_vec());
    while jpeg[at + 1] != 0xda {
        let end = at + 2 + usize::from(u16::from_be_bytes([jpeg[at + 2], jpeg[at + 3]]));
        if jpeg[at + 1] != marker {
            out.extend(&jpeg[at..end]);
        }
        at = end;
    }
    out.extend(&jpeg[at..]);
    out
}

#[test]
fn inks_are_converted_with_and_without_adobes_marker() {
    // Cyan 0.8, magenta 0.2, no yellow, black 0.5, everywhere.
    let inks = [0.8f32, 0.2, 0.0, 0.5];
    let expected = [0.2f32 * 0.5, 0.8 * 0.5, 0.5].map(srgb);
    let encoded = |pixel: [u8; 4]| {
        let mut jpeg = Vec::new();
        let encoder = jpeg_encoder::Encoder::new(&mut jpeg, 100);
        encoder.encode(&pixel.repeat(16 * 16), 16, 16, jpeg_encoder::ColorType::Cmyk).unwrap();
        jpeg
    };
    let raw = |jpeg: &[u8]| decode(jpeg, Encoding::AsFile, None).unwrap();
    let marked = encoded(inks.map(|v| (v * 255.0) as u8));
    assert!(
        marked.windows(5).any(|w| w == b"Adobe"),
        "this encoder writes the marker, and stores what inks leave of the light"
    );
    near(raw(&marked).image.pixel(3, 3), &expected, 0.02);
    let plain = without_segment(&encoded(inks.map(|v| 255 - (v * 255.0) as u8)), 0xee);
    assert!(!plain.windows(5).any(|w| w == b"Adobe"));
    near(raw(&plain).image.pixel(3, 3), &expected, 0.02);
    assert!(raw(&plain).notes[0].contains("CMYK"), "{:?}", raw(&plain).notes);
}

#[test]
fn a_photo_that_ends_early_says_so() {
    let pixels: Vec<u8> = (0..64 * 64 * 3).map(|i| (i * 7 % 251) as u8).collect();
    let mut jpeg = Vec::new();
    jpeg_encoder::Encoder::new(&mut jpeg, 90).encode(&pixels, 64, 64, jpeg_encoder::ColorType::Rgb).unwrap();
    assert_eq!(read(&jpeg).notes, Vec::<String>::new());
    match decode(&jpeg[..jpeg.len() / 2], Encoding::AsFile, None) {
        Ok(found) => assert!(found.notes[0].contains("ends early"), "{:?}", found.notes),
        Err(e) => assert!(e.to_string().contains("damaged"), "{e}"),
    }
}

// ---- Radiance HDR --------------------------------------------------------------------------------------------------

#[test]
fn hdr_headers_are_obeyed() {
    // Flat pixels of 3×2: their reds are 1 to 6, with an exponent of 2^8 · 2^−8.
    let pixels: Vec<u8> = (1..=6).flat_map(|i| [i, 2 * i, 0, 136]).collect();
    let file = |header: &str, resolution: &str| [format!("{header}\n\n{resolution}\n").as_bytes(), &pixels].concat();
    let reds = |bytes: &[u8]| -> Vec<f32> {
        let image = read(bytes).image;
        assert!(image.data.chunks_exact(3).all(|p| p[1] == 2.0 * p[0] && p[2] == 0.0));
        image.data.iter().step_by(3).copied().collect()
    };
    for magic in ["#?RADIANCE", "#?RGBE"] {
        assert_eq!(reds(&file(magic, "-Y 2 +X 3")), [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]);
    }
    for (resolution, expected) in [
        ("+Y 2 +X 3", [4.0, 5.0, 6.0, 1.0, 2.0, 3.0]),
        ("-Y 2 -X 3", [3.0, 2.0, 1.0, 6.0, 5.0, 4.0]),
        ("+Y 2 -X 3", [6.0, 5.0, 4.0, 3.0, 2.0, 1.0]),
        // Three columns of two pixels each.
        ("+X 3 -Y 2", [1.0, 3.0, 5.0, 2.0, 4.0, 6.0]),
        ("+X 3 +Y 2", [2.0, 4.0, 6.0, 1.0, 3.0, 5.0]),
        ("-X 3 -Y 2", [5.0, 3.0, 1.0, 6.0, 4.0, 2.0]),
        ("-X 3 +Y 2", [6.0, 4.0, 2.0, 5.0, 3.0, 1.0]),
    ] {
        let found = read(&file("#?RADIANCE", resolution)).image;
        assert_eq!((found.width, found.height), (3, 2), "{resolution}");
        assert_eq!(reds(&file("#?RADIANCE", resolution)), expected, "{resolution}");
    }
    let exposed = read(&file("#?RADIANCE\nEXPOSURE=2\nEXPOSURE= 4\nCOLORCORR=0.5 1 1", "-Y 2 +X 3")).image;
    assert_eq!(exposed.pixel(0, 0), [1.0 / 4.0, 2.0 / 8.0, 0.0]);
    let said = read(&file("#?RADIANCE\nPIXASPECT=2\nPRIMARIES=0.7 0.3 0.2 0.7 0.1 0.1 0.3 0.3", "-Y 2 +X 3")).notes;
    assert!(said[0].contains("PIXASPECT") && said[1].contains("PRIMARIES"), "{said:?}");
    for wrong in ["#?RADIANCE\nEXPOSURE=0", "#?RADIANCE\nFORMAT=64-bit"] {
        assert!(decode(&file(wrong, "-Y 2 +X 3"), Encoding::AsFile, None).is_err(), "{wrong}");
    }
    // White of equal energy in XYZ: Y stays, and the colour is that of CIE's white in Rec. 709.
    let white = [b"#?RADIANCE\nFORMAT=32-bit_rle_xyze\n\n-Y 1 +X 1\n".as_slice(), &[128, 128, 128, 129]].concat();
    near(&read(&white).image.data, &[1.2048, 0.9483, 0.9087], 1e-3);
}

// ---- as users see it -----------------------------------------------------------------------------------------------

fn dsl(folder: &Path, line: &[&str]) -> (i32, String) {
    let output = Command::cargo_bin("dsl").unwrap().current_dir(folder).args(line).output().unwrap();
    let text = String::from_utf8_lossy(&output.stdout).into_owned() + &String::from_utf8_lossy(&output.stderr);
    (output.status.code().unwrap_or(-1), text)
}

#[test]
fn what_is_not_done_is_said_once_at_the_call() {
    let folder = tempfile::tempdir().unwrap();
    let layers = part(None, (2, 2), (0, 0), &[("R", 0.1), ("G", 0.2), ("B", 0.3), ("Z", 7.0)]);
    fs::write(folder.path().join("a.exr"), exr_file(None, vec![layers])).unwrap();
    let script = "let photo = load_image(\"a.exr\")\nlet depth = load_image(\"a.exr\", layer: \"Z\")\n\
                  print mean(photo)\nprint mean(photo.r)\nprint mean(depth)\n";
    fs::write(folder.path().join("s.dscene"), script).unwrap();
    let (code, text) = dsl(folder.path(), &["run", "s.dscene", "--out", "o", "--force"]);
    assert_eq!(code, 0, "{text}");
    assert_eq!(text.matches("of the EXR file's channels only R, G, B are read, not “Z”").count(), 1, "{text}");
    assert!(text.contains("s.dscene:1:"), "{text}");
    assert!(text.lines().any(|l| l.trim() == "7"), "{text}");
}

#[test]
fn sizes_are_known_before_memory_is_taken() {
    let folder = tempfile::tempdir().unwrap();
    let put = |name: &str, bytes: &[u8]| fs::write(folder.path().join(name), bytes).unwrap();
    // A header alone promises 12,000 × 12,000 pixels; no byte of them is read.
    let mut png = png_file(png::BitDepth::Eight, &[0, 0], |_| {});
    png[16..24].copy_from_slice(&[0, 0, 0x2e, 0xe0, 0, 0, 0x2e, 0xe0]);
    let crc = crc(&png[12..29]);
    png[29..33].copy_from_slice(&crc.to_be_bytes());
    put("a.png", &png);
    put("a.hdr", b"#?RADIANCE\n\n-Y 12000 +X 12000\n");
    let mut exr = exr_file(Some(((0, 0), (2, 2))), vec![part(None, (2, 2), (0, 0), &[("Y", 1.0)])]);
    for name in [&b"dataWindow\0box2i\0"[..], b"displayWindow\0box2i\0"] {
        let at = exr.windows(name.len()).position(|w| w == name).unwrap() + name.len() + 4 + 8;
        exr[at..at + 8].copy_from_slice(&[0xdf, 0x2e, 0, 0, 0xdf, 0x2e, 0, 0]);
    }
    let name = b"chunkCount\0int\0";
    if let Some(at) = exr.windows(name.len()).position(|w| w == name) {
        exr[at + name.len() + 4..][..4].copy_from_slice(&12000u32.to_le_bytes());
    }
    put("a.exr", &exr);
    for name in ["a.png", "a.hdr", "a.exr"] {
        fs::write(folder.path().join("s.dscene"), format!("print load_image(\"{name}\")\n")).unwrap();
        let (code, text) = dsl(folder.path(), &["run", "s.dscene", "--memory", "200MB", "--out", "o", "--force"]);
        assert_eq!(code, 1, "{name}: {text}");
        assert!(text.contains("dscene::run::memory") && text.contains("--memory 16GB"), "{name}: {text}");
        assert!(text.contains("s.dscene:1:18"), "{name}: {text}");
    }
}

/// A texture that nothing is computed with is held in bytes, by the value and by the renderer together; on the tape a number takes eight.
#[test]
fn textures_of_files_take_a_byte_a_number() {
    let folder = tempfile::tempdir().unwrap();
    let mut image = Image::new(2048, 2048, 3);
    image.data.iter_mut().enumerate().for_each(|(i, x)| *x = (i / 5 % 256) as f32 / 255.0);
    file::save(&folder.path().join("big.png"), &image).unwrap();
    let script = |of: &str| {
        format!(
            "camera eye {{ position: [0, 2, 0], look_at: [0, 0, 0], up: [0, 0, 1], film: [16, 16] }}\n\
             light sky = constant(radiance: 1)\nlet paint = texture(\"big.png\")\n\
             shape ground {{ mesh: rectangle(width: 9, depth: 9), material: diffuse(reflectance: {of}) }}\n\
             let seen = mean(render(eye, spp: 4))\nexpect 0.1 < seen\nexpect seen < 0.9\n"
        )
    };
    // 50 MB are those of the picture as it is read.
    for (of, code) in [("paint", 0), ("texture(0.9 * paint.texels)", 1)] {
        fs::write(folder.path().join("s.dscene"), script(of)).unwrap();
        let memory = ["run", "s.dscene", "--memory", "170MB", "--out", "o", "--force"];
        let (found, text) = dsl(folder.path(), &memory);
        assert_eq!(found, code, "{of}: {text}");
        assert_eq!(text.contains("dscene::run::memory"), code == 1, "{of}: {text}");
    }
}

/// The check of a PNG chunk.
fn crc(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(u32::MAX, |crc, &b| {
        (0..8).fold(crc ^ u32::from(b), |c, _| if c & 1 == 1 { 0xedb8_8320 ^ (c >> 1) } else { c >> 1 })
    })
}

#[test]
fn an_image_is_what_was_saved() {
    let mut image = Image::new(3, 2, 3);
    image.data.iter_mut().enumerate().for_each(|(i, v)| *v = i as f32 / 18.0);
    let folder = tempfile::tempdir().unwrap();
    for (name, tolerance) in [("a.exr", 0.0), ("a.hdr", 0.01), ("a.png", 0.01)] {
        let path = folder.path().join(name);
        dscene::image::file::save(&path, &image).unwrap();
        near(&read(&fs::read(&path).unwrap()).image.data, &image.data, tolerance);
    }
}

/// Every line is one save, with what is told of it; nothing is told of the others.
#[test]
fn what_a_file_does_not_hold_of_an_image_is_told_when_it_is_saved() {
    let folder = tempfile::tempdir().unwrap();
    let colours = "image([[[0.1, 0.5, 1, 0.5], [0.25, 1, 0, 0]]])";
    let rows: &[(&str, &[&str])] = &[
        (
            &format!("{colours} to \"i4.hdr\""),
            &["`i4.hdr` does not hold the channels of the image", "(alpha) is left out"],
        ),
        (&format!("{colours} to \"i4.exr\""), &[]),
        (&format!("{colours} to \"i4.png\""), &[]),
        ("image([[[0.1, 0.5], [0.2, 0]]]) to \"i2.png\"", &["`i2.png` does not hold the channels", "a blue of 0"]),
        ("image([[[0.1, 0.5], [0.2, 0]]]) to \"i2.exr\"", &[]),
        (
            "image([[1, 1e39, 1e-46], [70000, 1 / 3, -1e40]]) to \"big.exr\"",
            &[
                "2 pixels of `big.exr` are beyond its numbers; the first, [1, 0], is 1e39, and infinite in the file",
                "its numbers end at 3.4e38",
            ],
        ),
        ("image([[1, 1 / 0, 0.5]]) to \"infinite.exr\"", &[]),
        ("image([[0, 1e-46]]) to \"small.exr\"", &["the pixel [1, 0] of `small.exr` is 1e-46, and 0 in the file"]),
        (
            "image([[1e39, 1, 1]]) to \"big.hdr\"",
            &["the pixel [0, 0] of `big.hdr` is 1e39, and the brightest that there is in the file", "end at 1.6e38"],
        ),
        (
            "image([[1e-39, 1e-40]]) to \"small.hdr\"",
            &["2 pixels of `small.hdr`", "[0, 0], is 1e-39, and 0 in the file"],
        ),
        // Beside what is so much brighter nobody sees it.
        ("image([[1e-39, 1, 1]]) to \"dark.hdr\"", &[]),
        ("image([[0.5, 0]]) to \"grey.hdr\"", &[]),
    ];
    for (saved, told) in rows {
        fs::write(folder.path().join("s.dscene"), format!("save {saved}\n")).unwrap();
        let (code, text) = dsl(folder.path(), &["run", "s.dscene", "--out", "o", "--force"]);
        let text = text.split_whitespace().filter(|w| *w != "│").collect::<Vec<&str>>().join(" ");
        assert_eq!((code, text.matches("dscene::").count()), (0, usize::from(!told.is_empty())), "{saved}: {text}");
        for words in *told {
            assert!(text.contains(words), "{saved}: {text}");
        }
    }
    // Where the number of channels is known, the checker refuses it.
    let array = Tensor::new(vec![1, 1, 2], vec![0.5, 1.0]);
    fs::write(folder.path().join("a.npy"), dscene::data::npy::encode(&array)).unwrap();
    for (script, says) in [
        ("save image([[[0.1, 0.5], [0.2, 0]]]) to \"a.hdr\"\n", "cannot be saved as `.hdr`"),
        ("save [[[0.1, 0.5], [0.2, 0]]] to \"a.hdr\"\n", "cannot be saved as `.hdr`"),
        (
            "save load_array(\"a.npy\") to \"a.hdr\"\n",
            "an HDR file holds colours, not 2 channels … help: `.exr` holds images of any number of channels",
        ),
        (
            "save [image([[1]]), resize(image([[1]]), width: 1 + sum(noise([1]) ^ 0), height: 1)] to \"a.apng\"\n",
            "have one size, … help: `resize(image, width: …, height: …)` brings images to one size",
        ),
    ] {
        fs::write(folder.path().join("s.dscene"), script).unwrap();
        let (code, text) = dsl(folder.path(), &["run", "s.dscene", "--out", "o", "--force"]);
        let text = text.split_whitespace().filter(|w| *w != "│").collect::<Vec<&str>>().join(" ");
        assert!(code == 1 && says.split(" … ").all(|words| text.contains(words)), "{script}: {text}");
    }
}

/// In a list of files one sees which is meant.
#[test]
fn notes_of_images_and_data_name_their_files() {
    let folder = tempfile::tempdir().unwrap();
    let put = |name: &str, bytes: &[u8]| fs::write(folder.path().join(name), bytes).unwrap();
    let plain = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\nPRIMARIES=0 0 0 0 0 0 0 0\n\n-Y 1 +X 1\n\x80\x80\x80\x80";
    put("one.hdr", plain);
    put("two.hdr", plain);
    let animated = folder.path().join("moving.png");
    let frames = [0.0, 1.0].map(|x| Image { width: 1, height: 1, channels: 1, data: vec![x] });
    file::save_animation(&animated, &frames).unwrap();
    let infinite = Image { width: 1, height: 1, channels: 1, data: vec![f32::INFINITY] };
    file::save(&folder.path().join("far.exr"), &infinite).unwrap();
    put("ids.json", b"[9007199254740993]");
    put("ids.csv", b"id\n9007199254740993\n");
    let mut array = dscene::data::npy::encode(&Tensor::vector(vec![1.0, 2.0]));
    array.push(7);
    put("more.npy", &array);
    put("twice.json", b"{\"a\": 1, \"a\": 2}");
    put("none.obj", b"v 0 0 0\n");
    let run = |script: &str| {
        fs::write(folder.path().join("s.dscene"), script).unwrap();
        let (code, text) = dsl(folder.path(), &["run", "s.dscene", "--out", "o", "--force"]);
        (code, text.split_whitespace().filter(|w| *w != "│").collect::<Vec<&str>>().join(" "))
    };
    let (code, text) =
        run("print [mean(load_image(f)) for f in [\"one.hdr\", \"two.hdr\", \"moving.png\", \"far.exr\"]]\n\
         print load_json(\"ids.json\"), load_table(\"ids.csv\"), load_array(\"more.npy\")\n");
    assert_eq!(code, 0, "{text}");
    let rounded = "an integer beyond 2^53 is rounded: 9007199254740993";
    for words in [
        "one.hdr: the HDR file has PRIMARIES",
        "two.hdr: the HDR file has PRIMARIES",
        "moving.png: the PNG file is animated",
        "far.exr: the image's pixel [0, 0] is infinite",
        &format!("ids.json: {rounded} in line 1, taken as 9007199254740992"),
        &format!("ids.csv: {rounded} in row 2, taken as 9007199254740992"),
        "more.npy: 1 bytes after the numbers that its shape promises are left out",
    ] {
        assert!(text.contains(words), "{words}: {text}");
    }
    for (script, says) in [
        ("print load_json(\"twice.json\")\n", "twice.json: two fields of an object are named “a” at line 1"),
        ("print load(\"none.obj\")\n", "none.obj: the file has no triangles"),
    ] {
        let (code, text) = run(script);
        assert!(code == 1 && text.contains(says), "{script}: {text}");
    }
}
