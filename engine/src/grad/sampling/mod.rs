//! Where samples go: how many each term draws, on which pixels and edges, and what pilots learn for them.

pub mod allocate;
pub(super) mod chains;
pub(super) mod contrast;
pub mod edge_tree;
pub mod guide;
pub(super) mod jumps;
pub(super) mod pixels;
