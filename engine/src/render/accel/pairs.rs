//! Pairs of triangles whose boxes overlap, or nearly do.

use std::sync::atomic::Ordering;

use glam::Vec3;
use rayon::prelude::*;

use super::tree::{Block, Child, Tree, WIDTH};
use super::{Accel, NO_PRIM, PrimId};
use crate::memory;
use crate::stop;

impl Accel {
    /// Calls `test` once for every pair of triangles whose boxes are no further apart than `slack` times their coordinates and of which at
    /// least one is `wanted`; returns what it finds, in an order that depends on the tree alone. Takes time O(n log n) for meshes whose
    /// triangles overlap few others.
    pub fn overlapping_pairs<T: Send>(
        &self,
        slack: f32,
        wanted: impl Fn(PrimId) -> bool + Sync,
        test: impl Fn([PrimId; 2], &mut Vec<T>) + Sync,
    ) -> Vec<T> {
        let leaf = |child: &Child| *child != Child::EMPTY && child.node().is_none();
        let leaves: Vec<Child> = self.tree.nodes.iter().flat_map(|n| n.children).filter(leaf).collect();
        let stop = stop::flag();
        let found: Vec<Vec<T>> = leaves
            .par_chunks(256)
            .map(|leaves| {
                let (mut found, mut near) = (Vec::new(), Vec::new());
                let mut granted = 0;
                for leaf in leaves {
                    if stop.load(Ordering::Relaxed) {
                        break;
                    }
                    // The memory for results cannot be asked for beforehand: all triangles may overlap all others. Results are held
                    // twice when they are joined at the end.
                    memory::need(((found.len() - granted) * 2 * size_of::<T>()) as u64);
                    granted = found.len();
                    let own = self.tree.triangles(*leaf).filter(|(prim, _)| wanted(*prim));
                    let own: Vec<(PrimId, Bounds)> = own.map(|(prim, bounds)| (prim, bounds.expanded(slack))).collect();
                    let Some(around) = own.iter().map(|(_, b)| *b).reduce(Bounds::union) else { continue };
                    near.clear();
                    self.tree.find_overlapping(&around, &mut near);
                    for (a, bounds) in &own {
                        let others = near.iter().filter(|(b, _)| b > a || (b < a && !wanted(*b)));
                        for (b, _) in others.filter(|(_, other)| bounds.overlaps(other)) {
                            test([*a, *b], &mut found);
                        }
                    }
                }
                found
            })
            .collect();
        stop::check();
        found.into_iter().flatten().collect()
    }
}

/// An axis-aligned box.
#[derive(Clone, Copy)]
struct Bounds {
    lo: Vec3,
    hi: Vec3,
}

impl Bounds {
    fn union(self, other: Bounds) -> Bounds {
        Bounds { lo: self.lo.min(other.lo), hi: self.hi.max(other.hi) }
    }

    /// Expanded on all sides by a fraction of its largest coordinate.
    fn expanded(self, share: f32) -> Bounds {
        let by = Vec3::splat(share * self.lo.abs().max(self.hi.abs()).max_element());
        Bounds { lo: self.lo - by, hi: self.hi + by }
    }

    fn overlaps(&self, other: &Bounds) -> bool {
        self.lo.cmple(other.hi).all() && other.lo.cmple(self.hi).all()
    }
}

impl Tree {
    /// The triangles of a leaf with their boxes.
    fn triangles(&self, leaf: Child) -> impl Iterator<Item = (PrimId, Bounds)> {
        self.blocks[leaf.blocks()].iter().flat_map(Block::triangles)
    }

    /// Adds to `found` all triangles whose boxes overlap a given one.
    fn find_overlapping(&self, around: &Bounds, found: &mut Vec<(PrimId, Bounds)>) {
        let mut pending = vec![0];
        while let Some(index) = pending.pop() {
            let node = &self.nodes[index];
            let mut overlaps = [true; WIDTH];
            for (axis, [lo, hi]) in node.bounds.iter().enumerate() {
                for i in 0..WIDTH {
                    overlaps[i] &= lo[i] <= around.hi[axis] && around.lo[axis] <= hi[i];
                }
            }
            for (child, _) in node.children.iter().zip(overlaps).filter(|(_, overlaps)| *overlaps) {
                match child.node() {
                    Some(inner) => pending.push(inner),
                    None => found.extend(self.triangles(*child).filter(|(_, bounds)| bounds.overlaps(around))),
                }
            }
        }
    }
}

impl Block {
    fn triangles(&self) -> impl Iterator<Item = (PrimId, Bounds)> {
        let corner = |vertex: usize, lane: usize| Vec3::from_array(self.corners[vertex].map(|axis| axis[lane]));
        let filled = self.prims.iter().enumerate().take_while(|(_, prim)| **prim != NO_PRIM);
        filled.map(move |(lane, &prim)| {
            let [a, b, c] = [0, 1, 2].map(|vertex| corner(vertex, lane));
            (prim, Bounds { lo: a.min(b).min(c), hi: a.max(b).max(c) })
        })
    }
}
