//! Reads MTL, the material files of OBJ, as metallic-roughness materials.
//!
//! `Kd` and `map_Kd` are the base colour, `Ke` and `map_Ke` the emission. `Pr` is the roughness (if it is missing, the exponent `Ns`) and
//! `Pm` the metallicity, with their maps. `specular` of `principled` follows from the mean of `Ks` or, if that is missing, from the index
//! of refraction `Ni`. `d` (or 1 − `Tr`) and `map_d` are the opacity, `norm` is a normal map. `illum` 0 and 1 have no highlight; 4, 6, 7
//! and 9 are clear glass of the index `Ni`. Other statements are reported as not supported, and numbers beyond their range as brought back.

use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::{Vec2, Vec3, vec2};

use crate::image::file::{Encoding, is_file, read_bytes};
use crate::image::{Image, Wrap};

use super::load::{Clear, Coat, LoadedImage, LoadedMaterial};
use super::reading::{Notes, Reading, lines, text_of, without_mark};

/// Transformation of a material's texture coordinates: they are scaled, then translated.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Placement {
    scale: Vec2,
    offset: Vec2,
}

impl Placement {
    const AS_IS: Placement = Placement { scale: Vec2::ONE, offset: Vec2::ZERO };

    pub fn apply(&self, uv: Vec2) -> Vec2 {
        uv * self.scale + self.offset
    }
}

/// A map statement: an image and its options.
#[derive(Clone, Debug)]
struct Map {
    file: String,
    placement: Placement,
    clamp: bool,
    /// The channel of a map of numbers, as the option `-imfchan` names it.
    channel: Option<char>,
}

#[derive(Clone, Debug, Default)]
struct Mtl {
    /// Folder of the material library.
    folder: PathBuf,
    diffuse: Option<Vec3>,
    specular: Option<Vec3>,
    emissive: Option<Vec3>,
    exponent: Option<f32>,
    roughness: Option<f32>,
    metallic: Option<f32>,
    index: Option<f32>,
    coat: Option<f32>,
    coat_roughness: Option<f32>,
    opacity: Option<f32>,
    transparency: Option<f32>,
    /// Whether there is ambient light, which is traced instead.
    ambient: bool,
    illumination: Option<i32>,
    /// By the name of the statement.
    maps: HashMap<&'static str, Map>,
    /// Statements and options that are not supported.
    left_out: Vec<String>,
}

/// The materials of all libraries of a file.
#[derive(Default)]
pub(super) struct Library {
    materials: HashMap<String, Mtl>,
    is_broken: bool,
}

/// Maps that are used.
const MAPS: [&str; 6] = ["map_Kd", "map_Ke", "map_Pr", "map_Pm", "map_d", "norm"];

impl Library {
    /// Reads the material libraries that a `mtllib` statement names: one file, whose name may contain blanks, or several.
    pub fn read(&mut self, names: &str, reading: &mut Reading) {
        let whole = names.replace('\\', "/");
        let is_there = |name: &str| is_file(&reading.folder.join(name));
        let names = match is_there(&whole) || !whole.contains(char::is_whitespace) {
            true => vec![whole],
            false => whole.split_whitespace().map(str::to_string).collect(),
        };
        for name in names {
            let path = reading.folder.join(&name);
            match read_bytes(&path) {
                Ok(bytes) => self.parse(&bytes, &name, path.parent().unwrap_or(Path::new("")), reading),
                Err(message) => {
                    self.is_broken = true;
                    reading.notes.say(format!("material file “{name}”: {message}"));
                }
            }
        }
    }

    /// Whether a library could not be read, so that materials may be missing.
    pub fn is_broken(&self) -> bool {
        self.is_broken
    }

    pub fn material(&self, name: &str, reading: &mut Reading) -> Option<(Arc<LoadedMaterial>, Placement)> {
        let mtl = self.materials.get(name)?;
        let (material, placement) = mtl.within_range(name, reading).convert(name, reading);
        Some((Arc::new(material), placement))
    }

    fn parse(&mut self, bytes: &[u8], file: &str, folder: &Path, reading: &mut Reading) {
        let mut current: Option<&mut Mtl> = None;
        let mut spare = Mtl::default();
        let mut joined = String::new();
        for (number, line) in lines(without_mark(bytes)) {
            let text = text_of(line);
            let is_comment = joined.is_empty() && text.trim_start().starts_with('#');
            if let (false, Some(head)) = (is_comment, text.trim_end().strip_suffix('\\')) {
                joined.push_str(head);
                joined.push(' ');
                continue;
            }
            joined.push_str(&text);
            let statement = std::mem::take(&mut joined);
            let statement = statement.trim();
            let (word, rest) = statement.split_once(char::is_whitespace).unwrap_or((statement, ""));
            if word.is_empty() || word.starts_with('#') {
                continue;
            }
            let rest = rest.trim();
            if word.eq_ignore_ascii_case("newmtl") {
                if self.materials.contains_key(rest) {
                    // If several libraries define a material, the first one counts.
                    reading.notes.about("materials are defined twice, and the first counts", format!("“{rest}”"));
                    current = Some(&mut spare);
                    continue;
                }
                let new = Mtl { folder: folder.to_path_buf(), ..Mtl::default() };
                current = Some(self.materials.entry(rest.to_string()).or_insert(new));
                continue;
            }
            let known = current.as_mut().map(|mtl| mtl.statement(word, rest));
            if known != Some(Ok(())) {
                let line: String = statement.chars().take(40).collect();
                let what = format!("`{line}` (line {number} of “{file}”)");
                match known {
                    Some(Err(Fault::Unknown)) => reading.notes.about("statements of materials are left out", what),
                    _ => reading.notes.about("lines that cannot be understood are left out", what),
                }
            }
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Fault {
    /// The statement is malformed.
    Odd,
    /// The statement is not known, or has no meaning here.
    Unknown,
}

impl Mtl {
    fn statement(&mut self, word: &str, rest: &str) -> Result<(), Fault> {
        let lower = word.to_ascii_lowercase();
        match lower.as_str() {
            "kd" => self.diffuse = Some(color(rest)?),
            "ks" => self.specular = Some(color(rest)?),
            "ke" => self.emissive = Some(color(rest)?),
            "ns" => self.exponent = Some(number(rest)?),
            "pr" => self.roughness = Some(number(rest)?),
            "pm" => self.metallic = Some(number(rest)?),
            "ni" => self.index = Some(number(rest)?),
            "tr" => self.transparency = Some(number(rest)?),
            "d" => match rest.strip_prefix("-halo") {
                Some(rest) => {
                    self.opacity = Some(number(rest)?);
                    self.left_out.push("-halo".into());
                }
                None => self.opacity = Some(number(rest)?),
            },
            "illum" => {
                let model = number(rest)?;
                if model.fract() != 0.0 || !(0.0..=10.0).contains(&model) {
                    return Err(Fault::Odd);
                }
                self.illumination = Some(model as i32);
                if model == 10.0 {
                    self.left_out.push("`illum 10` (a surface of which only the shadows show)".into());
                }
            }
            "map_kd" | "map_ke" | "map_pr" | "map_pm" | "map_d" | "norm" => {
                let map = self.map(word, rest)?;
                let name = MAPS.into_iter().find(|m| m.eq_ignore_ascii_case(word)).ok_or(Fault::Unknown)?;
                self.maps.insert(name, map);
            }
            "ka" => self.ambient |= color(rest)? != Vec3::ZERO,
            "map_ka" => self.ambient = true,
            // Every image is antialiased.
            "map_aat" => {}
            // What filters the light that passes: white leaves it as it is.
            "tf" => {
                if color(rest)? != Vec3::ONE {
                    self.left_out.push(word.to_string());
                }
            }
            // How sharp a reflected image is; by default 60.
            "sharpness" => {
                if number(rest)? != 60.0 {
                    self.left_out.push(word.to_string());
                }
            }
            "pc" => self.coat = Some(number(rest)?),
            "pcr" => self.coat_roughness = Some(number(rest)?),
            "ps" | "aniso" | "anisor" => {
                if number(rest)? != 0.0 {
                    self.left_out.push(word.to_string());
                }
            }
            "map_ks" | "map_ns" | "map_tr" | "map_bump" | "bump" | "map_norm" | "disp" | "map_disp" | "decal"
            | "refl" | "map_refl" | "map_ps" | "map_pc" | "map_pcr" | "map_ni" | "map_tf" | "map_rma" | "map_orm" => {
                self.left_out.push(word.to_string());
            }
            _ => return Err(Fault::Unknown),
        }
        Ok(())
    }

    /// Parses options and then the name of a file, which may contain blanks.
    fn map(&mut self, word: &str, text: &str) -> Result<Map, Fault> {
        let mut map = Map { file: String::new(), placement: Placement::AS_IS, clamp: false, channel: None };
        let mut rest = text.trim();
        while rest.starts_with('-') {
            let (option, after) = rest.split_once(char::is_whitespace).ok_or(Fault::Odd)?;
            let most = match option {
                "-s" | "-o" | "-t" => 3,
                "-mm" => 2,
                "-bm" | "-boost" | "-texres" | "-blendu" | "-blendv" | "-cc" | "-clamp" | "-imfchan" | "-type" => 1,
                // Not an option: the name of a file that begins with a dash.
                _ => break,
            };
            let mut words = Vec::new();
            rest = after.trim_start();
            while words.len() < most && !rest.is_empty() {
                let (word, after) = rest.split_once(char::is_whitespace).unwrap_or((rest, ""));
                // The second and third number are optional.
                if most > 1 && word.parse::<f32>().is_err() {
                    break;
                }
                words.push(word);
                rest = after.trim_start();
            }
            if words.is_empty() {
                return Err(Fault::Odd);
            }
            let at = |i: usize, or: f32| words.get(i).and_then(|w| w.parse::<f32>().ok()).unwrap_or(or);
            let is_on = words[0].eq_ignore_ascii_case("on");
            match option {
                "-s" => map.placement.scale = vec2(at(0, 1.0), at(1, 1.0)),
                "-o" => map.placement.offset = vec2(at(0, 0.0), at(1, 0.0)),
                "-clamp" => map.clamp = is_on,
                // The luminance is the mean; a depth, and one channel of a colour, are not supported.
                "-imfchan" => match words[0].chars().next() {
                    Some(channel @ ('r' | 'g' | 'b' | 'm' | 'l')) if !has_colors(word) => map.channel = Some(channel),
                    _ => self.left_out.push(format!("`{option}` of {word}")),
                },
                // Options that have their default value, or do not change the appearance.
                "-mm" if at(0, 0.0) == 0.0 && at(1, 1.0) == 1.0 => {}
                "-t" if (0..3).all(|i| at(i, 0.0) == 0.0) => {}
                "-blendu" | "-blendv" if is_on => {}
                "-cc" if !is_on => {}
                "-boost" | "-texres" => {}
                _ => self.left_out.push(format!("`{option}` of {word}")),
            }
        }
        if rest.is_empty() {
            return Err(Fault::Odd);
        }
        if !(map.placement.scale.is_finite() && map.placement.offset.is_finite()) {
            return Err(Fault::Odd);
        }
        map.file = rest.trim_matches('"').replace('\\', "/");
        Ok(map)
    }

    /// The material with its numbers in the ranges where they mean something.
    fn within_range(&self, name: &str, reading: &mut Reading) -> Mtl {
        let mut new = self.clone();
        let whose = format!("“{name}”");
        let colors =
            [("Kd", &mut new.diffuse, 1.0), ("Ks", &mut new.specular, 1.0), ("Ke", &mut new.emissive, f32::MAX)];
        for (what, color, most) in colors {
            *color = color.map(|color| reading.within(color.to_array(), 0.0..=most, what, &whose).into());
        }
        let numbers = [
            ("Ns", &mut new.exponent, 0.0..=f32::MAX),
            ("Pr", &mut new.roughness, 0.0..=1.0),
            ("Pm", &mut new.metallic, 0.0..=1.0),
            ("Pc", &mut new.coat, 0.0..=1.0),
            ("Pcr", &mut new.coat_roughness, 0.0..=1.0),
            ("d", &mut new.opacity, 0.0..=1.0),
            ("Tr", &mut new.transparency, 0.0..=1.0),
            ("Ni", &mut new.index, f32::MIN..=10.0),
        ];
        for (what, number, range) in numbers {
            *number = number.map(|number| reading.within([number], range, what, &whose)[0]);
        }
        // There is no index nearest to one that no material has.
        if new.index.is_some_and(|index| index < 1.0) {
            new.index = None;
            if reading.materials() {
                reading.notes.about("refractive indices (`Ni`) below 1 are left out", &whose);
            }
        }
        new
    }

    /// Reports what the material says in vain.
    fn tell(&self, name: &str, notes: &mut Notes) {
        for what in &self.left_out {
            notes.about("parts of materials are left out", format!("{what} of “{name}”"));
        }
        if self.ambient {
            notes.about("ambient colours (`Ka`, `map_Ka`) are left out: ambient light is traced", format!("“{name}”"));
        }
        let is_grey = |color: Vec3| color == Vec3::splat(color.x);
        if self.specular.is_some_and(|color| !is_grey(color)) && !matches!(self.illumination, Some(0 | 1)) {
            notes.about("of the colours of highlights (`Ks`) only the mean is taken", format!("“{name}”"));
        }
        if self.opacity.zip(self.transparency).is_some_and(|(d, tr)| (d - (1.0 - tr)).abs() > 1e-3) {
            notes.about("where `d` and `Tr` contradict each other, `d` counts", format!("“{name}”"));
        }
        if self.clear().is_some() {
            let sentence =
                "glass (`illum` 4, 6, 7 and 9) is smooth and clear: its colour, roughness and images are left out";
            notes.about(sentence, format!("“{name}”"));
        } else if matches!(self.illumination, Some(4 | 6 | 7 | 9)) {
            let sentence = "glass (`illum` 4, 6, 7 and 9) without a refractive index (`Ni`) above 1 is rendered as an opaque surface";
            notes.about(sentence, format!("“{name}”"));
        }
    }

    fn convert(&self, name: &str, reading: &mut Reading) -> (LoadedMaterial, Placement) {
        let whose = format!("material “{name}”");
        if reading.materials() {
            self.tell(name, &mut reading.notes);
        }
        // A material has one transformation of texture coordinates: that of its first image.
        let first = MAPS.iter().find_map(|m| self.maps.get(m));
        let placement = first.map_or(Placement::AS_IS, |m| m.placement);
        if self.maps.values().any(|m| m.placement != placement) && reading.materials() {
            reading.notes.about("all images of a material are placed as its first one is", format!("“{name}”"));
        }
        let mut image = |kind: &str, encoding| {
            let map = self.maps.get(kind)?;
            let here = reading.folder;
            // Absolute paths are those of the machine on which the file was made, so only the name of the file counts.
            let beside = Path::new(&map.file).file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
            let found = [self.folder.as_path(), here].iter().any(|f| is_file(&f.join(&map.file)));
            let file = if found || !is_file(&self.folder.join(&beside)) { &map.file } else { &beside };
            let image = reading.image(&[&self.folder, here], file, encoding, &whose)?;
            Some((
                LoadedImage { image, wrap: if map.clamp { Wrap::Clamp } else { Wrap::Repeat }, nearest: false },
                map.channel,
            ))
        };
        let color = |found: Option<(LoadedImage, Option<char>)>| found.map(|(image, _)| image.channels(0, 3));
        let single = |found: Option<(LoadedImage, Option<char>)>| {
            found.map(|(i, channel)| i.with(one_channel(&i.image, channel)))
        };
        let base_color_image = color(image("map_Kd", Encoding::Srgb));
        let emissive_image = color(image("map_Ke", Encoding::Srgb));
        let roughness_image = single(image("map_Pr", Encoding::Linear));
        let metallic_image = single(image("map_Pm", Encoding::Linear));
        let mask = single(image("map_d", Encoding::Linear));
        let normals = color(image("norm", Encoding::Linear));
        // Some exporters write a black colour together with an image; then the image alone counts.
        let beside = |image: &Option<LoadedImage>, color: Option<Vec3>, or: Vec3| match (image, color) {
            (Some(_), None | Some(Vec3::ZERO)) => Vec3::ONE,
            (_, color) => color.unwrap_or(or),
        };
        let number = |image: &Option<LoadedImage>, x: Option<f32>, or: f32| match (image, x) {
            (Some(_), None | Some(0.0)) => 1.0,
            (_, x) => x.unwrap_or(or),
        };
        let from_exponent = |ns: f32| (2.0 / (ns + 2.0)).powf(0.25);
        let clear = self.clear();
        let coat = self.coat.filter(|weight| clear.is_none() && *weight > 0.0).map(|weight| Coat {
            weight,
            weight_image: None,
            roughness: self.coat_roughness.unwrap_or(0.0),
            roughness_image: None,
        });
        let mask = mask.filter(|_| clear.is_none());
        let normals = normals.filter(|_| clear.is_none());
        // Converts a Blinn-Phong exponent to the roughness of a lobe of the same width: α² = 2/(Ns + 2), α = roughness². Glass is smooth.
        let roughness = match clear {
            Some(_) => 0.0,
            None => number(&roughness_image, self.roughness.or(self.exponent.map(from_exponent)), 1.0),
        };
        let opacity = if clear.is_some() { Some(1.0) } else { self.opacity };
        let opacity = opacity.or(self.transparency.map(|t| 1.0 - t)).unwrap_or(1.0);
        let material = LoadedMaterial {
            name: name.to_string(),
            base_color: beside(&base_color_image, self.diffuse, Vec3::ONE),
            metallic: number(&metallic_image, self.metallic, 0.0),
            roughness,
            specular: self.reflectance(),
            emissive: beside(&emissive_image, self.emissive, Vec3::ZERO),
            opacity: match mask {
                Some(mask) => Some(mask.with(scaled(&mask.image, if opacity == 0.0 { 1.0 } else { opacity }))),
                None if opacity < 1.0 => {
                    let image = Image { width: 1, height: 1, channels: 1, data: vec![opacity] };
                    Some(LoadedImage { image: Arc::new(image), wrap: Wrap::Repeat, nearest: false })
                }
                None => None,
            },
            base_color_image,
            metallic_image,
            roughness_image: roughness_image.filter(|_| clear.is_none()),
            emissive_image,
            clear,
            coat,
            normals,
            ..LoadedMaterial::default()
        };
        (material, placement)
    }

    /// The refractive index of a body of glass.
    fn clear(&self) -> Option<Clear> {
        let is_glass = matches!(self.illumination, Some(4 | 6 | 7 | 9));
        self.index
            .filter(|index| is_glass && *index > 1.0)
            .map(|index| Clear::Body { ior: index, absorption: Vec3::ZERO })
    }

    /// The factor on the usual reflectance of 4 % at normal incidence.
    fn reflectance(&self) -> f32 {
        match (self.illumination, self.specular, self.index) {
            (Some(0 | 1), ..) => 0.0,
            // A `specular` of 0.5 stands for those 4 %.
            (_, Some(specular), _) => 2.0 * specular.element_sum() / 3.0,
            (.., Some(index)) => ((index - 1.0) / (index + 1.0)).powi(2) / 0.04,
            _ => 1.0,
        }
    }
}

/// Whether the image of a map statement has colours or directions, not numbers.
fn has_colors(word: &str) -> bool {
    ["map_kd", "map_ke", "norm"].iter().any(|name| name.eq_ignore_ascii_case(word))
}

/// Three numbers as a colour, or one number for all channels.
fn color(text: &str) -> Result<Vec3, Fault> {
    let numbers: Vec<f32> = uncommented(text).split_whitespace().map(number).collect::<Result<_, _>>()?;
    match numbers[..] {
        [grey] => Ok(Vec3::splat(grey)),
        [r, g, b] | [r, g, b, _] => Ok(Vec3::new(r, g, b)),
        _ => Err(Fault::Odd),
    }
}

fn number(text: &str) -> Result<f32, Fault> {
    uncommented(text).trim().parse().ok().filter(|x: &f32| x.is_finite()).ok_or(Fault::Odd)
}

/// Parses numbers up to the beginning of a comment.
fn uncommented(text: &str) -> &str {
    text.split('#').next().unwrap_or(text)
}

/// The channel that the option names. Without the option, alpha if the image has an alpha channel that is not 1 everywhere, and else the
/// mean of the colour channels.
fn one_channel(image: &Image, channel: Option<char>) -> Image {
    let n = image.channels;
    let colors = if n >= 3 { 3 } else { 1 };
    let alpha = (n == 2 || n == 4).then_some(n - 1);
    let chosen = match channel {
        Some('r') => Some(0),
        Some('g') => Some(1.min(colors - 1)),
        Some('b') => Some(2.min(colors - 1)),
        Some('m') => alpha,
        Some(_) => None,
        None => alpha.filter(|&a| image.data.chunks_exact(n).any(|p| p[a] != 1.0)),
    };
    let value = |p: &[f32]| match chosen {
        Some(c) => p[c],
        None => p[..colors].iter().sum::<f32>() / colors as f32,
    };
    Image { channels: 1, data: image.data.chunks_exact(n).map(value).collect(), ..*image }
}

fn scaled(image: &Image, factor: f32) -> Image {
    let opacity = |v: &f32| if v.is_nan() { 1.0 } else { (v * factor).clamp(0.0, 1.0) };
    Image { data: image.data.iter().map(opacity).collect(), ..*image }
}
