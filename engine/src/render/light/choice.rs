//! Choosing a light and a point on it.

use glam::{Vec2, Vec3};

use super::table::{Arrival, Entry, LightKind, LightSample, mean_luminance};
use crate::render::accel::PrimId;
use crate::render::sampler::{Discrete, ONE_MINUS_EPSILON};
use crate::render::scene::DeltaLight;
use crate::render::world::Scene;

impl Scene {
    /// Samples a light and a point on it; `None` without lights. The first number chooses the light and is then rescaled and used again,
    /// so that the two dimensions of a light's points stay stratified together with the sample's other dimensions.
    #[inline(always)]
    pub(crate) fn sample_light(&self, u: Vec2) -> Option<LightSample> {
        self.sample_from(&self.lights.entries, &self.lights.pmf, u)
    }

    /// [`Scene::sample_light`], but of the environment only its peak.
    pub(crate) fn sample_local_light(&self, u: Vec2) -> Option<LightSample> {
        self.sample_from(&self.lights.local_entries, &self.lights.local_pmf, u)
    }

    #[inline(always)]
    fn sample_from(&self, entries: &[Entry], pmf: &Discrete, u: Vec2) -> Option<LightSample> {
        let mut light = None;
        self.sample_into(entries, pmf, u, |l| light = Some(*l));
        light
    }

    /// [`Scene::sample_light`] in continuation-passing style: the result is passed to a function for each kind of light, because merging
    /// the kinds into one value would wait for memory.
    #[inline(always)]
    pub(crate) fn sample_light_into(&self, u: Vec2, take: impl FnMut(&LightSample)) {
        self.sample_into(&self.lights.entries, &self.lights.pmf, u, take);
    }

    #[inline(always)]
    fn sample_into(&self, entries: &[Entry], pmf: &Discrete, u: Vec2, mut take: impl FnMut(&LightSample)) {
        if pmf.is_empty() {
            return;
        }
        let (i, p, rest) = pmf.sample(f64::from(u.x));
        let (p, u) = (p as f32, [(rest as f32).min(ONE_MINUS_EPSILON), u.y]);
        if let Entry::Triangle { prim, pdf } = entries[i] {
            // Uniform over the triangle (Turk): low-distortion enough and keeps Sobol's strata connected.
            let s = u[0].sqrt();
            let b = [1.0 - s, s * (1.0 - u[1]), s * u[1]];
            take(&self.light_at(prim, b, pdf));
        } else if let Some(light) = self.sample_other(entries[i], p, u) {
            take(&light);
        }
    }

    /// Samples a light that is not a triangle, which was chosen with probability `p`.
    fn sample_other(&self, entry: Entry, p: f32, u: [f32; 2]) -> Option<LightSample> {
        let base = LightSample { pdf: p, ..LightSample::NONE };
        Some(match entry {
            Entry::Triangle { .. } => return None,
            Entry::Delta(i) => match self.description.delta_lights[i as usize] {
                DeltaLight::Point { position, intensity } => {
                    LightSample { kind: LightKind::Point(i), y: position, power: intensity, ..base }
                }
                DeltaLight::Spot { position, intensity, cone, profile } => {
                    let (kind, has_profile) = (LightKind::Point(i), profile.is_some());
                    LightSample { kind, y: position, power: intensity, cone: Some(cone), has_profile, ..base }
                }
                DeltaLight::Goniometric { position, intensity, .. } => {
                    let kind = LightKind::Point(i);
                    LightSample { kind, y: position, power: intensity, has_profile: true, ..base }
                }
                DeltaLight::Directional { direction, irradiance } => {
                    let y = -direction.normalize();
                    LightSample { kind: LightKind::Directional(i), y, power: irradiance, ..base }
                }
            },
            Entry::Peak => {
                let rotation = self.description.environment.as_ref()?.rotation;
                let peak = self.environment_peak.as_ref()?;
                let (local, pdf) = peak.table.sample(u);
                let y = (rotation * local).normalize();
                let power = self.environment_radiance(y) - self.environment_base(y);
                LightSample { kind: LightKind::Environment, y, power, pdf: p * pdf, ..base }
            }
            Entry::Environment => {
                let rotation = self.description.environment.as_ref()?.rotation;
                // The number that chose the light also chooses the elevation, because that matters most to a guide over this number.
                let (local, pdf) = self.environment.as_ref()?.sample([u[1], u[0]]);
                let y = (rotation * local).normalize();
                let power = self.environment_radiance(y);
                LightSample { kind: LightKind::Environment, y, power, pdf: p * pdf, ..base }
            }
        })
    }

    /// The light that arrives at `x`, without a visibility test; `None` if the light does not shine in that direction. The power of a
    /// light with a profile becomes that in the direction of `x`.
    #[inline]
    pub(crate) fn arrive(&self, light: &mut LightSample, x: Vec3) -> Option<Arrival> {
        let arrival = light.arrive(x)?;
        if light.has_profile
            && let LightKind::Point(i) = light.kind
        {
            let light_there = &self.description.delta_lights[i as usize];
            light.power = light_there.power() * self.profile(light_there, -arrival.dir);
        }
        Some(arrival)
    }

    /// What a light's profile multiplies its intensity by in the unit direction `dir`; 1 without a profile.
    pub(crate) fn profile(&self, light: &DeltaLight, dir: Vec3) -> Vec3 {
        light.profile().map_or(Vec3::ONE, |profile| profile.value_from(&self.description.textures[profile.texels], dir))
    }

    /// The light sample of a given point; `None` if the primitive does not emit.
    #[inline]
    pub(crate) fn area_sample(&self, prim: PrimId, b: [f32; 3], pdf: f32) -> Option<LightSample> {
        let emits = self.shape_shading[self.facets[prim as usize].shape as usize].emits;
        emits.then(|| self.light_at(prim, b, pdf))
    }

    /// The light sample of a given point of an emissive primitive.
    #[inline(always)]
    fn light_at(&self, prim: PrimId, b: [f32; 3], pdf: f32) -> LightSample {
        let facet = &self.facets[prim as usize];
        LightSample {
            kind: LightKind::Area,
            y: facet.point(b),
            n: facet.normal,
            power: self.emitted(prim, b) * self.opacity(prim, b).unwrap_or(1.0),
            pdf,
            prim,
            b,
            two_sided: self.shape_shading[facet.shape as usize].two_sided,
            cone: None,
            has_profile: false,
        }
    }

    /// Luminance emitted per unit area of a primitive, averaged over its shape, up to a constant factor.
    pub(crate) fn emitted_power(&self, prim: PrimId) -> f64 {
        let emission = self.description.shapes[self.prims[prim as usize].shape as usize].emission.as_ref();
        let sides = |two_sided: bool| if two_sided { 2.0 } else { 1.0 };
        emission.map_or(0.0, |e| sides(e.two_sided) * mean_luminance(&self.description, e.radiance))
    }

    /// Solid-angle density with which light sampling finds the direction `dir` of the environment.
    pub(crate) fn environment_pdf(&self, dir: Vec3) -> f32 {
        match (&self.environment, &self.description.environment) {
            (Some(table), Some(e)) => {
                self.lights.environment_pmf * table.pdf((e.rotation.transpose() * dir).normalize())
            }
            _ => 0.0,
        }
    }
}

#[cfg(test)]
mod tests {
    use std::f32::consts::TAU;

    use glam::Mat3;

    use super::*;
    use crate::math::Pcg32;
    use crate::mesh::Mesh;
    use crate::render::material::{Input, Material, MaterialKind};
    use crate::render::scene::{Cone, Emission, SceneDescription, Shape, SphericalMap};
    use crate::render::texture::{Filter, Texture, Wrap};

    const ROWS: usize = 10;
    const COLUMNS: usize = 12;

    /// Two glowing meshes of very different power, a point light, a sun, a sky with one bright spot, turned.
    fn scene() -> Scene {
        let mut d = SceneDescription::default();
        let glow = |d: &mut SceneDescription, vertices: Vec<Vec3>, faces: Vec<[u32; 3]>, radiance: f32| {
            d.textures.push(Texture::constant(Vec3::splat(radiance)));
            let radiance = Input::Texture(d.textures.len() - 1);
            d.shapes.push(Shape {
                mesh: Mesh { vertices, faces, ..Mesh::default() },
                material: Material::from(MaterialKind::Black),
                emission: Some(Emission { radiance, two_sided: true }),
            });
        };
        let v = Vec3::new;
        let quad = vec![v(0.0, 0.0, 0.0), v(2.0, 0.0, 0.0), v(2.5, 1.0, 0.3), v(0.0, 0.7, 0.0)];
        glow(&mut d, quad, vec![[0, 1, 2], [0, 2, 3]], 1.0);
        glow(&mut d, vec![v(0.0, 2.0, 0.0), v(0.1, 2.0, 0.0), v(0.0, 2.0, 0.3)], vec![[0, 1, 2]], 40.0);
        d.delta_lights.push(DeltaLight::Point { position: v(1.0, 1.0, 1.0), intensity: Vec3::splat(0.5) });
        d.delta_lights.push(DeltaLight::Directional { direction: v(0.0, -2.0, 1.0), irradiance: Vec3::splat(0.3) });
        let cone = Cone { axis: v(0.0, -2.0, 0.1), beam: 0.5, cutoff: 1.0 };
        d.delta_lights.push(DeltaLight::Spot {
            position: v(0.5, 2.0, 0.0),
            intensity: Vec3::splat(0.8),
            cone,
            profile: None,
        });
        let mut sky = vec![0.02; 8 * 4 * 3];
        sky[(8 + 7) * 3..][..3].fill(3.0);
        d.textures.push(Texture::new(8, 4, 3, sky, Wrap::Repeat, Filter::Bilinear).unwrap());
        let rotation = Mat3::from_rotation_x(0.7) * Mat3::from_rotation_y(1.9);
        d.environment = Some(SphericalMap { texels: d.textures.len() - 1, rotation });
        Scene::new(d).unwrap()
    }

    fn sky_bin(dir: Vec3) -> usize {
        let row = ((0.5 - 0.5 * dir.y) * ROWS as f32) as usize;
        let column = ((dir.x.atan2(dir.z) / TAU + 0.5) * COLUMNS as f32) as usize;
        row.min(ROWS - 1) * COLUMNS + column.min(COLUMNS - 1)
    }

    /// The corner of its triangle a point belongs to, or the middle: four parts of equal area.
    fn quarter(b: [f32; 3]) -> usize {
        b.iter().position(|&b| b > 0.5).unwrap_or(3)
    }

    #[test]
    fn samples_follow_the_densities() {
        const N: usize = 200_000;
        let scene = scene();
        let prims = scene.prims.len();
        let sky = prims * 4 + scene.description.delta_lights.len();
        let mut found = vec![0.0; sky + ROWS * COLUMNS];
        let mut expected = found.clone();
        for prim in 0..prims {
            let [a, b, c] = scene.corners(prim as u32);
            let area = 0.5 * (b - a).cross(c - a).length();
            expected[4 * prim..4 * prim + 4].fill(f64::from(scene.lights.area_pdf(prim as u32) * area) / 4.0);
        }
        let fine = 960;
        for i in 0..fine * fine {
            let y = 1.0 - 2.0 * ((i / fine) as f32 + 0.5) / fine as f32;
            let (sin, cos) = (TAU * ((i % fine) as f32 + 0.5) / fine as f32).sin_cos();
            let ring = (1.0 - y * y).sqrt();
            let dir = Vec3::new(ring * sin, y, ring * cos);
            let area = 4.0 * std::f64::consts::PI / (fine * fine) as f64;
            expected[sky + sky_bin(dir)] += f64::from(scene.environment_pdf(dir)) * area;
        }
        let mut rng = Pcg32::new(17);
        for _ in 0..N {
            let light = scene.sample_light(rng.next_2d().into()).unwrap();
            let (bin, pdf) = match light.kind {
                LightKind::Area => (4 * light.prim as usize + quarter(light.b), scene.lights.area_pdf(light.prim)),
                LightKind::Point(i) | LightKind::Directional(i) => {
                    expected[4 * prims + i as usize] = f64::from(light.pdf);
                    (4 * prims + i as usize, light.pdf)
                }
                LightKind::Environment => (sky + sky_bin(light.y), scene.environment_pdf(light.y)),
            };
            // A direction may round across a border of the map's pieces.
            assert!((light.pdf - pdf).abs() < 1e-4 * pdf || light.kind == LightKind::Environment);
            found[bin] += 1.0;
        }
        let total: f64 = expected.iter().sum();
        assert!((total - 1.0).abs() < 2e-3, "the densities integrate to {total}");
        let (mut chi2, mut freedom) = (0.0, -1.0f64);
        for (e, f) in expected.iter().map(|e| e * N as f64).zip(&found) {
            assert!(e > 5.0, "a bin expects only {e} samples");
            chi2 += (f - e).powi(2) / e;
            freedom += 1.0;
        }
        assert!(chi2 < freedom + 5.0 * (2.0 * freedom).sqrt(), "chi² {chi2:.1} for {freedom} degrees of freedom");
    }

    #[test]
    fn falloff_ends_flat_and_has_its_derivatives() {
        let mut rng = Pcg32::new(23);
        let mut unit = || (Vec3::from_array(rng.next_3d()) * 2.0 - 1.0).normalize();
        for (beam, cutoff) in [(0.2, 0.9), (0.0, 1.5), (0.01, 0.03), (2.0, std::f32::consts::PI)] {
            for i in 0..200 {
                let axis = unit() * 1.7;
                // From the axis to well beyond the cutoff.
                let angle = 1.2 * cutoff * i as f32 / 200.0;
                let side = axis.cross(unit()).normalize();
                let cone = Cone { axis, beam, cutoff };
                let at = |angle: f32| (axis.normalize() * angle.cos() + side * angle.sin()).normalize();
                let dir = at(angle);
                let found = cone.falloff(dir);
                match angle {
                    _ if angle < beam => assert_eq!(found.value, 1.0),
                    _ if angle > 1.001 * cutoff && angle < std::f32::consts::PI => assert_eq!(found.value, 0.0),
                    _ => assert!((0.0..=1.0).contains(&found.value)),
                }
                let h = 2e-3 * (cutoff - beam);
                let close = |found: f32, up: f32, down: f32| {
                    let difference = (up - down) / (2.0 * h);
                    assert!((found - difference).abs() * (cutoff - beam) < 0.02, "{found} {difference}");
                };
                let along = at(angle + 0.5 * std::f32::consts::PI);
                if angle > h {
                    let value = |by: f32| cone.falloff((dir + along * by).normalize()).value;
                    close(found.by_direction.dot(along), value(h), value(-h));
                    let turned = |by: f32| Cone { axis: axis.normalize() + side * by, ..cone }.falloff(dir).value;
                    close(found.by_axis.dot(side), turned(h), turned(-h));
                }
                let beams = |by: f32| Cone { beam: beam + by, ..cone }.falloff(dir).value;
                close(found.by_angles[0], beams(h), beams(-h));
                let ends = |by: f32| Cone { cutoff: cutoff + by, ..cone }.falloff(dir).value;
                close(found.by_angles[1], ends(h), ends(-h));
            }
            // As much as directions all around find.
            let cone = Cone { axis: Vec3::Z, beam, cutoff };
            let n = 20_000;
            let ring = |i: i32| {
                let angle = (i as f32 + 0.5) / n as f32 * cutoff;
                f64::from(
                    cone.falloff(Vec3::new(angle.sin(), 0.0, angle.cos())).value * angle.sin() * cutoff / n as f32,
                )
            };
            let all = std::f64::consts::TAU * (0..n).map(ring).sum::<f64>();
            assert!((cone.solid_angle() - all).abs() < 2e-3 * all, "{} {all}", cone.solid_angle());
        }
    }

    #[test]
    fn arriving_light_has_the_geometry_factor_of_its_kind() {
        let scene = scene();
        let mut rng = Pcg32::new(19);
        let x = Vec3::new(0.3, -1.0, 0.4);
        for _ in 0..200 {
            let mut light = scene.sample_light(rng.next_2d().into()).unwrap();
            let Some(arrival) = scene.arrive(&mut light, x) else { continue };
            assert!((arrival.dir.length() - 1.0).abs() < 1e-5);
            let d = light.y - x;
            let expected = match light.kind {
                LightKind::Area => light.n.dot(d.normalize()).abs() / d.length_squared(),
                LightKind::Point(_) => light.cone.map_or(1.0, |c| c.falloff(-d.normalize()).value) / d.length_squared(),
                _ => 1.0,
            };
            assert!((arrival.geometry - expected).abs() < 1e-4 * expected);
        }
    }
}
