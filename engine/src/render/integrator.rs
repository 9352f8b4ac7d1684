//! The path tracer: next-event estimation and BSDF sampling, combined with the balance heuristic.
//!
//! The steps of a path are implemented once ([`Paths`]), for single paths and for many side by side, for rendering and for derivatives. A
//! [`Recorder`] receives each vertex and each light connection with the numbers that were used, so that the derivative code uses exactly
//! the same transport.

mod bounce;
mod lanes;
mod paths;

use std::array;

use glam::Vec3;

use super::accel::{PrimId, Ray};
use super::bodies::Inside;
use super::bsdf::Lobe;
use super::interaction::SurfaceInteraction;
use super::light::LightSample;
use super::mask::{MaskCrossing, MaskSampling, MaskWeight};
use super::sampler::Sampler;
use super::world::Scene;

pub use self::paths::Paths;

/// Paths are never longer than this, whatever `max_bounces` says.
pub const MAX_DEPTH: u32 = 64;

/// Where a path starts.
pub enum Start<'a> {
    Ray(Ray, &'a [PrimId]),
    Surface(SurfaceInteraction),
    /// A surface point right [beside](crate::render::edges::Edge::beside) an edge, with the primitives that rays from there cannot hit.
    /// Its rays begin nearer than others, because a face that rises at the edge may stand between the point and a light at a very small
    /// distance.
    BesideEdge(SurfaceInteraction, &'a [PrimId]),
}

/// Options of a path. The first two concern its first segment.
#[derive(Clone, Copy, Debug)]
pub struct Options<'a> {
    pub max_bounces: u32,
    /// Include the emission of the first surface.
    pub first_emission: bool,
    /// Include the environment if the first ray leaves the scene.
    pub first_environment: bool,
    /// Continue paths with a throughput of zero: a black albedo has derivatives too.
    pub keep_black: bool,
    /// Choose one part of the BSDF, by its value, for each continuation, where the parts are differentiated with different
    /// parametrisations. Neither of the directions of a smooth interface is rare then.
    pub split_lobes: bool,
    /// Sample the lights at each vertex. Without this, only the vertices of the path are used.
    pub next_event: bool,
    /// How masks are passed.
    pub mask_sampling: MaskSampling,
    /// The fraction of scattered directions that lead to a point chosen by area on all surfaces, where the path can continue after that.
    /// Segments that hit a surface at a grazing angle are rare among BSDF samples, but not among these.
    pub area_sampling_fraction: f32,
    /// By shape: whether it is required. Light contributes only to paths that have hit a required shape, and lights are not sampled
    /// before; `None` requires nothing.
    pub required_shapes: Option<&'a [bool]>,
    /// Primitives that rays from the first vertex skip.
    pub first_skip: &'a [PrimId],
    /// The bodies that the path starts in, where it starts on a surface of one; `None` finds those around its start.
    pub inside: Option<Inside>,
}

impl<'a> Options<'a> {
    pub fn new(max_bounces: u32) -> Options<'a> {
        Options {
            max_bounces: max_bounces.min(MAX_DEPTH),
            first_emission: true,
            first_environment: true,
            keep_black: false,
            split_lobes: false,
            next_event: true,
            mask_sampling: MaskSampling::Opacity,
            area_sampling_fraction: 0.0,
            required_shapes: None,
            first_skip: &[],
            inside: None,
        }
    }

    fn is_required(&self, shape: u32) -> bool {
        self.required_shapes.is_none_or(|required| required[shape as usize])
    }
}

/// Light found by next-event estimation at a vertex.
#[derive(Clone, Copy, Debug)]
pub struct Connection {
    pub light: LightSample,
    /// Direction and distance to the light, geometry factor as in [`Arrival`](crate::render::light::Arrival).
    pub dir: Vec3,
    pub distance: f32,
    pub geometry: f32,
    /// MIS weight over density: the contribution is f·cos · power · geometry · weight · transmittance · attenuation.
    pub weight: f32,
    /// Transmittance of the masks on the way.
    pub transmittance: f32,
    /// What the body on the way does not absorb, and the body's shape.
    pub attenuation: Vec3,
    pub body: Option<u32>,
    /// f·cos of the vertex towards the light.
    pub f: Vec3,
}

/// The sampled continuation of a vertex.
#[derive(Clone, Copy, Debug)]
pub struct Continuation {
    pub dir: Vec3,
    /// 1 / (solid-angle density · survival probability); for a delta lobe, with the probability of the lobe as density.
    pub inv_pdf: f32,
    /// f·cos (of the chosen part), or a delta lobe's factor on radiance.
    pub f: Vec3,
    pub lobe: Lobe,
    /// The chosen part is a narrow lobe, whose direction is attached to the surface.
    pub attached: bool,
    /// Distance travelled, infinite if nothing was hit.
    pub t: f32,
    /// Weight of the masks on the way.
    pub through: MaskWeight,
    /// What the body on the way does not absorb.
    pub attenuation: Vec3,
    /// MIS weight of emission found at the end of this segment.
    pub emission_weight: f32,
    /// If the segment ends on an emitter: the point as a light sample, with the density of this technique as its pdf.
    pub hit_light: Option<LightSample>,
    /// If the segment leaves the scene: the environment's radiance.
    pub escaped: Option<Vec3>,
}

/// Receives the vertices and connections of a path in order, as they are found.
pub trait Recorder {
    /// Whether this recorder records anything.
    const RECORDS: bool = true;

    /// A vertex reached with `throughput · through.weight` (before scattering), at distance `t` from the previous one.
    fn vertex(&mut self, _si: &SurfaceInteraction, _throughput: Vec3, _t: f32, _through: &MaskWeight) {}
    /// The body on the way to the latest vertex, whose absorption the throughput includes.
    fn absorbed(&mut self, _body: u32) {}
    /// Begins a new segment. The masks on it follow, and then the vertex or connection that it leads to, if there is one.
    fn segment(&mut self) {}
    /// A mask that was passed. Not called if masks are sampled by opacity ([`MaskSampling::Opacity`]).
    fn cross(&mut self, _crossing: &MaskCrossing) {}
    /// An unoccluded light connection of the latest vertex.
    fn connect(&mut self, _connection: &Connection) {}
    /// The continuation of the latest vertex.
    fn advance(&mut self, _continuation: &Continuation) {}
}

/// Records nothing, for rendering without derivatives.
#[derive(Clone, Copy)]
pub struct NoRecord;

impl Recorder for NoRecord {
    const RECORDS: bool = false;
}

/// The way to the first vertex of a path.
struct FirstSegment {
    t: f32,
    through: MaskWeight,
    /// In scenes where bodies absorb light: those that the vertex is in, and what the one on the way does not absorb.
    bodies: Option<(Inside, Vec3)>,
}

impl FirstSegment {
    /// Of a path that starts at its first vertex.
    const NONE: FirstSegment = FirstSegment { t: 0.0, through: MaskWeight::CLEAR, bodies: None };

    /// Of a path that starts with a ray, which goes as far as `t`.
    #[inline(always)]
    fn new(scene: &Scene, ray: &Ray, options: &Options, (t, through): (f32, MaskWeight)) -> FirstSegment {
        let bodies = scene.absorbs().then(|| {
            let inside = options.inside.unwrap_or_else(|| scene.around(ray.origin));
            (inside, scene.attenuated(&inside, t))
        });
        FirstSegment { t, through, bodies }
    }

    /// What the body on the way does not absorb.
    #[inline(always)]
    fn attenuation(&self) -> Vec3 {
        self.bodies.as_ref().map_or(Vec3::ONE, |(_, attenuation)| *attenuation)
    }
}

/// One-sample estimate of the radiance along a path's first segment, towards its start.
#[inline(always)]
pub fn trace<R: Recorder>(scene: &Scene, start: Start, sampler: &mut Sampler, options: &Options, rec: &mut R) -> Vec3 {
    let mut paths = Paths::<1>::new();
    let (samplers, recs) = (array::from_mut(sampler), array::from_mut(rec));
    let mut options = *options;
    let mut way = FirstSegment::NONE;
    if let Start::Surface(si) | Start::BesideEdge(si, _) = &start
        && scene.absorbs()
    {
        way.bodies = Some((scene.in_front_of(si), Vec3::ONE));
    }
    match start {
        Start::Surface(si) => paths.start_at(0, &si, &way, &options, &mut recs[0]),
        Start::BesideEdge(si, skip) => {
            /// In an acute corner, light is reflected between surfaces at distances that are smaller than those at which rays of other
            /// paths begin.
            const NEAR: f32 = 1.0 / 16.0;
            options.first_skip = skip;
            paths.offset_scale = NEAR;
            paths.start_at(0, &si, &way, &options, &mut recs[0]);
        }
        Start::Ray(ray, skip) => paths.start(scene, &[ray], skip, samplers, &options, recs),
    }
    paths.run(scene, samplers, &options, recs);
    paths.radiance(0)
}

/// Number of paths that [`Paths::trace`] traces side by side.
pub const BATCH: usize = 32;

#[cfg(test)]
mod tests {
    use glam::Mat3;

    use super::*;
    use crate::mesh::Mesh;
    use crate::mesh::shapes::{icosphere, rectangle};
    use crate::render::material::{Input, Material, MaterialKind};
    use crate::render::scene::{DeltaLight, Emission, SceneDescription, Shape, SphericalMap};
    use crate::render::texture::{Filter, Texture, Wrap};

    /// Whoever records needs whole interactions everywhere.
    struct Records;

    impl Recorder for Records {}

    /// A glossy ball in a corner, a lamp, and a sky of two halves.
    fn corner() -> Scene {
        let mut d = SceneDescription::default();
        let mut constant = |rgb: Vec3| {
            d.textures.push(Texture::constant(rgb));
            Input::Texture(d.textures.len() - 1)
        };
        let (white, black) = (constant(Vec3::splat(0.7)), constant(Vec3::ZERO));
        let (roughness, bright) = (constant(Vec3::splat(0.4)), constant(Vec3::splat(5.0)));
        let mut add = |mesh: Mesh, kind: MaterialKind, emission: Option<Emission>| {
            d.shapes.push(Shape { mesh, material: Material::from(kind), emission });
        };
        let quad = |turn: Mat3, at: Vec3, size: f32| {
            let mut mesh = rectangle(size, size).unwrap();
            mesh.vertices.iter_mut().for_each(|v| *v = turn * *v + at);
            mesh
        };
        let (turn, diffuse) = (Mat3::from_rotation_x(1.2), MaterialKind::Diffuse { reflectance: white });
        add(quad(Mat3::IDENTITY, Vec3::ZERO, 4.0), diffuse.clone(), None);
        add(quad(turn, Vec3::new(0.0, 1.0, -1.0), 4.0), diffuse, None);
        let mut ball = icosphere(0.6, 1).unwrap();
        ball.vertices.iter_mut().for_each(|v| *v += Vec3::new(0.3, 0.7, 0.2));
        add(ball, MaterialKind::Conductor { reflectance: white, roughness }, None);
        let lamp = Emission { radiance: bright, two_sided: true };
        add(quad(turn, Vec3::new(-0.8, 1.2, 0.3), 0.4), MaterialKind::Diffuse { reflectance: black }, Some(lamp));
        let mut sky = vec![0.1; 8 * 4 * 3];
        sky[..8 * 2 * 3].fill(0.6);
        d.textures.push(Texture::new(8, 4, 3, sky, Wrap::Repeat, Filter::Bilinear).unwrap());
        d.environment = Some(SphericalMap { texels: d.textures.len() - 1, rotation: Mat3::IDENTITY });
        Scene::new(d).unwrap()
    }

    /// Whatever is used to choose directions, light is the same.
    #[test]
    fn area_sampling_finds_the_light_that_bsdf_sampling_finds() {
        const N: u64 = 60_000;
        let scene = corner();
        for (x, y) in [(0.0, -0.9), (0.15, -0.4), (-0.4, -0.2)] {
            let ray = Ray::new(Vec3::new(0.0, 2.0, 3.0), Vec3::new(x, y, -1.0).normalize());
            let radiance = |fraction: f32, split_lobes: bool| {
                let options = Options { area_sampling_fraction: fraction, split_lobes, ..Options::new(4) };
                let (mut sum, mut squares) = (0.0, 0.0);
                for i in 0..N {
                    // Independent samples, of which the error can be told.
                    let mut sampler = Sampler::new(i, 0);
                    let l = f64::from(trace(&scene, Start::Ray(ray, &[]), &mut sampler, &options, &mut NoRecord).y);
                    (sum, squares) = (sum + l, squares + l * l);
                }
                let (mean, n) = (sum / N as f64, N as f64);
                (mean, (squares / n - mean * mean) / n)
            };
            let (expected, variance) = radiance(0.0, false);
            for (fraction, split_lobes) in [(0.25, false), (0.7, false), (0.5, true)] {
                let (found, own) = radiance(fraction, split_lobes);
                let error = (variance + own).sqrt();
                assert!(error < 0.015 * expected, "{error} of {expected}");
                assert!((found - expected).abs() < 3.5 * error, "{fraction}: {found} instead of {expected} ± {error}");
            }
        }
    }

    #[test]
    fn paths_side_by_side_are_paths_one_after_the_other_to_the_last_bit() {
        let changed = |change: fn(&mut SceneDescription)| {
            let mut description = corner().description.clone();
            change(&mut description);
            Scene::new(description).unwrap()
        };
        let scenes = [
            corner(),
            changed(|d| {
                d.shapes[2].material.opacity = Some(Input::Texture(0));
                d.delta_lights.push(DeltaLight::Point { position: Vec3::Y * 2.0, intensity: Vec3::ONE });
            }),
            changed(|d| d.shapes[2].material.kind = MaterialKind::Mirror { reflectance: Input::Texture(0) }),
            changed(|d| d.shapes[2].material.kind = MaterialKind::Diffuse { reflectance: Input::Texture(0) }),
            // Ground glass that absorbs, beside matte surfaces.
            changed(|d| {
                d.textures.extend([1.5, 0.3, 0.8].map(|x| Texture::constant(Vec3::splat(x))));
                let [ior, roughness, absorption] = [3, 2, 1].map(|back| Input::Texture(d.textures.len() - back));
                let (roughness, absorption) = (Some(roughness), Some(absorption));
                d.shapes[2].material.kind = MaterialKind::Dielectric { ior, roughness, absorption };
            }),
        ];
        let plain = Options { keep_black: true, split_lobes: true, ..Options::new(6) };
        let all_options = [
            plain,
            Options::new(1),
            Options { area_sampling_fraction: 0.3, ..plain },
            Options { required_shapes: Some(&[false, false, true, false]), next_event: false, ..Options::new(4) },
        ];
        let pairs = scenes.iter().flat_map(|scene| all_options.iter().map(move |options| (scene, options)));
        for (case, (scene, options)) in pairs.enumerate() {
            let mut paths = Paths::<BATCH>::new();
            let mut lit = 0;
            for batch in 0..20 {
                let count = if batch % 3 == 0 { BATCH } else { 1 + batch };
                let ray = |k: usize| {
                    let x = -1.3 + 2.6 * ((batch * BATCH + k) % 97) as f32 / 97.0;
                    Ray::new(Vec3::new(0.0, 2.0, 3.0), Vec3::new(x, -0.3 - 0.5 * x * x, -1.0).normalize())
                };
                let rays: [Ray; BATCH] = array::from_fn(ray);
                let sampler = |k: usize| Sampler::new(7, (batch * BATCH + k) as u64);
                let (mut samplers, mut recs) = (array::from_fn(sampler), [NoRecord; BATCH]);
                paths.trace(scene, &rays[..count], &mut samplers, options, &mut recs);
                for (k, ray) in rays[..count].iter().enumerate() {
                    let mut alone = sampler(k);
                    let expected = trace(scene, Start::Ray(*ray, &[]), &mut alone, options, &mut NoRecord);
                    assert_eq!(paths.radiance(k), expected, "case {case}, batch {batch}, path {k}");
                    let recorded = trace(scene, Start::Ray(*ray, &[]), &mut sampler(k), options, &mut Records);
                    assert_eq!(recorded, expected, "recorded: case {case}, batch {batch}, path {k}");
                    lit += usize::from(expected.max_element() > 0.2);
                }
            }
            assert!(lit > 50, "case {case}: {lit}");
        }
    }
}
