//! Products of matrices. This is the one place that calls `matrixmultiply`, whose functions take pointers.

/// A matrix in a slice: the distances between the numbers of one column and between those of one row.
#[derive(Clone, Copy)]
pub struct Matrix<'a> {
    pub data: &'a [f32],
    pub row_stride: usize,
    pub column_stride: usize,
}

impl<'a> Matrix<'a> {
    /// Rows one after the other, each of `columns` numbers.
    pub fn rows(data: &'a [f32], columns: usize) -> Matrix<'a> {
        Matrix { data, row_stride: columns, column_stride: 1 }
    }

    pub fn transposed(self) -> Matrix<'a> {
        Matrix { row_stride: self.column_stride, column_stride: self.row_stride, ..self }
    }

    /// The matrix without its first columns.
    pub fn columns_from(self, first: usize) -> Matrix<'a> {
        Matrix { data: &self.data[first * self.column_stride..], ..self }
    }
}

/// `out = a b` of an `m × k` and a `k × n` matrix. Rows of `out` are `stride` numbers apart. Each number is a sum in an order that depends
/// on `k` only, so that it does not matter how a product is divided into parts.
#[allow(unsafe_code)]
pub fn product(out: &mut [f32], stride: usize, a: Matrix, b: Matrix, [m, k, n]: [usize; 3]) {
    if m == 0 || n == 0 {
        return;
    }
    let reach = |rows: usize, columns: usize, row: usize, column: usize| match (rows, columns) {
        (0, _) | (_, 0) => 0,
        _ => (rows - 1) * row + (columns - 1) * column + 1,
    };
    assert!(reach(m, k, a.row_stride, a.column_stride) <= a.data.len(), "the left matrix is too small");
    assert!(reach(k, n, b.row_stride, b.column_stride) <= b.data.len(), "the right matrix is too small");
    assert!(n <= stride && reach(m, n, stride, 1) <= out.len(), "the result is too small");
    let [a_row, a_column, b_row, b_column, out_row] =
        [a.row_stride, a.column_stride, b.row_stride, b.column_stride, stride].map(|s| s as isize);
    // SAFETY: all offsets that are read or written are below `reach`, and so within the slices; rows of `out` do not overlap.
    unsafe {
        let (a, b, out) = (a.data.as_ptr(), b.data.as_ptr(), out.as_mut_ptr());
        matrixmultiply::sgemm(m, k, n, 1.0, a, a_row, a_column, b, b_row, b_column, 0.0, out, out_row, 1);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn numbers(n: usize, seed: u64) -> Vec<f32> {
        (0..n as u64).map(|i| ((i * 7919 + seed * 104_729) % 201) as f32 / 100.0 - 1.0).collect()
    }

    #[test]
    fn products_are_sums_of_products_however_they_are_divided() {
        for [m, k, n] in [[1, 1, 1], [3, 5, 2], [17, 300, 9], [1, 40, 33], [5, 0, 4], [64, 27, 32]] {
            let (a, b) = (numbers(m * k, 1), numbers(k * n, 2));
            let mut out = vec![9.0; m * n];
            product(&mut out, n, Matrix::rows(&a, k), Matrix::rows(&b, n), [m, k, n]);
            for (i, found) in out.iter().enumerate() {
                let (row, column) = (i / n, i % n);
                let sum: f64 = (0..k).map(|j| f64::from(a[row * k + j]) * f64::from(b[j * n + column])).sum();
                assert!((f64::from(*found) - sum).abs() < 1e-4, "{m}×{k}×{n}");
            }
            // Row by row, column by column, and from transposed matrices.
            let mut parts = vec![0.0; m * n];
            for (row, part) in parts.chunks_mut(n).enumerate() {
                for column in 0..n {
                    let b = Matrix::rows(&b, n).columns_from(column.min(k * n));
                    let out = &mut part[column..=column];
                    product(out, 1, Matrix::rows(&a[row * k..], k), b, [1, k, 1]);
                }
            }
            assert_eq!(out, parts, "{m}×{k}×{n}");
            let across: Vec<f32> = (0..k * n).map(|i| b[(i % k.max(1)) * n + i / k.max(1)]).collect();
            product(&mut parts, n, Matrix::rows(&a, k), Matrix::rows(&across, k).transposed(), [m, k, n]);
            assert_eq!(out, parts, "{m}×{k}×{n}");
        }
    }
}
