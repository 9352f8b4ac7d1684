//! The bounding volume hierarchy: nodes of eight child boxes in single precision over blocks of eight triangles.
//!
//! The crate obvhs builds a binary tree (parallel locally-ordered clustering, then reinsertion). It is collapsed into wide nodes by
//! dynamic programming over the surface area heuristic (Ylitie et al. 2017, "Efficient Incoherent Ray Traversal on GPUs Through
//! Compressed Wide BVHs"): of all ways to cut the binary tree into wide nodes and leaves this finds the cheapest.

use glam::{Vec3, Vec3A};
use obvhs::BvhBuildParams;
use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::reinsertion::ReinsertionOptimizer;
use obvhs::ploc::PlocBuilder;

use super::{NO_PRIM, PrimId};
use crate::math::hash_words;
use crate::memory;
use crate::stop::{self, Pace};

/// Number of children of a node, and of triangles of a block.
pub const WIDTH: usize = 8;
/// Most blocks of a leaf: as many as the bits of its reference can count.
const MAX_LEAF_BLOCKS: usize = (1 << COUNT_BITS) - 1;
const COUNT_BITS: u32 = 5;

/// Binary trees over more boxes than this take so long that Ctrl-C must be able to interrupt them.
const MAX_UNINTERRUPTED: usize = 1 << 16;

/// Bytes per triangle while a tree is built: boxes, two binary trees and their costs, and the tree itself. Measured as the peak memory of
/// the process: 200 to 230 bytes for a ball of 0.6 million triangles and for 0.3 million separate ones.
const BYTES_PER_TRIANGLE: u64 = 250;

/// Most blocks of a small tree ([`Tree::is_small`]).
const MAX_SMALL_BLOCKS: usize = 16;

/// Expected costs of visiting a node and a block of triangles, in the unit of the surface area heuristic.
const NODE_COST: f32 = 1.0;
const BLOCK_COST: f32 = 0.5;

/// Eight boxes, four cache lines.
#[derive(Clone, Copy)]
#[repr(C, align(32))]
pub struct Node {
    /// By axis: the lower and the upper bounds of the children. An empty slot has +∞ as its lower and −∞ as its upper bound.
    pub bounds: [[[f32; WIDTH]; 2]; 3],
    pub children: [Child; WIDTH],
}

/// A reference to a node, or to the blocks of a leaf. Of a leaf the lowest bits are the number of its blocks, and those above them the
/// index of the first.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Child(pub u32);

const LEAF: u32 = 1 << 31;

/// Eight triangles. The corners of an unused slot are NaN, so that no ray hits it.
#[derive(Clone, Copy)]
#[repr(C, align(32))]
pub struct Block {
    /// By vertex and axis.
    pub corners: [[[f32; WIDTH]; 3]; 3],
    pub prims: [PrimId; WIDTH],
}

/// The first node is the root; children come after their parents.
#[derive(Clone)]
pub struct Tree {
    pub nodes: Vec<Node>,
    pub blocks: Vec<Block>,
}

impl Child {
    pub const EMPTY: Child = Child(u32::MAX);

    fn leaf(first: usize, blocks: usize) -> Child {
        Child(LEAF | (first as u32) << COUNT_BITS | blocks as u32)
    }

    /// The index of a node, unless this is a leaf.
    #[inline(always)]
    pub fn node(self) -> Option<usize> {
        (self.0 & LEAF == 0).then_some(self.0 as usize)
    }

    /// The blocks of a leaf.
    #[inline(always)]
    pub fn blocks(self) -> std::ops::Range<usize> {
        let first = ((self.0 & !LEAF) >> COUNT_BITS) as usize;
        first..first + self.0 as usize % (1 << COUNT_BITS)
    }
}

impl Node {
    const EMPTY: Node =
        Node { bounds: [[[f32::INFINITY; WIDTH], [f32::NEG_INFINITY; WIDTH]]; 3], children: [Child::EMPTY; WIDTH] };

    fn set_bounds(&mut self, slot: usize, lo: Vec3, hi: Vec3) {
        for axis in 0..3 {
            self.bounds[axis][0][slot] = lo[axis];
            self.bounds[axis][1][slot] = hi[axis];
        }
    }

    fn child_bounds(&self, slot: usize) -> (Vec3, Vec3) {
        let side = |side: usize| Vec3::from_array(self.bounds.map(|b| b[side][slot]));
        (side(0), side(1))
    }

    /// Takes the lowest slot out of a bit set of slots and returns its child.
    #[inline(always)]
    pub fn next(&self, slots: &mut u32) -> Child {
        let slot = slots.trailing_zeros() as usize % WIDTH;
        *slots &= slots.wrapping_sub(1);
        self.children[slot]
    }

    /// The box around all children.
    fn total_bounds(&self) -> (Vec3, Vec3) {
        let fold = |(lo, hi): (Vec3, Vec3), (l, h): (Vec3, Vec3)| (lo.min(l), hi.max(h));
        (0..WIDTH).map(|i| self.child_bounds(i)).fold((Vec3::INFINITY, Vec3::NEG_INFINITY), fold)
    }
}

impl Block {
    fn new(prims: &[PrimId], corners: &[[Vec3; 3]]) -> Block {
        let mut block = Block { corners: [[[f32::NAN; WIDTH]; 3]; 3], prims: [NO_PRIM; WIDTH] };
        block.prims[..prims.len()].copy_from_slice(prims);
        block.fill(corners);
        block
    }

    /// Copies the corners of its primitives, and returns the box around them.
    fn fill(&mut self, corners: &[[Vec3; 3]]) -> (Vec3, Vec3) {
        let (mut lo, mut hi) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
        for (lane, prim) in self.prims.iter().enumerate().take_while(|(_, p)| **p != NO_PRIM) {
            for (vertex, point) in corners[*prim as usize].iter().enumerate() {
                (lo, hi) = (lo.min(*point), hi.max(*point));
                for axis in 0..3 {
                    self.corners[vertex][axis][lane] = point[axis];
                }
            }
        }
        (lo, hi)
    }
}

impl Tree {
    /// Builds a tree over the primitives `prims`; `corners` are those of all primitives, by id.
    pub fn new(corners: &[[Vec3; 3]], prims: &[PrimId]) -> Tree {
        if prims.is_empty() {
            return Tree { nodes: Vec::new(), blocks: Vec::new() };
        }
        memory::need(prims.len() as u64 * BYTES_PER_TRIANGLE);
        let boxes: Vec<Aabb> = prims
            .iter()
            .map(|&p| {
                let [a, b, c] = corners[p as usize].map(Vec3A::from);
                Aabb::new(a.min(b).min(c), a.max(b).max(c))
            })
            .collect();
        let groups = BoxGroups::new(&boxes);
        let representatives: Vec<Aabb> = groups.representatives.iter().map(|&i| boxes[i as usize]).collect();
        drop(boxes);
        let binary = if representatives.len() > MAX_UNINTERRUPTED {
            stop::apart(move || binary_tree(&representatives))
        } else {
            binary_tree(&representatives)
        };
        Collapse::new(&binary, &groups, corners, prims).run()
    }

    /// Whether there is only one node, over so few triangles that testing them in any order is faster than sorting them by distance.
    #[inline(always)]
    pub fn is_small(&self) -> bool {
        self.nodes.len() == 1 && self.blocks.len() <= MAX_SMALL_BLOCKS
    }

    /// Moves the triangles and updates the boxes around them. There must be as many triangles as when the tree was built.
    pub fn refit(&mut self, corners: &[[Vec3; 3]]) {
        for index in (0..self.nodes.len()).rev() {
            let mut node = self.nodes[index];
            for slot in 0..WIDTH {
                let child = node.children[slot];
                if child == Child::EMPTY {
                    continue;
                }
                let (lo, hi) = match child.node() {
                    Some(inner) => self.nodes[inner].total_bounds(),
                    None => self.blocks[child.blocks()]
                        .iter_mut()
                        .map(|b| b.fill(corners))
                        .fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(lo, hi), (l, h)| (lo.min(l), hi.max(h))),
                };
                node.set_bounds(slot, lo, hi);
            }
            self.nodes[index] = node;
        }
    }

    /// Expected cost of a ray that hits the root's box, by the surface area heuristic.
    pub fn cost(&self) -> f64 {
        let half_area = |(lo, hi): (Vec3, Vec3)| {
            let d = (hi - lo).as_dvec3();
            d.x * d.y + d.y * d.z + d.z * d.x
        };
        let Some(root) = self.nodes.first() else { return 0.0 };
        let mut sum = 0.0;
        for node in &self.nodes {
            for (slot, child) in node.children.iter().enumerate().filter(|(_, c)| **c != Child::EMPTY) {
                let cost = match child.node() {
                    Some(_) => f64::from(NODE_COST),
                    None => f64::from(BLOCK_COST) * child.blocks().len() as f64,
                };
                sum += cost * half_area(node.child_bounds(slot));
            }
        }
        f64::from(NODE_COST) + sum / half_area(root.total_bounds()).max(f64::MIN_POSITIVE)
    }
}

/// Groups of primitives that have the same box, each at most as large as a leaf. The builder of the binary tree sees one box for each
/// group: from many equal boxes it would build a tree as deep as a list, in quadratic time.
struct BoxGroups {
    /// By group: its first primitive.
    representatives: Vec<u32>,
    /// By primitive: the next in its group, or `LAST`.
    next: Vec<u32>,
}

const LAST: u32 = u32::MAX;

impl BoxGroups {
    fn new(boxes: &[Aabb]) -> BoxGroups {
        let words = |b: &Aabb| [b.min.x, b.min.y, b.min.z, b.max.x, b.max.y, b.max.z].map(f32::to_bits);
        let mut keys: Vec<u64> = (0u64..).zip(boxes).map(|(i, b)| u64::from(hash_words(&words(b))) << 32 | i).collect();
        keys.sort_unstable();
        let mut next = vec![LAST; boxes.len()];
        let mut representatives = Vec::with_capacity(boxes.len());
        let (mut last, mut height) = (LAST, 0);
        for index in keys.iter().map(|&key| key as u32) {
            let same = last != LAST && words(&boxes[last as usize]) == words(&boxes[index as usize]);
            if same && height < MAX_LEAF_BLOCKS * WIDTH {
                next[last as usize] = index;
                height += 1;
            } else {
                representatives.push(index);
                height = 1;
            }
            last = index;
        }
        // In the order in which primitives were given, which is better for the caches than the order of hashes.
        representatives.sort_unstable();
        BoxGroups { representatives, next }
    }

    fn members(&self, group: u32) -> impl Iterator<Item = u32> {
        std::iter::successors(Some(self.representatives[group as usize]), |&i| {
            Some(self.next[i as usize]).filter(|&n| n != LAST)
        })
    }
}

/// The binary tree that obvhs calls a medium build, with one box in each leaf.
fn binary_tree(boxes: &[Aabb]) -> Bvh2 {
    let params = BvhBuildParams::medium_build();
    let mut tree = PlocBuilder::with_capacity(boxes.len()).build(
        params.ploc_search_distance,
        boxes,
        (0..boxes.len() as u32).collect(),
        params.sort_precision,
        params.search_depth_threshold,
    );
    ReinsertionOptimizer::default().run(&mut tree, params.reinsertion_batch_ratio, None);
    tree
}

struct Collapse<'a> {
    binary: &'a Bvh2,
    groups: &'a BoxGroups,
    corners: &'a [[Vec3; 3]],
    prims: &'a [PrimId],
    /// By binary node: the number of triangles below it.
    counts: Vec<u32>,
    /// By binary node: the least cost of its subtree if that takes up at most 1, 2, … 7 slots of the wide node above it.
    costs: Vec<[f32; WIDTH - 1]>,
    /// Lengths are multiplied by this before they make areas, so that areas neither overflow nor underflow.
    scale: f32,
    tree: Tree,
}

impl<'a> Collapse<'a> {
    fn new(binary: &'a Bvh2, groups: &'a BoxGroups, corners: &'a [[Vec3; 3]], prims: &'a [PrimId]) -> Collapse<'a> {
        let scale = 1.0 / binary.nodes[0].aabb().diagonal().max_element();
        let count = binary.nodes.len();
        Collapse {
            binary,
            groups,
            corners,
            prims,
            counts: vec![0; count],
            costs: vec![[0.0; WIDTH - 1]; count],
            scale: if scale.is_finite() { scale } else { 1.0 },
            tree: Tree { nodes: Vec::new(), blocks: Vec::new() },
        }
    }

    fn run(mut self) -> Tree {
        self.find_costs();
        self.tree.nodes.push(Node::EMPTY);
        let mut pending = vec![(0, 0)];
        let mut pace = Pace::default();
        while let Some((index, target)) = pending.pop() {
            pace.step(64);
            self.emit(index, target, &mut pending);
        }
        self.tree
    }

    /// Indices of a binary node's two children, unless it is a leaf.
    fn pair(&self, index: usize) -> Option<[usize; 2]> {
        let node = &self.binary.nodes[index];
        let first = node.first_index as usize;
        (!node.is_leaf()).then_some([first, first + 1])
    }

    /// The groups in a binary leaf.
    fn leaf_groups(&self, index: usize) -> impl Iterator<Item = u32> {
        let leaf = &self.binary.nodes[index];
        let first = leaf.first_index as usize;
        self.binary.primitive_indices[first..first + leaf.prim_count as usize].iter().copied()
    }

    fn find_costs(&mut self) {
        // Children before parents. The order of obvhs's nodes does not tell, since reinsertion moves them about.
        let mut order = Vec::with_capacity(self.binary.nodes.len());
        let mut pending = vec![0];
        while let Some(index) = pending.pop() {
            order.push(index as u32);
            pending.extend(self.pair(index).into_iter().flatten());
        }
        let mut pace = Pace::default();
        for &index in order.iter().rev() {
            pace.step(16);
            let index = index as usize;
            let Some(pair) = self.pair(index) else {
                self.counts[index] =
                    self.leaf_groups(index).map(|group| self.groups.members(group).count() as u32).sum();
                self.costs[index] = [self.leaf_cost(index); WIDTH - 1];
                continue;
            };
            self.counts[index] = self.counts[pair[0]] + self.counts[pair[1]];
            let mut cost = self.leaf_cost(index).min(self.node_cost(index, pair));
            self.costs[index][0] = cost;
            for slots in 2..WIDTH {
                cost = cost.min(self.cheapest_split(pair, slots).0);
                self.costs[index][slots - 1] = cost;
            }
        }
    }

    fn area(&self, index: usize) -> f32 {
        let d = self.binary.nodes[index].aabb().diagonal() * self.scale;
        d.x * d.y + d.y * d.z + d.z * d.x
    }

    fn leaf_cost(&self, index: usize) -> f32 {
        let blocks = (self.counts[index] as usize).div_ceil(WIDTH);
        if blocks > MAX_LEAF_BLOCKS { f32::INFINITY } else { self.area(index) * BLOCK_COST * blocks as f32 }
    }

    fn node_cost(&self, index: usize, pair: [usize; 2]) -> f32 {
        self.area(index) * NODE_COST + self.cheapest_split(pair, WIDTH).0
    }

    /// The least cost of two subtrees that share a number of slots (at least two), and how many of these the first one takes.
    fn cheapest_split(&self, pair: [usize; 2], slots: usize) -> (f32, usize) {
        let [a, b] = pair.map(|i| &self.costs[i]);
        let cost = |first: usize| a[first - 1] + b[slots - first - 1];
        (1..slots)
            .map(|first| (cost(first), first))
            .fold((f32::INFINITY, 1), |best, x| if x.0 < best.0 { x } else { best })
    }

    /// Fills the node at index `target` with the subtree of a binary node. Children that are nodes themselves are put on `pending`.
    fn emit(&mut self, index: usize, target: usize, pending: &mut Vec<(usize, usize)>) {
        let mut children = Vec::with_capacity(WIDTH);
        match self.pair(index) {
            Some(pair) => self.cut_pair(pair, WIDTH, &mut children),
            None => children.push(index),
        }
        let mut node = Node::EMPTY;
        for (i, &child) in children.iter().enumerate() {
            let bounds = self.binary.nodes[child].aabb();
            node.set_bounds(i, bounds.min.into(), bounds.max.into());
            node.children[i] = match self.pair(child) {
                Some(pair)
                    if self.leaf_cost(child) > self.node_cost(child, pair) || self.leaf_cost(child).is_infinite() =>
                {
                    let next = self.tree.nodes.len();
                    self.tree.nodes.push(Node::EMPTY);
                    pending.push((child, next));
                    Child(next as u32)
                }
                _ => self.emit_leaf(child),
            };
        }
        self.tree.nodes[target] = node;
    }

    fn cut_pair(&self, pair: [usize; 2], slots: usize, children: &mut Vec<usize>) {
        let (_, first) = self.cheapest_split(pair, slots);
        self.cut(pair[0], first, children);
        self.cut(pair[1], slots - first, children);
    }

    /// Adds the binary nodes that take up the slots given to a subtree.
    fn cut(&self, index: usize, slots: usize, children: &mut Vec<usize>) {
        let costs = &self.costs[index];
        match self.pair(index) {
            Some(pair) if costs[slots - 1] < costs[0] => {
                // The fewest slots that have the same cost.
                let needed = (1..slots).rev().take_while(|&n| costs[n - 1] == costs[slots - 1]).last().unwrap_or(slots);
                self.cut_pair(pair, needed, children);
            }
            _ => children.push(index),
        }
    }

    fn emit_leaf(&mut self, index: usize) -> Child {
        let mut prims = Vec::new();
        let mut pending = vec![index];
        while let Some(index) = pending.pop() {
            match self.pair(index) {
                Some(pair) => pending.extend(pair),
                None => {
                    let members = self.leaf_groups(index).flat_map(|group| self.groups.members(group));
                    prims.extend(members.map(|i| self.prims[i as usize]));
                }
            }
        }
        let first = self.tree.blocks.len();
        self.tree.blocks.extend(prims.chunks(WIDTH).map(|chunk| Block::new(chunk, self.corners)));
        Child::leaf(first, self.tree.blocks.len() - first)
    }
}
