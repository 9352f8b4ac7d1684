//! Nearest neighbour search with a k-d tree.

use std::sync::Arc;

use crate::stop;

/// A balanced k-d tree. The points of every subtree are a range of `order`; the point in the middle of the range is the root and splits
/// the others along the longest side of their bounding box.
pub struct Nearest {
    points: Arc<[[f64; 3]]>,
    order: Vec<u32>,
    /// For the middle of each range: the axis along which the range is split.
    axes: Vec<u8>,
}

impl Nearest {
    /// Builds a tree of points, which must be finite, at least one and fewer than 2³².
    pub fn new(points: Arc<[[f64; 3]]>) -> Nearest {
        let mut order: Vec<u32> = (0..points.len() as u32).collect();
        let mut axes = vec![0; points.len()];
        split(&points, &mut order, &mut axes);
        Nearest { points, order, axes }
    }

    /// Index of the point that is nearest to `p`. Of points at equal distances, the one with the lowest index.
    pub fn find(&self, p: [f64; 3]) -> u32 {
        let mut best = (f64::INFINITY, u32::MAX);
        self.search(p, 0, self.order.len(), &mut best);
        best.1
    }

    fn search(&self, p: [f64; 3], start: usize, end: usize, best: &mut (f64, u32)) {
        if start >= end {
            return;
        }
        let middle = start + (end - start) / 2;
        let index = self.order[middle];
        let at = self.points[index as usize];
        let distance = (0..3).map(|k| (p[k] - at[k]).powi(2)).sum::<f64>();
        if (distance, index) < *best {
            *best = (distance, index);
        }
        let axis = self.axes[middle] as usize;
        let off = p[axis] - at[axis];
        let (near, far) =
            if off < 0.0 { ((start, middle), (middle + 1, end)) } else { ((middle + 1, end), (start, middle)) };
        self.search(p, near.0, near.1, best);
        // A subtree at exactly the same distance is searched too, because it may have a point with a lower index.
        if off * off <= best.0 {
            self.search(p, far.0, far.1, best);
        }
    }
}

fn split(points: &[[f64; 3]], order: &mut [u32], axes: &mut [u8]) {
    if order.len() < 2 {
        return;
    }
    if order.len() > 1 << 10 {
        stop::check();
    }
    let (mut low, mut high) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
    for p in order.iter().map(|i| points[*i as usize]) {
        for k in 0..3 {
            low[k] = low[k].min(p[k]);
            high[k] = high[k].max(p[k]);
        }
    }
    let axis = (0..3).max_by(|&i, &j| (high[i] - low[i]).total_cmp(&(high[j] - low[j]))).unwrap_or(0);
    let middle = order.len() / 2;
    let at = |i: &u32| points[*i as usize][axis];
    order.select_nth_unstable_by(middle, |i, j| at(i).total_cmp(&at(j)).then(i.cmp(j)));
    axes[middle] = axis as u8;
    let (before, rest) = order.split_at_mut(middle);
    let (axes_before, axes_rest) = axes.split_at_mut(middle);
    split(points, before, axes_before);
    split(points, &mut rest[1..], &mut axes_rest[1..]);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nearest_is_that_of_a_search_through_all() {
        let mut state = 1u64;
        let mut next = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            // Few different values, so that many points are equally near or the same.
            ((state >> 33) % 17) as f64
        };
        for n in [1, 2, 3, 50, 700] {
            let points: Arc<[[f64; 3]]> = (0..n).map(|_| [next(), next(), 0.5 * next()]).collect();
            let tree = Nearest::new(points.clone());
            for _ in 0..200 {
                let p = [next() + 0.5, next(), next()];
                let distance = |i: &usize| (0..3).map(|k| (p[k] - points[*i][k]).powi(2)).sum::<f64>();
                let best = (0..n).min_by(|i, j| distance(i).total_cmp(&distance(j)).then(i.cmp(j)));
                assert_eq!(Some(tree.find(p) as usize), best);
            }
        }
    }
}
