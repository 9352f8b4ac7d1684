//! Light tracing: what points, spots and suns send by way of mirrors and smooth glass to the surfaces that the camera sees.
//!
//! A path starts at a point of a light's film (`render::light_film`) with the light's power per pixel of that film, follows a chain of specular
//! surfaces (`render::specular`) to the first one that scatters, and is connected from there to the camera. What a surface with the BSDF f
//! (cosine of the incident light included) sends to the camera of a power Φ that arrives under the cosine c is f/c Φ per area and steradian,
//! and a pixel sees it as h(u) P f/c Φ: with the pixel's filter h at the film position u, and P pixels of film per area (Veach 1997, §4.5 and §10.3).
//! No path from the camera finds this light, as no ray meets a light without area.

use std::ops::Range;
use std::sync::atomic::{AtomicBool, Ordering};

use glam::{DVec3, Vec2, Vec3};

use super::accel::{PrimId, Ray};
use super::film::{Method, Settings};
use super::interaction::SurfaceInteraction;
use super::light_film::{LightFilmSample, LightFilms};
use super::pixel_filter::PixelFilter;
use super::sampler::{Sampler, Sequence, hash, progress};
use super::scene::Camera;
use super::sensor::Projected;
use super::specular::{Chain, Transport};
use super::validate::SceneError;
use super::world::Scene;
use crate::image::Image;
use crate::math::luminance;
use crate::ranks::{self, Packed};
use crate::work;

/// Where a chain from a light ends on a surface that scatters light to the camera.
pub struct Landing {
    /// The surface as the camera sees it.
    pub si: SurfaceInteraction,
    pub(crate) projected: Projected,
    /// Unit direction to where the light comes from, and its cosine with the geometric normal.
    pub towards: Vec3,
    pub(crate) cosine: f32,
    /// The distance to the camera.
    pub distance: f32,
    /// f / c.
    pub scattered: Vec3,
    /// Pixels of film per area.
    pub pixels_per_area: f32,
    /// The body between surface and camera, and what it does not absorb on that way.
    pub body: Option<u32>,
    pub(crate) attenuation: Vec3,
}

impl Landing {
    /// Where a chain ends, if that is a surface that scatters and that the camera would see if nothing was in between.
    pub fn of(scene: &Scene, camera: &Camera, chain: &Chain) -> Option<Landing> {
        let (end, _) = chain.end.as_ref().filter(|(end, _)| !end.bsdf.is_delta())?;
        if chain.links.is_empty() {
            return None; // a path from the camera finds it
        }
        let projected = camera.project(end.p).filter(|projected| camera.on_film(projected.pixel))?;
        let (back, distance) = camera.direction_from(end.p);
        if distance <= 0.0 {
            return None;
        }
        let si = scene.interaction(end.prim, end.b, back);
        let towards = end.wi;
        let cosine = si.ng.dot(towards);
        let scattered = si.eval(towards) / cosine.abs();
        if !scattered.is_finite() || scattered == Vec3::ZERO && si.bsdf.is_black() {
            return None;
        }
        let (mut body, mut attenuation) = (None, Vec3::ONE);
        if scene.absorbs() {
            let inside = scene.around(si.p + back * distance);
            (body, attenuation) = (inside.body(), scene.attenuated(&inside, distance));
        }
        Some(Landing {
            si,
            projected,
            towards,
            cosine,
            distance,
            scattered,
            pixels_per_area: camera.pixels_per_area(&projected, si.ng),
            body,
            attenuation,
        })
    }

    /// The ray from the camera to the surface, ending just before it.
    pub fn view(&self) -> Ray {
        let origin = self.si.p + self.si.wi * self.distance;
        Ray { t_min: 0.0, t_max: self.distance * (1.0 - 4e-6), ..Ray::new(origin, -self.si.wi) }
    }

    /// What hides the surface from the camera first.
    pub fn hidden_by(&self, scene: &Scene) -> Option<PrimId> {
        scene.accel.closest(&self.view(), &[self.si.prim]).map(|hit| hit.prim)
    }

    pub(crate) fn is_hidden(&self, scene: &Scene) -> bool {
        scene.accel.occluded(&self.view(), &[self.si.prim])
    }

    /// Radiance times pixels per area, for each unit of power that arrives.
    pub fn response(&self) -> Vec3 {
        self.scattered * self.attenuation * self.pixels_per_area
    }
}

/// The share of a chain's power that arrives at its end.
pub fn arriving(scene: &Scene, chain: &Chain) -> Vec3 {
    let way = chain.end.as_ref().map_or(0.0, |(_, t)| *t);
    chain.weight() * scene.attenuated(chain.inside(chain.links.len()), way)
}

/// An error for scenes and cameras whose caustics cannot be rendered.
pub fn validate_caustics(scene: &Scene, camera: &Camera, settings: &Settings) -> Result<(), SceneError> {
    if !settings.has_caustics() {
        return Ok(());
    }
    let fail = |what: &str| Err(SceneError::Camera { what: what.into() });
    if camera.filter == PixelFilter::Box {
        return fail(
            "light tracing wants a continuous pixel filter, as what it draws moves over the pixels: `filter: \"tent\"`, \"gaussian\" or \"mitchell\"",
        );
    }
    if !camera.distortion.is_none() {
        return fail("light tracing knows no cameras with a lens distortion");
    }
    if scene.masked {
        return fail("light tracing knows no masks (`opacity`), and the scene has some");
    }
    Ok(())
}

/// Contributions to pixels.
#[derive(Default)]
struct Splats {
    pixels: Vec<u32>,
    values: Vec<Vec3>,
}

impl Packed for Splats {
    fn pack(&self, to: &mut Vec<u8>) {
        self.pixels.pack(to);
        self.values.pack(to);
    }

    fn unpack(from: &mut &[u8]) -> Option<Splats> {
        Some(Splats { pixels: Vec::unpack(from)?, values: Vec::unpack(from)? })
    }
}

/// Adds the light of paths from the lights to an image, times `weight`: as many as the image has samples.
pub(super) fn add_caustics(
    scene: &Scene,
    camera: &Camera,
    settings: &Settings,
    weight: f32,
    stop: &AtomicBool,
    image: &mut Image,
) {
    /// Paths that are traced one after the other, and how many times that are kept at a time.
    const CHUNK: usize = 4096;
    const ROUND: usize = 32;
    if !settings.has_caustics() {
        return;
    }
    let Some(films) = LightFilms::new(scene) else { return };
    let count = settings.spp.max(1) as usize * camera.width * camera.height;
    let seed = hash(settings.seed, 0x0063_6175_7374_6963);
    let tracer = Tracer { scene, camera, films, count, most: settings.max_bounces as usize - 1, seed };
    let tracer = Tracer { films: tracer.guided(), ..tracer };
    let mut sums = vec![DVec3::ZERO; camera.width * camera.height];
    let chunks = count.div_ceil(CHUNK);
    let _work = work::begin("light paths", chunks as u64);
    for first in (0..chunks).step_by(ROUND) {
        let part = |part: usize| {
            let start = (first + part) * CHUNK;
            let mut splats = Splats::default();
            if !stop.load(Ordering::Relaxed) {
                tracer.trace(start..(start + CHUNK).min(count), &mut splats);
            }
            work::step(1);
            splats
        };
        for Splats { pixels, values } in ranks::map(ROUND.min(chunks - first), &part) {
            for (pixel, value) in pixels.into_iter().zip(values) {
                sums[pixel as usize] += value.as_dvec3();
            }
        }
    }
    let share = f64::from(weight) / count as f64;
    for (pixel, sum) in image.data.chunks_exact_mut(3).zip(sums) {
        for (pixel, x) in pixel.iter_mut().zip((sum * share).to_array()) {
            *pixel += x as f32;
        }
    }
}

/// What each light without area sends by way of mirrors and smooth glass and [`Method::Path`] has left out of an image, over the light in
/// that image: from some thirty thousand paths, for a warning. Zeros where light tracing cannot render it, whatever the filter. What moves is
/// taken at its opening keyframe.
pub fn left_out(scene: &Scene, camera: &Camera, settings: &Settings, image: &Image) -> Vec<f32> {
    const PATHS: usize = 1 << 15;
    let mut shares = vec![0.0; scene.description.delta_lights.len()];
    let traced = Settings { method: Method::Light, ..*settings };
    let continuous = Camera { filter: PixelFilter::Tent, ..*camera };
    if settings.has_caustics() || !traced.has_caustics() || validate_caustics(scene, &continuous, &traced).is_err() {
        return shares;
    }
    let scene = &scene.seen_by(camera);
    let Some(films) = LightFilms::new(scene) else { return shares };
    let seed = hash(settings.seed, 0x6c65_6674_6f75_7400);
    let most = settings.max_bounces as usize - 1;
    let tracer = Tracer { scene, camera, films, count: PATHS, most, seed };
    let mut chain = Chain::default();
    let light: f32 = image.data.chunks_exact(3).map(|pixel| luminance(Vec3::from_slice(pixel))).sum();
    for i in 0..PATHS {
        let mut sampler = Sampler::new(hash(seed, i as u64), 0);
        let along = (i as f64 + 0.5) / PATHS as f64;
        let start = tracer.films.place([along, f64::from(sampler.next_1d())]);
        if let Some((value, _)) = tracer.path(&start, &mut sampler, &mut chain) {
            let (source, _) = tracer.films.of(start.film);
            shares[source as usize] += luminance(value) / (PATHS as f32 * light);
        }
    }
    shares
}

struct Tracer<'a> {
    scene: &'a Scene,
    camera: &'a Camera,
    films: LightFilms,
    count: usize,
    /// Most specular surfaces of a path.
    most: usize,
    seed: u64,
}

impl Tracer<'_> {
    /// Films with more samples where paths start that reach the image. The pilots have random numbers of their own, so that nothing is biased.
    fn guided(&self) -> LightFilms {
        const SHARE: usize = 8;
        let seed = hash(self.seed, 0x0070_696c_6f74);
        self.films.guided(self.count / SHARE, |start, number| {
            let mut sampler = Sampler::new(hash(seed, number), 0);
            let found = self.path(start, &mut sampler, &mut Chain::default());
            found.map_or(0.0, |(value, _)| luminance(value.abs()))
        })
    }

    /// The path from a point of a film: what it brings to which place of the camera's film.
    fn path(&self, start: &LightFilmSample, sampler: &mut Sampler, chain: &mut Chain) -> Option<(Vec3, Vec2)> {
        let pixel = start.corner + start.within;
        let camera = self.camera.sample_lens(sampler);
        chain.follow(self.scene, self.films.ray(start.film, pixel), self.most, Transport::Power, |_, si| {
            si.choose_delta_lobe(sampler.next_1d(), 0.0)
        });
        let landing = Landing::of(self.scene, &camera, chain)?;
        let arriving = self.films.power(self.scene, start.film, pixel) * arriving(self.scene, chain);
        let value = arriving * landing.response() * start.weight as f32;
        let counts = value != Vec3::ZERO && value.is_finite() && !landing.is_hidden(self.scene);
        counts.then_some((value, landing.projected.pixel))
    }

    fn trace(&self, paths: Range<usize>, splats: &mut Splats) {
        let mut sequence = Sequence::new(self.seed, paths.start as u64);
        let mut chain = Chain::default();
        for i in paths {
            if !sequence.has(i as u64) {
                sequence = Sequence::new(self.seed, i as u64);
            }
            let mut sampler = sequence.sampler(i as u64);
            let along = progress(self.seed, i, self.count);
            let start = self.films.place([along, f64::from(sampler.next_1d())]);
            let Some((value, place)) = self.path(&start, &mut sampler, &mut chain) else { continue };
            for (pixel, weight) in self.camera.footprint(place).pixels() {
                splats.pixels.push(*pixel);
                splats.values.push(value * *weight);
            }
        }
    }
}
