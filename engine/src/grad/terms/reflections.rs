//! Boundary term of edges that the camera sees in curved mirrors: reflected silhouettes and creases.
//!
//! dI = ∫ δ(h) (L_fg − L_bg) N̂·(ṗ − ṙ) du over the film, where ṗ is the velocity of the edge point, ṙ that of the mirrored ray at a
//! fixed film position u, N̂ the normal from the covering to the uncovered side and h = N̂·(p − r). The image of an edge in a triangle of
//! a mirror is the curve h = 0 over the triangle ([`crate::grad::mirrors::curved`]). It is found along random straight lines of two
//! families, one for each coordinate of the triangle. A line of a family intersects the curve with density |∂h| along it, so each
//! intersection is weighted by the inverse of the mean of both densities (balance heuristic). This needs no inverse of a derivative that
//! vanishes where the mirror focuses, finds all images, and is unbiased.

use std::sync::atomic::Ordering;

use glam::{Vec2, Vec3};
use rayon::prelude::*;

use crate::grad::estimate::{Draw, Estimate, Pass, Sequence};
use crate::grad::layers::Sides;
use crate::grad::local::{RayAdjoint, d_specular_ray};
use crate::grad::mirrors::curved::{Barycentric, Eye, MirrorPatch, MirrorTree, MirrorTriangle, SegmentImage, quarters};
use crate::grad::mirrors::viewpoint::CameraConnection;
use crate::grad::sampling::allocate::{Estimator, typical_bounces};
use crate::grad::sampling::contrast::{contrasts, pilots};
use crate::grad::sampling::pixels::magnitude_at;
use crate::grad::terms::primary::pieces::MAX_PIECE_LENGTH;
use crate::image::Image;
use crate::render::accel::{PrimId, Ray};
use crate::render::bsdf::Lobe;
use crate::render::edges::{Edge, EdgeView, SMOOTH_CREASE};
use crate::render::integrator::{NoRecord, Options, Start, trace};
use crate::render::interaction::SurfaceInteraction;
use crate::render::sampler::{Discrete, Sampler, hash};
use crate::render::sensor::Projected;
use crate::render::{Camera, Scene, Settings};
use crate::stop;

/// Angle between an edge and the ray past it, in radians.
const NUDGE: f32 = 2e-5;
/// Largest depth to which triangles are subdivided into four.
const DEPTH: u32 = 7;

/// The estimator of edges in curved mirrors.
pub struct Reflections<'a> {
    scene: &'a Scene,
    camera: &'a Camera,
    settings: &'a Settings,
    tree: &'a MirrorTree,
    pieces: Vec<Piece>,
    pmf: Discrete,
    count: usize,
}

/// A part of a mirror's triangle that may show an edge.
#[derive(Clone, Copy)]
struct Piece {
    edge: u32,
    triangle: u32,
    corners: [Barycentric; 3],
    /// Film positions of the corners, if the camera sees them all.
    film: Option<[Vec2; 3]>,
    /// Size on film in pixels, times the fraction that is probably visible.
    weight: f32,
}

/// An edge point seen in a mirror.
struct Boundary<'a> {
    edge: &'a Edge,
    s: f32,
    view: EdgeView,
    mirror: SurfaceInteraction,
    /// Distance of the mirror from the camera, and of the edge from the mirror.
    before: f32,
    after: f32,
    film: Vec2,
    /// The jump of radiance times pixels of film over the density of lines there.
    jump: Vec3,
}

impl<'a> Reflections<'a> {
    /// `None` if no curved mirror can show an edge.
    pub fn new(
        scene: &'a Scene,
        camera: &'a Camera,
        tree: &'a MirrorTree,
        settings: &'a Settings,
        adjoint: &Image,
        seed: u64,
    ) -> Option<Reflections<'a>> {
        let mut reflections =
            Reflections { scene, camera, settings, tree, pieces: Vec::new(), pmf: Discrete::default(), count: 0 };
        reflections.pieces = reflections.collect(seed);
        reflections.plan(adjoint, seed);
        (!reflections.pmf.is_empty()).then_some(reflections)
    }

    fn collect(&self, seed: u64) -> Vec<Piece> {
        // After an interruption the helping threads skip the rest, and this thread unwinds then.
        let stop = stop::flag();
        let stopped = || stop.load(Ordering::Relaxed);
        let visibility = |i: usize| if stopped() { 0.0 } else { self.visibility(i, seed) };
        let visible: Vec<f32> = (0..self.tree.triangles().len()).into_par_iter().map(visibility).collect();
        stop::check();
        let edges = &self.scene.edges().edges;
        let of_edge = |e: usize| {
            let mut pieces = Vec::new();
            if stopped() {
                return pieces;
            }
            self.tree.triangles_showing(&edges[e], |triangle| {
                let weight = visible[triangle] * self.class(&edges[e], &self.tree.triangles()[triangle].patch);
                let whole = Piece {
                    edge: e as u32,
                    triangle: triangle as u32,
                    corners: [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]],
                    film: None,
                    weight,
                };
                if let Some(whole) = self.on_film(whole) {
                    self.cut(whole, DEPTH, &mut pieces);
                }
            });
            pieces
        };
        let parts: Vec<Vec<Piece>> = (0..edges.len()).into_par_iter().map(of_edge).collect();
        stop::check();
        let diagonal = (self.camera.width as f32).hypot(self.camera.height as f32);
        let size = |piece: &Piece| match piece.film {
            Some([a, b, c]) => a.distance(b).max(b.distance(c)).max(c.distance(a)).min(diagonal),
            None => diagonal,
        };
        // Never zero, because a part that is small on film may show much.
        let weigh = |piece: Piece| Piece { weight: piece.weight * (size(&piece) + 1e-3), ..piece };
        parts.into_iter().flatten().map(weigh).collect()
    }

    /// An estimate of the fraction of a mirror's triangle that the camera sees; never zero.
    fn visibility(&self, triangle: usize, seed: u64) -> f32 {
        const POINTS: u32 = 4;
        let prim = self.tree.triangles()[triangle].prim;
        let sees = |i: u32| {
            let mut sampler = Sampler::new(hash(seed, u64::from(prim)), u64::from(i));
            let u = sampler.next_2d();
            let root = u.x.sqrt();
            let camera = self.camera.sample_lens(&mut sampler);
            connect_to_mirror(self.scene, &camera, prim, [1.0 - root, root * (1.0 - u.y), root * u.y]).is_some()
        };
        0.05 + (0..POINTS).filter(|&i| sees(i)).count() as f32 / POINTS as f32
    }

    /// Sampling weight by kind of edge, as [`crate::grad::terms::primary::pieces::EdgeClass::weight`].
    fn class(&self, edge: &Edge, patch: &MirrorPatch) -> f32 {
        let from = (patch.x[0] + patch.x[1] + patch.x[2]).as_vec3() / 3.0;
        let view = edge.view((edge.point(0.5) - from).normalize_or_zero());
        let jumps = edge.sharp || view.is_none_or(|v| v.background.is_none());
        if jumps { 1.0 } else { SMOOTH_CREASE }
    }

    /// A piece with its film positions; `None` if it is off film.
    fn on_film(&self, piece: Piece) -> Option<Piece> {
        let patch = &self.tree.triangles()[piece.triangle as usize].patch;
        let part = patch.part(piece.corners);
        let [a, b, c] = part.x.map(|x| self.camera.project(x.as_vec3()).map(|q| q.pixel));
        let film = a.zip(b).zip(c).map(|((a, b), c)| [a, b, c]);
        if let Some([a, b, c]) = film.filter(|_| self.camera.is_pinhole() && self.camera.is_rectilinear()) {
            let (low, high) = (a.min(b).min(c), a.max(b).max(c));
            let [first, last] = self.camera.seen_film();
            if high.cmplt(first - 1.0).any() || low.cmpgt(last + 1.0).any() {
                return None;
            }
        }
        Some(Piece { film, ..piece })
    }

    /// Subdivides a piece until it is small and most of its parts show the edge.
    fn cut(&self, piece: Piece, depth: u32, out: &mut Vec<Piece>) {
        let size = piece.film.map_or(f32::INFINITY, |[a, b, c]| a.distance(b).max(b.distance(c)).max(c.distance(a)));
        if depth == 0 || size < 1.0 {
            return out.push(piece);
        }
        let ends = self.scene.edges().edges[piece.edge as usize].p.map(Vec3::as_dvec3);
        let patch = &self.tree.triangles()[piece.triangle as usize].patch;
        let parts: Vec<Piece> = quarters(piece.corners)
            .into_iter()
            .filter(|corners| patch.part(*corners).may_see(ends, self.tree.slack()))
            .filter_map(|corners| self.on_film(Piece { corners, ..piece }))
            .collect();
        if parts.len() > 2 && f64::from(size) <= MAX_PIECE_LENGTH {
            return out.push(piece);
        }
        for part in parts {
            self.cut(part, depth - 1, out);
        }
    }

    /// Weights pieces by size on film, adjoint image, and the jumps that pilot samples find, as in [`crate::grad::terms::primary`].
    fn plan(&mut self, adjoint: &Image, seed: u64) {
        let spp = f64::from(self.settings.spp.max(1));
        let pieces = self.pieces.len();
        let total: f64 = self.pieces.iter().map(|p| f64::from(p.weight)).sum();
        let groups = ((total * spp / 4.0).max(4096.0) as usize).min(pieces);
        let range = |g: usize| g * pieces / groups..(g + 1) * pieces / groups;
        let factors = contrasts(groups, self.settings.spp, hash(seed, 0x7069_6c6f_7473), |g, sampler| {
            let (u, range) = (sampler.next_2d(), range(g));
            let piece = &self.pieces[range.start + (u.x * range.len() as f32) as usize];
            let mut sum = 0.0;
            self.visit(piece, f64::from(u.y), sampler, |b| {
                sum += f64::from((b.jump / piece.weight).length_squared());
            });
            sum
        });
        let mean =
            adjoint.data.iter().map(|v| f64::from(v.abs())).sum::<f64>() / (adjoint.width * adjoint.height) as f64;
        let mut weights = Vec::with_capacity(pieces);
        let mut seen = 0.0;
        for (g, factor) in factors.into_iter().enumerate() {
            for piece in &self.pieces[range(g)] {
                let importance = piece.adjoint(self.camera, adjoint).unwrap_or(mean) + 0.1 * mean;
                weights.push(f64::from(piece.weight) * importance * factor.weight);
                seen += f64::from(piece.weight) * if factor.seen { 1.0 } else { 0.1 };
            }
        }
        let least = adjoint.width as f64 * adjoint.height as f64 * spp / 16.0;
        self.pmf = Discrete::new(weights);
        // At least as many samples as there were pilots.
        let least = least.max(groups as f64 * f64::from(pilots(self.settings.spp)));
        self.count = (seen * spp).max(least).clamp(1024.0, 1e7) as usize;
    }

    /// All images of a piece's edge on a line of the piece.
    fn visit(&self, piece: &Piece, at: f64, sampler: &mut Sampler, mut each: impl FnMut(Boundary<'a>)) {
        let camera = self.camera.sample_lens(sampler);
        let edge = &self.scene.edges().edges[piece.edge as usize];
        let MirrorTriangle { prim, folded, patch, .. } = &self.tree.triangles()[piece.triangle as usize];
        let patch =
            if camera.is_pinhole() { *patch } else { MirrorPatch::new(self.scene, *prim, Eye::of(&camera), *folded) };
        let part = patch.part(piece.corners);
        let c = (2.0 * at).fract();
        let line = if at < 0.5 { [[c, 0.0], [c, 1.0 - c]] } else { [[0.0, c], [1.0 - c, c]] };
        part.images_on_line(line, edge.p.map(Vec3::as_dvec3), |image| {
            let boundary = self.evaluate(&camera, *prim, piece, &part, edge, image, &mut sampler.clone());
            boundary.into_iter().for_each(&mut each);
        });
    }

    #[allow(clippy::too_many_arguments)]
    fn evaluate(
        &self,
        camera: &Camera,
        prim: PrimId,
        piece: &Piece,
        part: &MirrorPatch,
        edge: &'a Edge,
        image: SegmentImage,
        sampler: &mut Sampler,
    ) -> Option<Boundary<'a>> {
        let scene = self.scene;
        let SegmentImage { place: [u, t], s } = image;
        let s = s as f32;
        let b = [0, 1].map(|k| {
            let [a, b, c] = piece.corners.map(|corner| corner[k]);
            (a * (1.0 - u - t) + b * u + c * t) as f32
        });
        let b = [1.0 - b[0] - b[1], b[0], b[1]];
        let MirrorConnection { mirror, projected, before, through } = connect_to_mirror(scene, camera, prim, b)?;
        let film = projected.pixel;
        // The direction to the edge, which is the mirrored direction up to rounding.
        let q = edge.point(s) - mirror.p;
        let after = q.length();
        let dir = q / after;
        let reflectance = mirror.bsdf.mirror_reflectance();
        if after.is_nan() || after <= 1e-5 * scene.radius || reflectance == Vec3::ZERO {
            return None;
        }
        let view = edge.view(dir)?;
        let mut skip: Vec<PrimId> = edge.prims().into_iter().chain([prim]).collect();
        let ray = Ray { t_min: 1e-5 * scene.radius, t_max: after * (1.0 - 2e-5), ..Ray::new(mirror.p, dir) };
        let through = through * scene.transmittance(&ray, &skip);
        if through == 0.0 {
            return None;
        }
        skip.extend(scene.masks_passed(&ray, &skip));
        let d_miss = part.d_miss([u, t], f64::from(after), view.normal.as_dvec3());
        let density = 0.5 * (d_miss[0].abs() + d_miss[1].abs()) as f32;
        let [x, y, z] = part.x;
        let area = (y - x).cross(z - x).length() as f32;
        let pixels = camera.pixels_per_area(&projected, mirror.ng) * area;

        // Both sides use the same random numbers.
        let sides = Sides::choose(scene, edge, dir, &view, s, sampler)?;
        let options = Options::new(self.settings.max_bounces - 1);
        let side = |face: Option<usize>| {
            let mut sampler = sampler.clone();
            let below;
            let mut way = Vec3::ONE;
            let start = match face {
                Some(face) => {
                    way = scene.attenuation_from(mirror.p, after);
                    let [_, beside] = edge.beside(scene, face, s, after, -dir);
                    below = edge.below(face, beside.ng);
                    Start::BesideEdge(beside, &below)
                }
                None => {
                    let past = mirror.spawn_ray((dir + view.normal * NUDGE).normalize());
                    Start::Ray(past, &skip)
                }
            };
            way * trace(scene, start, &mut sampler, &options, &mut NoRecord)
        };
        let reflectance = reflectance * scene.attenuation_from(mirror.p, before);
        let jump = (side(sides.near) - side(sides.far)) * reflectance * (sides.scale * through * pixels / density);
        (jump != Vec3::ZERO && jump.is_finite()).then_some(Boundary {
            edge,
            s,
            view,
            mirror,
            before,
            after,
            film,
            jump,
        })
    }
}

/// The connection from the camera to a point of a mirror.
struct MirrorConnection {
    mirror: SurfaceInteraction,
    projected: Projected,
    before: f32,
    /// Transmittance of masks in front of the mirror, times the opacity of its own mask.
    through: f32,
}

/// Connects the camera to a point of a primitive, if the primitive is a mirror and the point is visible.
fn connect_to_mirror(scene: &Scene, camera: &Camera, prim: PrimId, b: [f32; 3]) -> Option<MirrorConnection> {
    let [x, y, z] = scene.corners(prim);
    let p = x * b[0] + y * b[1] + z * b[2];
    let projected = camera.project(p)?;
    let (back, before) = camera.direction_from(p);
    if !camera.on_film(projected.pixel) || before <= 0.0 {
        return None;
    }
    let mirror = scene.interaction(prim, b, back);
    let ray = Ray { t_max: before * (1.0 - 2e-5), ..Ray::new(p + back * before, -back) };
    let through = scene.transmittance(&ray, &[prim]) * scene.opacity(prim, b).unwrap_or(1.0);
    (through > 0.0 && mirror.bsdf.is_mirror()).then_some(MirrorConnection { mirror, projected, before, through })
}

/// Connects the camera to a point of a primitive by all specular paths over curved mirrors. Returns each with the pixels per area
/// perpendicular to its last segment.
pub fn connect_by_curved_mirrors(
    scene: &Scene,
    camera: &Camera,
    tree: &MirrorTree,
    own: PrimId,
    p: Vec3,
) -> Vec<(CameraConnection, f32)> {
    let mut connections = Vec::new();
    tree.images_of_point(scene, camera, own, p, |prim, patch, [u, t]| {
        let b = [1.0 - u - t, u, t].map(|b| b as f32);
        let Some(MirrorConnection { mirror, projected, before, through }) = connect_to_mirror(scene, camera, prim, b)
        else {
            return;
        };
        let q = p - mirror.p;
        let distance = q.length();
        let dir = q / distance;
        if distance.is_nan() || distance <= 1e-5 * scene.radius {
            return;
        }
        let ray = Ray { t_min: 1e-5 * scene.radius, t_max: distance * (1.0 - 2e-5), ..Ray::new(mirror.p, dir) };
        let reflectance = mirror.bsdf.mirror_reflectance() * scene.attenuation_from(mirror.p, before);
        let throughput = reflectance * (through * scene.transmittance(&ray, &[own, prim]));
        let pixels = camera.pixels_per_area(&projected, mirror.ng)
            / patch.area_magnification([u, t], f64::from(distance)) as f32;
        if throughput != Vec3::ZERO && pixels.is_finite() {
            let (origin, mirror) = (mirror.p, Some((mirror, before)));
            connections.push((CameraConnection { projected, mirror, origin, dir, distance, throughput }, pixels));
        }
    });
    connections
}

impl Piece {
    /// Mean magnitude of an image over the piece's bounding box.
    fn adjoint(&self, camera: &Camera, image: &Image) -> Option<f64> {
        let [a, b, c] = self.film?;
        let size = Vec2::new(image.width as f32, image.height as f32);
        let on_film = |p: Vec2| p.max(Vec2::ZERO).min(size - 1.0).as_uvec2();
        let [a, b, c] = [a, b, c].map(|p| p - camera.corner());
        let (low, high) = (on_film(a.min(b).min(c)), on_film(a.max(b).max(c)));
        let (mut sum, mut count) = (0.0, 0);
        for y in (low.y..=high.y).step_by(1 + (high.y - low.y) as usize / 8) {
            for x in (low.x..=high.x).step_by(1 + (high.x - low.x) as usize / 8) {
                sum += magnitude_at(camera, image, camera.corner() + Vec2::new(x as f32, y as f32) + 0.5);
                count += 1;
            }
        }
        Some(sum / f64::from(count))
    }
}

impl Draw for Reflections<'_> {
    type Scratch = ();

    fn draw(&self, first: f64, mut sampler: Sampler, weight: f64, _: &mut (), out: &mut dyn Estimate) {
        let (piece, p, rest) = self.pmf.sample(first);
        self.visit(&self.pieces[piece], rest, &mut sampler, |b| {
            let footprint = self.camera.footprint(b.film);
            if out.skips(footprint.pixels()) {
                return;
            }
            let jump = b.jump * (weight / p) as f32;
            out.pixels(footprint.pixels(), &mut |d, out| {
                let d_p = b.view.normal * d.dot(jump);
                out.edge_point(b.edge, b.view.foreground, b.s, d_p);
                let ray = RayAdjoint { origin: -d_p, dir: d_p * -b.after };
                let ray = d_specular_ray(out, &b.mirror, b.before, Lobe::SPECULAR, ray);
                self.camera.d_ray(b.film, ray.origin, ray.dir, &mut out.camera);
            });
        });
    }
}

impl Estimator for Reflections<'_> {
    fn count(&self) -> usize {
        self.count
    }

    fn cost(&self) -> f64 {
        20.0 + 4.0 * typical_bounces(self.settings.max_bounces)
    }

    fn pass(&self, count: usize, share: f64, seed: u64) -> impl Pass + '_ {
        Sequence { of: self, count, weight: share / count as f64, seed: hash(seed, 0x6d69_7272_6f72) }
    }
}
