//! Writes `.safetensors` files: the length of the header (eight bytes), the header in JSON with type, shape and byte range of each array,
//! and the numbers.

use serde_json::{Map, Value, json};

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
}
