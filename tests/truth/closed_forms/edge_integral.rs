//! The boundary integral of direct light, all in double precision: that the formula which `grad::terms::shadow` samples is the right one, to
//! more digits than samples would ever show.

use dscene::render::Scene;
use dscene::render::edges::{Edge, EdgeTable, Seams};
use glam::{DVec2, DVec3, Vec3};

use super::shadows::Penumbra;
use super::support::{Builder, Pieces as _, triangle};

/// Nodes and weights on [0, 1].
fn gauss_legendre(n: usize) -> Vec<(f64, f64)> {
    let legendre = |x: f64| {
        let (mut below, mut value) = (1.0, x);
        for k in 2..=n {
            let k = k as f64;
            (below, value) = (value, ((2.0 * k - 1.0) * x * value - (k - 1.0) * below) / k);
        }
        (value, n as f64 * (x * value - below) / (x * x - 1.0))
    };
    let node = |i: usize| {
        let mut x = (std::f64::consts::PI * (i as f64 + 0.75) / (n as f64 + 0.5)).cos();
        for _ in 0..20 {
            let (value, slope) = legendre(x);
            x -= value / slope;
        }
        (0.5 + 0.5 * x, 1.0 / ((1.0 - x * x) * legendre(x).1.powi(2)))
    };
    (0..n).map(node).collect()
}

impl Penumbra {
    /// Everything moved by `h` times what `velocity` says.
    fn moved(&self, velocity: &Penumbra, h: f64) -> Penumbra {
        Penumbra {
            x: self.x + velocity.x * h,
            light: std::array::from_fn(|i| self.light[i] + velocity.light[i] * h),
            blocker: std::array::from_fn(|i| self.blocker[i] + velocity.blocker[i] * h),
            ..self.clone()
        }
    }

    /// The sides of the light, from its first corner.
    fn sides(&self) -> [DVec3; 2] {
        [self.light[1] - self.light[0], self.light[3] - self.light[0]]
    }

    /// What is at coordinates `u` of the light.
    fn on_light(&self, u: DVec2) -> DVec3 {
        let [a, b] = self.sides();
        self.light[0] + a * u.x + b * u.y
    }

    /// The coordinates of a point of the light's plane.
    fn coordinates(&self, y: DVec3) -> DVec2 {
        let [a, b] = self.sides();
        let (m, d) = (a.cross(b), y - self.light[0]);
        DVec2::new(d.cross(b).dot(m), a.cross(d).dot(m)) / m.length_squared()
    }

    /// The derivative of what a point of the light does for `x`, at fixed coordinates and per unit of their area.
    fn d_integrand(&self, velocity: &Penumbra, u: DVec2) -> f64 {
        let ([a, b], [d_a, d_b]) = (self.sides(), velocity.sides());
        let (m, d_m) = (a.cross(b), d_a.cross(b) + a.cross(d_b));
        let (d, d_d) = (self.on_light(u) - self.x, velocity.on_light(u) - velocity.x);
        let (cos, cos_light, r2) = (self.n.dot(d), m.dot(d), d.length_squared());
        let growth = self.n.dot(d_d) * cos_light + cos * (d_m.dot(d) + m.dot(d_d));
        cos_light.signum() * (growth - 4.0 * cos * cos_light * d.dot(d_d) / r2) / (r2 * r2)
    }

    /// The integral of that over a polygon of the light.
    fn interior(&self, velocity: &Penumbra, polygon: &[DVec3]) -> f64 {
        let nodes = gauss_legendre(24);
        let corners: Vec<DVec2> = polygon.iter().map(|&p| self.coordinates(p)).collect();
        let mut sum = 0.0;
        for ends in corners.windows(2).skip(1) {
            let (b, c) = (ends[0] - corners[0], ends[1] - corners[0]);
            for (s, ws) in &nodes {
                for (t, wt) in &nodes {
                    let u = corners[0] + b.lerp(c, *t) * *s;
                    sum += ws * wt * s * b.perp_dot(c).abs() * self.d_integrand(velocity, u);
                }
            }
        }
        sum
    }

    /// Fractions of an edge between which it is before the light, seen from `x`.
    fn before_light(&self, p: [DVec3; 2]) -> Vec<[f64; 2]> {
        let mut cuts = vec![0.0, 1.0];
        for i in 0..4 {
            let side = (self.light[i] - self.x).cross(self.light[(i + 1) % 4] - self.x);
            let [a, b] = p.map(|p| side.dot(p - self.x));
            cuts.extend((a * b < 0.0).then(|| a / (a - b)));
        }
        cuts.sort_by(f64::total_cmp);
        let shows = |cut: &[f64; 2]| {
            let (_, u) = self.behind(p[0].lerp(p[1], 0.5 * (cut[0] + cut[1])) - self.x);
            u.cmpgt(DVec2::ZERO).all() && u.cmplt(DVec2::ONE).all()
        };
        cuts.windows(2).map(|cut| [cut[0], cut[1]]).filter(shows).collect()
    }

    /// Where the light is behind x + q: at x + q/τ. Returns τ and the coordinates.
    fn behind(&self, q: DVec3) -> (f64, DVec2) {
        let [a, b] = self.sides();
        let m = a.cross(b);
        let t = m.dot(self.light[0] - self.x) / m.dot(q);
        (1.0 / t, self.coordinates(self.x + q * t))
    }

    /// −∫dl sinφ/|q|² (n·ω) N̂·(ṗ − (1−τ)ẋ − τẏ) over an edge of the blocker before a light of radiance 1.
    fn boundary(&self, velocity: &Penumbra, edge: &Edge) -> f64 {
        let p = edge.p.map(|p| p.as_dvec3());
        let d_p = p.map(|p| velocity.blocker[self.blocker.iter().position(|b| *b == p).unwrap()]);
        let e = p[1] - p[0];
        let mut sum = 0.0;
        for [from, to] in self.before_light(p) {
            for (s, w) in gauss_legendre(40) {
                let s = from + (to - from) * s;
                let q = p[0] + e * s - self.x;
                let omega = q.normalize();
                // The side as the renderer sees it. It says so in single precision.
                let view = edge.view(omega.as_vec3()).unwrap();
                let normal = q.cross(e).normalize();
                let normal = normal * normal.dot(view.normal.as_dvec3()).signum();
                assert!(view.background.is_none() && normal.distance(view.normal.as_dvec3()) < 1e-6);
                let (tau, u) = self.behind(q);
                let moves = d_p[0].lerp(d_p[1], s) - velocity.x * (1.0 - tau) - velocity.on_light(u) * tau;
                let sin_dl = e.cross(omega).length() * (to - from) * w;
                sum -= sin_dl / q.length_squared() * self.n.dot(omega) * normal.dot(moves);
            }
        }
        sum
    }
}

/// Of f at 0, to fourth order.
fn derivative(f: impl Fn(f64) -> f64) -> f64 {
    let central = |h: f64| (f(h) - f(-h)) / (2.0 * h);
    (4.0 * central(5e-4) - central(1e-3)) / 3.0
}

/// T7: interior and boundary add up to the derivative of the exact irradiance, for every way in which blocker, receiver and light may
/// move: to nine digits of each.
#[test]
fn interior_and_boundary_are_the_derivative() {
    let still =
        Penumbra { x: DVec3::ZERO, n: DVec3::ZERO, light: [DVec3::ZERO; 4], blocker: [DVec3::ZERO; 3], opacity: 0.0 };
    let mut motions = Vec::new();
    for axis in DVec3::AXES {
        for i in 0..3 {
            let mut motion = still.clone();
            motion.blocker[i] = axis;
            motions.push((format!("blocker {i}"), motion));
        }
        motions.push(("receiver".to_string(), Penumbra { x: axis, ..still.clone() }));
        // The light stays a parallelogram.
        for moved in [[1.0, 1.0, 1.0, 1.0], [0.0, 1.0, 1.0, 0.0], [0.0, 0.0, 1.0, 1.0]] {
            motions.push((format!("light {moved:?}"), Penumbra { light: moved.map(|m| axis * m), ..still.clone() }));
        }
    }
    // Within the light, over its outline, over a corner and across all of it.
    let blockers = [
        [[-0.15, 1.5, 0.2], [0.35, 1.4, 0.1], [0.05, 1.6, -0.4]],
        [[-0.5, 1.5, 0.1], [0.2, 1.4, 0.5], [0.1, 1.7, -0.1]],
        [[0.2, 1.3, 0.1], [0.9, 1.5, 0.7], [0.8, 1.9, -0.1]],
        [[-0.7, 1.2, 0.05], [0.8, 1.1, 0.15], [0.9, 1.3, 1.0]],
    ];
    for corners in blockers {
        // What single precision can say, so that the renderer's edges are these.
        let corners = corners.map(|[x, y, z]| Vec3::new(x, y, z));
        let exact = Penumbra { blocker: corners.map(|p| p.as_dvec3()), ..Penumbra::new() };
        let mut b = Builder::default();
        b.black(triangle(corners));
        let scene: Scene = b.scene();
        let edges = &EdgeTable::new(&scene, Seams::None).edges;
        assert_eq!(edges.len(), 3);
        for (name, motion) in &motions {
            let expected = derivative(|h| exact.moved(motion, h).irradiance());
            let interior = exact.interior(motion, &exact.light) - exact.interior(motion, &exact.hidden());
            let boundary: f64 = edges.iter().map(|edge| exact.boundary(motion, edge)).sum();
            let found = interior + boundary;
            let off = (found - expected).abs();
            println!("{name:32} {interior:12.9} + {boundary:12.9} = {expected:12.9}, off by {off:.1e}");
            assert!(off <= 1e-9 * expected.abs() + 1e-13, "{name}: {found} instead of {expected}, off by {off:.1e}");
        }
    }
}
