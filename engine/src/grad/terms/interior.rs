//! The interior term: camera paths, which are recorded side by side and swept backwards one after the other (`grad::path`).

use std::ops::Range;

use glam::Vec3;

use crate::grad::environment::MovingEnvironment;
use crate::grad::estimate::{Estimate, Pass, Sequence};
use crate::grad::local::{RayAdjoint, d_first_hit, d_masks};
use crate::grad::path::{Detached, Path, area_sampling_fraction, sweep};
use crate::grad::sampling::allocate::{Estimator, typical_bounces};
use crate::grad::sampling::pixels::{self, FilmCurve, FilmSample};
use crate::grad::sink::Layout;
use crate::image::Image;
use crate::render::accel::{Kernel, Ray};
use crate::render::film::first_hit;
use crate::render::integrator::{self, BATCH, Options, Recorder};
use crate::render::mask::{MaskCrossing, MaskSampling};
use crate::render::sampler::Sampler;
use crate::render::{Camera, DeltaLight, Input, MaterialKind, Output, Scene, Settings, Shape, Slot, TextureId};

/// The interior term: camera paths, swept backwards.
#[derive(Clone)]
pub struct Interior<'a> {
    scene: &'a Scene,
    camera: &'a Camera,
    settings: &'a Settings,
    film: FilmCurve,
    count: usize,
    mask_sampling: MaskSampling,
    area_sampling_fraction: f32,
    required_shapes: Option<Vec<bool>>,
    /// What is taken as fixed while a path is differentiated.
    pub detached: Detached,
}

impl<'a> Interior<'a> {
    /// By default there are as many paths as the image has samples in pixels where the adjoint is not zero.
    pub fn new(
        scene: &'a Scene,
        camera: &'a Camera,
        settings: &'a Settings,
        layout: &Layout,
        adjoint: &Image,
    ) -> Interior<'a> {
        let count = pixels::active(adjoint) * settings.spp.max(1) as usize;
        Interior {
            scene,
            camera,
            settings,
            film: FilmCurve::new(camera, adjoint),
            count,
            mask_sampling: mask_sampling(scene, layout),
            area_sampling_fraction: area_sampling_fraction(layout),
            required_shapes: required_shapes(scene, layout),
            detached: Detached { distributions: false, environment: MovingEnvironment::Whole },
        }
    }

    /// The derivative of a first-hit channel at a film position; `weight` is that of the pixel's adjoint.
    fn first_hit(&self, camera_ray: &CameraRay, sampler: &mut Sampler, path: &mut Path, out: &mut dyn Estimate) {
        let (output, CameraRay { camera, ray, film, weight }) = (self.settings.output, camera_ray);
        path.clear();
        let (hit, through) = self.scene.sample_interaction(ray, &[], sampler, self.mask_sampling, |c| path.cross(&c));
        let Some((si, t)) = hit else { return };
        out.pixel(film.pixel, &mut |d, out| {
            let d = d * *weight;
            let r = d_first_hit(out, output, camera, (&si, t), &through, d);
            let d_pass = d.dot(first_hit(self.scene, output, camera, &si)) * through.opacity * through.inv_choice;
            let r = r + d_masks(out, ray.dir, &path.crossings, d_pass);
            camera.d_ray(film.position, r.origin, r.dir, &mut out.camera);
        });
    }

    /// The derivative of the radiance along a recorded path.
    fn sweep(&self, camera_ray: &CameraRay, path: &Path, out: &mut dyn Estimate) {
        let CameraRay { camera, ray, film, weight } = camera_ray;
        out.pixel(film.pixel, &mut |d, out| {
            let d = d * *weight;
            let ray_adjoint = if path.vertices().is_empty() {
                let pass: f32 = path.crossings.iter().map(MaskCrossing::weight).product();
                let dir = out.environment(ray.dir, d * pass);
                let d_pass = d.dot(self.scene.environment_radiance(ray.dir));
                RayAdjoint { origin: Vec3::ZERO, dir } + d_masks(out, ray.dir, &path.crossings, d_pass)
            } else {
                sweep(out, path, d, self.detached)
            };
            if !out.layout.is_static {
                camera.d_ray(film.position, ray_adjoint.origin, ray_adjoint.dir, &mut out.camera);
            }
        });
    }
}

/// The film sample of a path and the camera at its lens point.
#[derive(Clone, Copy)]
struct CameraRay {
    camera: Camera,
    ray: Ray,
    film: FilmSample,
    /// Weight of the pixel's adjoint.
    weight: f32,
}

/// A range of a sequence's samples: recorded side by side in batches, as those of the image are, and swept one after the other.
struct Batches<'a> {
    of: &'a Sequence<'a, Interior<'a>>,
    items: Range<usize>,
    out: &'a mut dyn Estimate,
}

impl Kernel for Batches<'_> {
    #[inline(always)]
    fn run(self) {
        let Batches { of, items, out } = self;
        let interior = of.of;
        let options = Options {
            keep_black: true,
            split_lobes: true,
            mask_sampling: interior.mask_sampling,
            area_sampling_fraction: interior.area_sampling_fraction,
            required_shapes: interior.required_shapes.as_deref(),
            ..Options::new(interior.settings.max_bounces)
        };
        let mut paths: [Path; BATCH] = std::array::from_fn(|_| Path::default());
        let mut together = integrator::Paths::<BATCH>::new();
        let mut camera_rays: Vec<CameraRay> = Vec::with_capacity(BATCH);
        let mut rays = [Ray::new(Vec3::ZERO, Vec3::ZERO); BATCH];
        let mut points = of.points(items.start);
        let mut next = items.start;
        while next < items.end {
            if !points.has(next as u64) {
                points = of.points(next);
            }
            let mut samplers: [Sampler; BATCH] = std::array::from_fn(|_| Sampler::new(0, 0));
            camera_rays.clear();
            for i in (next..items.end.min(next + BATCH)).take_while(|&i| points.has(i as u64)) {
                let k = camera_rays.len();
                let (first, mut sampler) = of.point(i, &points);
                let film = interior.film.place(first, sampler.next_2d());
                let camera = interior.camera.sample_lens(&mut sampler);
                let weight = (film.weight * of.weight) as f32;
                (rays[k], samplers[k]) = (camera.ray(film.position), sampler);
                camera_rays.push(CameraRay { camera, ray: rays[k], film, weight });
                paths[k].clear();
            }
            next += camera_rays.len();
            if interior.settings.output == Output::Radiance {
                together.trace(interior.scene, &rays[..camera_rays.len()], &mut samplers, &options, &mut paths);
            }
            for ((camera_ray, path), sampler) in camera_rays.iter().zip(&mut paths).zip(&mut samplers) {
                match interior.settings.output {
                    Output::Radiance => interior.sweep(camera_ray, path, out),
                    _ => interior.first_hit(camera_ray, sampler, path, out),
                }
            }
        }
    }
}

impl Pass for Sequence<'_, Interior<'_>> {
    fn items(&self) -> usize {
        self.count
    }

    fn run(&self, items: Range<usize>, out: &mut dyn Estimate) {
        self.of.scene.accel.run(Batches { of: self, items, out });
    }
}

impl Estimator for Interior<'_> {
    fn count(&self) -> usize {
        self.count
    }

    fn cost(&self) -> f64 {
        match self.settings.output {
            Output::Radiance => 2.5 * (1.0 + 2.0 * typical_bounces(self.settings.max_bounces)),
            _ => 2.5,
        }
    }

    fn pass(&self, count: usize, share: f64, seed: u64) -> impl Pass + '_ {
        Sequence { of: self, count, weight: share / count as f64, seed }
    }
}

/// [`Options::required_shapes`]: light has a derivative only if its path has hit a shape that moves, or whose material is requested.
/// `None` if a light itself, a mask, what a body absorbs or the camera has a derivative.
fn required_shapes(scene: &Scene, layout: &Layout) -> Option<Vec<bool>> {
    let shapes = &scene.description.shapes;
    let asked = |i: usize, input: Input| layout.slots.iter().any(|slot| slot.is_read_by(input, i));
    let profiles = scene.description.delta_lights.iter().filter_map(DeltaLight::profile);
    let maps: Vec<TextureId> =
        scene.description.environment.into_iter().chain(profiles).map(|map| map.texels).collect();
    let elsewhere = |slot: &Slot| match slot {
        Slot::Vertices(_) | Slot::Normals(_) | Slot::Uvs(_) | Slot::Colors(_) => false,
        Slot::Texels(t) => maps.contains(t),
        _ => true,
    };
    if scene.masked || layout.slots.iter().any(elsewhere) {
        return None;
    }
    let of_shape = |(i, shape): (usize, &Shape)| {
        let changes = layout.moves(i as u32) || layout.slots.contains(&Slot::Uvs(i));
        if let MaterialKind::Dielectric { absorption: Some(absorption), .. } = shape.material.kind
            && asked(i, absorption)
        {
            return None; // light within a body is absorbed wherever it comes from and goes to
        }
        match &shape.emission {
            Some(emission) if changes || asked(i, emission.radiance) => None,
            _ => Some(changes || shape.material.inputs().any(|(_, input)| asked(i, *input))),
        }
    };
    shapes.iter().enumerate().map(of_shape).collect()
}

/// How paths sample masks: never rarely in either way if requested slots change opacities.
fn mask_sampling(scene: &Scene, layout: &Layout) -> MaskSampling {
    let opacity = |slot: &Slot| {
        let shapes = scene.description.shapes.iter().enumerate();
        shapes.into_iter().any(|(i, s)| s.material.opacity.is_some_and(|input| slot.is_read_by(input, i)))
    };
    let moves_nothing = |slot: &Slot| matches!(slot, Slot::Texels(_) | Slot::Colors(_) | Slot::LightPower(_));
    if layout.slots.iter().any(opacity) {
        MaskSampling::BothSides
    } else if layout.slots.iter().all(moves_nothing) {
        MaskSampling::Opacity
    } else {
        MaskSampling::PartlyOpaque
    }
}
