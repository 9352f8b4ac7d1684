//! Local adjoints: closed forms for one vertex of a path.

use std::ops::Add;

use glam::Vec3;

use super::shadow::Sky;
use super::sink::{Adjoints, Sink};
use crate::render::accel::PrimId;
use crate::render::bsdf::{BsdfAdjoint, MAX_INPUTS, Part};
use crate::render::film::first_hit;
use crate::render::interaction::{SurfaceInteraction, d_terminator, terminator};
use crate::render::light::{LightKind, LightSample};
use crate::render::mask::{Crossing, Through};
use crate::render::{Camera, Input, Output};

/// Adjoints of the numbers of one surface interaction.
#[derive(Clone, Copy, Debug, Default)]
pub struct VertexAdjoint {
    pub p: Vec3,
    pub ng: Vec3,
    pub ns: Vec3,
    pub wi: Vec3,
    pub b: [f32; 3],
}

/// What a moving hit point asks of the ray that found it.
#[derive(Clone, Copy, Debug, Default)]
pub struct RayAdjoint {
    pub origin: Vec3,
    pub dir: Vec3,
}

impl Add for RayAdjoint {
    type Output = RayAdjoint;

    fn add(self, other: RayAdjoint) -> RayAdjoint {
        RayAdjoint { origin: self.origin + other.origin, dir: self.dir + other.dir }
    }
}

impl VertexAdjoint {
    pub fn add_b(&mut self, b: [f32; 3]) {
        for (a, b) in self.b.iter_mut().zip(b) {
            *a += b;
        }
    }
}

/// Adjoint of [`SurfaceInteraction::eval`] (of one part of it, if given) with both directions given: adds to the vertex,
/// returns the adjoint of `wo` and of the material's inputs.
pub fn d_eval(
    si: &SurfaceInteraction,
    wo: Vec3,
    part: Option<Part>,
    d_f: Vec3,
    adj: &mut VertexAdjoint,
) -> (Vec3, [Vec3; MAX_INPUTS]) {
    d_eval_with(si, wo, part, d_f, adj, |ci, co, io, d| match part {
        Some(part) => si.bsdf.d_eval_part(part, ci, co, io, d),
        None => si.bsdf.d_eval(ci, co, io, d),
    })
}

fn d_eval_with(
    si: &SurfaceInteraction,
    wo: Vec3,
    part: Option<Part>,
    d_f: Vec3,
    adj: &mut VertexAdjoint,
    d_bsdf: impl Fn(f32, f32, f32, Vec3) -> BsdfAdjoint,
) -> (Vec3, [Vec3; MAX_INPUTS]) {
    let (ci, co, io) = (si.ns.dot(si.wi), si.ns.dot(wo), si.wi.dot(wo));
    let mut d_wo = Vec3::ZERO;
    let mut d_brdf = d_f;
    if si.shading_flip != 0.0 {
        let (ng_wo, ng_ns) = (si.ng.dot(wo), si.ng.dot(si.ns));
        let g = terminator(ng_wo, co, ng_ns);
        d_brdf = d_f * g;
        if g < 1.0 {
            let f = part.map_or_else(|| si.bsdf.eval(ci, co, io), |p| si.bsdf.eval_part(p, ci, co, io));
            let (a, b, c) = d_terminator(ng_wo, co, ng_ns, d_f.dot(f));
            adj.ng += wo * a + si.ns * c;
            adj.ns += wo * b + si.ng * c;
            d_wo += si.ng * a + si.ns * b;
        }
    }
    let d = d_bsdf(ci, co, io, d_brdf);
    adj.ns += si.wi * d.d_ci + wo * d.d_co;
    adj.wi += si.ns * d.d_ci + wo * d.d_io;
    d_wo += si.ns * d.d_co + si.wi * d.d_io;
    (d_wo, d.d_values)
}

/// Adjoint of [`SurfaceInteraction::mirrored`], perpendicular to it.
pub fn d_mirrored(si: &SurfaceInteraction, mut d_dir: Vec3, adj: &mut VertexAdjoint) {
    let n_wi = si.ns.dot(si.wi);
    let dir = si.ns * (2.0 * n_wi) - si.wi;
    let height = si.ng.dot(dir);
    if height < 0.0 {
        adj.ng -= (d_dir * height + dir * si.ng.dot(d_dir)) * 2.0;
        d_dir -= si.ng * (2.0 * si.ng.dot(d_dir));
    }
    adj.ns += (si.wi * si.ns.dot(d_dir) + d_dir * n_wi) * 2.0;
    adj.wi += si.ns * (2.0 * si.ns.dot(d_dir)) - d_dir;
}

/// The incoming direction on the front of the shading normal, as the BSDF has it.
fn front(si: &SurfaceInteraction) -> (Vec3, f32) {
    let ci = si.ns.dot(si.wi);
    if ci < 0.0 { (si.wi - si.ns * (2.0 * ci), ci) } else { (si.wi, ci) }
}

/// Adjoint of an attached direction: `wo` is `wi` mirrored at a half vector h that turns with the shading normal, by the
/// smallest rotation that takes the normal along. `d_wo` goes to the normal and `wi`; `d_h` is an adjoint h has besides.
fn d_attached(si: &SurfaceInteraction, h: Vec3, mut d_h: Vec3, d_wo: Vec3, mut d_wi: Vec3, adj: &mut VertexAdjoint) {
    let (wi, ci) = front(si);
    let (h_wi, h_d) = (h.dot(wi), h.dot(d_wo));
    d_h += (wi * h_d + d_wo * h_wi) * 2.0;
    d_wi += h * (2.0 * h_d) - d_wo;
    adj.ns += h.cross(d_h).cross(si.ns);
    if ci < 0.0 {
        // wi was mirrored at the tangent plane.
        let along = si.ns.dot(d_wi);
        adj.ns -= (d_wi * ci + si.wi * along) * 2.0;
        d_wi -= si.ns * (2.0 * along);
    }
    adj.wi += d_wi;
}

/// Adjoint of the direction `wo` of an attached lobe.
pub fn d_attached_direction(si: &SurfaceInteraction, wo: Vec3, d_wo: Vec3, adj: &mut VertexAdjoint) {
    let h = (front(si).0 + wo).normalize_or_zero();
    d_attached(si, h, Vec3::ZERO, d_wo, Vec3::ZERO, adj);
}

/// Adjoint of the specular part of [`SurfaceInteraction::eval`] where its direction is attached: the half vector is what
/// was sampled and turns with the surface, so the integrand is f·cos·|∂ω/∂h| = 4 f·cos·(wi·h). `d_wo` is the adjoint that the
/// radiance from there has in the direction. Returns the adjoint of the material's inputs.
pub fn d_eval_attached(
    si: &SurfaceInteraction,
    wo: Vec3,
    d_f: Vec3,
    d_wo: Vec3,
    adj: &mut VertexAdjoint,
) -> [Vec3; MAX_INPUTS] {
    let (d_direction, d_values) =
        d_eval_with(si, wo, Some(Part::Specular), d_f, adj, |ci, co, io, d| si.bsdf.d_eval_attached(ci, co, io, d));
    let wi = front(si).0;
    let h = (wi + wo).normalize_or_zero();
    let h_wi = h.dot(wi);
    if h_wi <= 0.0 {
        return d_values;
    }
    let by_jacobian = d_f.dot(si.eval_part(Part::Specular, wo)) / h_wi;
    d_attached(si, h, wi * by_jacobian, d_wo + d_direction, h * by_jacobian, adj);
    d_values
}

/// Adjoint of a vertex whose position is where a ray (direction −wi, distance `t`) meets its triangle: distributes to the
/// triangle's arrays and returns the adjoint of the ray.
///
/// ẋ = u + d (n·(V−u))/(n·d), with u the velocity of the ray at the hit and V that of the material point; ḃ_i = ∇b_i·(ẋ−V).
pub fn slide<S: Sink>(out: &mut Adjoints<S>, si: &SurfaceInteraction, t: f32, mut adj: VertexAdjoint) -> RayAdjoint {
    if si.shading_flip == 0.0 {
        adj.ng += adj.ns;
    } else if adj.ns != Vec3::ZERO {
        // ns = flip · M/|M|, M = Σ b n; |M| from the interpolated normals again.
        let id = out.scene.prims[si.prim as usize];
        let mesh = &out.scene.description.shapes[id.shape as usize].mesh;
        if let Some(normals) = &mesh.normals {
            let face = mesh.faces[id.face as usize];
            let m: Vec3 = face.iter().zip(si.b).map(|(&v, b)| normals[v as usize] * b).sum();
            let d_m = (adj.ns - si.ns * si.ns.dot(adj.ns)) * (si.shading_flip / m.length());
            let d_b = out.interpolated_normal(si.prim, si.b, d_m);
            adj.add_b(d_b);
        }
    }
    out.geometric_normal(si.prim, adj.ng * si.flip);

    let d = -si.wi;
    let n_d = si.ng.dot(d);
    if n_d.abs() < 1e-7 {
        return RayAdjoint::default();
    }
    let g = if adj.b == [0.0; 3] { Vec3::ZERO } else { barycentric_gradient(out, si.prim, adj.b) };
    let d_x = adj.p + g;
    let along_normal = si.ng * (d.dot(d_x) / n_d);
    out.material_point(si.prim, si.b, along_normal - g);
    let d_u = d_x - along_normal;
    RayAdjoint { origin: d_u, dir: d_u * t - adj.wi }
}

/// Σ b̄_i ∇b_i with ∇b_i = n × (v_{i+2} − v_{i+1}) / 2A.
fn barycentric_gradient<S: Sink>(out: &Adjoints<S>, prim: PrimId, d_b: [f32; 3]) -> Vec3 {
    let [p0, p1, p2] = out.scene.corners(prim);
    let n = (p1 - p0).cross(p2 - p0);
    let double_area_squared = n.length_squared();
    if double_area_squared <= 0.0 {
        return Vec3::ZERO;
    }
    n.cross((p2 - p1) * d_b[0] + (p0 - p2) * d_b[1] + (p1 - p0) * d_b[2]) / double_area_squared
}

/// Adjoint of a material's inputs at a vertex.
pub fn d_inputs<S: Sink>(
    out: &mut Adjoints<S>,
    si: &SurfaceInteraction,
    d: &[Vec3; MAX_INPUTS],
    adj: &mut VertexAdjoint,
) {
    let kind = &out.scene.description.shapes[si.shape as usize].material.kind;
    let (inputs, count) = kind.inputs();
    let scalar = kind.scalar_inputs();
    for i in 0..count {
        let d = if scalar[i] { Vec3::X * d[i].x } else { d[i] };
        if d != Vec3::ZERO {
            let d_b = out.input(inputs[i], si.prim, si.b, d, true);
            adj.add_b(d_b);
        }
    }
}

/// Adjoint of emission seen where a direction-fixed ray hits (camera rays, mirrors).
pub fn d_emission_sliding<S: Sink>(out: &mut Adjoints<S>, si: &SurfaceInteraction, d: Vec3, adj: &mut VertexAdjoint) {
    if let Some(input) = emission_input(out, si.prim) {
        let d_b = out.input(input, si.prim, si.b, d, true);
        adj.add_b(d_b);
    }
}

/// Adjoint of a light's power, its radiance times the opacity of its mask, at a point. Returns the adjoint of b as
/// [`Adjoints::input`] does.
fn d_light_power<S: Sink>(out: &mut Adjoints<S>, prim: PrimId, b: [f32; 3], d: Vec3, slides: bool) -> [f32; 3] {
    let Some(radiance) = emission_input(out, prim) else { return [0.0; 3] };
    let (scene, opacity) = (out.scene, opacity_input(out, prim));
    let Some((opacity, value)) = opacity.zip(scene.opacity(prim, b)) else {
        return out.input(radiance, prim, b, d, slides);
    };
    let by_radiance = out.input(radiance, prim, b, d * value, slides);
    let by_opacity = out.input(opacity, prim, b, Vec3::X * d.dot(scene.lookup(radiance, prim, b)), slides);
    std::array::from_fn(|i| by_radiance[i] + by_opacity[i])
}

/// Adjoint of the opacity of a vertex that slides over its surface.
pub fn d_opacity<S: Sink>(out: &mut Adjoints<S>, si: &SurfaceInteraction, d: f32, adj: &mut VertexAdjoint) {
    if let Some(input) = opacity_input(out, si.prim) {
        let d_b = out.input(input, si.prim, si.b, Vec3::X * d, true);
        adj.add_b(d_b);
    }
}

/// Adjoint of what masks on a line let through: `d` is that of the product of their weights. Returns the adjoint of the line, a
/// ray along `dir`.
pub fn d_masks<S: Sink>(out: &mut Adjoints<S>, dir: Vec3, crossings: &[Crossing], d: f32) -> RayAdjoint {
    let mut ray = RayAdjoint::default();
    for (i, c) in crossings.iter().enumerate() {
        let others: f32 = crossings.iter().enumerate().filter(|&(j, _)| j != i).map(|(_, c)| c.weight()).product();
        let d_opacity_here = -d * others * c.inv_choice;
        if d_opacity_here != 0.0 {
            let si = out.scene.interaction(c.prim, c.b, -dir);
            let mut adj = VertexAdjoint::default();
            d_opacity(out, &si, d_opacity_here, &mut adj);
            ray = ray + slide(out, &si, c.t, adj);
        }
    }
    ray
}

fn opacity_input<S: Sink>(out: &Adjoints<S>, prim: PrimId) -> Option<Input> {
    out.scene.description.shapes[out.scene.prims[prim as usize].shape as usize].material.opacity
}

pub fn emission_input<S: Sink>(out: &Adjoints<S>, prim: PrimId) -> Option<Input> {
    let shape = out.scene.prims[prim as usize].shape as usize;
    out.scene.description.shapes[shape].emission.as_ref().map(|e| e.radiance)
}

/// Adjoint of light that arrives at a vertex: material-fixed, but where surfaces touch, or through an attached lobe.
pub fn d_arriving<S: Sink>(
    out: &mut Adjoints<S>,
    si: &SurfaceInteraction,
    c: &Arriving,
    a: Vec3,
    sky: Sky,
    adj: &mut VertexAdjoint,
) -> [Vec3; MAX_INPUTS] {
    if c.light.is_delta() {
        return d_material(out, si, c, Scattering { f: si.eval(c.dir), part: None, a }, adj);
    }
    let [fixed, attached] = si.eval_split(c.dir);
    let part = si.bsdf.is_attached().then_some(Part::Diffuse);
    let scattering = Scattering { f: fixed, part, a };
    let touches = c.light.kind == LightKind::Area && out.scene.touch(si.prim, c.light.prim);
    let splits = c.light.kind == LightKind::Environment && sky != Sky::Whole && out.layout.turns_environment();
    let mut d_values = if splits {
        d_sky(out, si, c, scattering, sky, adj)
    } else if !touches {
        d_material(out, si, c, scattering, adj)
    } else {
        let d_f = a * c.light.power * (c.geometry * c.weight);
        d_found(out, c, a * fixed, adj);
        d_eval(si, c.dir, part, d_f, adj).1
    };
    if si.bsdf.is_attached() {
        let d_f = a * c.light.power * (c.geometry * c.weight);
        let d_dir = d_found(out, c, a * attached, adj);
        for (d, e) in d_values.iter_mut().zip(d_eval_attached(si, c.dir, d_f, d_dir, adj)) {
            *d += e;
        }
    }
    d_values
}

/// Adjoint of light from a direction of which a part turns with the environment and the rest stays where it is.
fn d_sky<S: Sink>(
    out: &mut Adjoints<S>,
    si: &SurfaceInteraction,
    c: &Arriving,
    scattering: Scattering,
    sky: Sky,
    adj: &mut VertexAdjoint,
) -> [Vec3; MAX_INPUTS] {
    let Scattering { f, part, a } = scattering;
    let rest = c.light.power * sky.rest(out.scene, c.dir);
    let turning = LightSample { power: c.light.power - rest, ..*c.light };
    let mut d_values = d_material(out, si, &Arriving { light: &turning, ..*c }, scattering, adj);
    let scale = c.geometry * c.weight;
    out.environment_base(c.dir, a * f * scale);
    adj.p += d_masks(out, c.dir, c.masks.crossings, a.dot(f * rest) * c.geometry * c.masks.weight).origin;
    for (d, e) in d_values.iter_mut().zip(d_eval(si, c.dir, part, a * rest * scale, adj).1) {
        *d += e;
    }
    d_values
}

/// Adjoint of what a ray finds on a light that it slides over: `a` includes the BSDF. Adds the vertex's part, returns the
/// direction's.
fn d_found<S: Sink>(out: &mut Adjoints<S>, c: &Arriving, a: Vec3, adj: &mut VertexAdjoint) -> Vec3 {
    let d_power = a * (c.geometry * c.weight);
    let mut ray = d_masks(out, c.dir, c.masks.crossings, a.dot(c.light.power) * (c.geometry * c.masks.weight));
    if c.light.kind == LightKind::Environment {
        ray.dir += out.environment(c.dir, d_power);
    } else {
        let mut d_light = VertexAdjoint::default();
        let d_b = d_light_power(out, c.light.prim, c.light.b, d_power, true);
        d_light.add_b(d_b);
        if d_light.b != [0.0; 3] {
            let there = out.scene.interaction(c.light.prim, c.light.b, -c.dir);
            ray = ray + slide(out, &there, c.distance, d_light);
        }
    }
    adj.p += ray.origin;
    ray.dir
}

/// Light arriving at a vertex from a light sample: contribution a·(f·power)·geometry·weight.
#[derive(Clone, Copy)]
pub struct Arriving<'a> {
    pub light: &'a LightSample,
    pub dir: Vec3,
    pub distance: f32,
    pub geometry: f32,
    pub weight: f32,
    pub masks: Masks<'a>,
}

/// Masks on the way of light: `weight` is the whole one without theirs.
#[derive(Clone, Copy)]
pub struct Masks<'a> {
    pub crossings: &'a [Crossing],
    pub weight: f32,
}

/// How a vertex passes light on: by a part of its BSDF, or all of it, with the value `f`; `a` is the adjoint of what leaves.
#[derive(Clone, Copy)]
pub struct Scattering {
    pub f: Vec3,
    pub part: Option<Part>,
    pub a: Vec3,
}

/// Adjoint of light from a point that stays where it is on its light.
pub fn d_material<S: Sink>(
    out: &mut Adjoints<S>,
    si: &SurfaceInteraction,
    c: &Arriving,
    Scattering { f, part, a }: Scattering,
    adj: &mut VertexAdjoint,
) -> [Vec3; MAX_INPUTS] {
    let light = c.light;
    let scale = c.geometry * c.weight;
    let (mut d_dir, d_values) = d_eval(si, c.dir, part, a * light.power * scale, adj);
    let d_power = a * f * scale;
    let d_value = a.dot(f * light.power);
    let d_geometry = d_value * c.weight;
    // Where the line crosses a mask moves with both its ends.
    let masks = d_masks(out, c.dir, c.masks.crossings, d_value * c.geometry * c.masks.weight);
    adj.p += masks.origin;
    d_dir += masks.dir;
    match light.kind {
        LightKind::Area => {
            // geometry = |cos| / r²
            let cos = -light.n.dot(c.dir);
            let sign = cos.signum();
            let inv_r2 = 1.0 / (c.distance * c.distance);
            let d_cos = d_geometry * inv_r2 * sign;
            let d_r = -2.0 * d_geometry * c.geometry / c.distance;
            d_dir -= light.n * d_cos;
            let d = c.dir * d_r + (d_dir - c.dir * c.dir.dot(d_dir)) / c.distance;
            adj.p -= d;
            out.material_point(light.prim, light.b, d);
            out.geometric_normal(light.prim, -c.dir * d_cos);
            // The measure is dA = 2A du dv; the density, a constant, cancels it only in value.
            let [p0, p1, p2] = out.scene.corners(light.prim);
            let area = 0.5 * (p1 - p0).cross(p2 - p0).length();
            out.area(light.prim, d_geometry * c.geometry / area);
            d_light_power(out, light.prim, light.b, d_power, false);
        }
        LightKind::Point(i) => {
            // geometry = falloff / r²
            let d_r = -2.0 * d_geometry * c.geometry / c.distance;
            if let Some(cone) = light.cone {
                let falloff = cone.falloff(-c.dir);
                let d_falloff = d_geometry / (c.distance * c.distance);
                d_dir -= falloff.by_direction * d_falloff;
                let d_axis = crate::math::d_normalize(cone.axis, falloff.by_axis * d_falloff);
                out.light_cone(i, d_axis, falloff.by_angles.map(|d| d * d_falloff));
            }
            let d = c.dir * d_r + (d_dir - c.dir * c.dir.dot(d_dir)) / c.distance;
            adj.p -= d;
            out.light_placement(i, d);
            out.light_power(i, d_power);
        }
        LightKind::Directional(i) => {
            d_direction(out, i, d_dir);
            out.light_power(i, d_power);
        }
        LightKind::Environment => {
            out.environment_direction(c.dir, d_dir);
            out.environment_point(c.dir, d_power);
        }
    }
    d_values
}

/// Adjoint of the unit direction towards a directional light → its `direction` (which points the other way).
pub fn d_direction<S: Sink>(out: &mut Adjoints<S>, light: u32, d_towards: Vec3) {
    if let crate::render::DeltaLight::Directional { direction, .. } = out.scene.description.delta_lights[light as usize]
    {
        out.light_placement(light, crate::math::d_normalize(direction, -d_towards));
    }
}

/// Adjoint of a first-hit channel (see `first_hit`) seen through masks → adjoint of the camera ray. The camera's own
/// part of the depth goes straight to `out.camera`.
pub fn d_first_hit<S: Sink>(
    out: &mut Adjoints<S>,
    output: Output,
    camera: &Camera,
    (si, t): (&SurfaceInteraction, f32),
    through: &Through,
    d: Vec3,
) -> RayAdjoint {
    let mut adj = VertexAdjoint::default();
    d_opacity(out, si, d.dot(first_hit(out.scene, output, camera, si)) * through.pass * through.inv_choice, &mut adj);
    let d = d * through.weight;
    match output {
        Output::Radiance | Output::Alpha | Output::ShapeIndex => {}
        Output::Depth => {
            let forward = camera.frame[2].normalize();
            adj.p += forward * d.x;
            out.camera.origin -= forward * d.x;
            out.camera.frame[2] += crate::math::d_normalize(camera.frame[2], (si.p - camera.origin) * d.x);
        }
        Output::Position => adj.p += d,
        Output::Normal => adj.ns += d,
        Output::GeometricNormal => adj.ng += d,
        Output::Albedo => {
            let d_values = si.bsdf.d_albedo(d);
            d_inputs(out, si, &d_values, &mut adj);
        }
        Output::Uv => {
            let d_b = out.uv(si.prim, si.b, d.truncate());
            adj.add_b(d_b);
        }
    }
    slide(out, si, t, adj)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grad::sink::{Dense, Layout};
    use crate::math::{Dual, Pcg32};
    use crate::mesh::Mesh;
    use crate::render::accel::Ray;
    use crate::render::bsdf::Bsdf;
    use crate::render::texture::Texture;
    use crate::render::{DeltaLight, Emission, Material, MaterialKind, Scene, SceneDescription, Shape, Slot};
    use glam::{DQuat, DVec3, Vec2};

    fn vertex(ns: Vec3, wi: Vec3, bsdf: Bsdf) -> SurfaceInteraction {
        SurfaceInteraction {
            prim: 0,
            shape: 0,
            b: [1.0, 0.0, 0.0],
            p: Vec3::ZERO,
            ng: ns,
            ns,
            flip: 1.0,
            shading_flip: 0.0,
            wi,
            bsdf,
            emission: Vec3::ZERO,
        }
    }

    /// F D G / (4 ci) of a conductor (first channel) in double precision.
    fn ggx(f0: f64, roughness: f64, ci: f64, co: f64, half: f64, cos_h: f64) -> f64 {
        let a2 = roughness.powi(4);
        let tan2 = |c: f64| (1.0 - c * c) / (c * c);
        let d = a2 / (std::f64::consts::PI * cos_h.powi(4) * (a2 + tan2(cos_h)).powi(2));
        let g = |c: f64| 2.0 / (1.0 + (1.0 + a2 * tan2(c)).sqrt());
        (f0 + (1.0 - f0) * (1.0 - half).powi(5)) * d * g(ci) * g(co) / (4.0 * ci)
    }

    /// The integrand of an attached lobe in the half vector's measure, with a radiance that changes with direction.
    fn integrand(roughness: f64, [ns, wi, h, gradient]: [DVec3; 4]) -> f64 {
        let ci = ns.dot(wi);
        let front = if ci < 0.0 { wi - ns * (2.0 * ci) } else { wi };
        let half = h.dot(front);
        let wo = h * (2.0 * half) - front;
        ggx(0.8, roughness, ci.abs(), ns.dot(wo), half, ns.dot(h)) * half * (1.0 + gradient.dot(wo))
    }

    #[test]
    fn attached_lobes_follow_their_surface() {
        let mut rng = Pcg32::new(5);
        let mut unit = || (Vec3::from_array(rng.next_3d()) * 2.0 - 1.0).normalize();
        let mut checked = 0;
        for i in 0..600 {
            let roughness = [0.44f32, 0.35, 0.2][i % 3];
            let bsdf = Bsdf::Conductor { reflectance: Vec3::splat(0.8), roughness };
            assert!(bsdf.is_attached());
            let (ns, wi, gradient) = (unit(), unit(), unit());
            let h = (ns + roughness * roughness * unit()).normalize();
            let ci = ns.dot(wi);
            let front = if ci < 0.0 { wi - ns * (2.0 * ci) } else { wi };
            let half = h.dot(front);
            let wo = h * (2.0 * half) - front;
            if ci.abs() < 0.2 || ns.dot(wo) < 0.2 {
                continue;
            }
            checked += 1;
            let mut adj = VertexAdjoint::default();
            let si = vertex(ns, wi, bsdf);
            let f = si.eval_part(Part::Specular, wo).x;
            d_eval_attached(&si, wo, Vec3::X * (1.0 + gradient.dot(wo)), gradient * f, &mut adj);
            // With respect to a rotation of the incoming direction, and to the smallest one that takes the normal along.
            let at = [ns, wi, h, gradient].map(Vec3::as_dvec3);
            let allowed = 0.005 * (f64::from(f) + f64::from(adj.wi.length() + adj.ns.length()));
            for axis in Vec3::AXES {
                let step = 1e-5;
                let difference = |axis: DVec3, turned: [bool; 4]| {
                    let value = |angle: f64| {
                        let q = DQuat::from_axis_angle(axis, angle);
                        let v = std::array::from_fn(|i| if turned[i] { q * at[i] } else { at[i] });
                        integrand(f64::from(roughness), v)
                    };
                    (value(step) - value(-step)) / (2.0 * step * f64::from(half))
                };
                let by_wi = difference(axis.as_dvec3(), [false, true, false, false]);
                let expected = f64::from(adj.wi.dot(axis.cross(wi)));
                assert!((by_wi - expected).abs() < allowed, "wi: {by_wi} {expected} {roughness}");
                let Some(turn) = (axis - ns * ns.dot(axis)).try_normalize() else { continue };
                let by_n = difference(turn.as_dvec3().normalize(), [true, false, true, false]);
                let expected = f64::from(adj.ns.dot(turn.cross(ns)));
                assert!((by_n - expected).abs() < allowed, "n: {by_n} {expected} {roughness}");
            }
        }
        assert!(checked > 200, "{checked}");
    }

    /// Numbers in three coordinates, with their derivatives.
    type Twin<const N: usize> = [Dual<N>; 3];

    /// Variables number `first` and the two after it.
    fn variables<const N: usize>(v: Vec3, first: usize) -> Twin<N> {
        std::array::from_fn(|i| Dual::variable(f64::from(v[i]), first + i))
    }

    fn constants<const N: usize>(v: Vec3) -> Twin<N> {
        std::array::from_fn(|i| Dual::constant(f64::from(v[i])))
    }

    fn minus<const N: usize>(a: Twin<N>, b: Twin<N>) -> Twin<N> {
        std::array::from_fn(|i| a[i] - b[i])
    }

    fn times<const N: usize>(a: Twin<N>, s: Dual<N>) -> Twin<N> {
        a.map(|x| x * s)
    }

    fn dot<const N: usize>(a: Twin<N>, b: Twin<N>) -> Dual<N> {
        a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
    }

    fn cross<const N: usize>(a: Twin<N>, b: Twin<N>) -> Twin<N> {
        std::array::from_fn(|i| a[(i + 1) % 3] * b[(i + 2) % 3] - a[(i + 2) % 3] * b[(i + 1) % 3])
    }

    fn unit<const N: usize>(a: Twin<N>) -> Twin<N> {
        times(a, 1.0 / dot(a, a).sqrt())
    }

    fn assert_alike(what: &str, found: &[f64], expected: &[f64]) {
        let scale = expected.iter().fold(0.0, |m: f64, x| m.max(x.abs()));
        for (i, (a, b)) in found.iter().zip(expected).enumerate() {
            assert!((a - b).abs() <= 1e-3 * scale + 1e-6, "{what}, {i}: {a} for {b} of {scale}");
        }
        assert_eq!(found.len(), expected.len());
    }

    fn numbers(vectors: &[Vec3]) -> Vec<f64> {
        vectors.iter().flat_map(|v| v.to_array()).map(f64::from).collect()
    }

    /// A matte triangle, which shines with a radiance of 5 if it is a light.
    fn triangle(corners: [Vec3; 3], light: bool) -> SceneDescription {
        let textures = vec![Texture::constant(Vec3::splat(0.6)), Texture::constant(Vec3::splat(5.0))];
        let kind = MaterialKind::Diffuse { reflectance: Input::Texture(0) };
        let emission = light.then_some(Emission { radiance: Input::Texture(1), two_sided: true });
        let mesh = Mesh { vertices: corners.to_vec(), faces: vec![[0, 1, 2]], ..Default::default() };
        let shapes = vec![Shape { mesh, material: Material { kind, one_sided: false, opacity: None }, emission }];
        SceneDescription { shapes, textures, ..Default::default() }
    }

    /// Where a ray meets a triangle: the position, the barycentric coordinates, both normals and the place in the texture, as all
    /// that the triangle has and the ray move.
    #[test]
    fn sliding_matches_the_dual_number_twin() {
        let mut rng = Pcg32::new(11);
        let mut random = || Vec3::from_array(rng.next_3d()) * 2.0 - 1.0;
        let mut checked = 0;
        for _ in 0..200 {
            let corners: [Vec3; 3] = std::array::from_fn(|_| random());
            let (origin, [d_p, d_ng, d_ns, d_b, d_uv, inside]) =
                (3.0 * random().normalize(), std::array::from_fn(|_| random()));
            let inside = inside.abs() / inside.abs().element_sum();
            let target = corners[0] * inside.x + corners[1] * inside.y + corners[2] * inside.z;
            let dir = (target - origin).normalize();
            let face = (corners[1] - corners[0]).cross(corners[2] - corners[0]).normalize();
            let normals: [Vec3; 3] = std::array::from_fn(|_| (face + 0.4 * random()).normalize());
            let uvs: [Vec2; 3] = std::array::from_fn(|_| random().truncate());
            let mut description = triangle(corners, false);
            description.shapes[0].mesh.normals = Some(normals.to_vec());
            description.shapes[0].mesh.uvs = Some(uvs.to_vec());
            let scene = Scene::new(description).unwrap();
            let Some(hit) = scene.accel.closest(&Ray::new(origin, dir), &[]) else { continue };
            let si = scene.interaction(0, hit.b, -dir);
            if si.ng.dot(dir).abs() < 0.1 {
                continue;
            }
            checked += 1;
            let layout = Layout::new(&scene, &[Slot::Vertices(0), Slot::Normals(0), Slot::Uvs(0)]);
            let mut out = Adjoints::new(&scene, &layout, Dense::new(layout.size()));
            let mut adj = VertexAdjoint { p: d_p, ng: d_ng, ns: d_ns, b: d_b.to_array(), ..Default::default() };
            adj.add_b(out.uv(si.prim, si.b, d_uv.truncate()));
            let ray = slide(&mut out, &si, hit.t, adj);

            let p: [Twin<30>; 3] = std::array::from_fn(|i| variables(corners[i], 3 * i));
            let m: [Twin<30>; 3] = std::array::from_fn(|i| variables(normals[i], 9 + 3 * i));
            let uv = |i: usize, axis: usize| Dual::variable(f64::from(uvs[i][axis]), 18 + 2 * i + axis);
            let (o, d) = (variables(origin, 24), variables(dir, 27));
            let n = cross(minus(p[1], p[0]), minus(p[2], p[0]));
            let t = dot(n, minus(p[0], o)) / dot(n, d);
            let x: Twin<30> = std::array::from_fn(|i| o[i] + t * d[i]);
            let b: Twin<30> = std::array::from_fn(|i| {
                let (next, last) = (p[(i + 1) % 3], p[(i + 2) % 3]);
                dot(n, cross(minus(last, next), minus(x, next))) / dot(n, n)
            });
            let between = |of: &dyn Fn(usize) -> Dual<30>| b[0] * of(0) + b[1] * of(1) + b[2] * of(2);
            let normal = times(unit(n), Dual::constant(f64::from(si.flip)));
            let smooth: Twin<30> = unit(std::array::from_fn(|axis| between(&|i| m[i][axis])));
            let side = dot(smooth, constants(si.ns)).value.signum();
            let mut loss = dot(x, constants(d_p)) + dot(normal, constants(d_ng)) + dot(b, constants(d_b));
            loss = loss + dot(smooth, constants(d_ns)) * side;
            for axis in 0..2 {
                loss = loss + between(&|i| uv(i, axis)) * f64::from(d_uv[axis]);
            }
            let found = [out.sink.data, numbers(&[ray.origin, ray.dir])].concat();
            assert_alike("slide", &found, &loss.partials);
        }
        assert!(checked > 100, "{checked}");
    }

    /// A matte point in the light of a triangle, of a point and of a direction, as both move and the surface turns.
    #[test]
    fn arriving_light_matches_the_dual_number_twin() {
        let mut rng = Pcg32::new(12);
        let mut random = || Vec3::from_array(rng.next_3d()) * 2.0 - 1.0;
        let mut checked = [0; 3];
        for i in 0..600 {
            let corners: [Vec3; 3] = std::array::from_fn(|_| random());
            let (x, ns, a) = (3.0 * random().normalize(), random().normalize(), random());
            let mut description = triangle(corners, i % 3 == 0);
            match i % 3 {
                1 => description.delta_lights.push(DeltaLight::Point { position: corners[0], intensity: a.abs() }),
                2 => description
                    .delta_lights
                    .push(DeltaLight::Directional { direction: corners[0], irradiance: a.abs() }),
                _ => {}
            }
            let slot = if i % 3 == 0 { Slot::Vertices(0) } else { Slot::LightPlacement(0) };
            let scene = Scene::new(description).unwrap();
            let light = scene.sample_light(Vec2::new(0.3, 0.6)).unwrap();
            let Some(arrival) = light.arrive(x) else { continue };
            let si = SurfaceInteraction { p: x, ..vertex(ns, ns, Bsdf::Diffuse { reflectance: Vec3::splat(0.6) }) };
            let f = si.eval(arrival.dir);
            if ns.dot(arrival.dir) < 0.05 || light.n.dot(arrival.dir).abs() < 0.05 && i % 3 == 0 {
                continue;
            }
            checked[i % 3] += 1;
            let layout = Layout::new(&scene, &[slot]);
            let mut out = Adjoints::new(&scene, &layout, Dense::new(layout.size()));
            let arriving = Arriving {
                light: &light,
                dir: arrival.dir,
                distance: arrival.distance,
                geometry: arrival.geometry,
                weight: 0.7,
                masks: Masks { crossings: &[], weight: 0.7 },
            };
            let mut adj = VertexAdjoint::default();
            d_material(&mut out, &si, &arriving, Scattering { f, part: None, a }, &mut adj);

            let (at, normal): (Twin<15>, Twin<15>) = (variables(x, 9), variables(ns, 12));
            let power = 0.7 * 0.6 * f64::from(a.dot(light.power)) / std::f64::consts::PI;
            let p: [Twin<15>; 3] = std::array::from_fn(|k| variables(corners[k], 3 * k));
            let value = match i % 3 {
                0 => {
                    let b = light.b.map(f64::from);
                    let y: Twin<15> = std::array::from_fn(|k| p[0][k] * b[0] + p[1][k] * b[1] + p[2][k] * b[2]);
                    let n = cross(minus(p[1], p[0]), minus(p[2], p[0]));
                    let (to, double_area) = (minus(y, at), dot(n, n).sqrt());
                    let (dir, r2) = (unit(to), dot(to, to));
                    // |cos| / r² dA, of a light of today's area.
                    dot(normal, dir) * dot(n, dir).abs() / r2 * (power / double_area.value)
                }
                1 => {
                    let to = minus(p[0], at);
                    dot(normal, unit(to)) / dot(to, to) * power
                }
                _ => dot(normal, unit(p[0])) * -power,
            };
            let found = [out.sink.data, numbers(&[adj.p, adj.ns])].concat();
            let moves = if i % 3 == 0 { 9 } else { 3 };
            let expected = [&value.partials[..moves], &value.partials[9..]].concat();
            assert_alike(["area", "point", "directional"][i % 3], &found, &expected);
        }
        assert!(checked.iter().all(|n| *n > 40), "{checked:?}");
    }
}
