//! An edge in coordinates around a query point: its importance in closed form, and positions on it sampled in proportion to it.

use glam::Vec3;

use super::Query;
use crate::render::ltc::Lobe;

/// An edge relative to a query point. The edge's line is at distance d from the point. Positions on the edge are given by their signed
/// distance l from the foot of the perpendicular, or by the angle ψ = atan(l / d) at the query point.
#[derive(Clone, Copy)]
pub struct Polar {
    pub d: f32,
    /// Positions l of both ends, clipped to the horizon.
    pub l: [f32; 2],
    /// Distance of the perpendicular's foot from the edge's start, along the edge.
    pub foot: f32,
    pub length: f32,
    /// Importance for the cosine lobe and for the glossy lobe.
    diffuse: f32,
    glossy: f32,
    /// The edge in the space where the glossy lobe is a cosine.
    transformed: Transformed,
}

/// An edge after the linear transformation that makes a lobe a cosine. The point at l on the original edge, whose foot is at `foot`, is at
/// l' = `scale`·(l + foot) − foot' there, with foot' the field of this struct.
#[derive(Clone, Copy)]
struct Transformed {
    scale: f32,
    d: f32,
    l: [f32; 2],
    foot: f32,
}

impl Transformed {
    /// Transforms the part of an edge between two distances from its start. The start is at `a` relative to the query point, `e` is the unit
    /// direction and `d` the distance of the edge's line. Also returns the importance ∫ D sinφ / |q|² dl over that part, where D is the
    /// density of the lobe.
    ///
    /// D is a density by solid angle, so its integral over the solid angle that a moving edge sweeps is the same after the transformation.
    /// There the importance is ∫ cosθ' d / (π |q'|³) dl, the irradiance of a linear light (Heitz & Hill 2017, "Linear-Light Shading with
    /// Linearly Transformed Cosines").
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

    /// An edge for a query infinitely far away, where all its points have the same importance. `sine` is that of the angle between the edge
    /// and the direction to the query.
    fn from_afar(sine: f32, length: f32) -> Option<Polar> {
        // In lengths of the edge: so far away the angle is linear in the position, and so near that rounding does no harm.
        const DISTANCE: f32 = 100.0;
        let (d, foot) = (DISTANCE * length, 0.5 * length);
        let l = [-foot, foot];
        let transformed = Transformed { scale: 1.0, d, l, foot };
        let diffuse = sine * length;
        (diffuse > 0.0).then_some(Polar { d, l, foot, length, diffuse, glossy: 0.0, transformed })
    }

    pub fn importance(&self) -> f32 {
        self.diffuse + self.glossy
    }

    /// Multiplies the importance by a factor.
    pub fn scale(&mut self, by: f32) {
        self.diffuse *= by;
        self.glossy *= by;
    }

    /// Samples a position along the edge; returns its distance from the start and its density by length. Positions are uniform in the angle
    /// at the query point or, with the glossy lobe's share of the probability, in that angle after the transformation.
    pub fn sample(&self, u: f32) -> (f32, f32) {
        let q = self.glossy / (self.diffuse + self.glossy);
        let t = &self.transformed;
        let at = if u < q {
            (sample_angle(t.d, t.l, u / q) + t.foot) / t.scale
        } else {
            sample_angle(self.d, self.l, ((u - q) / (1.0 - q)).min(1.0)) + self.foot
        };
        let at = at.clamp(self.l[0] + self.foot, self.l[1] + self.foot);
        let mut pdf = (1.0 - q) * angle_pdf(self.d, self.l, at - self.foot);
        if q > 0.0 {
            pdf += q * t.scale * angle_pdf(t.d, t.l, at * t.scale - t.foot);
        }
        (at, pdf)
    }
}

/// Samples a position l on a piece of edge, uniformly by the angle at the query point.
fn sample_angle(d: f32, l: [f32; 2], u: f32) -> f32 {
    // Rotates (d, l₀) by a fraction of the angle. This is precise even if the query point is almost on the edge's line.
    let (sin, cos) = (angle(d, l) * u).sin_cos();
    let at = d * (l[0] * cos + d * sin) / (d * cos - l[0] * sin).max(1e-6 * d);
    at.clamp(l[0], l[1])
}

/// Density of [`sample_angle`], by length.
pub fn angle_pdf(d: f32, l: [f32; 2], at: f32) -> f32 {
    if at < l[0] || at > l[1] { 0.0 } else { d / ((d * d + at * at) * angle(d, l)) }
}

/// The angle that a piece of edge at distance `d`, from l₀ to l₁, subtends at the query point.
fn angle(d: f32, [l0, l1]: [f32; 2]) -> f32 {
    (d * (l1 - l0)).atan2(d * d + l0 * l1)
}

/// ∫ sinφ cosθ / |q|² dl over a piece of edge at distance `d`, from l₀ to l₁: its importance for a Lambertian surface if jump and velocity
/// are constant along it. The component of q along the surface's normal is a + b l. The result is clamped to be positive.
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

    /// Edges around a point of the plane y = 0 with a cosine lobe and a narrow one.
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
