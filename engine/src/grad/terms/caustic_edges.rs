//! Boundary term of light tracing: edges that light from points, spots and suns passes on its way by specular surfaces to what the
//! camera sees, before the first of them, between them and after the last; and edges between there and the camera.
//!
//! What a light sends is an integral over its film. It jumps where the chain of specular surfaces hits another surface on one side than
//! on the other, and where the place at which it ends disappears from the camera's sight: [`crate::grad::sampling::jumps`] says how such places are
//! found, and what they count. There h is the distance on the camera's film between the images of the edge's point and of the place.
//!
//! What the light's film shows directly need not be looked for: [`CausticRims`] has points along those edges. There a chain begins on one
//! side that does not on the other, or two begin on different facets.

use glam::{Vec2, Vec3};

use crate::grad::estimate::{Draw, Estimate, Pass, Sequence};
use crate::grad::local::{RayAdjoint, VertexAdjoint, d_intersection};
use crate::grad::sampling::allocate::{Estimator, typical_bounces};
use crate::grad::sampling::guide::{Guide, GuideKey, GuideTraining};
use crate::grad::sampling::jumps::{self, Jumps, Line, Nowhere, Passed, d_links, slope_on_film};
use crate::grad::sink::{Adjoints, Layout};
use crate::grad::terms::caustics::{MOST_CELLS, d_light_ray};
use crate::render::accel::{PrimId, Ray};
use crate::render::bsdf::Lobe;
use crate::render::caustics::{Landing, arriving};
use crate::render::edges::Edge;
use crate::render::interaction::SurfaceInteraction;
use crate::render::light_film::LightFilms;
use crate::render::sampler::{Discrete, Sampler, hash};
use crate::render::sensor::Projected;
use crate::render::specular::{Chain, LONGEST, Transport};
use crate::render::{Camera, Scene, Settings};
use crate::stop::paced;

/// The estimator of edges that caustics end at, but for those that the light's film shows directly.
pub struct CausticEdges<'a> {
    common: &'a Common<'a>,
    count: usize,
    /// The guide over the random numbers that choose a place of the films.
    guide: Option<Guide>,
}

/// The estimator of edges that the light's film shows directly.
pub struct CausticRims<'a> {
    common: &'a Common<'a>,
    /// Edges that some film shows, with the films.
    edges: Vec<(u32, u32)>,
    density: Discrete,
    count: usize,
    /// The guide over the random number that chooses a point of an edge.
    guide: Option<Guide>,
}

/// What both estimators know.
pub struct Common<'a> {
    scene: &'a Scene,
    camera: &'a Camera,
    layout: &'a Layout,
    films: &'a LightFilms,
    jumps: Jumps<'a>,
    max_bounces: u32,
    samples: usize,
}

/// A path that starts at a point of a light's film.
struct LightPath {
    chain: Chain,
    landing: Option<Landing>,
    /// What hides the place where it lands from the camera.
    hidden_by: Option<PrimId>,
    /// What it brings to the camera.
    value: Vec3,
}

/// The ends of a path: the light's film at which it starts, and the camera that sees it.
#[derive(Clone, Copy)]
struct Ends<'c> {
    film: u32,
    camera: &'c Camera,
}

/// What a path passes where it jumps.
enum Jump<'a> {
    /// An edge, after so many links.
    Chain(Passed<'a>, usize),
    /// An edge in front of the place where it lands.
    Occluder(Occluder<'a>),
}

/// An edge in front of the place where a path lands, as the camera sees it.
struct Occluder<'a> {
    passed: Passed<'a>,
    view: Ray,
    /// Where the camera sees the edge's point, and the place.
    edge: Projected,
    place: Projected,
    /// The edge's normal on film.
    normal: Vec2,
}

impl<'a> Common<'a> {
    /// `None` if the image holds no caustics, or there are no edges.
    pub fn new(
        scene: &'a Scene,
        camera: &'a Camera,
        films: Option<&'a LightFilms>,
        settings: &Settings,
        layout: &'a Layout,
    ) -> Option<Common<'a>> {
        let films = films.filter(|_| settings.has_caustics())?;
        let jumps = Jumps::new(scene);
        let samples = settings.spp.max(1) as usize * camera.width * camera.height;
        let max_bounces = settings.max_bounces;
        (!jumps.table.edges.is_empty()).then_some(Common { scene, camera, layout, films, jumps, max_bounces, samples })
    }

    /// The path from a point of a light's film, whose surfaces send it into lobes as `choose` says.
    fn light_path(
        &self,
        camera: &Camera,
        film: u32,
        pixel: Vec2,
        choose: impl FnMut(usize, &SurfaceInteraction) -> (Lobe, f32),
    ) -> LightPath {
        let (mut chain, most) = (Chain::default(), self.max_bounces as usize - 1);
        chain.follow(self.scene, self.films.ray(film, pixel), most, Transport::Power, choose);
        let landing = Landing::of(self.scene, camera, &chain);
        let hidden_by = landing.as_ref().and_then(|landing| landing.hidden_by(self.scene));
        let value = match &landing {
            Some(landing) if hidden_by.is_none() => {
                self.films.power(self.scene, film, pixel) * arriving(self.scene, &chain) * landing.response()
            }
            _ => Vec3::ZERO,
        };
        let value = if value.is_finite() { value } else { Vec3::ZERO };
        LightPath { chain, landing, hidden_by, value }
    }

    /// Whether one of two paths that end at the same surface is hidden from the camera.
    fn occlusion_differs(a: &LightPath, b: &LightPath) -> bool {
        a.landing.is_some() && b.landing.is_some() && a.hidden_by.is_some() != b.hidden_by.is_some()
    }

    /// What the path passes between two neighbouring points of the film.
    fn jump(&self, camera: &Camera, a: &LightPath, b: &LightPath) -> Option<Jump<'a>> {
        if let Some(k) = self.jumps.parts(&a.chain, &b.chain) {
            let passed = self.jumps.passed(&a.chain, &b.chain, k)?;
            let again = k > 0 && passed.is_at_start(&a.chain.rays[k]);
            return (!again).then_some(Jump::Chain(passed, k));
        }
        let (of_a, of_b) = (a.landing.as_ref()?, b.landing.as_ref()?);
        let hider = a.hidden_by.or(b.hidden_by)?;
        let view = of_a.view();
        let passed = self.jumps.passed_by([&view, &of_b.view()], [hider; 2])?;
        // At the foot of what hides the place nothing is hidden by it, as rays to the place end a little before it: that is no jump.
        const AT_FOOT: f32 = 8.0;
        if of_a.distance - passed.t <= AT_FOOT * (of_a.distance - view.t_max) {
            return None;
        }
        let edge = camera.project(passed.edge.point(passed.s))?;
        let [x, y] = camera.projection_gradient(&edge);
        let along = passed.edge.p[1] - passed.edge.p[0];
        let normal = Vec2::new(x.dot(along), y.dot(along)).perp().normalize_or_zero();
        Some(Jump::Occluder(Occluder { passed, view, edge, place: of_a.projected, normal }))
    }

    /// Adjoint of the ray that leaves the light, for one of h, and the derivatives of all that moves what it passes.
    fn d_jump(&self, out: &mut Adjoints, camera: &Camera, chain: &Chain, jump: &Jump, d_h: f32) -> RayAdjoint {
        match jump {
            Jump::Chain(passed, k) => {
                passed.d_point(out, &chain.rays[*k], passed.normal * d_h);
                d_links(out, &chain.links[..*k], passed.d_ray(d_h))
            }
            Jump::Occluder(occluder) => {
                let d = occluder.normal * d_h;
                let d_edge = camera.d_project(&occluder.edge, d, &mut out.camera);
                occluder.passed.d_point(out, &occluder.view, d_edge);
                let p = camera.d_project(&occluder.place, -d, &mut out.camera);
                let Some((end, t)) = &chain.end else { return RayAdjoint::default() };
                let ray = d_intersection(out, end, *t, VertexAdjoint { p, ..VertexAdjoint::default() });
                d_links(out, &chain.links, ray)
            }
        }
    }
}

impl Common<'_> {
    /// How h changes on a light's film, per pixel.
    fn slope(&self, Ends { film, camera }: Ends, pixel: Vec2, chain: &Chain, jump: &Jump) -> Vec2 {
        let mut nowhere = Nowhere;
        let mut unused = Adjoints::new(self.scene, self.layout, &mut nowhere);
        let ray = self.d_jump(&mut unused, camera, chain, jump, 1.0);
        slope_on_film(self.films.of(film).1, pixel, ray)
    }

    /// What paths see a little aside of a jump on either side, where they end at a foot of the edge: right beside it they do not find it.
    fn aside(
        &self,
        place: Vec2,
        slope: Vec2,
        ahead: Vec2,
        jump: &Jump,
        path_at: &impl Fn(Vec2) -> LightPath,
    ) -> [Option<LightPath>; 2] {
        let Jump::Chain(passed, k) = jump else { return [None, None] };
        let Some(places) = self.jumps.aside(passed, place, slope, ahead) else { return [None, None] };
        places.map(|place| Some(path_at(place)).filter(|path| passed.is_foot_of(&path.chain, *k)))
    }

    /// Adds what the paths on both sides of a jump bring, times the `motion` of the place where it is per h: of the side before it, less
    /// that of the side after it.
    fn add(
        &self,
        Ends { film, camera }: Ends,
        chain: &Chain,
        sides: [&LightPath; 2],
        jump: &Jump,
        motion: f32,
        out: &mut dyn Estimate,
    ) {
        if !motion.is_finite() {
            return;
        }
        for (side, sign) in sides.into_iter().zip([-1.0, 1.0]) {
            let Some(landing) = side.landing.as_ref().filter(|_| side.value != Vec3::ZERO) else { continue };
            let m = side.value * (motion * sign);
            let footprint = camera.footprint(landing.projected.pixel);
            out.pixels(footprint.pixels(), &mut |d, out| {
                let ray = self.d_jump(out, camera, chain, jump, d.dot(m));
                d_light_ray(out, self.films.of(film).0, ray);
            });
        }
    }
}

impl<'a> CausticEdges<'a> {
    pub fn new(common: Option<&'a Common<'a>>) -> Option<CausticEdges<'a>> {
        common.map(|common| CausticEdges { common, count: (common.samples / 4).max(64), guide: None })
    }

    /// Trains the guide: pilot samples measure where lines find jumps.
    pub fn guided(mut self, training: &GuideTraining) -> Self {
        let size = [training.cells(self.count, MOST_CELLS).max(4), 1];
        self.guide = Some(Guide::new(GuideKey::CausticEdges, size, training, |mut sampler, at, pilot| {
            self.sample(at, 1.0, &mut sampler, pilot);
        }));
        self
    }
}

impl CausticEdges<'_> {
    /// Draws one sample; `at` chooses the pixel of a film and the place of a line across it.
    fn sample(&self, at: [f64; 2], weight: f64, sampler: &mut Sampler, out: &mut dyn Estimate) {
        let common = self.common;
        let start = common.films.place(at);
        let camera = common.camera.sample_lens(sampler);
        let [which, offset] = sampler.next_2d().into();
        let line = Line::new(start.corner, start.within, which < 0.5, sampler);
        // One of both directions was chosen.
        let weight = 2.0 * (start.weight * weight) as f32;
        let path_at = |pixel: Vec2| common.light_path(&camera, start.film, pixel, |k, si| line.lobe(k, si));
        let differs = |a: &LightPath, b: &LightPath| {
            Common::occlusion_differs(a, b) || common.jumps.parts(&a.chain, &b.chain).is_some()
        };
        line.march(offset, &path_at, &differs, &mut |pixel, a, b| {
            let Some(jump) = common.jump(&camera, a, b) else { return };
            if matches!(jump, Jump::Chain(_, 0)) {
                return; // a rim
            }
            let ends = Ends { film: start.film, camera: &camera };
            let slope = common.slope(ends, pixel, &a.chain, &jump);
            let [clear_a, clear_b] = common.aside(pixel, slope, line.ahead(), &jump, &path_at);
            let sides = [clear_a.as_ref().unwrap_or(a), clear_b.as_ref().unwrap_or(b)];
            common.add(ends, &a.chain, sides, &jump, weight * line.motion(slope), out);
        });
    }
}

impl Draw for CausticEdges<'_> {
    type Scratch = ();

    fn draw(&self, first: f64, mut sampler: Sampler, weight: f64, _: &mut (), out: &mut dyn Estimate) {
        let at = [first, f64::from(sampler.next_1d())];
        let (at, density) = self.guide.as_ref().map_or((at, 1.0), |guide| guide.warp(at));
        self.sample(at, weight / density, &mut sampler, out);
    }
}

impl Estimator for CausticEdges<'_> {
    fn count(&self) -> usize {
        self.count
    }

    fn cost(&self) -> f64 {
        40.0 + 20.0 * typical_bounces(self.common.max_bounces)
    }

    fn pass(&self, count: usize, share: f64, seed: u64) -> impl Pass + '_ {
        Sequence { of: self, count, weight: share / count as f64, seed: hash(seed, 0x6361_7573_6564_6765) }
    }
}

impl<'a> CausticRims<'a> {
    pub fn new(common: Option<&'a Common<'a>>) -> Option<CausticRims<'a>> {
        let common = common?;
        let (mut edges, mut weights) = (Vec::new(), Vec::new());
        for (film, e) in
            (0..common.films.count()).flat_map(|film| (0..common.jumps.table.edges.len()).map(move |e| (film, e)))
        {
            if let Some(length) = common.length_on_film(film, &common.jumps.table.edges[e]) {
                edges.push((e as u32, film));
                weights.push(length);
            }
        }
        let density = Discrete::new(paced(weights, 1));
        let count = (common.samples / 2).max(64);
        (!density.is_empty()).then_some(CausticRims { common, edges, density, count, guide: None })
    }

    /// Trains the guide: pilot samples measure which edges matter.
    pub fn guided(mut self, training: &GuideTraining) -> Self {
        let size = [training.cells(self.count, MOST_CELLS).max(4), 1];
        self.guide = Some(Guide::new(GuideKey::CausticRims, size, training, |mut sampler, [at, _], pilot| {
            self.sample(at, 1.0, &mut sampler, pilot);
        }));
        self
    }
}

impl Common<'_> {
    /// The length of an edge on a light's film, in pixels; `None` where nothing jumps there, or it is not on the film.
    fn length_on_film(&self, film: u32, edge: &Edge) -> Option<f64> {
        let camera = self.films.of(film).1;
        let size = camera.width as f32;
        let middle = edge.point(0.5);
        let view = edge.view(-camera.direction_from(middle).0)?;
        if let Some(background) = view.background {
            // Within a surface that scatters nothing begins or ends, nor where directions follow normals that do not jump.
            let shapes =
                [view.foreground, background].map(|face| self.scene.prims[edge.faces[face].prim as usize].shape);
            let specular = shapes.map(|i| self.scene.description.shapes[i as usize].material.kind.is_delta());
            let smooth = self.scene.description.shapes[shapes[0] as usize].mesh.normals.is_some();
            if specular == [false, false] || shapes[0] == shapes[1] && smooth {
                return None;
            }
        }
        let [a, b] = [0.0, 1.0].map(|s| camera.project(edge.point(s)).map(|projected| projected.pixel));
        let (low, high) = match (a, b) {
            (None, None) => return None,
            (Some(a), Some(b)) => (a.min(b), a.max(b)),
            _ => (Vec2::ZERO, Vec2::splat(size)),
        };
        let seen = [low.max(Vec2::ZERO), high.min(Vec2::splat(size))];
        let length = f64::from((seen[1] - seen[0]).length());
        (seen[0].cmple(seen[1]).all() && length > 0.0 && self.films.may_cover(film, seen)).then_some(length)
    }
}

impl CausticRims<'_> {
    /// Draws one sample; `at` chooses the point of an edge.
    fn sample(&self, at: f64, weight: f64, sampler: &mut Sampler, out: &mut dyn Estimate) {
        /// Neither reflection nor refraction is rarer, so that what is behind both is found.
        const LEAST: f32 = 0.1;
        let common = self.common;
        let (i, probability, s) = self.density.sample(at);
        let (e, film) = self.edges[i];
        let edge = &common.jumps.table.edges[e as usize];
        let on_film = common.films.of(film).1;
        let Some(place) = on_film.project(edge.point(s as f32)).filter(|place| on_film.on_film(place.pixel)) else {
            return;
        };
        // The edge's image: its length per s, and its normal.
        let [x, y] = on_film.projection_gradient(&place);
        let along = edge.p[1] - edge.p[0];
        let along = Vec2::new(x.dot(along), y.dot(along));
        let aside = along.perp().normalize_or_zero() * jumps::narrow(place.pixel);
        let camera = common.camera.sample_lens(sampler);
        let choices: [f32; LONGEST] = std::array::from_fn(|_| sampler.next_1d());
        let path_at =
            |pixel: Vec2| common.light_path(&camera, film, pixel, |k, si| si.choose_delta_lobe(choices[k], LEAST));
        let (a, b) = (path_at(place.pixel - aside), path_at(place.pixel + aside));
        if common.jumps.parts(&a.chain, &b.chain) != Some(0) {
            return;
        }
        let Some(passed) = common.jumps.passed(&a.chain, &b.chain, 0) else { return };
        if !std::ptr::eq(passed.edge, edge) {
            return; // something is in front of it
        }
        let jump = Jump::Chain(passed, 0);
        let ends = Ends { film, camera: &camera };
        let slope = common.slope(ends, place.pixel, &a.chain, &jump);
        let ahead = aside.normalize_or_zero();
        let [clear_a, clear_b] = common.aside(place.pixel, slope, ahead, &jump, &path_at);
        let sides = [clear_a.as_ref().unwrap_or(&a), clear_b.as_ref().unwrap_or(&b)];
        // The place moves along the edge's normal, by −1/h_n per h.
        let per_h = slope.dot(ahead).recip();
        let weight = (weight / probability) as f32 * along.length();
        common.add(ends, &a.chain, sides, &jump, weight * per_h, out);
    }
}

impl Draw for CausticRims<'_> {
    type Scratch = ();

    fn draw(&self, first: f64, mut sampler: Sampler, weight: f64, _: &mut (), out: &mut dyn Estimate) {
        let ([at, _], density) = self.guide.as_ref().map_or(([first, 0.0], 1.0), |guide| guide.warp([first, 0.0]));
        self.sample(at, weight / density, &mut sampler, out);
    }
}

impl Estimator for CausticRims<'_> {
    fn count(&self) -> usize {
        self.count
    }

    fn cost(&self) -> f64 {
        10.0 + 6.0 * typical_bounces(self.common.max_bounces)
    }

    fn pass(&self, count: usize, share: f64, seed: u64) -> impl Pass + '_ {
        Sequence { of: self, count, weight: share / count as f64, seed: hash(seed, 0x6361_7573_7269_6d73) }
    }
}
