//! Reflections in the triangles of curved mirrors, as polynomials.
//!
//! Over a triangle with corners x_i and interpolated normals m_i, the point x, the normal m (not normalised) and the direction w back to
//! the eye are linear in the barycentric coordinates. So the mirrored direction d = 2 m (m·w) − w (m·m) is cubic. The line from x along d
//! intersects the segment from A to B (both relative to x) where the quartic (A×B)·d vanishes and d lies between A and B. A polynomial
//! whose Bernstein coefficients all have one sign has no root. So triangles are searched completely by subdivision, and all roots along
//! straight lines within them are found. Mirrored directions below the triangle's plane are folded up (`SurfaceInteraction::mirrored`),
//! which is linear: such a triangle counts as two, one for each side.

use std::ops::Range;

use glam::{DVec3, Vec3};

use crate::grad::mirrors::viewpoint::CurvedMirror;
use crate::render::accel::PrimId;
use crate::render::edges::Edge;
use crate::render::sampler::Discrete;
use crate::render::{Camera, Scene};

/// A point of a triangle: barycentric coordinates of its second and third corner.
pub type Barycentric = [f64; 2];

/// The position from which a mirror is seen.
#[derive(Clone, Copy, Debug)]
pub enum Eye {
    /// A point of the world: of a pinhole or of a lens's middle.
    Point(DVec3),
    /// Infinitely far away in this direction.
    Direction(DVec3),
}

impl Eye {
    /// A pinhole, or the middle of a lens; for an orthographic camera the direction to it.
    pub fn of(camera: &Camera) -> Eye {
        let (origin, [_, _, forward]) = camera.pinhole();
        if camera.is_central() { Eye::Point(origin.as_dvec3()) } else { Eye::Direction(-forward.as_dvec3()) }
    }

    /// Radius of the lens: the slack with which [`Eye::of`] stands for all points of the lens.
    pub fn slack(camera: &Camera) -> f64 {
        let lens = camera.lens.radius * camera.frame[0].length().max(camera.frame[1].length());
        f64::from(if camera.is_central() || lens == 0.0 { lens } else { lens / camera.lens.focus })
    }

    /// From a point to the eye.
    fn from(self, x: DVec3) -> DVec3 {
        match self {
            Eye::Point(origin) => origin - x,
            Eye::Direction(towards) => towards,
        }
    }
}

/// A triangle of a mirror, or a part of one, seen from an eye.
#[derive(Clone, Copy, Debug)]
pub struct MirrorPatch {
    /// Points, normals and directions to the eye at the corners.
    pub x: [DVec3; 3],
    m: [DVec3; 3],
    w: [DVec3; 3],
    /// The unit normal of the triangle's plane, if this patch is for directions that are folded up.
    fold: Option<DVec3>,
}

impl MirrorPatch {
    /// A triangle of a mirror as the eye sees it; `folded` takes directions that are folded up at its plane.
    pub fn new(scene: &Scene, prim: PrimId, eye: Eye, folded: bool) -> MirrorPatch {
        let id = scene.prims[prim as usize];
        let mesh = &scene.description.shapes[id.shape as usize].mesh;
        let x = scene.corners(prim).map(Vec3::as_dvec3);
        let flat = (x[1] - x[0]).cross(x[2] - x[0]).normalize_or_zero();
        let m = match &mesh.normals {
            Some(normals) => mesh.faces[id.face as usize].map(|v| normals[v as usize].as_dvec3()),
            None => [flat; 3],
        };
        MirrorPatch { x, m, w: x.map(|x| eye.from(x)), fold: folded.then_some(flat) }
    }

    /// The part between three of its points.
    pub fn part(&self, corners: [Barycentric; 3]) -> MirrorPatch {
        let at = |v: &[DVec3; 3]| corners.map(|[u, t]| v[0] * (1.0 - u - t) + v[1] * u + v[2] * t);
        MirrorPatch { x: at(&self.x), m: at(&self.m), w: at(&self.w), fold: self.fold }
    }

    /// Unit normal of the plane.
    pub fn normal(&self) -> DVec3 {
        (self.x[1] - self.x[0]).cross(self.x[2] - self.x[0]).normalize_or_zero()
    }

    /// The mirrored direction.
    fn direction(&self) -> Form<DVec3> {
        let (m, w) = (Form::linear(self.m), Form::linear(self.w));
        let (mw, mm) = (m.times(&w, DVec3::dot), m.times(&m, DVec3::dot));
        let mut d = m.times(&mw, |m, f| m * (2.0 * f));
        let other = w.times(&mm, |w, f| w * f);
        d.c.iter_mut().zip(other.c).for_each(|(d, o)| *d = self.folded(*d - o));
        d
    }

    fn folded(&self, d: DVec3) -> DVec3 {
        self.fold.map_or(d, |n| d - n * (2.0 * n.dot(d)))
    }

    /// Whether a mirrored direction leaves on the side of the plane that the eye sees. If not, the point belongs to the other patch of
    /// the triangle, folded or not.
    fn leaves(&self, [u, t]: Barycentric, d: DVec3) -> bool {
        let w = self.w[0] * (1.0 - u - t) + self.w[1] * u + self.w[2] * t;
        let n = self.normal();
        n.dot(d) * n.dot(w) > 0.0
    }

    /// Whether the vertex normals are that of the plane. Then no direction is mirrored below it.
    fn is_flat(&self) -> bool {
        let n = self.normal();
        self.m.iter().all(|m| m.cross(n).length() <= 1e-9 * m.length())
    }

    /// Whether the mirrored direction leaves on the eye's side at any point.
    pub fn reflects_outwards(&self) -> bool {
        let n = self.normal();
        let seen: Form<f64> = Form::linear(self.w.map(|w| w.dot(n)));
        !self.direction().times(&seen, |d, s| d.dot(n) * s).is_below(0.0)
    }

    /// A cone around the normals of all mirrored directions: its axis and half its opening angle.
    fn normals(&self) -> (DVec3, f64) {
        let normals = self.m.map(DVec3::normalize_or_zero);
        let axis = normals.iter().sum::<DVec3>().normalize_or_zero();
        let half = normals.iter().map(|n| angle(*n, axis)).fold(0.0, f64::max);
        // Folding mirrors a direction at the horizon, to which it stays as close as it was. The cone is widened for that.
        (axis, self.fold.map_or(half, |flat| 3.0 * half.max(angle(flat * flat.dot(axis).signum(), axis))))
    }

    /// Largest sine of the eye's elevation above the plane at which a direction may be folded.
    fn fold_reach(&self) -> f64 {
        let tilt = |flat: DVec3| self.m.iter().map(|m| angle(flat, m.normalize_or_zero())).fold(0.0, f64::max);
        self.fold.map_or(std::f64::consts::PI, |flat| 2.0 * tilt(flat).min(tilt(-flat)))
    }

    fn largest_normal(&self) -> f64 {
        self.m.iter().map(|m| m.length_squared()).fold(0.0, f64::max)
    }

    /// Whether a segment may be seen in the patch from an eye that is at most `slack` away.
    pub fn may_see(&self, ends: [DVec3; 2], slack: f64) -> bool {
        let [a, b] = ends.map(|p| Form::linear(self.x.map(|x| p - x)));
        let n = Form::linear(self.x.map(|x| (ends[0] - x).cross(ends[1] - x)));
        let d = self.direction();
        let off = slack * self.largest_normal();
        let largest = |f: &Form<DVec3>| (0..3).map(|i| f.c[i].length()).fold(0.0, f64::max);
        let f = d.times(&n, DVec3::dot);
        let error = off * largest(&n);
        if f.is_below(-error) || f.is_above(error) {
            return false;
        }
        // d = α A + β B
        let (alpha, beta) =
            (d.times(&b.times(&n, DVec3::cross), DVec3::dot), d.times(&n.times(&a, DVec3::cross), DVec3::dot));
        !(alpha.is_below(-off * largest(&n) * largest(&b)) || beta.is_below(-off * largest(&n) * largest(&a)))
    }

    /// All points at which the segment is seen, on the straight line between the points `from` and `to` of this patch (both in [0, 1]²).
    pub fn images_on_line(&self, [from, to]: [Barycentric; 2], ends: [DVec3; 2], mut found: impl FnMut(SegmentImage)) {
        let at = |v: &[DVec3; 3], [u, t]: Barycentric| v[0] * (1.0 - u - t) + v[1] * u + v[2] * t;
        let line = |v: &[DVec3; 3]| [at(v, from), at(v, to) - at(v, from)];
        let ([x0, x1], [m0, m1], [w0, w1]) = (line(&self.x), line(&self.m), line(&self.w));
        let mw = [m0.dot(w0), m0.dot(w1) + m1.dot(w0), m1.dot(w1)];
        let mm = [m0.dot(m0), 2.0 * m0.dot(m1), m1.dot(m1)];
        let mut d = [DVec3::ZERO; 4];
        for i in 0..3 {
            d[i] += m0 * (2.0 * mw[i]) - w0 * mm[i];
            d[i + 1] += m1 * (2.0 * mw[i]) - w1 * mm[i];
        }
        let d = d.map(|d| self.folded(d));
        let n = |x: DVec3| (ends[0] - x).cross(ends[1] - x);
        let (n0, n1) = (n(x0), n(x0 + x1) - n(x0));
        let mut f = [0.0; 5];
        for i in 0..4 {
            f[i] += d[i].dot(n0);
            f[i + 1] += d[i].dot(n1);
        }
        roots(&f, &mut |t| {
            let x = x0 + x1 * t;
            let d = d[0] + (d[1] + (d[2] + d[3] * t) * t) * t;
            let [a, b] = ends.map(|p| p - x);
            let n = a.cross(b);
            let scale = 1.0 / n.length_squared();
            let (alpha, beta) = (d.dot(b.cross(n)) * scale, d.dot(n.cross(a)) * scale);
            if !(alpha >= 0.0 && beta >= 0.0 && alpha + beta > 0.0 && (alpha + beta).is_finite()) {
                return;
            }
            let place = [0, 1].map(|k| from[k] + (to[k] - from[k]) * t);
            if !self.leaves(place, d) {
                return;
            }
            found(SegmentImage { place, s: beta / (alpha + beta) });
        });
    }

    /// Derivatives, with respect to the point of the mirror, of the mirrored ray's offset in the direction `n`, perpendicular to it, at
    /// `distance`.
    pub fn d_miss(&self, place: Barycentric, distance: f64, n: DVec3) -> [f64; 2] {
        let local = self.mirrored(place);
        let length = local.d.length();
        [0, 1].map(|k| n.dot(local.x_k[k]) + distance * n.dot(local.d_k[k]) / length)
    }

    /// Area perpendicular to the mirrored ray at `distance`, per area of the mirror.
    pub fn area_magnification(&self, place: Barycentric, distance: f64) -> f64 {
        let local = self.mirrored(place);
        let length = local.d.length();
        let [a, b] = [0, 1].map(|k| local.x_k[k] + local.d_k[k] * (distance / length));
        let [x, y] = local.x_k;
        (a.cross(b).dot(local.d) / length).abs() / x.cross(y).length()
    }

    fn mirrored(&self, [u, t]: Barycentric) -> Mirrored {
        let at = |v: &[DVec3; 3]| v[0] * (1.0 - u - t) + v[1] * u + v[2] * t;
        let (x, m, w) = (at(&self.x), at(&self.m), at(&self.w));
        let (mw, mm) = (m.dot(w), m.dot(m));
        let along = |k: usize| [&self.x, &self.m, &self.w].map(|v| v[k] - v[0]);
        let d_k = |k: usize| {
            let [_, m_k, w_k] = along(k);
            self.folded(m_k * (2.0 * mw) + m * (2.0 * (m_k.dot(w) + m.dot(w_k))) - w_k * mm - w * (2.0 * m.dot(m_k)))
        };
        Mirrored { x, d: self.folded(m * (2.0 * mw) - w * mm), x_k: [along(1)[0], along(2)[0]], d_k: [d_k(1), d_k(2)] }
    }

    /// Whether a point may be seen in the patch from an eye that is at most `slack` away; `across` are directions perpendicular to the
    /// line to it.
    fn may_see_point(&self, p: DVec3, across: [DVec3; 2], slack: f64) -> bool {
        let (d, q) = (self.direction(), Form::linear(self.x.map(|x| p - x)));
        let error = slack * self.largest_normal() * self.x.iter().map(|x| x.distance(p)).fold(0.0, f64::max);
        let off = q.times(&d, DVec3::cross);
        let misses = |n: DVec3| {
            let mut f = Form { degree: off.degree, c: [0.0; MOST] };
            f.c.iter_mut().zip(off.c).for_each(|(f, off)| *f = off.dot(n));
            f.is_below(-error) || f.is_above(error)
        };
        !(across.into_iter().any(misses) || q.times(&d, DVec3::dot).is_below(-error))
    }

    fn may_see_from(&self, p: DVec3, slack: f64) -> bool {
        let (e1, e2) = (p - self.x[0]).normalize_or_zero().any_orthonormal_pair();
        self.may_see_point(p, [e1, e2], slack)
    }

    /// All points of the patch at which a point is seen: by Newton's method in parts that are so small that they reflect almost linearly.
    fn images_of(&self, p: DVec3, found: impl FnMut(Barycentric)) {
        const DEPTH: u32 = 2;
        let (e1, e2) = (p - self.x[0]).normalize_or_zero().any_orthonormal_pair();
        let mut places = Vec::new();
        self.search(p, [e1, e2], [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]], DEPTH, &mut places);
        places.into_iter().for_each(found);
    }

    /// Area perpendicular to the mirrored ray at `distance`, per solid angle at an eye that is `before` away.
    pub fn area_per_solid_angle(&self, place: Barycentric, before: f64, distance: f64) -> f64 {
        let [u, t] = place;
        let w = self.w[0] * (1.0 - u - t) + self.w[1] * u + self.w[2] * t;
        self.area_magnification(place, distance) * before * before / w.normalize_or_zero().dot(self.normal()).abs()
    }

    fn search(
        &self,
        p: DVec3,
        across: [DVec3; 2],
        corners: [Barycentric; 3],
        depth: u32,
        found: &mut Vec<Barycentric>,
    ) {
        if !self.part(corners).may_see_point(p, across, 0.0) {
            return;
        }
        if depth > 0 {
            quarters(corners).into_iter().for_each(|part| self.search(p, across, part, depth - 1, found));
            return;
        }
        const NEAR: f64 = 1e-7;
        let [a, b, c] = corners;
        let mut at = [0, 1].map(|k| (a[k] + b[k] + c[k]) / 3.0);
        for _ in 0..20 {
            let Mirrored { x, d, x_k, d_k } = self.mirrored(at);
            let off = (p - x).cross(d);
            let off_k = [0, 1].map(|k| (p - x).cross(d_k[k]) - x_k[k].cross(d));
            let [f, g] = across.map(|n| n.dot(off));
            let [[f0, f1], [g0, g1]] = across.map(|n| off_k.map(|o| n.dot(o)));
            let det = f0 * g1 - f1 * g0;
            let step = [(f * g1 - f1 * g) / det, (f0 * g - f * g0) / det];
            at = [at[0] - step[0], at[1] - step[1]];
            let far = at[0].abs() + at[1].abs();
            if far.is_nan() || far > 4.0 {
                return;
            }
            if step[0].abs() + step[1].abs() < 1e-11 {
                break;
            }
        }
        let Mirrored { x, d, .. } = self.mirrored(at);
        let inside = at[0] >= -NEAR && at[1] >= -NEAR && at[0] + at[1] <= 1.0 + NEAR;
        let met = (p - x).dot(d) > 0.0 && (p - x).cross(d).length() < 1e-6 * (p - x).length() * d.length();
        let again = |q: &Barycentric| (q[0] - at[0]).abs() + (q[1] - at[1]).abs() < 4.0 * NEAR;
        if inside && met && self.leaves(at, d) && !found.iter().any(again) {
            found.push(at);
        }
    }
}

/// A triangle divided into four.
pub fn quarters(corners: [Barycentric; 3]) -> [[Barycentric; 3]; 4] {
    let [a, b, c] = corners;
    let middle = |p: Barycentric, q: Barycentric| [0.5 * (p[0] + q[0]), 0.5 * (p[1] + q[1])];
    let (ab, bc, ca) = (middle(a, b), middle(b, c), middle(c, a));
    [[a, ab, ca], [ab, b, bc], [ca, bc, c], [bc, ca, ab]]
}

/// A point of a mirror and the mirrored direction there (not normalised), with their derivatives in the barycentric coordinates.
struct Mirrored {
    x: DVec3,
    d: DVec3,
    x_k: [DVec3; 2],
    d_k: [DVec3; 2],
}

/// A point of a mirror that shows a point of a segment.
#[derive(Clone, Copy, Debug)]
pub struct SegmentImage {
    pub(crate) place: Barycentric,
    /// Parameter of the point on the segment.
    pub s: f64,
}

fn angle(a: DVec3, b: DVec3) -> f64 {
    a.dot(b).clamp(-1.0, 1.0).acos()
}

/// Number of coefficients of a polynomial of degree five in three barycentric coordinates.
const MOST: usize = 21;

/// A homogeneous polynomial in barycentric coordinates: coefficients of b0^i b1^j b2^(n−i−j), j running faster.
#[derive(Clone, Copy, Debug)]
struct Form<T> {
    degree: usize,
    c: [T; MOST],
}

fn index(degree: usize, i: usize, j: usize) -> usize {
    i * (2 * degree + 3 - i) / 2 + j
}

impl<T: Copy + Default + std::ops::AddAssign> Form<T> {
    fn linear(v: [T; 3]) -> Form<T> {
        let mut c = [T::default(); MOST];
        (c[0], c[1], c[2]) = (v[2], v[1], v[0]);
        Form { degree: 1, c }
    }

    fn len(&self) -> usize {
        (self.degree + 1) * (self.degree + 2) / 2
    }

    fn times<U: Copy, V: Copy + Default + std::ops::AddAssign>(
        &self,
        other: &Form<U>,
        product: impl Fn(T, U) -> V,
    ) -> Form<V> {
        let degree = self.degree + other.degree;
        let mut c = [V::default(); MOST];
        for i in 0..=self.degree {
            for j in 0..=self.degree - i {
                let a = self.c[index(self.degree, i, j)];
                for k in 0..=other.degree {
                    for l in 0..=other.degree - k {
                        c[index(degree, i + k, j + l)] += product(a, other.c[index(other.degree, k, l)]);
                    }
                }
            }
        }
        Form { degree, c }
    }
}

impl Form<f64> {
    /// Whether the polynomial is less than a number everywhere in the triangle, by its Bernstein coefficients.
    fn is_below(&self, limit: f64) -> bool {
        (0..self.len()).all(|i| self.c[i] < limit * multinomial(self.degree, i))
    }

    fn is_above(&self, limit: f64) -> bool {
        (0..self.len()).all(|i| self.c[i] > limit * multinomial(self.degree, i))
    }
}

/// The multinomial coefficient of the `i`-th monomial in (b0 + b1 + b2)^degree.
fn multinomial(degree: usize, i: usize) -> f64 {
    const TABLE: [[f64; MOST]; 6] = {
        let mut table = [[0.0; MOST]; 6];
        let factorial = [1.0, 1.0, 2.0, 6.0, 24.0, 120.0];
        let mut degree = 0;
        while degree < 6 {
            let (mut at, mut i) = (0, 0);
            while i <= degree {
                let mut j = 0;
                while i + j <= degree {
                    table[degree][at] = factorial[degree] / (factorial[i] * factorial[j] * factorial[degree - i - j]);
                    at += 1;
                    j += 1;
                }
                i += 1;
            }
            degree += 1;
        }
        table
    };
    TABLE[degree][i]
}

/// The roots of a polynomial in [0, 1], in order. Between two roots of its derivative it is monotone and has at most one.
fn roots(c: &[f64], found: &mut dyn FnMut(f64)) {
    let value = |t: f64| c.iter().rev().fold(0.0, |sum, c| sum * t + c);
    let mut stops = [0.0; 8];
    let mut count = 1;
    if c.len() > 2 {
        let mut derivative = [0.0; 8];
        for (i, d) in derivative[..c.len() - 1].iter_mut().enumerate() {
            *d = c[i + 1] * (i + 1) as f64;
        }
        roots(&derivative[..c.len() - 1], &mut |t| {
            stops[count] = t;
            count += 1;
        });
    }
    stops[count] = 1.0;
    for pair in stops[..=count].windows(2) {
        let (mut low, mut high) = (pair[0], pair[1]);
        let (f_low, f_high) = (value(low), value(high));
        // Intervals are half open, so that a root at an end counts once.
        if (f_low < 0.0) == (f_high < 0.0) {
            continue;
        }
        for _ in 0..60 {
            let middle = 0.5 * (low + high);
            if middle <= low || middle >= high {
                break;
            }
            if (value(middle) < 0.0) == (f_low < 0.0) { low = middle } else { high = middle }
        }
        found(0.5 * (low + high));
    }
}

/// The triangles of curved mirrors in a hierarchy of bounding spheres and normal cones.
pub struct MirrorTree {
    mirrors: Vec<Range<PrimId>>,
    triangles: Vec<MirrorTriangle>,
    nodes: Vec<Node>,
    areas: Discrete,
    eye: Eye,
    slack: f64,
}

/// A triangle of a mirror.
#[derive(Clone, Debug)]
pub struct MirrorTriangle {
    pub(crate) prim: PrimId,
    pub(crate) folded: bool,
    /// The patch as seen from the camera.
    pub patch: MirrorPatch,
    /// Triangles that it cannot show to the camera, because they belong to the same convex body.
    hidden: Range<PrimId>,
}

struct Node {
    centre: DVec3,
    radius: f64,
    axis: DVec3,
    half: f64,
    /// The largest [`MirrorPatch::fold_reach`] below this node.
    rim: f64,
    /// The triangles of a leaf. For an inner node the left child is the next node.
    range: [u32; 2],
    right: u32,
}

impl Node {
    /// Whether any triangle below this node may reflect the eye, whose position is known up to `slack`, to a sphere.
    fn may_show(&self, eye: Eye, slack: f64, middle: DVec3, reach: f64) -> bool {
        let (q, w) = (middle - self.centre, eye.from(self.centre));
        let (distance, far) = (q.length(), w.length());
        let reach = reach + self.radius;
        let off = slack + if matches!(eye, Eye::Point(_)) { self.radius } else { 0.0 };
        if distance <= reach || far <= off {
            return true;
        }
        // asin x ≤ x + (π/2 − 1) x³
        let asin = |x: f64| x + 0.5708 * x * x * x;
        let unsure = asin(off / far) + 1e-9;
        if self.axis.dot(w).abs() > far * (self.rim + self.half + unsure) {
            return false;
        }
        let half = 2.0 * self.half + unsure + asin(reach / distance);
        let mirrored = self.axis * (2.0 * self.axis.dot(w)) - w;
        half >= std::f64::consts::PI || q.dot(mirrored) >= half.cos() * distance * far
    }
}

/// Most triangles of a leaf.
const LEAF: usize = 1;

impl MirrorTree {
    /// The tree of the triangles that the camera sees.
    pub fn new(scene: &Scene, camera: &Camera, mirrors: &[CurvedMirror]) -> MirrorTree {
        Self::of(scene, camera, mirrors, false)
    }

    /// Whether the camera sees no patch, as of degenerate mirrors.
    pub fn is_empty(&self) -> bool {
        self.triangles.is_empty()
    }

    /// The tree of all triangles of curved mirrors, for [`MirrorTree::specular_paths`].
    pub fn all(scene: &Scene, camera: &Camera, mirrors: &[CurvedMirror]) -> MirrorTree {
        Self::of(scene, camera, mirrors, true)
    }

    fn of(scene: &Scene, camera: &Camera, mirrors: &[CurvedMirror], unseen: bool) -> MirrorTree {
        let (eye, slack) = (Eye::of(camera), Eye::slack(camera));
        let mut triangles = Vec::new();
        for mirror in mirrors {
            let ways = mirror.prims.clone().flat_map(|prim| [(prim, false), (prim, true)]);
            let own = ways.map(|(prim, folded)| (prim, folded, MirrorPatch::new(scene, prim, eye, folded)));
            let own = own.filter(|(_, folded, patch)| patch.normal() != DVec3::ZERO && !(*folded && patch.is_flat()));
            let turned = |f: &MirrorPatch, least: f64| f.w.iter().any(|w| w.dot(f.normal()) > least);
            let start = triangles.len();
            let seen = |f: &MirrorPatch| unseen || slack > 0.0 || f.reflects_outwards();
            let own = own.filter(|(_, _, patch)| seen(patch));
            triangles.extend(own.map(|(prim, folded, patch)| MirrorTriangle {
                prim,
                folded,
                patch,
                hidden: prim..prim + 1,
            }));
            // A convex body is seen from outside if any of its faces is turned to the eye, and then only such faces are visible.
            if !unseen && mirror.convex && triangles[start..].iter().any(|f: &MirrorTriangle| turned(&f.patch, slack)) {
                let mut seen = triangles.split_off(start);
                seen.retain(|f| turned(&f.patch, -slack));
                seen.iter_mut().for_each(|f| f.hidden = mirror.prims.clone());
                triangles.extend(seen);
            }
        }
        let mirrors = mirrors.iter().map(|m| m.prims.clone()).collect();
        let nodes = Vec::with_capacity(2 * triangles.len());
        let mut tree = MirrorTree { mirrors, nodes, triangles, areas: Discrete::default(), eye, slack };
        if !tree.triangles.is_empty() {
            let cones: Vec<(DVec3, f64)> = tree.triangles.iter().map(|f| f.patch.normals()).collect();
            let mut order: Vec<u32> = (0..tree.triangles.len() as u32).collect();
            tree.build(&mut order, 0, &cones);
            tree.triangles = order.iter().map(|&i| tree.triangles[i as usize].clone()).collect();
            // Each triangle is entered once.
            let area = |f: &MirrorTriangle| match f.folded {
                false => (f.patch.x[1] - f.patch.x[0]).cross(f.patch.x[2] - f.patch.x[0]).length(),
                true => 0.0,
            };
            tree.areas = Discrete::new(tree.triangles.iter().map(area));
        }
        tree
    }

    fn build(&mut self, order: &mut [u32], start: usize, cones: &[(DVec3, f64)]) {
        let corners = || order.iter().flat_map(|&i| self.triangles[i as usize].patch.x);
        let (low, high) = corners().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(l, h), p| (l.min(p), h.max(p)));
        let centre = 0.5 * (low + high);
        let radius = corners().map(|p| p.distance(centre)).fold(0.0, f64::max);
        let axis = order.iter().map(|&i| cones[i as usize].0).sum::<DVec3>().normalize_or_zero();
        let half = order.iter().map(|&i| angle(axis, cones[i as usize].0) + cones[i as usize].1).fold(0.0, f64::max);
        let half = if axis == DVec3::ZERO { std::f64::consts::PI } else { half };
        let rim = order.iter().map(|&i| self.triangles[i as usize].patch.fold_reach()).fold(0.0, f64::max);
        let at = self.nodes.len();
        let range = [start as u32, (start + order.len()) as u32];
        self.nodes.push(Node { centre, radius, axis, half, rim, range, right: 0 });
        if order.len() <= LEAF {
            return;
        }
        let size = high - low;
        let k = (0..3).max_by(|&i, &j| size[i].total_cmp(&size[j])).unwrap_or(0);
        let folded = |i: u32| self.triangles[i as usize].folded;
        let key = |i: u32| self.triangles[i as usize].patch.x.iter().map(|x| x[k]).sum::<f64>();
        // Few directions are folded. Patches for these are in nodes of their own, which are skipped for all other directions.
        let middle = match order.iter().filter(|&&i| !folded(i)).count() {
            plain if 0 < plain && plain < order.len() => {
                order.sort_unstable_by_key(|&i| (folded(i), i));
                plain
            }
            _ => {
                order.sort_unstable_by(|&i, &j| key(i).total_cmp(&key(j)).then(i.cmp(&j)));
                order.len() / 2
            }
        };
        let (left, right) = order.split_at_mut(middle);
        self.build(left, start, cones);
        self.nodes[at].right = self.nodes.len() as u32;
        self.build(right, start + middle, cones);
    }

    pub(crate) fn triangles(&self) -> &[MirrorTriangle] {
        &self.triangles
    }

    /// Whether the triangle belongs to a curved mirror.
    pub fn contains(&self, prim: PrimId) -> bool {
        self.mirrors.iter().any(|m| m.contains(&prim))
    }

    /// A random point of the mirrors.
    pub fn sample(&self, u: f64) -> Vec3 {
        let (i, _, rest) = self.areas.sample(u);
        self.triangles[i].patch.x[0].lerp(self.triangles[i].patch.x[1], rest).as_vec3()
    }

    /// Indices of all triangles that may show a point of the edge to the camera.
    pub fn triangles_showing(&self, edge: &Edge, mut found: impl FnMut(usize)) {
        // A convex mirror cannot show itself.
        if let ([_], Some(f)) = (self.mirrors.as_slice(), self.triangles.first())
            && edge.faces.iter().all(|e| f.hidden.contains(&e.prim))
        {
            return;
        }
        let ends = edge.p.map(Vec3::as_dvec3);
        let reach = 0.5 * ends[0].distance(ends[1]);
        self.visit(self.eye, self.slack, 0.5 * (ends[0] + ends[1]), reach, |i| {
            let MirrorTriangle { prim, patch, hidden, .. } = &self.triangles[i];
            let own = edge.faces.iter().any(|f| f.prim == *prim) || edge.faces.iter().all(|f| hidden.contains(&f.prim));
            if !own && patch.may_see(ends, self.slack) {
                found(i);
            }
        });
    }

    /// All points of a mirror at which the camera, through its lens point, may see a point of the primitive `own`.
    pub fn images_of_point(
        &self,
        scene: &Scene,
        camera: &Camera,
        own: PrimId,
        p: Vec3,
        mut found: impl FnMut(PrimId, &MirrorPatch, Barycentric),
    ) {
        self.visit(self.eye, self.slack, p.as_dvec3(), 0.0, |i| {
            let MirrorTriangle { prim, folded, patch, ref hidden } = self.triangles[i];
            if !hidden.contains(&own) && patch.may_see_from(p.as_dvec3(), self.slack) {
                let patch =
                    if self.slack > 0.0 { MirrorPatch::new(scene, prim, Eye::of(camera), folded) } else { patch };
                patch.images_of(p.as_dvec3(), |place| found(prim, &patch, place));
            }
        });
    }

    /// All points of mirrors that reflect one point to another: the specular paths between them.
    pub fn specular_paths(
        &self,
        scene: &Scene,
        from: Vec3,
        to: Vec3,
        mut found: impl FnMut(PrimId, &MirrorPatch, Barycentric),
    ) {
        let eye = Eye::Point(from.as_dvec3());
        self.visit(eye, 0.0, to.as_dvec3(), 0.0, |i| {
            let MirrorTriangle { prim, folded, .. } = self.triangles[i];
            let patch = MirrorPatch::new(scene, prim, eye, folded);
            patch.images_of(to.as_dvec3(), |place| found(prim, &patch, place));
        });
    }

    /// Indices of the triangles that may reflect the eye to anything within a sphere.
    fn visit(&self, eye: Eye, slack: f64, middle: DVec3, reach: f64, mut found: impl FnMut(usize)) {
        let mut stack = vec![0];
        while let Some(at) = stack.pop() {
            let Some(node) = self.nodes.get(at).filter(|n| n.may_show(eye, slack, middle, reach)) else { continue };
            if node.right > 0 {
                stack.extend([node.right as usize, at + 1]);
            } else {
                (node.range[0] as usize..node.range[1] as usize).for_each(&mut found);
            }
        }
    }

    pub(crate) fn slack(&self) -> f64 {
        self.slack
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Pcg32;

    #[test]
    fn all_roots_of_polynomials_are_found() {
        let mut rng = Pcg32::new(3);
        for _ in 0..1000 {
            let zeros: Vec<f64> = (0..4).map(|_| f64::from(rng.next_f32()) * 2.0 - 0.5).collect();
            let mut c = vec![1.0];
            for z in &zeros {
                let mut next = vec![0.0; c.len() + 1];
                for (i, c) in c.iter().enumerate() {
                    next[i] -= z * c;
                    next[i + 1] += c;
                }
                c = next;
            }
            let mut expected: Vec<f64> = zeros.into_iter().filter(|z| (0.0..1.0).contains(z)).collect();
            expected.sort_by(f64::total_cmp);
            let mut found = Vec::new();
            roots(&c, &mut |t| found.push(t));
            assert_eq!(found.len(), expected.len(), "{c:?}");
            assert!(found.iter().zip(&expected).all(|(a, b)| (a - b).abs() < 1e-5), "{found:?} {expected:?}");
        }
    }

    /// A random curved patch mirrors a random ray: it must be found again, and subdivision must never lose it.
    #[test]
    fn whatever_a_facet_shows_is_found() {
        let mut rng = Pcg32::new(7);
        let mut random =
            |r: f64| DVec3::from_array(std::array::from_fn(|_| (f64::from(rng.next_f32()) * 2.0 - 1.0) * r));
        for _ in 0..300 {
            let x = [DVec3::ZERO, DVec3::X, DVec3::Y].map(|p| p + random(0.2));
            let m = x.map(|_| DVec3::Z + random(0.3));
            let eye = DVec3::Z * 4.0 + random(1.0);
            let patch = MirrorPatch { x, m, w: x.map(|x| eye - x), fold: None };
            let along: Barycentric = [0.2 + 0.1 * random(1.0).x, 0.3 + 0.1 * random(1.0).x];
            let here = patch.part([along; 3]);
            let d = (here.m[0] * (2.0 * here.m[0].dot(here.w[0])) - here.w[0] * here.m[0].length_squared()).normalize();
            let p = here.x[0] + d * 3.0;
            let e = random(1.0);
            let ends = [p - e * 0.3, p + e * 0.7];
            assert!(patch.may_see(ends, 0.0));
            let (axis, half) = patch.normals();
            let centre = (x[0] + x[1] + x[2]) / 3.0;
            let radius = x.iter().map(|x| x.distance(centre)).fold(0.0, f64::max);
            let node = Node { centre, radius, axis, half, rim: patch.fold_reach(), range: [0, 1], right: 0 };
            assert!(node.may_show(Eye::Point(eye), 0.0, p, 0.0));
            let mut found = Vec::new();
            patch.images_on_line([[along[0], 0.0], [along[0], 1.0 - along[0]]], ends, |s| found.push(s));
            let hit = found.iter().find(|s| (s.place[1] - along[1]).abs() < 1e-6).expect("a sighting");
            assert!((hit.s - 0.3).abs() < 1e-6);
            let (e1, e2) = d.any_orthonormal_pair();
            assert!(patch.may_see_point(p, [e1, e2], 0.0));
            let mut places = Vec::new();
            patch.images_of(p, |place| places.push(place));
            assert!(places.iter().any(|q| (q[0] - along[0]).abs() + (q[1] - along[1]).abs() < 1e-7), "{places:?}");
            // Inside of a small part: at its corner rounding would decide.
            let [u, t] = along;
            let small = [[u - 0.003, t - 0.003], [u + 0.01, t - 0.003], [u - 0.003, t + 0.01]];
            assert!(patch.part(small).may_see(ends, 0.0));

            // How far the ray passes by, by differences.
            let n = e.cross(d).normalize();
            let by = patch.d_miss(along, 3.0, n);
            for k in 0..2 {
                let pass = |t: f64| {
                    let mut place = along;
                    place[k] += t;
                    let f = patch.part([place; 3]);
                    let d = (f.m[0] * (2.0 * f.m[0].dot(f.w[0])) - f.w[0] * f.m[0].length_squared()).normalize();
                    n.dot(f.x[0] + d * 3.0)
                };
                let difference = (pass(1e-5) - pass(-1e-5)) / 2e-5;
                assert!((difference - by[k]).abs() < 1e-6 * (1.0 + difference.abs()), "{difference} {by:?}");
            }
        }
    }
}
