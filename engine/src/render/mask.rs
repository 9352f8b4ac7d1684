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

/// The weight that masks give to the surface that a ray hits: `weight` is pass · opacity · inv_choice.
#[derive(Clone, Copy, Debug)]
pub struct MaskWeight {
    /// Product of the weights of the masks passed.
    pub pass: f32,
    /// Opacity of the surface that is hit; 1 without a mask.
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
    /// In proportion to opacity, so that all weights are one. For values, and for derivatives in slots that do not change opacities.
    Opacity,
    /// In proportion to opacity, but neither side is rare if the mask is neither opaque nor clear. For derivatives of points that slide
    /// over a mask.
    PartlyOpaque,
    /// Neither side is ever rare. For derivatives in opacities, which need both sides everywhere.
    BothSides,
}

/// The least probability of either side if neither may be rare.
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
        // Rounding in the interpolation may leave the range.
        shape.material.opacity.map(|input| self.lookup(input, prim, b).x.clamp(0.0, 1.0))
    }

    /// Samples the surface at which a ray stops, with its distance and the weight of the masks. `cross` is called with the masks passed,
    /// unless they are sampled by opacity.
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

    /// [`Scene::sample_interaction`] with masks sampled by opacity.
    #[inline]
    pub(crate) fn random_interaction(
        &self,
        ray: &Ray,
        skip: &[PrimId],
        sampler: &mut Sampler,
    ) -> Option<(SurfaceInteraction, f32)> {
        self.sample_interaction(ray, skip, sampler, MaskSampling::Opacity, |_| ()).0
    }

    /// The hit at which a ray stops, with masks sampled by opacity.
    #[inline]
    pub(crate) fn random_hit(&self, ray: &Ray, skip: &[PrimId], sampler: &mut Sampler) -> Option<Hit> {
        self.sample_hit(ray, skip, sampler, MaskSampling::Opacity, |_| ()).0
    }

    /// The hit at which a ray stops, and the weight of the masks.
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
        let hit = self.walk(ray, skip, &mut |hit| {
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

    /// Transmittance of the masks along a ray; 0 behind an opaque surface.
    #[inline]
    pub(crate) fn transmittance(&self, ray: &Ray, skip: &[PrimId]) -> f32 {
        self.unoccluded(ray, None, skip, MaskSampling::Opacity, |_| ()).unwrap_or(0.0)
    }

    /// [`Scene::transmittance`] with the masks passed, for which `cross` is called. `None` if it is zero and has no derivative, or none
    /// in opacities is requested.
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
        // Behind a single opaque mask the transmittance is zero but has a derivative in the opacity; behind two it has none.
        let allowed = u32::from(sampling == MaskSampling::BothSides);
        let (mut pass, mut opaque) = (1.0, 0);
        let end = self.walk(ray, skip, &mut |hit| {
            let Some(opacity) = self.opacity(hit.prim, hit.b) else { return true };
            opaque += u32::from(opacity >= 1.0);
            pass *= 1.0 - opacity;
            cross(MaskCrossing { prim: hit.prim, b: hit.b, t: hit.t, opacity, inv_choice: 1.0 });
            opaque > allowed
        });
        end.is_none().then_some(pass)
    }

    /// The masks that a ray passes. A ray right beside an edge skips these by id: both rays pass the same masks, and only what is behind
    /// them differs. (Skipping by distance would not do, because the ray beside the edge may hit another surface at the same distance.)
    pub(crate) fn masks_passed(&self, ray: &Ray, skip: &[PrimId]) -> Vec<PrimId> {
        let mut passed = Vec::new();
        if self.masked {
            self.unoccluded(ray, None, skip, MaskSampling::Opacity, |crossing| passed.push(crossing.prim));
        }
        passed
    }

    /// The first hit that is `wanted`, if no opaque surface is in front of it. Returns its distance too, and its opacity times the
    /// transmittance of the masks in front.
    pub(crate) fn first_wanted(
        &self,
        ray: &Ray,
        skip: &[PrimId],
        wanted: impl Fn(&SurfaceInteraction) -> bool,
    ) -> Option<(SurfaceInteraction, f32, f32)> {
        let mut through = 1.0;
        let mut found = None;
        self.walk(ray, skip, &mut |hit| {
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

    /// The first hit along a ray that `is_end` accepts. It is called for the hits in order of their distance. (By a reference, so that the
    /// walk is compiled once and not for each of twenty callers.)
    pub(super) fn walk(&self, ray: &Ray, skip: &[PrimId], is_end: &mut dyn FnMut(&Hit) -> bool) -> Option<Hit> {
        let first = self.accel.closest(ray, skip)?;
        if is_end(&first) {
            return Some(first);
        }
        let (mut ray, mut passed) = (*ray, skip.to_vec());
        let mut last = first;
        loop {
            // Triangles at the same distance are visited one after the other, each once.
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
