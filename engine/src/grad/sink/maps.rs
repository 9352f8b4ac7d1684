//! Adjoints of what is looked up by direction: the environment, and profiles of lights.

use glam::{Vec2, Vec3};

use super::{Adjoints, NONE};
use crate::render::SphericalMap;
use crate::render::environment::{d_environment_uv, environment_uv};
use crate::render::texture::{Footprint, Texture};

impl Adjoints<'_> {
    /// Adjoint of the environment's radiance in the world direction `dir`; returns the adjoint of `dir`.
    pub fn environment(&mut self, dir: Vec3, d: Vec3) -> Vec3 {
        let scene = self.scene;
        let Some(e) = &scene.description.environment else { return Vec3::ZERO };
        let texture = &scene.description.textures[e.texels];
        let start = self.layout.texels[e.texels];
        if texture.is_constant() {
            self.add3(start, 0, d);
            return Vec3::ZERO;
        }
        if start == NONE && self.layout.is_static {
            return Vec3::ZERO;
        }
        let footprint = texture.environment_footprint(environment_uv(e.rotation.transpose() * dir));
        if start != NONE {
            let sink = &mut *self.sink;
            texture.scatter_footprint(&footprint, d, |i, v| sink.add(start as usize + i, v));
        }
        if self.layout.is_static {
            return Vec3::ZERO;
        }
        self.turned_map(e, self.layout.environment_rotation, texture, &footprint, dir, d)
    }

    /// Adjoint of the value of a map that is rotated like `e`, in the world direction `dir`; returns the adjoint of `dir`. The adjoint of
    /// the rotation goes to the slot that starts at `start`.
    fn turned_map(
        &mut self,
        e: &SphericalMap,
        start: u32,
        map: &Texture,
        footprint: &Footprint,
        dir: Vec3,
        d: Vec3,
    ) -> Vec3 {
        let [du, dv] = map.uv_gradient(footprint);
        let local = e.rotation.transpose() * dir;
        let d_local = d_environment_uv(local, Vec2::new(du.dot(d), dv.dot(d)));
        if start != NONE {
            // local_j = Σ_i R_ij dir_i
            for (i, dir_i) in dir.to_array().into_iter().enumerate() {
                for (j, d_j) in d_local.to_array().into_iter().enumerate() {
                    self.sink.add(start as usize + 3 * i + j, dir_i * d_j);
                }
            }
        }
        e.rotation * d_local
    }

    /// Adjoint of the profile of a goniometric or spot light in the unit direction `dir` away from it; returns the adjoint of `dir`. Other lights
    /// have nothing to pass it on to.
    pub fn light_profile(&mut self, light: u32, dir: Vec3, d: Vec3) -> Vec3 {
        let scene = self.scene;
        let Some(profile) = scene.description.delta_lights[light as usize].profile() else { return Vec3::ZERO };
        let map = &scene.description.textures[profile.texels];
        let start = self.layout.texels[profile.texels];
        if map.is_constant() {
            self.add3(start, 0, d);
            return Vec3::ZERO;
        }
        let footprint = map.environment_footprint(environment_uv(profile.rotation.transpose() * dir));
        if start != NONE {
            let sink = &mut *self.sink;
            map.scatter_footprint(&footprint, d, |i, v| sink.add(start as usize + i, v));
        }
        self.turned_map(&profile, self.layout.light_rotation[light as usize], map, &footprint, dir, d)
    }

    /// Adjoint of the radiance of the environment's base (all of it but its peak) in a fixed world direction `dir`. The texels of the base
    /// are taken as constants, so that only the environment's rotation gets a derivative.
    pub fn environment_base(&mut self, dir: Vec3, d: Vec3) {
        let scene = self.scene;
        let Some(e) = scene.description.environment.as_ref().filter(|_| self.layout.turns_environment()) else {
            return;
        };
        let map = scene.environment_peak.as_ref().map_or(&scene.description.textures[e.texels], |peak| &peak.base);
        if !map.is_constant() {
            let footprint = map.environment_footprint(environment_uv(e.rotation.transpose() * dir));
            self.turned_map(e, self.layout.environment_rotation, map, &footprint, dir, d);
        }
    }

    /// Adjoint of the radiance of a point of the environment that is seen in the world direction `dir` now and turns with the environment.
    /// Unlike in [`Adjoints::environment`], rotation does not change it, so that only the texels get derivatives.
    pub fn environment_point(&mut self, dir: Vec3, d: Vec3) {
        let Some(e) = &self.scene.description.environment else { return };
        let start = self.layout.texels[e.texels];
        if start == NONE {
            return;
        }
        let texture = &self.scene.description.textures[e.texels];
        if texture.is_constant() {
            return self.add3(start, 0, d);
        }
        let footprint = texture.environment_footprint(environment_uv(e.rotation.transpose() * dir));
        let sink = &mut *self.sink;
        texture.scatter_footprint(&footprint, d, |i, v| sink.add(start as usize + i, v));
    }

    /// Adjoint of the world direction of a point that turns with the environment.
    pub fn environment_direction(&mut self, dir: Vec3, d_dir: Vec3) {
        let Some(e) = self.scene.description.environment.as_ref().filter(|_| self.layout.turns_environment()) else {
            return;
        };
        // dir_i = Σ_j R_ij local_j
        let local = e.rotation.transpose() * dir;
        for (i, d_i) in d_dir.to_array().into_iter().enumerate() {
            for (j, local_j) in local.to_array().into_iter().enumerate() {
                self.sink.add(self.layout.environment_rotation as usize + 3 * i + j, d_i * local_j);
            }
        }
    }
}
