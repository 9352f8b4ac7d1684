//! Values as files: images, meshes, numbers, and any value as JSON or text.

use std::path::Path;

use super::show::significant;
use crate::check::types::Ty;
use crate::data::{npy, table};
use crate::diag::Diagnostic;
use crate::eval::{self, Names, SceneFile};
use crate::files::write_atomically;
use crate::image::file::{BRIGHTEST, Clipped, NotNumbers, negatives};
use crate::image::{Image, ImageError};
use crate::memory;
use crate::mesh::Mesh;
use crate::natives::value::Value;
use crate::stop;
use crate::tape::Tensor;

/// Why a value could not be saved.
pub enum SaveError {
    Io(std::io::Error),
    Other { message: String, help: String },
}

/// Writes a value by its file's extension: images as PNG, EXR or HDR, lists of them as animated PNG, meshes as OBJ, PLY or GLB, scenes and
/// their parts as GLB; anything as JSON or text.
/// What the file does not hold is told.
pub fn save_value(value: &Value, ty: &Ty, path: &Path) -> Result<Vec<Lost>, SaveError> {
    save_named(value, ty, Names::default(), path)
}

/// As [`save_value`], with names for the parts of a scene.
pub fn save_named(value: &Value, ty: &Ty, names: Names, path: &Path) -> Result<Vec<Lost>, SaveError> {
    let (value, ty, path) = (value.clone(), ty.clone(), path.to_path_buf());
    // To compress a large image takes seconds.
    stop::apart(move || write_value(&value, &ty, &names, &path))
}

/// What a file does not hold of what was saved to it.
pub enum Lost {
    /// Colours beyond black and white.
    Colors(Clipped),
    /// Negative colours in an HDR file: of how many pixels, and the least.
    Negative(usize, f32),
    /// Pixels that are no numbers.
    NotNumbers(NotNumbers),
    /// Numbers beyond those of the file's format.
    Beyond(Beyond),
    /// That the file has other channels than the image, in a sentence.
    Channels(&'static str),
    /// What glTF does not have, in sentences.
    OfScene(Vec<String>),
}

/// Pixels whose numbers are too large for a file, or all too small.
pub struct Beyond {
    /// How many there are.
    count: usize,
    /// Column and row of the first, from the top left.
    first: [usize; 2],
    /// Its number.
    value: f64,
    /// The largest number of the file's format.
    most: f64,
    /// What the largest become there.
    becomes: &'static str,
}

impl Beyond {
    /// Of an image in a file whose format ends at `most`. Numbers that are too small for it are rounded to zero, which is told only where
    /// something as small is all that the image has beside: elsewhere nobody would see it.
    fn of(value: &Value, extension: &str) -> Option<Beyond> {
        let tensor = value.var()?.value();
        let (width, channels) = match tensor.shape[..] {
            [_, width] => (width, 1),
            [_, width, channels] => (width, channels),
            _ => return None,
        };
        let is_hdr = extension == "hdr";
        // EXR files hold what is infinite, and HDR files nothing negative, which is told by itself.
        let (most, becomes) = if is_hdr {
            (f64::from(BRIGHTEST), "the brightest that there is")
        } else {
            (f64::from(f32::MAX), "infinite")
        };
        let size = |x: f64| if is_hdr { x.max(0.0) } else { x.abs() };
        let is_zero = |x: f64| if is_hdr { x < f64::from(f32::MIN_POSITIVE) } else { x as f32 == 0.0 };
        let largest = tensor.data.iter().map(|x| size(*x)).fold(0.0, f64::max);
        let seen = largest * f64::from(f32::EPSILON);
        let is_beyond = |x: &f64| {
            let too_large = size(*x) > most && (is_hdr || x.is_finite());
            too_large || (size(*x) > seen && is_zero(size(*x)))
        };
        let mut pixels = tensor.data.chunks_exact(channels.max(1)).enumerate();
        let (at, value) = pixels.find_map(|(i, pixel)| Some((i, *pixel.iter().find(|x| is_beyond(x))?)))?;
        let count = 1 + pixels.filter(|(_, pixel)| pixel.iter().any(is_beyond)).count();
        Some(Beyond { count, first: [at % width, at / width], value, most, becomes })
    }

    fn told(&self, name: &str) -> String {
        let Beyond { count, first: [x, y], value, .. } = self;
        let shown = significant(*value, 3);
        let becomes = match value.abs() > self.most {
            true => format!("{} in the file: its numbers end at {}", self.becomes, significant(self.most, 2)),
            false => "0 in the file: it holds no numbers as small".to_owned(),
        };
        match count {
            1 => format!("the pixel [{x}, {y}] of `{name}` is {shown}, and {becomes}"),
            n => format!(
                "{n} pixels of `{name}` are beyond its numbers; the first, [{x}, {y}], is {shown}, and {becomes}"
            ),
        }
    }
}

impl Lost {
    /// A word for the kind, of which a place tells once.
    pub fn kind(&self) -> &'static str {
        match self {
            Lost::Colors(_) | Lost::Negative(..) => "clipped",
            Lost::Beyond(_) => "beyond",
            Lost::Channels(_) => "channels",
            Lost::NotNumbers(_) => "not numbers",
            Lost::OfScene(_) => "simplified",
        }
    }

    /// What stands under the expression that was saved.
    pub fn label(&self) -> &'static str {
        match self {
            Lost::Colors(_) => "goes beyond black or white",
            Lost::Negative(..) => "is negative in places",
            Lost::NotNumbers(_) => "is NaN in places",
            Lost::Beyond(_) => "goes beyond the numbers of the file",
            Lost::Channels(_) | Lost::OfScene(_) => "saved here",
        }
    }
}

fn write_value(value: &Value, ty: &Ty, names: &Names, path: &Path) -> Result<Vec<Lost>, SaveError> {
    let extension = path.extension().and_then(|e| e.to_str()).unwrap_or("").to_ascii_lowercase();
    let written = match extension.as_str() {
        "json" => {
            // What a value shares with itself is written out each time.
            memory::ask(eval::json_size(value, memory::limit())).map_err(|shortage| SaveError::Other {
                message: format!("too large for a `.json` file: {shortage}"),
                help: "save its parts by themselves".to_owned(),
            })?;
            let text = format!("{}\n", eval::to_json(value));
            write_atomically(path, text.as_bytes()).map_err(SaveError::Io)
        }
        "npy" => {
            let bytes = match (value.var(), truths(value)) {
                (Some(array), _) => npy::encode(array.value()),
                (None, Some(truths)) => npy::encode_truths(&truths),
                (None, None) => {
                    return Err(SaveError::Other {
                        message: format!("a .npy file holds an array of numbers, this is {}", value.kind()),
                        help: "give the file the extension .json, which holds any value".to_owned(),
                    });
                }
            };
            write_atomically(path, &bytes).map_err(SaveError::Io)
        }
        "csv" => write_atomically(path, &table_of(value)?).map_err(SaveError::Io),
        "txt" => write_atomically(path, format!("{}\n", eval::show(value, ty)).as_bytes()).map_err(SaveError::Io),
        "png" | "exr" | "hdr" => {
            let image = image_of(value).ok_or_else(|| SaveError::Other {
                message: format!("an image file holds an image, this is {}", value.kind()),
                help: "save a `render(…)`, or give the file the extension .json".to_owned(),
            })?;
            crate::image::file::save(path, &image).map_err(|e| unwritten(e, path))?;
            let beyond = Beyond::of(value, &extension).map(Lost::Beyond);
            return Ok(match extension.as_str() {
                "png" => lost_of(&image),
                "hdr" => {
                    let alpha = "an HDR file holds colours alone: the fourth channel (alpha) is left out";
                    let alpha = (image.channels == 4).then_some(Lost::Channels(alpha));
                    let negative = negatives(&image).map(|(count, least)| Lost::Negative(count, least));
                    let broken = NotNumbers::of(&image).map(Lost::NotNumbers);
                    broken.into_iter().chain(negative).chain(beyond).chain(alpha).collect()
                }
                _ => beyond.into_iter().collect(),
            });
        }
        "apng" => {
            let frames = match value {
                Value::List(items) => items.iter().map(image_of).collect::<Option<Vec<Image>>>(),
                _ => None,
            };
            let frames = frames.filter(|frames| !frames.is_empty()).ok_or_else(|| SaveError::Other {
                message: format!("an animation is a list of images, this is {}", value.kind()),
                help: "write `save [a, b] to …`, or `save [render(view) for view in views] to …`".to_owned(),
            })?;
            crate::image::file::save_animation(path, &frames).map_err(|e| unwritten(e, path))?;
            return Ok(frames.iter().map(lost_of).find(|lost| !lost.is_empty()).unwrap_or_default());
        }
        "glb" if !matches!(value, Value::Mesh(_)) => return write_scene(value, names, path),
        "obj" | "ply" | "glb" => {
            let Value::Mesh(mesh) = value else {
                return Err(SaveError::Other {
                    message: format!("a mesh file holds a mesh, this is {}", value.kind()),
                    help: "save for instance `ball.mesh`, or give the file another extension".to_owned(),
                });
            };
            let mesh = mesh.to_mesh();
            readable(&mesh)?;
            let bytes = crate::mesh::save::encode(&mesh, &extension).unwrap_or_default();
            write_atomically(path, &bytes).map_err(SaveError::Io)
        }
        other => Err(SaveError::Other {
            message: if other.is_empty() {
                format!("`{}` has no extension, which would tell the format", path.display())
            } else {
                format!("`.{other}` is not a format that can be written")
            },
            help: "use .png, .exr or .hdr for images, .apng for animations, .obj, .ply or .glb for meshes, .glb for scenes, .npy or .csv for numbers, .json or .txt for any value".to_owned(),
        }),
    };
    written.map(|()| Vec::new())
}

/// What a PNG file does not hold of an image.
fn lost_of(image: &Image) -> Vec<Lost> {
    let broken = NotNumbers::of(image).map(Lost::NotNumbers);
    let blue = "a PNG file has no two channels: they are red and green, beside a blue of 0";
    let blue = (image.channels == 2).then_some(Lost::Channels(blue));
    broken.into_iter().chain(Clipped::of(image).map(Lost::Colors)).chain(blue).collect()
}

/// A mesh, shape, light, camera, scene or list of such.
fn write_scene(value: &Value, names: &Names, path: &Path) -> Result<Vec<Lost>, SaveError> {
    let Some(SceneFile { scene, cameras, mut told }) = eval::scene_file(value, names) else {
        return Err(SaveError::Other {
            message: format!("a .glb file holds meshes, shapes, lights and cameras, this is {}", value.kind()),
            help: "save for instance `scene`, `[scene, eye]` or `ball.mesh`, or give the file another extension"
                .to_owned(),
        });
    };
    if scene.parts.is_empty() && scene.lights.is_empty() && cameras.is_empty() {
        return Err(SaveError::Other {
            message: "there is nothing to save: no mesh, no light that glTF has, and no camera".to_owned(),
            help: "the file's own scene is `scene`, without parentheses".to_owned(),
        });
    }
    scene.parts.iter().try_for_each(|part| readable(&part.mesh))?;
    let (bytes, more) = crate::mesh::save::encode_scene(&scene, &cameras).map_err(|e| unwritten(e, path))?;
    write_atomically(path, &bytes).map_err(SaveError::Io)?;
    told.extend(more);
    Ok((!told.is_empty()).then_some(Lost::OfScene(told)).into_iter().collect())
}

/// A file with numbers that are not finite is one that no program reads, this one included.
fn readable(mesh: &Mesh) -> Result<(), SaveError> {
    mesh.validate().map_err(|why| SaveError::Other {
        message: format!("the mesh cannot be written: {why}"),
        help: "files of meshes hold numbers up to 3.4e38: scale it down, or look for what is NaN in it".to_owned(),
    })
}

fn unwritten(error: ImageError, path: &Path) -> SaveError {
    let extension = path.extension().and_then(|e| e.to_str()).unwrap_or("").to_ascii_lowercase();
    let (why, help) = match error {
        ImageError::File { message, .. } => (message, "check the folder, the space on the disk and the extension"),
        ImageError::Memory(_) | ImageError::TooLarge { .. } => {
            (error.to_string(), "save something smaller, or its parts by themselves")
        }
        _ if extension == "apng" => {
            (error.to_string(), "`resize(image, width: …, height: …)` brings images to one size")
        }
        _ => (error.to_string(), "`.exr` holds images of any number of channels"),
    };
    SaveError::Other { message: format!("cannot write `{}`: {why}", path.display()), help: help.to_owned() }
}

/// The warning about what a file does not hold of the expression whose text is `of`.
pub fn lost_warning(lost: &Lost, path: &Path, of: &str) -> Diagnostic {
    match lost {
        Lost::Colors(clipped) => clipped_warning(clipped, path, of),
        Lost::Negative(count, least) => {
            let name = path.file_name().unwrap_or(path.as_os_str()).to_string_lossy();
            let least = significant(f64::from(*least), 3);
            let told = match count {
                1 => format!(
                    "a pixel of `{name}` is negative, {least}, and black in the file: an HDR file holds no negative values"
                ),
                n => format!(
                    "{n} pixels of `{name}` are negative, down to {least}, and black in the file: an HDR file holds no negative values"
                ),
            };
            Diagnostic::warning("dscene::image::clipped", told).help("`.exr` keeps all values")
        }
        Lost::NotNumbers(broken) => {
            let name = path.file_name().unwrap_or(path.as_os_str()).to_string_lossy();
            let NotNumbers { count, first: [x, y] } = broken;
            let told = match count {
                1 => format!("the pixel [{x}, {y}] of `{name}` is not a number (NaN), and black in the file"),
                n => format!(
                    "{n} pixels of `{name}` are not numbers (NaN), and black in the file; the first is [{x}, {y}]"
                ),
            };
            let help = "0 / 0, a root or a logarithm of what is negative give such, and so does all that is computed with one; `.exr` keeps them";
            Diagnostic::warning("dscene::image::nan", told).help(help)
        }
        Lost::Beyond(beyond) => {
            let name = path.file_name().unwrap_or(path.as_os_str()).to_string_lossy();
            let help = "`.npy` and `.json` keep all numbers; a factor brings them into the file's range";
            Diagnostic::warning("dscene::image::clipped", beyond.told(&name)).help(help)
        }
        Lost::Channels(told) => {
            let name = path.file_name().unwrap_or(path.as_os_str()).to_string_lossy();
            let told = format!("`{name}` does not hold the channels of the image: {told}");
            Diagnostic::warning("dscene::file::simplified", told).help("`.exr` keeps them as they are")
        }
        Lost::OfScene(told) => {
            let name = path.file_name().unwrap_or(path.as_os_str()).to_string_lossy();
            let told = told.join("\n  ");
            Diagnostic::warning("dscene::file::simplified", format!("`{name}` does not hold all of it:\n  {told}"))
        }
    }
}

/// That a PNG file lacks what is brighter than white or darker than black.
fn clipped_warning(clipped: &Clipped, path: &Path, of: &str) -> Diagnostic {
    let Clipped { share, least, largest, mostly_below, channels } = *clipped;
    let name = path.file_name().unwrap_or(path.as_os_str()).to_string_lossy();
    let of = if of.len() > 40 { "…" } else { of.trim() };
    let number = |x: f32| significant(f64::from(x), 3);
    let (share, least, largest) = (significant(100.0 * share, 2), number(least), number(largest));
    let ways = match channels {
        1 => format!("`colormap({of})` shows any range of values"),
        _ if mostly_below > 1.0 && mostly_below.is_finite() => {
            // One digit, rounded down.
            let exposure = f64::from(mostly_below).recip();
            let digit = 10_f64.powf(exposure.log10().floor());
            let exposure = (exposure / digit + 1e-9).floor() * digit;
            format!("`tonemap({of})` fits, or {} times as much as an exposure", significant(exposure, 1))
        }
        _ => format!("`colormap(luminance({of}), map: diverging)` shows what is negative"),
    };
    let told = format!(
        "{share} % of the pixels of `{name}` are clipped: a PNG holds values from 0 to 1, these are from {least} to {largest}"
    );
    Diagnostic::warning("dscene::image::clipped", told).help(format!("{ways}; `.exr` keeps all values"))
}

/// An array of truth values as ones and zeros.
fn truths(value: &Value) -> Option<Tensor> {
    match value {
        Value::Bool(truth) => Some(Tensor::scalar(f64::from(u8::from(*truth)))),
        Value::List(items) => {
            let parts = items.iter().map(truths).collect::<Option<Vec<Tensor>>>()?;
            let within = &parts.first()?.shape;
            if parts.iter().any(|part| part.shape != *within) {
                return None;
            }
            let shape = [&[parts.len()], &within[..]].concat();
            Some(Tensor { shape, data: parts.iter().flat_map(|part| part.data.iter().copied()).collect() })
        }
        _ => None,
    }
}

/// The table that a value is: a column for a vector, rows for a matrix, and named columns for a record of vectors. Angles are in radians, and
/// what is true is 1.
fn table_of(value: &Value) -> Result<Vec<u8>, SaveError> {
    let no_table = || SaveError::Other {
        message: format!("a table holds a vector, rows of numbers or a record of columns, this is {}", value.kind()),
        help: "give the file the extension .json, which holds any value".to_owned(),
    };
    let failed = |message: String| SaveError::Other { message, help: "save it as .json".to_owned() };
    // `{}` writes as many digits as it takes to read the same number back.
    let cells = |row: &[f64]| row.iter().map(f64::to_string).collect::<Vec<String>>();
    if let Value::Record(fields) = value {
        let column = |v: &Value| -> Option<Vec<String>> {
            match v {
                Value::Num(v) if v.shape().len() == 1 => Some(cells(&v.value().data)),
                Value::List(items) if items.first().is_some_and(|item| matches!(item, Value::Bool(_))) => {
                    Some(cells(&truths(v)?.data))
                }
                Value::List(items) => items
                    .iter()
                    .map(|item| match item {
                        Value::Str(s) => Some(s.to_string()),
                        _ => None,
                    })
                    .collect(),
                _ => None,
            }
        };
        let columns: Option<Vec<Vec<String>>> = fields.iter().map(|(_, v)| column(v)).collect();
        let columns = columns.ok_or_else(no_table)?;
        let length = columns.first().map_or(0, Vec::len);
        if columns.iter().any(|c| c.len() != length) {
            return Err(failed("the columns of the table have different lengths".to_owned()));
        }
        let rows: Vec<Vec<String>> = (0..length).map(|i| columns.iter().map(|c| c[i].clone()).collect()).collect();
        let names: Vec<&str> = fields.iter().map(|(n, _)| n.as_str()).collect();
        return table::encode(Some(&names), &rows).map_err(failed);
    }
    let truths = truths(value);
    let tensor = value.var().map(|var| var.value()).or(truths.as_ref()).ok_or_else(no_table)?;
    let width = match tensor.shape[..] {
        [] | [_] => 1,
        [_, width] => width.max(1),
        _ => return Err(no_table()),
    };
    let rows: Vec<Vec<String>> = tensor.data.chunks(width).map(cells).collect();
    table::encode(None, &rows).map_err(failed)
}

/// The picture that a value is, or that its numbers make: `[height, width]` or `[height, width, channels ≤ 4]`.
pub fn image_of(value: &Value) -> Option<Image> {
    let tensor: &Tensor = value.var()?.value();
    let (height, width, channels) = match (value, &tensor.shape[..]) {
        (_, &[h, w, c]) if (1..=4).contains(&c) => (h, w, c),
        (Value::Num(_), &[h, w]) => (h, w, 1),
        _ => return None,
    };
    let data = tensor.data.iter().map(|x| *x as f32).collect();
    Some(Image { width, height, channels, data })
}
