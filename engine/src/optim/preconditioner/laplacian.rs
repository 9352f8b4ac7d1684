//! Smooth steps, for the vertices of meshes.

use crate::stop::Pace;

/// M = W (I + λL)⁻¹ Wᵀ, where L = D − A is the combinatorial Laplacian of the mesh's edges (Nicolet, Jacobson & Jakob 2021, "Large Steps in
/// Inverse Rendering of Geometry", eq. 9), and W copies each welded position to the vertices that are there, so that seams stay closed.
///
/// The system is solved by conjugate gradients: with its diagonal as preconditioner its condition number is at most about 2λ times the
/// vertices' degree, so that a hundred iterations do, and meshes of any size take no more memory than their edges. (A sparse Cholesky
/// factorisation would take a tenth of the time for each step, a small part of a rendering's, and half a minute of everybody's build.)
#[derive(Debug, PartialEq)]
pub struct Laplacian {
    /// By vertex: its welded position.
    place: Vec<u32>,
    /// By position: where its neighbours begin in `neighbours`; one more entry at the end.
    starts: Vec<usize>,
    neighbours: Vec<u32>,
    lambda: f64,
}

impl Laplacian {
    /// For vertices at the welded positions `place`, of which there are `places`, that `edges` join. `lambda` is positive.
    pub fn new(place: Vec<u32>, places: usize, edges: &[[u32; 2]], lambda: f64) -> Laplacian {
        let mut starts = vec![0; places + 1];
        for &[i, j] in edges {
            starts[i as usize + 1] += 1;
            starts[j as usize + 1] += 1;
        }
        for i in 0..places {
            starts[i + 1] += starts[i];
        }
        let mut next = starts.clone();
        let mut neighbours = vec![0; 2 * edges.len()];
        for &[i, j] in edges {
            for (from, to) in [(i, j), (j, i)] {
                neighbours[next[from as usize]] = to;
                next[from as usize] += 1;
            }
        }
        Laplacian { place, starts, neighbours, lambda }
    }

    fn places(&self) -> usize {
        self.starts.len() - 1
    }

    /// M x, which is also Mᵀ x; `x` has the same number of components for each vertex.
    pub fn apply(&self, x: &[f64]) -> Vec<f64> {
        let width = x.len() / self.place.len().max(1);
        let mut out = vec![0.0; x.len()];
        // Three components at a time take little longer than one.
        let mut first = 0;
        while first < width {
            match width - first {
                1 => self.apply_to::<1>(x, width, first, &mut out),
                2 => self.apply_to::<2>(x, width, first, &mut out),
                _ => self.apply_to::<3>(x, width, first, &mut out),
            }
            first += 3;
        }
        out
    }

    /// M x for `N` of the `width` components, from `first` on.
    fn apply_to<const N: usize>(&self, x: &[f64], width: usize, first: usize, out: &mut [f64]) {
        let mut sums = vec![[0.0; N]; self.places()];
        for (numbers, &place) in x.chunks_exact(width).zip(&self.place) {
            for (sum, number) in sums[place as usize].iter_mut().zip(&numbers[first..]) {
                *sum += number;
            }
        }
        let solution = self.solve(sums);
        for (numbers, &place) in out.chunks_exact_mut(width).zip(&self.place) {
            numbers[first..first + N].copy_from_slice(&solution[place as usize]);
        }
    }

    /// Solves (I + λL) x = b for `N` right-hand sides by conjugate gradients (Hestenes & Stiefel 1952) with the diagonal as preconditioner.
    fn solve<const N: usize>(&self, b: Vec<[f64; N]>) -> Vec<[f64; N]> {
        /// Of the residual, relative to the right-hand side.
        const TOLERANCE: f64 = 1e-8;
        const MOST_ITERATIONS: usize = 10_000;
        let mut pace = Pace::default();
        let diagonal: Vec<f64> =
            self.starts.windows(2).map(|ends| 1.0 + self.lambda * (ends[1] - ends[0]) as f64).collect();
        let scaled =
            |r: &[[f64; N]]| -> Vec<[f64; N]> { r.iter().zip(&diagonal).map(|(r, d)| r.map(|r| r / d)).collect() };
        let mut x = vec![[0.0; N]; b.len()];
        let mut residual = b;
        let enough = dots(&residual, &residual).map(|square| square * TOLERANCE * TOLERANCE);
        let mut z = scaled(&residual);
        let mut direction = z.clone();
        let mut weight = dots(&residual, &z);
        for _ in 0..MOST_ITERATIONS {
            pace.step(8 * x.len());
            let squares = dots(&residual, &residual);
            if squares.iter().zip(enough).all(|(square, enough)| *square <= enough) {
                break;
            }
            let image = self.matrix_times(&direction, &diagonal);
            let curvature = dots(&direction, &image);
            // A right-hand side that is solved to the last digit has no direction any more.
            let step: [f64; N] =
                std::array::from_fn(|k| if curvature[k] > 0.0 { weight[k] / curvature[k] } else { 0.0 });
            for (((x, r), p), q) in x.iter_mut().zip(&mut residual).zip(&direction).zip(&image) {
                for k in 0..N {
                    x[k] += step[k] * p[k];
                    r[k] -= step[k] * q[k];
                }
            }
            z = scaled(&residual);
            let next = dots(&residual, &z);
            let turn: [f64; N] = std::array::from_fn(|k| if weight[k] > 0.0 { next[k] / weight[k] } else { 0.0 });
            for (p, z) in direction.iter_mut().zip(&z) {
                for k in 0..N {
                    p[k] = z[k] + turn[k] * p[k];
                }
            }
            weight = next;
        }
        x
    }

    /// (I + λL) x, whose diagonal is `diagonal`.
    fn matrix_times<const N: usize>(&self, x: &[[f64; N]], diagonal: &[f64]) -> Vec<[f64; N]> {
        let row = |i: usize| {
            let mut sum = [0.0; N];
            for &neighbour in &self.neighbours[self.starts[i]..self.starts[i + 1]] {
                for (sum, x) in sum.iter_mut().zip(x[neighbour as usize]) {
                    *sum += x;
                }
            }
            std::array::from_fn(|k| diagonal[i] * x[i][k] - self.lambda * sum[k])
        };
        (0..x.len()).map(row).collect()
    }
}

/// The scalar products of the components.
fn dots<const N: usize>(a: &[[f64; N]], b: &[[f64; N]]) -> [f64; N] {
    let mut sums = [0.0; N];
    for (a, b) in a.iter().zip(b) {
        for k in 0..N {
            sums[k] += a[k] * b[k];
        }
    }
    sums
}

#[cfg(test)]
mod tests {
    use super::super::tests::{dot, numbers};
    use super::*;

    #[test]
    fn a_path_of_three_vertices_is_solved_by_hand() {
        // I + L of a path: [[2, −1, 0], [−1, 3, −1], [0, −1, 2]]; its inverse times [8, 0, 0] is [5, 2, 1].
        let laplacian = Laplacian::new(vec![0, 1, 2], 3, &[[0, 1], [2, 1]], 1.0);
        let found = laplacian.apply(&[8.0, 0.0, 0.0]);
        for (found, expected) in found.iter().zip([5.0, 2.0, 1.0]) {
            assert!((found - expected).abs() < 1e-7, "{found} {expected}");
        }
    }

    #[test]
    fn what_moves_together_keeps_its_step_and_seams_stay_closed() {
        // A closed ring of 40 positions, of which the first is there twice; three components each.
        let n = 40;
        let place: Vec<u32> = (0..n).chain([0]).collect();
        let edges: Vec<[u32; 2]> = (0..n).map(|i| [i, (i + 1) % n]).collect();
        let laplacian = Laplacian::new(place, n as usize, &edges, 19.0);
        // (I + λL) maps constants to themselves: each position moves by the sum over its vertices, smoothed.
        let mut same = vec![0.5; 3 * (n as usize + 1)];
        same[0..3].fill(0.25);
        same[3 * n as usize..].fill(0.25);
        assert!(laplacian.apply(&same).iter().all(|x| (x - 0.5).abs() < 1e-7));
        let any = numbers(3 * (n as usize + 1));
        let moved = laplacian.apply(&any);
        assert_eq!(moved[0..3], moved[3 * n as usize..]);
        // What alternates from vertex to vertex is damped by 1 + 4λ.
        let zigzag: Vec<f64> = (0..=n)
            .map(|i| {
                if i == n {
                    0.0
                } else if i % 2 == 0 {
                    77.0
                } else {
                    -77.0
                }
            })
            .collect();
        let damped = laplacian.apply(&zigzag);
        assert!((damped[0] - 1.0).abs() < 1e-6 && (damped[1] + 1.0).abs() < 1e-6, "{damped:?}");
    }

    #[test]
    fn it_is_its_own_transpose() {
        let ring = Laplacian::new(vec![0, 1, 2, 0], 3, &[[0, 1], [1, 2], [0, 2]], 3.0);
        for width in [1, 2, 3, 4, 7] {
            let (g, u) = (numbers(4 * width), numbers(4 * width + 5)[5..].to_vec());
            let (a, b) = (dot(&ring.apply(&g), &u), dot(&g, &ring.apply(&u)));
            assert!((a - b).abs() < 1e-7 * (1.0 + a.abs()), "{width}: {a} {b}");
        }
    }
}
