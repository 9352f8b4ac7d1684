//! Values as files: images, meshes, numbers, and any value as JSON or text.

use std::path::Path;

use super::show::significant;
use crate::check::types::Ty;
use crate::data::{npy, table};
use crate::diag::Diagnostic;
use crate::eval::{self, Names, SceneFile};
use crate::files::write_atomically;
use crate::image::file::Clipped;
use crate::image::{Image, ImageError};
use crate::memory;
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
pub fn save_value(value: &Value, ty: &Ty, path: &Path) -> Result<Option<Lost>, SaveError> {
    save_named(value, ty, Names::default(), path)
}

/// As [`save_value`], with names for the parts of a scene.
pub fn save_named(value: &Value, ty: &Ty, names: Names, path: &Path) -> Result<Option<Lost>, SaveError> {
    let (value, ty, path) = (value.clone(), ty.clone(), path.to_path_buf());
    // To compress a large image takes seconds.
    stop::apart(move || write_value(&value, &ty, &names, &path))
}

/// What a file does not hold of what was saved to it.
pub enum Lost {
    /// Colours beyond black and white.
    Colors(Clipped),
    /// What glTF does not have, in sentences.
    OfScene(Vec<String>),
}

fn write_value(value: &Value, ty: &Ty, names: &Names, path: &Path) -> Result<Option<Lost>, SaveError> {
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
            let array = value.var().ok_or_else(|| SaveError::Other {
                message: format!("a .npy file holds an array of numbers, this is {}", value.kind()),
                help: "give the file the extension .json, which holds any value".to_owned(),
            })?;
            write_atomically(path, &npy::encode(array.value())).map_err(SaveError::Io)
        }
        "csv" => write_atomically(path, &table_of(value)?).map_err(SaveError::Io),
        "txt" => write_atomically(path, format!("{}\n", eval::show(value, ty)).as_bytes()).map_err(SaveError::Io),
        "png" | "exr" | "hdr" => {
            let image = image_of(value).ok_or_else(|| SaveError::Other {
                message: format!("an image file holds an image, this is {}", value.kind()),
                help: "save a `render(…)`, or give the file the extension .json".to_owned(),
            })?;
            crate::image::file::save(path, &image).map_err(|e| unwritten(e, path))?;
            return Ok(if extension == "png" { Clipped::of(&image).map(Lost::Colors) } else { None });
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
            return Ok(frames.iter().find_map(Clipped::of).map(Lost::Colors));
        }
        "glb" if !matches!(value, Value::Mesh(_)) => return write_scene(value, names, path),
        "obj" | "ply" | "glb" => {
            let Value::Mesh(mesh) = value else {
                return Err(SaveError::Other {
                    message: format!("a mesh file holds a mesh, this is {}", value.kind()),
                    help: "save for instance `ball.mesh`, or give the file another extension".to_owned(),
                });
            };
            let bytes = crate::mesh::save::encode(&mesh.to_mesh(), &extension).unwrap_or_default();
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
    written.map(|()| None)
}

/// A mesh, shape, light, camera, scene or list of such.
fn write_scene(value: &Value, names: &Names, path: &Path) -> Result<Option<Lost>, SaveError> {
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
    let (bytes, more) = crate::mesh::save::encode_scene(&scene, &cameras).map_err(|e| unwritten(e, path))?;
    write_atomically(path, &bytes).map_err(SaveError::Io)?;
    told.extend(more);
    Ok((!told.is_empty()).then_some(Lost::OfScene(told)))
}

fn unwritten(error: ImageError, path: &Path) -> SaveError {
    let why = match error {
        ImageError::File { message, .. } => message,
        other => other.to_string(),
    };
    SaveError::Other {
        message: format!("cannot write `{}`: {why}", path.display()),
        help: "check the folder, the space on the disk and the extension".to_owned(),
    }
}

/// The warning about what a file does not hold of the expression whose text is `of`.
pub fn lost_warning(lost: &Lost, path: &Path, of: &str) -> Diagnostic {
    match lost {
        Lost::Colors(clipped) => clipped_warning(clipped, path, of),
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

/// The table that a value is: a column for a vector, rows for a matrix, and named columns for a record of vectors.
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
    let tensor = value.var().ok_or_else(no_table)?.value();
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
