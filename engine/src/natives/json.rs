//! JSON as values of the language. Numbers are gathered as they are read: a tree of them would take some twenty times as much memory as the text.

use std::collections::HashSet;
use std::fmt;
use std::sync::Arc;

use serde::de::{Deserialize, Deserializer, Error, MapAccess, SeqAccess, Visitor};

use crate::data::{Noted, Rounded};
use crate::memory::{self, Shortage};
use crate::tape::Tensor;

use super::value::Value;

/// Bytes of memory that a value takes beside its text or its numbers.
const VALUE_BYTES: u64 = 200;
/// Fields up to which a record's are looked through for one that was there before.
const FEW: usize = 16;

/// The value of a JSON text. Objects become records, and arrays of numbers tensors if their lengths agree. Numbers that are not finite are the
/// strings `"nan"`, `"inf"` or `"-inf"` in files written here; many other programs write NaN as `null`.
/// No two fields of an object have one name. Told is that integers are rounded, and what is taken as 0.
pub(super) fn decode(bytes: &[u8]) -> Result<Noted<Value>, String> {
    let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    let value = serde_json::from_slice::<Read>(bytes).map(Read::value).map_err(|e| fault(bytes, &e))?;
    Ok((value, rounded(bytes).note().into_iter().collect()))
}

/// The integers of a text that are rounded. The parser gives those beyond 64 bits as doubles, so they are looked at as they are written.
fn rounded(bytes: &[u8]) -> Rounded {
    let mut rounded = Rounded::default();
    let mut at = 0;
    while let Some(first) = bytes.get(at) {
        let from = at;
        at += 1;
        match first {
            b'"' => {
                while let Some(byte) = bytes.get(at).filter(|b| **b != b'"') {
                    at += if *byte == b'\\' { 2 } else { 1 };
                }
                at += 1;
            }
            b'-' | b'0'..=b'9' => {
                let is_part = |b: &u8| b.is_ascii_digit() || matches!(b, b'.' | b'e' | b'E' | b'+' | b'-');
                at += bytes[at..].iter().take_while(|b| is_part(b)).count();
                let line = || format!("in line {}", 1 + bytes[..from].iter().filter(|b| **b == b'\n').count());
                rounded.see(std::str::from_utf8(&bytes[from..at]).unwrap_or_default(), line);
            }
            _ => {}
        }
    }
    rounded
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
        let mut names: HashSet<String> = HashSet::new();
        while let Some((name, value)) = from.next_entry::<String, Read>()? {
            memory::ask(VALUE_BYTES + name.len() as u64).map_err(A::Error::custom)?;
            let is_new = match fields.len() {
                ..FEW => fields.iter().all(|(known, _)| *known != name),
                _ => {
                    if names.is_empty() {
                        names.extend(fields.iter().map(|(known, _)| known.clone()));
                    }
                    names.insert(name.clone())
                }
            };
            if !is_new {
                return Err(A::Error::custom(format!("two fields of an object are named “{name}”")));
            }
            fields.push((name, value.value()));
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
        let wide: Vec<String> = (0..40).map(|i| format!("\"f{i}\": {i}")).collect();
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
                    format!("{{\"x\": {a}, \"y\": [{a}, {b}], \"z\": {b}}}"),
                ]);
                cases.extend(parts.map(|c| format!("[{a}, {a}, {b}, {c}]")));
            }
        }
        cases.extend(
            ["[[[]]]", "[[], [[]]]", "[[[1]], [[2]]]", "18446744073709551615", "[[1, 2], [3]]"].map(str::to_owned),
        );
        cases.push(format!("{{{}}}", wide.join(", ")));
        for case in cases {
            let read = decode(case.as_bytes()).unwrap().0;
            assert_eq!(text(&read), text(&of_tree(&serde_json::from_str(&case).unwrap())), "{case}");
        }
    }

    #[test]
    fn fields_of_one_name_and_rounded_integers_are_told() {
        let wide = |last: usize| {
            let fields: Vec<String> = (0..40).chain([last]).map(|i| format!("\"f{i}\": {i}")).collect();
            decode(format!("{{{}}}", fields.join(",\n")).as_bytes()).map(|(_, notes)| notes)
        };
        assert_eq!(wide(40), Ok(Vec::new()));
        assert!(wide(3).unwrap_err().starts_with("two fields of an object are named “f3” at line 41"), "{:?}", wide(3));
        let error = decode(b"{\"a\": {\"b\": 1, \"c\": 2,\n \"b\": 3}, \"b\": 4}").map(|_| ()).unwrap_err();
        assert!(error.starts_with("two fields of an object are named “b” at line 2"), "{error}");
        let notes = |text: &str| decode(text.as_bytes()).unwrap().1;
        let told = "an integer beyond 2^53 is rounded: 9007199254740993 in line 2, taken as 9007199254740992";
        assert_eq!(
            notes("{\"a\": \"12345678901234567\\\" 9007199254740993\",\n \"b\": [9007199254740993, 1]}"),
            [told]
        );
        assert!(notes("[-123456789012345678901, 36893488147419103231]")[0].starts_with("2 integers beyond 2^53"));
        let told = "a number below the smallest, 4.9e-324, is taken as 0: 1e-400 in line 1";
        assert_eq!(notes("[1e-400, \"1e-400\", 0e-400, 4.9e-324]"), [told]);
        assert!(notes("[1e300, 0.1234567890123456789, 1152921504606846976]").is_empty());
    }
}
