//! Boundary term at path vertices: what a shading point sees behind an edge, reflected radiance on both sides and the
//! environment.
//!
//! Receiver-first, one vertex a camera path: choose a vertex x, an edge point p for it, and add
//! sinφ/|q|² f cosθ (L_fg − L_bg) N̂·(ṗ − ẋ) (Li et al. 2018, §5, with direction-fixed radiance on both sides). The part
//! that moves x goes back along the very path. Emission of area lights is material-fixed and not seen
//! here: its boundary is [`crate::grad::terms::shadow`]'s. A narrow lobe is attached: there emission counts too, and the lobe's direction
//! moves, N̂·(ṗ − ẋ − |q|ω̇). What the point sees in a planar mirror, its mirror image sees directly: the same
//! estimator from there, with emission on both sides. In a curved mirror the edge point is connected to x by all specular paths there
//! are ([`crate::grad::mirrors::curved`]), with N̂·(ṗ − ṙ), ṙ the velocity of the mirrored ray, and the area that it spreads over in place of |q|².

use glam::{Vec2, Vec3};

use crate::grad::environment::MovingEnvironment;
use crate::grad::estimate::{Draw, Estimate, Pass, Sequence};
use crate::grad::layers::Sides;
use crate::grad::local::RayAdjoint;
use crate::grad::mirrors::curved::MirrorTree;
use crate::grad::mirrors::viewpoint::{MirrorPlane, d_mirror_image, d_reflected_ray};
use crate::grad::sampling::allocate::{Estimator, typical_bounces};
use crate::grad::sampling::edge_tree::{EdgeTree, Query};
use crate::grad::sampling::guide::{Guide, GuideKey, GuideTraining};
use crate::grad::sampling::pixels::{self, FilmDensity};
use crate::grad::sink::{Adjoints, Layout, Sink};
use crate::grad::terms::interior::{Injection, Path, PathVertex, area_sampling_fraction, inject};
use crate::render::accel::{PrimId, Ray};
use crate::render::edges::{Edge, EdgeTable};
use crate::render::integrator::{Options, Recorder, Start, trace};
use crate::render::interaction::SurfaceInteraction;
use crate::render::mask::MaskWeight;
use crate::render::sampler::{ONE_MINUS_EPSILON, Sampler, hash};
use crate::render::{Camera, Scene, Settings};

/// Angle between an edge and the ray that looks past it.
const NUDGE: f32 = 2e-5;

/// Cells of the guide over the film, at most.
const MOST_CELLS: usize = 64 * 64;

/// Edge points sampled for each path. What moves past a surface appears on one side and vanishes on the other: sampled from one vertex,
/// these two cancel in part, and the path is shared.
const EDGE_POINTS: usize = 4;

/// Receiver-first samples.
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
    /// [`Options::area_sampling_fraction`], as of interior paths.
    area_sampling_fraction: f32,
    /// Only the edges that move, for path vertices that do not.
    moving: Option<EdgeTree>,
    max_bounces: u32,
    count: usize,
    film: FilmDensity,
    /// Over the film.
    guide: Option<Guide>,
}

/// A boundary sample of a path: with pixel adjoint d the contribution is (d·weight) N̂·(ṗ − ẋ).
#[derive(Clone, Copy, Debug)]
pub struct SecondarySample {
    /// Index of the path vertex x.
    pub vertex: usize,
    pub edge: usize,
    pub foreground: usize,
    pub s: f32,
    /// The edge point.
    pub p: Vec3,
    /// From covering to uncovered side, of the edge as x sees it (in the mirror, if there is one).
    pub normal: Vec3,
    pub mirror: Option<MirrorVertex>,
    pub weight: Vec3,
    /// The share of the weight whose direction is attached, and that direction with the distance of the edge along it.
    pub attached: Vec3,
    pub dir: Vec3,
    pub distance: f32,
}

/// The vertex on a mirror between a path vertex and an edge.
#[derive(Clone, Copy, Debug)]
pub struct MirrorVertex {
    pub si: SurfaceInteraction,
    /// Of a curved one: its distance from the path vertex, and that of the edge from it.
    pub curved: Option<[f32; 2]>,
}

/// The radiance on one side of an edge: the first surface's own emission apart from everything else.
#[derive(Default)]
struct SideRadiance {
    first: Option<PrimId>,
    emission: Vec3,
    radiance: Vec3,
}

impl Recorder for SideRadiance {
    fn vertex(&mut self, si: &SurfaceInteraction, _throughput: Vec3, _t: f32, _through: &MaskWeight) {
        if self.first.is_none() {
            self.first = Some(si.prim);
            self.emission = si.emission;
        }
    }
}

impl<'a> Secondary<'a> {
    /// `None` if no path vertex can see anything but lights.
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
        let direct = sees_environment || !scene.contacts().is_empty() || has_attached_lobes(scene);
        let reach = if direct { 1 } else { 2 };
        let table = scene.edges();
        let film = FilmDensity::new(adjoint);
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

    /// Learns from pilots where on film edges matter.
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

    /// One sample: `at` chooses the place on film, `u` the edges and the points on them; `weight` is one over their density.
    fn sample_at(
        &self,
        at: [f64; 2],
        u: Vec2,
        weight: f64,
        sampler: &mut Sampler,
        path: &mut Path,
        out: &mut impl Estimate,
    ) {
        let film = self.film.place(at);
        if out.skips(film.pixel) {
            return;
        }
        let camera = self.camera.sample_lens(sampler);
        let ray = camera.ray(film.position);
        // The last vertex that can see an edge is one event before the last.
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
            out.pixel(film.pixel, |d, out| {
                let injection = self.scatter(out, &sample, d * weight);
                let ray = inject(out, path, &injection);
                camera.d_ray(film.position, ray.origin, ray.dir, &mut out.camera);
            });
        }
    }

    /// One sample for a recorded path. `u` chooses the edge and the point on it.
    fn sample(&self, path: &Path, u: Vec2, sampler: &mut Sampler) -> Option<SecondarySample> {
        let u_choice = sampler.next_1d();
        // Choose a vertex with probability proportional to what it passes on.
        let events_left = |k: usize| self.max_bounces.saturating_sub(k as u32 + 1);
        let contacts = self.scene.contacts();
        let least_direct = |v: &PathVertex| {
            let sees_environment = self.scene.environment.is_some() && self.environment != MovingEnvironment::Whole;
            let sees_light = sees_environment || !contacts.is_empty() || v.si.bsdf.is_attached();
            u32::from(!sees_light)
        };
        let weight = |k: usize| {
            let v = &path.vertices[k];
            let useless = v.si.bsdf.is_black() || v.si.bsdf.is_delta() || k as u32 >= self.max_bounces;
            if useless || events_left(k) < least_direct(v) { 0.0 } else { v.throughput.max_element().max(1e-3) }
        };
        let n = path.vertices.len();
        let total: f32 = (0..n).map(weight).sum();
        if total <= 0.0 {
            return None;
        }
        let mut x = u_choice * total;
        let k = (0..n).find(|&k| {
            x -= weight(k);
            x < 0.0
        })?;
        let vertex = &path.vertices[k];
        let si = &vertex.si;

        // Look directly, or into one of the mirrors: the curved ones together count as one.
        let kinds = self.mirrors.len() + usize::from(self.curved.is_some());
        let mirrors = if events_left(k) >= 1 { kinds } else { 0 };
        let choice = (sampler.next_1d() * (mirrors + 1) as f32) as usize;
        let mirror = choice.checked_sub(1).and_then(|i| self.mirrors.get(i));
        let curved = self.curved.filter(|_| choice > self.mirrors.len());
        if mirror.is_none() && curved.is_none() && events_left(k) < least_direct(vertex) {
            return None;
        }
        let query = match (mirror, curved) {
            (Some(m), _) => Query::new(si).reflected(m),
            (_, Some(tree)) => Query::around_mirror(tree.sample(f64::from(sampler.next_1d())), si.p),
            _ => Query::new(si),
        };
        // Seen by what stands still, only edges that move have a derivative.
        let moves = |prim: PrimId| self.layout.moves(self.scene.prims[prim as usize].shape);
        let still = mirror.is_none() && curved.is_none() && !path.vertices[..=k].iter().any(|v| moves(v.si.prim));
        let tree = self.moving.as_ref().filter(|_| still).unwrap_or(self.tree);
        let point = tree.sample(self.table, &query, u.to_array(), sampler.next_1d())?;
        let edge = &self.table.edges[point.edge];
        let p = edge.point(point.s);
        let by_mirror = match curved {
            Some(tree) => Some(self.connect_by_curved_mirror(tree, si, edge, p, sampler)?),
            None => None,
        };
        let q = mirror.map_or(p, |m| m.reflect_point(p)) - si.p;
        let (dir, distance) =
            by_mirror.as_ref().map_or((q / q.length(), q.length()), |by| (by.first, by.connection.distance));
        let [fixed, attached] = si.eval_split(dir);
        if fixed + attached == Vec3::ZERO || si.ng.dot(dir) <= 0.0 {
            return None;
        }
        let (connection, area) = match by_mirror {
            Some(by) => (by.connection, by.area),
            None => (self.connect(si, mirror, p, dir, distance)?, distance * distance),
        };
        let view = edge.view(connection.dir)?;
        let alike = || !self.tree.shows_creases(point.edge) || edge.mirrors_alike(self.scene, point.s, -connection.dir);
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

        let options =
            Options { first_emission: false, ..Options::new(events_left(k) - u32::from(connection.mirror.is_some())) };
        let radiance = |start: Start| {
            let mut side = SideRadiance::default();
            side.radiance = trace(self.scene, start, &mut sampler.clone(), &options, &mut side);
            side
        };
        let normal = mirror.map_or(view.normal, |m| m.reflect(view.normal));
        let side = |face: Option<usize>| match face {
            Some(i) => {
                let [_, beside] = edge.beside(self.scene, i, point.s, distance, -connection.dir);
                radiance(Start::BesideEdge(beside, &edge.below(i, beside.ng)))
            }
            None => {
                let past = match connection.mirror {
                    Some(MirrorVertex { si: mirror_si, curved: Some(_) }) => Some(EdgeConnection {
                        ray: mirror_si.spawn_ray((connection.dir + normal * NUDGE).normalize()),
                        ..connection
                    }),
                    _ => self.connect(si, mirror, p, (dir + normal * NUDGE).normalize(), distance),
                };
                past.map_or_else(SideRadiance::default, |past| radiance(Start::Ray(past.ray, &skip)))
            }
        };
        let (foreground, background) = (side(sides.near), side(sides.far));
        // Emission is direction-fixed behind a mirror and where the surfaces touch, else material-fixed. Of the environment
        // some is left to the edge-first estimator.
        let sliding = |side: &SideRadiance| match side.first {
            _ if connection.mirror.is_some() => side.radiance + side.emission,
            Some(emitter) if contacts.contains(si.prim, emitter) => side.radiance + side.emission,
            Some(_) => side.radiance,
            None => side.radiance * self.environment.direction_fixed_share(self.scene, connection.dir),
        };
        let all = |side: &SideRadiance| side.radiance + side.emission;
        let fixed = fixed * (sliding(&foreground) - sliding(&background));
        let attached = attached * (all(&foreground) - all(&background));
        let sin_phi = edge.direction().cross(connection.dir).length();
        let pdf = point.pdf * weight(k) / (total * (mirrors + 1) as f32);
        let scale = vertex.throughput * connection.reflectance * (through * sides.scale * sin_phi / (area * pdf));
        let (weight, attached) = (scale * (fixed + attached), scale * attached);
        (weight != Vec3::ZERO && weight.is_finite()).then_some(SecondarySample {
            vertex: k,
            edge: point.edge,
            foreground: view.foreground,
            s: point.s,
            p,
            normal,
            mirror: connection.mirror,
            weight,
            attached,
            dir,
            distance,
        })
    }

    /// Connects a shading point to an edge point in direction `dir`, by way of a flat mirror if there is one.
    fn connect(
        &self,
        si: &SurfaceInteraction,
        mirror: Option<&MirrorPlane>,
        p: Vec3,
        dir: Vec3,
        distance: f32,
    ) -> Option<EdgeConnection> {
        let ray = si.spawn_ray(dir);
        let Some(plane) = mirror else {
            return Some(EdgeConnection { ray, dir, distance, prim: si.prim, reflectance: Vec3::ONE, mirror: None });
        };
        let least = 1e-5 * self.scene.radius;
        let (here, there) = (plane.height(si.p), plane.height(p));
        if here * there <= 0.0 || here.abs() < least || there.abs() < least {
            return None;
        }
        let ours = |hit: &SurfaceInteraction| hit.bsdf.is_delta() && plane.contains(hit.ng, hit.p, self.scene.radius);
        let (hit, t, through) = self.scene.first_wanted(&ray, &[si.prim], ours)?;
        if t >= distance {
            return None;
        }
        let dir = plane.reflect(dir);
        Some(EdgeConnection {
            ray: hit.spawn_ray(dir),
            dir,
            distance: distance - t,
            prim: hit.prim,
            reflectance: hit.bsdf.mirror_reflectance() * through,
            mirror: Some(MirrorVertex { si: hit, curved: None }),
        })
    }

    /// Connects a shading point to an edge point by way of a curved mirror: by one of all specular paths between them, chosen at random.
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
        if !mirror_si.bsdf.is_delta() || before < least || distance < least {
            return None;
        }
        let opacity = scene.opacity(prim, b).unwrap_or(1.0);
        let through = opacity * scene.transmittance(&si.spawn_ray_to(first, before), &[si.prim, prim]);
        let reflectance = mirror_si.bsdf.mirror_reflectance() * (through * specular_paths.len() as f32);
        let area = patch.area_per_solid_angle(place, f64::from(before), f64::from(distance)) as f32;
        let mirror = Some(MirrorVertex { si: mirror_si, curved: Some([before, distance]) });
        let connection = EdgeConnection { ray: mirror_si.spawn_ray(dir), dir, distance, prim, reflectance, mirror };
        (reflectance != Vec3::ZERO).then_some(CurvedConnection { connection, first, area })
    }

    /// Adds the derivatives of a sample's edge and mirror; returns the adjoint of the path vertex's position.
    fn scatter<S: Sink>(&self, out: &mut Adjoints<S>, sample: &SecondarySample, d: Vec3) -> Injection {
        let d_image = sample.normal * d.dot(sample.weight);
        if let Some(MirrorVertex { si, curved: Some([before, after]) }) = &sample.mirror {
            out.edge_point(&self.table.edges[sample.edge], sample.foreground, sample.s, d_image);
            // The direction at the vertex is fixed, but for the attached share.
            let mut back = |share: Vec3| {
                let m = sample.normal * -d.dot(share);
                d_reflected_ray(out, si, *before, RayAdjoint { origin: m, dir: m * *after })
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

    fn draw(&self, first: f64, mut sampler: Sampler, weight: f64, path: &mut Path, out: &mut impl Estimate) {
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
        // Two paths look past the edge.
        3.0 + 1.5 * EDGE_POINTS as f64 * (self.tree.cost() + 6.0 * typical_bounces(self.max_bounces))
    }

    fn pass(&self, count: usize, share: f64, seed: u64) -> impl Pass + '_ {
        Sequence { of: self, count, weight: share / count as f64, seed: hash(seed, 0x0073_6563_6f6e_6461) }
    }
}

/// The last segment of the connection from a path vertex to an edge point.
#[derive(Clone, Copy)]
struct EdgeConnection {
    ray: Ray,
    dir: Vec3,
    distance: f32,
    /// Where it starts.
    prim: PrimId,
    reflectance: Vec3,
    mirror: Option<MirrorVertex>,
}

/// The connection from a path vertex to an edge point by way of a curved mirror.
struct CurvedConnection {
    connection: EdgeConnection,
    /// Direction of its first segment.
    first: Vec3,
    /// At the edge, perpendicular to it, over the solid angle at its start.
    area: f32,
}

/// Whether any surface has a narrow lobe.
fn has_attached_lobes(scene: &Scene) -> bool {
    scene.description.shapes.iter().any(|s| s.material.kind.may_be_attached())
}
