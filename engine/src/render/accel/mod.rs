//! Ray queries: a bounding volume hierarchy with eight child boxes a node and a watertight triangle test. A query can skip
//! primitives by their ids.
//!
//! Edge sampling sends rays along edges that two triangles share. So the triangle test is watertight without enlarging any
//! triangle: of two neighbours, a ray through their common edge hits at least one. The traversal (`traverse`) is written once,
//! generic over SIMD lanes: `avx2` is chosen at run time where the processor has it, `portable` elsewhere. Both return the same bits.

#[cfg(target_arch = "x86_64")]
#[allow(unsafe_code)]
mod avx2;
mod pairs;
mod portable;
mod traverse;
mod tree;

#[cfg(test)]
mod tests;

use glam::Vec3;

pub use traverse::RootHits;
use tree::Tree;

/// Index of a triangle over all shapes of a scene.
pub type PrimId = u32;

/// Stands for "no primitive". In a list of primitives to skip it skips nothing.
pub const NO_PRIM: PrimId = u32::MAX;

/// A refitted tree is rebuilt once an average ray costs more than this many times what it cost when the tree was built.
const REBUILD_RATIO: f32 = 1.3;

/// A ray query. `dir` is a unit vector. Only hits with `t_min` ≤ t < `t_max` count; `t_min` is not negative.
#[derive(Clone, Copy, Debug)]
pub struct Ray {
    /// Where it begins.
    pub origin: Vec3,
    /// Where it goes, of length 1.
    pub dir: Vec3,
    /// The least distance at which a hit counts.
    pub t_min: f32,
    /// The distance from which on no hit counts.
    pub t_max: f32,
}

impl Ray {
    /// A ray of endless length that begins at `origin`; `dir` is a unit vector.
    pub fn new(origin: Vec3, dir: Vec3) -> Ray {
        Ray { origin, dir, t_min: 0.0, t_max: f32::INFINITY }
    }
}

/// A hit of a ray with a triangle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Its distance along the ray.
    pub t: f32,
    /// The triangle that was hit.
    pub prim: PrimId,
    /// Barycentric coordinates of the triangle's three vertices.
    pub b: [f32; 3],
}

impl Hit {
    /// The result of a query that hits nothing.
    pub const NONE: Hit = Hit { t: f32::INFINITY, prim: NO_PRIM, b: [0.0; 3] };

    /// `None` for [`Hit::NONE`].
    #[inline(always)]
    pub fn found(self) -> Option<Hit> {
        (self.prim != NO_PRIM).then_some(self)
    }
}

/// The acceleration structure of one scene.
#[derive(Clone)]
pub struct Accel {
    tree: Tree,
    instructions: Instructions,
    /// Number of triangles given to [`Accel::new`].
    count: usize,
    /// Those of them without area. They are not in the tree: no ray hits them, and many of them in one place make a poor tree.
    degenerate: Vec<PrimId>,
    /// Cost of the tree ([`Tree::cost`]) when it was built.
    cost: f64,
}

/// A loop that makes many ray queries. It is compiled once for each set of instructions, so that AVX2's queries are inlined into it.
pub trait Kernel {
    /// Mark this and the functions that it calls `#[inline(always)]`: only inlined code is compiled with those instructions.
    fn run(self);
}

#[derive(Clone, Copy)]
enum Instructions {
    #[cfg(target_arch = "x86_64")]
    Avx2(avx2::Avx2),
    Portable,
}

/// The processor's instructions by which rays are traced here.
pub fn instructions() -> &'static str {
    match Instructions::best() {
        #[cfg(target_arch = "x86_64")]
        Instructions::Avx2(avx2) => avx2.name(),
        Instructions::Portable => "portable code",
    }
}

impl Accel {
    /// Builds a tree over triangles given by their corners, whose coordinates must be finite.
    pub fn new(corners: &[[Vec3; 3]]) -> Accel {
        let ids = 0..corners.len() as PrimId;
        let (prims, degenerate): (Vec<PrimId>, Vec<PrimId>) = ids.partition(|&i| has_area(&corners[i as usize]));
        let tree = Tree::new(corners, &prims);
        let cost = tree.cost();
        Accel { tree, instructions: Instructions::best(), count: corners.len(), degenerate, cost }
    }

    /// Moves the triangles and updates the tree's boxes, which takes a fraction of the time of a new tree. Returns the cost of an
    /// average ray over its cost when the tree was built: 1 if nothing changed. The tree is rebuilt if the number of triangles
    /// differs, or if a triangle that had no area now has one.
    pub fn refit(&mut self, corners: &[[Vec3; 3]]) -> f32 {
        if corners.len() != self.count || self.degenerate.iter().any(|&i| has_area(&corners[i as usize])) {
            *self = Accel::new(corners);
            return 1.0;
        }
        if self.tree.nodes.is_empty() {
            return 1.0;
        }
        self.tree.refit(corners);
        (self.tree.cost() / self.cost) as f32
    }

    /// [`Accel::refit`], but rebuilds the tree if rays have become much slower (`REBUILD_RATIO`).
    pub fn refit_or_rebuild(&mut self, corners: &[[Vec3; 3]]) {
        if self.refit(corners) > REBUILD_RATIO {
            *self = Accel::new(corners);
        }
    }

    /// Runs a kernel that was compiled with the same instructions as the queries.
    pub fn run(&self, kernel: impl Kernel) {
        match self.instructions {
            #[cfg(target_arch = "x86_64")]
            Instructions::Avx2(avx2) => avx2.run(kernel),
            Instructions::Portable => kernel.run(),
        }
    }

    /// The closest hit whose primitive is not in `skip`. Of hits at the same distance, the one with the lowest primitive id.
    #[inline]
    pub fn closest(&self, ray: &Ray, skip: &[PrimId]) -> Option<Hit> {
        self.closest_from(ray, None, skip).found()
    }

    /// Intersects a ray with the root's boxes. This has no branches that are hard to predict, so that a processor can overlap the tests
    /// of many rays if they are made one after the other.
    #[inline(always)]
    pub fn intersect_root(&self, ray: &Ray) -> RootHits {
        if self.tree.nodes.is_empty() || !is_finite(ray) {
            return RootHits::default();
        }
        match self.instructions {
            #[cfg(target_arch = "x86_64")]
            Instructions::Avx2(avx2) => avx2.intersect_root(&self.tree, ray),
            Instructions::Portable => portable::intersect_root(&self.tree, ray),
        }
    }

    /// [`Accel::closest`], but [`Hit::NONE`] where nothing is hit. Takes the result of [`Accel::intersect_root`] if it is known.
    #[inline(always)]
    pub fn closest_from(&self, ray: &Ray, root: Option<&RootHits>, skip: &[PrimId]) -> Hit {
        // A ray whose root test is known is finite, or hits none of the root's boxes.
        if root.is_none() && (self.tree.nodes.is_empty() || !is_finite(ray)) {
            return Hit::NONE;
        }
        match self.instructions {
            #[cfg(target_arch = "x86_64")]
            Instructions::Avx2(avx2) => avx2.closest(&self.tree, ray, root, skip),
            Instructions::Portable => portable::closest(&self.tree, ray, root, skip),
        }
    }

    /// Whether the ray hits any primitive that is not in `skip`. A ray that is not finite counts as occluded.
    #[inline]
    pub fn occluded(&self, ray: &Ray, skip: &[PrimId]) -> bool {
        self.occluded_from(ray, None, skip)
    }

    /// [`Accel::occluded`]. Takes the result of [`Accel::intersect_root`] if it is known.
    #[inline(always)]
    pub fn occluded_from(&self, ray: &Ray, root: Option<&RootHits>, skip: &[PrimId]) -> bool {
        if self.tree.nodes.is_empty() {
            return false;
        }
        if !is_finite(ray) {
            return true;
        }
        match self.instructions {
            #[cfg(target_arch = "x86_64")]
            Instructions::Avx2(avx2) => avx2.any(&self.tree, ray, root, skip),
            Instructions::Portable => portable::any(&self.tree, ray, root, skip),
        }
    }
}

impl Instructions {
    fn best() -> Instructions {
        #[cfg(target_arch = "x86_64")]
        if let Some(avx2) = avx2::Avx2::detect() {
            return Instructions::Avx2(avx2);
        }
        Instructions::Portable
    }
}

/// Whether a ray's origin and direction are finite numbers.
#[inline]
fn is_finite(ray: &Ray) -> bool {
    (ray.origin.abs() + ray.dir.abs()).element_sum() < f32::INFINITY
}

fn has_area([a, b, c]: &[Vec3; 3]) -> bool {
    let (a, b, c) = (a.as_dvec3(), b.as_dvec3(), c.as_dvec3());
    (b - a).cross(c - a).length() > 1e-30
}
