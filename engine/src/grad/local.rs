//! Local adjoints of one path vertex, in closed form.

use std::ops::Add;

use glam::Vec3;

use crate::grad::environment::MovingEnvironment;
use crate::grad::sink::Adjoints;
use crate::render::accel::PrimId;
use crate::render::bsdf::{
    Bsdf, BsdfAdjoint, FollowedAdjoint, Lobe, Part, RoughDielectric, d_mirrored_at_plane, d_refract, mirrored_at_plane,
    refract,
};
use crate::render::film::first_hit;
use crate::render::interaction::{SurfaceInteraction, d_terminator, terminator};
use crate::render::light::{LightKind, LightSample};
use crate::render::mask::{MaskCrossing, MaskWeight};
use crate::render::{
    ANISOTROPY, BLEND_WEIGHT, COAT, COAT_ROUGHNESS, COVERS, Camera, ClearCoat, GRAIN, Grain, Input, InputField,
    LAYER_INPUTS, MAX_INPUTS, MaterialKind, Output, Quantity, SHEEN, SHEEN_COLOR, SHEEN_ROUGHNESS, SheenLayer, TURN,
    WEIGHT,
};

/// Adjoints of the numbers of one surface interaction.
#[derive(Clone, Copy, Debug, Default)]
pub struct VertexAdjoint {
    pub p: Vec3,
    pub ng: Vec3,
    pub ns: Vec3,
    pub wi: Vec3,
    pub b: [f32; 3],
}

/// Adjoint of a ray: of its origin and its direction.
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

/// Adjoint of [`SurfaceInteraction::eval`] (or of one part of it) at fixed directions. Adds to the adjoint of the vertex; returns the
/// adjoints of `wo` and of the material's inputs.
pub fn d_eval(
    si: &SurfaceInteraction,
    wo: Vec3,
    part: Option<Part>,
    d_f: Vec3,
    adj: &mut VertexAdjoint,
) -> (Vec3, [Vec3; MAX_INPUTS]) {
    d_eval_with(si, wo, part, d_f, adj, |d| match part {
        Some(part) => si.bsdf.d_eval_part(part, si.ns, si.wi, wo, d),
        None => si.bsdf.d_eval(si.ns, si.wi, wo, d),
    })
}

fn d_eval_with(
    si: &SurfaceInteraction,
    wo: Vec3,
    part: Option<Part>,
    d_f: Vec3,
    adj: &mut VertexAdjoint,
    d_bsdf: impl Fn(Vec3) -> BsdfAdjoint,
) -> (Vec3, [Vec3; MAX_INPUTS]) {
    let co = si.ns.dot(wo);
    let mut d_wo = Vec3::ZERO;
    let mut d_brdf = d_f;
    if si.bends() {
        let side = si.side(wo);
        let (ng_wo, ng_ns) = (si.ng.dot(wo), si.ng.dot(si.ns));
        let g = terminator(ng_wo * side, co * side, ng_ns);
        d_brdf = d_f * g;
        if g < 1.0 {
            let f = match part {
                Some(part) => si.bsdf.eval_part(part, si.ns, si.wi, wo),
                None => si.bsdf.eval(si.ns, si.wi, wo),
            };
            let (a, b, c) = d_terminator(ng_wo * side, co * side, ng_ns, d_f.dot(f));
            let (a, b) = (a * side, b * side);
            adj.ng += wo * a + si.ns * c;
            adj.ns += wo * b + si.ng * c;
            d_wo += si.ng * a + si.ns * b;
        }
    }
    let d = d_bsdf(d_brdf);
    adj.ns += d.directions.n;
    adj.wi += d.directions.wi;
    (d_wo + d.directions.wo, d.d_values)
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

/// Adjoint of [`SurfaceInteraction::refracted`]: adds to that of the vertex, and returns that of `eta`.
fn d_refracted(si: &SurfaceInteraction, eta: f32, mut d_dir: Vec3, adj: &mut VertexAdjoint) -> f32 {
    let n = si.normal_to_wi();
    let Some(dir) = refract(n, si.wi, eta) else { return 0.0 };
    let height = si.ng.dot(dir);
    if height > 0.0 {
        adj.ng -= (d_dir * height + dir * si.ng.dot(d_dir)) * 2.0;
        d_dir -= si.ng * (2.0 * si.ng.dot(d_dir));
    }
    let d = d_refract(n, si.wi, eta, d_dir);
    adj.ns += d.n * n.dot(si.ns).signum();
    adj.wi += d.wi;
    d.eta
}

/// Adjoint of a delta lobe, [`SurfaceInteraction::specular_sample`]: `d_f` is that of the factor on radiance, `d_dir` that of the direction,
/// which follows the normal and `wi`. Adds to the adjoint of the vertex, and returns those of the material's inputs.
pub fn d_specular(
    si: &SurfaceInteraction,
    lobe: Lobe,
    d_f: Vec3,
    d_dir: Vec3,
    adj: &mut VertexAdjoint,
) -> [Vec3; MAX_INPUTS] {
    let mut d_values = [Vec3::ZERO; MAX_INPUTS];
    let Bsdf::Dielectric(dielectric) = si.bsdf else {
        d_mirrored(si, d_dir, adj);
        d_values[0] = d_f;
        return d_values;
    };
    let outside = si.flip > 0.0;
    let (c, eta) = (si.ns.dot(si.wi), dielectric.eta(outside));
    let [by_c, by_ior] = dielectric.d_reflectance(c.abs(), outside);
    let (d_reflectance, d_eta) = if lobe.transmits() {
        // The factor on radiance is τ (1 − F)/η² with the tint τ.
        let share = 1.0 - dielectric.reflectance(c.abs(), outside);
        let d_share = d_f.dot(dielectric.tint);
        if dielectric.is_pane {
            d_values[1] = d_f * share;
        }
        let by_index = -2.0 * share / (eta * eta * eta);
        (-d_share / (eta * eta), d_share * by_index + d_refracted(si, eta, d_dir, adj))
    } else {
        d_mirrored(si, d_dir, adj);
        (d_f.element_sum(), 0.0)
    };
    let d_c = d_reflectance * by_c * c.signum();
    adj.ns += si.wi * d_c;
    adj.wi += si.ns * d_c;
    d_values[0].x = dielectric.d_eta(outside, d_eta) + d_reflectance * by_ior;
    d_values
}

/// Adjoint of a ray that leaves a vertex in the direction of a delta lobe; returns the adjoint of the ray that hit the vertex at distance
/// `t`.
pub fn d_specular_ray(out: &mut Adjoints, si: &SurfaceInteraction, t: f32, lobe: Lobe, ray: RayAdjoint) -> RayAdjoint {
    let mut adj = VertexAdjoint { p: ray.origin, ..Default::default() };
    let d_values = d_specular(si, lobe, Vec3::ZERO, ray.dir, &mut adj);
    d_inputs(out, si, &d_values, &mut adj);
    d_intersection(out, si, t, adj)
}

/// `wi` mirrored to the front of the shading normal, as the BSDF uses it.
fn front(si: &SurfaceInteraction) -> Vec3 {
    let ci = si.ns.dot(si.wi);
    if ci < 0.0 { si.wi - si.ns * (2.0 * ci) } else { si.wi }
}

/// Adjoint of an attached direction: `wo` is `wi` mirrored at a half vector h that turns with the shading normal, by the smallest
/// rotation between the old and the new normal. `d_wo` is passed on to the normal and `wi`; `d_h` is a further adjoint of h.
fn d_attached(si: &SurfaceInteraction, h: Vec3, mut d_h: Vec3, d_wo: Vec3, mut d_wi: Vec3, adj: &mut VertexAdjoint) {
    let wi = front(si);
    let (h_wi, h_d) = (h.dot(wi), h.dot(d_wo));
    d_h += (wi * h_d + d_wo * h_wi) * 2.0;
    d_wi += h * (2.0 * h_d) - d_wo;
    adj.ns += h.cross(d_h).cross(si.ns);
    d_front(si, d_wi, adj);
}

/// Adjoint of the direction `wo` of an attached lobe: adds to that of the vertex, and to that of the index of what lets it through.
pub fn d_attached_direction(
    out: &mut Adjoints,
    si: &SurfaceInteraction,
    wo: Vec3,
    d_wo: Vec3,
    adj: &mut VertexAdjoint,
) {
    let wi = front(si);
    if let Some(rough) = passed(si, wo) {
        if let Some(h) = rough.facet(si.ns, wi, wo) {
            let d_values = d_followed(si, h, &rough.d_direction(h, wi, d_wo), adj);
            d_inputs(out, si, &d_values, adj);
        }
        return;
    }
    let (wo, d_wo) = d_reflected_by_facet(si, wo, d_wo, adj);
    let h = (wi + wo).normalize_or_zero();
    d_attached(si, h, Vec3::ZERO, d_wo, Vec3::ZERO, adj);
}

/// The direction in which an attached facet reflects, and its adjoint, given those of the direction `wo` of the lobe: on the far side of a pane
/// it is mirrored at the plane of the surface, which adds to the adjoint of the vertex.
fn d_reflected_by_facet(si: &SurfaceInteraction, wo: Vec3, d_wo: Vec3, adj: &mut VertexAdjoint) -> (Vec3, Vec3) {
    if si.ns.dot(wo) >= 0.0 || !si.bsdf.has_pane() {
        return (wo, d_wo);
    }
    let reflected = mirrored_at_plane(si.ns, wo);
    let [d_n, d_reflected] = d_mirrored_at_plane(si.ns, reflected, d_wo);
    adj.ns += d_n;
    (reflected, d_reflected)
}

/// The rough interface that light passes towards `wo`; `None` where it does not pass.
fn passed(si: &SurfaceInteraction, wo: Vec3) -> Option<RoughDielectric> {
    match si.bsdf {
        Bsdf::RoughDielectric(rough) if si.ns.dot(wo) < 0.0 => Some(rough),
        _ => None,
    }
}

/// Passes the adjoint of a facet `h` that lets light through on to the vertex, with whose normal it turns; returns that of the inputs.
fn d_followed(si: &SurfaceInteraction, h: Vec3, d: &FollowedAdjoint, adj: &mut VertexAdjoint) -> [Vec3; MAX_INPUTS] {
    adj.ns += d.n + h.cross(d.h).cross(si.ns);
    d_front(si, d.wi, adj);
    let mut d_values = [Vec3::ZERO; MAX_INPUTS];
    (d_values[0].x, d_values[1].x) = (d.ior, d.roughness);
    d_values
}

/// Adjoint of [`front`].
fn d_front(si: &SurfaceInteraction, mut d_wi: Vec3, adj: &mut VertexAdjoint) {
    let ci = si.ns.dot(si.wi);
    if ci < 0.0 {
        // Here `wi` was mirrored at the tangent plane.
        let along = si.ns.dot(d_wi);
        adj.ns -= (d_wi * ci + si.wi * along) * 2.0;
        d_wi -= si.ns * (2.0 * along);
    }
    adj.wi += d_wi;
}

/// Adjoint of the specular part of [`SurfaceInteraction::eval`] for an attached direction. The half vector is sampled and turns with the
/// surface, so the integrand is f·cos·|∂ω/∂h| = 4 f·cos·(wi·h). `d_wo` is the adjoint of the direction through the radiance that arrives
/// from it. Returns the adjoint of the material's inputs.
pub fn d_eval_attached(
    si: &SurfaceInteraction,
    wo: Vec3,
    d_f: Vec3,
    d_wo: Vec3,
    adj: &mut VertexAdjoint,
) -> [Vec3; MAX_INPUTS] {
    let (d_direction, d_values) =
        d_eval_with(si, wo, Some(Part::Specular), d_f, adj, |d| si.bsdf.d_eval_attached(si.ns, si.wi, wo, d));
    let wi = front(si);
    if let Some(rough) = passed(si, wo) {
        // What `d_eval_attached` leaves to be done here: facets that let light through.
        let Some(h) = rough.facet(si.ns, wi, wo) else { return d_values };
        let d_log = d_f.dot(si.eval_part(Part::Specular, wo));
        return d_followed(si, h, &rough.d_followed(si.ns, wi, wo, d_log, d_wo + d_direction), adj);
    }
    let (reflected, d_reflected) = d_reflected_by_facet(si, wo, d_wo + d_direction, adj);
    let h = (wi + reflected).normalize_or_zero();
    let h_wi = h.dot(wi);
    if h_wi <= 0.0 {
        return d_values;
    }
    let by_jacobian = d_f.dot(si.eval_part(Part::Specular, wo)) / h_wi;
    d_attached(si, h, wi * by_jacobian, d_reflected, h * by_jacobian, adj);
    d_values
}

/// Adjoint of a vertex at the intersection of a ray (direction −wi, distance `t`) with its triangle: adds to the adjoints of the
/// triangle's vertices and attributes, and returns the adjoint of the ray.
///
/// ẋ = u + d (n·(V−u))/(n·d), with u the velocity of the ray at the hit and V that of the material point; ḃ_i = ∇b_i·(ẋ−V).
pub fn d_intersection(out: &mut Adjoints, si: &SurfaceInteraction, t: f32, mut adj: VertexAdjoint) -> RayAdjoint {
    let mut base = si.ns;
    if let Some(mapped) = out.scene.mapped_normal_of(si).filter(|_| adj.ns != Vec3::ZERO) {
        let d = mapped.adjoint(adj.ns);
        let d_b = out.input(mapped.input, si.prim, si.b, d.value, true);
        adj.add_b(d_b);
        let d_b = out.tangent(si.prim, si.b, d.tangent);
        adj.add_b(d_b);
        (adj.ns, base) = (d.base, mapped.base());
    }
    if si.shading_flip == 0.0 {
        adj.ng += adj.ns;
    } else if adj.ns != Vec3::ZERO {
        // ns = flip · M/|M|, M = Σ b n; |M| from the interpolated normals again.
        let id = out.scene.prims[si.prim as usize];
        let mesh = &out.scene.description.shapes[id.shape as usize].mesh;
        if let Some(normals) = &mesh.normals {
            let face = mesh.faces[id.face as usize];
            let m: Vec3 = face.iter().zip(si.b).map(|(&v, b)| normals[v as usize] * b).sum();
            let d_m = (adj.ns - base * base.dot(adj.ns)) * (si.shading_flip / m.length());
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
fn barycentric_gradient(out: &Adjoints, prim: PrimId, d_b: [f32; 3]) -> Vec3 {
    let [p0, p1, p2] = out.scene.corners(prim);
    let n = (p1 - p0).cross(p2 - p0);
    let double_area_squared = n.length_squared();
    if double_area_squared <= 0.0 {
        return Vec3::ZERO;
    }
    n.cross((p2 - p1) * d_b[0] + (p0 - p2) * d_b[1] + (p1 - p0) * d_b[2]) / double_area_squared
}

/// Adjoint of a material's inputs at a vertex.
pub fn d_inputs(out: &mut Adjoints, si: &SurfaceInteraction, d: &[Vec3; MAX_INPUTS], adj: &mut VertexAdjoint) {
    let material = &out.scene.description.shapes[si.shape as usize].material;
    let mut add = |field: InputField, input: Input, d: Vec3| {
        let d = if field.quantity == Quantity::Color { d } else { Vec3::X * d.x };
        if d != Vec3::ZERO {
            let d_b = out.input(input, si.prim, si.b, d, true);
            adj.add_b(d_b);
        }
    };
    // This runs for every vertex of every path: `inputs` would write down all fields first.
    let mut d_turn = 0.0;
    type Covers<'a> = (&'a Option<SheenLayer>, &'a Option<ClearCoat>);
    let mut of_layer = |kind: &MaterialKind, grain: &Option<Grain>, (sheen, coat): Covers, d: &[Vec3]| {
        let mut of_model = d.iter();
        kind.map(|field, input| add(field, *input, of_model.next().copied().unwrap_or_default()));
        if let Some(grain) = grain {
            let d = d[GRAIN];
            add(ANISOTROPY, grain.anisotropy, d);
            add(TURN, grain.turn, Vec3::X * d.y);
            d_turn += d.y;
        }
        if let Some(sheen) = sheen {
            add(SHEEN, sheen.color, d[SHEEN_COLOR]);
            add(SHEEN_ROUGHNESS, sheen.roughness, Vec3::X * d[COVERS].z);
        }
        if let Some(coat) = coat {
            let d = d[COVERS];
            add(COAT, coat.weight, d);
            add(COAT_ROUGHNESS, coat.roughness, Vec3::X * d.y);
        }
    };
    of_layer(&material.kind, &material.grain, (&material.sheen, &material.coat), &d[..LAYER_INPUTS]);
    if let Some(blend) = &material.blend {
        of_layer(&blend.kind, &blend.grain, (&blend.sheen, &blend.coat), &d[LAYER_INPUTS..BLEND_WEIGHT]);
        add(WEIGHT, blend.weight, d[BLEND_WEIGHT]);
    }
    // Grains turn with the texture coordinates that they are told in.
    if d_turn != 0.0
        && let Some([d_ns, d_tangent]) = out.scene.d_grain_axes(si, d_turn)
    {
        adj.ns += d_ns;
        let d_b = out.tangent(si.prim, si.b, d_tangent);
        adj.add_b(d_b);
    }
}

/// Adjoint of what a body does not absorb on a way of length `t` ([`attenuation`](crate::render::bodies::attenuation)), given that of its
/// logarithm. Adds to the adjoint of the absorption, and returns that of the length.
pub fn d_attenuation(out: &mut Adjoints, si: &SurfaceInteraction, body: u32, t: f32, d_log: Vec3) -> f32 {
    let scene = out.scene;
    let MaterialKind::Dielectric { absorption: Some(input), .. } =
        scene.description.shapes[body as usize].material.kind
    else {
        return 0.0;
    };
    if !t.is_finite() {
        return 0.0; // nothing is left, or nothing is absorbed
    }
    // The same everywhere in the body, so that the place does not matter.
    out.input(input, si.prim, si.b, d_log * -t, false);
    -d_log.dot(scene.lookup(input, si.prim, si.b))
}

/// [`d_attenuation`] on the way to a light, whose point is fixed to it or `slides` over it.
pub fn d_attenuation_to(
    out: &mut Adjoints,
    si: &SurfaceInteraction,
    body: u32,
    c: &IncidentLight,
    d_log: Vec3,
    slides: bool,
    adj: &mut VertexAdjoint,
) {
    let d_end = c.dir * d_attenuation(out, si, body, c.distance, d_log);
    adj.p -= d_end;
    match c.light.kind {
        LightKind::Area if slides => {
            let there = out.scene.interaction(c.light.prim, c.light.b, -c.dir);
            let at_light = VertexAdjoint { p: d_end, ..Default::default() };
            adj.p += d_intersection(out, &there, c.distance, at_light).origin;
        }
        LightKind::Area => out.material_point(c.light.prim, c.light.b, d_end),
        LightKind::Point(i) => out.light_placement(i, d_end),
        LightKind::Directional(_) | LightKind::Environment => {}
    }
}

/// Adjoint of emission at the hit of a ray with a fixed direction (camera rays, mirrors).
pub fn d_emission_sliding(out: &mut Adjoints, si: &SurfaceInteraction, d: Vec3, adj: &mut VertexAdjoint) {
    if let Some(input) = emission_input(out, si.prim) {
        let d_b = out.input(input, si.prim, si.b, d, true);
        adj.add_b(d_b);
    }
}

/// Adjoint of a light's power (radiance times the opacity of its mask) at a point. Returns the adjoint of b as [`Adjoints::input`] does.
fn d_light_power(out: &mut Adjoints, prim: PrimId, b: [f32; 3], d: Vec3, slides: bool) -> [f32; 3] {
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
pub fn d_opacity(out: &mut Adjoints, si: &SurfaceInteraction, d: f32, adj: &mut VertexAdjoint) {
    if let Some(input) = opacity_input(out, si.prim) {
        let d_b = out.input(input, si.prim, si.b, Vec3::X * d, true);
        adj.add_b(d_b);
    }
}

/// Adjoint of the transmittance of masks along a line: `d` is the adjoint of the product of their weights. Returns the adjoint of the
/// line as a ray along `dir`.
pub fn d_masks(out: &mut Adjoints, dir: Vec3, crossings: &[MaskCrossing], d: f32) -> RayAdjoint {
    let mut ray = RayAdjoint::default();
    for (i, c) in crossings.iter().enumerate() {
        let others: f32 = crossings.iter().enumerate().filter(|&(j, _)| j != i).map(|(_, c)| c.weight()).product();
        let d_opacity_here = -d * others * c.inv_choice;
        if d_opacity_here != 0.0 {
            let si = out.scene.interaction(c.prim, c.b, -dir);
            let mut adj = VertexAdjoint::default();
            d_opacity(out, &si, d_opacity_here, &mut adj);
            ray = ray + d_intersection(out, &si, c.t, adj);
        }
    }
    ray
}

fn opacity_input(out: &Adjoints, prim: PrimId) -> Option<Input> {
    out.scene.description.shapes[out.scene.prims[prim as usize].shape as usize].material.opacity
}

pub fn emission_input(out: &Adjoints, prim: PrimId) -> Option<Input> {
    let shape = out.scene.prims[prim as usize].shape as usize;
    out.scene.description.shapes[shape].emission.as_ref().map(|e| e.radiance)
}

/// Adjoint of light that arrives at a vertex: with the light's point fixed on its surface or, if it `slides`, where surfaces touch or
/// through an attached lobe, with a point that slides.
pub fn d_incident(
    out: &mut Adjoints,
    si: &SurfaceInteraction,
    c: &IncidentLight,
    a: Vec3,
    slides: bool,
    environment: MovingEnvironment,
    adj: &mut VertexAdjoint,
) -> [Vec3; MAX_INPUTS] {
    if c.light.is_delta() {
        return d_material_fixed(out, si, c, Scattering { f: si.eval(c.dir), part: None, a }, adj);
    }
    let [fixed, attached] = si.eval_split(c.dir);
    let part = si.bsdf.is_attached().then_some(Part::Diffuse);
    let scattering = Scattering { f: fixed, part, a };
    let slides = slides || c.light.kind == LightKind::Area && out.scene.touch(si.prim, c.light.prim);
    let splits = c.light.kind == LightKind::Environment
        && environment != MovingEnvironment::Whole
        && out.layout.turns_environment();
    let mut d_values = if splits && !slides {
        d_environment_light(out, si, c, scattering, environment, adj)
    } else if !slides {
        d_material_fixed(out, si, c, scattering, adj)
    } else {
        let d_f = a * c.light.power * (c.geometry * c.weight);
        d_direction_fixed(out, c, a * fixed, adj);
        d_eval(si, c.dir, part, d_f, adj).1
    };
    if si.bsdf.is_attached() {
        let d_f = a * c.light.power * (c.geometry * c.weight);
        let d_dir = d_direction_fixed(out, c, a * attached, adj);
        let more = d_eval_attached(si, c.dir, d_f, d_dir, adj);
        si.bsdf.add_values(&mut d_values, &more);
    }
    d_values
}

/// Adjoint of radiance from a direction of the environment, of which a part turns with the environment and the rest has a fixed
/// direction.
fn d_environment_light(
    out: &mut Adjoints,
    si: &SurfaceInteraction,
    c: &IncidentLight,
    scattering: Scattering,
    environment: MovingEnvironment,
    adj: &mut VertexAdjoint,
) -> [Vec3; MAX_INPUTS] {
    let Scattering { f, part, a } = scattering;
    let rest = c.light.power * environment.direction_fixed_share(out.scene, c.dir);
    let turning = LightSample { power: c.light.power - rest, ..*c.light };
    let mut d_values = d_material_fixed(out, si, &IncidentLight { light: &turning, ..*c }, scattering, adj);
    let scale = c.geometry * c.weight;
    out.environment_base(c.dir, a * f * scale);
    adj.p += d_masks(out, c.dir, c.masks.crossings, a.dot(f * rest) * c.geometry * c.masks.weight).origin;
    let more = d_eval(si, c.dir, part, a * rest * scale, adj).1;
    si.bsdf.add_values(&mut d_values, &more);
    d_values
}

/// Adjoint of the emission at the hit of a ray, which slides over the light; `a` includes the BSDF. Adds to the adjoint of the hit, and
/// returns that of the direction.
fn d_direction_fixed(out: &mut Adjoints, c: &IncidentLight, a: Vec3, adj: &mut VertexAdjoint) -> Vec3 {
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
            ray = ray + d_intersection(out, &there, c.distance, d_light);
        }
    }
    adj.p += ray.origin;
    ray.dir
}

/// Light arriving at a vertex from a light sample: contribution a·(f·power)·geometry·weight.
#[derive(Clone, Copy)]
pub struct IncidentLight<'a> {
    pub light: &'a LightSample,
    pub dir: Vec3,
    pub distance: f32,
    pub geometry: f32,
    pub weight: f32,
    pub masks: Masks<'a>,
}

/// Masks between light and vertex; `weight` does not include them.
#[derive(Clone, Copy)]
pub struct Masks<'a> {
    pub crossings: &'a [MaskCrossing],
    pub weight: f32,
}

/// The scattering of light at a vertex: by a part of its BSDF or all of it, with the value `f`; `a` is the adjoint of the scattered
/// radiance.
#[derive(Clone, Copy)]
pub struct Scattering {
    pub f: Vec3,
    pub part: Option<Part>,
    pub a: Vec3,
}

/// Adjoint of light from a point that is fixed on its light's surface.
pub fn d_material_fixed(
    out: &mut Adjoints,
    si: &SurfaceInteraction,
    c: &IncidentLight,
    Scattering { f, part, a }: Scattering,
    adj: &mut VertexAdjoint,
) -> [Vec3; MAX_INPUTS] {
    let light = c.light;
    let scale = c.geometry * c.weight;
    let (mut d_dir, d_values) = d_eval(si, c.dir, part, a * light.power * scale, adj);
    let d_power = a * f * scale;
    let d_value = a.dot(f * light.power);
    let d_geometry = d_value * c.weight;
    // The point at which the line crosses a mask moves with both its ends.
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
            // The measure is dA = 2A du dv. The sampling density contains 1/A but is a constant to the derivative, so that the derivative
            // of the area remains.
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
            // light.power = intensity · profile
            let delta = &out.scene.description.delta_lights[i as usize];
            out.light_power(i, d_power * out.scene.profile(delta, -c.dir));
            d_dir -= out.light_profile(i, -c.dir, d_power * delta.power());
            let d = c.dir * d_r + (d_dir - c.dir * c.dir.dot(d_dir)) / c.distance;
            adj.p -= d;
            out.light_placement(i, d);
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

/// Passes the adjoint of the unit direction towards a directional light on to the light's `direction`, which points the opposite way.
pub fn d_direction(out: &mut Adjoints, light: u32, d_towards: Vec3) {
    if let crate::render::DeltaLight::Directional { direction, .. } = out.scene.description.delta_lights[light as usize]
    {
        out.light_placement(light, crate::math::d_normalize(direction, -d_towards));
    }
}

/// Adjoint of a first-hit channel (`first_hit`) seen through masks; returns the adjoint of the camera ray. The direct dependence of the
/// depth channel on the camera is added to `out.camera`.
pub fn d_first_hit(
    out: &mut Adjoints,
    output: Output,
    camera: &Camera,
    (si, t): (&SurfaceInteraction, f32),
    through: &MaskWeight,
    d: Vec3,
) -> RayAdjoint {
    let mut adj = VertexAdjoint::default();
    d_opacity(out, si, d.dot(first_hit(out.scene, output, camera, si)) * through.pass * through.inv_choice, &mut adj);
    let d = d * through.weight;
    match output {
        Output::Radiance | Output::Alpha | Output::ShapeIndex => {}
        Output::Depth => {
            let axis = camera.axis();
            adj.p += axis * d.x;
            out.camera.origin -= axis * d.x;
            camera.d_axis((si.p - camera.origin) * d.x, &mut out.camera);
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
    d_intersection(out, si, t, adj)
}

#[cfg(test)]
mod tests;
