//! Fits transformed cosines to the renderer's own GGX lobe.
//!
//! A node's M is the one under which samples of the lobe are likeliest: the loss is the relative entropy of lobe and fit, which
//! punishes light that the fit does not find, the error that costs an importance sampler most.

use dscene::render::MaterialKind;
use dscene::render::bsdf::{Bsdf, ggx_roughness_of};
use dscene::render::ltc::{Lobe, Node, SIZE, node};
use glam::Vec3;

/// Strata of the samples of a lobe, a side.
const STRATA: usize = 32;

/// Directions with their weights, which sum to the lobe's albedo; `wi` in the plane of x and the normal z.
pub struct Samples {
    pub wi: Vec3,
    directions: Vec<(Vec3, f64)>,
    /// f·cos at each.
    values: Vec<f64>,
}

impl Samples {
    pub fn new(cos: f32, alpha: f32) -> Samples {
        let bsdf = Bsdf::new(&MaterialKind::Conductor {
            reflectance: Vec3::ONE,
            roughness: Vec3::splat(ggx_roughness_of(alpha)),
        });
        let wi = Vec3::new((1.0 - cos * cos).max(0.0).sqrt(), 0.0, cos);
        let (mut directions, mut values) = (Vec::new(), Vec::new());
        for i in 0..STRATA * STRATA {
            let u = [i % STRATA, i / STRATA].map(|k| (k as f32 + 0.5) / STRATA as f32);
            if let Some(s) = bsdf.sample(wi, [u[0], u[1], 0.5]) {
                let value = s.f.x;
                directions.push((s.wo, f64::from(value / s.pdf) / (STRATA * STRATA) as f64));
                values.push(f64::from(value));
            }
        }
        Samples { wi, directions, values }
    }

    pub fn albedo(&self) -> f64 {
        self.directions.iter().map(|d| d.1).sum()
    }

    /// ½ ∫ |lobe/albedo − fit|: zero for a perfect fit, at most one. Light of the fit where the lobe is black counts by what it
    /// is missing elsewhere.
    pub fn distance(&self, fit: &Lobe) -> f64 {
        let albedo = self.albedo();
        let parts = self.directions.iter().zip(&self.values);
        parts.map(|((d, w), f)| w / albedo * (1.0 - f64::from(fit.density(*d)) * albedo / f).max(0.0)).sum()
    }

    /// −∫ lobe/albedo · ln fit
    fn entropy(&self, m: &[f64; 4]) -> f64 {
        let m11 = 1.0 / (m[0] * m[3] - m[1] * m[2]);
        if !(m11 > 0.0 && m11.is_finite()) {
            return f64::INFINITY;
        }
        let (sin, cos) = (f64::from(self.wi.x), f64::from(self.wi.z));
        let of = |d: Vec3| {
            let [x, y, z] = d.to_array().map(f64::from);
            let [x, z] = [cos * x + sin * z, cos * z - sin * x];
            let [x, y, z] = [m[0] * x + m[1] * z, m11 * y, m[2] * x + m[3] * z];
            let squared = x * x + y * y + z * z;
            2.0 * squared.ln() - z.max(1e-6 * squared.sqrt()).ln()
        };
        self.directions.iter().map(|(d, w)| w * of(*d)).sum::<f64>() / self.albedo()
    }
}

/// The whole table, row by row. Each node starts from its neighbour's fit.
pub fn table() -> Vec<Node> {
    let mut table = vec![[0.0; 5]; SIZE * SIZE];
    for column in (0..SIZE).rev() {
        for row in 0..SIZE {
            let (cos, alpha) = node(row, column);
            let width = f64::from(alpha).powf(1.0 / 3.0);
            let guess = [1.0 / width, 0.0, 0.0, width * width];
            let mut starts = vec![guess];
            if row > 0 {
                let m = table[(row - 1) * SIZE + column];
                starts.push(std::array::from_fn(|i| f64::from(m[i])));
            }
            table[row * SIZE + column] = fit(&Samples::new(cos, alpha), &starts);
        }
    }
    table
}

/// The best fit from any of some starts.
pub fn fit(samples: &Samples, starts: &[[f64; 4]]) -> Node {
    let best = |start: &[f64; 4]| {
        // Twice: a simplex may collapse before it arrives.
        let once = nelder_mead(|m| samples.entropy(m), *start);
        nelder_mead(|m| samples.entropy(m), once)
    };
    let fits = starts.iter().map(best);
    let [a, b, c, d] = fits.min_by(|a, b| samples.entropy(a).total_cmp(&samples.entropy(b))).unwrap_or([1.0; 4]);
    [a, b, c, d, samples.albedo()].map(|x| x as f32)
}

/// A minimum near `start` (Nelder & Mead 1965).
fn nelder_mead(f: impl Fn(&[f64; 4]) -> f64, start: [f64; 4]) -> [f64; 4] {
    let scale = start.iter().fold(0.0, |a: f64, x| a.max(x.abs()));
    let mut simplex = vec![start; 5];
    for (i, p) in simplex[1..].iter_mut().enumerate() {
        p[i] += 0.1 * p[i].abs().max(1e-3 * scale);
    }
    let mut simplex: Vec<([f64; 4], f64)> = simplex.into_iter().map(|p| (p, f(&p))).collect();
    for _ in 0..300 {
        simplex.sort_by(|a, b| a.1.total_cmp(&b.1));
        if simplex[4].1 - simplex[0].1 < 1e-10 {
            break;
        }
        let centre: [f64; 4] = std::array::from_fn(|i| simplex[..4].iter().map(|p| p.0[i]).sum::<f64>() / 4.0);
        let worst = simplex[4];
        let along = |t: f64| {
            let p = std::array::from_fn(|i| centre[i] + t * (worst.0[i] - centre[i]));
            (p, f(&p))
        };
        let reflected = along(-1.0);
        simplex[4] = if reflected.1 < simplex[0].1 {
            let further = along(-2.0);
            if further.1 < reflected.1 { further } else { reflected }
        } else if reflected.1 < simplex[3].1 {
            reflected
        } else {
            let inside = if reflected.1 < worst.1 { along(-0.5) } else { along(0.5) };
            if inside.1 < worst.1.min(reflected.1) {
                inside
            } else {
                let best = simplex[0].0;
                for p in &mut simplex[1..] {
                    p.0 = std::array::from_fn(|i| 0.5 * (best[i] + p.0[i]));
                    p.1 = f(&p.0);
                }
                simplex[4]
            }
        };
    }
    simplex.sort_by(|a, b| a.1.total_cmp(&b.1));
    simplex[0].0
}
