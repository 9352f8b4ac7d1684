//! JSON as values of the language. Numbers are gathered as they are read: a tree of them would take some twenty times as much memory as the text.

use std::collections::HashMap;
use std::fmt;
use std::sync::Arc;

use serde::de::{Deserialize, Deserializer, Error, MapAccess, SeqAccess, Visitor};

use crate::memory::{self, Shortage};
use crate::tape::Tensor;

use super::value::Value;

/// Bytes of memory that a value takes beside its text or its numbers.
const VALUE_BYTES: u64 = 200;
/// Fields up to which a record's are looked through for one that was there before.
const FEW: usize = 16;

/// The value of a JSON text. Objects become records, and arrays of numbers tensors if their lengths agree. Numbers that are not finite are the
/// strings `"nan"`, `"inf"` or `"-inf"` in files written here; many other programs write NaN as `null`.
pub(super) fn decode(bytes: &[u8]) -> Result<Value, String> {
    let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    serde_json::from_slice::<Read>(bytes).map(Read::value).map_err(|e| fault(bytes, &e))
}

/// What is wrong with a JSON file. Python writes words that JSON does not have.
fn fault(bytes: &[u8], error: &serde_json::Error) -> String {
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

/// A part of the text.
enum Read {
    Number(f64),
    /// Nested arrays of numbers with equal lengths.
    Numbers(Tensor),
    Other(Value),
}

impl Read {
    fn value(self) -> Value {
        match self {
            Read::Number(x) => Value::scalar(x),
            Read::Numbers(mut numbers) => {
                numbers.data.shrink_to_fit();
                Value::tensor(numbers)
            }
            Read::Other(value) => value,
        }
    }
}

impl<'de> Deserialize<'de> for Read {
    fn deserialize<D: Deserializer<'de>>(from: D) -> Result<Read, D::Error> {
        from.deserialize_any(Reader)
    }
}

struct Reader;

impl<'de> Visitor<'de> for Reader {
    type Value = Read;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a JSON value")
    }

    fn visit_bool<E: Error>(self, truth: bool) -> Result<Read, E> {
        Ok(Read::Other(Value::Bool(truth)))
    }

    fn visit_i64<E: Error>(self, x: i64) -> Result<Read, E> {
        Ok(Read::Number(x as f64))
    }

    fn visit_u64<E: Error>(self, x: u64) -> Result<Read, E> {
        Ok(Read::Number(x as f64))
    }

    fn visit_f64<E: Error>(self, x: f64) -> Result<Read, E> {
        Ok(Read::Number(x))
    }

    fn visit_unit<E: Error>(self) -> Result<Read, E> {
        Ok(Read::Number(f64::NAN))
    }

    fn visit_str<E: Error>(self, text: &str) -> Result<Read, E> {
        Ok(match text {
            "nan" => Read::Number(f64::NAN),
            "inf" => Read::Number(f64::INFINITY),
            "-inf" => Read::Number(f64::NEG_INFINITY),
            _ => {
                memory::ask(text.len() as u64).map_err(E::custom)?;
                Read::Other(Value::str(text))
            }
        })
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut from: A) -> Result<Read, A::Error> {
        let mut items = Items::default();
        while let Some(item) = from.next_element()? {
            items.push(item).map_err(A::Error::custom)?;
        }
        Ok(items.read())
    }

    fn visit_map<A: MapAccess<'de>>(self, mut from: A) -> Result<Read, A::Error> {
        let mut fields: Vec<(String, Value)> = Vec::new();
        let mut places: HashMap<String, usize> = HashMap::new();
        while let Some((name, value)) = from.next_entry::<String, Read>()? {
            memory::ask(VALUE_BYTES + name.len() as u64).map_err(A::Error::custom)?;
            let known = match fields.len() {
                ..FEW => fields.iter().position(|(known, _)| *known == name),
                count => {
                    if places.is_empty() {
                        places = fields.iter().enumerate().map(|(i, (known, _))| (known.clone(), i)).collect();
                    }
                    let place = *places.entry(name.clone()).or_insert(count);
                    (place < count).then_some(place)
                }
            };
            // Of several fields of one name the last counts.
            match known {
                Some(place) => fields[place].1 = value.value(),
                None => fields.push((name, value.value())),
            }
        }
        Ok(Read::Other(Value::Record(Arc::new(fields))))
    }
}

/// The items of an array that is being read.
#[derive(Default)]
struct Items {
    /// The shape of each, as long as all are numbers of one shape.
    shape: Option<Vec<usize>>,
    numbers: Vec<f64>,
    count: usize,
    /// All of them, once they are not.
    values: Option<Vec<Value>>,
}

impl Items {
    fn push(&mut self, item: Read) -> Result<(), Shortage> {
        if self.values.is_none() {
            let (shape, numbers): (&[usize], &[f64]) = match &item {
                Read::Number(x) => (&[], std::slice::from_ref(x)),
                Read::Numbers(t) => (&t.shape, &t.data),
                Read::Other(_) => return self.push_other(item),
            };
            if self.shape.as_deref().is_none_or(|known| known.iter().eq(shape)) {
                let count = self.numbers.len() + numbers.len();
                if count > self.numbers.capacity() {
                    memory::ask_for::<f64>(2 * count)?;
                }
                if self.shape.is_none() {
                    self.shape = Some(shape.to_vec());
                }
                self.numbers.extend_from_slice(numbers);
                self.count += 1;
                return Ok(());
            }
        }
        self.push_other(item)
    }

    /// Adds an item that is none like those before.
    fn push_other(&mut self, item: Read) -> Result<(), Shortage> {
        if self.values.is_none() {
            memory::ask(VALUE_BYTES * self.count as u64 + 8 * self.numbers.len() as u64)?;
            let (shape, numbers) = (self.shape.take().unwrap_or_default(), std::mem::take(&mut self.numbers));
            let run = shape.iter().product::<usize>();
            let value = |i: usize| Value::tensor(Tensor::new(shape.clone(), numbers[i * run..(i + 1) * run].to_vec()));
            self.values = Some((0..self.count).map(value).collect());
        }
        memory::ask(VALUE_BYTES)?;
        self.values.get_or_insert_default().push(item.value());
        Ok(())
    }

    fn read(self) -> Read {
        match self.values {
            Some(values) => Read::Other(Value::list(values)),
            None => {
                let shape = [&[self.count], self.shape.as_deref().unwrap_or_default()].concat();
                Read::Numbers(Tensor::new(shape, self.numbers))
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use serde_json::Value as Json;

    use super::*;

    /// The same from a tree: an array is one of numbers if it was found to be so as a whole.
    fn of_tree(json: &Json) -> Value {
        let number = |x: f64| Value::scalar(x);
        match json {
            Json::Null => number(f64::NAN),
            Json::String(s) if ["nan", "inf", "-inf"].contains(&s.as_str()) => number(s.parse().unwrap()),
            Json::Number(n) => number(n.as_f64().unwrap()),
            Json::Bool(b) => Value::Bool(*b),
            Json::String(s) => Value::str(s.as_str()),
            Json::Array(items) if items.is_empty() => Value::tensor(Tensor::vector(Vec::new())),
            Json::Array(items) => Value::array(items.iter().map(of_tree).collect()),
            Json::Object(fields) => {
                Value::Record(Arc::new(fields.iter().map(|(n, v)| (n.clone(), of_tree(v))).collect()))
            }
        }
    }

    fn text(value: &Value) -> String {
        match value {
            Value::Num(x) => format!("{:?}{:?}", x.shape(), x.value().data),
            Value::List(items) => format!("list {:?}", items.iter().map(text).collect::<Vec<_>>()),
            Value::Record(fields) => {
                format!("record {:?}", fields.iter().map(|(n, v)| format!("{n}: {}", text(v))).collect::<Vec<_>>())
            }
            Value::Bool(b) => format!("{b}"),
            Value::Str(s) => format!("{s:?}"),
            _ => unreachable!("no JSON"),
        }
    }

    #[test]
    fn numbers_are_read_as_arrays_wherever_a_tree_of_them_is_one() {
        let wide: Vec<String> = (0..40).map(|i| format!("\"f{}\": {i}", i % 25)).collect();
        let parts = [
            "1",
            "-2.5e3",
            "null",
            "\"inf\"",
            "[]",
            "[1, 2]",
            "[3, null]",
            "[[1], [2]]",
            "true",
            "\"a\"",
            "{\"b\": [0, 1]}",
        ];
        let mut cases: Vec<String> = parts.iter().map(|p| (*p).to_owned()).collect();
        for a in parts {
            for b in parts {
                cases.extend([
                    format!("[{a}, {b}]"),
                    format!("[[{a}, {b}], [{b}, {b}]]"),
                    format!("{{\"x\": {a}, \"y\": [{a}, {b}], \"x\": {b}}}"),
                ]);
                cases.extend(parts.map(|c| format!("[{a}, {a}, {b}, {c}]")));
            }
        }
        cases.extend(
            ["[[[]]]", "[[], [[]]]", "[[[1]], [[2]]]", "18446744073709551615", "[[1, 2], [3]]"].map(str::to_owned),
        );
        cases.push(format!("{{{}}}", wide.join(", ")));
        for case in cases {
            let read = decode(case.as_bytes()).unwrap();
            assert_eq!(text(&read), text(&of_tree(&serde_json::from_str(&case).unwrap())), "{case}");
        }
    }
}
