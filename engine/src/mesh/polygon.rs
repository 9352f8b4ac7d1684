//! Triangulates polygons: convex ones as fans, others by ear clipping.

use earcut::Earcut;
use glam::{DVec3, Vec3};

/// A triangulator, which uses its memory again for the next polygon.
pub(super) struct Triangulator {
    ears: Earcut<f64>,
    flat: Vec<[f64; 2]>,
    cut: Vec<u32>,
}

impl Triangulator {
    pub fn new() -> Triangulator {
        Triangulator { ears: Earcut::new(), flat: Vec::new(), cut: Vec::new() }
    }

    /// Triangles of a polygon as indices of its corners, with the winding of the polygon. A polygon that is not planar is projected along
    /// its mean normal. With fewer than three corners there are none.
    pub fn cut(&mut self, corners: &[Vec3], mut give: impl FnMut([usize; 3])) {
        let n = corners.len();
        if n > 3 && self.project(corners) && !is_convex(&self.flat) && !winds_again(&self.flat) {
            self.ears.earcut(self.flat.iter().copied(), &[], &mut self.cut);
            if !self.cut.is_empty() {
                for t in self.cut.chunks_exact(3) {
                    let [a, b, c] = [t[0] as usize, t[1] as usize, t[2] as usize];
                    // The polygon is counter-clockwise in the plane onto which it was projected.
                    let reversed = turn(self.flat[a], self.flat[b], self.flat[c]) < 0.0;
                    give(if reversed { [a, c, b] } else { [a, b, c] });
                }
                return;
            }
        }
        (2..n).for_each(|k| give([0, k - 1, k]));
    }

    /// Projects the corners along the polygon's normal into `flat`; false if the polygon has no normal.
    fn project(&mut self, corners: &[Vec3]) -> bool {
        let from = corners[0].as_dvec3();
        let normal = normal(corners);
        let Some(normal) = normal.try_normalize() else { return false };
        let (x, y) = normal.any_orthonormal_pair();
        self.flat.clear();
        self.flat.extend(corners.iter().map(|c| {
            let c = c.as_dvec3() - from;
            [c.dot(x), c.dot(y)]
        }));
        true
    }
}

/// Twice the area of a polygon along its mean normal (Newell).
pub(super) fn normal(corners: &[Vec3]) -> DVec3 {
    let Some(from) = corners.first().map(|c| c.as_dvec3()) else { return DVec3::ZERO };
    corners.windows(2).map(|p| (p[0].as_dvec3() - from).cross(p[1].as_dvec3() - from)).sum()
}

/// Twice the signed area of a triangle.
fn turn(a: [f64; 2], b: [f64; 2], c: [f64; 2]) -> f64 {
    (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
}

/// Whether a polygon is convex: it never turns right and winds around once.
fn is_convex(p: &[[f64; 2]]) -> bool {
    let n = p.len();
    let mut reversals = 0;
    let mut before = p[0][0] - p[n - 1][0];
    for i in 0..n {
        let (a, b, c) = (p[i], p[(i + 1) % n], p[(i + 2) % n]);
        if turn(a, b, c) < 0.0 {
            return false;
        }
        let step = b[0] - a[0];
        if step != 0.0 {
            reversals += u32::from(before * step < 0.0);
            before = step;
        }
    }
    reversals <= 2
}

/// Whether a long polygon comes back to its own corners over and over, and so has no inside: the time of ear clipping would grow with the
/// cube of its length. (One that goes along a bridge to a hole and back passes few corners twice.)
fn winds_again(p: &[[f64; 2]]) -> bool {
    const LONG: usize = 64;
    if p.len() < LONG {
        return false;
    }
    let mut places: Vec<[u64; 2]> = p.iter().map(|c| c.map(|x| (x + 0.0).to_bits())).collect();
    places.sort_unstable();
    places.dedup();
    2 * places.len() < p.len()
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::vec3;

    fn area(corners: &[Vec3]) -> (f32, usize) {
        let (mut sum, mut count) = (Vec3::ZERO, 0);
        let mut total = 0.0;
        Triangulator::new().cut(corners, |t| {
            let [a, b, c] = t.map(|i| corners[i]);
            let n = (b - a).cross(c - a) * 0.5;
            (sum, total, count) = (sum + n, total + n.length(), count + 1);
        });
        assert!((sum.length() - total).abs() < 1e-5 * total.max(1.0), "the triangles overlap or are turned");
        (total, count)
    }

    #[test]
    fn concave_polygons_have_their_area() {
        // An arrow head: a fan from its first corner would cover 2.
        let arrow = [vec3(-1.0, 0.0, 0.0), vec3(0.0, 0.2, 0.0), vec3(1.0, 0.0, 0.0), vec3(0.0, 1.0, 0.0)];
        for turned in 0..4 {
            let mut corners = arrow.map(|c| vec3(c.z + 5.0, c.x, c.y));
            corners.rotate_left(turned);
            let (found, count) = area(&corners);
            assert!((found - 0.8).abs() < 1e-6 && count == 2, "{found} from corner {turned}");
            corners.reverse();
            assert!((area(&corners).0 - 0.8).abs() < 1e-6);
        }
        // A comb with ten teeth.
        let mut comb = vec![vec3(0.0, -1.0, 0.0), vec3(20.0, -1.0, 0.0)];
        comb.extend((0..=20).rev().map(|x| vec3(x as f32, if x % 2 == 0 { 2.0 } else { 0.0 }, 0.0)));
        let (found, count) = area(&comb);
        assert!((found - 40.0).abs() < 1e-4 && count == comb.len() - 2, "{found}, {count}");
    }

    #[test]
    fn all_else_is_a_fan() {
        let square = [vec3(0.0, 0.0, 0.0), vec3(1.0, 0.0, 0.0), vec3(1.0, 1.0, 0.2), vec3(0.0, 1.0, 0.0)];
        let mut found = Vec::new();
        Triangulator::new().cut(&square, |t| found.push(t));
        assert_eq!(found, [[0, 1, 2], [0, 2, 3]]);
        // Without an area, or with fewer than three corners, there is nothing to go wrong.
        assert_eq!(area(&[Vec3::ONE; 5]).1, 3);
        assert_eq!(area(&[Vec3::ONE; 2]).1, 0);
        let nothing = [Vec3::NAN, Vec3::ONE, Vec3::ZERO, Vec3::X];
        Triangulator::new().cut(&nothing, |_| {});
        // Around one triangle three thousand times.
        let again: Vec<Vec3> = [Vec3::ZERO, Vec3::X, Vec3::Y].into_iter().cycle().take(9_000).collect();
        let mut count = 0;
        Triangulator::new().cut(&again, |_| count += 1);
        assert_eq!(count, again.len() - 2);
    }

    #[test]
    fn a_long_spiral_is_cut_quickly() {
        let spiral = |r: f32| {
            (0..20_000).map(move |i| {
                let a = i as f32 * 0.01;
                vec3((r + a) * a.cos(), (r + a) * a.sin(), 0.0)
            })
        };
        let corners: Vec<Vec3> = spiral(1.0).chain(spiral(2.0).collect::<Vec<_>>().into_iter().rev()).collect();
        let mut count = 0;
        Triangulator::new().cut(&corners, |_| count += 1);
        assert!(count > 39_000, "{count}");
    }
}
