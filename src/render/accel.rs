//! Ray queries: obvhs's compressed wide BVH with a watertight triangle test and skipping by primitive id.
//!
//! Edge sampling sends rays that graze shared edges, so neighbouring triangles must agree about which of them an edge ray
//! hits: the Plücker edge functions below give the same value up to sign for both (Davis & Wald 2016, as in Embree's
//! robust mode), except that no tolerance is added: triangles are never enlarged.

use glam::{Vec3, Vec3A};
use obvhs::aabb::Aabb;
use obvhs::bvh2::reinsertion::ReinsertionOptimizer;
use obvhs::cwbvh::CwBvh;
use obvhs::cwbvh::bvh2_to_cwbvh::bvh2_to_cwbvh;
use obvhs::ploc::PlocBuilder;
use obvhs::ray::{Ray as ObvhsRay, RayHit};
use obvhs::triangle::Triangle;
use obvhs::{Boundable, BvhBuildParams};

/// Index of a triangle over all shapes of a scene.
pub type PrimId = u32;

/// "No primitive": skips nothing.
pub const NO_PRIM: PrimId = u32::MAX;

/// Levels of nodes that obvhs's traversal has room for.
const MAX_DEPTH: usize = 31;

/// A ray query. `dir` is a unit vector; hits closer than `t_min` or not before `t_max` do not count.
#[derive(Clone, Copy, Debug)]
pub struct Ray {
    pub origin: Vec3,
    pub dir: Vec3,
    pub t_min: f32,
    pub t_max: f32,
}

impl Ray {
    pub fn new(origin: Vec3, dir: Vec3) -> Ray {
        Ray { origin, dir, t_min: 0.0, t_max: f32::INFINITY }
    }
}

/// The closest hit: where on which triangle.
#[derive(Clone, Copy, Debug)]
pub struct Hit {
    pub t: f32,
    pub prim: PrimId,
    /// Barycentric coordinates of the triangle's three vertices.
    pub b: [f32; 3],
}

#[derive(Clone, Copy)]
struct Tri {
    v: [Vec3A; 3],
    prim: PrimId,
}

/// The acceleration structure of one scene.
pub struct Accel {
    bvh: Option<CwBvh>,
    /// In leaf order.
    tris: Vec<Tri>,
}

impl Accel {
    /// Builds over triangles given by their corners; finite coordinates are the caller's duty.
    pub fn new(corners: &[[Vec3; 3]]) -> Accel {
        if corners.is_empty() {
            return Accel { bvh: None, tris: Vec::new() };
        }
        // Triangles without area are never hit, and many of them in one place make a tree like a chain.
        let (prims, triangles): (Vec<PrimId>, Vec<Triangle>) = (0..)
            .zip(corners)
            .filter(|(_, t)| has_area(t))
            .map(|(i, t)| (i, Triangle { v0: t[0].into(), v1: t[1].into(), v2: t[2].into() }))
            .unzip();
        if triangles.is_empty() {
            return Accel { bvh: None, tris: Vec::new() };
        }
        let bvh = build(&triangles);
        let tris = bvh
            .primitive_indices
            .iter()
            .map(|&i| {
                let t = &triangles[i as usize];
                Tri { v: [t.v0, t.v1, t.v2], prim: prims[i as usize] }
            })
            .collect();
        Accel { bvh: Some(bvh), tris }
    }

    /// The closest hit whose primitive is not in `skip`.
    pub fn closest(&self, ray: &Ray, skip: &[PrimId]) -> Option<Hit> {
        let bvh = self.bvh.as_ref().filter(|_| is_finite(ray))?;
        let mut best_b = [0.0; 3];
        let mut hit = RayHit::none();
        let found = bvh.ray_traverse(to_obvhs(ray), &mut hit, |r, i| {
            let tri = &self.tris[i];
            match intersect(tri, r) {
                Some((t, b)) if !skip.contains(&tri.prim) => {
                    best_b = b;
                    t
                }
                _ => f32::INFINITY,
            }
        });
        found.then(|| Hit { t: hit.t, prim: self.tris[hit.primitive_id as usize].prim, b: best_b })
    }

    /// Whether anything not in `skip` lies on the ray. Nothing is seen along a ray that is not finite.
    pub fn occluded(&self, ray: &Ray, skip: &[PrimId]) -> bool {
        let Some(bvh) = self.bvh.as_ref() else { return false };
        if !is_finite(ray) {
            return true;
        }
        !bvh.ray_traverse_miss(to_obvhs(ray), |r, i| {
            let tri = &self.tris[i];
            match intersect(tri, r) {
                Some((t, _)) if !skip.contains(&tri.prim) => t,
                _ => f32::INFINITY,
            }
        })
    }
}

/// Positions of the order of 1e19 and more overflow in the arithmetic of single precision.
fn is_finite(ray: &Ray) -> bool {
    ray.origin.is_finite() && ray.dir.is_finite()
}

fn has_area([a, b, c]: &[Vec3; 3]) -> bool {
    let (a, b, c) = (a.as_dvec3(), b.as_dvec3(), c.as_dvec3());
    (b - a).cross(c - a).length() > 1e-30
}

/// What obvhs calls a medium build. Its builder is not called itself because in debug builds that panics over a tree deeper
/// than the traversal's stack, and in release builds the traversal would lose parts of it.
fn build(triangles: &[Triangle]) -> CwBvh {
    let params = BvhBuildParams::medium_build();
    let mut boxes: Vec<Aabb> = triangles.iter().map(Boundable::aabb).collect();
    let make = |boxes: &[Aabb]| {
        let mut tree = PlocBuilder::with_capacity(boxes.len()).build(
            params.ploc_search_distance,
            boxes,
            (0..boxes.len() as u32).collect(),
            params.sort_precision,
            params.search_depth_threshold,
        );
        ReinsertionOptimizer::default().run(&mut tree, params.reinsertion_batch_ratio, None);
        bvh2_to_cwbvh(&tree, params.max_prims_per_leaf.clamp(1, 3), true, false)
    };
    let tree = make(&boxes);
    if depth(&tree) < MAX_DEPTH {
        return tree;
    }
    // Boxes in one place are all equally near to each other, which makes a chain. Larger ones, each in its own way, are not.
    for (i, b) in boxes.iter_mut().enumerate() {
        let share = (i as u32).wrapping_mul(0x9E37_79B9) as f32 / u32::MAX as f32;
        let margin = 0.01 * b.diagonal().max_element();
        b.min -= Vec3A::splat(margin * share);
        b.max += Vec3A::splat(margin * (1.0 - share));
    }
    make(&boxes)
}

/// Levels of nodes.
fn depth(bvh: &CwBvh) -> usize {
    let mut deepest = 0;
    let mut pending = vec![(0usize, 1usize)];
    while let Some((index, level)) = pending.pop() {
        let Some(node) = bvh.nodes.get(index) else { continue };
        deepest = deepest.max(level);
        let children = node.imask.count_ones() as usize;
        pending.extend((0..children).map(|k| (node.child_base_idx as usize + k, level + 1)));
    }
    deepest
}

fn to_obvhs(ray: &Ray) -> ObvhsRay {
    // Adding zero turns −0 into +0: obvhs takes a component's sign from a comparison but its inverse from the sign bit,
    // and misses everything if the two differ.
    ObvhsRay::new(ray.origin.into(), (ray.dir + Vec3::ZERO).into(), ray.t_min, ray.t_max)
}

/// Watertight ray-triangle test; `None` unless `t_min <= t < t_max` of the ray.
#[inline(always)]
fn intersect(tri: &Tri, ray: &ObvhsRay) -> Option<(f32, [f32; 3])> {
    let d = ray.direction;
    let a = tri.v[0] - ray.origin;
    let b = tri.v[1] - ray.origin;
    let c = tri.v[2] - ray.origin;
    // Plücker products of the ray with the edges opposite to a, b, c: (p − q) × (p + q) · d changes only its sign
    // when p and q swap.
    let u = (c - b).cross(c + b).dot(d);
    let v = (a - c).cross(a + c).dot(d);
    let w = (b - a).cross(b + a).dot(d);
    let inside = (u >= 0.0 && v >= 0.0 && w >= 0.0) || (u <= 0.0 && v <= 0.0 && w <= 0.0);
    if !inside {
        return None;
    }
    let n = (b - a).cross(c - a);
    let den = n.dot(d);
    let sum = u + v + w;
    if den == 0.0 || sum == 0.0 {
        return None;
    }
    let t = n.dot(a) / den;
    if !(t >= ray.tmin && t < ray.tmax) {
        return None;
    }
    let inv = 1.0 / sum;
    Some((t, [u * inv, v * inv, w * inv]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Pcg32;

    fn random_vec(rng: &mut Pcg32) -> Vec3 {
        Vec3::new(rng.next_f32(), rng.next_f32(), rng.next_f32()) * 2.0 - 1.0
    }

    #[test]
    fn heaps_of_triangles_in_one_place_do_not_make_a_chain() {
        for size in [1.0f32, 1e-12, 1e-25, 0.0] {
            let one = [Vec3::ZERO, Vec3::X * size, Vec3::Y * size];
            let mut corners = vec![one; 2000];
            corners.push([vec3_at(-9.0), vec3_at(-9.0) + Vec3::X, vec3_at(-9.0) + Vec3::Y]);
            let accel = Accel::new(&corners);
            assert!(depth(accel.bvh.as_ref().unwrap()) < MAX_DEPTH, "size {size}");
            let hit = accel.closest(&Ray::new(Vec3::new(0.2, 0.2, -20.0), Vec3::Z), &[]).unwrap();
            assert_eq!(hit.prim, 2000, "size {size}");
        }
    }

    fn vec3_at(z: f32) -> Vec3 {
        Vec3::new(0.0, 0.0, z)
    }

    #[test]
    fn agrees_with_brute_force() {
        let mut rng = Pcg32::new(7);
        let corners: Vec<[Vec3; 3]> = (0..200)
            .map(|_| {
                let p = random_vec(&mut rng);
                [p, p + 0.3 * random_vec(&mut rng), p + 0.3 * random_vec(&mut rng)]
            })
            .collect();
        let accel = Accel::new(&corners);
        let mut hits = 0;
        for _ in 0..2000 {
            let ray = Ray::new(2.0 * random_vec(&mut rng), random_vec(&mut rng).normalize());
            let skip = [(rng.next_f32() * 200.0) as u32];
            let brute = (0..200u32)
                .filter(|i| !skip.contains(i))
                .filter_map(|i| {
                    let v = corners[i as usize].map(Vec3A::from);
                    intersect(&Tri { v, prim: i }, &to_obvhs(&ray)).map(|(t, _)| (t, i))
                })
                .min_by(|a, b| a.0.total_cmp(&b.0));
            let hit = accel.closest(&ray, &skip);
            assert_eq!(hit.map(|h| h.prim), brute.map(|b| b.1));
            assert_eq!(accel.occluded(&ray, &skip), brute.is_some());
            if let Some(h) = hit {
                hits += 1;
                let v = corners[h.prim as usize];
                let p = v[0] * h.b[0] + v[1] * h.b[1] + v[2] * h.b[2];
                assert!(p.distance(ray.origin + ray.dir * h.t) < 1e-4);
            }
        }
        assert!(hits > 100, "{hits}");
    }

    #[test]
    fn no_gap_at_shared_edges() {
        // A fan of slivers: rays at points of the shared edges must hit one of the two neighbours.
        let mut rng = Pcg32::new(3);
        let n = 64;
        let rim: Vec<Vec3> = (0..n)
            .map(|i| {
                let a = i as f32 / n as f32 * std::f32::consts::TAU;
                Vec3::new(a.cos(), a.sin(), 0.1 * (3.0 * a).sin())
            })
            .collect();
        let centre = Vec3::new(0.03, -0.02, 0.3);
        let corners: Vec<[Vec3; 3]> = (0..n).map(|i| [centre, rim[i], rim[(i + 1) % n]]).collect();
        let accel = Accel::new(&corners);
        for _ in 0..20000 {
            let i = (rng.next_f32() * n as f32) as usize % n;
            let target = centre.lerp(rim[i], 0.01 + 0.98 * rng.next_f32());
            let origin = Vec3::new(0.2 * rng.next_f32(), 0.2 * rng.next_f32(), 5.0);
            assert!(accel.closest(&Ray::new(origin, (target - origin).normalize()), &[]).is_some());
        }
    }

    #[test]
    fn rays_along_an_axis_hit_whatever_the_sign_of_their_zeros() {
        let accel = Accel::new(&[[Vec3::ZERO, Vec3::X, Vec3::Y].map(|p| p - Vec3::Z)]);
        for x in [0.0, -0.0] {
            for y in [0.0, -0.0] {
                let ray = Ray::new(Vec3::new(0.2, 0.2, 0.0), Vec3::new(x, y, -1.0));
                assert!(accel.closest(&ray, &[]).is_some() && accel.occluded(&ray, &[]), "{:?}", ray.dir);
            }
        }
    }
}
