//! State that the readers of all mesh formats share while they read a file: its folder, a budget of memory, images read so far, and notes
//! for the user.

use std::collections::HashMap;
use std::fmt::Display;
use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use crate::image::file::{Decoded, Encoding, decode, is_file, read_bytes};
use crate::image::{Image, ImageError};

use crate::memory;
use crate::stop;

use super::load::Wanted;

/// Most names that a note lists, and most names that it counts.
const NAMES: usize = 4;
const COUNTED: usize = 100;

/// Bytes per vertex with all its attributes: as read, after merging, and as numbers of the language in double precision.
const VERTEX_BYTES: u64 = 2 * 44 + 88;

/// Bytes per triangle: as read and after merging.
const FACE_BYTES: u64 = 2 * 12;

/// Bytes per number of an image: as read, split into channels, as a number of the language, and as rendered.
const TEXEL_BYTES: u64 = 4 + 4 + 8 + 4;

/// Notes about features of a file that are not supported. Features of one kind make one sentence, which lists them by name.
#[derive(Debug, Default)]
pub(super) struct Notes {
    entries: Vec<(String, Vec<String>)>,
}

impl Notes {
    /// Adds a sentence.
    pub fn say(&mut self, sentence: impl Into<String>) {
        let sentence = sentence.into();
        if !self.entries.iter().any(|(s, _)| *s == sentence) {
            self.entries.push((sentence, Vec::new()));
        }
    }

    /// Adds a name to those that a sentence lists; each is listed once.
    pub fn about(&mut self, sentence: &str, name: impl Display) {
        let name = name.to_string();
        match self.entries.iter_mut().find(|(s, _)| s == sentence) {
            Some((_, names)) if names.len() > COUNTED || names.contains(&name) => {}
            Some((_, names)) => names.push(name),
            None => self.entries.push((sentence.to_string(), vec![name])),
        }
    }

    /// All sentences, in the order in which they were added.
    pub fn sentences(self) -> Vec<String> {
        let sentence = |(sentence, names): (String, Vec<String>)| match names.len() {
            0 => sentence,
            1..=NAMES => format!("{sentence}: {}", names.join(", ")),
            n if n > COUNTED => format!("{sentence}: {} and many more", names[..NAMES - 1].join(", ")),
            n => format!("{sentence}: {} and {} more", names[..NAMES - 1].join(", "), n - (NAMES - 1)),
        };
        self.entries.into_iter().map(sentence).collect()
    }
}

/// One file being read.
pub(super) struct Reading<'a> {
    pub folder: &'a Path,
    /// Name of parts without a name.
    pub name: &'a str,
    pub wanted: Wanted,
    pub notes: Notes,
    /// Bytes of geometry that were requested.
    asked: u64,
    /// Images by path and encoding; `None` for one that could not be read, which has been reported.
    images: HashMap<(PathBuf, bool), Option<Arc<Image>>>,
}

impl<'a> Reading<'a> {
    pub fn new(folder: &'a Path, name: &'a str, wanted: Wanted) -> Reading<'a> {
        Reading { folder, name, wanted, notes: Notes::default(), asked: 0, images: HashMap::new() }
    }

    /// Whether materials are read, and their unsupported features reported.
    pub fn materials(&self) -> bool {
        self.wanted == Wanted::Scene
    }

    /// A number of a material or the channels of its colour, brought back into the range where they mean something. That is reported by the
    /// name that they have in the file (`what`), about `whose`.
    pub fn within<const N: usize>(
        &mut self,
        given: [f32; N],
        range: RangeInclusive<f32>,
        what: impl Display,
        whose: &str,
    ) -> [f32; N] {
        // What is not a number has no nearest one in the range.
        let taken = given.map(|x| if x.is_nan() { *range.start() } else { x.clamp(*range.start(), *range.end()) });
        if taken != given && self.materials() {
            let sentence = "numbers of materials beyond their range are brought back into it";
            self.notes.about(sentence, format!("{what} of {whose} ({}, taken as {})", text(&given), text(&taken)));
        }
        taken
    }

    /// Requests memory for a total number of vertices and triangles, before they are made.
    pub fn expect(&mut self, vertices: u64, faces: u64) -> Result<(), String> {
        let bytes = vertices.saturating_mul(VERTEX_BYTES).saturating_add(faces.saturating_mul(FACE_BYTES));
        let more = bytes.saturating_sub(self.asked);
        stop::check();
        self.asked += more;
        memory::ask(more).map_err(|e| format!("of its {vertices} vertices and {faces} triangles, {e}"))
    }

    /// Reads an image from the first of `folders` that has it. If it cannot be read, that is reported about `whose` and there is none;
    /// nor is there if materials are not read.
    pub fn image(&mut self, folders: &[&Path], name: &str, encoding: Encoding, whose: &str) -> Option<Arc<Image>> {
        let found = folders.iter().map(|f| f.join(name)).find(|p| is_file(p));
        let path = found.unwrap_or_else(|| folders.first().unwrap_or(&self.folder).join(name));
        if !self.materials() {
            if !is_file(&path) {
                self.notes.about("images are missing", format!("“{name}” of {whose}"));
            }
            return None;
        }
        let key = (path, encoding == Encoding::Srgb);
        if let Some(known) = self.images.get(&key) {
            return known.clone();
        }
        let read =
            read_bytes(&key.0).and_then(|bytes| self.decoded(&bytes, encoding, &format!("image “{name}” of {whose}")));
        let image = read.map_err(|message| self.notes.say(format!("image “{name}” of {whose}: {message}"))).ok();
        self.images.insert(key, image.clone());
        image
    }

    /// Decodes an image from bytes. What is not done of it is reported by its name.
    pub fn decoded(&mut self, bytes: &[u8], encoding: Encoding, name: &str) -> Result<Arc<Image>, String> {
        let Decoded { image, notes } = decode(bytes, encoding, None).map_err(|e: ImageError| e.to_string())?;
        notes.into_iter().for_each(|note| self.notes.say(format!("{name}: {note}")));
        memory::ask(TEXEL_BYTES * image.data.len() as u64).map_err(|e| e.to_string())?;
        Ok(Arc::new(image))
    }
}

/// Numbers as a file has them; one stands for several that are the same.
fn text(numbers: &[f32]) -> String {
    match numbers {
        [first, others @ ..] if others.iter().all(|x| x.to_bits() == first.to_bits()) => first.to_string(),
        _ => format!("[{}]", numbers.iter().map(f32::to_string).collect::<Vec<_>>().join(", ")),
    }
}

/// The text of a line: UTF-8 or, if the bytes are not, Latin-1, which older exporters write.
pub(super) fn text_of(bytes: &[u8]) -> std::borrow::Cow<'_, str> {
    match std::str::from_utf8(bytes) {
        Ok(text) => text.into(),
        Err(_) => bytes.iter().map(|&b| char::from(b)).collect::<String>().into(),
    }
}

/// The bytes without a UTF-8 byte order mark.
pub(super) fn without_mark(bytes: &[u8]) -> &[u8] {
    bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes)
}

/// Lines with their numbers from 1; they end at `\n`, `\r\n` or a lone `\r`.
pub(super) fn lines(bytes: &[u8]) -> impl Iterator<Item = (usize, &[u8])> {
    let mut rest = Some(bytes);
    let mut number = 0;
    std::iter::from_fn(move || {
        let here = rest.filter(|r| !r.is_empty())?;
        number += 1;
        let Some(end) = here.iter().position(|&b| b == b'\n' || b == b'\r') else {
            rest = None;
            return Some((number, here));
        };
        let long = usize::from(here[end..].starts_with(b"\r\n"));
        rest = Some(&here[end + 1 + long..]);
        Some((number, &here[..end]))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn notes_list_names_once() {
        let mut notes = Notes::default();
        for name in ["a", "b", "a", "c"] {
            notes.about("left out", name);
        }
        notes.say("alone");
        (0..6).for_each(|i| notes.about("many", i));
        assert_eq!(notes.sentences(), ["left out: a, b, c", "alone", "many: 0, 1, 2 and 3 more"]);
    }

    #[test]
    fn lines_end_in_three_ways() {
        let found: Vec<(usize, &[u8])> = lines(b"a\nb\r\n\rc").collect();
        assert_eq!(found, [(1, &b"a"[..]), (2, b"b"), (3, b""), (4, b"c")]);
        assert_eq!(text_of(b"caf\xe9"), "café");
    }
}
