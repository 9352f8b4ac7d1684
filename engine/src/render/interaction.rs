//! Surface interactions: a point on a surface with everything that shading needs.

use glam::{Vec2, Vec3};

use super::accel::{Hit, NO_PRIM, PrimId, Ray};
use super::bsdf::{Bsdf, BsdfSample, Dielectric, Lobe, Part, refract};
use super::environment::environment_uv;
use super::facets::ShapeShading;
use super::material::{Input, Material};
use super::scene::SphericalMap;
use super::texture::Texture;
use super::world::Scene;
use crate::math::{Frame, luminance};

/// A surface point seen from the direction `wi`.
#[derive(Clone, Copy, Debug)]
pub struct SurfaceInteraction {
    pub prim: PrimId,
    pub shape: u32,
    /// Barycentric coordinates.
    pub b: [f32; 3],
    pub p: Vec3,
    /// Unit geometric normal on the side of `wi`.
    pub ng: Vec3,
    /// Unit shading normal, on the same side of the surface as `ng`.
    pub ns: Vec3,
    /// The right-hand-rule normal is `ng · flip`.
    pub flip: f32,
    /// The interpolated vertex normal is `ns · shading_flip` (before normalisation, and without a normal map); 0 for flat shading.
    pub shading_flip: f32,
    /// A normal map has tilted the shading normal.
    pub mapped: bool,
    /// Unit direction towards the previous vertex.
    pub wi: Vec3,
    pub bsdf: Bsdf,
    /// Emitted radiance towards `wi`.
    pub emission: Vec3,
}

/// All that a path needs of a point on a flat diffuse surface of one colour that emits nothing.
pub(crate) struct Plain {
    pub shape: u32,
    pub p: Vec3,
    /// Unit normal on the side that the ray comes from.
    pub n: Vec3,
    pub reflectance: Vec3,
}

/// The value of one part of a BSDF, diffuse or specular.
#[derive(Clone, Copy, Debug)]
pub struct ChosenPart {
    pub attached: bool,
    /// f·cos of this part.
    pub f: Vec3,
    pub probability: f32,
}

impl Scene {
    /// Texture coordinates of a point. Without uvs, a face's corners have (0,0), (1,0) and (0,1).
    pub(crate) fn uv(&self, prim: PrimId, b: [f32; 3]) -> Vec2 {
        let id = self.prims[prim as usize];
        let mesh = &self.description.shapes[id.shape as usize].mesh;
        match &mesh.uvs {
            Some(uvs) => {
                let [i, j, k] = mesh.faces[id.face as usize].map(|v| uvs[v as usize]);
                i * b[0] + j * b[1] + k * b[2]
            }
            None => Vec2::new(b[1], b[2]),
        }
    }

    /// Value of an input at a point. The value of a texture with one channel is repeated in all three.
    pub(crate) fn lookup(&self, input: Input, prim: PrimId, b: [f32; 3]) -> Vec3 {
        match input {
            Input::Texture(t) => {
                let texture = &self.description.textures[t];
                if texture.is_constant() {
                    texture.color()
                } else if texture.is_mipmapped() {
                    texture.eval_at(self.uv(prim, b), self.level_of_detail(texture, prim, b))
                } else {
                    texture.eval(self.uv(prim, b))
                }
            }
            Input::VertexColor => {
                let id = self.prims[prim as usize];
                let mesh = &self.description.shapes[id.shape as usize].mesh;
                match &mesh.colors {
                    Some(colors) => {
                        let [i, j, k] = mesh.faces[id.face as usize].map(|v| colors[v as usize]);
                        i * b[0] + j * b[1] + k * b[2]
                    }
                    None => Vec3::ONE,
                }
            }
            Input::Tinted(t) => self.lookup(Input::Texture(t), prim, b) * self.lookup(Input::VertexColor, prim, b),
        }
    }

    /// The interaction at a point of a primitive seen along `wi` (unit, away from the surface).
    #[inline(always)]
    pub(crate) fn interaction(&self, prim: PrimId, b: [f32; 3], wi: Vec3) -> SurfaceInteraction {
        let facet = &self.facets[prim as usize];
        let shading = &self.shape_shading[facet.shape as usize];
        let flip = if facet.normal.dot(wi) < 0.0 { -1.0 } else { 1.0 };
        let ng = facet.normal * flip;
        let is_flat = !shading.smooth & !shading.mapped;
        let (ns, shading_flip, mapped) =
            if is_flat { (ng, 0.0, false) } else { self.bent_normal(shading, prim, b, ng, flip) };
        // A BSDF is large: where nothing is done to it, it stays where it is.
        let mut bsdf = match shading.bsdf {
            _ if shading.one_sided && flip < 0.0 => Bsdf::Black,
            // Most surfaces are diffuse, and a copy of that is small.
            Some(Bsdf::Diffuse { reflectance }) => Bsdf::Diffuse { reflectance },
            Some(bsdf) => bsdf,
            None => self.bsdf(&self.description.shapes[facet.shape as usize].material, prim, b),
        };
        if self.has_glass {
            bsdf = bsdf.seen_from(flip > 0.0);
        }
        if shading.grained {
            bsdf = bsdf.laid(self.grain_axes(prim, b, ns, flip));
        }
        let emission =
            if shading.emits && (shading.two_sided || flip > 0.0) { self.emitted(prim, b) } else { Vec3::ZERO };
        SurfaceInteraction {
            prim,
            shape: facet.shape,
            b,
            p: facet.point(b),
            ng,
            ns,
            flip,
            shading_flip,
            mapped,
            wi,
            bsdf,
            emission,
        }
    }

    /// What [`Scene::interaction`] says of a point that a ray in direction `dir` has hit, if it says no more than this: most surfaces of most
    /// scenes are so, and a whole interaction is large.
    #[inline(always)]
    pub(crate) fn plain(&self, hit: &Hit, dir: Vec3) -> Option<Plain> {
        let facet = &self.facets[hit.prim as usize];
        let reflectance = self.shape_shading[facet.shape as usize].plain?;
        let flip = if facet.normal.dot(-dir) < 0.0 { -1.0 } else { 1.0 };
        Some(Plain { shape: facet.shape, p: facet.point(hit.b), n: facet.normal * flip, reflectance })
    }

    /// The normal of a surface with vertex normals or with a normal map, its sign relative to the interpolated normal, and whether the map has
    /// tilted it.
    #[inline(never)]
    fn bent_normal(&self, shading: &ShapeShading, prim: PrimId, b: [f32; 3], ng: Vec3, flip: f32) -> (Vec3, f32, bool) {
        let (ns, shading_flip) = if shading.smooth { self.shading_normal(prim, b, ng) } else { (ng, 0.0) };
        let mapped = if shading.mapped { self.mapped_normal(prim, b, ns, flip) } else { None };
        let (ns, mapped) = mapped.map_or((ns, false), |mapped| (mapped.normal, true));
        (ns, shading_flip, mapped)
    }

    /// The shading normal on the side of `ng`, and its sign relative to the interpolated normal; `ng` and 0 without vertex normals.
    pub(super) fn shading_normal(&self, prim: PrimId, b: [f32; 3], ng: Vec3) -> (Vec3, f32) {
        let id = self.prims[prim as usize];
        let mesh = &self.description.shapes[id.shape as usize].mesh;
        let Some(normals) = &mesh.normals else { return (ng, 0.0) };
        let [i, j, k] = mesh.faces[id.face as usize].map(|v| normals[v as usize]);
        let n = (i * b[0] + j * b[1] + k * b[2]).normalize_or_zero();
        if n == Vec3::ZERO {
            return (ng, 0.0);
        }
        let s = if n.dot(ng) < 0.0 { -1.0 } else { 1.0 };
        (n * s, s)
    }

    /// The radiance emitted at a point of an emitter.
    #[inline(always)]
    pub(crate) fn emitted(&self, prim: PrimId, b: [f32; 3]) -> Vec3 {
        let shape = self.facets[prim as usize].shape as usize;
        self.shape_shading[shape].radiance.unwrap_or_else(|| self.emitted_by_texture(shape, prim, b))
    }

    #[inline(never)]
    fn emitted_by_texture(&self, shape: usize, prim: PrimId, b: [f32; 3]) -> Vec3 {
        let emission = self.description.shapes[shape].emission.as_ref();
        emission.map_or(Vec3::ZERO, |e| self.lookup(e.radiance, prim, b))
    }

    fn bsdf(&self, material: &Material, prim: PrimId, b: [f32; 3]) -> Bsdf {
        material.bsdf(|_, input| self.lookup(*input, prim, b))
    }

    /// The closest surface along a ray.
    #[inline(always)]
    pub fn intersect(&self, ray: &Ray, skip: &[PrimId]) -> Option<(SurfaceInteraction, f32)> {
        let hit = self.accel.closest(ray, skip)?;
        Some((self.interaction(hit.prim, hit.b, -ray.dir), hit.t))
    }

    /// Radiance arriving from infinity against world direction `dir`.
    pub(crate) fn environment_radiance(&self, dir: Vec3) -> Vec3 {
        match &self.description.environment {
            Some(e) => e.value_from(&self.description.textures[e.texels], dir),
            None => Vec3::ZERO,
        }
    }

    /// The radiance of the environment's base: all of it except its peak.
    pub(crate) fn environment_base(&self, dir: Vec3) -> Vec3 {
        match (&self.description.environment, &self.environment_peak) {
            (Some(e), Some(peak)) => e.value_from(&peak.base, dir),
            _ => self.environment_radiance(dir),
        }
    }

    /// The base as a fraction of the environment's radiance, by channel.
    pub(crate) fn environment_base_share(&self, dir: Vec3) -> Vec3 {
        if self.environment_peak.is_none() {
            return Vec3::ONE;
        }
        let (base, all) = (self.environment_base(dir), self.environment_radiance(dir));
        Vec3::select(all.cmpeq(Vec3::ZERO), Vec3::ZERO, base / all)
    }
}

impl SphericalMap {
    /// The value in world direction `dir` of a map that is rotated like this one.
    pub(super) fn value_from(&self, map: &Texture, dir: Vec3) -> Vec3 {
        if map.is_constant() {
            return map.color();
        }
        map.value(&map.environment_footprint(environment_uv(self.rotation.transpose() * dir)))
    }
}

impl SurfaceInteraction {
    /// A placeholder where there is no surface yet.
    pub(crate) const NOWHERE: SurfaceInteraction = SurfaceInteraction {
        prim: NO_PRIM,
        shape: 0,
        b: [0.0; 3],
        p: Vec3::ZERO,
        ng: Vec3::ZERO,
        ns: Vec3::ZERO,
        flip: 1.0,
        shading_flip: 0.0,
        mapped: false,
        wi: Vec3::ZERO,
        bsdf: Bsdf::Black,
        emission: Vec3::ZERO,
    };

    /// A ray that leaves the surface. The query must skip the point's own triangle by its id.
    #[inline]
    pub fn spawn_ray(&self, dir: Vec3) -> Ray {
        Ray { origin: self.p, dir, t_min: offset(self.p), t_max: f32::INFINITY }
    }

    /// A ray to a point at `distance` along `dir`, stopping just before it.
    #[inline]
    pub fn spawn_ray_to(&self, dir: Vec3, distance: f32) -> Ray {
        let ray = self.spawn_ray(dir);
        Ray { t_max: end_before(distance, ray.t_min), ..ray }
    }

    /// f·cos θ towards `wo`, made continuous at the geometric horizon (see [`terminator`]).
    #[inline(always)]
    pub fn eval(&self, wo: Vec3) -> Vec3 {
        let f = self.bsdf.eval(self.ns, self.wi, wo);
        if self.bends() { f * self.terminator(wo) } else { f }
    }

    /// Whether the shading normal may differ from the geometric one; where a normal map is flat, it does not.
    #[inline(always)]
    pub fn bends(&self) -> bool {
        self.shading_flip != 0.0 || self.mapped && self.ns != self.ng
    }

    /// [`SurfaceInteraction::eval`] and [`SurfaceInteraction::pdf`].
    #[inline]
    pub fn eval_and_pdf(&self, wo: Vec3) -> (Vec3, f32) {
        let (f, pdf) = self.bsdf.eval_and_pdf(self.ns, self.wi, wo);
        (if self.bends() { f * self.terminator(wo) } else { f }, pdf)
    }

    /// One part of [`SurfaceInteraction::eval`].
    #[inline]
    pub fn eval_part(&self, part: Part, wo: Vec3) -> Vec3 {
        let f = self.bsdf.eval_part(part, self.ns, self.wi, wo);
        if self.bends() { f * self.terminator(wo) } else { f }
    }

    /// The value towards `wo` split into the part that is differentiated with a fixed direction and the part with an attached one.
    #[inline]
    pub fn eval_split(&self, wo: Vec3) -> [Vec3; 2] {
        if self.bsdf.is_attached() {
            [self.eval_part(Part::Diffuse, wo), self.eval_part(Part::Specular, wo)]
        } else {
            [self.eval(wo), Vec3::ZERO]
        }
    }

    /// Chooses one of the two parts of [`SurfaceInteraction::eval_split`] at random, by [`Bsdf::specular_choice`].
    pub fn choose_part(&self, wo: Vec3, u: f32) -> ChosenPart {
        let [fixed, attached] = self.eval_split(wo);
        let p = self.bsdf.specular_choice(luminance(fixed.abs()), luminance(attached.abs()));
        if u < p {
            ChosenPart { attached: true, f: attached, probability: p }
        } else {
            ChosenPart { attached: false, f: fixed, probability: 1.0 - p }
        }
    }

    /// Solid-angle density with which the BSDF is sampled in direction `wo`, without delta lobes.
    #[inline]
    pub fn pdf(&self, wo: Vec3) -> f32 {
        self.bsdf.pdf(self.ns, self.wi, wo)
    }

    /// Samples a direction, in the world's frame: [`Bsdf::sample`], and the directions of delta lobes. Where a surface has two of these,
    /// neither is chosen with a probability below `least`: for derivatives, which grow beyond all bounds where the share of refracted light
    /// goes to zero, at the angle of total reflection.
    #[inline(never)]
    pub fn sample(&self, u: [f32; 3], least: f32) -> Option<BsdfSample> {
        match self.bsdf {
            Bsdf::Mirror { .. } => self.specular_sample(Lobe::SPECULAR),
            Bsdf::Dielectric(_) => {
                let (lobe, pdf) = self.choose_delta_lobe(u[2], least);
                self.specular_sample(lobe).map(|sample| BsdfSample { pdf, ..sample })
            }
            _ => {
                let frame = Frame::from_normal(self.ns);
                let wi = frame.to_local(self.wi);
                let sample = match self.bsdf.has_grain() {
                    false => self.bsdf.sample(wi, u)?,
                    true => self.bsdf.in_frame(&frame).sample(wi, u)?,
                };
                let wo = frame.to_world(sample.wo);
                Some(BsdfSample { wo, f: sample.f * self.terminator(wo), ..sample })
            }
        }
    }

    /// Chooses one of a specular surface's lobes by the light that each gets, neither of two with a probability below `least`.
    #[inline(always)]
    pub fn choose_delta_lobe(&self, u: f32, least: f32) -> (Lobe, f32) {
        let Bsdf::Dielectric(dielectric) = self.bsdf else { return (Lobe::SPECULAR, 1.0) };
        let reflected = self.interface_reflectance(&dielectric);
        let p = if reflected < 1.0 { reflected.clamp(least, 1.0 - least) } else { 1.0 };
        if u < p { (Lobe::SPECULAR, p) } else { (Lobe::REFRACTED, 1.0 - p) }
    }

    /// The share of the light that a smooth interface reflects.
    fn interface_reflectance(&self, dielectric: &Dielectric) -> f32 {
        dielectric.reflectance(self.ns.dot(self.wi).abs(), self.flip > 0.0)
    }

    /// The sample of a delta lobe, with its share of the light as probability; `None` if the surface has no such lobe or all light goes
    /// into the other. Radiance is in proportion to the square of the index around it, and that changes as it is refracted.
    pub fn specular_sample(&self, lobe: Lobe) -> Option<BsdfSample> {
        match self.bsdf {
            Bsdf::Mirror { reflectance } => (lobe == Lobe::SPECULAR).then(|| BsdfSample {
                wo: self.mirrored(),
                f: reflectance,
                pdf: 1.0,
                lobe,
                eta: 1.0,
            }),
            Bsdf::Dielectric(dielectric) => {
                let reflected = self.interface_reflectance(&dielectric);
                let (share, eta, tint) = match lobe.transmits() {
                    false => (reflected, 1.0, Vec3::ONE),
                    true => (1.0 - reflected, dielectric.eta(self.flip > 0.0), dielectric.tint),
                };
                let wo = if lobe.transmits() { self.refracted(eta)? } else { self.mirrored() };
                let f = tint * (share / (eta * eta));
                (share > 0.0).then_some(BsdfSample { wo, f, pdf: share, lobe, eta })
            }
            _ => None,
        }
    }

    /// The direction in which a smooth interface refracts light from `wi`, with the index `eta` on the far side over that on the near side;
    /// `None` if all light is reflected. If the shading normal would send it back to the near side, it is folded down as
    /// [`SurfaceInteraction::mirrored`] is folded up.
    pub fn refracted(&self, eta: f32) -> Option<Vec3> {
        let dir = refract(self.normal_to_wi(), self.wi, eta)?;
        let height = self.ng.dot(dir);
        Some((if height > 0.0 { dir - self.ng * (2.0 * height) } else { dir }).normalize())
    }

    /// Of rough glass, the direction in which a smooth one would refract `wi`, and the width α of a reflecting lobe as wide as that around this
    /// direction. Where the facets that lie flat reflect all light there is none.
    pub fn refracted_lobe(&self) -> Option<(f32, Vec3)> {
        let rough = match self.bsdf {
            Bsdf::RoughDielectric(rough) => rough,
            Bsdf::RoughPane(pane) => return Some((pane.alpha(), -self.wi)),
            Bsdf::Blended(blended) => return blended.pane_alpha().map(|alpha| (alpha, -self.wi)),
            _ => return None,
        };
        let (n, eta) = (self.normal_to_wi(), rough.eta());
        let dir = refract(n, self.wi, eta)?;
        // A facet that turns by an angle turns a reflection by twice that, or 2c across the plane of incidence, and what passes by |1 − c/(ηs)| or
        // |c/η − s|. Tails are longer than those of a reflection.
        const TAILS: f32 = 1.3;
        let (c, s) = (n.dot(self.wi).max(1e-3), n.dot(dir).abs().max(1e-3));
        let width = 0.5 * (1.0 - c / (eta * s)).abs().max((c / eta - s).abs() / c);
        Some((rough.alpha() * (TAILS * width).clamp(0.05, 1.0), dir))
    }

    /// The shading normal, or its opposite where it is turned away from `wi`.
    pub fn normal_to_wi(&self) -> Vec3 {
        if self.ns.dot(self.wi) < 0.0 { -self.ns } else { self.ns }
    }

    /// Whether the direction of a delta lobe is folded to the side of the surface on which it belongs.
    pub fn folds(&self) -> bool {
        let mirrored = self.ns * (2.0 * self.ns.dot(self.wi)) - self.wi;
        let refracted = match self.bsdf {
            Bsdf::Dielectric(d) => refract(self.normal_to_wi(), self.wi, d.eta(self.flip > 0.0)),
            _ => None,
        };
        self.ng.dot(mirrored) <= 0.0 || refracted.is_some_and(|dir| self.ng.dot(dir) >= 0.0)
    }

    /// The direction in which a perfect mirror reflects `wi`. If the shading normal would reflect it below the surface, the direction is
    /// folded up: mirrored at the plane of the surface. So it is continuous, and no light is lost.
    #[inline]
    pub fn mirrored(&self) -> Vec3 {
        let dir = self.ns * (2.0 * self.ns.dot(self.wi)) - self.wi;
        let height = self.ng.dot(dir);
        (if height < 0.0 { dir - self.ng * (2.0 * height) } else { dir }).normalize()
    }

    #[inline]
    fn terminator(&self, wo: Vec3) -> f32 {
        let side = self.side(wo);
        if self.bends() {
            terminator(self.ng.dot(wo) * side, self.ns.dot(wo) * side, self.ng.dot(self.ns))
        } else {
            1.0
        }
    }

    /// 1 for a direction on the side of the shading normal, −1 for one on the other side, where only what is clear has lobes.
    #[inline(always)]
    pub fn side(&self, wo: Vec3) -> f32 {
        if self.ns.dot(wo) < 0.0 { -1.0 } else { 1.0 }
    }

    /// Whether a direction is on the same side of the surface by both normals, the geometric one and that of shading.
    #[inline(always)]
    pub fn sides_agree(&self, wo: Vec3) -> bool {
        self.ng.dot(wo) * self.side(wo) > 0.0
    }
}

/// Distance at which rays from a surface point begin: a few ulps of the coordinates. It only keeps neighbouring triangles from being hit
/// at distance zero.
#[inline(always)]
pub(crate) fn offset(p: Vec3) -> f32 {
    4e-6 * p.abs().max_element()
}

/// `t_max` of a ray that ends just before a point at `distance`.
#[inline(always)]
pub(crate) fn end_before(distance: f32, offset: f32) -> f32 {
    distance * (1.0 - 1e-5) - offset
}

/// A factor that removes the discontinuity at the horizon of the geometric normal, where the shading normal may still face the light
/// (Chiang et al. 2019, "Taming the Shadow Terminator"): g = (n_g·ω) / ((n_s·ω)(n_g·n_s)) clamped to [0, 1], G = −g³ + g² + g. Without it
/// a smooth mesh would have discontinuities that no edge accounts for, and derivatives would be biased.
#[inline]
pub fn terminator(ng_wo: f32, ns_wo: f32, ng_ns: f32) -> f32 {
    let g = ng_wo / (ns_wo * ng_ns);
    if g >= 1.0 {
        1.0
    } else if g <= 0.0 || g.is_nan() {
        0.0
    } else {
        g * (1.0 + g - g * g)
    }
}

/// Adjoint of [`terminator`]: derivatives in its three arguments times `d_g`.
#[inline]
pub fn d_terminator(ng_wo: f32, ns_wo: f32, ng_ns: f32, d_value: f32) -> (f32, f32, f32) {
    let g = ng_wo / (ns_wo * ng_ns);
    if !(g > 0.0 && g < 1.0) {
        return (0.0, 0.0, 0.0);
    }
    let d_g = d_value * (1.0 + 2.0 * g - 3.0 * g * g);
    (d_g / (ns_wo * ng_ns), -d_g * g / ns_wo, -d_g * g / ng_ns)
}
