//! The tree: nodes of eight child boxes in single precision over blocks of eight triangles.
//!
//! obvhs builds a binary tree (parallel locally-ordered clustering, then reinsertion). It is collapsed by dynamic
//! programming over the surface area heuristic (Ylitie et al. 2017): of all ways to cut a binary tree into wide nodes and
//! leaves this finds the cheapest.

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

/// Children of a node, and triangles of a block.
pub const WIDTH: usize = 8;
/// What a leaf's reference has room for.
const MAX_BLOCKS: usize = (1 << COUNT_BITS) - 1;
const COUNT_BITS: u32 = 5;

/// Boxes whose binary tree takes so long that Ctrl-C may come first.
const SLOW: usize = 1 << 16;

/// Bytes that a triangle takes while a tree is built: boxes, two binary trees and their costs, and the tree itself. Measured by what the
/// process held at most: 200 to 230 for balls of 0.6 and for 0.3 million separate triangles.
const BUILDING: u64 = 250;

/// See [`Tree::is_small`]; in blocks.
const SMALL: usize = 16;

/// Expected costs of visiting a node and a block of triangles, in the unit of the surface area heuristic.
const NODE_COST: f32 = 1.0;
const BLOCK_COST: f32 = 0.5;

/// Eight boxes, four cache lines.
#[derive(Clone, Copy)]
#[repr(C, align(32))]
pub struct Node {
    /// Of each axis: the lower and the upper bounds of the children. Those of an empty place are inside out.
    pub bounds: [[[f32; WIDTH]; 2]; 3],
    pub children: [Child; WIDTH],
}

/// A reference to a node, or to the blocks of a leaf: their first above the bits that count them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Child(pub u32);

const LEAF: u32 = 1 << 31;

/// Eight triangles; an unused place has no number among its coordinates and thus is never hit.
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

    fn set_bounds(&mut self, place: usize, lo: Vec3, hi: Vec3) {
        for axis in 0..3 {
            self.bounds[axis][0][place] = lo[axis];
            self.bounds[axis][1][place] = hi[axis];
        }
    }

    fn child_bounds(&self, place: usize) -> (Vec3, Vec3) {
        let side = |side: usize| Vec3::from_array(self.bounds.map(|b| b[side][place]));
        (side(0), side(1))
    }

    /// The child at the first of some places, which is struck off.
    #[inline(always)]
    pub fn next(&self, places: &mut u32) -> Child {
        let place = places.trailing_zeros() as usize % WIDTH;
        *places &= places.wrapping_sub(1);
        self.children[place]
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

    /// Takes the corners of its primitives, and returns the box around them.
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
    /// Over the given primitives, of all whose corners are given.
    pub fn new(corners: &[[Vec3; 3]], prims: &[PrimId]) -> Tree {
        if prims.is_empty() {
            return Tree { nodes: Vec::new(), blocks: Vec::new() };
        }
        memory::need(prims.len() as u64 * BUILDING);
        let boxes: Vec<Aabb> = prims
            .iter()
            .map(|&p| {
                let [a, b, c] = corners[p as usize].map(Vec3A::from);
                Aabb::new(a.min(b).min(c), a.max(b).max(c))
            })
            .collect();
        let piles = Piles::new(&boxes);
        let heads: Vec<Aabb> = piles.heads.iter().map(|&i| boxes[i as usize]).collect();
        drop(boxes);
        let binary = if heads.len() > SLOW { stop::apart(move || binary_tree(&heads)) } else { binary_tree(&heads) };
        Collapse::new(&binary, &piles, corners, prims).run()
    }

    /// Whether there is one node only, and few enough triangles to test all that its boxes do not exclude.
    #[inline(always)]
    pub fn is_small(&self) -> bool {
        self.nodes.len() == 1 && self.blocks.len() <= SMALL
    }

    /// Moves the triangles; each must have been there when the tree was built.
    pub fn refit(&mut self, corners: &[[Vec3; 3]]) {
        for index in (0..self.nodes.len()).rev() {
            let mut node = self.nodes[index];
            for place in 0..WIDTH {
                let child = node.children[place];
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
                node.set_bounds(place, lo, hi);
            }
            self.nodes[index] = node;
        }
    }

    /// The surface area heuristic's cost of a ray that hits the root's box.
    pub fn cost(&self) -> f64 {
        let half_area = |(lo, hi): (Vec3, Vec3)| {
            let d = (hi - lo).as_dvec3();
            d.x * d.y + d.y * d.z + d.z * d.x
        };
        let Some(root) = self.nodes.first() else { return 0.0 };
        let mut sum = 0.0;
        for node in &self.nodes {
            for (place, child) in node.children.iter().enumerate().filter(|(_, c)| **c != Child::EMPTY) {
                let cost = match child.node() {
                    Some(_) => f64::from(NODE_COST),
                    None => f64::from(BLOCK_COST) * child.blocks().len() as f64,
                };
                sum += cost * half_area(node.child_bounds(place));
            }
        }
        f64::from(NODE_COST) + sum / half_area(root.total_bounds()).max(f64::MIN_POSITIVE)
    }
}

/// Primitives with the same box, at most a leaf's worth of them, are one to the builder: many boxes that are all equally near to
/// each other would make a tree like a chain, in quadratic time.
struct Piles {
    /// The first primitive of each pile.
    heads: Vec<u32>,
    /// Of each primitive: the next in its pile, or `LAST`.
    next: Vec<u32>,
}

const LAST: u32 = u32::MAX;

impl Piles {
    fn new(boxes: &[Aabb]) -> Piles {
        let words = |b: &Aabb| [b.min.x, b.min.y, b.min.z, b.max.x, b.max.y, b.max.z].map(f32::to_bits);
        let mut keys: Vec<u64> = (0u64..).zip(boxes).map(|(i, b)| u64::from(hash_words(&words(b))) << 32 | i).collect();
        keys.sort_unstable();
        let mut next = vec![LAST; boxes.len()];
        let mut heads = Vec::with_capacity(boxes.len());
        let (mut last, mut height) = (LAST, 0);
        for index in keys.iter().map(|&key| key as u32) {
            let same = last != LAST && words(&boxes[last as usize]) == words(&boxes[index as usize]);
            if same && height < MAX_BLOCKS * WIDTH {
                next[last as usize] = index;
                height += 1;
            } else {
                heads.push(index);
                height = 1;
            }
            last = index;
        }
        // In the order they came, which is better for the caches than that of their hashes.
        heads.sort_unstable();
        Piles { heads, next }
    }

    fn members(&self, pile: u32) -> impl Iterator<Item = u32> {
        std::iter::successors(Some(self.heads[pile as usize]), |&i| Some(self.next[i as usize]).filter(|&n| n != LAST))
    }
}

/// What obvhs calls a medium build, with one box in each leaf.
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
    piles: &'a Piles,
    corners: &'a [[Vec3; 3]],
    prims: &'a [PrimId],
    /// Triangles below each binary node.
    counts: Vec<u32>,
    /// The cost of what is below a binary node if it takes up at most 1, 2, … 7 places of its parent.
    costs: Vec<[f32; WIDTH - 1]>,
    /// Lengths are multiplied by this before they make areas: those neither overflow nor vanish.
    scale: f32,
    tree: Tree,
}

impl<'a> Collapse<'a> {
    fn new(binary: &'a Bvh2, piles: &'a Piles, corners: &'a [[Vec3; 3]], prims: &'a [PrimId]) -> Collapse<'a> {
        let scale = 1.0 / binary.nodes[0].aabb().diagonal().max_element();
        let count = binary.nodes.len();
        Collapse {
            binary,
            piles,
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
        while let Some((index, place)) = pending.pop() {
            pace.step(64);
            self.emit(index, place, &mut pending);
        }
        self.tree
    }

    /// Indices of the two below a binary node, unless that is a leaf.
    fn pair(&self, index: usize) -> Option<[usize; 2]> {
        let node = &self.binary.nodes[index];
        let first = node.first_index as usize;
        (!node.is_leaf()).then_some([first, first + 1])
    }

    /// The piles in a binary leaf.
    fn leaf_piles(&self, index: usize) -> impl Iterator<Item = u32> {
        let leaf = &self.binary.nodes[index];
        let first = leaf.first_index as usize;
        self.binary.primitive_indices[first..first + leaf.prim_count as usize].iter().copied()
    }

    fn find_costs(&mut self) {
        // Reinsertion leaves no order of the nodes to rely on.
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
                self.counts[index] = self.leaf_piles(index).map(|pile| self.piles.members(pile).count() as u32).sum();
                self.costs[index] = [self.leaf_cost(index); WIDTH - 1];
                continue;
            };
            self.counts[index] = self.counts[pair[0]] + self.counts[pair[1]];
            let mut cost = self.leaf_cost(index).min(self.node_cost(index, pair));
            self.costs[index][0] = cost;
            for places in 2..WIDTH {
                cost = cost.min(self.cheapest_split(pair, places).0);
                self.costs[index][places - 1] = cost;
            }
        }
    }

    fn area(&self, index: usize) -> f32 {
        let d = self.binary.nodes[index].aabb().diagonal() * self.scale;
        d.x * d.y + d.y * d.z + d.z * d.x
    }

    fn leaf_cost(&self, index: usize) -> f32 {
        let blocks = (self.counts[index] as usize).div_ceil(WIDTH);
        if blocks > MAX_BLOCKS { f32::INFINITY } else { self.area(index) * BLOCK_COST * blocks as f32 }
    }

    fn node_cost(&self, index: usize, pair: [usize; 2]) -> f32 {
        self.area(index) * NODE_COST + self.cheapest_split(pair, WIDTH).0
    }

    /// The least cost of a pair that shares a number of places (at least two), and how many of them the first takes.
    fn cheapest_split(&self, pair: [usize; 2], places: usize) -> (f32, usize) {
        let [a, b] = pair.map(|i| &self.costs[i]);
        let cost = |first: usize| a[first - 1] + b[places - first - 1];
        (1..places)
            .map(|first| (cost(first), first))
            .fold((f32::INFINITY, 1), |best, x| if x.0 < best.0 { x } else { best })
    }

    /// Fills a node with what is below a binary one.
    fn emit(&mut self, index: usize, place: usize, pending: &mut Vec<(usize, usize)>) {
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
        self.tree.nodes[place] = node;
    }

    fn cut_pair(&self, pair: [usize; 2], places: usize, children: &mut Vec<usize>) {
        let (_, first) = self.cheapest_split(pair, places);
        self.cut(pair[0], first, children);
        self.cut(pair[1], places - first, children);
    }

    /// The binary nodes that take up the places given to one.
    fn cut(&self, index: usize, places: usize, children: &mut Vec<usize>) {
        let costs = &self.costs[index];
        match self.pair(index) {
            Some(pair) if costs[places - 1] < costs[0] => {
                // Fewer places may do as well.
                let needed =
                    (1..places).rev().take_while(|&n| costs[n - 1] == costs[places - 1]).last().unwrap_or(places);
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
                    let members = self.leaf_piles(index).flat_map(|pile| self.piles.members(pile));
                    prims.extend(members.map(|i| self.prims[i as usize]));
                }
            }
        }
        let first = self.tree.blocks.len();
        self.tree.blocks.extend(prims.chunks(WIDTH).map(|chunk| Block::new(chunk, self.corners)));
        Child::leaf(first, self.tree.blocks.len() - first)
    }
}
