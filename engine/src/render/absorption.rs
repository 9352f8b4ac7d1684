//! Bodies that absorb light on its way through them: by Beer and Lambert's law exp(−σ t) remains after a distance t, with σ the body's
//! absorption per unit length.
//!
//! Light passes the surface of such a body (a `dielectric`) only by being refracted, so that a path knows which bodies it is in from those that
//! it has entered and not left ([`Inside`]). Where paths start, [`Scene::around`] finds them.

use glam::Vec3;

use super::accel::Ray;
use super::bodies::{Body, Inside, attenuation};
use super::interaction::{SurfaceInteraction, offset};
use super::world::Scene;

impl Scene {
    /// Whether some body absorbs light.
    #[inline(always)]
    pub(crate) fn absorbs(&self) -> bool {
        !self.bodies.is_empty()
    }

    fn body(&self, shape: u32) -> Option<&Body> {
        self.bodies.iter().find(|body| body.shape == shape)
    }

    /// What the innermost of these bodies leaves of light that goes as far in it.
    pub(crate) fn attenuated(&self, inside: &Inside, distance: f32) -> Vec3 {
        let body = inside.body().and_then(|shape| self.body(shape));
        body.map_or(Vec3::ONE, |body| attenuation(body.absorption, distance))
    }

    /// [`Scene::attenuated`] on a way that begins at a point, which lies on no surface of glass.
    pub(crate) fn attenuation_from(&self, p: Vec3, distance: f32) -> Vec3 {
        if self.absorbs() { self.attenuated(&self.around(p), distance) } else { Vec3::ONE }
    }

    /// [`Scene::attenuated`] on a way that begins at a surface, which may be that of rough glass.
    pub(crate) fn attenuation_after(&self, si: &SurfaceInteraction, dir: Vec3, distance: f32) -> Vec3 {
        self.inside_after(si, dir).map_or(Vec3::ONE, |inside| self.attenuated(&inside, distance))
    }

    /// The bodies in which light is that leaves a surface in a direction, by a lobe; `None` where no body absorbs any.
    pub(crate) fn inside_after(&self, si: &SurfaceInteraction, dir: Vec3) -> Option<Inside> {
        self.absorbs().then(|| {
            let mut inside = self.in_front_of(si);
            if si.bsdf.has_both_sides() && si.side(dir) < 0.0 {
                self.pass(&mut inside, si);
            }
            inside
        })
    }

    /// The bodies around a point that lies on no surface of glass.
    pub(crate) fn around(&self, p: Vec3) -> Inside {
        self.around_but(p, None)
    }

    /// The bodies in which light is before it meets a surface.
    pub(crate) fn in_front_of(&self, si: &SurfaceInteraction) -> Inside {
        let own = self.body(si.shape).map(|body| body.shape);
        let mut inside = self.around_but(si.p, own);
        if let Some(own) = own.filter(|_| si.flip < 0.0) {
            inside.enter(own);
        }
        inside
    }

    /// A body is around a point if a ray from there to its surface meets this from inside first, whatever else the ray passes.
    fn around_but(&self, p: Vec3, own: Option<u32>) -> Inside {
        let mut inside = Inside::NOTHING;
        for body in self.bodies.iter().filter(|body| Some(body.shape) != own && body.may_hold(p)) {
            let dir = (body.point - p).normalize_or_zero();
            let ray = Ray { origin: p, dir, t_min: offset(p), t_max: f32::INFINITY };
            let hit = self.walk(&ray, &[], &mut |hit| self.prims[hit.prim as usize].shape == body.shape);
            if hit.is_some_and(|hit| self.facets[hit.prim as usize].normal.dot(dir) > 0.0) {
                inside.enter(body.shape);
            }
        }
        inside
    }

    /// Moves a path through a surface that refracts it.
    pub(crate) fn pass(&self, inside: &mut Inside, si: &SurfaceInteraction) {
        match self.body(si.shape) {
            Some(body) if si.flip > 0.0 => inside.enter(body.shape),
            Some(body) => inside.leave(body.shape),
            None => {}
        }
    }
}
