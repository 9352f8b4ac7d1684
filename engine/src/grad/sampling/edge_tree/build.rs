//! Builds the edge tree: edges that are close to each other and of similar size share a node.

use glam::{Vec3, Vec4, Vec4Swizzles};

use super::{EdgeTree, LEAF, Node};
use crate::render::edges::EdgeTable;
use crate::stop::Pace;

/// Number of bins along each axis. A node may be split between any two of them.
const BINS: usize = 16;
/// Nodes deeper than this are split into halves of equal number, so that the depth of the tree is bounded.
const MAX_BINNED_DEPTH: u32 = 48;

/// The numbers of an edge from which those of a node are computed.
struct Item {
    p: [Vec3; 2],
    /// Length times [`crate::render::edges::Edge::weight`].
    weighted: f32,
    crease: f32,
    mask_jump: f32,
    bright_length: f32,
    folding: f32,
    open: bool,
    /// The range of its faces' normals in `Builder::normals`.
    normals: [u32; 2],
}

/// The box around the edges of one or more bins, with their number and weighted length.
#[derive(Clone, Copy)]
struct Bounds {
    lo: Vec3,
    hi: Vec3,
    weighted: f32,
    count: u32,
}

impl Bounds {
    const NONE: Bounds = Bounds { lo: Vec3::INFINITY, hi: Vec3::NEG_INFINITY, weighted: 0.0, count: 0 };

    fn with(self, other: Bounds) -> Bounds {
        Bounds {
            lo: self.lo.min(other.lo),
            hi: self.hi.max(other.hi),
            weighted: self.weighted + other.weighted,
            count: self.count + other.count,
        }
    }

    /// Cost of a node: its weighted length times the squared diagonal of its box. A large box makes the importance of a node imprecise, and
    /// the more so the more length is in it. (Estevez & Kulla 2018, "Importance Sampling of Many Lights with Adaptive Tree Splitting",
    /// use power times surface area for lights. Boxes of edges may be flat, so the diagonal stands for the area.)
    fn cost(&self) -> f32 {
        if self.count == 0 { 0.0 } else { self.weighted * (self.hi - self.lo).length_squared() }
    }
}

pub struct Builder {
    items: Vec<Item>,
    normals: Vec<Vec3>,
    pub nodes: Vec<Node>,
    pace: Pace,
}

impl Builder {
    /// A builder for a tree that has its tables by edge, but no nodes yet.
    pub fn new(tree: &EdgeTree, table: &EdgeTable) -> Builder {
        let mut normals = Vec::with_capacity(2 * table.edges.len());
        let items = table.edges.iter().enumerate().map(|(e, edge)| {
            let start = normals.len() as u32;
            normals.extend(edge.faces.iter().map(|f| edge.face_normal(f)));
            let weighted = edge.length() * edge.weight;
            Item {
                p: edge.p,
                weighted,
                crease: edge.length() * tree.crease[e],
                mask_jump: edge.length() * tree.mask_jump[e],
                bright_length: weighted * (1.0 + tree.brightness[e]),
                folding: tree.folding[e],
                open: !edge.is_wound_consistently(),
                normals: [start, normals.len() as u32],
            }
        });
        Builder { items: items.collect(), normals, nodes: Vec::new(), pace: Pace::default() }
    }

    /// Builds the subtree over some edges, whose place in the tree's order begins at `offset`, and sorts `order` by its leaves. Returns the
    /// index of its root.
    pub fn build(&mut self, order: &mut [u32], offset: u32, depth: u32) -> u32 {
        self.pace.step(order.len());
        let points = || order.iter().flat_map(|&e| self.items[e as usize].p);
        let lo = points().fold(Vec3::INFINITY, Vec3::min);
        let hi = points().fold(Vec3::NEG_INFINITY, Vec3::max);
        let centre = 0.5 * (lo + hi);
        let (mut plane_lo, mut plane_hi) = (Vec4::INFINITY, Vec4::NEG_INFINITY);
        let mut open = false;
        let (mut length, mut creases, mut mask_jumps, mut bright_length, mut folding) = (0.0, 0.0, 0.0, 0.0, 0.0_f32);
        for &e in order.iter() {
            let item = &self.items[e as usize];
            length += item.weighted;
            creases += item.crease;
            mask_jumps += item.mask_jump;
            bright_length += item.bright_length;
            folding = folding.max(item.folding);
            open |= item.open;
            for n in &self.normals[item.normals[0] as usize..item.normals[1] as usize] {
                let plane = n.extend(n.dot(item.p[0] - centre));
                plane_lo = plane_lo.min(plane);
                plane_hi = plane_hi.max(plane);
            }
        }
        let at = self.nodes.len();
        self.nodes.push(Node {
            lo,
            hi,
            length,
            creases,
            mask_jumps,
            folding,
            brightness: bright_length / length,
            plane_lo,
            plane_hi,
            spread: (plane_hi - plane_lo).xyz().length(),
            open,
            start: offset,
            count: order.len() as u32,
            second: 0,
        });
        if order.len() > LEAF {
            let middle = self.cut(order, depth);
            let (left, right) = order.split_at_mut(middle);
            self.build(left, offset, depth + 1);
            let second = self.build(right, offset + middle as u32, depth + 1);
            self.nodes[at].second = second;
        }
        at as u32
    }

    /// Partitions edges into two groups where the sum of their costs is least; returns the size of the first group. (Split into halves by
    /// number, nodes would mix long with short edges and edges that are far apart. In so large a box a short edge has hardly any
    /// importance. It would be found very rarely and then with a very large weight, so that a thousand samples would give neither the
    /// mean nor its error.)
    fn cut(&self, order: &mut [u32], depth: u32) -> usize {
        let key = |e: u32| {
            let p = self.items[e as usize].p;
            p[0] + p[1]
        };
        let lo = order.iter().fold(Vec3::INFINITY, |m, &e| m.min(key(e)));
        let hi = order.iter().fold(Vec3::NEG_INFINITY, |m, &e| m.max(key(e)));
        let extent = hi - lo;
        let scale = Vec3::splat(BINS as f32) / extent.max(Vec3::splat(f32::MIN_POSITIVE));
        let bin = |e: u32| ((key(e) - lo) * scale).min(Vec3::splat(BINS as f32 - 1.0)).as_uvec3();
        let mut best: Option<(f32, usize, u32)> = None;
        if depth < MAX_BINNED_DEPTH && extent.max_element() > 0.0 && extent.is_finite() {
            let mut bins = [[Bounds::NONE; BINS]; 3];
            for &e in order.iter() {
                let Item { p: [a, b], weighted, .. } = self.items[e as usize];
                let own = Bounds { lo: a.min(b), hi: a.max(b), weighted, count: 1 };
                for (bins, at) in bins.iter_mut().zip(bin(e).to_array()) {
                    bins[at as usize] = bins[at as usize].with(own);
                }
            }
            for (axis, bins) in bins.iter().enumerate() {
                let mut above = [Bounds::NONE; BINS + 1];
                for i in (0..BINS).rev() {
                    above[i] = above[i + 1].with(bins[i]);
                }
                let mut below = Bounds::NONE;
                for i in 1..BINS {
                    below = below.with(bins[i - 1]);
                    let cost = below.cost() + above[i].cost();
                    if below.count > 0 && above[i].count > 0 && best.is_none_or(|(least, ..)| cost < least) {
                        best = Some((cost, axis, i as u32));
                    }
                }
            }
        }
        let Some((_, axis, at)) = best else {
            let (middle, axis) = (order.len() / 2, extent.max_position());
            let key = |e: &u32| key(*e)[axis];
            order.select_nth_unstable_by(middle, |a, b| key(a).total_cmp(&key(b)).then(a.cmp(b)));
            return middle;
        };
        // Both groups keep their order, so that the result does not depend on a library's sorting.
        let (left, right): (Vec<u32>, Vec<u32>) = order.iter().partition(|&&e| bin(e)[axis] < at);
        order[..left.len()].copy_from_slice(&left);
        order[left.len()..].copy_from_slice(&right);
        left.len()
    }
}
