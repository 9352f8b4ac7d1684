//! Boundary term of edges that the camera sees directly or in a planar mirror: silhouettes and creases in the image.
//!
//! dJ = Σ_edges ∫ δ(u) (L_fg − L_bg) n·u̇ dℓ over projected edges, where u̇ is the velocity of the projected edge point and n the image
//! normal from the covering to the uncovered side (Li et al. 2018, §4, in the image plane, which is the same for every projection).
//! Unbiased: a ray tests the visibility of each sampled edge point, the covering side is shaded on the known face, and the uncovered side
//! is found by a ray that skips the edge's own faces.

mod lens;
pub(in crate::grad) mod pieces;

use glam::{Vec2, Vec3};

use self::lens::{blurred, classify_through_lens};
use self::pieces::{Piece, classify, clip, curved_pieces, even_cuts, is_straight, ordered_edges, pixel_cuts};
use crate::grad::estimate::{Draw, Estimate, Pass, Sequence};
use crate::grad::layers::Sides;
use crate::grad::mirrors::viewpoint::{CameraConnection, Viewpoint};
use crate::grad::sampling::allocate::{Estimator, typical_bounces};
use crate::grad::sampling::contrast::contrasts;
use crate::grad::sampling::pixels::magnitude_at;
use crate::image::Image;
use crate::render::accel::PrimId;
use crate::render::edges::Edge;
use crate::render::film::first_hit;
use crate::render::footprint::Footprint;
use crate::render::integrator::{NoRecord, Options, Start, trace};
use crate::render::sampler::{Discrete, Sampler, hash};
use crate::render::{Camera, Output, PixelFilter, Scene, Settings};

/// Distance between an edge and the ray past it: in pixels, and as a fraction of the film's width, whichever is less. Narrower features
/// are missed, such as the shadow right behind the foot of something that hangs a little above a floor.
const NUDGE: [f32; 2] = [1e-3, 1e-6];
/// Number of antithetic pairs on a piece. More than one is needed only for pieces that are partly occluded.
const STRATA: u32 = 4;
/// The estimator of primary edges: all pieces in their order along chains, and the sampling plan.
pub struct PrimaryEdges<'a> {
    viewpoints: &'a [Viewpoint<'a>],
    settings: &'a Settings,
    seed: u64,
    pieces: Vec<Piece>,
    plan: Plan,
}

/// How edge points are sampled.
enum Plan {
    /// Antithetic pairs on every piece, for radiance without noise and pieces within one pixel of the box filter. There the jump and the adjoint are
    /// constant and the velocity is linear, so a pair integrates exactly. If an occluder begins within the pixel, the estimate is still
    /// unbiased.
    Enumerate,
    /// Stratified over the pieces by weight.
    Sample { pmf: Discrete, count: u32 },
}

/// A sampled point of an edge, and the viewpoint from which it is seen.
struct EdgeSample<'a> {
    edge: &'a Edge,
    viewpoint: Viewpoint<'a>,
    s: f32,
}

/// A boundary sample: an edge point with the jump of radiance across it.
struct Boundary<'a> {
    viewpoint: Viewpoint<'a>,
    edge: &'a Edge,
    s: f32,
    p: Vec3,
    foreground: usize,
    connection: CameraConnection,
    footprint: Footprint,
    /// Image normal from the covering to the uncovered side.
    normal_2d: Vec2,
    /// Pixels of film per unit of the edge parameter.
    speed: f32,
    jump: Vec3,
}

impl<'a> PrimaryEdges<'a> {
    /// Collects the edges, clips and cuts their images, and weights the pieces by the adjoint image. Pieces are stratified along chains
    /// of edges, so that noise depends less on the order of a mesh's faces. (Derivatives were as noisy or noisier with pieces along a
    /// Hilbert curve of the film, docs/efficiency.md.)
    pub fn new(
        viewpoints: &'a [Viewpoint<'a>],
        settings: &'a Settings,
        adjoint: &Image,
        seed: u64,
    ) -> PrimaryEdges<'a> {
        let straight = viewpoints.first().is_some_and(|v| is_straight(&v.camera));
        let lens = viewpoints.first().is_some_and(|v| !v.camera.is_pinhole());
        let within_pixels = |v: &Viewpoint| v.camera.filter == PixelFilter::Box && is_noise_free(v.scene, settings);
        let enumerate = straight && viewpoints.first().is_some_and(within_pixels);
        let mut pieces = Vec::new();
        let mut lengths = Vec::new();
        for (v, viewpoint) in viewpoints.iter().enumerate() {
            let max_radius = f64::from(viewpoint.camera.max_ideal_radius());
            let class = |edge: &Edge| {
                if lens {
                    classify_through_lens(viewpoint, edge, settings)
                } else {
                    classify(viewpoint, edge, settings)
                }
            };
            let table = &viewpoint.scene.edges_of(settings.output).edges;
            for line in ordered_edges(table, class) {
                let edge = &table[line.edge as usize];
                let start = pieces.len();
                let mut add = |piece: Piece| pieces.push(Piece { edge: line.edge, viewpoint: v as u32, ..piece });
                if lens {
                    blurred(viewpoint, edge).into_iter().for_each(&mut add);
                } else if !straight {
                    curved_pieces(viewpoint, edge, max_radius).into_iter().for_each(&mut add);
                } else if let Some(segment) = clip(viewpoint, edge) {
                    let cuts = if enumerate { pixel_cuts(&segment) } else { even_cuts(&segment) };
                    cuts.windows(2).map(|c| segment.part(c[0], c[1])).for_each(&mut add);
                }
                let own: &mut [Piece] = &mut pieces[start..];
                if line.reversed {
                    own.reverse();
                    own.iter_mut().for_each(|piece| *piece = piece.reversed());
                }
                // Never zero: the ends of a curved piece may coincide on film although its middle lies elsewhere.
                let length = |p: &Piece| {
                    f64::from(line.weight) * (p.a.distance(p.b) + 1e-3) * p.share_on_film(&viewpoint.camera)
                };
                lengths.extend(own.iter().map(length));
            }
        }
        let mut edges = PrimaryEdges { viewpoints, settings, seed, pieces, plan: Plan::Enumerate };
        if !enumerate {
            edges.plan = edges.plan_samples(&lengths, adjoint);
        }
        edges
    }

    /// Weights pieces by length, by the adjoint image, and by the jump that a few pilot samples find: edges that are hidden or have no
    /// contrast get few samples. Pilots are independent of the samples that they plan, and no piece has zero weight, so the estimate is
    /// unbiased. One pilot per piece does what a depth buffer would do, but exactly, and costs one sample in `MAX_PIECE_LENGTH`·spp. With
    /// a depth buffer in addition no derivative had less noise, and all took longer (docs/efficiency.md).
    fn plan_samples(&self, lengths: &[f64], adjoint: &Image) -> Plan {
        let spp = f64::from(self.settings.spp.max(1));
        let total: f64 = lengths.iter().sum();
        let groups = ((total * spp / 4.0).max(4096.0) as usize).min(self.pieces.len());
        let range = |g: usize| g * self.pieces.len() / groups..(g + 1) * self.pieces.len() / groups;
        let factors = contrasts(groups, self.settings.spp, hash(self.seed, 0x70_696c_6f74), |g, sampler| {
            let (u, range) = (sampler.next_2d(), range(g));
            let piece = &self.pieces[range.start + (u.x * range.len() as f32) as usize];
            let sample = self.edge_sample(piece, f64::from(u.y), sampler);
            let boundary = sample.and_then(|c| self.evaluate(&c, sampler, |_| false));
            boundary.map_or(0.0, |b| f64::from(b.jump.length_squared()))
        });
        let mean_adjoint = adjoint.data.iter().map(|v| f64::from(v.abs())).sum::<f64>()
            / (adjoint.width * adjoint.height).max(1) as f64;
        let camera = &self.viewpoints[0].camera;
        let mut weights = Vec::with_capacity(self.pieces.len());
        let mut seen = 0.0;
        for (g, factor) in factors.into_iter().enumerate() {
            for i in range(g) {
                let piece = &self.pieces[i];
                let importance = local_weight(camera, adjoint, piece) + 0.1 * mean_adjoint;
                weights.push(lengths[i] * importance * factor.weight);
                seen += lengths[i] * if factor.seen { 1.0 } else { 0.1 };
            }
        }
        // As many samples per pixel of visible edge as the image has per pixel, but at least one for four of the image's: an edge is as
        // noisy as a surface, and matters more.
        let least = (camera.width * camera.height) as f64 * spp / 4.0;
        let count = (seen * spp).max(least).clamp(1024.0, 1e7) as u32;
        Plan::Sample { pmf: Discrete::new(weights), count }
    }

    /// The point of a piece at the fraction `rest` of its length on film (or of its parameter), seen from a random point of the lens.
    fn edge_sample(&self, piece: &Piece, rest: f64, sampler: &mut Sampler) -> Option<EdgeSample<'a>> {
        let viewpoint = &self.viewpoints[piece.viewpoint as usize];
        let viewpoint = viewpoint.through(viewpoint.camera.sample_lens(sampler).lens);
        let edge = &viewpoint.scene.edges_of(self.settings.output).edges[piece.edge as usize];
        if !is_straight(&viewpoint.camera) {
            let s = (piece.sa + (piece.sb - piece.sa) * rest) as f32;
            return Some(EdgeSample { edge, viewpoint, s });
        }
        let s = piece.parameter(piece.ta + (piece.tb - piece.ta) * rest) as f32;
        (piece.a != piece.b).then_some(EdgeSample { edge, viewpoint, s })
    }

    /// Evaluates a sampled point; `None` if its pixels are skipped, or if it is occluded or has no jump.
    fn evaluate(
        &self,
        sample: &EdgeSample<'a>,
        sampler: &mut Sampler,
        skips: impl Fn(&[(u32, f32)]) -> bool,
    ) -> Option<Boundary<'a>> {
        let &EdgeSample { edge, viewpoint, s } = sample;
        let p = edge.point(s);
        let prims = edge.prims();
        let (view, aside) = viewpoint.view(edge, p)?;
        let connection = viewpoint.connect_aside(p, aside, &prims)?;
        let footprint = viewpoint.camera.footprint(connection.projected.pixel);
        if skips(footprint.pixels()) {
            return None;
        }
        let [gx, gy] = viewpoint.projection_gradient(&connection);
        let along = edge.p[1] - edge.p[0];
        let along = Vec2::new(gx.dot(along), gy.dot(along));
        let speed = along.length();
        if !(speed > 0.0 && speed.is_finite()) {
            return None;
        }
        let tangent = along / speed;
        let normal_2d = Vec2::new(tangent.y, -tangent.x);
        let side = normal_2d.x * gx.dot(view.normal) + normal_2d.y * gy.dot(view.normal);
        let normal_2d = if side < 0.0 { -normal_2d } else { normal_2d };

        let radiance = self.settings.output == Output::Radiance;
        if radiance && view.background.is_some() && edge.specular_alike(viewpoint.scene, s, -connection.dir) {
            return None;
        }

        // Both sides use the same random numbers.
        let scene = viewpoint.scene;
        let sides = Sides::choose(scene, edge, connection.dir, &view, s, sampler)?;
        let settings = self.settings;
        let nudge = NUDGE[0].min(NUDGE[1] * viewpoint.camera.film_size().max_element());
        let value = SideRadiance {
            scene,
            settings,
            viewpoint: &viewpoint,
            edge,
            connection: &connection,
            aside,
            s,
            prims: &prims,
        };
        let side = |face: Option<usize>| match face {
            Some(face) => value.face(face, &mut sampler.clone()),
            None => value.past(connection.projected.pixel + normal_2d * nudge, &mut sampler.clone()),
        };
        let jump = (side(sides.near) - side(sides.far)) * sides.scale;
        let foreground = view.foreground;
        (jump != Vec3::ZERO && jump.is_finite()).then_some(Boundary {
            viewpoint,
            edge,
            s,
            p,
            foreground,
            connection,
            footprint,
            normal_2d,
            speed,
            jump,
        })
    }

    /// The pass over all pieces, if the plan is to enumerate them.
    pub fn enumeration(&self) -> Option<Enumeration<'_>> {
        matches!(self.plan, Plan::Enumerate).then_some(Enumeration(self))
    }

    /// Draws one boundary sample on a piece, at the fraction `rest` of it; `weight` is the inverse of the fraction's density.
    fn sample(&self, piece: &Piece, rest: f64, weight: f64, sampler: &mut Sampler, out: &mut dyn Estimate) {
        let Some(sample) = self.edge_sample(piece, rest, sampler) else { return };
        let Some(b) = self.evaluate(&sample, sampler, |pixels| out.skips(pixels)) else { return };
        // Converts the density from per fraction of the piece to per pixel of arc length on film.
        let pixels = if is_straight(&b.viewpoint.camera) {
            piece.a.distance(piece.b)
        } else {
            (piece.sb - piece.sa).abs() * f64::from(b.speed)
        };
        let scale = (pixels * weight) as f32;
        out.pixels(b.footprint.pixels(), &mut |d, out| {
            let d_pixel = b.normal_2d * (d.dot(b.jump) * scale);
            let d_p = b.viewpoint.d_position(out, b.p, &b.connection, d_pixel);
            out.edge_point(b.edge, b.foreground, b.s, d_p);
        });
    }
}

impl Draw for PrimaryEdges<'_> {
    type Scratch = ();

    fn draw(&self, first: f64, mut sampler: Sampler, weight: f64, _: &mut (), out: &mut dyn Estimate) {
        if let Plan::Sample { pmf, .. } = &self.plan {
            let (piece, p, rest) = pmf.sample(first);
            self.sample(&self.pieces[piece], rest, weight / p, &mut sampler, out);
        }
    }
}

impl Estimator for PrimaryEdges<'_> {
    fn count(&self) -> usize {
        match &self.plan {
            Plan::Sample { pmf, count } if !pmf.is_empty() => *count as usize,
            _ => 0,
        }
    }

    fn cost(&self) -> f64 {
        match self.settings.output {
            Output::Radiance => 24.0 + 2.0 * typical_bounces(self.settings.max_bounces),
            _ => 12.0,
        }
    }

    fn pass(&self, count: usize, share: f64, seed: u64) -> impl Pass + '_ {
        Sequence { of: self, count, weight: share / count as f64, seed: hash(seed, 0x7072_696d_6172) }
    }
}

/// A pass over every piece, with stratified antithetic pairs of points on each.
pub struct Enumeration<'a>(&'a PrimaryEdges<'a>);

impl Pass for Enumeration<'_> {
    fn items(&self) -> usize {
        self.0.pieces.len()
    }

    fn run(&self, items: std::ops::Range<usize>, out: &mut dyn Estimate) {
        let seed = hash(self.0.seed, 0x7072_696d_6172);
        let weight = 0.5 / f64::from(STRATA);
        for i in items {
            for stratum in 0..STRATA {
                let mut sampler = Sampler::new(hash(seed, i as u64), u64::from(stratum));
                let u = f64::from(sampler.next_1d());
                for at in [u, 1.0 - u] {
                    let rest = (f64::from(stratum) + at) / f64::from(STRATA);
                    self.0.sample(&self.0.pieces[i], rest, weight, &mut sampler, out);
                }
            }
        }
    }
}

/// Radiance (or another channel) on either side of an edge point.
struct SideRadiance<'a> {
    scene: &'a Scene,
    settings: &'a Settings,
    viewpoint: &'a Viewpoint<'a>,
    edge: &'a Edge,
    connection: &'a CameraConnection,
    /// Offset for lines of sight ([`Viewpoint::view`]).
    aside: Vec3,
    s: f32,
    prims: &'a [PrimId],
}

impl SideRadiance<'_> {
    /// The radiance of one of the edge's own faces, right beside the edge.
    fn face(&self, face: usize, sampler: &mut Sampler) -> Vec3 {
        let [at_edge, beside] =
            self.edge.beside(self.scene, face, self.s, self.connection.distance, -self.connection.dir);
        match self.settings.output {
            Output::Radiance => {
                let options = Options::new(self.settings.max_bounces.saturating_sub(self.viewpoint.bounces()));
                let below = self.edge.below(face, beside.ng);
                let start = Start::BesideEdge(beside, &below);
                let way = self.scene.attenuation_from(self.connection.origin, self.connection.distance);
                self.connection.throughput * way * trace(self.scene, start, sampler, &options, &mut NoRecord)
            }
            output => self.connection.throughput * first_hit(self.scene, output, &self.viewpoint.camera, &at_edge),
        }
    }

    /// The radiance past the edge, through a film position just beside it.
    fn past(&self, pixel: Vec2, sampler: &mut Sampler) -> Vec3 {
        let Some((ray, start, mut throughput)) = self.viewpoint.ray(pixel) else { return Vec3::ZERO };
        let mut skip: Vec<PrimId> = self.prims.iter().copied().chain(start).collect();
        if self.scene.masked {
            throughput = self.connection.throughput;
            let way = self.viewpoint.last_segment(
                self.connection.origin + self.aside,
                self.connection.dir,
                self.connection.distance,
            );
            skip.extend(self.scene.masks_passed(&way, &skip));
        }
        match self.settings.output {
            Output::Radiance => {
                let options = Options::new(self.settings.max_bounces.saturating_sub(self.viewpoint.bounces()));
                throughput * trace(self.scene, Start::Ray(ray, &skip), sampler, &options, &mut NoRecord)
            }
            output => match self.scene.random_interaction(&ray, &skip, sampler) {
                Some((si, _)) => throughput * first_hit(self.scene, output, &self.viewpoint.camera, &si),
                None => Vec3::ZERO,
            },
        }
    }
}

/// Whether the values on both sides of edges do not depend on random numbers: first-hit channels, emission alone, or direct light of a
/// single point or directional light, all without masks.
fn is_noise_free(scene: &Scene, settings: &Settings) -> bool {
    !scene.masked
        && (settings.output != Output::Radiance
            || settings.max_bounces == 0
            || (settings.max_bounces == 1 && scene.lights.is_single_delta()))
}

/// Mean magnitude of the adjoint image along a piece.
fn local_weight(camera: &Camera, image: &Image, piece: &Piece) -> f64 {
    if piece.blur > 0.0 {
        return piece.blurred_weight(camera, image);
    }
    let (a, b) = (piece.a, piece.b);
    let steps = a.distance(b).ceil().max(1.0) as usize;
    let mut sum = 0.0;
    for i in 0..steps {
        let p = a.lerp(b, (i as f64 + 0.5) / steps as f64);
        sum += magnitude_at(camera, image, p.as_vec2());
    }
    sum / steps as f64
}
