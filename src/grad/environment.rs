//! Which part of an environment's light turns with it.

use glam::Vec3;

use crate::render::Scene;

/// The part of an environment's light that turns with it and whose shadows are sampled from the edges (`terms::shadow`). The rest is a
/// radiance in fixed directions, and its shadows are sampled from the receivers (`terms::secondary`).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum MovingEnvironment {
    /// What stands out of the map, such as a sun ([`crate::render::environment::EnvironmentPeak`]), if anything does.
    Peak,
    Whole,
}

impl MovingEnvironment {
    /// The share of the radiance from a direction that is direction-fixed, by channel.
    pub fn direction_fixed_share(self, scene: &Scene, dir: Vec3) -> Vec3 {
        match self {
            MovingEnvironment::Whole => Vec3::ZERO,
            MovingEnvironment::Peak => scene.environment_base_share(dir),
        }
    }
}
