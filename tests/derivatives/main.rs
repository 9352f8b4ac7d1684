//! Derivatives of images, held to closed forms, to differences and to each other.

#[path = "../common/mod.rs"]
mod common;
#[path = "../common/dice.rs"]
mod dice;
#[path = "../common/place.rs"]
mod place;

mod absorption;
mod brushed;
mod cameras;
mod caustics;
mod curved_mirrors;
mod edge_on;
mod edges;
mod gaps;
mod glass;
mod ltc;
mod masks;
mod materials;
mod mip_maps;
mod modes;
mod normal_maps;
mod pixel_filters;
mod random_scenes;
mod rough_glass;
mod shared_edges;
mod slots;
mod spots_and_distortion;
mod translations;
