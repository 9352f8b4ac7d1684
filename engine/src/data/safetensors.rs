//! `.safetensors` files: the length of the header (eight bytes), the header in JSON with type, shape and byte range of each array,
//! and the numbers.

use std::ops::Range;

use serde::Deserialize;
use serde_json::{Map, Value, json};

use crate::memory;
use crate::tape::Tensor;

/// The bytes of a file with named arrays, as little-endian doubles in row-major order.
pub fn encode<'a>(arrays: impl IntoIterator<Item = (&'a str, &'a Tensor)>) -> Vec<u8> {
    let mut entries = Map::new();
    let mut numbers = Vec::new();
    for (name, array) in arrays {
        let begin = numbers.len();
        array.data.iter().for_each(|x| numbers.extend(x.to_le_bytes()));
        let entry = json!({ "dtype": "F64", "shape": array.shape, "data_offsets": [begin, numbers.len()] });
        entries.insert(name.to_owned(), entry);
    }
    let mut header = Value::Object(entries).to_string();
    // Numbers begin at a multiple of 8 bytes.
    header.extend(std::iter::repeat_n(' ', header.len().next_multiple_of(8) - header.len()));
    [&(header.len() as u64).to_le_bytes(), header.as_bytes(), &numbers].concat()
}

/// A file whose header was read and found to be in order. Its numbers are decoded when they are asked for.
pub struct Arrays {
    bytes: Vec<u8>,
    entries: Vec<(String, Entry)>,
}

#[derive(Clone, Debug)]
struct Entry {
    kind: String,
    shape: Vec<usize>,
    /// In the bytes of the file.
    range: Range<usize>,
}

/// An array in single precision, as weights of networks are used.
#[derive(Clone, Debug, PartialEq)]
pub struct Array {
    /// Lengths of its axes, the outermost first.
    pub shape: Vec<usize>,
    /// Row by row: as many numbers as the product of the shape.
    pub data: Vec<f32>,
}

/// An array in the header.
#[derive(Deserialize)]
struct Stated {
    dtype: String,
    shape: Vec<usize>,
    data_offsets: [usize; 2],
}

/// The key of a header under which other things than arrays stand.
const METADATA: &str = "__metadata__";

/// Bytes of one number, by its type.
fn width(kind: &str) -> Option<usize> {
    Some(match kind {
        "BOOL" | "U8" | "I8" | "F8_E5M2" | "F8_E4M3" => 1,
        "F16" | "BF16" | "I16" | "U16" => 2,
        "F32" | "I32" | "U32" => 4,
        "F64" | "I64" | "U64" => 8,
        _ => return None,
    })
}

/// Reads the header of a file.
pub fn decode(bytes: Vec<u8>) -> Result<Arrays, String> {
    let start = bytes.first_chunk().map(|length| u64::from_le_bytes(*length));
    let start = start.ok_or("this is no .safetensors file: it is shorter than the length of its header")?;
    let end = usize::try_from(start).ok().and_then(|n| n.checked_add(8)).filter(|end| *end <= bytes.len());
    let end = end.ok_or_else(|| {
        let size = bytes.len() - 8;
        format!("its header should have {start} bytes, and {size} follow: it is cut off, or no .safetensors file")
    })?;
    // A JSON tree takes some twenty times as much memory as its text.
    memory::ask(start.saturating_mul(20)).map_err(|e| e.to_string())?;
    let header: Map<String, Value> =
        serde_json::from_slice(&bytes[8..end]).map_err(|e| format!("its header is no JSON object: {e}"))?;
    let held = bytes.len() - end;
    let mut entries = Vec::new();
    for (name, stated) in header.into_iter().filter(|(name, _)| name != METADATA) {
        let wrong = |why: &str| format!("its header is wrong about `{name}`: {why}");
        let stated = Stated::deserialize(stated).map_err(|e| wrong(&e.to_string()))?;
        let width = width(&stated.dtype).ok_or_else(|| wrong(&format!("no type is called {:?}", stated.dtype)))?;
        let needed = stated.shape.iter().try_fold(width, |n, side| n.checked_mul(*side));
        let [from, to] = stated.data_offsets;
        if to > held {
            return Err(format!("it ends within the numbers of `{name}`: {held} bytes of at least {to}"));
        }
        if from > to || needed != Some(to - from) {
            return Err(wrong(&format!(
                "shape {:?} of {} does not take bytes {from} to {to}",
                stated.shape, stated.dtype
            )));
        }
        entries.push((name, Entry { kind: stated.dtype, shape: stated.shape, range: end + from..end + to }));
    }
    Ok(Arrays { bytes, entries })
}

impl Arrays {
    /// The names of all arrays, in the order of the header.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.entries.iter().map(|(name, _)| name.as_str())
    }

    /// The array of that name, `None` if there is none. Fails if it is made of whole numbers, or of numbers that are not finite.
    pub fn floats(&self, name: &str) -> Result<Option<Array>, String> {
        let Some((_, entry)) = self.entries.iter().find(|(n, _)| n == name) else { return Ok(None) };
        let bytes = &self.bytes[entry.range.clone()];
        memory::ask_for::<f32>(entry.shape.iter().product()).map_err(|e| e.to_string())?;
        let data: Vec<f32> = match entry.kind.as_str() {
            "F16" => bytes.as_chunks().0.iter().map(|b| half(u16::from_le_bytes(*b))).collect(),
            "BF16" => {
                bytes.as_chunks().0.iter().map(|b| f32::from_bits(u32::from(u16::from_le_bytes(*b)) << 16)).collect()
            }
            "F32" => bytes.as_chunks().0.iter().map(|b| f32::from_le_bytes(*b)).collect(),
            "F64" => bytes.as_chunks().0.iter().map(|b| f64::from_le_bytes(*b) as f32).collect(),
            other => return Err(format!("`{name}` is of type {other}; F16, BF16, F32 and F64 are read")),
        };
        match data.iter().find(|x| !x.is_finite()) {
            Some(x) => Err(format!("`{name}` has a number that is not finite ({x})")),
            None => Ok(Some(Array { shape: entry.shape.clone(), data })),
        }
    }
}

/// A half-precision number (IEEE 754): one bit of sign, five of the exponent, ten of the fraction.
pub(super) fn half(bits: u16) -> f32 {
    let (exponent, fraction) = (i32::from(bits >> 10 & 31), f32::from(bits & 1023));
    let size = match exponent {
        0 => fraction * 2f32.powi(-24),
        31 if fraction == 0.0 => f32::INFINITY,
        31 => f32::NAN,
        _ => (1024.0 + fraction) * 2f32.powi(exponent - 25),
    };
    if bits >> 15 == 1 { -size } else { size }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_header_says_where_numbers_are() {
        let (x, grid) = (Tensor::scalar(0.1), Tensor { shape: vec![2, 3], data: vec![1.0, 2.0, 3.0, 4.0, 5.0, -0.0] });
        let empty = Tensor { shape: vec![0, 3], data: vec![] };
        let bytes = encode([("x", &x), ("a.b", &grid), ("none", &empty)]);
        let length = u64::from_le_bytes(bytes[..8].try_into().unwrap()) as usize;
        assert_eq!(length % 8, 0);
        let header: Value = serde_json::from_slice(&bytes[8..8 + length]).unwrap();
        let numbers = &bytes[8 + length..];
        for (name, array) in [("x", &x), ("a.b", &grid), ("none", &empty)] {
            let entry = &header[name];
            assert_eq!((&entry["dtype"], &entry["shape"]), (&json!("F64"), &json!(array.shape)));
            let at = |i: usize| entry["data_offsets"][i].as_u64().unwrap() as usize;
            let found: Vec<u64> =
                numbers[at(0)..at(1)].chunks(8).map(|c| u64::from_le_bytes(c.try_into().unwrap())).collect();
            assert_eq!(found, array.data.iter().map(|x| x.to_bits()).collect::<Vec<u64>>(), "{name}");
        }
        assert_eq!(numbers.len(), 7 * 8);
    }

    fn file(header: &str, numbers: &[u8]) -> Vec<u8> {
        [&(header.len() as u64).to_le_bytes(), header.as_bytes(), numbers].concat()
    }

    #[test]
    fn what_is_written_is_read() {
        let (x, grid) = (Tensor::scalar(0.1), Tensor { shape: vec![2, 2], data: vec![1.0, 2.0, 3.5, -0.0] });
        let arrays = decode(encode([("x", &x), ("a.b", &grid)])).unwrap();
        assert_eq!(arrays.names().collect::<Vec<_>>(), ["x", "a.b"]);
        assert_eq!(arrays.floats("x"), Ok(Some(Array { shape: vec![], data: vec![0.1] })));
        assert_eq!(arrays.floats("a.b"), Ok(Some(Array { shape: vec![2, 2], data: vec![1.0, 2.0, 3.5, -0.0] })));
        assert_eq!(arrays.floats("c"), Ok(None));
    }

    #[test]
    fn all_floating_point_types_are_read() {
        let header = r#"{"__metadata__": {"by": "hand"}, "h": {"dtype": "F16", "shape": [5], "data_offsets": [0, 10]},
            "b": {"dtype": "BF16", "shape": [2], "data_offsets": [10, 14]}, "s": {"dtype": "F32", "shape": [1], "data_offsets": [14, 18]},
            "n": {"dtype": "I64", "shape": [], "data_offsets": [18, 26]}, "i": {"dtype": "F16", "shape": [1], "data_offsets": [26, 28]}}"#;
        let halves = [0x3c00u16, 0xc000, 0x3555, 0x0001, 0x7bff].map(u16::to_le_bytes).concat();
        let brains = [0x3f80u16, 0xc2c8].map(u16::to_le_bytes).concat();
        let rest = [&1.5f32.to_le_bytes()[..], &7i64.to_le_bytes(), &0x7c00u16.to_le_bytes()].concat();
        let arrays = decode(file(header, &[halves, brains, rest].concat())).unwrap();
        let data = |name: &str| arrays.floats(name).map(|a| a.map(|a| a.data));
        assert_eq!(data("h"), Ok(Some(vec![1.0, -2.0, 0.333_251_95, 2f32.powi(-24), 65504.0])));
        assert_eq!(data("b"), Ok(Some(vec![1.0, -100.0])));
        assert_eq!(data("s"), Ok(Some(vec![1.5])));
        assert_eq!(data("n"), Err("`n` is of type I64; F16, BF16, F32 and F64 are read".to_owned()));
        assert_eq!(data("i"), Err("`i` has a number that is not finite (inf)".to_owned()));
    }

    #[test]
    fn hostile_headers_are_refused_in_words() {
        let entry = |rest: &str| file(&format!("{{\"w\": {{\"dtype\": \"F32\", {rest}}}}}"), &[0; 16]);
        for (bytes, why) in [
            (vec![1, 2, 3], "shorter than the length of its header"),
            (u64::MAX.to_le_bytes().to_vec(), "its header should have 18446744073709551615 bytes, and 0 follow"),
            (file("[1]", &[]), "its header is no JSON object"),
            (file("{\"w\": 1}", &[]), "wrong about `w`"),
            (
                file(r#"{"w": {"dtype": "F31", "shape": [], "data_offsets": [0, 4]}}"#, &[0; 4]),
                "no type is called \"F31\"",
            ),
            (
                entry(r#""shape": [2, 3], "data_offsets": [0, 24]"#),
                "ends within the numbers of `w`: 16 bytes of at least 24",
            ),
            (entry(r#""shape": [2, 3], "data_offsets": [0, 16]"#), "shape [2, 3] of F32 does not take bytes 0 to 16"),
            (entry(r#""shape": [4], "data_offsets": [16, 0]"#), "does not take bytes 16 to 0"),
            (entry(r#""shape": [4611686018427387904, 4], "data_offsets": [0, 0]"#), "does not take bytes"),
            (entry(r#""shape": [-4], "data_offsets": [0, 16]"#), "wrong about `w`"),
        ] {
            let Err(found) = decode(bytes) else { panic!("{why} was not said") };
            assert!(found.contains(why), "{found}");
        }
    }
}
