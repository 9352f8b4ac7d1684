//! Ray queries: a tree of eight boxes a node, with a watertight triangle test and skipping by primitive id.
//!
//! Edge sampling sends rays that graze shared edges, so neighbouring triangles must agree about which of them an edge ray
//! hits; triangles are never enlarged. The walk (`traverse`) is written once over lanes of numbers; `avx2` is chosen at run
//! time where the processor has it, `portable` elsewhere, and both return the same bits.

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

use portable::Portable;
pub use traverse::Root;
use traverse::traverse;
use tree::Tree;

/// Index of a triangle over all shapes of a scene.
pub type PrimId = u32;

/// "No primitive": skips nothing.
pub const NO_PRIM: PrimId = u32::MAX;

/// Once an average ray costs so many times what it did when the tree was built, a new one is worth its time.
const WORN: f32 = 1.3;

/// A ray query. `dir` is a unit vector; hits closer than `t_min` (not negative) or not before `t_max` do not count.
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
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    pub t: f32,
    pub prim: PrimId,
    /// Barycentric coordinates of the triangle's three vertices.
    pub b: [f32; 3],
}

impl Hit {
    /// Stands where there is none.
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
    /// Number of triangles given, and which of them have no area: they are never hit, and many of them in one place make a
    /// poor tree.
    count: usize,
    left_out: Vec<PrimId>,
    /// Of the tree when it was built.
    cost: f64,
}

/// Something that asks so many queries that it is worth being compiled with their instructions, once for each set.
pub trait Work {
    /// To be marked `#[inline(always)]`, as what it calls: only what is inlined is compiled so.
    fn run(self);
}

#[derive(Clone, Copy)]
enum Instructions {
    #[cfg(target_arch = "x86_64")]
    Avx2(avx2::Avx2),
    Portable,
}

impl Accel {
    /// Builds over triangles given by their corners; finite coordinates are the caller's duty.
    pub fn new(corners: &[[Vec3; 3]]) -> Accel {
        let ids = 0..corners.len() as PrimId;
        let (prims, left_out): (Vec<PrimId>, Vec<PrimId>) = ids.partition(|&i| has_area(&corners[i as usize]));
        let tree = Tree::new(corners, &prims);
        let cost = tree.cost();
        Accel { tree, instructions: Instructions::best(), count: corners.len(), left_out, cost }
    }

    /// Moves the triangles without rebuilding the tree, which takes a fraction of the time. Returns how much more an average
    /// ray costs than when the tree was built, 1 if nothing changed. If there are more or fewer triangles than before, or some that
    /// had no area now have one, the tree is built anew.
    pub fn refit(&mut self, corners: &[[Vec3; 3]]) -> f32 {
        if corners.len() != self.count || self.left_out.iter().any(|&i| has_area(&corners[i as usize])) {
            *self = Accel::new(corners);
            return 1.0;
        }
        if self.tree.nodes.is_empty() {
            return 1.0;
        }
        self.tree.refit(corners);
        (self.tree.cost() / self.cost) as f32
    }

    /// [`Accel::refit`], but builds anew what would become slow.
    pub fn follow(&mut self, corners: &[[Vec3; 3]]) {
        if self.refit(corners) > WORN {
            *self = Accel::new(corners);
        }
    }

    /// Does work with the instructions of the queries.
    pub fn run(&self, work: impl Work) {
        match self.instructions {
            #[cfg(target_arch = "x86_64")]
            Instructions::Avx2(avx2) => avx2.run(work),
            Instructions::Portable => work.run(),
        }
    }

    /// The closest hit whose primitive is not in `skip`; of hits at the same distance, that of the lowest primitive.
    #[inline]
    pub fn closest(&self, ray: &Ray, skip: &[PrimId]) -> Option<Hit> {
        self.closest_from(ray, None, skip).found()
    }

    /// How a ray begins. This takes no turns: to ask it of many rays before anything else lets the processor work on all of them.
    #[inline(always)]
    pub fn enter(&self, ray: &Ray) -> Root {
        if self.tree.nodes.is_empty() || !is_finite(ray) {
            return Root::default();
        }
        match self.instructions {
            #[cfg(target_arch = "x86_64")]
            Instructions::Avx2(avx2) => avx2.enter(&self.tree, ray),
            Instructions::Portable => traverse::enter::<Portable>(&self.tree, ray),
        }
    }

    /// [`Accel::closest`] or [`Hit::NONE`], where [`Accel::enter`] may have been asked before.
    #[inline(always)]
    pub fn closest_from(&self, ray: &Ray, root: Option<&Root>, skip: &[PrimId]) -> Hit {
        // What has entered is finite, or hits nothing.
        if root.is_none() && (self.tree.nodes.is_empty() || !is_finite(ray)) {
            return Hit::NONE;
        }
        match self.instructions {
            #[cfg(target_arch = "x86_64")]
            Instructions::Avx2(avx2) => avx2.closest(&self.tree, ray, root, skip),
            Instructions::Portable => traverse::<Portable, false>(&self.tree, ray, root, skip),
        }
    }

    /// Whether anything not in `skip` lies on the ray. Nothing is seen along a ray that is not finite.
    #[inline]
    pub fn occluded(&self, ray: &Ray, skip: &[PrimId]) -> bool {
        self.occluded_from(ray, None, skip)
    }

    /// [`Accel::occluded`], where [`Accel::enter`] may have been asked before.
    #[inline(always)]
    pub fn occluded_from(&self, ray: &Ray, root: Option<&Root>, skip: &[PrimId]) -> bool {
        if self.tree.nodes.is_empty() {
            return false;
        }
        if !is_finite(ray) {
            return true;
        }
        match self.instructions {
            #[cfg(target_arch = "x86_64")]
            Instructions::Avx2(avx2) => avx2.any(&self.tree, ray, root, skip),
            Instructions::Portable => traverse::<Portable, true>(&self.tree, ray, root, skip).prim != NO_PRIM,
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

/// Positions of the order of 1e19 and more overflow in the arithmetic of single precision.
#[inline]
fn is_finite(ray: &Ray) -> bool {
    (ray.origin.abs() + ray.dir.abs()).element_sum() < f32::INFINITY
}

fn has_area([a, b, c]: &[Vec3; 3]) -> bool {
    let (a, b, c) = (a.as_dvec3(), b.as_dvec3(), c.as_dvec3());
    (b - a).cross(c - a).length() > 1e-30
}
