//! An edge as a surface's point sees it: what it may contribute, in closed form, and positions on it in proportion.

use glam::Vec3;

use super::Query;
use crate::render::ltc::Lobe;

/// An edge around a query point: its line at distance d, points on it by their distance l from the foot of the
/// perpendicular, or by the angle ψ = atan(l / d).
#[derive(Clone, Copy)]
pub struct Polar {
    pub d: f32,
    /// The ends, clipped to the horizon.
    pub l: [f32; 2],
    /// Position of the foot along the edge from its start.
    pub foot: f32,
    pub length: f32,
    diffuse: f32,
    glossy: f32,
    /// Where the glossy lobe is a cosine.
    transformed: Transformed,
}

/// An edge where a lobe is a cosine. A point at l on the edge is at `scale`·(l + foot) − `foot'` there.
#[derive(Clone, Copy)]
struct Transformed {
    scale: f32,
    d: f32,
    l: [f32; 2],
    foot: f32,
}

impl Transformed {
    /// An edge from `a` in direction `e` (a unit), both relative to the query point, between two distances from its start;
    /// with ∫ D sinφ / |q|² dl over it, for an edge whose line is at distance `d`.
    ///
    /// Solid angles swept by an edge are as many in the cosine's world, so that is ∫ cosθ' d / (π |q'|³) dl, the form of a
    /// linear light's irradiance (Heitz & Hill 2017).
    fn new(lobe: &Lobe, a: Vec3, e: Vec3, [from, to]: [f32; 2], d: f32) -> Option<(Transformed, f32)> {
        let (a, e) = (lobe.to_cosine * a, lobe.to_cosine * e);
        let scale = e.length();
        let e = e / scale;
        let (mut l0, mut l1) = (from * scale, to * scale);
        let (h0, h1) = (a.z + e.z * l0, a.z + e.z * l1);
        if h0 <= 0.0 && h1 <= 0.0 {
            return None;
        }
        let crossing = l0 + (l1 - l0) * h0 / (h0 - h1);
        if h0 < 0.0 {
            l0 = crossing;
        } else if h1 < 0.0 {
            l1 = crossing;
        }
        let foot = -a.dot(e);
        let to_foot = a + e * foot;
        let there = Transformed { scale, d: to_foot.length(), l: [l0 - foot, l1 - foot], foot };
        let mass = irradiance(there.d, there.l, to_foot.z, e.z) * d / (there.d * scale);
        (mass > 0.0 && mass.is_finite() && l0 < l1).then_some((there, mass * std::f32::consts::FRAC_1_PI))
    }
}

impl Polar {
    pub fn new(query: &Query, p0: Vec3, p1: Vec3) -> Option<Polar> {
        let length = p0.distance(p1);
        let e = (p1 - p0) / length;
        if query.distant {
            return Polar::from_afar(e.cross(query.p).length(), length);
        }
        let a = p0 - query.p;
        // Clip to the horizon of the geometric normal.
        let (h0, h1) = (query.ng.dot(a), query.ng.dot(p1 - query.p));
        let (mut l0, mut l1) = (0.0, length);
        if !query.has_horizon() {
        } else if h0 <= 0.0 && h1 <= 0.0 {
            return None;
        } else if h0 < 0.0 {
            l0 = length * h0 / (h0 - h1);
        } else if h1 < 0.0 {
            l1 = length * h0 / (h0 - h1);
        }
        let foot = -a.dot(e);
        let to_foot = a + e * foot;
        let d = query.effective_distance(to_foot.length());
        if d < 1e-6 * (a.length() + length) || l1 <= l0 {
            return None;
        }
        let l = [l0 - foot, l1 - foot];
        let diffuse = if query.has_horizon() {
            irradiance(d, l, query.ng.dot(to_foot), query.ng.dot(e))
        } else {
            angle(d, l) / d
        };
        let diffuse = diffuse * (query.diffuse * std::f32::consts::FRAC_1_PI);
        if diffuse.is_nan() || diffuse <= 0.0 {
            return None;
        }
        let transformed = Transformed { scale: 1.0, d, l, foot };
        let mut polar = Polar { d, l, foot, length, diffuse, glossy: 0.0, transformed };
        if let Some((lobe, weight)) = &query.glossy
            && let Some((transformed, mass)) = Transformed::new(lobe, a, e, [l0, l1], d)
        {
            polar.glossy = weight * mass;
            polar.transformed = transformed;
        }
        Some(polar)
    }

    /// An edge seen at an angle of some sine by who is so far away that all its points count alike.
    fn from_afar(sine: f32, length: f32) -> Option<Polar> {
        const DISTANCE: f32 = 100.0; // in lengths: the angle is linear, and nothing of the edge is lost to rounding
        let (d, foot) = (DISTANCE * length, 0.5 * length);
        let l = [-foot, foot];
        let transformed = Transformed { scale: 1.0, d, l, foot };
        let diffuse = sine * length;
        (diffuse > 0.0).then_some(Polar { d, l, foot, length, diffuse, glossy: 0.0, transformed })
    }

    pub fn importance(&self) -> f32 {
        self.diffuse + self.glossy
    }

    /// Multiplies its importance.
    pub fn scale(&mut self, by: f32) {
        self.diffuse *= by;
        self.glossy *= by;
    }

    /// A position along the edge (from its start) and its density: even in the angle, as the query point sees it or as one does where
    /// the lobe is a cosine.
    pub fn sample(&self, u: f32) -> (f32, f32) {
        let q = self.glossy / (self.diffuse + self.glossy);
        let t = &self.transformed;
        let at = if u < q {
            (place(t.d, t.l, u / q) + t.foot) / t.scale
        } else {
            place(self.d, self.l, ((u - q) / (1.0 - q)).min(1.0)) + self.foot
        };
        let at = at.clamp(self.l[0] + self.foot, self.l[1] + self.foot);
        let mut pdf = (1.0 - q) * even(self.d, self.l, at - self.foot);
        if q > 0.0 {
            pdf += q * t.scale * even(t.d, t.l, at * t.scale - t.foot);
        }
        (at, pdf)
    }
}

/// A point of a piece of edge, chosen evenly by the angle at which it is seen.
fn place(d: f32, l: [f32; 2], u: f32) -> f32 {
    // From the start by an angle: (d, l₀) turned; precise even where the query point is almost in line.
    let (sin, cos) = (angle(d, l) * u).sin_cos();
    let at = d * (l[0] * cos + d * sin) / (d * cos - l[0] * sin).max(1e-6 * d);
    at.clamp(l[0], l[1])
}

/// Density of [`place`] by length.
pub fn even(d: f32, l: [f32; 2], at: f32) -> f32 {
    if at < l[0] || at > l[1] { 0.0 } else { d / ((d * d + at * at) * angle(d, l)) }
}

/// The angle at which a piece of edge at distance `d`, from l₀ to l₁, is seen.
fn angle(d: f32, [l0, l1]: [f32; 2]) -> f32 {
    (d * (l1 - l0)).atan2(d * d + l0 * l1)
}

/// ∫ sinφ cosθ / |q|² dl over a piece of edge at distance `d`, from l₀ to l₁, at whose points the normal's component of q is
/// a + b l: what the piece means to a Lambertian surface, for an even jump and velocity. Kept positive.
fn irradiance(d: f32, l: [f32; 2], a: f32, b: f32) -> f32 {
    let [l0, l1] = l;
    let (r0, r1) = (d * d + l0 * l0, d * d + l1 * l1);
    let length = l1 - l0;
    let angle = angle(d, l);
    let even = (length * (d * d - l0 * l1) / (r0 * r1) + angle / d) / (2.0 * d);
    let slope = d * length * (l0 + l1) / (2.0 * r0 * r1);
    let highest = ((a + b * l0) / r0).max((a + b * l1) / r1);
    (a * even + b * slope).max(1e-3 * highest * angle)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Pcg32;

    /// Edges about a surface in the plane y = 0 that reflects narrowly.
    #[test]
    fn the_importance_of_an_edge_is_the_integral_over_it_and_positions_have_their_density() {
        let mut rng = Pcg32::new(9);
        let mut point = || Vec3::from_array(rng.next_3d()) * 4.0 - Vec3::new(2.0, 1.0, 2.0);
        let mut checked = 0;
        for i in 0..200 {
            let alpha = [0.6, 0.2, 0.05][i % 3];
            let lobe = Lobe::new(alpha, Vec3::Y, Vec3::new(-0.5, 0.7, 0.3).normalize());
            let query = Query { ng: Vec3::Y, diffuse: 0.2, glossy: Some((lobe, 0.8)), ..Query::around(Vec3::ZERO) };
            let ends = [point(), point()];
            let Some(polar) = Polar::new(&query, ends[0], ends[1]) else { continue };
            let (e, n) = ((ends[1] - ends[0]) / polar.length, 20_000);
            let distance = ends[0].cross(e).length();
            if distance < 0.1 {
                continue;
            }
            checked += 1;
            let (mut diffuse, mut glossy, mut covered) = (0.0, 0.0, 0.0);
            for k in 0..n {
                let q = ends[0] + e * (polar.length * (k as f32 + 0.5) / n as f32);
                let step = f64::from(polar.length / n as f32 * distance / q.length().powi(3));
                if q.y > 0.0 {
                    diffuse += 0.2 * step * f64::from(q.normalize().y * std::f32::consts::FRAC_1_PI);
                    glossy += 0.8 * step * f64::from(lobe.density(q.normalize()));
                }
                covered += 1.0 / f64::from(polar.sample((k as f32 + 0.5) / n as f32).1) / f64::from(n);
            }
            let near = |a: f32, b: f64| (f64::from(a) - b).abs() < 0.01 * b + 1e-3 * (diffuse + glossy);
            assert!(near(polar.diffuse, diffuse) && near(polar.glossy, glossy), "{} {glossy}", polar.glossy);
            let whole = polar.l[1] - polar.l[0];
            assert!((covered / f64::from(whole) - 1.0).abs() < 0.01, "{covered} {whole}");
        }
        assert!(checked > 50, "{checked}");
    }
}
