//! Boundary term of what the camera sees directly (or in a planar mirror): silhouettes and creases in the image.
//!
//! dJ = Σ_edges ∫ δ(u) (L_fg − L_bg) n·u̇ dℓ over projected edges, with u̇ the velocity of the projected edge point and n the
//! image normal from covering to uncovered side: Li et al. 2018, §4, in the image plane, the same for every
//! projection. Unbiased; visibility of each sampled edge point is tested by a ray, the covering side is shaded from the
//! known face, the uncovered side by a ray that ignores the edge's own faces.

use glam::{DVec2, Vec2, Vec3};
use rayon::prelude::*;

use super::allocate::{Estimator, typical_bounces};
use super::chains::chains;
use super::estimate::{Draw, Estimate, Pass, Sequence};
use super::layers::Sides;
use super::lens::{blurred, classify_through_lens};
use super::viewpoint::{Seen, Viewpoint};
use crate::image::Image;
use crate::render::accel::PrimId;
use crate::render::edges::{Edge, SMOOTH_CREASE};
use crate::render::film::first_hit;
use crate::render::integrator::{NoRecord, Options, Start, trace};
use crate::render::sampler::{Discrete, Sampler, hash};
use crate::render::{Camera, Output, Projection, Scene, Settings};

/// Distance between an edge and the ray that looks past it: in pixels, and over the width of the film, whichever is less. What is
/// narrower is not seen past the edge, such as the shadow right behind the foot of something that hangs a little above a floor.
const NUDGE: [f32; 2] = [1e-3, 1e-6];
/// Longest piece of an edge with one sampling weight, in pixels.
pub const PIECE: f64 = 8.0;
/// Antithetic pairs on a piece: more than one only for pieces that something else hides in part.
const STRATA: u32 = 4;
/// A piece of a projected edge on the film.
#[derive(Clone, Copy)]
pub struct Piece {
    pub edge: u32,
    pub viewpoint: u32,
    /// Film positions of its ends, in pixels, and the edge parameters they belong to, which may fall from `a` to `b`.
    pub a: DVec2,
    pub b: DVec2,
    /// Depths of the whole (near-clipped) segment's ends with their parameters, to undo perspective.
    pub za: f64,
    pub zb: f64,
    pub sa: f64,
    pub sb: f64,
    pub ta: f64,
    pub tb: f64,
    /// How far from there a lens may show it, in pixels.
    pub blur: f64,
}

/// Samples of primary edges: all pieces turned the right way, with the plan how to visit them.
pub struct PrimaryEdges<'a> {
    viewpoints: &'a [Viewpoint<'a>],
    settings: &'a Settings,
    seed: u64,
    pieces: Vec<Piece>,
    plan: Plan,
}

/// How edge points are chosen.
enum Plan {
    /// Antithetic pairs on every piece. For radiance without noise and pieces within one pixel: there the jump and the
    /// adjoint are constant and the velocity is linear, so the pair integrates them exactly, and where something else
    /// begins within the pixel it is still unbiased.
    Enumerate,
    /// Stratified over the pieces by weight.
    Sample { pmf: Discrete, count: u32 },
}

/// An edge point chosen for a primary boundary sample.
struct Chosen<'a> {
    edge: &'a Edge,
    viewpoint: Viewpoint<'a>,
    s: f32,
}

/// What an edge point shows.
struct Boundary<'a> {
    viewpoint: Viewpoint<'a>,
    edge: &'a Edge,
    s: f32,
    p: Vec3,
    foreground: usize,
    seen: Seen,
    pixel: usize,
    /// Image normal from the covering to the uncovered side.
    normal_2d: Vec2,
    /// Pixels of film per unit of the edge parameter.
    speed: f32,
    jump: Vec3,
}

impl<'a> PrimaryEdges<'a> {
    /// Collects, clips and weights: samples go where the adjoint image is large. Pieces are stratified together along chains of edges, so that
    /// noise depends less on the order of a mesh's faces. (Along a Hilbert curve of the film derivatives were as noisy or noisier,
    /// docs/efficiency.md.)
    pub fn new(
        viewpoints: &'a [Viewpoint<'a>],
        settings: &'a Settings,
        adjoint: &Image,
        seed: u64,
    ) -> PrimaryEdges<'a> {
        let straight = viewpoints.first().is_some_and(|v| is_straight(&v.camera));
        let lens = viewpoints.first().is_some_and(|v| !v.camera.is_pinhole());
        let enumerate = straight && viewpoints.first().is_some_and(|v| is_noise_free(v.scene, settings));
        let size = DVec2::new(adjoint.width as f64, adjoint.height as f64);
        let mut pieces = Vec::new();
        let mut lengths = Vec::new();
        for (v, viewpoint) in viewpoints.iter().enumerate() {
            let widest = f64::from(viewpoint.camera.widest());
            let class = |edge: &Edge| {
                if lens {
                    classify_through_lens(viewpoint, edge, settings)
                } else {
                    classify(viewpoint, edge, settings)
                }
            };
            let table = &viewpoint.scene.edges_of(settings.output).edges;
            for line in lines(table, class) {
                let edge = &table[line.edge as usize];
                let start = pieces.len();
                let mut add = |piece: Piece| pieces.push(Piece { edge: line.edge, viewpoint: v as u32, ..piece });
                if lens {
                    blurred(viewpoint, edge).into_iter().for_each(&mut add);
                } else if !straight {
                    curved(viewpoint, edge, widest).into_iter().for_each(&mut add);
                } else if let Some(segment) = clip(viewpoint, edge) {
                    let cuts = if enumerate { pixel_cuts(&segment) } else { even_cuts(&segment) };
                    cuts.windows(2).map(|c| segment.part(c[0], c[1])).for_each(&mut add);
                }
                let own: &mut [Piece] = &mut pieces[start..];
                if line.reversed {
                    own.reverse();
                    own.iter_mut().for_each(|piece| *piece = piece.reversed());
                }
                // Never zero: the middle of a curved piece may be off film where its ends are not.
                let length = |p: &Piece| f64::from(line.weight) * (p.a.distance(p.b) + 1e-3) * p.share_on_film(size);
                lengths.extend(own.iter().map(length));
            }
        }
        let mut edges = PrimaryEdges { viewpoints, settings, seed, pieces, plan: Plan::Enumerate };
        if !enumerate {
            edges.plan = edges.plan_samples(&lengths, adjoint);
        }
        edges
    }

    /// Weights by length, by the adjoint image, and by the jump that a few pilot samples find: edges that are hidden or show
    /// no contrast get little. Pilots are independent of the samples they plan, and no piece is left out, so the estimate
    /// stays unbiased. One pilot a piece does what a depth buffer would, is exact where that is conservative, and costs one sample
    /// in `PIECE`·spp: with a depth buffer besides no derivative had less noise, and all took longer (docs/efficiency.md).
    fn plan_samples(&self, lengths: &[f64], adjoint: &Image) -> Plan {
        let spp = f64::from(self.settings.spp.max(1));
        let total: f64 = lengths.iter().sum();
        let groups = ((total * spp / 4.0).max(4096.0) as usize).min(self.pieces.len());
        let range = |g: usize| g * self.pieces.len() / groups..(g + 1) * self.pieces.len() / groups;
        let factors = contrasts(groups, self.settings.spp, hash(self.seed, 0x70_696c_6f74), |g, sampler| {
            let (u, range) = (sampler.next_2d(), range(g));
            let piece = &self.pieces[range.start + (u.x * range.len() as f32) as usize];
            let chosen = self.place(piece, f64::from(u.y), sampler);
            let boundary = chosen.and_then(|c| self.look(&c, sampler, |_| false));
            boundary.map_or(0.0, |b| f64::from(b.jump.length_squared()))
        });
        let mean_adjoint = adjoint.data.iter().map(|v| f64::from(v.abs())).sum::<f64>()
            / (adjoint.width * adjoint.height).max(1) as f64;
        let mut weights = Vec::with_capacity(self.pieces.len());
        let mut seen = 0.0;
        for (g, factor) in factors.into_iter().enumerate() {
            for i in range(g) {
                let piece = &self.pieces[i];
                let importance = local_weight(adjoint, piece) + 0.1 * mean_adjoint;
                weights.push(lengths[i] * importance * factor.weight);
                seen += lengths[i] * if factor.seen { 1.0 } else { 0.1 };
            }
        }
        // As many samples a pixel of visible edge as the image has a pixel, but no less than one for four of the image's: an
        // edge is as noisy as a surface, and matters more.
        let camera = &self.viewpoints[0].camera;
        let least = (camera.width * camera.height) as f64 * spp / 4.0;
        let count = (seen * spp).max(least).clamp(1024.0, 1e7) as u32;
        Plan::Sample { pmf: Discrete::new(weights), count }
    }

    /// The point of a piece at the fraction `rest` of its length on film (or of its parameter), as a point of the lens sees it.
    fn place(&self, piece: &Piece, rest: f64, sampler: &mut Sampler) -> Option<Chosen<'a>> {
        let viewpoint = &self.viewpoints[piece.viewpoint as usize];
        let viewpoint = viewpoint.through(viewpoint.camera.sample_lens(sampler).lens);
        let edge = &viewpoint.scene.edges_of(self.settings.output).edges[piece.edge as usize];
        if !is_straight(&viewpoint.camera) {
            let s = (piece.sa + (piece.sb - piece.sa) * rest) as f32;
            return Some(Chosen { edge, viewpoint, s });
        }
        let s = piece.parameter(piece.ta + (piece.tb - piece.ta) * rest) as f32;
        (piece.a != piece.b).then_some(Chosen { edge, viewpoint, s })
    }

    /// What a chosen point shows, unless its pixel is skipped or it is hidden or shows nothing.
    fn look(&self, chosen: &Chosen<'a>, sampler: &mut Sampler, skips: impl Fn(usize) -> bool) -> Option<Boundary<'a>> {
        let &Chosen { edge, viewpoint, s } = chosen;
        let p = edge.point(s);
        let prims = edge.prims();
        let (view, aside) = viewpoint.view(edge, p)?;
        let seen = viewpoint.see_along(p, aside, &prims)?;
        let pixel = seen.pixel_index(&viewpoint.camera);
        if skips(pixel) {
            return None;
        }
        let [gx, gy] = viewpoint.projection_gradient(&seen);
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
        if radiance && view.background.is_some() && edge.mirrors_alike(viewpoint.scene, s, -seen.dir) {
            return None;
        }

        // The same random numbers on both sides.
        let scene = viewpoint.scene;
        let sides = Sides::choose(scene, edge, seen.dir, &view, s, sampler)?;
        let settings = self.settings;
        let nudge = NUDGE[0].min(NUDGE[1] * viewpoint.camera.width.max(viewpoint.camera.height) as f32);
        let value = Values { scene, settings, viewpoint: &viewpoint, edge, seen: &seen, aside, s, prims: &prims };
        let side = |face: Option<usize>| match face {
            Some(face) => value.face(face, &mut sampler.clone()),
            None => value.past(seen.projected.pixel + normal_2d * nudge, &mut sampler.clone()),
        };
        let jump = (side(sides.near) - side(sides.far)) * sides.scale;
        let foreground = view.foreground;
        (jump != Vec3::ZERO && jump.is_finite()).then_some(Boundary {
            viewpoint,
            edge,
            s,
            p,
            foreground,
            seen,
            pixel,
            normal_2d,
            speed,
            jump,
        })
    }

    /// The samples, where they need no choice.
    pub fn enumeration(&self) -> Option<Enumeration<'_>> {
        matches!(self.plan, Plan::Enumerate).then_some(Enumeration(self))
    }

    /// One boundary sample on a piece, at a fraction of it; `weight` is one over the fraction's density.
    fn sample(&self, piece: &Piece, rest: f64, weight: f64, sampler: &mut Sampler, out: &mut impl Estimate) {
        let Some(chosen) = self.place(piece, rest, sampler) else { return };
        let Some(b) = self.look(&chosen, sampler, |pixel| out.skips(pixel)) else { return };
        // Per fraction → per pixel of arc length on film.
        let pixels = if is_straight(&b.viewpoint.camera) {
            piece.a.distance(piece.b)
        } else {
            (piece.sb - piece.sa).abs() * f64::from(b.speed)
        };
        let scale = (pixels * weight) as f32;
        out.pixel(b.pixel, |d, out| {
            let d_pixel = b.normal_2d * (d.dot(b.jump) * scale);
            let d_p = b.viewpoint.d_position(out, b.p, &b.seen, d_pixel);
            out.edge_point(b.edge, b.foreground, b.s, d_p);
        });
    }
}

impl Draw for PrimaryEdges<'_> {
    type Scratch = ();

    fn draw(&self, first: f64, mut sampler: Sampler, weight: f64, _: &mut (), out: &mut impl Estimate) {
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
            Output::Radiance => 2.0 + 4.0 * typical_bounces(self.settings.max_bounces),
            _ => 2.0,
        }
    }

    fn pass(&self, count: usize, share: f64, seed: u64) -> impl Pass + '_ {
        Sequence { of: self, count, weight: share / count as f64, seed: hash(seed, 0x7072_696d_6172) }
    }
}

/// Every piece of edge: nothing is left to chance, or almost nothing.
pub struct Enumeration<'a>(&'a PrimaryEdges<'a>);

impl Pass for Enumeration<'_> {
    fn items(&self) -> usize {
        self.0.pieces.len()
    }

    fn run(&self, items: std::ops::Range<usize>, out: &mut impl Estimate) {
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

/// What pilot samples say of a group of pieces.
pub struct Contrast {
    /// Factor of its sampling weight.
    pub weight: f64,
    /// It shows something.
    pub seen: bool,
}

/// Pilot samples of a group.
pub fn pilots(spp: u32) -> u32 {
    spp.div_ceil(4).clamp(1, 64)
}

/// Pilot samples of groups of pieces, neighbours by number: `square` returns the square of what one finds.
pub fn contrasts(
    groups: usize,
    spp: u32,
    seed: u64,
    square: impl Fn(usize, &mut Sampler) -> f64 + Sync,
) -> Vec<Contrast> {
    /// Share of the weight that does not listen to pilots.
    const DEFENSIVE: f64 = 0.2;
    let pilots = pilots(spp);
    // Mean squares: the best density follows the second moment.
    let contrast: Vec<f64> = (0..groups)
        .into_par_iter()
        .map(|g| {
            let square = |i: u32| square(g, &mut Sampler::new(hash(seed, g as u64), u64::from(i)));
            (0..pilots).map(square).sum::<f64>() / f64::from(pilots)
        })
        .collect();
    let near = |g: usize| {
        let near = &contrast[g.saturating_sub(1)..(g + 2).min(groups)];
        (near.iter().sum::<f64>() / near.len() as f64).sqrt()
    };
    let mean = (0..groups).map(near).sum::<f64>() / groups.max(1) as f64;
    let factor = |g: usize| {
        // The root, because pilots are noisy: a lucky one must not starve the others.
        let local = near(g);
        let weight = if mean > 0.0 { (1.0 - DEFENSIVE) * (local / mean).min(16.0).sqrt() + DEFENSIVE } else { 1.0 };
        Contrast { weight, seen: local > 0.0 }
    };
    (0..groups).map(factor).collect()
}

/// What is seen on either side of an edge point.
struct Values<'a> {
    scene: &'a Scene,
    settings: &'a Settings,
    viewpoint: &'a Viewpoint<'a>,
    edge: &'a Edge,
    seen: &'a Seen,
    /// How far aside to look ([`Viewpoint::view`]).
    aside: Vec3,
    s: f32,
    prims: &'a [PrimId],
}

impl Values<'_> {
    /// On one of the edge's own faces, a hair's breadth inside of it.
    fn face(&self, face: usize, sampler: &mut Sampler) -> Vec3 {
        let [at_edge, beside] = self.edge.beside(self.scene, face, self.s, self.seen.distance, -self.seen.dir);
        match self.settings.output {
            Output::Radiance => {
                let options = Options::new(self.settings.max_bounces.saturating_sub(self.viewpoint.bounces()));
                let below = self.edge.below(face, beside.ng);
                let start = Start::Beside(beside, &below);
                self.seen.throughput * trace(self.scene, start, sampler, &options, &mut NoRecord)
            }
            output => self.seen.throughput * first_hit(self.scene, output, &self.viewpoint.camera, &at_edge),
        }
    }

    /// Past the edge, through a film position just beside it.
    fn past(&self, pixel: Vec2, sampler: &mut Sampler) -> Vec3 {
        let Some((ray, start, mut throughput)) = self.viewpoint.ray(pixel) else { return Vec3::ZERO };
        let mut skip: Vec<PrimId> = self.prims.iter().copied().chain(start).collect();
        if self.scene.masked {
            throughput = self.seen.throughput;
            let way = self.viewpoint.way(self.seen.origin + self.aside, self.seen.dir, self.seen.distance);
            skip.extend(self.scene.passed(&way, &skip));
        }
        match self.settings.output {
            Output::Radiance => {
                let options = Options::new(self.settings.max_bounces.saturating_sub(self.viewpoint.bounces()));
                throughput * trace(self.scene, Start::Ray(ray, &skip), sampler, &options, &mut NoRecord)
            }
            output => match self.scene.chance(&ray, &skip, sampler) {
                Some((si, _)) => throughput * first_hit(self.scene, output, &self.viewpoint.camera, &si),
                None => Vec3::ZERO,
            },
        }
    }
}

/// Whether edges are sampled evenly along their straight images.
fn is_straight(camera: &Camera) -> bool {
    camera.keeps_lines() && camera.is_pinhole()
}

/// How an edge may matter to a camera.
pub struct Class {
    /// Sampling weight per length.
    pub weight: f64,
    /// It covers something; through a lens, as seen from some of its points.
    pub contour: bool,
}

/// Kind of an edge; `None` if nothing can jump there.
pub fn classify(viewpoint: &Viewpoint, edge: &Edge, settings: &Settings) -> Option<Class> {
    let (view, _) = viewpoint.view(edge, edge.point(0.5))?;
    let contour = view.background.is_none();
    let class = |weight: f64| Class { weight, contour };
    if contour || edge.sharp {
        return Some(class(1.0));
    }
    if settings.output == Output::Radiance && edge.is_mirror(viewpoint.scene) {
        // Nothing jumps but near the rim, and there much does.
        return may_be_folded(viewpoint, edge).then(|| class(1.0));
    }
    let jumps = match settings.output {
        Output::Radiance => settings.max_bounces > 0,
        output => output == Output::GeometricNormal,
    };
    jumps.then(|| class(SMOOTH_CREASE.into()))
}

/// An edge that may matter to a viewpoint.
struct Line {
    edge: u32,
    weight: f32,
    /// It is passed from its end to its start.
    reversed: bool,
}

/// The edges of a viewpoint, one after the other along contours and creases.
fn lines(edges: &[Edge], class: impl Fn(&Edge) -> Option<Class>) -> impl Iterator<Item = Line> {
    /// More creases are a net, in which no way is better than the mesh's own, and to look for one takes as long as to sample.
    const NET: usize = 1 << 15;
    let classes: Vec<(u32, Class)> = (0..).zip(edges).filter_map(|(e, edge)| Some((e, class(edge)?))).collect();
    let creases = classes.iter().filter(|(_, class)| !class.contour).count();
    let (chained, net): (Vec<_>, Vec<_>) = classes.into_iter().partition(|(_, class)| class.contour || creases <= NET);
    let ends: Vec<[Vec3; 2]> = chained.iter().map(|(e, _)| edges[*e as usize].p).collect();
    let line = |(edge, class): &(u32, Class), reversed| Line { edge: *edge, weight: class.weight as f32, reversed };
    let chained = chains(&ends).into_iter().map(move |link| line(&chained[link.edge], link.reversed));
    chained.chain(net.into_iter().map(move |of| line(&of, false)))
}

/// Whether the camera, from any point of its lens, sees a smooth mirror's faces at an edge so low that something may be folded.
fn may_be_folded(viewpoint: &Viewpoint, edge: &Edge) -> bool {
    const SLACK: f32 = 1e-5;
    let folding = edge.folding(viewpoint.scene) + SLACK;
    edge.p.iter().any(|&p| {
        let (dir, distance) = viewpoint.way_to(p);
        let off = folding + viewpoint.camera.lens.radius / distance;
        edge.faces.iter().any(|f| edge.face_normal(f).dot(dir).abs() <= off)
    })
}

/// Whether what an edge shows does not depend on random numbers: first-hit channels, emission alone, direct light of a
/// single point or directional light, all without masks.
fn is_noise_free(scene: &Scene, settings: &Settings) -> bool {
    !scene.masked
        && (settings.output != Output::Radiance
            || settings.max_bounces == 0
            || (settings.max_bounces == 1 && scene.lights.is_single_delta()))
}

/// Fractions of a segment at which it crosses from pixel to pixel, with both ends.
fn pixel_cuts(segment: &Piece) -> Vec<f64> {
    let mut cuts = vec![0.0, 1.0];
    let (a, d) = (segment.a, segment.b - segment.a);
    for (a, d) in [(a.x, d.x), (a.y, d.y)] {
        let (lo, hi) = (a.min(a + d), a.max(a + d));
        let mut line = lo.floor() + 1.0;
        while line < hi {
            cuts.push((line - a) / d);
            line += 1.0;
        }
    }
    cuts.sort_by(f64::total_cmp);
    cuts.dedup();
    cuts
}

/// Fractions that cut a segment into equal parts no longer than [`PIECE`].
fn even_cuts(segment: &Piece) -> Vec<f64> {
    let count = (segment.a.distance(segment.b) / PIECE).ceil().max(1.0) as usize;
    (0..=count).map(|i| i as f64 / count as f64).collect()
}

impl Piece {
    /// The edge parameter at a fraction of the projected (near-clipped) segment.
    pub fn parameter(&self, t: f64) -> f64 {
        let s = t * self.za / ((1.0 - t) * self.zb + t * self.za);
        self.sa + (self.sb - self.sa) * s
    }

    /// The same piece from its other end.
    fn reversed(self) -> Piece {
        let Piece { a, b, za, zb, sa, sb, ta, tb, .. } = self;
        Piece { a: b, b: a, za: zb, zb: za, sa: sb, sb: sa, ta: 1.0 - tb, tb: 1.0 - ta, ..self }
    }

    /// The part between two fractions of the length on film.
    pub fn part(&self, from: f64, to: f64) -> Piece {
        let t = |x: f64| self.ta + (self.tb - self.ta) * x;
        Piece { a: self.a.lerp(self.b, from), b: self.a.lerp(self.b, to), ta: t(from), tb: t(to), ..*self }
    }
}

fn local_weight(image: &Image, piece: &Piece) -> f64 {
    if piece.blur > 0.0 {
        return piece.blurred_weight(image);
    }
    let (a, b) = (piece.a, piece.b);
    let steps = a.distance(b).ceil().max(1.0) as usize;
    let mut sum = 0.0;
    for i in 0..steps {
        let p = a.lerp(b, (i as f64 + 0.5) / steps as f64);
        let x = (p.x.max(0.0) as usize).min(image.width - 1);
        let y = (p.y.max(0.0) as usize).min(image.height - 1);
        sum += image.pixel(x, y).iter().map(|v| f64::from(v.abs())).sum::<f64>();
    }
    sum / steps as f64
}

/// Pieces of an edge for a projection that bends lines, on or near the film: equal steps of the edge parameter or, where an ideal
/// film would show a straight line, of that.
fn curved(viewpoint: &Viewpoint, edge: &Edge, widest: f64) -> Vec<Piece> {
    const STEPS: usize = 32;
    let camera = &viewpoint.camera;
    let share = |i: usize| i as f64 / STEPS as f64;
    let places: Vec<Option<(f64, DVec2)>> = if camera.projection == Projection::Perspective {
        let Some((line, _)) = before(viewpoint, edge) else { return Vec::new() };
        let half = DVec2::new(0.5 * camera.width as f64, -0.5 * camera.height as f64);
        let ideal = |p: DVec2| (p / half + DVec2::new(-1.0, 1.0)) * Vec2::from_array(camera.scale).as_dvec2();
        let (a, b) = (ideal(line.a), ideal(line.b));
        let Some([from, to]) = within(a, b, widest) else { return Vec::new() };
        let place = |i: usize| {
            let t = from + (to - from) * share(i);
            Some((line.parameter(t), camera.distorted_pixel(a.lerp(b, t).as_vec2()).as_dvec2()))
        };
        (0..=STEPS).map(place).collect()
    } else {
        let film = |s: f64| camera.project_folded(viewpoint.image(edge.point(s as f32))).map(|q| q.pixel.as_dvec2());
        (0..=STEPS).map(|i| Some((share(i), film(share(i))?))).collect()
    };
    let size = DVec2::new(camera.width as f64, camera.height as f64);
    places
        .windows(2)
        .filter_map(|ends| {
            let [(sa, a), (sb, b)] = [ends[0]?, ends[1]?];
            // A step may jump from one side of a panorama to the other: then its length says nothing.
            let reach = DVec2::splat(a.distance(b) + 4.0);
            let outside = |p: DVec2| p.cmplt(-reach).any() || p.cmpgt(size + reach).any();
            let piece = Piece { edge: 0, viewpoint: 0, a, b, za: 1.0, zb: 1.0, sa, sb, ta: 0.0, tb: 1.0, blur: 0.0 };
            (!(outside(a) && outside(b))).then_some(piece)
        })
        .collect()
}

/// The part of the way from `a` to `b` that is no further than `radius` from the origin, as fractions of it.
fn within(a: DVec2, b: DVec2, radius: f64) -> Option<[f64; 2]> {
    let d = b - a;
    let middle = -a.dot(d) / d.length_squared();
    let half2 = (radius * radius - (a + d * middle).length_squared()) / d.length_squared();
    let half = half2.sqrt(); // not a number where none is
    let (from, to) = ((middle - half).max(0.0), (middle + half).min(1.0));
    (half2 > 0.0 && from < to).then_some([from, to])
}

/// Clips an edge to the space before the camera (and before the mirror) and to the film.
fn clip(viewpoint: &Viewpoint, edge: &Edge) -> Option<Piece> {
    let (width, height) = (viewpoint.camera.width as f64, viewpoint.camera.height as f64);
    let (whole, _) = before(viewpoint, edge)?;
    let (a, b) = (whole.a, whole.b);
    // Liang-Barsky against the film.
    let (mut t0, mut t1) = (0.0f64, 1.0f64);
    let d = b - a;
    for (p, q) in [(-d.x, a.x), (d.x, width - a.x), (-d.y, a.y), (d.y, height - a.y)] {
        if p == 0.0 {
            if q < 0.0 {
                return None;
            }
        } else if p < 0.0 {
            t0 = t0.max(q / p);
        } else {
            t1 = t1.min(q / p);
        }
    }
    if t0 >= t1 {
        return None;
    }
    Some(Piece { a: a.lerp(b, t0), b: a.lerp(b, t1), ta: t0, tb: t1, ..whole })
}

/// The part of an edge before the camera (and before the mirror), and the depths of its ends.
pub fn before(viewpoint: &Viewpoint, edge: &Edge) -> Option<(Piece, [f64; 2])> {
    let camera = &viewpoint.camera;
    let (mut s0, mut s1) = (0.0f64, 1.0f64);
    let mut keep = |d0: f64, d1: f64| {
        // Keep where lerp(d0, d1, s) >= 0.
        if d0 < 0.0 && d1 < 0.0 {
            s1 = -1.0;
        } else if d0 < 0.0 {
            s0 = s0.max(d0 / (d0 - d1));
        } else if d1 < 0.0 {
            s1 = s1.min(d0 / (d0 - d1));
        }
    };
    let frame =
        glam::DMat3::from_cols(camera.frame[0].as_dvec3(), camera.frame[1].as_dvec3(), camera.frame[2].as_dvec3())
            .inverse();
    let local = |p: Vec3| frame * (viewpoint.image(p).as_dvec3() - camera.origin.as_dvec3());
    let (l0, l1) = (local(edge.p[0]), local(edge.p[1]));
    let perspective = camera.projection == Projection::Perspective;
    let near = 1e-5 * f64::from(viewpoint.scene.radius);
    keep(l0.z - near, l1.z - near);
    // A lens may have points on either side of the mirror.
    if let Some(m) = viewpoint.mirror.filter(|_| camera.is_pinhole()) {
        let side = viewpoint.side(&m);
        let distance = |p: Vec3| f64::from(m.height(p) * side);
        keep(distance(edge.p[0]), distance(edge.p[1]));
    }
    if s0 >= s1 {
        return None;
    }
    let (q0, q1) = (l0.lerp(l1, s0), l0.lerp(l1, s1));
    let to_film = |q: glam::DVec3| {
        let w = if perspective { q.z } else { 1.0 };
        let x = q.x / (w * f64::from(camera.scale[0]));
        let y = q.y / (w * f64::from(camera.scale[1]));
        DVec2::new((x + 1.0) * 0.5 * camera.width as f64, (1.0 - y) * 0.5 * camera.height as f64)
    };
    let (a, b) = (to_film(q0), to_film(q1));
    if !a.is_finite() || !b.is_finite() {
        return None;
    }
    let (za, zb) = if perspective { (q0.z, q1.z) } else { (1.0, 1.0) };
    let piece = Piece { edge: 0, viewpoint: 0, a, b, za, zb, sa: s0, sb: s1, ta: 0.0, tb: 1.0, blur: 0.0 };
    Some((piece, [q0.z, q1.z]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_reversed_piece_has_the_same_points() {
        let whole = Piece {
            edge: 0,
            viewpoint: 0,
            a: DVec2::new(3.0, 8.0),
            b: DVec2::new(-5.0, 2.0),
            za: 0.7,
            zb: 2.5,
            sa: 0.2,
            sb: 0.9,
            ta: 0.0,
            tb: 1.0,
            blur: 0.0,
        };
        let piece = whole.part(0.3, 0.45);
        let reversed = piece.reversed();
        let place = |p: &Piece, rest: f64| p.parameter(p.ta + (p.tb - p.ta) * rest);
        for rest in [0.0, 0.25, 0.8, 1.0] {
            assert!((place(&piece, rest) - place(&reversed, 1.0 - rest)).abs() < 1e-14, "{rest}");
            assert!((piece.a.lerp(piece.b, rest) - reversed.a.lerp(reversed.b, 1.0 - rest)).length() < 1e-14, "{rest}");
        }
        // Where lines are not straight parameters go evenly.
        assert_eq!((reversed.sa, reversed.sb), (piece.sb, piece.sa));
    }
}
