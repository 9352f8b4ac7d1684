//! NumPy's `.npy` files (numpy.lib.format, versions 1 to 3): one array of numbers.

use super::safetensors::half;
use super::{Noted, Rounded};
use crate::memory;
use crate::tape::Tensor;

/// An array of booleans, whole or floating-point numbers, in either order of bytes and of axes: its numbers row by row.
pub fn decode(bytes: &[u8]) -> Result<Noted<Tensor>, String> {
    let rest = bytes.strip_prefix(b"\x93NUMPY").ok_or("this is no .npy file")?;
    let cut = "the file ends within its header";
    let (version, rest) = rest.split_at_checked(2).ok_or(cut)?;
    let size = if version[0] == 1 { 2 } else { 4 };
    let (length, rest) = rest.split_at_checked(size).ok_or(cut)?;
    let length = length.iter().rev().fold(0usize, |n, b| n << 8 | usize::from(*b));
    let (header, data) = rest.split_at_checked(length).ok_or(cut)?;
    let header = String::from_utf8_lossy(header);
    let kind = after(&header, "descr").and_then(quoted).ok_or_else(|| {
        "its elements are records or of no type that is known; numbers of one type are read".to_owned()
    })?;
    let fortran = after(&header, "fortran_order").is_some_and(|rest| rest.starts_with("True"));
    let shape = after(&header, "shape").and_then(shape).ok_or("its header has no shape")?;
    let count = shape.iter().try_fold(1usize, |n, side| n.checked_mul(*side)).ok_or("its shape is too large")?;
    let (order, kind) = kind.split_at_checked(1).unwrap_or(("", ""));
    let big = order == ">";
    let unknown = || {
        format!(
            "elements of type “{order}{kind}” are not read; floating-point numbers of 16 to 64 bits, integers and booleans are"
        )
    };
    let width = kind.get(1..).and_then(|w| w.parse::<usize>().ok()).filter(|w| *w <= 8).ok_or_else(unknown)?;
    let needed = count.checked_mul(width).ok_or("its shape is too large")?;
    if data.len() < needed {
        return Err(format!("it promises {needed} bytes of numbers and has {}", data.len()));
    }
    memory::ask_for::<f64>(count).map_err(|e| e.to_string())?;
    let read: fn([u8; 8]) -> f64 = match kind {
        "f2" => |b| f64::from(half(u16::from_le_bytes([b[0], b[1]]))),
        "f4" => |b| f64::from(f32::from_le_bytes([b[0], b[1], b[2], b[3]])),
        "f8" => f64::from_le_bytes,
        "u1" => |b| f64::from(b[0]),
        "b1" => |b| f64::from(u8::from(b[0] != 0)),
        "i1" => |b| f64::from(b[0] as i8),
        "u2" => |b| f64::from(u16::from_le_bytes([b[0], b[1]])),
        "i2" => |b| f64::from(i16::from_le_bytes([b[0], b[1]])),
        "u4" => |b| f64::from(u32::from_le_bytes([b[0], b[1], b[2], b[3]])),
        "i4" => |b| f64::from(i32::from_le_bytes([b[0], b[1], b[2], b[3]])),
        "u8" => |b| u64::from_le_bytes(b) as f64,
        "i8" => |b| i64::from_le_bytes(b) as f64,
        _ => return Err(unknown()),
    };
    let element = |bytes: &[u8]| {
        let mut all = [0u8; 8];
        all[..width].copy_from_slice(bytes);
        if big {
            all[..width].reverse();
        }
        all
    };
    let elements = || data[..needed].chunks_exact(width.max(1)).map(element);
    let stored: Vec<f64> = elements().map(read).collect();
    let mut rounded = Rounded::default();
    // Only what comes out above 2^53, or as that, may have been rounded.
    for (i, (element, _)) in elements().zip(&stored).enumerate().filter(|(_, (_, x))| x.abs() >= (1_u64 << 53) as f64) {
        let place = || format!("at {i} in the order of the file");
        match kind {
            "u8" => rounded.see(&u64::from_le_bytes(element).to_string(), place),
            "i8" => rounded.see(&i64::from_le_bytes(element).to_string(), place),
            _ => break,
        }
    }
    let more = data.len() - needed;
    let left = (more > 0).then(|| format!("{more} bytes after the numbers that its shape promises are left out"));
    let data = if fortran { by_rows(&stored, &shape)? } else { stored };
    Ok((Tensor { shape, data }, rounded.note().into_iter().chain(left).collect()))
}

/// The `.npy` file of an array: doubles, little-endian, row by row.
pub fn encode(array: &Tensor) -> Vec<u8> {
    let mut bytes = header(array, "<f8", 8);
    array.data.iter().for_each(|x| bytes.extend(x.to_le_bytes()));
    bytes
}

/// The `.npy` file of an array of truth values: a byte for each, 0 or 1.
pub fn encode_truths(array: &Tensor) -> Vec<u8> {
    let mut bytes = header(array, "|b1", 1);
    bytes.extend(array.data.iter().map(|x| u8::from(*x != 0.0)));
    bytes
}

/// What stands before the numbers of a file, with room for them: `width` bytes each, as `descr` names them.
fn header(array: &Tensor, descr: &str, width: usize) -> Vec<u8> {
    let sides: String = array.shape.iter().map(|n| format!("{n},")).collect();
    let mut header = format!("{{'descr': '{descr}', 'fortran_order': False, 'shape': ({sides}), }}");
    // Numbers begin at a multiple of 64 bytes.
    let padding = 63 - (10 + header.len()) % 64;
    header.extend(std::iter::repeat_n(' ', padding));
    header.push('\n');
    let mut bytes = Vec::with_capacity(10 + header.len() + width * array.len());
    bytes.extend(b"\x93NUMPY\x01\x00");
    // A shape has so few numbers that this is far below 64 kB.
    bytes.extend((header.len() as u16).to_le_bytes());
    bytes.extend(header.as_bytes());
    bytes
}

/// What follows a key of the header, which is a Python dictionary.
fn after<'a>(header: &'a str, key: &str) -> Option<&'a str> {
    let at = ["'", "\""].iter().find_map(|q| header.find(&format!("{q}{key}{q}")))?;
    Some(header[at..].split_once(':')?.1.trim_start())
}

fn quoted(text: &str) -> Option<&str> {
    let quote = text.chars().next().filter(|c| matches!(c, '\'' | '"'))?;
    text[1..].split_once(quote).map(|(inside, _)| inside)
}

fn shape(text: &str) -> Option<Vec<usize>> {
    let inside = text.strip_prefix('(')?.split_once(')')?.0;
    let sides = inside.split(',').map(str::trim).filter(|s| !s.is_empty());
    // Python 2 wrote long integers with an L.
    sides.map(|s| s.trim_end_matches('L').parse().ok()).collect()
}

/// Numbers whose first index runs fastest, with the last one fastest.
fn by_rows(stored: &[f64], shape: &[usize]) -> Result<Vec<f64>, String> {
    memory::ask_for::<f64>(stored.len()).map_err(|e| e.to_string())?;
    let mut strides = vec![1usize; shape.len()];
    for axis in 1..shape.len() {
        strides[axis] = strides[axis - 1] * shape[axis - 1];
    }
    let mut index = vec![0usize; shape.len()];
    let mut at = 0;
    let mut out = Vec::with_capacity(stored.len());
    for _ in 0..stored.len() {
        out.push(stored[at]);
        for axis in (0..shape.len()).rev() {
            index[axis] += 1;
            at += strides[axis];
            if index[axis] < shape[axis] {
                break;
            }
            at -= strides[axis] * shape[axis];
            index[axis] = 0;
        }
    }
    Ok(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A file as NumPy writes it.
    fn file(descr: &str, fortran: bool, shape: &str, data: &[u8]) -> Vec<u8> {
        let order = if fortran { "True" } else { "False" };
        let header = format!("{{'descr': '{descr}', 'fortran_order': {order}, 'shape': {shape}, }}\n");
        [b"\x93NUMPY\x01\x00", &(header.len() as u16).to_le_bytes()[..], header.as_bytes(), data].concat()
    }

    #[test]
    fn every_type_and_order_of_bytes_is_read() {
        let array = |descr: &str, data: &[u8]| decode(&file(descr, false, "(2,)", data)).map(|(array, _)| array.data);
        let both = |a: &[u8], b: &[u8]| [a, b].concat();
        assert_eq!(array("<f2", &both(&0x3e00u16.to_le_bytes(), &0xc000u16.to_le_bytes())), Ok(vec![1.5, -2.0]));
        assert_eq!(array("<f4", &both(&1.5f32.to_le_bytes(), &(-2f32).to_le_bytes())), Ok(vec![1.5, -2.0]));
        assert_eq!(array(">f4", &both(&1.5f32.to_be_bytes(), &(-2f32).to_be_bytes())), Ok(vec![1.5, -2.0]));
        assert_eq!(array("<f8", &both(&0.1f64.to_le_bytes(), &f64::MIN.to_le_bytes())), Ok(vec![0.1, f64::MIN]));
        assert_eq!(array(">f8", &both(&0.1f64.to_be_bytes(), &7f64.to_be_bytes())), Ok(vec![0.1, 7.0]));
        assert_eq!(array("|b1", &[0, 1]), Ok(vec![0.0, 1.0]));
        assert_eq!(array("|u1", &[0, 255]), Ok(vec![0.0, 255.0]));
        assert_eq!(array("|i1", &[127, 255]), Ok(vec![127.0, -1.0]));
        assert_eq!(array("<i2", &[0, 1, 0xff, 0xff]), Ok(vec![256.0, -1.0]));
        assert_eq!(array(">u2", &[1, 0, 0xff, 0xff]), Ok(vec![256.0, 65535.0]));
        assert_eq!(array("<i4", &both(&(-5i32).to_le_bytes(), &7i32.to_le_bytes())), Ok(vec![-5.0, 7.0]));
        assert_eq!(array(">i8", &both(&(-5i64).to_be_bytes(), &7i64.to_be_bytes())), Ok(vec![-5.0, 7.0]));
        assert_eq!(array("<u8", &both(&5u64.to_le_bytes(), &7u64.to_le_bytes())), Ok(vec![5.0, 7.0]));
        let notes = |descr: &str, data: &[u8]| decode(&file(descr, false, "(2,)", data)).unwrap().1;
        let odd = (1_u64 << 53) + 1;
        assert_eq!(
            notes("<i8", &both(&7i64.to_le_bytes(), &(-(odd as i64)).to_le_bytes())),
            [
                "an integer beyond 2^53 is rounded: -9007199254740993 at 1 in the order of the file, taken as -9007199254740992"
            ]
        );
        assert!(notes(">u8", &both(&u64::MAX.to_be_bytes(), &odd.to_be_bytes()))[0].starts_with("2 integers beyond"));
        assert!(notes("<u8", &both(&(1_u64 << 60).to_le_bytes(), &0_u64.to_le_bytes())).is_empty());
        assert!(notes("<f8", &both(&1e300f64.to_le_bytes(), &1e17f64.to_le_bytes())).is_empty());
        assert_eq!(notes("|u1", &[1, 2, 3, 4, 5]), ["3 bytes after the numbers that its shape promises are left out"]);
        assert!(array("<c8", &[0; 16]).unwrap_err().contains("“<c8” are not read"));
        assert!(array("<f8", &[0; 15]).unwrap_err().contains("promises 16 bytes"));
    }

    #[test]
    fn columns_first_is_turned_round() {
        let data: Vec<u8> = [1u8, 2, 3, 4, 5, 6].to_vec();
        let found = |fortran, shape| decode(&file("|u1", fortran, shape, &data)).map(|(array, _)| array);
        let rows = found(false, "(2, 3)").unwrap();
        assert_eq!((rows.shape, rows.data), (vec![2, 3], vec![1.0, 2.0, 3.0, 4.0, 5.0, 6.0]));
        let columns = found(true, "(2, 3)").unwrap();
        assert_eq!((columns.shape, columns.data), (vec![2, 3], vec![1.0, 3.0, 5.0, 2.0, 4.0, 6.0]));
    }

    #[test]
    fn what_is_written_is_read() {
        for shape in [vec![], vec![0], vec![3], vec![2, 3], vec![2, 1, 4]] {
            let n: usize = shape.iter().product();
            let array = Tensor { shape, data: (0..n).map(|i| i as f64 / 7.0 - 1e300).collect() };
            let bytes = encode(&array);
            assert_eq!(bytes.len() % 64, n * 8 % 64, "the numbers are aligned");
            assert_eq!(decode(&bytes), Ok((array, Vec::new())));
        }
        let truths = Tensor { shape: vec![2, 2], data: vec![1.0, 0.0, 0.0, 1.0] };
        let bytes = encode_truths(&truths);
        assert_eq!(bytes.len() % 64, 4, "a byte each");
        assert_eq!(decode(&bytes), Ok((truths, Vec::new())));
    }
}
