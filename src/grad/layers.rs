//! What masked faces at an edge cover: on either side of an edge a line of sight crosses all faces of that side or none.

use crate::render::Scene;
use crate::render::edges::{Edge, EdgeView, INSIDE};
use crate::render::sampler::Sampler;
use glam::Vec3;

/// What a boundary sample compares, times `scale`: the faces it looks at on either side, or past the edge.
#[derive(Clone, Copy, Debug)]
pub struct Sides {
    pub near: Option<usize>,
    pub far: Option<usize>,
    pub scale: f32,
}

impl Sides {
    /// By a toss of a coin where faces are masked, the same for both sides: past the edge both see the same, so only where one of
    /// them is covered is of interest. `None` if nothing covers anything.
    pub fn choose(
        scene: &Scene,
        edge: &Edge,
        dir: Vec3,
        view: &EdgeView,
        s: f32,
        sampler: &mut Sampler,
    ) -> Option<Sides> {
        if !has_masks(scene, edge) {
            return Some(Sides { near: Some(view.foreground), far: view.background, scale: 1.0 });
        }
        let near = layers(scene, edge, dir, view, Some(view.foreground), s);
        let far = layers(scene, edge, dir, view, view.background, s);
        let scale = cover(&near).max(cover(&far));
        let u = sampler.next_1d() * scale;
        let at = |layers: &[(usize, f32)]| layers.iter().find(|&&(_, covered)| u < covered).map(|l| l.0);
        (scale > 0.0).then(|| Sides { near: at(&near), far: at(&far), scale })
    }
}

/// How much more the faces on the covering side of an edge cover than those on the other: 1 for an opaque contour, 0 where opaque
/// faces are on both sides.
pub fn contrast(scene: &Scene, edge: &Edge, dir: Vec3, view: &EdgeView, s: f32) -> f32 {
    if !has_masks(scene, edge) {
        return if view.background.is_some() { 0.0 } else { 1.0 };
    }
    let covered = |face: Option<usize>| cover(&layers(scene, edge, dir, view, face, s));
    covered(Some(view.foreground)) - covered(view.background)
}

pub fn has_masks(scene: &Scene, edge: &Edge) -> bool {
    scene.masked && edge.faces.iter().any(|f| scene.opacity(f.prim, [1.0, 0.0, 0.0]).is_some())
}

/// The faces on one side, nearest first, each with what is covered by it and those before it.
fn layers(scene: &Scene, edge: &Edge, dir: Vec3, view: &EdgeView, first: Option<usize>, s: f32) -> Vec<(usize, f32)> {
    let Some(first) = first else { return Vec::new() };
    let mut open = 1.0;
    let mut cover = |i: usize| {
        open *= 1.0 - scene.opacity(edge.faces[i].prim, edge.barycentric(i, s, INSIDE)).unwrap_or(1.0);
        (i, 1.0 - open)
    };
    edge.layers(dir, view, first).into_iter().map(&mut cover).collect()
}

fn cover(layers: &[(usize, f32)]) -> f32 {
    layers.last().map_or(0.0, |l| l.1)
}
