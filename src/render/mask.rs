//! Masks: surfaces with an opacity. A ray hits such a surface with a probability of its opacity, and else passes straight through.
//!
//! Paths choose at random at every mask they hit. Shadow rays carry the transmittance Π(1 − opacity) instead. Opacities are continuous
//! over a surface, so that derivatives need no edges besides those of the mesh.

use super::accel::{Hit, PrimId, Ray, RootHits};
use super::interaction::SurfaceInteraction;
use super::sampler::Sampler;
use super::world::Scene;

/// A masked surface that a ray passes through.
#[derive(Clone, Copy, Debug)]
pub struct MaskCrossing {
    pub prim: PrimId,
    pub b: [f32; 3],
    /// Distance along the ray.
    pub t: f32,
    pub opacity: f32,
    /// 1 / probability of passing.
    pub inv_choice: f32,
}

impl MaskCrossing {
    /// The factor on radiance from behind the mask: its transmittance over the probability of passing.
    pub fn weight(&self) -> f32 {
        (1.0 - self.opacity) * self.inv_choice
    }
}

/// What masks do to what a ray finds: `weight` is pass · opacity · inv_choice.
#[derive(Clone, Copy, Debug)]
pub struct MaskWeight {
    /// Product over the masks passed.
    pub pass: f32,
    /// Of the surface that is found; 1 without a mask.
    pub opacity: f32,
    /// 1 / probability of stopping there.
    pub inv_choice: f32,
    pub weight: f32,
}

impl MaskWeight {
    pub const CLEAR: MaskWeight = MaskWeight { pass: 1.0, opacity: 1.0, inv_choice: 1.0, weight: 1.0 };
}

/// How a path chooses between a mask and what is behind it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MaskSampling {
    /// In proportion to opacity: all weights are one. For values, and derivatives that change no opacity.
    Opacity,
    /// Neither side is rare where the mask is neither opaque nor clear: for derivatives of points that slide over a mask.
    PartlyOpaque,
    /// Neither side is ever rare: for derivatives in the opacities themselves, which need both sides everywhere.
    BothSides,
}

/// The least probability of either side where both are wanted.
const RARE: f32 = 0.1;

impl MaskSampling {
    fn probability(self, opacity: f32) -> f32 {
        let certain = opacity <= 0.0 || opacity >= 1.0;
        match self {
            MaskSampling::Opacity => opacity,
            MaskSampling::PartlyOpaque if certain => opacity,
            MaskSampling::PartlyOpaque | MaskSampling::BothSides => opacity.clamp(RARE, 1.0 - RARE),
        }
    }
}

impl Scene {
    /// Opacity in [0, 1] of a point; `None` if its material has no mask.
    #[inline]
    pub(crate) fn opacity(&self, prim: PrimId, b: [f32; 3]) -> Option<f32> {
        if !self.masked {
            return None;
        }
        let shape = &self.description.shapes[self.prims[prim as usize].shape as usize];
        // Interpolation may round to just outside.
        shape.material.opacity.map(|input| self.lookup(input, prim, b).x.clamp(0.0, 1.0))
    }

    /// The surface that a ray stops at, its distance, and the weight that masks give it. `cross` is told the masks passed, unless
    /// these are passed by opacity.
    #[inline]
    pub(crate) fn sample_interaction(
        &self,
        ray: &Ray,
        skip: &[PrimId],
        sampler: &mut Sampler,
        sampling: MaskSampling,
        cross: impl FnMut(MaskCrossing),
    ) -> (Option<(SurfaceInteraction, f32)>, MaskWeight) {
        let (hit, through) = self.sample_hit(ray, skip, sampler, sampling, cross);
        (hit.map(|hit| (self.interaction(hit.prim, hit.b, -ray.dir), hit.t)), through)
    }

    /// [`Scene::sample_interaction`] with masks passed by opacity.
    #[inline]
    pub(crate) fn random_interaction(
        &self,
        ray: &Ray,
        skip: &[PrimId],
        sampler: &mut Sampler,
    ) -> Option<(SurfaceInteraction, f32)> {
        self.sample_interaction(ray, skip, sampler, MaskSampling::Opacity, |_| ()).0
    }

    /// Where a ray stops, with masks passed by opacity.
    #[inline]
    pub(crate) fn random_hit(&self, ray: &Ray, skip: &[PrimId], sampler: &mut Sampler) -> Option<Hit> {
        self.sample_hit(ray, skip, sampler, MaskSampling::Opacity, |_| ()).0
    }

    /// Where a ray stops, and what the masks on the way do to that.
    #[inline(always)]
    pub(crate) fn sample_hit(
        &self,
        ray: &Ray,
        skip: &[PrimId],
        sampler: &mut Sampler,
        sampling: MaskSampling,
        cross: impl FnMut(MaskCrossing),
    ) -> (Option<Hit>, MaskWeight) {
        if !self.masked {
            return (self.accel.closest(ray, skip), MaskWeight::CLEAR);
        }
        self.sample_hit_with_masks(ray, skip, sampler, sampling, cross)
    }

    fn sample_hit_with_masks(
        &self,
        ray: &Ray,
        skip: &[PrimId],
        sampler: &mut Sampler,
        sampling: MaskSampling,
        mut cross: impl FnMut(MaskCrossing),
    ) -> (Option<Hit>, MaskWeight) {
        let mut through = MaskWeight::CLEAR;
        let hit = self.walk(ray, skip, |hit| {
            let Some(opacity) = self.opacity(hit.prim, hit.b) else { return true };
            let p = sampling.probability(opacity);
            if p >= 1.0 || (p > 0.0 && sampler.next_1d() < p) {
                (through.opacity, through.inv_choice) = (opacity, 1.0 / p);
                return true;
            }
            if sampling != MaskSampling::Opacity {
                let inv_choice = 1.0 / (1.0 - p);
                let crossing = MaskCrossing { prim: hit.prim, b: hit.b, t: hit.t, opacity, inv_choice };
                through.pass *= crossing.weight();
                cross(crossing);
            }
            false
        });
        if sampling != MaskSampling::Opacity {
            through.weight = through.pass * through.opacity * through.inv_choice;
        }
        (hit, through)
    }

    /// What masks let through along a ray, 0 behind anything solid.
    #[inline]
    pub(crate) fn transmittance(&self, ray: &Ray, skip: &[PrimId]) -> f32 {
        self.unoccluded(ray, None, skip, MaskSampling::Opacity, |_| ()).unwrap_or(0.0)
    }

    /// [`Scene::transmittance`]; `None` where it is zero and no opacity can change that, or none is asked for. `cross`
    /// is told the masks passed.
    #[inline]
    pub(crate) fn unoccluded(
        &self,
        ray: &Ray,
        root: Option<&RootHits>,
        skip: &[PrimId],
        sampling: MaskSampling,
        mut cross: impl FnMut(MaskCrossing),
    ) -> Option<f32> {
        if !self.masked {
            return (!self.accel.occluded_from(ray, root, skip)).then_some(1.0);
        }
        if !(ray.origin.is_finite() && ray.dir.is_finite()) {
            return None;
        }
        // One opaque mask may still become less so, where that is asked for; two hide each other.
        let allowed = u32::from(sampling == MaskSampling::BothSides);
        let (mut pass, mut opaque) = (1.0, 0);
        let end = self.walk(ray, skip, |hit| {
            let Some(opacity) = self.opacity(hit.prim, hit.b) else { return true };
            opaque += u32::from(opacity >= 1.0);
            pass *= 1.0 - opacity;
            cross(MaskCrossing { prim: hit.prim, b: hit.b, t: hit.t, opacity, inv_choice: 1.0 });
            opaque > allowed
        });
        end.is_none().then_some(pass)
    }

    /// The masks that a ray passes. Rays right beside it pass the same, and see the same of them: these leave them out where what is
    /// behind makes a difference. (Not all that lies as near: a ray beside one that ends on a surface may meet that before.)
    pub(crate) fn masks_passed(&self, ray: &Ray, skip: &[PrimId]) -> Vec<PrimId> {
        let mut passed = Vec::new();
        if self.masked {
            self.unoccluded(ray, None, skip, MaskSampling::Opacity, |crossing| passed.push(crossing.prim));
        }
        passed
    }

    /// The first surface that is `wanted` if nothing solid is before it, with its distance and what is let through of it: its
    /// opacity, and what the masks in front of it leave.
    pub(crate) fn first_wanted(
        &self,
        ray: &Ray,
        skip: &[PrimId],
        wanted: impl Fn(&SurfaceInteraction) -> bool,
    ) -> Option<(SurfaceInteraction, f32, f32)> {
        let mut through = 1.0;
        let mut found = None;
        self.walk(ray, skip, |hit| {
            let opacity = self.opacity(hit.prim, hit.b);
            let si = self.interaction(hit.prim, hit.b, -ray.dir);
            if wanted(&si) {
                found = Some((si, hit.t, through * opacity.unwrap_or(1.0)));
            } else {
                through *= 1.0 - opacity.unwrap_or(1.0);
            }
            found.is_some() || opacity.is_none()
        });
        found.filter(|f| f.2 > 0.0)
    }

    /// The first hit along a ray that `is_end` accepts; it is asked about one after the other.
    fn walk(&self, ray: &Ray, skip: &[PrimId], mut is_end: impl FnMut(&Hit) -> bool) -> Option<Hit> {
        let first = self.accel.closest(ray, skip)?;
        if is_end(&first) {
            return Some(first);
        }
        let (mut ray, mut passed) = (*ray, skip.to_vec());
        let mut last = first;
        loop {
            // Triangles at the same distance come one after the other, each once.
            if last.t > ray.t_min {
                passed.truncate(skip.len());
                ray.t_min = last.t;
            }
            passed.push(last.prim);
            last = self.accel.closest(&ray, &passed)?;
            if is_end(&last) {
                return Some(last);
            }
        }
    }
}
