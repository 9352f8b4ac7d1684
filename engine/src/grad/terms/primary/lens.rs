//! Primary edges for cameras with a lens: the region of the film in which an edge may appear from any point of the lens.
//!
//! Each sample has its own lens point and its own pinhole camera there (`render::sensor`), so only the choice of the edge point is
//! special. Pieces are cut by how much the edge is blurred, and all pieces whose blur reaches the film are kept.

use glam::{DVec2, Vec2};

use super::pieces::{EdgeClass, MAX_PIECE_LENGTH, Piece, classify, clip_to_front};
use crate::grad::mirrors::viewpoint::Viewpoint;
use crate::grad::sampling::pixels::magnitude_at;
use crate::image::Image;
use crate::render::edges::Edge;
use crate::render::{Camera, Lens, Projection, Settings};

/// Corners of a square around the lens, in radii.
const CORNERS: [Vec2; 4] = [Vec2::new(-1.0, -1.0), Vec2::new(1.0, -1.0), Vec2::new(1.0, 1.0), Vec2::new(-1.0, 1.0)];

/// Classifies an edge; `None` if the image cannot be discontinuous there for any point of the lens.
pub fn classify_through_lens(viewpoint: &Viewpoint, edge: &Edge, settings: &Settings) -> Option<EdgeClass> {
    let p = edge.point(0.5);
    let along = (edge.p[1] - edge.p[0]).as_dvec3();
    // On which side of all faces' planes the lens lies: if the corners of the square agree, so do all points of the lens.
    let sides = |point: Vec2| {
        let lens = Lens { point, ..viewpoint.camera.lens };
        let dir = viewpoint.through(lens).direction_to(p).as_dvec3();
        edge.faces.iter().map(move |f| along.cross((f.opposite - edge.p[0]).as_dvec3()).dot(dir) > 0.0)
    };
    if CORNERS[1..].iter().any(|&c| sides(c).ne(sides(CORNERS[0]))) {
        return Some(EdgeClass { weight: 1.0, contour: true });
    }
    classify(viewpoint, edge, settings)
}

/// Pieces of an edge, sampled uniformly by the edge parameter.
pub fn blurred(viewpoint: &Viewpoint, edge: &Edge) -> Vec<Piece> {
    /// Pieces shorter than this fraction of the edge's length on film are not cut again.
    const LEAST: f64 = 1e-4;
    let camera = &viewpoint.camera;
    let Some((whole, [z0, z1])) = clip_to_front(viewpoint, edge) else { return Vec::new() };
    let perspective = camera.projection == Projection::Perspective;
    // With perspective, 1/depth is linear along the edge's image (and so is the blur, up to its sign). Without perspective the depth is.
    let depth = |t: f64| if perspective { 1.0 / ((1.0 - t) / z0 + t / z1) } else { (1.0 - t) * z0 + t * z1 };
    let mut pieces = Vec::new();
    let mut rest = vec![(0.0, 1.0)];
    while let Some((from, to)) = rest.pop() {
        let part = whole.part(from, to);
        let blur = camera.blur_radius(depth(from)).max(camera.blur_radius(depth(to))) + 1.0;
        let piece = Piece { sa: whole.parameter(from), sb: whole.parameter(to), ta: 0.0, tb: 1.0, blur, ..part };
        if piece.share_on_film(camera) <= 0.0 {
            continue;
        }
        if piece.a.distance(piece.b) > blur.max(MAX_PIECE_LENGTH) && to - from > LEAST {
            let middle = 0.5 * (from + to);
            rest.extend([(middle, to), (from, middle)]);
        } else {
            pieces.push(piece);
        }
    }
    pieces
}

impl Piece {
    /// Corners of the bounding box of the piece's images from all points of the lens.
    fn reach(&self) -> [DVec2; 2] {
        [self.a.min(self.b) - self.blur, self.a.max(self.b) + self.blur]
    }

    /// The fraction of the piece's bounding box that lies on the film; 1 without blur.
    pub fn share_on_film(&self, camera: &Camera) -> f64 {
        if self.blur == 0.0 {
            return 1.0;
        }
        let [lo, hi] = self.reach();
        let [first, last] = camera.seen_film().map(Vec2::as_dvec2);
        let shared = (hi.min(last) - lo.max(first)).max(DVec2::ZERO);
        let share = shared / (hi - lo);
        share.x * share.y
    }

    /// Mean magnitude of the adjoint image over the part of a blurred piece's bounding box that lies on the film.
    pub fn blurred_weight(&self, camera: &Camera, image: &Image) -> f64 {
        const MOST: f64 = 16.0;
        let [lo, hi] = self.reach();
        let [first, last] = camera.seen_film().map(Vec2::as_dvec2);
        let (lo, hi) = (lo.max(first), hi.min(last));
        let [columns, rows] = (hi - lo).ceil().clamp(DVec2::ONE, DVec2::splat(MOST)).to_array().map(|n| n as usize);
        let mut sum = 0.0;
        for i in 0..rows * columns {
            let at = DVec2::new((i % columns) as f64 + 0.5, (i / columns) as f64 + 0.5);
            let p = lo + (hi - lo) * at / DVec2::new(columns as f64, rows as f64);
            sum += magnitude_at(camera, image, p.as_vec2());
        }
        sum / (rows * columns) as f64
    }
}
