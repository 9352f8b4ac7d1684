//! Pieces of edges on film: selects the edges that may have a boundary term for a camera, orders them, clips their images to the film and
//! cuts them into pieces that have one sampling weight each.

use glam::{DVec2, Vec2, Vec3};

use crate::grad::mirrors::viewpoint::Viewpoint;
use crate::grad::sampling::chains::chains;
use crate::render::edges::{Edge, SMOOTH_CREASE};
use crate::render::{Camera, Output, Projection, Settings};

/// Longest piece of an edge with one sampling weight, in pixels.
pub const MAX_PIECE_LENGTH: f64 = 8.0;

/// A piece of a projected edge on the film.
#[derive(Clone, Copy)]
pub struct Piece {
    pub edge: u32,
    pub viewpoint: u32,
    /// Film positions of its ends, in pixels. `a` need not be the end with the lesser edge parameter.
    pub a: DVec2,
    pub b: DVec2,
    /// Camera depths of the ends of the edge's near-clipped segment. They relate fractions of its length on film to edge parameters
    /// ([`Piece::parameter`]); 1 where that relation is linear.
    pub za: f64,
    pub zb: f64,
    /// Edge parameters of the ends of that segment; for cameras that do not keep lines straight, or have a lens, of the piece itself.
    pub sa: f64,
    pub sb: f64,
    /// Fractions of that segment's length on film at which this piece begins (at `a`) and ends (at `b`).
    pub ta: f64,
    pub tb: f64,
    /// Radius, in pixels, within which a lens may show the piece's points around their film positions; 0 for a pinhole camera.
    pub blur: f64,
}

/// Whether the images of edges are straight, so that they are sampled uniformly by length on film.
pub fn is_straight(camera: &Camera) -> bool {
    camera.is_rectilinear() && camera.is_pinhole()
}

/// How an edge may matter to a camera.
pub struct EdgeClass {
    /// Sampling weight per length.
    pub weight: f64,
    /// The edge is a contour; for a camera with a lens, as seen from some of the lens's points.
    pub contour: bool,
}

/// Classifies an edge as seen from a viewpoint; `None` if the image cannot be discontinuous there.
pub fn classify(viewpoint: &Viewpoint, edge: &Edge, settings: &Settings) -> Option<EdgeClass> {
    let (view, _) = viewpoint.view(edge, edge.point(0.5))?;
    let contour = view.background.is_none();
    let class = |weight: f64| EdgeClass { weight, contour };
    if contour || edge.sharp {
        return Some(class(1.0));
    }
    if settings.output == Output::Radiance && edge.is_specular(viewpoint.scene) {
        // What a smooth mirror shows is continuous, except where it is seen at a grazing angle, and there it may jump a lot.
        return may_be_folded(viewpoint, edge).then(|| class(1.0));
    }
    let jumps = match settings.output {
        Output::Radiance => settings.max_bounces > 0,
        output => output == Output::GeometricNormal,
    };
    jumps.then(|| class(SMOOTH_CREASE.into()))
}

/// An edge that may have a boundary term, in the order and direction in which its pieces are sampled.
pub struct OrderedEdge {
    pub edge: u32,
    /// Sampling weight per length.
    pub weight: f32,
    /// The edge runs from its end to its start.
    pub reversed: bool,
}

/// The edges with a class, ordered so that neighbours along contours and creases follow one another.
pub fn ordered_edges(edges: &[Edge], class: impl Fn(&Edge) -> Option<EdgeClass>) -> impl Iterator<Item = OrderedEdge> {
    /// Beyond this number creases keep the order of the mesh. They form a net, in which chains are no better than that order, and finding
    /// chains would take as long as sampling.
    const NET: usize = 1 << 15;
    let classes: Vec<(u32, EdgeClass)> = (0..).zip(edges).filter_map(|(e, edge)| Some((e, class(edge)?))).collect();
    let creases = classes.iter().filter(|(_, class)| !class.contour).count();
    let (chained, net): (Vec<_>, Vec<_>) = classes.into_iter().partition(|(_, class)| class.contour || creases <= NET);
    let ends: Vec<[Vec3; 2]> = chained.iter().map(|(e, _)| edges[*e as usize].p).collect();
    let line =
        |(edge, class): &(u32, EdgeClass), reversed| OrderedEdge { edge: *edge, weight: class.weight as f32, reversed };
    let chained = chains(&ends).into_iter().map(move |link| line(&chained[link.edge], link.reversed));
    chained.chain(net.into_iter().map(move |of| line(&of, false)))
}

/// Whether the camera, from any point of its lens, sees the faces of a smooth mirror at an edge at so grazing an angle that the mirrored
/// direction may be folded up ([`Edge::folding`]).
fn may_be_folded(viewpoint: &Viewpoint, edge: &Edge) -> bool {
    const SLACK: f32 = 1e-5;
    let folding = edge.folding(viewpoint.scene) + SLACK;
    edge.p.iter().any(|&p| {
        let (dir, distance) = viewpoint.first_direction_to(p);
        let off = folding + viewpoint.camera.lens.radius / distance;
        edge.faces.iter().any(|f| edge.face_normal(f).dot(dir).abs() <= off)
    })
}

/// Fractions of a segment at which it passes from one pixel to the next, and 0 and 1.
pub fn pixel_cuts(segment: &Piece) -> Vec<f64> {
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

/// Fractions that cut a segment into equal parts no longer than [`MAX_PIECE_LENGTH`].
pub fn even_cuts(segment: &Piece) -> Vec<f64> {
    let count = (segment.a.distance(segment.b) / MAX_PIECE_LENGTH).ceil().max(1.0) as usize;
    (0..=count).map(|i| i as f64 / count as f64).collect()
}

impl Piece {
    /// The edge parameter at a fraction of the near-clipped segment's length on film.
    pub fn parameter(&self, t: f64) -> f64 {
        let s = t * self.za / ((1.0 - t) * self.zb + t * self.za);
        self.sa + (self.sb - self.sa) * s
    }

    /// The same piece in the opposite direction.
    pub fn reversed(self) -> Piece {
        let Piece { a, b, za, zb, sa, sb, ta, tb, .. } = self;
        Piece { a: b, b: a, za: zb, zb: za, sa: sb, sb: sa, ta: 1.0 - tb, tb: 1.0 - ta, ..self }
    }

    /// The part between two fractions of the piece's length on film.
    pub fn part(&self, from: f64, to: f64) -> Piece {
        let t = |x: f64| self.ta + (self.tb - self.ta) * x;
        Piece { a: self.a.lerp(self.b, from), b: self.a.lerp(self.b, to), ta: t(from), tb: t(to), ..*self }
    }
}

/// Pieces of an edge on or near the film, for a camera that does not keep lines straight. The cuts are equal steps of the edge parameter
/// or, for a perspective camera with distortion, of the straight image that the edge would have without distortion.
pub fn curved_pieces(viewpoint: &Viewpoint, edge: &Edge, max_radius: f64) -> Vec<Piece> {
    const STEPS: usize = 32;
    let camera = &viewpoint.camera;
    let share = |i: usize| i as f64 / STEPS as f64;
    let places: Vec<Option<(f64, DVec2)>> = if camera.projection == Projection::Perspective {
        let Some((line, _)) = clip_to_front(viewpoint, edge) else { return Vec::new() };
        let half = DVec2::new(0.5, -0.5) * camera.film_size().as_dvec2();
        let ideal = |p: DVec2| (p / half + DVec2::new(-1.0, 1.0)) * Vec2::from_array(camera.scale).as_dvec2();
        let (a, b) = (ideal(line.a), ideal(line.b));
        let Some([from, to]) = clip_to_disk(a, b, max_radius) else { return Vec::new() };
        let place = |i: usize| {
            let t = from + (to - from) * share(i);
            Some((line.parameter(t), camera.distorted_pixel(a.lerp(b, t).as_vec2()).as_dvec2()))
        };
        (0..=STEPS).map(place).collect()
    } else {
        let film = |s: f64| camera.project_folded(viewpoint.image(edge.point(s as f32))).map(|q| q.pixel.as_dvec2());
        (0..=STEPS).map(|i| Some((share(i), film(share(i))?))).collect()
    };
    let [first, last] = camera.seen_film().map(Vec2::as_dvec2);
    places
        .windows(2)
        .filter_map(|ends| {
            let [(sa, a), (sb, b)] = [ends[0]?, ends[1]?];
            // Dropped if both ends are farther off film than the piece is long. (A step across the seam of a panorama is kept: it is about
            // as long as the film is wide.)
            let reach = DVec2::splat(a.distance(b) + 4.0);
            let outside = |p: DVec2| p.cmplt(first - reach).any() || p.cmpgt(last + reach).any();
            let piece = Piece { edge: 0, viewpoint: 0, a, b, za: 1.0, zb: 1.0, sa, sb, ta: 0.0, tb: 1.0, blur: 0.0 };
            (!(outside(a) && outside(b))).then_some(piece)
        })
        .collect()
}

/// The part of the segment from `a` to `b` within a distance of `radius` from the origin, as two fractions of the segment.
fn clip_to_disk(a: DVec2, b: DVec2, radius: f64) -> Option<[f64; 2]> {
    let d = b - a;
    let middle = -a.dot(d) / d.length_squared();
    let half2 = (radius * radius - (a + d * middle).length_squared()) / d.length_squared();
    let half = half2.sqrt(); // NaN if the segment's line misses the disk
    let (from, to) = ((middle - half).max(0.0), (middle + half).min(1.0));
    (half2 > 0.0 && from < to).then_some([from, to])
}

/// Projects an edge, clipped to the space in front of the camera (and of the mirror) and to the film.
pub fn clip(viewpoint: &Viewpoint, edge: &Edge) -> Option<Piece> {
    let [first, last] = viewpoint.camera.seen_film().map(Vec2::as_dvec2);
    let (whole, _) = clip_to_front(viewpoint, edge)?;
    let (a, b) = (whole.a, whole.b);
    // Liang-Barsky against the film.
    let (mut t0, mut t1) = (0.0f64, 1.0f64);
    let d = b - a;
    for (p, q) in [(-d.x, a.x - first.x), (d.x, last.x - a.x), (-d.y, a.y - first.y), (d.y, last.y - a.y)] {
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

/// Projects the part of an edge in front of the camera (and of the mirror). Returns the depths of its ends too.
pub fn clip_to_front(viewpoint: &Viewpoint, edge: &Edge) -> Option<(Piece, [f64; 2])> {
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
        let size = camera.film_size().as_dvec2();
        DVec2::new((x + 1.0) * 0.5 * size.x, (1.0 - y) * 0.5 * size.y)
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
        // For cameras that bend lines, `sa` and `sb` themselves are the parameters of the ends.
        assert_eq!((reversed.sa, reversed.sb), (piece.sb, piece.sa));
    }
}
