//! Chains of specular surfaces: the ways on which mirrors and smooth glass lead light, seen from the camera or followed from a light.

use glam::Vec3;

use super::accel::{NO_PRIM, PrimId, Ray};
use super::bodies::Inside;
use super::bsdf::Lobe;
use super::interaction::SurfaceInteraction;
use super::world::Scene;

/// Most specular surfaces of a chain.
pub const LONGEST: usize = 16;

/// What a chain carries along its rays.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Transport {
    /// Radiance, against the rays, as paths from the camera do. It is in proportion to the square of the index around it.
    Radiance,
    /// Power, along the rays, as paths from a light do.
    Power,
}

/// A chain of specular surfaces along a ray, and what it ends at.
#[derive(Clone, Debug, Default)]
pub struct Chain {
    /// Its vertices.
    pub links: Vec<Link>,
    /// The ray that it begins with, and then that of each link.
    pub rays: Vec<Ray>,
    /// The surface at which it ends with its distance: one that is not specular, or that was reached by the last bounce, or that sends
    /// nothing into the chosen lobe. `None` where the chain leaves the scene.
    pub end: Option<(SurfaceInteraction, f32)>,
    /// The bodies around its beginning.
    start: Inside,
}

/// A vertex of a chain.
#[derive(Clone, Copy, Debug)]
pub struct Link {
    pub si: SurfaceInteraction,
    /// The distance from the vertex before.
    pub t: f32,
    pub lobe: Lobe,
    /// The factor on what is carried, over the probability of the lobe, and that probability.
    pub factor: Vec3,
    pub probability: f32,
    /// The product of these factors, of this link and those before, and of what bodies do not absorb on the way here.
    pub weight: Vec3,
    /// The bodies that the chain is in after it.
    pub inside: Inside,
}

impl Chain {
    /// Follows a ray over at most so many specular surfaces; `choose` says into which lobe a surface sends it, and with what probability.
    /// Masks are not seen.
    pub fn follow(
        &mut self,
        scene: &Scene,
        ray: Ray,
        most: usize,
        transport: Transport,
        mut choose: impl FnMut(usize, &SurfaceInteraction) -> (Lobe, f32),
    ) {
        self.links.clear();
        self.rays.clear();
        self.rays.push(ray);
        self.end = None;
        self.start = scene.around(ray.origin);
        let (mut skip, mut weight, mut inside) = (NO_PRIM, Vec3::ONE, self.start);
        while let Some(ray) = self.rays.last()
            && let Some((si, t)) = scene.intersect(ray, &[skip])
        {
            self.end = Some((si, t));
            let k = self.links.len();
            if !si.bsdf.is_delta() || k >= LONGEST.min(most) {
                break;
            }
            let (lobe, p) = choose(k, &si);
            let Some(sample) = si.specular_sample(lobe) else { break };
            let scale = match transport {
                Transport::Radiance => 1.0,
                Transport::Power => sample.eta * sample.eta,
            };
            let factor = sample.f * (scale / p);
            weight *= scene.attenuated(&inside, t) * factor;
            if lobe.transmits() {
                scene.pass(&mut inside, &si);
            }
            skip = si.prim;
            self.rays.push(si.spawn_ray(sample.wo));
            self.links.push(Link { si, t, lobe, factor, probability: p, weight, inside });
            self.end = None;
        }
    }

    /// The primitive that it hits after `k` links; [`NO_PRIM`] where it has left the scene.
    pub fn prim(&self, k: usize) -> PrimId {
        let end = || self.end.as_ref().map_or(NO_PRIM, |(si, _)| si.prim);
        self.links.get(k).map_or_else(end, |link| link.si.prim)
    }

    /// The bodies that it is in after `k` links.
    pub fn inside(&self, k: usize) -> &Inside {
        k.checked_sub(1).map_or(&self.start, |before| &self.links[before].inside)
    }

    /// The product of the factors of all links, and of what bodies do not absorb on the way to the last.
    pub fn weight(&self) -> Vec3 {
        self.links.last().map_or(Vec3::ONE, |link| link.weight)
    }
}
