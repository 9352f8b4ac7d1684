//! Where samples go: how many each term draws, on which pixels and edges, and what pilots learn for them.

pub mod allocate;
pub mod chains;
pub mod contrast;
pub mod edge_tree;
pub mod guide;
pub mod jumps;
pub mod pixels;
