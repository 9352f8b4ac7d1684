//! Interior term of light tracing: paths from points, spots and suns by way of mirrors and smooth glass to what the camera sees.
//!
//! Where a path starts on its light's film is fixed to the derivative, and all that follows is attached: directions follow normals and
//! indices, the place x where the path lands moves with them over its surface, and with it the film position u(x). A pixel with the
//! filter h sees Σ h(u) C, whose derivative is Σ (∇h·u̇ C + h Ċ), where C is what the path brings ([`crate::render::caustics`]).

use glam::{Vec2, Vec3};

use crate::grad::estimate::{Draw, Estimate, Pass, Sequence};
use crate::grad::local::{RayAdjoint, VertexAdjoint, d_attenuation, d_eval, d_inputs, d_intersection, d_specular};
use crate::grad::sampling::allocate::{Estimator, typical_bounces};
use crate::grad::sampling::guide::{Guide, GuideKey, GuideTraining};
use crate::grad::sink::Adjoints;
use crate::math::d_normalize;
use crate::render::bsdf::Bsdf;
use crate::render::caustics::{Landing, arriving};
use crate::render::interaction::SurfaceInteraction;
use crate::render::light_film::{LightFilmSample, LightFilms};
use crate::render::sampler::{Sampler, hash};
use crate::render::specular::{Chain, Link, Transport};
use crate::render::{Camera, DeltaLight, Scene, Settings};

/// The estimator of how light moves that lights without area send by specular surfaces.
pub struct Caustics<'a> {
    scene: &'a Scene,
    camera: &'a Camera,
    films: &'a LightFilms,
    max_bounces: u32,
    count: usize,
    /// The guide over the random numbers that choose a place of the films.
    guide: Option<Guide>,
}

/// Most cells of a guide over the films of lights.
pub const MOST_CELLS: usize = 4096;

/// A path from a light to the camera.
struct LightPath<'a> {
    chain: &'a Chain,
    landing: Landing,
    camera: Camera,
    light: u32,
    /// Solid angle or area that the path stands for.
    measure: f32,
    /// What it has of the light's power, and the share of that which arrives where it lands.
    power: Vec3,
    arriving: Vec3,
}

impl<'a> Caustics<'a> {
    /// `None` if the image holds no caustics.
    pub fn new(
        scene: &'a Scene,
        camera: &'a Camera,
        films: Option<&'a LightFilms>,
        settings: &Settings,
    ) -> Option<Caustics<'a>> {
        let films = films.filter(|_| settings.has_caustics())?;
        let count = settings.spp.max(1) as usize * camera.width * camera.height;
        Some(Caustics { scene, camera, films, max_bounces: settings.max_bounces, count, guide: None })
    }

    /// Trains the guide: pilot samples measure where what starts reaches the camera.
    pub fn guided(mut self, training: &GuideTraining) -> Self {
        let size = [training.cells(self.count, MOST_CELLS).max(4), 1];
        self.guide = Some(Guide::new(GuideKey::Caustics, size, training, |mut sampler, at, pilot| {
            self.sample(at, 1.0, &mut sampler, &mut Chain::default(), pilot);
        }));
        self
    }
}

impl LightPath<'_> {
    /// What the path brings to its film position.
    fn value(&self) -> Vec3 {
        self.power * self.arriving * self.landing.response()
    }

    /// Propagates the adjoint of what the path brings, and of the film position to which it does, back to all that moves or changes it.
    fn backward(&self, out: &mut Adjoints, d: Vec3, d_pixel: Vec2) {
        let ray = self.d_landing(out, d, d_pixel);
        let ray = self.d_chain(out, d, ray);
        d_light_ray(out, self.light, ray);
        let d_power = d * self.arriving * self.landing.response() * self.measure;
        let light = &out.scene.description.delta_lights[self.light as usize];
        let dir = self.chain.rays[0].dir;
        let falloff = light.cone().map(|cone| (cone, cone.falloff(dir)));
        let profile = out.scene.profile(light, dir);
        let faded = d_power * falloff.map_or(1.0, |(_, falloff)| falloff.value);
        out.light_power(self.light, faded * profile);
        // What starts in a direction keeps it.
        out.light_profile(self.light, dir, faded * light.power());
        if let Some((cone, falloff)) = falloff {
            let d_falloff = d_power.dot(light.power() * profile);
            let d_axis = d_normalize(cone.axis, falloff.by_axis * d_falloff);
            out.light_cone(self.light, d_axis, falloff.by_angles.map(|d| d * d_falloff));
        }
    }

    /// The part of [`LightPath::backward`] at the surface where the path lands; returns the adjoint of the ray that leads there.
    fn d_landing(&self, out: &mut Adjoints, d: Vec3, d_pixel: Vec2) -> RayAdjoint {
        let (landing, camera) = (&self.landing, &self.camera);
        let si = &landing.si;
        let mut adj = VertexAdjoint::default();
        let mut d_towards = Vec3::ZERO;
        // By what moves the origin of the camera's ray, and its direction.
        let (mut d_origin, mut d_dir) = (Vec3::ZERO, Vec3::ZERO);
        if d != Vec3::ZERO {
            let d_response = d * self.power * self.arriving;
            let d_scattered = d_response * landing.attenuation * landing.pixels_per_area;
            let (d_wo, d_values) = d_eval(si, landing.towards, None, d_scattered / landing.cosine.abs(), &mut adj);
            d_inputs(out, si, &d_values, &mut adj);
            let d_cosine = -d_scattered.dot(landing.scattered) / landing.cosine;
            adj.ng += landing.towards * d_cosine;
            d_towards = d_wo + si.ng * d_cosine;
            let d_pixels = d_response.dot(landing.scattered * landing.attenuation);
            let [d_p, d_n] = camera.d_pixels_per_area(&landing.projected, si.ng, d_pixels, &mut out.camera);
            adj.p += d_p;
            adj.ng += d_n;
            let mut d_distance = 0.0;
            if let Some(body) = landing.body {
                d_distance = d_attenuation(out, si, body, landing.distance, d * self.value());
            }
            let d_wi = std::mem::take(&mut adj.wi);
            let d_camera = if camera.is_central() {
                (d_wi - si.wi * si.wi.dot(d_wi)) / landing.distance
            } else {
                d_dir = -d_wi;
                Vec3::ZERO
            };
            d_origin = d_camera + si.wi * d_distance;
            adj.p -= d_origin;
        }
        camera.d_ray(landing.projected.pixel, d_origin, d_dir, &mut out.camera);
        adj.p += camera.d_project(&landing.projected, d_pixel, &mut out.camera);
        adj.wi = d_towards;
        let Some((end, t)) = &self.chain.end else { return RayAdjoint::default() };
        let inside = self.chain.inside(self.chain.links.len());
        // The surface as the camera sees it, reached by the light's ray.
        let si = SurfaceInteraction { wi: end.wi, ..*si };
        d_way(out, &si, *t, inside.body(), d * self.value(), adj)
    }

    /// The part of [`LightPath::backward`] along the chain; returns the adjoint of the ray that leaves the light.
    fn d_chain(&self, out: &mut Adjoints, d: Vec3, mut ray: RayAdjoint) -> RayAdjoint {
        let (chain, scene) = (self.chain, out.scene);
        let all = d * self.value();
        // The adjoint of what is carried behind each link, and what is carried to the one before.
        let way = chain.end.as_ref().map_or(0.0, |(_, t)| *t);
        let left = scene.attenuated(chain.inside(chain.links.len()), way);
        let mut after = d * self.power * self.landing.response() * left;
        for (k, link) in chain.links.iter().enumerate().rev() {
            let before = k.checked_sub(1).map_or(Vec3::ONE, |k| chain.links[k].weight);
            let left = scene.attenuated(chain.inside(k), link.t);
            let mut adj = VertexAdjoint { p: ray.origin, ..VertexAdjoint::default() };
            let d_values = d_link(link, after * before * left, ray.dir, &mut adj);
            d_inputs(out, &link.si, &d_values, &mut adj);
            ray = d_way(out, &link.si, link.t, chain.inside(k).body(), all, adj);
            after *= link.factor * left;
        }
        ray
    }
}

/// Adjoint of a link's factor on power, and of its direction. Adds to the adjoint of the vertex, and returns those of the material's inputs.
fn d_link(link: &Link, d_factor: Vec3, d_dir: Vec3, adj: &mut VertexAdjoint) -> [Vec3; crate::render::MAX_INPUTS] {
    let Bsdf::Dielectric(dielectric) = link.si.bsdf else {
        return d_specular(&link.si, link.lobe, d_factor / link.probability, d_dir, adj);
    };
    // The factor on power is that on radiance times η².
    let outside = link.si.flip > 0.0;
    let eta = if link.lobe.transmits() { dielectric.eta(outside) } else { 1.0 };
    let mut d_values = d_specular(&link.si, link.lobe, d_factor * (eta * eta / link.probability), d_dir, adj);
    if link.lobe.transmits() {
        d_values[0].x += dielectric.d_eta(outside, 2.0 * d_factor.dot(link.factor) / eta);
    }
    d_values
}

/// Adjoint of a vertex that light reaches on a way of length `t`, perhaps within a body that absorbs it, given that of the logarithm of what
/// is left there. Returns the adjoint of the ray.
fn d_way(
    out: &mut Adjoints,
    si: &SurfaceInteraction,
    t: f32,
    body: Option<u32>,
    d_log: Vec3,
    mut adj: VertexAdjoint,
) -> RayAdjoint {
    let d_t = body.map_or(0.0, |body| d_attenuation(out, si, body, t, d_log));
    adj.p -= si.wi * d_t;
    let mut ray = d_intersection(out, si, t, adj);
    ray.origin += si.wi * d_t;
    ray
}

/// Passes the adjoint of a ray that leaves a light on to the light: that of a point light keeps its direction, that of a sun its origin.
pub fn d_light_ray(out: &mut Adjoints, light: u32, ray: RayAdjoint) {
    let d = match out.scene.description.delta_lights[light as usize] {
        DeltaLight::Directional { direction, .. } => d_normalize(direction, ray.dir),
        DeltaLight::Point { .. } | DeltaLight::Spot { .. } | DeltaLight::Goniometric { .. } => ray.origin,
    };
    out.light_placement(light, d);
}

impl Caustics<'_> {
    /// Draws one sample; `at` chooses where it starts.
    fn sample(&self, at: [f64; 2], weight: f64, sampler: &mut Sampler, chain: &mut Chain, out: &mut dyn Estimate) {
        /// Neither reflection nor refraction is rarer: derivatives grow where the share of one goes to zero.
        const LEAST: f32 = 0.1;
        let start: LightFilmSample = self.films.place(at);
        let pixel = start.corner + start.within;
        let camera = self.camera.sample_lens(sampler);
        let most = self.max_bounces as usize - 1;
        chain.follow(self.scene, self.films.ray(start.film, pixel), most, Transport::Power, |_, si| {
            si.choose_delta_lobe(sampler.next_1d(), LEAST)
        });
        let Some(landing) = Landing::of(self.scene, &camera, chain) else { return };
        let place = landing.projected.pixel;
        let footprint = camera.footprint(place);
        let weights = footprint.pixels();
        let slopes = weights.iter().map(|(pixel, _)| (*pixel, camera.slope(*pixel, place)));
        let (along_x, along_y): (Vec<_>, Vec<_>) = slopes.map(|(p, slope)| ((p, slope.x), (p, slope.y))).unzip();
        if [weights, &along_x, &along_y].into_iter().all(|pixels| out.skips(pixels)) || landing.is_hidden(self.scene) {
            return;
        }
        let share = (start.weight * weight) as f32;
        let path = LightPath {
            arriving: arriving(self.scene, chain),
            power: self.films.power(self.scene, start.film, pixel) * share,
            measure: self.films.measure(start.film, pixel) * share,
            light: self.films.of(start.film).0,
            chain,
            landing,
            camera,
        };
        let value = path.value();
        if !value.is_finite() {
            return;
        }
        out.pixels(weights, &mut |d, out| path.backward(out, d, Vec2::ZERO));
        out.pixels(&along_x, &mut |d, out| path.backward(out, Vec3::ZERO, Vec2::X * d.dot(value)));
        out.pixels(&along_y, &mut |d, out| path.backward(out, Vec3::ZERO, Vec2::Y * d.dot(value)));
    }
}

impl Draw for Caustics<'_> {
    type Scratch = Chain;

    fn draw(&self, first: f64, mut sampler: Sampler, weight: f64, chain: &mut Chain, out: &mut dyn Estimate) {
        let at = [first, f64::from(sampler.next_1d())];
        let (at, density) = self.guide.as_ref().map_or((at, 1.0), |guide| guide.warp(at));
        self.sample(at, weight / density, &mut sampler, chain, out);
    }
}

impl Estimator for Caustics<'_> {
    fn count(&self) -> usize {
        self.count
    }

    fn cost(&self) -> f64 {
        4.0 + 2.0 * typical_bounces(self.max_bounces)
    }

    fn pass(&self, count: usize, share: f64, seed: u64) -> impl Pass + '_ {
        Sequence { of: self, count, weight: share / count as f64, seed: hash(seed, 0x0063_6175_7374_6963) }
    }
}
