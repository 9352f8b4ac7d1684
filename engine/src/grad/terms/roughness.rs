//! Derivatives of GGX lobes in their roughness, sampled by pairs of directions.
//!
//! ∂D/∂α changes sign at tan²θ = α², and its integral on either side is ±1/(2α). With the lobe's own samples it would be a score of that
//! size and either sign, whose mean is a small difference. Instead each side is a density and is sampled exactly (positivisation, Belhe
//! et al. 2024), with the same random numbers for both:
//!
//!   ∂I/∂α = 1/(2α) E[ h(tail) − h(core) ],   h = 4 (wi·h) / cosθ_h × the integrand without D,
//!
//! If the radiance is smooth, the difference has little noise. Light samples of the same integrand are combined by the balance heuristic.
//! Other dependencies of the lobe on α (shadowing) are left to [`crate::grad::terms::interior`], in which the distribution is constant
//! then.
//!
//! Only used if nothing but materials and lights is requested: where points slide, roughness textures slide with them.

use glam::Vec3;

use crate::grad::estimate::{Draw, Estimate, Pass, Sequence};
use crate::grad::path::{Path, PathVertex};
use crate::grad::sampling::allocate::{Estimator, typical_bounces};
use crate::grad::sampling::pixels::{self, FilmCurve, FilmSample};
use crate::grad::sink::Layout;
use crate::image::Image;
use crate::math::Frame;
use crate::render::bsdf::{Part, RoughnessPair};
use crate::render::integrator::{NoRecord, Options, Start, trace};
use crate::render::interaction::SurfaceInteraction;
use crate::render::light::LightKind;
use crate::render::sampler::Sampler;
use crate::render::{Camera, Output, Scene, Settings, Slot};

/// The estimator: paths that end in a pair of directions.
pub struct RoughnessPairs<'a> {
    scene: &'a Scene,
    camera: &'a Camera,
    settings: &'a Settings,
    film: FilmCurve,
    count: usize,
    /// By shape: whether its roughness is requested.
    requested: Vec<bool>,
}

impl<'a> RoughnessPairs<'a> {
    /// `None` if no GGX roughness is requested, if other slots than those of materials and lights are, or if there is no environment:
    /// then all light has outlines, and scores of light samples have less noise than differences across an outline.
    pub fn new(
        scene: &'a Scene,
        camera: &'a Camera,
        settings: &'a Settings,
        layout: &Layout,
        adjoint: &Image,
    ) -> Option<RoughnessPairs<'a>> {
        let still = |slot: &Slot| matches!(slot, Slot::Texels(_) | Slot::Colors(_) | Slot::LightPower(_));
        let outlined = scene.description.environment.is_none();
        if outlined
            || settings.output != Output::Radiance
            || !settings.has_paths()
            || settings.max_bounces == 0
            || !layout.slots.iter().all(still)
        {
            return None;
        }
        let requested: Vec<bool> = scene
            .description
            .shapes
            .iter()
            .enumerate()
            .map(|(i, shape)| {
                let roughness = shape.material.ggx_roughness();
                roughness.is_some_and(|input| layout.slots.iter().any(|slot| slot.is_read_by(input, i)))
            })
            .collect();
        let count = (pixels::active(adjoint) * settings.spp.max(1) as usize).div_ceil(2);
        let pairs = RoughnessPairs { scene, camera, settings, film: FilmCurve::new(camera, adjoint), count, requested };
        pairs.requested.contains(&true).then_some(pairs)
    }

    fn sample(&self, film: &FilmSample, path: &mut Path, sampler: &mut Sampler, out: &mut dyn Estimate) {
        let camera = self.camera.sample_lens(sampler);
        let ray = camera.ray(film.position);
        // The first scattering event after the path is that of the pair.
        let options = Options { next_event: false, ..Options::new(self.settings.max_bounces - 1) };
        path.clear();
        trace(self.scene, Start::Ray(ray, &[]), sampler, &options, path);
        let vertices = &path.vertices()[..path.vertices().len().min(self.settings.max_bounces as usize)];
        let strength = |v: &PathVertex| {
            let requested = self.requested[v.si.shape as usize] && v.si.bsdf.roughness_pair().is_some();
            if requested { (v.throughput * v.through.weight).max_element().max(1e-3) } else { 0.0 }
        };
        let total: f32 = vertices.iter().map(strength).sum();
        if total <= 0.0 {
            return;
        }
        let mut x = sampler.next_1d() * total;
        let chosen = vertices.iter().position(|v| {
            x -= strength(v);
            x < 0.0
        });
        let Some(k) = chosen else { return };
        let v = &vertices[k];
        let Some(pair) = v.si.bsdf.roughness_pair() else { return };
        let by_light = self.light(&v.si, &pair, sampler);
        let radiance = by_light + self.directions(&v.si, &pair, self.settings.max_bounces - k as u32, sampler);
        let weight = v.throughput * v.through.weight * (film.weight as f32 * total / strength(v));
        let d_roughness = radiance * weight;
        let input = self.scene.description.shapes[v.si.shape as usize].material.ggx_roughness();
        if let Some(input) = input.filter(|_| d_roughness != Vec3::ZERO && d_roughness.is_finite()) {
            out.pixel(film.pixel, &mut |d, out| {
                out.input(input, v.si.prim, v.si.b, Vec3::X * d.dot(d_roughness), false);
            });
        }
    }

    /// The derivative in the roughness from two sampled directions, with `events` scattering events left.
    fn directions(&self, si: &SurfaceInteraction, pair: &RoughnessPair, events: u32, sampler: &mut Sampler) -> Vec3 {
        let frame = Frame::from_normal(si.ns);
        let wi = frame.to_local(si.wi);
        let wi = Vec3::new(wi.x, wi.y, wi.z.abs());
        let sides = pair.sample(wi, sampler.next_2d().to_array());
        let mut sum = Vec3::ZERO;
        for wo in sides.into_iter().flatten() {
            let dir = frame.to_world(wo).normalize();
            let f = si.eval_part(Part::Specular, dir);
            let (score, pdf) = pair.score_and_pdf(Vec3::Z, wi, wo);
            if f == Vec3::ZERO || si.ng.dot(dir) <= 0.0 || pdf <= 0.0 {
                continue;
            }
            // Both directions use the same random numbers.
            let mut sampler = sampler.clone();
            let found = match self.scene.random_interaction(&si.spawn_ray(dir), &[si.prim], &mut sampler) {
                Some((next, t)) => {
                    let to_area = next.ng.dot(next.wi) / (t * t);
                    let direct = next.emission * balance(pdf, self.scene.lights.area_pdf(next.prim) / to_area);
                    let options = Options { first_emission: false, ..Options::new(events - 1) };
                    let found = direct + trace(self.scene, Start::Surface(next), &mut sampler, &options, &mut NoRecord);
                    self.scene.attenuation_from(si.p, t) * found
                }
                None => {
                    let sky = self.scene.environment_radiance(dir) * balance(pdf, self.scene.environment_pdf(dir));
                    self.scene.attenuation_from(si.p, f32::INFINITY) * sky
                }
            };
            sum += f * found * (score / pdf);
        }
        sum
    }

    /// The derivative in the roughness from a light sample.
    fn light(&self, si: &SurfaceInteraction, pair: &RoughnessPair, sampler: &mut Sampler) -> Vec3 {
        let Some(mut light) = self.scene.sample_light(sampler.next_2d()) else { return Vec3::ZERO };
        let Some(arrival) = self.scene.arrive(&mut light, si.p) else { return Vec3::ZERO };
        let f = si.eval_part(Part::Specular, arrival.dir);
        if f == Vec3::ZERO || si.ng.dot(arrival.dir) <= 0.0 {
            return Vec3::ZERO;
        }
        let (score, pdf) = pair.score_and_pdf(si.ns, si.wi, arrival.dir);
        let mut weight = arrival.geometry / light.pdf;
        if !light.is_delta() {
            let per_angle = if light.kind == LightKind::Area { light.pdf / arrival.geometry } else { light.pdf };
            weight *= balance(per_angle, pdf);
        }
        let ray = si.spawn_ray_to(arrival.dir, arrival.distance);
        let through = self.scene.transmittance(&ray, &[si.prim, light.prim]);
        f * light.power * self.scene.attenuation_from(si.p, arrival.distance) * (score * weight * through)
    }
}

fn balance(a: f32, b: f32) -> f32 {
    a / (a + b)
}

impl Draw for RoughnessPairs<'_> {
    type Scratch = Path;

    fn draw(&self, first: f64, mut sampler: Sampler, weight: f64, path: &mut Path, out: &mut dyn Estimate) {
        let film = self.film.place(first, sampler.next_2d());
        self.sample(&FilmSample { weight: film.weight * weight, ..film }, path, &mut sampler, out);
    }
}

impl Estimator for RoughnessPairs<'_> {
    fn count(&self) -> usize {
        self.count
    }

    fn cost(&self) -> f64 {
        3.0 + 5.0 * typical_bounces(self.settings.max_bounces)
    }

    fn pass(&self, count: usize, share: f64, seed: u64) -> impl Pass + '_ {
        Sequence { of: self, count, weight: share / count as f64, seed }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::texture::Texture;
    use crate::render::{Input, Material, MaterialKind, SceneDescription, Shape, SphericalMap};

    /// A single sample of a single pixel is not rounded down to none.
    #[test]
    fn the_smallest_image_has_a_pair() {
        let (reflectance, roughness) = (Input::Texture(0), Input::Texture(1));
        let material = Material::from(MaterialKind::Conductor { reflectance, roughness });
        let mesh = crate::mesh::shapes::rectangle(2.0, 2.0).unwrap();
        let textures = vec![Texture::constant(Vec3::ONE), Texture::constant_scalar(0.4)];
        let environment = Some(SphericalMap { texels: 0, rotation: glam::Mat3::IDENTITY });
        let shapes = vec![Shape { mesh, material, emission: None }];
        let scene = Scene::new(SceneDescription { shapes, textures, environment, ..Default::default() }).unwrap();
        let camera = Camera { scale: [0.5; 2], ..Camera::look_at(Vec3::Z, Vec3::ZERO, Vec3::Y, 1.0, [1, 1]) };
        let settings = Settings {
            output: Output::Radiance,
            spp: 1,
            max_bounces: 1,
            seed: 1,
            boundary: true,
            ..Settings::default()
        };
        let layout = Layout::new(&scene, &[Slot::Texels(1)]);
        let mut adjoint = Image::new(1, 1, 3);
        adjoint.data.fill(1.0);
        let pairs = RoughnessPairs::new(&scene, &camera, &settings, &layout, &adjoint).unwrap();
        assert_eq!(pairs.count(), 1);
    }
}
