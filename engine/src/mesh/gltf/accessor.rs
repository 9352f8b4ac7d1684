//! Reads accessors as numbers. The readers of the crate `gltf` trust the offsets in a file; these check every one.

use gltf::accessor::sparse::IndexType;
use gltf::accessor::{Accessor, DataType, Dimensions};

use super::parse::Buffer;

/// Most zeros that an accessor without a buffer view may have.
const MAX_IMPLICIT: usize = 1 << 22;

pub(super) struct Accessors<'a> {
    pub document: &'a gltf::Document,
    pub buffers: Vec<Buffer<'a>>,
}

impl Accessors<'_> {
    pub fn view(&self, index: usize) -> Result<&[u8], String> {
        let view = self.document.views().nth(index).ok_or("the glTF file refers to a buffer view it does not have")?;
        self.buffers
            .get(view.buffer().index())
            .and_then(|b| b.bytes().get(view.offset()..view.offset().checked_add(view.length())?))
            .ok_or(format!("buffer view {index} of the glTF file reaches beyond its buffer"))
    }

    /// The numbers of an accessor with `n` components; normalised integers are scaled to 0..1 or −1..1.
    pub fn floats(&self, accessor: &Accessor, n: usize) -> Result<Vec<f32>, String> {
        let kind = accessor.data_type();
        let scale = match kind {
            _ if !accessor.normalized() => 1.0,
            DataType::I8 => 127.0,
            DataType::U8 => 255.0,
            DataType::I16 => 32767.0,
            DataType::U16 => 65535.0,
            _ => 1.0,
        };
        let lowest = if accessor.normalized() { -1.0 } else { f64::NEG_INFINITY };
        self.numbers(accessor, n, |v| (v / scale).max(lowest) as f32)
    }

    pub fn integers(&self, accessor: &Accessor, n: usize) -> Result<Vec<u32>, String> {
        self.numbers(accessor, n, |v| v as u32)
    }

    fn numbers<T: Copy>(&self, accessor: &Accessor, n: usize, convert: impl Fn(f64) -> T) -> Result<Vec<T>, String> {
        let index = accessor.index();
        let found = accessor.dimensions();
        if found.multiplicity() != n || (n == 4 && found == Dimensions::Mat2) {
            return Err(format!("accessor {index} of the glTF file has {} components, not {n}", found.multiplicity()));
        }
        let too_short = || format!("accessor {index} of the glTF file reaches beyond its buffer view");
        let (kind, count) = (accessor.data_type(), accessor.count());
        let size = n * kind.size();
        let number = |kind: DataType, b: &[u8]| convert(number(kind, b));
        let mut values = match accessor.view() {
            Some(view) => {
                let bytes = self.view(view.index())?;
                let stride = view.stride().unwrap_or(size);
                let last = count.checked_sub(1).ok_or(format!("accessor {index} of the glTF file is empty"))?;
                let end = last.checked_mul(stride).and_then(|e| e.checked_add(accessor.offset())?.checked_add(size));
                if stride < size || end.is_none_or(|e| e > bytes.len()) {
                    return Err(too_short());
                }
                let mut values = Vec::with_capacity(count * n);
                for k in 0..count {
                    let item = &bytes[accessor.offset() + k * stride..][..size];
                    values.extend(item.chunks_exact(kind.size()).map(|b| number(kind, b)));
                }
                values
            }
            None if count <= MAX_IMPLICIT => vec![convert(0.0); count * n],
            None => return Err(format!("accessor {index} of the glTF file asks for {count} zeros")),
        };
        if let Some(sparse) = accessor.sparse() {
            let index_kind = match sparse.indices().index_type() {
                IndexType::U8 => DataType::U8,
                IndexType::U16 => DataType::U16,
                IndexType::U32 => DataType::U32,
            };
            let slice = |view: usize, offset: usize, bytes: usize| {
                self.view(view)?.get(offset..).and_then(|b| b.get(..bytes)).ok_or_else(too_short)
            };
            let count = sparse.count().min(values.len());
            let (at, with) = (sparse.indices(), sparse.values());
            let at = slice(at.view().index(), at.offset(), count * index_kind.size())?;
            let with = slice(with.view().index(), with.offset(), count * size)?;
            for (at, with) in at.chunks_exact(index_kind.size()).zip(with.chunks_exact(size)) {
                let at = self::number(index_kind, at) as usize;
                let to = at.checked_mul(n).and_then(|i| values.get_mut(i..)?.get_mut(..n)).ok_or_else(too_short)?;
                to.iter_mut().zip(with.chunks_exact(kind.size())).for_each(|(v, b)| *v = number(kind, b));
            }
        }
        Ok(values)
    }
}

fn number(kind: DataType, b: &[u8]) -> f64 {
    match kind {
        DataType::I8 => f64::from(b[0] as i8),
        DataType::U8 => f64::from(b[0]),
        DataType::I16 => f64::from(i16::from_le_bytes([b[0], b[1]])),
        DataType::U16 => f64::from(u16::from_le_bytes([b[0], b[1]])),
        DataType::U32 => f64::from(u32::from_le_bytes([b[0], b[1], b[2], b[3]])),
        DataType::F32 => f64::from(f32::from_le_bytes([b[0], b[1], b[2], b[3]])),
    }
}
