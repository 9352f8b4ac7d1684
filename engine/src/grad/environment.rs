//! Which part of an environment's radiance is differentiated as turning with the environment.

use glam::Vec3;
use serde::{Deserialize, Serialize};

use crate::render::Scene;

/// The part of an environment's radiance that turns with the environment. Its shadows are sampled from the edges (`terms::shadow`). The
/// rest is a radiance in fixed directions, whose shadows are sampled from the receivers (`terms::secondary`).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
pub enum MovingEnvironment {
    /// The peak of the map, such as a sun ([`crate::render::environment::EnvironmentPeak`]), if it has one.
    Peak,
    /// All of the map.
    Whole,
}

impl MovingEnvironment {
    /// The fraction of the radiance from a direction that is differentiated with a fixed direction, by channel.
    pub fn direction_fixed_share(self, scene: &Scene, dir: Vec3) -> Vec3 {
        match self {
            MovingEnvironment::Whole => Vec3::ZERO,
            MovingEnvironment::Peak => scene.environment_base_share(dir),
        }
    }
}
