//! Boundary term at path vertices: edges seen from a shading point, with reflected radiance and the environment on both sides.
//!
//! Receiver-first: choose a vertex x of a camera path and an edge point p for it, and add sinφ/|q|² f cosθ (L_fg − L_bg) N̂·(ṗ − ẋ) (Li
//! et al. 2018, §5, with direction-fixed radiance on both sides). The derivative of x is propagated back along the same path. Emission of
//! area lights is fixed to their surfaces and not included here: its boundary term is [`crate::grad::terms::shadow`]. A narrow lobe is
//! attached: there emission counts too, and the lobe's direction moves, N̂·(ṗ − ẋ − |q|ω̇). An edge seen in a planar mirror is seen
//! directly from the mirror image of x: this is the same estimator, with emission on both sides. For a curved mirror the edge point is
//! connected to x by all specular paths ([`crate::grad::mirrors::curved`]), with N̂·(ṗ − ṙ), where ṙ is the velocity of the mirrored ray,
//! and with the area over which it spreads in place of |q|².

use glam::{Vec2, Vec3};

use crate::grad::environment::MovingEnvironment;
use crate::grad::estimate::{Draw, Estimate, Pass, Sequence};
use crate::grad::layers::Sides;
use crate::grad::local::{RayAdjoint, d_specular_ray};
use crate::grad::mirrors::curved::MirrorTree;
use crate::grad::mirrors::viewpoint::{MirrorPlane, d_mirror_image};
use crate::grad::path::{Injection, Path, PathVertex, area_sampling_fraction, inject};
use crate::grad::sampling::allocate::{Estimator, typical_bounces};
use crate::grad::sampling::edge_tree::{EdgePoint, EdgeTree, Query};
use crate::grad::sampling::guide::{Guide, GuideKey, GuideTraining};
use crate::grad::sampling::pixels::{self, FilmDensity};
use crate::grad::sink::{Adjoints, Layout};
use crate::render::accel::{PrimId, Ray};
use crate::render::bodies::Inside;
use crate::render::bsdf::Lobe;
use crate::render::edges::{Edge, EdgeTable, EdgeView};
use crate::render::integrator::{Options, Recorder, Start, trace};
use crate::render::interaction::SurfaceInteraction;
use crate::render::mask::MaskWeight;
use crate::render::sampler::{ONE_MINUS_EPSILON, Sampler, hash};
use crate::render::{Camera, Scene, Settings};

/// Angle between an edge and the ray past it, in radians.
const NUDGE: f32 = 2e-5;

/// Most cells of the guide over the film.
const MOST_CELLS: usize = 64 * 64;

/// Number of edge points for each path. Something that moves past a surface appears on one side and vanishes on the other: sampled from
/// one vertex, these two partly cancel, and the path is shared.
const EDGE_POINTS: usize = 4;

/// The estimator of secondary edges.
pub struct Secondary<'a> {
    scene: &'a Scene,
    /// The part of the environment whose shadows are sampled from the edges.
    environment: MovingEnvironment,
    camera: &'a Camera,
    mirrors: &'a [MirrorPlane],
    curved: Option<&'a MirrorTree>,
    table: &'a EdgeTable,
    tree: &'a EdgeTree,
    layout: &'a Layout,
    /// [`Options::area_sampling_fraction`], as for interior paths.
    area_sampling_fraction: f32,
    /// A tree of only the edges that move, for path vertices that do not move.
    moving: Option<EdgeTree>,
    max_bounces: u32,
    count: usize,
    film: FilmDensity,
    /// The guide over the film.
    guide: Option<Guide>,
}

/// A boundary sample of a path: with pixel adjoint d the contribution is (d·weight) N̂·(ṗ − ẋ).
#[derive(Clone, Copy, Debug)]
pub struct SecondarySample {
    /// Index of the path vertex x.
    pub vertex: usize,
    pub(crate) edge: usize,
    pub(crate) foreground: usize,
    pub(crate) s: f32,
    /// The edge point.
    pub p: Vec3,
    /// Normal from the covering to the uncovered side of the edge as x sees it (in the mirror, if there is one).
    pub normal: Vec3,
    pub(crate) mirror: Option<MirrorVertex>,
    pub(crate) weight: Vec3,
    /// The fraction of the weight whose direction is attached, with that direction and the distance of the edge along it.
    pub attached: Vec3,
    pub(crate) dir: Vec3,
    pub(crate) distance: f32,
}

/// The vertex on a mirror between a path vertex and an edge.
#[derive(Clone, Copy, Debug)]
pub struct MirrorVertex {
    pub(crate) si: SurfaceInteraction,
    /// For a curved mirror: its distance from the path vertex, and that of the edge from it.
    pub curved: Option<[f32; 2]>,
}

/// The radiance on one side of an edge, with the emission of the first surface kept separate.
#[derive(Default)]
struct SideRadiance {
    first: Option<PrimId>,
    emission: Vec3,
    radiance: Vec3,
}

impl Recorder for SideRadiance {
    fn vertex(&mut self, si: &SurfaceInteraction, throughput: Vec3, _t: f32, _through: &MaskWeight) {
        if self.first.is_none() {
            self.first = Some(si.prim);
            self.emission = si.emission * throughput;
        }
    }
}

/// How often edges are looked for through rough glass rather than in its reflections.
const PASSES: f32 = 0.75;

impl<'a> Secondary<'a> {
    /// `None` if path vertices can see nothing but lights.
    pub fn new(
        environment: MovingEnvironment,
        camera: &'a Camera,
        tree: &'a EdgeTree,
        mirrors: &'a [MirrorPlane],
        curved: Option<&'a MirrorTree>,
        settings: &Settings,
        training: &GuideTraining<'a>,
    ) -> Option<Secondary<'a>> {
        let GuideTraining { scene, layout, adjoint, .. } = *training;
        let sees_environment = scene.environment.is_some() && environment != MovingEnvironment::Whole;
        let direct = sees_environment || scene.has_glass || !scene.contacts().is_empty() || has_attached_lobes(scene);
        let reach = if direct { 1 } else { 2 };
        let table = scene.edges();
        let film = FilmDensity::new(camera, adjoint);
        if settings.max_bounces < reach || table.edges.is_empty() || film.is_empty() {
            return None;
        }
        let pixels = pixels::active(adjoint);
        let count = (pixels * settings.spp.max(1) as usize / EDGE_POINTS).max(1024);
        let max_bounces = settings.max_bounces;
        let moving = if layout.moves_view() { None } else { EdgeTree::of_moving(scene, layout) };
        let secondary = Secondary {
            scene,
            environment,
            camera,
            mirrors,
            curved,
            table,
            tree,
            layout,
            area_sampling_fraction: area_sampling_fraction(layout),
            moving,
            max_bounces,
            count,
            film,
            guide: None,
        };
        Some(secondary)
    }

    /// Trains the guide: pilot samples measure where on film edges contribute.
    pub fn guided(mut self, training: &GuideTraining) -> Self {
        let side = (training.cells(self.count, MOST_CELLS) as f64).sqrt().max(4.0) as usize;
        self.guide =
            Some(Guide::new(GuideKey::Secondary(self.environment), [side; 2], training, |mut sampler, at, pilot| {
                let _film = sampler.next_2d();
                let u = sampler.next_2d();
                self.sample_at(at, u, 1.0, &mut sampler, &mut Path::default(), pilot);
            }));
        self
    }

    /// Draws one sample: `at` chooses the film position, `u` the edges and the points on them; `weight` is the inverse of their density.
    fn sample_at(
        &self,
        at: [f64; 2],
        u: Vec2,
        weight: f64,
        sampler: &mut Sampler,
        path: &mut Path,
        out: &mut dyn Estimate,
    ) {
        let film = self.film.place(at);
        if out.skips(&[(film.pixel as u32, 1.0)]) {
            return;
        }
        let camera = self.camera.sample_lens(sampler);
        let ray = camera.ray(film.position);
        // The last vertex that can see an edge is one scattering event before the last one.
        let options = Options {
            next_event: false,
            split_lobes: true,
            area_sampling_fraction: self.area_sampling_fraction,
            ..Options::new(self.max_bounces - 1)
        };
        path.clear();
        trace(self.scene, Start::Ray(ray, &[]), sampler, &options, path);
        let weight = (film.weight * weight / EDGE_POINTS as f64) as f32;
        for i in 0..EDGE_POINTS {
            let u = Vec2::new((u.x + i as f32) / EDGE_POINTS as f32, u.y).min(Vec2::splat(ONE_MINUS_EPSILON));
            let Some(sample) = self.sample(path, u, sampler) else { continue };
            out.pixel(film.pixel, &mut |d, out| {
                let injection = self.scatter(out, &sample, d * weight);
                let ray = inject(out, path, &injection);
                camera.d_ray(film.position, ray.origin, ray.dir, &mut out.camera);
            });
        }
    }

    /// Draws one sample for a recorded path. `u` chooses the edge and the point on it.
    fn sample(&self, path: &Path, u: Vec2, sampler: &mut Sampler) -> Option<SecondarySample> {
        let chosen = self.choose_vertex(path, sampler.next_1d())?;
        let vertex = &path.vertices()[chosen.index];
        let behind_glass = self.is_behind_glass(path, chosen.index);
        let (route, routes) = self.choose_route(chosen.index, sampler);
        if matches!(route, Route::Direct) && self.events_left(chosen.index) < self.least_events(path, chosen.index) {
            return None;
        }
        let point = self.choose_edge_point(&path.vertices()[..=chosen.index], route, u, sampler)?;
        let at = self.connect_by_route(&vertex.si, route, point, sampler)?;
        let jump = self.jump(&at, behind_glass, self.events_left(chosen.index), sampler)?;
        let Shading { edge, connection, dir, area, .. } = at;
        let sin_phi = edge.direction().cross(connection.dir).length();
        let pdf = point.pdf * chosen.weight / (chosen.total * routes as f32);
        let scale = vertex.throughput * connection.reflectance * (jump.covers * sin_phi / (area * pdf));
        let (weight, attached) = (scale * (jump.fixed + jump.attached), scale * jump.attached);
        (weight != Vec3::ZERO && weight.is_finite()).then_some(SecondarySample {
            vertex: chosen.index,
            edge: point.edge,
            foreground: jump.view.foreground,
            s: point.s,
            p: edge.point(point.s),
            normal: route.mirrored(jump.view.normal),
            mirror: connection.mirror,
            weight,
            attached,
            dir,
            distance: connection.whole,
        })
    }

    /// Number of scattering events that a path may have after its vertex `k`.
    fn events_left(&self, k: usize) -> u32 {
        self.max_bounces.saturating_sub(k as u32 + 1)
    }

    /// Number of events that must be left for a vertex to see directly anything that is sampled here: none if it sees lights.
    fn least_events(&self, path: &Path, k: usize) -> u32 {
        let v = &path.vertices()[k];
        let sees_environment = self.scene.environment.is_some() && self.environment != MovingEnvironment::Whole;
        let sees_light = sees_environment || !self.scene.contacts().is_empty() || v.si.bsdf.is_attached();
        u32::from(!(sees_light || self.is_behind_glass(path, k)))
    }

    /// Whether the camera sees a path's vertex `k` by way of glass. Then lights are seen with fixed directions, as all else.
    fn is_behind_glass(&self, path: &Path, k: usize) -> bool {
        self.scene.has_glass && path.is_behind_glass(k)
    }

    /// Chooses a vertex with probability in proportion to its throughput.
    fn choose_vertex(&self, path: &Path, u: f32) -> Option<ChosenVertex> {
        let weight = |k: usize| {
            let v = &path.vertices()[k];
            let useless = v.si.bsdf.is_black() || v.si.bsdf.is_delta() || k as u32 >= self.max_bounces;
            if useless || self.events_left(k) < self.least_events(path, k) {
                0.0
            } else {
                v.throughput.max_element().max(1e-3)
            }
        };
        let n = path.vertices().len();
        let total: f32 = (0..n).map(weight).sum();
        if total <= 0.0 {
            return None;
        }
        let mut x = u * total;
        let index = (0..n).find(|&k| {
            x -= weight(k);
            x < 0.0
        })?;
        Some(ChosenVertex { index, weight: weight(index), total })
    }

    /// Chooses whether vertex `k` sees the edge directly or in one of the mirrors; all curved mirrors together count as one. Also returns
    /// the number of these routes, which have equal probability.
    fn choose_route(&self, k: usize, sampler: &mut Sampler) -> (Route<'a>, usize) {
        let kinds = self.mirrors.len() + usize::from(self.curved.is_some());
        let mirrors = if self.events_left(k) >= 1 { kinds } else { 0 };
        let choice = (sampler.next_1d() * (mirrors + 1) as f32) as usize;
        let flat = choice.checked_sub(1).and_then(|i| self.mirrors.get(i)).map(Route::Flat);
        let curved = self.curved.filter(|_| choice > self.mirrors.len()).map(Route::Curved);
        (flat.or(curved).unwrap_or(Route::Direct), mirrors + 1)
    }

    /// Chooses an edge and a point on it for the last of some vertices of a path.
    fn choose_edge_point(
        &self,
        vertices: &[PathVertex],
        route: Route,
        u: Vec2,
        sampler: &mut Sampler,
    ) -> Option<EdgePoint> {
        let si = &vertices.last()?.si;
        // Rough glass sees edges on both of its sides, each with a query of its own.
        let side = (si.bsdf.has_both_sides() && !matches!(route, Route::Curved(_))).then(|| {
            let passes = sampler.next_1d() < PASSES;
            (passes, if passes { PASSES } else { 1.0 - PASSES })
        });
        let of_surface = || if side.is_some_and(|(passes, _)| passes) { Query::through(si) } else { Query::new(si) };
        let query = match route {
            Route::Direct => of_surface(),
            Route::Flat(mirror) => of_surface().reflected(mirror),
            Route::Curved(tree) => Query::around_mirror(tree.sample(f64::from(sampler.next_1d())), si.p),
        };
        // As seen from a vertex that does not move, only edges that move have a derivative.
        let moves = |prim: PrimId| self.layout.moves(self.scene.prims[prim as usize].shape);
        let still = matches!(route, Route::Direct) && !vertices.iter().any(|v| moves(v.si.prim));
        let tree = self.moving.as_ref().filter(|_| still).unwrap_or(self.tree);
        let mut point = tree.sample(self.table, &query, u.to_array(), sampler.next_1d())?;
        if let Some((passes, probability)) = side {
            let p = self.table.edges[point.edge].point(point.s);
            if (si.side(route.image(p) - si.p) < 0.0) != passes {
                return None; // the other query finds it
            }
            point.pdf *= probability;
        }
        Some(point)
    }

    /// Connects a shading point to an edge point, if the shading point reflects light from that direction.
    fn connect_by_route<'s>(
        &'s self,
        si: &'s SurfaceInteraction,
        route: Route<'s>,
        point: EdgePoint,
        sampler: &mut Sampler,
    ) -> Option<Shading<'s>> {
        let edge = &self.table.edges[point.edge];
        let p = edge.point(point.s);
        let reflected = |dir: Vec3| {
            let f = si.eval_split(dir);
            (f[0] + f[1] != Vec3::ZERO && si.sides_agree(dir)).then_some(f)
        };
        if let Route::Curved(tree) = route {
            let CurvedConnection { last, first, area } = self.connect_by_curved_mirror(tree, si, edge, p, sampler)?;
            let f = reflected(first)?;
            return Some(Shading { si, route, edge, point, connection: last, dir: first, area, f });
        }
        let q = route.image(p) - si.p;
        let (dir, distance) = (q / q.length(), q.length());
        let f = reflected(dir)?;
        let connection = self.connect(si, route, p, dir, distance)?;
        Some(Shading { si, route, edge, point, connection, dir, area: distance * distance, f })
    }

    /// The jump of reflected radiance across an edge, with `events` scattering events left after the shading point.
    fn jump(&self, at: &Shading, behind_glass: bool, events: u32, sampler: &mut Sampler) -> Option<Jump> {
        let &Shading { si, edge, point, connection, .. } = at;
        let view = edge.view(connection.dir)?;
        let alike =
            || !self.tree.shows_creases(point.edge) || edge.specular_alike(self.scene, point.s, -connection.dir);
        if view.background.is_some() && alike() {
            return None;
        }
        let mut skip: Vec<PrimId> = edge.prims();
        skip.push(connection.prim);
        let to_edge = Ray { t_max: connection.distance * (1.0 - 2e-5), ..connection.ray };
        let through = self.scene.transmittance(&to_edge, &skip);
        if through == 0.0 {
            return None;
        }
        skip.extend(self.scene.masks_passed(&to_edge, &skip));
        let sides = Sides::choose(self.scene, edge, connection.dir, &view, point.s, sampler)?;
        let events = events - u32::from(connection.mirror.is_some());
        let side = |face: Option<usize>| match face {
            Some(face) => self.radiance_on_face(at, face, events, sampler),
            None => self.radiance_past(at, at.route.mirrored(view.normal), &skip, events, sampler),
        };
        let (foreground, background) = (side(sides.near), side(sides.far));
        // Emission is differentiated with a fixed direction, and counts here, behind a mirror or glass and where surfaces touch. Elsewhere it is
        // fixed to its surface. Part of the environment is left to the edge-first estimator.
        let all = |side: &SideRadiance| side.radiance + side.emission;
        let sliding = |side: &SideRadiance| match side.first {
            _ if connection.mirror.is_some() || behind_glass => all(side),
            Some(emitter) if self.scene.contacts().contains(si.prim, emitter) => all(side),
            Some(_) => side.radiance,
            None => side.radiance * self.environment.direction_fixed_share(self.scene, connection.dir),
        };
        let [fixed, attached] = at.f;
        Some(Jump {
            view,
            covers: through * sides.scale,
            fixed: fixed * (sliding(&foreground) - sliding(&background)),
            attached: attached * (all(&foreground) - all(&background)),
        })
    }

    /// The radiance from a face of the edge at the shading point. Both sides use the same random numbers.
    fn radiance_on_face(&self, at: &Shading, face: usize, events: u32, sampler: &Sampler) -> SideRadiance {
        let &Shading { si, edge, point, connection, dir, .. } = at;
        let [_, beside] = edge.beside(self.scene, face, point.s, connection.whole, -connection.dir);
        let start = Start::BesideEdge(beside, &edge.below(face, beside.ng));
        let mut side = self.trace_side(start, None, events, sampler);
        let attenuation = self.scene.attenuation_after(si, dir, connection.distance);
        side.radiance *= attenuation;
        side.emission *= attenuation;
        side
    }

    /// The radiance past the edge: from a ray right beside it, on the side to which `normal` points.
    fn radiance_past(
        &self,
        at: &Shading,
        normal: Vec3,
        skip: &[PrimId],
        events: u32,
        sampler: &Sampler,
    ) -> SideRadiance {
        let &Shading { si, route, edge, point, connection, dir, .. } = at;
        let ray = match connection.mirror {
            Some(MirrorVertex { si: mirror_si, curved: Some(_) }) => {
                Some(mirror_si.spawn_ray((connection.dir + normal * NUDGE).normalize()))
            }
            _ => {
                let aside = (dir + normal * NUDGE).normalize();
                self.connect(si, route, edge.point(point.s), aside, connection.whole).map(|c| c.ray)
            }
        };
        let inside = if connection.mirror.is_none() { self.scene.inside_after(si, dir) } else { None };
        ray.map_or_else(SideRadiance::default, |ray| self.trace_side(Start::Ray(ray, skip), inside, events, sampler))
    }

    /// The light that a path finds, which begins within these bodies, if that is known.
    fn trace_side(&self, start: Start, inside: Option<Inside>, events: u32, sampler: &Sampler) -> SideRadiance {
        let options = Options { first_emission: false, inside, ..Options::new(events) };
        let mut side = SideRadiance::default();
        side.radiance = trace(self.scene, start, &mut sampler.clone(), &options, &mut side);
        side
    }

    /// Connects a shading point to an edge point in direction `dir`, over a flat mirror if there is one.
    fn connect(
        &self,
        si: &SurfaceInteraction,
        route: Route,
        p: Vec3,
        dir: Vec3,
        distance: f32,
    ) -> Option<EdgeConnection> {
        let ray = si.spawn_ray(dir);
        let Route::Flat(plane) = route else {
            let (prim, reflectance) = (si.prim, Vec3::ONE);
            return Some(EdgeConnection { ray, dir, distance, whole: distance, prim, reflectance, mirror: None });
        };
        let least = 1e-5 * self.scene.radius;
        let (here, there) = (plane.height(si.p), plane.height(p));
        if here * there <= 0.0 || here.abs() < least || there.abs() < least {
            return None;
        }
        let ours = |hit: &SurfaceInteraction| hit.bsdf.is_mirror() && plane.contains(hit.ng, hit.p, self.scene.radius);
        let (hit, t, through) = self.scene.first_wanted(&ray, &[si.prim], ours)?;
        if t >= distance {
            return None;
        }
        let attenuation = self.scene.attenuation_after(si, dir, t);
        let dir = plane.reflect(dir);
        Some(EdgeConnection {
            ray: hit.spawn_ray(dir),
            dir,
            distance: distance - t,
            whole: distance,
            prim: hit.prim,
            reflectance: hit.bsdf.mirror_reflectance() * through * attenuation,
            mirror: Some(MirrorVertex { si: hit, curved: None }),
        })
    }

    /// Connects a shading point to an edge point over a curved mirror, by one of all specular paths between them, chosen at random.
    fn connect_by_curved_mirror(
        &self,
        tree: &MirrorTree,
        si: &SurfaceInteraction,
        edge: &Edge,
        p: Vec3,
        sampler: &mut Sampler,
    ) -> Option<CurvedConnection> {
        let scene = self.scene;
        let mut specular_paths = Vec::new();
        let own = edge.prims();
        tree.specular_paths(scene, si.p, p, |prim, patch, place| {
            if prim != si.prim && !own.contains(&prim) {
                specular_paths.push((prim, *patch, place));
            }
        });
        let choice = (sampler.next_1d() * specular_paths.len() as f32) as usize;
        let &(prim, patch, place) = specular_paths.get(choice)?;
        let [x, y, z] = scene.corners(prim);
        let [u, t] = place;
        let b = [1.0 - u - t, u, t].map(|b| b as f32);
        let to_mirror = x * b[0] + y * b[1] + z * b[2] - si.p;
        let before = to_mirror.length();
        let first = to_mirror / before;
        let mirror_si = scene.interaction(prim, b, -first);
        let q = p - mirror_si.p;
        let distance = q.length();
        let dir = q / distance;
        let least = 1e-5 * scene.radius;
        if !mirror_si.bsdf.is_mirror() || before < least || distance < least {
            return None;
        }
        let opacity = scene.opacity(prim, b).unwrap_or(1.0);
        let through = opacity * scene.transmittance(&si.spawn_ray_to(first, before), &[si.prim, prim]);
        let through = scene.attenuation_after(si, first, before) * through;
        let reflectance = mirror_si.bsdf.mirror_reflectance() * through * specular_paths.len() as f32;
        let area = patch.area_per_solid_angle(place, f64::from(before), f64::from(distance)) as f32;
        let mirror = Some(MirrorVertex { si: mirror_si, curved: Some([before, distance]) });
        let ray = mirror_si.spawn_ray(dir);
        let last = EdgeConnection { ray, dir, distance, whole: distance, prim, reflectance, mirror };
        (reflectance != Vec3::ZERO).then_some(CurvedConnection { last, first, area })
    }

    /// Adds the derivatives of a sample in its edge and mirror; returns the adjoint of the path vertex's position.
    fn scatter(&self, out: &mut Adjoints, sample: &SecondarySample, d: Vec3) -> Injection {
        let d_image = sample.normal * d.dot(sample.weight);
        if let Some(MirrorVertex { si, curved: Some([before, after]) }) = &sample.mirror {
            out.edge_point(&self.table.edges[sample.edge], sample.foreground, sample.s, d_image);
            // The direction at the vertex is fixed, except for the attached fraction.
            let mut back = |share: Vec3| {
                let m = sample.normal * -d.dot(share);
                d_specular_ray(out, si, *before, Lobe::SPECULAR, RayAdjoint { origin: m, dir: m * *after })
            };
            let (fixed, attached) = (back(sample.weight - sample.attached), back(sample.attached));
            let d_p = fixed.origin + attached.origin;
            return Injection { vertex: sample.vertex, d_p, dir: sample.dir, d_dir: attached.dir };
        }
        let d_p = match &sample.mirror {
            Some(mirror) => d_mirror_image(out, &mirror.si, sample.p, d_image),
            None => d_image,
        };
        out.edge_point(&self.table.edges[sample.edge], sample.foreground, sample.s, d_p);
        let d_dir = sample.normal * (-sample.distance * d.dot(sample.attached));
        Injection { vertex: sample.vertex, d_p: -d_image, dir: sample.dir, d_dir }
    }
}

impl Draw for Secondary<'_> {
    type Scratch = Path;

    fn draw(&self, first: f64, mut sampler: Sampler, weight: f64, path: &mut Path, out: &mut dyn Estimate) {
        let [column, u, v] = sampler.next_3d();
        let (at, u) = ([first, f64::from(column)], Vec2::new(u, v));
        let (at, density) = self.guide.as_ref().map_or((at, 1.0), |g| g.warp(at));
        self.sample_at(at, u, weight / density, &mut sampler, path, out);
    }
}

impl Estimator for Secondary<'_> {
    fn count(&self) -> usize {
        self.count
    }

    fn cost(&self) -> f64 {
        // The paths on both sides of the edge.
        3.0 + 1.5 * EDGE_POINTS as f64 * (self.tree.cost() + 6.0 * typical_bounces(self.max_bounces))
    }

    fn pass(&self, count: usize, share: f64, seed: u64) -> impl Pass + '_ {
        Sequence { of: self, count, weight: share / count as f64, seed: hash(seed, 0x0073_6563_6f6e_6461) }
    }
}

/// A vertex chosen for a boundary sample, with its weight and that of all vertices.
struct ChosenVertex {
    index: usize,
    weight: f32,
    total: f32,
}

/// The route by which a shading point is connected to an edge.
#[derive(Clone, Copy)]
enum Route<'a> {
    Direct,
    /// Over a flat mirror.
    Flat(&'a MirrorPlane),
    /// Over a curved mirror.
    Curved(&'a MirrorTree),
}

impl Route<'_> {
    /// The image of a point in a flat mirror.
    fn image(self, p: Vec3) -> Vec3 {
        if let Route::Flat(mirror) = self { mirror.reflect_point(p) } else { p }
    }

    /// The image of a direction in a flat mirror.
    fn mirrored(self, v: Vec3) -> Vec3 {
        if let Route::Flat(mirror) = self { mirror.reflect(v) } else { v }
    }
}

/// A shading point and the edge point that it is connected to.
struct Shading<'a> {
    si: &'a SurfaceInteraction,
    route: Route<'a>,
    edge: &'a Edge,
    point: EdgePoint,
    connection: EdgeConnection,
    /// Direction of the connection at the shading point.
    dir: Vec3,
    /// Area at the edge, perpendicular to the connection, per solid angle at the shading point.
    area: f32,
    /// f·cos in this direction: of the part of the BSDF with fixed directions, and of an attached lobe.
    f: [Vec3; 2],
}

/// The difference of the reflected radiances from both sides of an edge.
struct Jump {
    view: EdgeView,
    /// Transmittance of masks.
    covers: f32,
    /// The differences by the part of the BSDF with fixed directions, and by an attached lobe.
    fixed: Vec3,
    attached: Vec3,
}

/// The last segment of the connection from a path vertex to an edge point.
#[derive(Clone, Copy)]
struct EdgeConnection {
    ray: Ray,
    dir: Vec3,
    distance: f32,
    /// Distance of the edge: from the shading point, along the path over a flat mirror; for a curved mirror, from the mirror.
    whole: f32,
    /// The primitive on which it starts.
    prim: PrimId,
    reflectance: Vec3,
    mirror: Option<MirrorVertex>,
}

/// The connection from a path vertex to an edge point over a curved mirror.
struct CurvedConnection {
    last: EdgeConnection,
    /// Direction of its first segment.
    first: Vec3,
    /// Area at the edge, perpendicular to the connection, per solid angle at its start.
    area: f32,
}

/// Whether any surface has a narrow lobe.
fn has_attached_lobes(scene: &Scene) -> bool {
    scene.description.shapes.iter().any(|s| s.material.may_be_attached())
}
