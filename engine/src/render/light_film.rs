//! The films of lights without area: where light starts that meets a mirror or smooth glass first.
//!
//! A camera at a point light sees what the light shines on; along the direction of a sun, an orthographic one does. A light's film is that
//! of such a camera (of six, where specular surfaces are all around the light), and its samples are points of those pixels of the film
//! that specular surfaces may cover. They are fixed to the derivative: the rays of a point light keep their directions as it moves, and
//! those of a sun keep where they come from as it turns.

use glam::{USizeVec2, Vec2, Vec3};

use super::accel::Ray;
use super::film::hilbert_curve;
use super::light::table::defensive;
use super::pixel_filter::PixelFilter;
use super::sampler::Discrete;
use super::scene::{Camera, DeltaLight, Projection};
use super::world::Scene;
use crate::math::{Frame, luminance};
use crate::ranks;
use crate::stop::paced;

/// Pixels of a film along each axis; of each of six films half as many.
const SIZE: usize = 128;
/// Films are at most this wide: tangent of half the angle.
const WIDEST: f32 = 1.5;

/// The films of all lights without area.
#[derive(Clone)]
pub struct LightFilms {
    films: Vec<Film>,
    /// The pixels that specular surfaces may cover, with their films.
    pixels: Vec<(u32, u32)>,
    density: Discrete,
}

/// What a light shines on, or a part of it.
#[derive(Clone)]
struct Film {
    light: u32,
    camera: Camera,
    /// Whether specular surfaces may cover each pixel.
    covered: Vec<bool>,
}

/// A point of a light's film.
#[derive(Clone, Copy, Debug)]
pub struct LightFilmSample {
    pub film: u32,
    /// The pixel's corner, and the point in it, from (0, 0) to (1, 1).
    pub corner: Vec2,
    pub within: Vec2,
    /// 1 / density in pixels.
    pub weight: f64,
}

impl LightFilms {
    /// `None` if there is no such light, or nothing specular for it to shine on.
    pub fn new(scene: &Scene) -> Option<LightFilms> {
        let specular: Vec<[Vec3; 3]> = paced(0..scene.prims.len(), 1)
            .filter(|&prim| {
                let shape = scene.prims[prim].shape as usize;
                scene.description.shapes[shape].material.kind.is_delta()
            })
            .map(|prim| scene.corners(prim as u32))
            .collect();
        if specular.is_empty() {
            return None;
        }
        let mut films = LightFilms { films: Vec::new(), pixels: Vec::new(), density: Discrete::default() };
        let mut weights = Vec::new();
        let lights = &scene.description.delta_lights;
        // A light that is dark now still has a derivative in its power.
        let powers = defensive(&lights.iter().map(|l| f64::from(luminance(l.power().abs()))).collect::<Vec<_>>());
        for (light, (source, power)) in lights.iter().zip(powers).enumerate() {
            for camera in cameras(scene, source, &specular) {
                let covered = covered(&camera, &specular);
                let film = Film { light: light as u32, camera, covered };
                // In the order of a curve, along which samples of neighbouring pixels follow one another.
                let size = film.camera.width;
                hilbert_curve([size; 2], [0..size, 0..size], |x, y, _| {
                    let pixel = y * size + x;
                    if film.covered[pixel] {
                        films.pixels.push((films.films.len() as u32, pixel as u32));
                        weights.push(power * f64::from(film.measure(film.corner(pixel as u32) + 0.5)));
                    }
                });
                films.films.push(film);
            }
        }
        films.density = Discrete::new(weights);
        (!films.density.is_empty()).then_some(films)
    }

    /// The same films with more samples where these are worth more: `brings` tells by how much what starts there brightens the image, from
    /// a number of pilots. Some go everywhere.
    pub(super) fn guided(&self, pilots: usize, brings: impl Fn(&LightFilmSample, u64) -> f32 + Sync) -> LightFilms {
        /// Pilots in each part of the films, and most parts.
        const PILOTS: usize = 4;
        const MOST: usize = 4096;
        const DEFENSIVE: f64 = 0.25;
        let parts = (pilots / PILOTS).min(MOST).min(self.pixels.len());
        if parts < 2 {
            return self.clone();
        }
        let found = ranks::map(parts, &|part| {
            let squares = (0..PILOTS).map(|i| {
                let number = (part * PILOTS + i) as u64;
                let along = (part as f64 + (i as f64 + 0.5) / PILOTS as f64) / parts as f64;
                let start = self.place([along, (number as f64 * 0.618_033_988_749).fract()]);
                f64::from(brings(&start, number)).powi(2)
            });
            (squares.sum::<f64>() / PILOTS as f64).sqrt()
        });
        // A part is averaged with its neighbours: its own pilots may have missed what is rare.
        let near = |part: usize| {
            let near = &found[part.saturating_sub(1)..(part + 2).min(parts)];
            near.iter().sum::<f64>() / near.len() as f64
        };
        let mean = (0..parts).map(near).sum::<f64>() / parts as f64;
        if !(mean > 0.0 && mean.is_finite()) {
            return self.clone();
        }
        let mut before = 0.0;
        let weights: Vec<f64> = (0..self.pixels.len())
            .map(|i| {
                let probability = self.density.pmf(i);
                let part = ((before + 0.5 * probability) * parts as f64) as usize;
                before += probability;
                probability * ((1.0 - DEFENSIVE) * near(part.min(parts - 1)) / mean + DEFENSIVE)
            })
            .collect();
        LightFilms { density: Discrete::new(weights), ..self.clone() }
    }

    /// The sample for a point of the unit square.
    pub fn place(&self, u: [f64; 2]) -> LightFilmSample {
        const ALMOST_ONE: f32 = 0.999_999;
        let (i, probability, rest) = self.density.sample(u[0]);
        let (film, pixel) = self.pixels[i];
        let within = Vec2::new(rest as f32, u[1] as f32).min(Vec2::splat(ALMOST_ONE));
        LightFilmSample { film, corner: self.films[film as usize].corner(pixel), within, weight: 1.0 / probability }
    }

    /// Number of films.
    pub fn count(&self) -> u32 {
        self.films.len() as u32
    }

    /// The index of a film's light, and the camera whose film it is.
    pub fn of(&self, film: u32) -> (u32, &Camera) {
        let film = &self.films[film as usize];
        (film.light, &film.camera)
    }

    /// The ray that leaves the light through a point of a film.
    pub fn ray(&self, film: u32, pixel: Vec2) -> Ray {
        self.films[film as usize].camera.ray(pixel)
    }

    /// Whether specular surfaces may cover a pixel at which a film shows a box between two corners.
    pub fn may_cover(&self, film: u32, [low, high]: [Vec2; 2]) -> bool {
        let film = &self.films[film as usize];
        let size = film.camera.width;
        let [first, last] = pixels([low, high], size);
        (first.y..last.y).any(|y| film.covered[y * size..][first.x.min(last.x)..last.x].contains(&true))
    }

    /// The light's power per pixel of its film: intensity times falloff or profile and solid angle, or irradiance times area.
    pub fn power(&self, scene: &Scene, film: u32, pixel: Vec2) -> Vec3 {
        let film = &self.films[film as usize];
        let light = &scene.description.delta_lights[film.light as usize];
        let dir = film.camera.ray(pixel).dir;
        let falloff = light.cone().map_or(1.0, |cone| cone.falloff(dir).value);
        light.power() * scene.profile(light, dir) * (falloff * film.measure(pixel))
    }

    /// Solid angle or area per pixel.
    pub fn measure(&self, film: u32, pixel: Vec2) -> f32 {
        self.films[film as usize].measure(pixel)
    }
}

/// The cameras that see all of these triangles from a light.
fn cameras(scene: &Scene, light: &DeltaLight, specular: &[[Vec3; 3]]) -> Vec<Camera> {
    let points = || specular.iter().flatten();
    let (low, high) = points().fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(low, high), p| (low.min(*p), high.max(*p)));
    let middle = 0.5 * (low + high);
    let radius = 1.001 * points().map(|p| p.distance(middle)).fold(0.0, f32::max);
    let camera = |projection: Projection, origin: Vec3, forward: Vec3, scale: f32, size: usize| {
        let frame = Frame::from_normal(forward);
        let (right, up) = (frame.to_world(Vec3::X), frame.to_world(Vec3::Y));
        let pinhole = Camera::look_at(Vec3::ZERO, Vec3::Z, Vec3::Y, 1.0, [size; 2]);
        Camera {
            projection,
            origin,
            frame: [right, up, forward],
            scale: [scale; 2],
            filter: PixelFilter::Box,
            ..pinhole
        }
    };
    if let DeltaLight::Directional { direction, .. } = light {
        // Rays start before all that may be in their way.
        let dir = direction.normalize();
        let corners = (0..scene.prims.len()).flat_map(|prim| scene.corners(prim as u32));
        let first = corners.map(|p| (p - middle).dot(dir)).fold(0.0, f32::min);
        let origin = middle + dir * (1.01 * first - 0.01 * scene.radius);
        return vec![camera(Projection::Orthographic, origin, dir, radius, SIZE)];
    }
    let origin = light.placement();
    let (forward, distance) = ((middle - origin).normalize_or(Vec3::Z), middle.distance(origin));
    let tangent = radius / (distance * distance - radius * radius).max(0.0).sqrt();
    if tangent < WIDEST {
        return vec![camera(Projection::Perspective, origin, forward, tangent, SIZE)];
    }
    let sides = Vec3::AXES.into_iter().flat_map(|axis| [axis, -axis]);
    sides.map(|side| camera(Projection::Perspective, origin, side, 1.0, SIZE / 2)).collect()
}

impl Film {
    fn corner(&self, pixel: u32) -> Vec2 {
        let width = self.camera.width as u32;
        Vec2::new((pixel % width) as f32, (pixel / width) as f32)
    }

    /// Solid angle or area per pixel.
    fn measure(&self, pixel: Vec2) -> f32 {
        let camera = &self.camera;
        let film = camera.film(pixel);
        let (x, y) = (film.x * camera.scale[0], film.y * camera.scale[1]);
        let area = 4.0 * camera.scale[0] * camera.scale[1] / (camera.width * camera.height) as f32;
        match camera.projection {
            Projection::Orthographic => area,
            _ => area / (1.0 + x * x + y * y).powf(1.5),
        }
    }
}

/// Which pixels of a film these triangles may cover: those of boxes around them.
fn covered(camera: &Camera, specular: &[[Vec3; 3]]) -> Vec<bool> {
    let size = camera.width;
    let mut covered = vec![false; size * size];
    for corners in paced(specular, 64) {
        let [mut low, mut high] = [Vec2::INFINITY, Vec2::NEG_INFINITY];
        let mut behind = 0;
        for p in corners {
            match camera.project(*p) {
                Some(projected) => (low, high) = (low.min(projected.pixel), high.max(projected.pixel)),
                None => behind += 1,
            }
        }
        if behind == 3 {
            continue;
        }
        // What is partly behind a film is seen by all of it, as far as this knows.
        if behind > 0 {
            (low, high) = (Vec2::ZERO, Vec2::splat(size as f32));
        }
        let [first, last] = pixels([low, high], size);
        for y in first.y..last.y {
            covered[y * size..][first.x.min(last.x)..last.x].fill(true);
        }
    }
    covered
}

/// The pixels of a square film that a box meets, from the first to before the last: a little wider than what rounding may do to its borders.
fn pixels([low, high]: [Vec2; 2], size: usize) -> [USizeVec2; 2] {
    let last = (high + 0.01).ceil().clamp(Vec2::ZERO, Vec2::splat(size as f32));
    [(low - 0.01).floor().max(Vec2::ZERO).as_usizevec2(), last.as_usizevec2()]
}

#[cfg(test)]
mod tests {
    use std::f32::consts::PI;

    use super::*;
    use crate::math::Pcg32;
    use crate::mesh::shapes::sphere;
    use crate::render::material::{Input, MaterialKind};
    use crate::render::scene::{Cone, SceneDescription, Shape};
    use crate::render::texture::Texture;

    fn films(lights: Vec<DeltaLight>, at: Vec3) -> (Scene, LightFilms) {
        let mut mesh = sphere(1.0, 24).unwrap();
        mesh.vertices.iter_mut().for_each(|v| *v += at);
        let material = MaterialKind::Mirror { reflectance: Input::Texture(0) }.into();
        let scene = Scene::new(SceneDescription {
            shapes: vec![Shape { mesh, material, emission: None }],
            textures: vec![Texture::constant(Vec3::ONE)],
            delta_lights: lights,
            ..Default::default()
        });
        let scene = scene.unwrap();
        let films = LightFilms::new(&scene).unwrap();
        (scene, films)
    }

    /// What all samples carry whose rays meet the ball is the power that the lights send to it, from afar, from nearby and from within.
    #[test]
    fn films_carry_all_that_meets_a_specular_surface() {
        let white = Vec3::ONE;
        let point = |position: Vec3| DeltaLight::Point { position, intensity: white };
        let wide = Cone { axis: -Vec3::Z, beam: 1.5, cutoff: 3.0 };
        let shares = |distance: f32| 2.0 * PI * (1.0 - (1.0 - 1.0 / (distance * distance)).sqrt());
        let cases: [(DeltaLight, f32); 5] = [
            (point(Vec3::new(0.0, 0.0, 4.0)), shares(4.0)),
            (point(Vec3::new(0.0, 0.0, 1.1)), shares(1.1)),
            (point(Vec3::new(0.2, 0.0, 0.1)), 4.0 * PI),
            (DeltaLight::Directional { direction: Vec3::new(1.0, -3.0, 0.5), irradiance: white }, PI),
            (
                DeltaLight::Spot { position: Vec3::new(0.0, 0.0, 4.0), intensity: white, cone: wide, profile: None },
                shares(4.0),
            ),
        ];
        for at in [Vec3::ZERO, Vec3::new(30.0, -7.0, 3.0)] {
            for (light, expected) in &cases {
                let moved = light.lerp(&moved(light, at), 1.0);
                let (scene, films) = films(vec![moved], at);
                let mut rng = Pcg32::new(3);
                let (mut sum, count) = (0.0, 200_000);
                for i in 0..count {
                    let u = [(f64::from(i) + 0.5) / f64::from(count), f64::from(rng.next_f32())];
                    let sample = films.place(u);
                    let pixel = sample.corner + sample.within;
                    if scene.accel.closest(&films.ray(sample.film, pixel), &[]).is_some() {
                        sum += films.power(&scene, sample.film, pixel).x * (sample.weight / f64::from(count)) as f32;
                    }
                }
                // A ball of flat triangles is a little smaller than a round one.
                assert!((sum - expected).abs() < 0.012 * expected, "{light:?} at {at}: {sum} of {expected}");
            }
        }
    }

    fn moved(light: &DeltaLight, by: Vec3) -> DeltaLight {
        match light.clone() {
            DeltaLight::Point { position, intensity } => DeltaLight::Point { position: position + by, intensity },
            DeltaLight::Spot { position, intensity, cone, profile } => {
                DeltaLight::Spot { position: position + by, intensity, cone, profile }
            }
            directional => directional,
        }
    }

    #[test]
    fn there_are_none_without_a_light_or_without_a_mirror() {
        let (scene, _) = films(vec![DeltaLight::Point { position: Vec3::Z * 3.0, intensity: Vec3::ONE }], Vec3::ZERO);
        let mut description = scene.description.clone();
        description.shapes[0].material = MaterialKind::Black.into();
        assert!(LightFilms::new(&Scene::new(description).unwrap()).is_none());
        let mut description = scene.description.clone();
        description.shapes[0].material = MaterialKind::Mirror { reflectance: Input::Texture(0) }.into();
        description.delta_lights.clear();
        assert!(LightFilms::new(&Scene::new(description).unwrap()).is_none());
    }
}
