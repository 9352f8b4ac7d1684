//! Which part of an environment's light turns with it.

use glam::Vec3;

use crate::render::Scene;

/// What of an environment's light is found edge-first, by `terms::shadow`, and turns with it. The rest is left to receiver-first
/// samples, and is a radiance in directions that stay where they are.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Sky {
    /// What stands out, if anything does.
    Peak,
    Whole,
}

impl Sky {
    /// The share of the radiance from a direction that is left, by channel.
    pub fn rest(self, scene: &Scene, dir: Vec3) -> Vec3 {
        match self {
            Sky::Whole => Vec3::ZERO,
            Sky::Peak => scene.environment_base_share(dir),
        }
    }
}
