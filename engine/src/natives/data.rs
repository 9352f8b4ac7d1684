//! Data files: JSON, tables and arrays, as values of the language.

use std::sync::Arc;

use serde_json::Value as Json;

use crate::data::{ies, npy, table};
use crate::files::read_bytes;
use crate::memory;
use crate::stop;
use crate::tape::{Tensor, Var};

use super::files::reading;
use super::value::Value;
use super::{Args, Native, NativeError, Result};

pub(super) const TABLE: &[(&str, Native)] = &[
    ("load_json", |a| {
        read(a, |bytes| {
            // A JSON tree of numbers takes some twenty times as much memory as its text.
            memory::ask(bytes.len() as u64 * 20).map_err(|e| e.to_string())?;
            let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
            let json: Json = serde_json::from_slice(bytes).map_err(|e| json_fault(bytes, &e))?;
            Ok(from_json(&json))
        })
    }),
    ("load_table", |a| match read(a, table::decode)? {
        table::Table::Rows(rows) => Ok(Value::tensor(rows)),
        table::Table::Columns(columns) => {
            let value = |column| match column {
                table::Column::Numbers(numbers) => Value::tensor(Tensor::vector(numbers)),
                table::Column::Words(words) => Value::list(words.into_iter().map(Value::str).collect()),
            };
            Ok(Value::Record(Arc::new(columns.into_iter().map(|(n, c)| (n, value(c))).collect())))
        }
    }),
    ("load_profile", |a| Ok(Value::Image(load_profile(a, 0)?))),
    ("load_array", |a| {
        let read = read(a, npy::decode)?;
        if let Some(note) = read.note {
            a.warn(NativeError::at(0, note));
        }
        Ok(Value::tensor(read.array))
    }),
];

/// Reads the file that the first argument names and decodes its bytes with `decode`.
fn read<T: Send + 'static>(a: &Args, decode: fn(&[u8]) -> Result<T, String>) -> Result<T> {
    read_at(a, 0, decode)
}

/// [`read`] for the file that another argument names.
fn read_at<T: Send + 'static>(a: &Args, index: usize, decode: fn(&[u8]) -> Result<T, String>) -> Result<T> {
    let path = a.path(index)?;
    let _work = reading(&path);
    let decoded = stop::apart(move || decode(&read_bytes(&path)?));
    decoded.map_err(|e| NativeError::at(index, format!("{}: {e}", a.string(index).unwrap_or_default())))
}

/// Whether a file is a photometric one, by its ending.
pub(super) fn is_photometric(path: &str) -> bool {
    path.rsplit_once('.').is_some_and(|(_, ending)| ending.eq_ignore_ascii_case("ies"))
}

/// The map of the photometric file that an argument names. Warns about what of it is not done.
pub(super) fn load_profile(a: &Args, index: usize) -> Result<Var> {
    let (map, notes) = read_at(a, index, |bytes| {
        let luminaire = ies::decode(bytes)?;
        Ok((luminaire.map()?, luminaire.notes))
    })?;
    for note in notes {
        a.warn(NativeError::at(index, note));
    }
    Ok(Var::constant(map))
}

/// What is wrong with a JSON file. Python writes words that JSON does not have.
fn json_fault(bytes: &[u8], error: &serde_json::Error) -> String {
    let line = bytes.split(|b| *b == b'\n').nth(error.line().saturating_sub(1)).unwrap_or_default();
    // The column is that of a word's first or last letter.
    let from = error.column().saturating_sub(2).min(line.len());
    let near = &line[from..line.len().min(from + 12)];
    let word = ["NaN", "Infinity"].into_iter().find(|word| near.windows(word.len()).any(|w| w == word.as_bytes()));
    match word {
        Some(word) => format!(
            "{error}: `{word}` is no word of JSON; what is no number is written `null` there, or \"nan\", \"inf\", \"-inf\""
        ),
        None => error.to_string(),
    }
}

/// Objects become records, and arrays of numbers tensors if their lengths agree. Numbers that are not finite are the strings `"nan"`,
/// `"inf"` or `"-inf"` in files written here; many other programs write NaN as `null`.
fn from_json(json: &Json) -> Value {
    if let Some(numbers) = numbers(json) {
        return Value::tensor(numbers);
    }
    match json {
        Json::Bool(b) => Value::Bool(*b),
        Json::String(s) => Value::str(s.as_str()),
        Json::Array(items) => Value::list(items.iter().map(from_json).collect()),
        Json::Object(fields) => {
            Value::Record(Arc::new(fields.iter().map(|(n, v)| (n.clone(), from_json(v))).collect()))
        }
        Json::Null | Json::Number(_) => Value::scalar(f64::NAN),
    }
}

/// A number, or nested arrays of numbers with equal lengths, as a tensor; `None` for anything else.
fn numbers(json: &Json) -> Option<Tensor> {
    fn fill(json: &Json, depth: usize, shape: &mut Vec<usize>, data: &mut Vec<f64>) -> Option<()> {
        match json {
            Json::Array(items) => {
                // The first elements decide the depth and the lengths, which all others must have.
                if shape.len() == depth && data.is_empty() {
                    shape.push(items.len());
                }
                if shape.get(depth) != Some(&items.len()) {
                    return None;
                }
                items.iter().try_for_each(|item| fill(item, depth + 1, shape, data))
            }
            _ if shape.len() != depth => None,
            _ => {
                data.push(match json {
                    Json::Null => f64::NAN,
                    Json::String(s) if matches!(s.as_str(), "nan" | "inf" | "-inf") => s.parse().ok()?,
                    Json::Number(n) => n.as_f64()?,
                    _ => return None,
                });
                Some(())
            }
        }
    }
    let (mut shape, mut data) = (Vec::new(), Vec::new());
    fill(json, 0, &mut shape, &mut data)?;
    (shape.iter().product::<usize>() == data.len()).then_some(Tensor { shape, data })
}
