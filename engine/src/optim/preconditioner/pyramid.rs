//! Steps of every size of detail, for textures, environments and heights.

/// M = [I, U₁, U₁U₂, …]: a grid is the sum of its levels, each of half the size of the one before and interpolated up to it by U (the
/// Laplacian pyramid of Burt & Adelson 1983). A number of a coarse level collects the derivatives of all that lies under it, in which noise
/// averages out, and a solver that gives each number the same rate moves large areas together from the first step on, and single texels
/// where that remains to be done (after Weier et al. 2025, "Practical Inverse Rendering of Textured and Translucent Appearance").
#[derive(Debug, PartialEq)]
pub struct Pyramid {
    /// Height and width of each level, the finest first.
    sizes: Vec<[usize; 2]>,
    channels: usize,
}

impl Pyramid {
    /// The levels of a param of this shape: `[height, width]`, `[height, width, channels]`, `[count]` or `[count, channels]`, where up to four
    /// numbers in the last place are the channels of a colour or a vector. `None` stands for all levels, down to a single number;
    /// there are never more. `None` if the param is no grid.
    pub fn new(shape: &[usize], levels: Option<usize>) -> Option<Pyramid> {
        let (grid, channels) = match shape {
            [grid @ .., channels] if !grid.is_empty() && *channels <= 4 => (grid, *channels),
            grid => (grid, 1),
        };
        let finest = match *grid {
            [count] => [1, count],
            [height, width] => [height, width],
            _ => return None,
        };
        if finest.contains(&0) || channels == 0 {
            return None;
        }
        let mut sizes = vec![finest];
        while let Some(&last) = sizes.last().filter(|last| **last != [1, 1] && levels.is_none_or(|n| sizes.len() < n)) {
            sizes.push(last.map(|n| n.div_ceil(2)));
        }
        Some(Pyramid { sizes, channels })
    }

    fn numbers(&self, level: usize) -> usize {
        self.sizes[level][0] * self.sizes[level][1] * self.channels
    }

    /// Numbers of all levels.
    pub fn variables(&self) -> usize {
        (0..self.sizes.len()).map(|level| self.numbers(level)).sum()
    }

    /// M u: the sum of the levels, which are in `update` one after another, the finest first.
    pub fn change(&self, update: &[f64]) -> Vec<f64> {
        let mut end = update.len();
        let mut sum = Vec::new();
        for level in (0..self.sizes.len()).rev() {
            let mut own = update[end - self.numbers(level)..end].to_vec();
            end -= own.len();
            if !sum.is_empty() {
                self.each_weight(level, |fine, coarse, weight| own[fine] += weight * sum[coarse]);
            }
            sum = own;
        }
        sum
    }

    /// Mᵀ g.
    pub fn gradient(&self, gradient: &[f64]) -> Vec<f64> {
        let mut out = gradient.to_vec();
        let mut start = 0;
        for level in 1..self.sizes.len() {
            let end = out.len();
            out.resize(end + self.numbers(level), 0.0);
            let (finer, own) = out.split_at_mut(end);
            self.each_weight(level - 1, |fine, coarse, weight| own[coarse] += weight * finer[start + fine]);
            start = end;
        }
        out
    }

    /// The entries of the matrix that interpolates the level after `level` up to it, bilinearly between centres: (row, column, weight).
    fn each_weight(&self, level: usize, mut entry: impl FnMut(usize, usize, f64)) {
        let ([_, width], [_, coarse_width]) = (self.sizes[level], self.sizes[level + 1]);
        let [rows, columns] = [0, 1].map(|axis| interpolation(self.sizes[level][axis], self.sizes[level + 1][axis]));
        for (y, row) in rows.iter().enumerate() {
            for (x, column) in columns.iter().enumerate() {
                for &(above, by_row) in row {
                    for &(left, by_column) in column {
                        let weight = by_row * by_column;
                        if weight == 0.0 {
                            continue;
                        }
                        let (fine, coarse) = (y * width + x, above * coarse_width + left);
                        for channel in 0..self.channels {
                            entry(fine * self.channels + channel, coarse * self.channels + channel, weight);
                        }
                    }
                }
            }
        }
    }
}

/// For each of `fine` cells, the two of `coarse` cells of twice the width between whose centres its own lies, with their weights.
fn interpolation(fine: usize, coarse: usize) -> Vec<[(usize, f64); 2]> {
    let last = coarse - 1;
    let cell = |i: usize| {
        let at = ((i as f64 + 0.5) / 2.0 - 0.5).clamp(0.0, last as f64);
        // A grid that is not halved (of one cell) stays as it is.
        let at = if fine == coarse { i as f64 } else { at };
        let left = (at as usize).min(last);
        let share = at - left as f64;
        [(left, 1.0 - share), ((left + 1).min(last), share)]
    };
    (0..fine).map(cell).collect()
}

#[cfg(test)]
mod tests {
    use super::super::tests::{dot, numbers};
    use super::*;

    #[test]
    fn shapes_are_grids_with_channels() {
        let sizes = |shape: &[usize], levels| Pyramid::new(shape, levels).map(|p| (p.sizes, p.channels));
        assert_eq!(sizes(&[5, 8], None), Some((vec![[5, 8], [3, 4], [2, 2], [1, 1]], 1)));
        assert_eq!(sizes(&[16, 16, 3], Some(2)), Some((vec![[16, 16], [8, 8]], 3)));
        assert_eq!(sizes(&[6, 3], Some(9)), Some((vec![[1, 6], [1, 3], [1, 2], [1, 1]], 3)));
        assert_eq!(sizes(&[2], None), Some((vec![[1, 2], [1, 1]], 1)));
        assert_eq!(sizes(&[7, 7, 7], None), None);
        assert_eq!(sizes(&[0, 7], None), None);
    }

    #[test]
    fn levels_add_up() {
        // Four numbers over two over one: each finer number lies a quarter from its coarse centre towards the other.
        let pyramid = Pyramid::new(&[4], None).unwrap();
        assert_eq!(pyramid.variables(), 7);
        assert_eq!(pyramid.change(&[0.0, 0.0, 0.0, 0.0, 4.0, 8.0, 0.5]), [4.5, 5.5, 7.5, 8.5]);
        assert_eq!(pyramid.change(&[1.0, 2.0, 3.0, 4.0, 0.0, 0.0, 0.0]), [1.0, 2.0, 3.0, 4.0]);
        // What is the same everywhere is the same on every level: levels move a constant by the sum of their steps.
        let pyramid = Pyramid::new(&[5, 7, 3], None).unwrap();
        let change = pyramid.change(&vec![1.0; pyramid.variables()]);
        assert!(change.len() == 105 && change.iter().all(|x| (x - 4.0).abs() < 1e-12));
    }

    #[test]
    fn gradients_go_the_way_back() {
        for shape in [&[5, 7, 3][..], &[8, 8], &[1, 9], &[6, 2], &[3]] {
            let pyramid = Pyramid::new(shape, None).unwrap();
            let (g, u) = (numbers(shape.iter().product()), numbers(pyramid.variables() + 5)[5..].to_vec());
            let (a, b) = (dot(&pyramid.change(&u), &g), dot(&pyramid.gradient(&g), &u));
            assert!((a - b).abs() < 1e-10 * (1.0 + a.abs()), "{shape:?}: {a} {b}");
        }
    }
}
