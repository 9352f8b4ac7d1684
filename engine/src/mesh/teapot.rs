//! The Utah teapot: Martin Newell's 32 bicubic Bézier patches (1975), bottom included.
//!
//! The data set's 306 control points are redundant: 24 patches are quarter turns of six profile curves, and the eight patches of handle
//! and spout are four patches and their mirror images. So only the profiles and halves are stored here.

use glam::{Vec3, vec2, vec3};

use super::shapes::{Patches, count, limit, positive_zero};
use super::{Mesh, MeshError};

/// The classic teapot, y up, standing on the plane y = 0: spout towards +x (to 3.43), handle towards −x (to −3), 3.15 high,
/// 4 deep. Each of the 32 patches has `subdivisions × subdivisions` cells; normals are the patches' own.
/// Texture coordinates cover the unit square once for each of body, lid, handle and spout.
pub fn teapot(subdivisions: usize) -> Result<Mesh, MeshError> {
    count("subdivisions", subdivisions, 1)?;
    let cells = 64u64.saturating_mul(subdivisions as u64).saturating_mul(subdivisions as u64);
    limit("the teapot", cells.max(subdivisions as u64))?;
    let n = subdivisions;
    let mut patches = Patches::new((32 * (n + 1) * (n + 1), cells as usize));
    revolve(&mut patches, &BODY, n);
    revolve(&mut patches, &LID, n);
    mirror(&mut patches, &HANDLE, n);
    mirror(&mut patches, &SPOUT, n);
    Ok(patches.mesh())
}

/// Radius r, coordinate q of the off-axis control points, and height. The control points of a quarter turn at that height are (r, 0), (r,
/// q), (q, r), (0, r).
type ProfilePoint = [f32; 3];

/// Lip, upper body, lower body, bottom; from the lip's inner edge down.
const BODY: [[ProfilePoint; 4]; 4] = [
    [[1.4, 0.784, 2.4], [1.3375, 0.749, 2.53125], [1.4375, 0.805, 2.53125], [1.5, 0.84, 2.4]],
    [[1.5, 0.84, 2.4], [1.75, 0.98, 1.875], [2.0, 1.12, 1.35], [2.0, 1.12, 0.9]],
    [[2.0, 1.12, 0.9], [2.0, 1.12, 0.45], [1.5, 0.84, 0.225], [1.5, 0.84, 0.15]],
    [[1.5, 0.84, 0.15], [1.5, 0.84, 0.075], [1.425, 0.798, 0.0], [0.0, 0.0, 0.0]],
];

/// Knob and lid, from the top down.
const LID: [[ProfilePoint; 4]; 2] = [
    [[0.0, 0.0, 3.15], [0.8, 0.45, 3.15], [0.0, 0.0, 2.85], [0.2, 0.112, 2.7]],
    [[0.2, 0.112, 2.7], [0.4, 0.224, 2.55], [1.3, 0.728, 2.55], [1.3, 0.728, 2.4]],
];

/// One half of a tube's cross section: inner x and height, outer x and height, half width w. Its control points are (inner, 0), (inner,
/// w), (outer, w), (outer, 0).
type Rib = ([f32; 2], [f32; 2], f32);

/// From the upper end on the body round to the lower one.
const HANDLE: [[Rib; 4]; 2] = [
    [
        ([-1.6, 2.025], [-1.5, 2.25], 0.3),
        ([-2.3, 2.025], [-2.5, 2.25], 0.3),
        ([-2.7, 2.025], [-3.0, 2.25], 0.3),
        ([-2.7, 1.8], [-3.0, 1.8], 0.3),
    ],
    [
        ([-2.7, 1.8], [-3.0, 1.8], 0.3),
        ([-2.7, 1.575], [-3.0, 1.35], 0.3),
        ([-2.5, 1.125], [-2.65, 0.9375], 0.3),
        ([-2.0, 0.9], [-1.9, 0.6], 0.3),
    ],
];

/// From the body to the mouth, whose wall turns inwards.
const SPOUT: [[Rib; 4]; 2] = [
    [
        ([1.7, 1.425], [1.7, 0.6], 0.66),
        ([2.6, 1.425], [3.1, 0.825], 0.66),
        ([2.3, 2.1], [2.4, 2.025], 0.25),
        ([2.7, 2.4], [3.3, 2.4], 0.25),
    ],
    [
        ([2.7, 2.4], [3.3, 2.4], 0.25),
        ([2.8, 2.475], [3.525, 2.49375], 0.25),
        ([2.9, 2.475], [3.45, 2.5125], 0.15),
        ([2.8, 2.4], [3.2, 2.4], 0.15),
    ],
];

/// Point and the two partial derivatives of a bicubic patch; `control[j][i]`, i along `s`, j along `t`.
fn bezier(control: &[[Vec3; 4]; 4], s: f32, t: f32) -> (Vec3, Vec3, Vec3) {
    let (bs, ds) = bernstein(s);
    let (bt, dt) = bernstein(t);
    let mut result = (Vec3::ZERO, Vec3::ZERO, Vec3::ZERO);
    for j in 0..4 {
        for i in 0..4 {
            result.0 += bs[i] * bt[j] * control[j][i];
            result.1 += ds[i] * bt[j] * control[j][i];
            result.2 += bs[i] * dt[j] * control[j][i];
        }
    }
    result
}

fn bernstein(t: f32) -> ([f32; 4], [f32; 4]) {
    let r = 1.0 - t;
    let values = [r * r * r, 3.0 * t * r * r, 3.0 * t * t * r, t * t * t];
    let slopes = [-3.0 * r * r, 3.0 * r * (r - 2.0 * t), 3.0 * t * (2.0 * r - t), 3.0 * t * t];
    (values, slopes)
}

/// Patch number and parameter of grid line `k` with `n` cells per patch. The very last line belongs to the last patch.
fn locate(k: usize, n: usize, patches: usize) -> (usize, f32) {
    let patch = (k / n).min(patches - 1);
    (patch, (k - patch * n) as f32 / n as f32)
}

/// A surface of revolution about the y axis; u around, v from the first profile point to the last.
fn revolve(patches: &mut Patches, profile: &[[ProfilePoint; 4]], n: usize) {
    let (nu, nv) = (4 * n, profile.len() * n);
    patches.grid(nu, nv, |i, j| {
        let (quarter, s) = locate(i, n, 4);
        let (part, t) = locate(nv - j, n, profile.len());
        let control =
            profile[part].map(|[r, q, y]| [vec3(r, y, 0.0), vec3(r, y, -q), vec3(q, y, -r), vec3(0.0, y, -r)]);
        let (mut position, ds, dt) = bezier(&control, s, t);
        // The height does not depend on s. It is computed from t alone, so that rounding does not split a pole into several points.
        position.y = bernstein(t).0.iter().zip(profile[part]).map(|(b, [_, _, y])| b * y).sum();
        // Outward, with u to the right and v up: ∂u × ∂v = ∂s × (−∂t). At a pole ∂s vanishes and the axis is normal.
        let across = dt.cross(ds);
        let normal =
            if across.length() > 1e-6 { across.normalize() } else { Vec3::Y * if part == 0 { 1.0 } else { -1.0 } };
        let turn = |v: Vec3| (0..quarter).fold(v, |v, _| vec3(v.z, v.y, -v.x));
        let uv = vec2(i as f32 / nu as f32, j as f32 / nv as f32);
        (positive_zero(turn(position)), turn(normal), uv)
    });
}

/// A tube symmetric in z; u around it from the inner line, v along it.
fn mirror(patches: &mut Patches, ribs: &[[Rib; 4]; 2], n: usize) {
    // Less than four sides would be a flat tube.
    let half = n.max(2);
    let (nu, nv) = (2 * half, 2 * n);
    // The handle extends towards −x and the spout towards +x. u runs in opposite directions on them, so that both have their outside
    // outside.
    let towards = if ribs[0][0].0[0] < 0.0 { -1.0 } else { 1.0 };
    patches.grid(nu, nv, |i, j| {
        let (part, t) = locate(j, n, 2);
        let (k, side) = if i <= half { (i, towards) } else { (nu - i, -towards) };
        let s = k as f32 / half as f32;
        let control = ribs[part].map(|([xi, yi], [xo, yo], w)| {
            [vec3(xi, yi, 0.0), vec3(xi, yi, w * side), vec3(xo, yo, w * side), vec3(xo, yo, 0.0)]
        });
        let (position, ds, dt) = bezier(&control, s, t);
        let du = if i <= half { ds } else { -ds };
        let uv = vec2(i as f32 / nu as f32, j as f32 / nv as f32);
        (positive_zero(position), du.cross(dt).normalize_or(Vec3::Y), uv)
    });
}
