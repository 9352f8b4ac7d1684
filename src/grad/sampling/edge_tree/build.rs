//! Building the tree: edges of one place and size into one node.

use glam::{Vec3, Vec4, Vec4Swizzles};

use super::{EdgeTree, LEAF, Node};
use crate::render::edges::EdgeTable;
use crate::stop::Pace;

/// Planes between which a node may be cut along each axis, and one more.
const BINS: usize = 16;
/// Levels below which nodes are cut in halves, lest the tree become a list.
const DEEP: u32 = 48;

/// What a node takes from an edge.
struct Item {
    p: [Vec3; 2],
    /// Its length, by [`crate::render::edges::Edge::weight`].
    weighted: f32,
    crease: f32,
    mask_jump: f32,
    bright: f32,
    folding: f32,
    open: bool,
    /// Range in `Builder::normals`.
    normals: [u32; 2],
}

/// Edges of a bin, or of a run of bins.
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

    /// How far off a node's importance may be: what it has, over how large an area that may be. (Estevez & Kulla 2018 do so with lights;
    /// of edges boxes may be flat, and are taken by their diagonals.)
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
    /// Of a tree that knows its edges, but has no nodes.
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
                bright: weighted * (1.0 + tree.brightness[e]),
                folding: tree.folding[e],
                open: !edge.is_wound_consistently(),
                normals: [start, normals.len() as u32],
            }
        });
        Builder { items: items.collect(), normals, nodes: Vec::new(), pace: Pace::default() }
    }

    /// The node of some edges, which are brought into the order of its leaves, and all below it.
    pub fn build(&mut self, order: &mut [u32], offset: u32, depth: u32) -> u32 {
        self.pace.step(order.len());
        let points = || order.iter().flat_map(|&e| self.items[e as usize].p);
        let lo = points().fold(Vec3::INFINITY, Vec3::min);
        let hi = points().fold(Vec3::NEG_INFINITY, Vec3::max);
        let centre = 0.5 * (lo + hi);
        let (mut plane_lo, mut plane_hi) = (Vec4::INFINITY, Vec4::NEG_INFINITY);
        let mut open = false;
        let (mut length, mut creases, mut mask_jumps, mut bright, mut folding) = (0.0, 0.0, 0.0, 0.0, 0.0_f32);
        for &e in order.iter() {
            let item = &self.items[e as usize];
            length += item.weighted;
            creases += item.crease;
            mask_jumps += item.mask_jump;
            bright += item.bright;
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
            brightness: bright / length,
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

    /// Brings edges into an order in which they are cut in two, and says where. In halves by number long edges would come to lie with
    /// short ones, and what is far apart with one another: over so large a box an edge counts for nothing, is hardly ever found, and weighs
    /// so much then that a thousand samples tell neither the mean nor its error.
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
        if depth < DEEP && extent.max_element() > 0.0 && extent.is_finite() {
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
        // Stable on either side: nothing depends on how a library sorts.
        let (left, right): (Vec<u32>, Vec<u32>) = order.iter().partition(|&&e| bin(e)[axis] < at);
        order[..left.len()].copy_from_slice(&left);
        order[left.len()..].copy_from_slice(&right);
        left.len()
    }
}
