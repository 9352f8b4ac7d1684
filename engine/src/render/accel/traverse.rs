//! Traversal of the tree, written once for all instruction sets.
//!
//! Every operation on lanes is a single operation of IEEE 754 (no fused multiply-add), in the same order everywhere, so that all
//! instruction sets return the same bits.
//!
//! This file uses no closures, and no `map` of the standard library over lanes. The compiler does not always inline them, and a function
//! that is not inlined is compiled without the wider instructions: every operation on a register would be a call.

use std::ops::{Add, BitAnd, BitOr, Div, Mul, Sub};

use glam::Vec3;

use super::tree::{Block, Child, Node, Tree, WIDTH};
use super::{Hit, NO_PRIM, PrimId, Ray};

/// [`WIDTH`] numbers on which operations work at once. If one of two operands is NaN, comparisons are false, and `min` and `max` return
/// the second operand.
pub trait Lanes: Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Div<Output = Self> {
    type Mask: Mask;
    type Ids: Copy;

    fn splat(x: f32) -> Self;
    fn load(x: &[f32; WIDTH]) -> Self;
    fn to_array(self) -> [f32; WIDTH];
    fn min(self, other: Self) -> Self;
    fn max(self, other: Self) -> Self;
    /// The least of all lanes, none of which may be NaN.
    fn min_lane(self) -> f32;
    fn less_or_equal(self, other: Self) -> Self::Mask;
    fn less(self, other: Self) -> Self::Mask;
    fn not_equal(self, other: Self) -> Self::Mask;
    fn select(mask: Self::Mask, yes: Self, no: Self) -> Self;

    fn load_ids(ids: &[PrimId; WIDTH]) -> Self::Ids;
    fn splat_id(id: PrimId) -> Self::Ids;
    fn ids_to_array(ids: Self::Ids) -> [PrimId; WIDTH];
    fn ids_equal(a: Self::Ids, b: Self::Ids) -> Self::Mask;
    /// Whether `a` < `b` as signed integers, so that [`NO_PRIM`] is less than all others.
    fn ids_less(a: Self::Ids, b: Self::Ids) -> Self::Mask;
    fn select_ids(mask: Self::Mask, yes: Self::Ids, no: Self::Ids) -> Self::Ids;
}

/// A boolean in every lane.
pub trait Mask: Copy + BitAnd<Output = Self> + BitOr<Output = Self> {
    /// One bit for each lane, the lowest for the first.
    fn bits(self) -> u32;
    /// `self & !other`
    fn and_not(self, other: Self) -> Self;
}

/// How far boxes are enlarged, relative to the distance. This is some sixteen roundings of single precision, more than the box
/// test and the triangle test have together: so no triangle is missed because the box around it was.
const MARGIN: f32 = 1e-6;

/// Which children of the root a ray hits (bits of `hits`), and at which distances it enters them.
#[derive(Clone, Copy, Debug, Default)]
pub struct RootHits {
    near: [f32; WIDTH],
    hits: u32,
    /// One over the ray's direction.
    inv: [f32; 3],
}

/// Tests a ray against the boxes of the root's children.
#[inline(always)]
pub fn intersect_root<L: Lanes>(tree: &Tree, ray: &Ray) -> RootHits {
    let inv = ray.dir.recip().to_array();
    let (near, hits) = BoxTest::<L>::new(ray, inv).hits(&tree.nodes[0], L::splat(with_margin(ray.t_max)));
    RootHits { near, hits, inv }
}

/// [`intersect_root`], unless its result is known already.
#[inline(always)]
fn root_of<L: Lanes>(tree: &Tree, ray: &Ray, known: Option<&RootHits>) -> RootHits {
    match known {
        Some(root) => *root,
        None => intersect_root::<L>(tree, ray),
    }
}

/// The closest hit or, if `ANY`, any hit; [`Hit::NONE`] if there is none. Of hits at the same distance the one with the lowest primitive id
/// is returned. `root` is the result of [`intersect_root`], if it is known.
#[inline(always)]
pub fn traverse<L: Lanes, const ANY: bool>(tree: &Tree, ray: &Ray, root: Option<&RootHits>, skip: &[PrimId]) -> Hit {
    if tree.is_small() {
        return if ANY {
            any_hit_small::<L>(tree, ray, root, skip)
        } else {
            closest_hit_small::<L>(tree, ray, root, skip)
        };
    }
    let root = root_of::<L>(tree, ray, root);
    if root.hits == 0 {
        return Hit::NONE;
    }
    let boxes = BoxTest::<L>::new(ray, root.inv);
    let triangles = TriangleTest::<L>::new(ray, root.inv);
    let ([first, second], others) = first_two(skip);
    // Hits at `t_max` itself do not count: since no id is less than 0, none is preferred to this start value.
    let mut best = Hit { t: ray.t_max, prim: 0, b: [0.0; 3] };
    let mut found = false;
    let mut limit = with_margin(best.t);
    let mut stack = Stack::new();
    let mut current = stack.push::<ANY>(&tree.nodes[0], &root.near, root.hits);
    loop {
        if let Some(index) = current.node() {
            let node = &tree.nodes[index];
            let (near, hits) = boxes.hits(node, L::splat(limit));
            if hits != 0 {
                current = stack.push::<ANY>(node, &near, hits);
                continue;
            }
        } else {
            for block in &tree.blocks[current.blocks()] {
                let Some((t, b, mut hits)) = triangles.hits::<ANY>(block, best.t) else { continue };
                while hits != 0 {
                    let lane = hits.trailing_zeros() as usize % WIDTH;
                    hits &= hits - 1;
                    let (t, prim) = (t[lane], block.prims[lane]);
                    let closer = ANY || t < best.t || (t == best.t && prim < best.prim);
                    if closer && (prim != first) & (prim != second) && !others.contains(&prim) {
                        best = Hit { t, prim, b: [b[0][lane], b[1][lane], b[2][lane]] };
                        if ANY {
                            return best;
                        }
                        found = true;
                        limit = with_margin(t);
                    }
                }
            }
        }
        loop {
            let Some((child, near)) = stack.pop() else { return if found { best } else { Hit::NONE } };
            if near <= limit {
                current = child;
                break;
            }
        }
    }
}

/// Closest hit in a [small](Tree::is_small) tree. All blocks whose boxes the ray hits are tested, each lane keeps its closest hit, and the
/// lanes are compared once at the end. Sorting by distance and stopping early would take branches that the processor cannot predict, and
/// these cost more than the tests that they save. (This must be inlined into [`traverse`]: in a function of its own the stack frame is
/// not aligned, which costs as much as is gained.)
#[inline(always)]
fn closest_hit_small<L: Lanes>(tree: &Tree, ray: &Ray, root: Option<&RootHits>, skip: &[PrimId]) -> Hit {
    let root = root_of::<L>(tree, ray, root);
    let triangles = TriangleTest::<L>::new(ray, root.inv);
    let skip = Skip::<L>::new(skip);
    let zero = L::splat(0.0);
    let (mut t, mut ids, mut b) = (L::splat(ray.t_max), L::splat_id(NO_PRIM), [zero; 3]);
    let mut hits = root.hits;
    while hits != 0 {
        for block in &tree.blocks[tree.nodes[0].next(&mut hits).blocks()] {
            let test = triangles.test(block);
            let prims = L::load_ids(&block.prims);
            let closer = test.t.less(t) | (test.t.less_or_equal(t) & L::ids_less(prims, ids));
            let closer = skip.without(prims, closer & test.valid);
            t = L::select(closer, test.t, t);
            ids = L::select_ids(closer, prims, ids);
            let [u, v, w] = test.b;
            b = [L::select(closer, u, b[0]), L::select(closer, v, b[1]), L::select(closer, w, b[2])];
        }
    }
    let nearest = t.min_lane();
    let mut first = t.less_or_equal(L::splat(nearest)).and_not(L::ids_equal(ids, L::splat_id(NO_PRIM))).bits();
    let [u, v, w] = [b[0].to_array(), b[1].to_array(), b[2].to_array()];
    let ids = L::ids_to_array(ids);
    // Of lanes at the same distance, the one with the lowest id. Without any hit this starts from lane 0, whose id is `NO_PRIM`.
    let mut lane = first.trailing_zeros() as usize % WIDTH;
    first &= first.wrapping_sub(1);
    while first != 0 {
        let other = first.trailing_zeros() as usize % WIDTH;
        first &= first - 1;
        if ids[other] < ids[lane] {
            lane = other;
        }
    }
    Hit { t: nearest, prim: ids[lane], b: [u[lane], v[lane], w[lane]] }
}

/// Any hit in a [small](Tree::is_small) tree: of the result only whether `prim` is [`NO_PRIM`] means anything.
#[inline(always)]
fn any_hit_small<L: Lanes>(tree: &Tree, ray: &Ray, root: Option<&RootHits>, skip: &[PrimId]) -> Hit {
    let root = root_of::<L>(tree, ray, root);
    let triangles = TriangleTest::<L>::new(ray, root.inv);
    let skip = Skip::<L>::new(skip);
    let t_max = L::splat(ray.t_max);
    let (mut hits, mut found) = (root.hits, 0);
    while hits != 0 {
        for block in &tree.blocks[tree.nodes[0].next(&mut hits).blocks()] {
            let test = triangles.test(block);
            found |= skip.without(L::load_ids(&block.prims), test.valid & test.t.less(t_max)).bits();
        }
    }
    Hit { prim: if found != 0 { 0 } else { NO_PRIM }, ..Hit::NONE }
}

/// The first two primitives to skip, and the others. Most queries skip one or two, and these are compared without a loop.
#[inline(always)]
fn first_two(skip: &[PrimId]) -> ([PrimId; 2], &[PrimId]) {
    match *skip {
        [] => ([NO_PRIM; 2], &[]),
        [only] => ([only, NO_PRIM], &[]),
        [first, second, ref others @ ..] => ([first, second], others),
    }
}

/// Primitives that a query skips.
struct Skip<'a, L: Lanes> {
    first: L::Ids,
    second: L::Ids,
    others: &'a [PrimId],
}

impl<'a, L: Lanes> Skip<'a, L> {
    #[inline(always)]
    fn new(skip: &'a [PrimId]) -> Self {
        let ([first, second], others) = first_two(skip);
        Skip { first: L::splat_id(first), second: L::splat_id(second), others }
    }

    #[inline(always)]
    fn without(&self, prims: L::Ids, mask: L::Mask) -> L::Mask {
        let mut left = mask.and_not(L::ids_equal(prims, self.first) | L::ids_equal(prims, self.second));
        for &other in self.others {
            left = left.and_not(L::ids_equal(prims, L::splat_id(other)));
        }
        left
    }
}

/// A distance, enlarged by [`MARGIN`].
#[inline(always)]
fn with_margin(t: f32) -> f32 {
    t + t.abs() * MARGIN
}

/// Three numbers, each in all lanes.
#[inline(always)]
fn splat<L: Lanes>(v: [f32; 3]) -> [L; 3] {
    [L::splat(v[0]), L::splat(v[1]), L::splat(v[2])]
}

/// Tests one ray against eight boxes: the slab test, made conservative as in Ize 2013, "Robust BVH Ray Traversal".
struct BoxTest<L> {
    origin: [L; 3],
    inv_near: [L; 3],
    inv_far: [L; 3],
    /// Which side of a box the ray enters, per axis.
    enters: [usize; 3],
    t_min: L,
}

impl<L: Lanes> BoxTest<L> {
    #[inline(always)]
    fn new(ray: &Ray, inv: [f32; 3]) -> Self {
        let [x, y, z] = inv;
        let far = 1.0 + MARGIN;
        BoxTest {
            origin: splat(ray.origin.to_array()),
            inv_near: splat(inv),
            inv_far: splat([x * far, y * far, z * far]),
            enters: [x.is_sign_negative() as usize, y.is_sign_negative() as usize, z.is_sign_negative() as usize],
            t_min: L::splat(ray.t_min * (1.0 - MARGIN)),
        }
    }

    /// The distances at which the ray enters the boxes, and a bit for each box that it hits before `limit`.
    #[inline(always)]
    fn hits(&self, node: &Node, limit: L) -> ([f32; WIDTH], u32) {
        // A ray that lies in the plane of a box's side gives 0 · ∞ = NaN there. `max` and `min` ignore a NaN that is their first operand,
        // and the second operand that ends each line is never NaN.
        let enter = self.near(node, 0).max(self.near(node, 1)).max(self.near(node, 2).max(self.t_min));
        let leave = self.far(node, 0).min(self.far(node, 1)).min(self.far(node, 2).min(limit));
        (enter.to_array(), enter.less_or_equal(leave).bits())
    }

    #[inline(always)]
    fn near(&self, node: &Node, axis: usize) -> L {
        let side = L::load(&node.bounds[axis][self.enters[axis] & 1]);
        (side - self.origin[axis]) * self.inv_near[axis]
    }

    #[inline(always)]
    fn far(&self, node: &Node, axis: usize) -> L {
        let side = L::load(&node.bounds[axis][self.enters[axis] & 1 ^ 1]);
        (side - self.origin[axis]) * self.inv_far[axis]
    }
}

/// Tests one ray against eight triangles (Woop et al. 2013, "Watertight Ray/Triangle Intersection"). Space is permuted and sheared so that
/// the ray runs along the z axis. There the edge function of an edge is the same up to its sign for both triangles that share the edge.
/// So no ray passes between triangles that share an edge or a vertex, although no triangle is enlarged.
struct TriangleTest<L> {
    /// The permutation of the axes: last the one along which the direction is longest.
    axes: [usize; 3],
    origin: [L; 3],
    shear: [L; 3],
    t_min: L,
}

/// Where a ray intersects the planes of triangles: distances, barycentric coordinates, and whether that is inside the triangles and not
/// before `t_min`.
struct PlaneHits<L: Lanes> {
    t: L,
    b: [L; 3],
    valid: L::Mask,
}

/// A ray whose numbers are read by the index of an axis. The alignment is for the sake of registers that are spilled to the same stack
/// frame: the compiler aligns the frame for this struct but not for them, and loads that cross cache lines cost up to a third of the time.
#[repr(align(64))]
struct RayByAxis {
    origin: [f32; 4],
    dir: [f32; 4],
    inv: [f32; 4],
}

#[inline(always)]
fn four(v: Vec3) -> [f32; 4] {
    v.extend(0.0).to_array()
}

/// Per lane: distances, barycentric coordinates, and a bit for each hit.
type TriangleHits = ([f32; WIDTH], [[f32; WIDTH]; 3], u32);

impl<L: Lanes> TriangleTest<L> {
    #[inline(always)]
    fn new(ray: &Ray, inv: [f32; 3]) -> Self {
        const NEXT: [usize; 4] = [1, 2, 0, 0];
        let RayByAxis { origin, dir, inv } =
            &RayByAxis { origin: four(ray.origin), dir: four(ray.dir), inv: four(Vec3::from_array(inv)) };
        let size = ray.dir.abs();
        // The longest axis is found without a branch, which the processor could not predict.
        let others = usize::from((size.x > size.y) & (size.x > size.z)).wrapping_sub(1);
        let z = (2 - usize::from(size.y > size.z)) & others;
        let x = NEXT[z & 3];
        let y = NEXT[x & 3];
        let inv = inv[z & 3];
        TriangleTest {
            axes: [x, y, z],
            origin: splat([origin[x & 3], origin[y & 3], origin[z & 3]]),
            shear: splat([dir[x & 3] * inv, dir[y & 3] * inv, inv]),
            t_min: L::splat(ray.t_min),
        }
    }

    /// Hits with `t_min` ≤ t ≤ `t_max`, or t < `t_max` if `ANY`. At `t_max` itself the caller compares primitive ids.
    #[inline(always)]
    fn hits<const ANY: bool>(&self, block: &Block, t_max: f32) -> Option<TriangleHits> {
        let PlaneHits { t, b: [u, v, w], valid } = self.test(block);
        let t_max = L::splat(t_max);
        let before = if ANY { t.less(t_max) } else { t.less_or_equal(t_max) };
        let hits = (valid & before).bits();
        if hits == 0 {
            return None;
        }
        Some((t.to_array(), [u.to_array(), v.to_array(), w.to_array()], hits))
    }

    #[inline(always)]
    fn test(&self, block: &Block) -> PlaneHits<L> {
        let (a, b, c) = (self.corner(block, 0), self.corner(block, 1), self.corner(block, 2));
        let (u, v, w) = (edge(c, b), edge(a, c), edge(b, a));
        let zero = L::splat(0.0);
        let inside = zero.less_or_equal(u.min(v).min(w)) | u.max(v).max(w).less_or_equal(zero);
        let det = u + v + w;
        let inv = L::splat(1.0) / det;
        let (u, v, w) = (u * inv, v * inv, w * inv);
        // Where the determinant is zero or NaN the distance is NaN, and comparisons with it are false. Where it is infinite its
        // inverse is zero.
        let t = (u * a[2] + v * b[2] + w * c[2]) * self.shear[2];
        let finite = inv.not_equal(zero);
        PlaneHits { t, b: [u, v, w], valid: inside & finite & self.t_min.less_or_equal(t) }
    }

    /// One corner of each triangle, in the space where the ray runs along the z axis.
    #[inline(always)]
    fn corner(&self, block: &Block, vertex: usize) -> [L; 3] {
        let [x, y, z] = self.axes;
        let corner = &block.corners[vertex];
        let z = L::load(&corner[z.min(2)]) - self.origin[2];
        let x = L::load(&corner[x.min(2)]) - self.origin[0] - self.shear[0] * z;
        let y = L::load(&corner[y.min(2)]) - self.origin[1] - self.shear[1] * z;
        [x, y, z]
    }
}

/// The edge function: twice the signed area of the triangle that two corners make with the ray. Swapping the corners changes its sign and
/// nothing else.
#[inline(always)]
fn edge<L: Lanes>(p: [L; 3], q: [L; 3]) -> L {
    p[0] * q[1] - p[1] * q[0]
}

/// Children to be visited. Each is a key: in the upper half the bits of the distance at which the ray enters it (bits of numbers that are
/// not negative are ordered like the numbers), in the lower half the child. Entries that do not fit spill to the heap. Aligned for the
/// same reason as [`RayByAxis`].
#[repr(align(64))]
struct Stack {
    len: usize,
    keys: [u64; Stack::ROOM],
    /// The bottom of a stack that has more than `ROOM` entries.
    spilled: Vec<u64>,
}

/// The key of the first child that is hit.
#[inline(always)]
fn key(node: &Node, near: &[f32; WIDTH], hits: u32) -> u64 {
    let place = hits.trailing_zeros() as usize % WIDTH;
    u64::from(near[place].to_bits()) << 32 | u64::from(node.children[place].0)
}

impl Stack {
    const ROOM: usize = 32;

    #[inline(always)]
    fn new() -> Stack {
        Stack { len: 0, keys: [0; Stack::ROOM], spilled: Vec::new() }
    }

    /// Returns the closest of the children that are hit and pushes the others, the farthest first. If `ANY` the others are not sorted,
    /// because the first hit ends the query.
    #[inline(always)]
    fn push<const ANY: bool>(&mut self, node: &Node, near: &[f32; WIDTH], mut hits: u32) -> Child {
        if self.len + WIDTH > Stack::ROOM {
            self.spill();
        }
        let mut closest = key(node, near, hits);
        let base = self.len;
        hits &= hits - 1;
        while hits != 0 {
            let key = key(node, near, hits);
            hits &= hits - 1;
            let farther = key.max(closest);
            closest = key.min(closest);
            let mut place = self.len;
            self.len += 1;
            if !ANY {
                while place > base && self.keys[place - 1] < farther {
                    self.keys[place] = self.keys[place - 1];
                    place -= 1;
                }
            }
            self.keys[place] = farther;
        }
        Child(closest as u32)
    }

    #[inline(always)]
    fn pop(&mut self) -> Option<(Child, f32)> {
        let key = if self.len > 0 {
            self.len -= 1;
            self.keys[self.len % Stack::ROOM]
        } else {
            self.spilled.pop()?
        };
        Some((Child(key as u32), f32::from_bits((key >> 32) as u32)))
    }

    #[cold]
    fn spill(&mut self) {
        self.spilled.extend_from_slice(&self.keys[..self.len]);
        self.len = 0;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_stack_grows_and_gives_back_the_closest_first() {
        let mut stack = Stack::new();
        let mut node = Node { bounds: [[[0.0; WIDTH]; 2]; 3], children: [Child(0); WIDTH] };
        let rounds = 40;
        for round in 0..rounds {
            node.children = std::array::from_fn(|i| Child(round * 8 + i as u32));
            let near = std::array::from_fn(|i| ((i * 3) % WIDTH) as f32);
            assert_eq!(stack.push::<false>(&node, &near, 0xff), Child(round * 8));
        }
        for round in (0..rounds).rev() {
            for distance in 1..WIDTH {
                let place = (0..WIDTH).find(|i| (i * 3) % WIDTH == distance).unwrap();
                assert_eq!(stack.pop(), Some((Child(round * 8 + place as u32), distance as f32)));
            }
        }
        assert_eq!(stack.pop(), None);
    }
}
