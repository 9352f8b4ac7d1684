//! Primary edges through a lens: where on film an edge may appear, from any point of the lens.
//!
//! Each sample has a lens point of its own and sees through a pinhole camera there (`render::sensor`), so that only the
//! choice of the edge point is special: pieces are cut by how far the edge is blurred, and none is left out whose blur
//! reaches the film.

use glam::{DVec2, Vec2};

use super::pieces::{EdgeClass, MAX_PIECE_LENGTH, Piece, classify, clip_to_front};
use crate::grad::mirrors::viewpoint::Viewpoint;
use crate::image::Image;
use crate::render::edges::Edge;
use crate::render::{Lens, Projection, Settings};

/// A square around the lens, in radii.
const CORNERS: [Vec2; 4] = [Vec2::new(-1.0, -1.0), Vec2::new(1.0, -1.0), Vec2::new(1.0, 1.0), Vec2::new(-1.0, 1.0)];

/// Kind of an edge; `None` if nothing can jump there for any point of the lens.
pub fn classify_through_lens(viewpoint: &Viewpoint, edge: &Edge, settings: &Settings) -> Option<EdgeClass> {
    let p = edge.point(0.5);
    let along = (edge.p[1] - edge.p[0]).as_dvec3();
    // Sides of all faces' planes: where the corners agree, so does all of the lens.
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

/// Pieces of an edge by its own parameter.
pub fn blurred(viewpoint: &Viewpoint, edge: &Edge) -> Vec<Piece> {
    /// Shortest part of an edge's length on film that is cut again.
    const LEAST: f64 = 1e-4;
    let camera = &viewpoint.camera;
    let Some((whole, [z0, z1])) = clip_to_front(viewpoint, edge) else { return Vec::new() };
    let perspective = camera.projection == Projection::Perspective;
    // Along the line on film 1/depth is linear (and so is the blur, but for its sign), without perspective the depth.
    let depth = |t: f64| if perspective { 1.0 / ((1.0 - t) / z0 + t / z1) } else { (1.0 - t) * z0 + t * z1 };
    let size = DVec2::new(camera.width as f64, camera.height as f64);
    let mut pieces = Vec::new();
    let mut rest = vec![(0.0, 1.0)];
    while let Some((from, to)) = rest.pop() {
        let part = whole.part(from, to);
        let blur = camera.blur_radius(depth(from)).max(camera.blur_radius(depth(to))) + 1.0;
        let piece = Piece { sa: whole.parameter(from), sb: whole.parameter(to), ta: 0.0, tb: 1.0, blur, ..part };
        if piece.share_on_film(size) <= 0.0 {
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
    /// Corners of the box in which any point of the lens may see the piece.
    fn reach(&self) -> [DVec2; 2] {
        [self.a.min(self.b) - self.blur, self.a.max(self.b) + self.blur]
    }

    /// How much of what the lens shows of the piece falls on the film: all of it where nothing is blurred.
    pub fn share_on_film(&self, size: DVec2) -> f64 {
        if self.blur == 0.0 {
            return 1.0;
        }
        let [lo, hi] = self.reach();
        let shared = (hi.min(size) - lo.max(DVec2::ZERO)).max(DVec2::ZERO);
        let share = shared / (hi - lo);
        share.x * share.y
    }

    /// Mean magnitude of the adjoint image around a blurred piece, where it is on film.
    pub fn blurred_weight(&self, image: &Image) -> f64 {
        const MOST: f64 = 16.0;
        let size = DVec2::new(image.width as f64, image.height as f64);
        let [lo, hi] = self.reach();
        let (lo, hi) = (lo.max(DVec2::ZERO), hi.min(size));
        let [columns, rows] = (hi - lo).ceil().clamp(DVec2::ONE, DVec2::splat(MOST)).to_array().map(|n| n as usize);
        let mut sum = 0.0;
        for i in 0..rows * columns {
            let at = DVec2::new((i % columns) as f64 + 0.5, (i / columns) as f64 + 0.5);
            let p = lo + (hi - lo) * at / DVec2::new(columns as f64, rows as f64);
            let (x, y) = ((p.x as usize).min(image.width - 1), (p.y as usize).min(image.height - 1));
            sum += image.pixel(x, y).iter().map(|v| f64::from(v.abs())).sum::<f64>();
        }
        sum / (rows * columns) as f64
    }
}
