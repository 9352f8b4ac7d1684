//! Coverage of masked faces at an edge: on either side of the edge, a line of sight crosses all faces of that side or none.

use crate::render::Scene;
use crate::render::edges::{Edge, EdgeView, INSIDE};
use crate::render::sampler::Sampler;
use glam::Vec3;

/// The two sides whose radiances a boundary sample subtracts, and the factor `scale` on the difference: a face of the edge on either
/// side, or the scene past the edge.
#[derive(Clone, Copy, Debug)]
pub struct Sides {
    pub near: Option<usize>,
    pub far: Option<usize>,
    pub scale: f32,
}

impl Sides {
    /// Chooses the faces. Where faces are masked, one random number decides on both sides whether the line of sight is covered. Where
    /// neither side is covered both see the same past the edge, so only cases in which one is covered are sampled. `None` if nothing
    /// covers anything.
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

/// The coverage of the faces on the covering side of an edge minus that on the other side: 1 for an opaque contour, 0 if both sides have
/// opaque faces.
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

/// The faces on one side, the nearest first, each with the coverage of it and those before it.
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
