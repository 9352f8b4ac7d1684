//! Boundary term at path vertices: what a shading point sees behind an edge, reflected radiance on both sides and the
//! environment.
//!
//! Receiver-first, one vertex a path: choose a vertex x, an edge point p for it, and add
//! sinφ/|q|² f cosθ (L_fg − L_bg) N̂·(ṗ − ẋ) ((E) of `algorithms.md` with direction-fixed radiance on both sides). The part
//! that moves x enters the backward sweep of the very path. Emission of area lights is material-fixed and not seen
//! here: its boundary is [`super::shadow`]'s.

use glam::Vec3;

use super::edge_tree::{EdgeTree, Query};
use super::edges::EdgeTable;
use super::interior::Path;
use super::primary::inset;
use crate::render::Scene;
use crate::render::accel::{PrimId, Ray};
use crate::render::integrator::{NoRecord, Options, Start, trace};
use crate::render::sampler::Sampler;

/// Angle between an edge and the ray that looks past it.
const NUDGE: f32 = 2e-5;

/// Receiver-first sampling for the paths of one pass.
pub struct Secondary<'a> {
    scene: &'a Scene,
    table: &'a EdgeTable,
    tree: EdgeTree,
    max_bounces: u32,
    /// Probability that a path gets a boundary sample.
    rate: f32,
}

/// A boundary sample of a path: with pixel adjoint d the contribution is (d·weight) N̂·(ṗ − ẋ).
#[derive(Clone, Copy, Debug)]
pub struct SecondarySample {
    /// Index of the path vertex x.
    pub vertex: usize,
    pub edge: usize,
    pub foreground: usize,
    pub s: f32,
    pub normal: Vec3,
    pub weight: Vec3,
}

impl<'a> Secondary<'a> {
    /// `None` if no path vertex can see anything but lights.
    pub fn new(scene: &'a Scene, max_bounces: u32) -> Option<Secondary<'a>> {
        let reach = if scene.environment.is_some() { 1 } else { 2 };
        let table = scene.edges();
        (max_bounces >= reach && !table.edges.is_empty()).then(|| Secondary {
            scene,
            table,
            tree: EdgeTree::new(table),
            max_bounces,
            rate: 1.0,
        })
    }

    /// One sample for a recorded path.
    pub fn sample(&self, path: &Path, sampler: &mut Sampler) -> Option<SecondarySample> {
        let u = sampler.next_3d();
        let mut u_choice = sampler.next_1d();
        if u_choice >= self.rate {
            return None;
        }
        u_choice /= self.rate;

        // Choose a vertex with probability proportional to what it passes on.
        let events_left = |k: usize| self.max_bounces.saturating_sub(k as u32 + 1);
        let least = u32::from(self.scene.environment.is_none());
        let weight = |k: usize| {
            let v = &path.vertices[k];
            let useless = v.si.bsdf.is_black() || v.si.bsdf.is_delta() || k as u32 >= self.max_bounces;
            if useless || events_left(k) < least { 0.0 } else { v.throughput.max_element().max(1e-3) }
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

        let point = self.tree.sample(self.table, &Query::new(si), u[0], u[1])?;
        let edge = &self.table.edges[point.edge];
        let p = edge.point(point.s);
        let q = p - si.p;
        let distance = q.length();
        let dir = q / distance;
        let f = si.eval(dir);
        if f == Vec3::ZERO || si.ng.dot(dir) <= 0.0 {
            return None;
        }
        let view = edge.view(dir)?;
        if view.background.is_some() && !edge.sharp {
            return None;
        }
        let mut skip: Vec<PrimId> = edge.prims();
        skip.push(si.prim);
        let mut to_edge = si.spawn_ray(dir);
        to_edge.t_max = distance * (1.0 - 2e-5);
        if self.scene.accel.occluded(&to_edge, &skip) {
            return None;
        }

        let options = Options { first_emission: false, ..Options::new(events_left(k)) };
        let face = |i: usize, sampler: &mut Sampler| {
            let b = edge.barycentric(i, point.s, inset(edge, i, distance));
            let si = self.scene.interaction(edge.faces[i].prim, b, -dir);
            trace(self.scene, Start::Surface(si), sampler, &options, &mut NoRecord)
        };
        let foreground = face(view.foreground, &mut sampler.clone());
        let background = match view.background {
            Some(i) => face(i, &mut sampler.clone()),
            None => {
                let past = Ray { dir: (dir + view.normal * NUDGE).normalize(), ..si.spawn_ray(dir) };
                trace(self.scene, Start::Ray(past, &skip), &mut sampler.clone(), &options, &mut NoRecord)
            }
        };
        let sin_phi = edge.direction().cross(dir).length();
        let pdf = point.pdf * self.rate * weight(k) / total;
        let weight = vertex.throughput * f * (foreground - background) * (sin_phi / (distance * distance * pdf));
        (weight != Vec3::ZERO && weight.is_finite()).then_some(SecondarySample {
            vertex: k,
            edge: point.edge,
            foreground: view.foreground,
            s: point.s,
            normal: view.normal,
            weight,
        })
    }

    /// Shape and vertices that move with an edge's foreground face.
    pub fn edge_vertices(&self, sample: &SecondarySample) -> (u32, [u32; 2]) {
        let face = &self.table.edges[sample.edge].faces[sample.foreground];
        (face.shape, face.v)
    }
}
