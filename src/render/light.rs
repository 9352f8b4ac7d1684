//! Choosing a light and a point on it.

use glam::{Vec2, Vec3};

use super::accel::{NO_PRIM, PrimId};
use super::environment::EnvironmentPeak;
use super::sampler::{Discrete, ONE_MINUS_EPSILON};
use super::scene::{Cone, DeltaLight, Input, SceneDescription};
use super::world::{Prim, Scene};
use crate::math::luminance;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LightKind {
    /// A point on an emissive triangle.
    Area,
    /// Delta light of this index: a point light or a spot.
    Point(u32),
    Directional(u32),
    Environment,
}

/// A point (or direction) on a light, chosen without regard to who asks.
#[derive(Clone, Copy, Debug)]
pub struct LightSample {
    pub kind: LightKind,
    /// Area, point: the position. Directional, environment: the unit direction towards the light.
    pub y: Vec3,
    /// Area: right-hand-rule unit normal.
    pub n: Vec3,
    /// Radiance (area, with the mask's opacity; environment), intensity (point) or perpendicular irradiance (directional), geometry apart.
    pub power: Vec3,
    /// Area: per unit area; environment: per steradian; delta lights: probability.
    pub pdf: f32,
    pub prim: PrimId,
    pub b: [f32; 3],
    pub two_sided: bool,
    /// Of a spot light.
    pub cone: Option<Cone>,
}

/// A light as it arrives at a point: `power · geometry` is what the BSDF is to be multiplied with before dividing by the pdf.
#[derive(Clone, Copy, Debug)]
pub struct Arrival {
    /// Unit direction towards the light.
    pub dir: Vec3,
    pub distance: f32,
    /// cos θ_y / r² (area), 1 / r² (point), [`Cone::falloff`] / r² (spot), 1 (distant).
    pub geometry: f32,
}

impl Arrival {
    /// Of the light of a surface at `y` with normal `n`, seen from `x`; and whether it shines that way. No branch.
    #[inline(always)]
    pub fn from_surface(y: Vec3, n: Vec3, two_sided: bool, x: Vec3) -> (Arrival, bool) {
        let d = y - x;
        let r2 = d.length_squared();
        let r = r2.sqrt();
        let dir = d * r.recip();
        let c = -n.dot(dir);
        let cos = if two_sided { c.abs() } else { c };
        (Arrival { dir, distance: r, geometry: cos / r2 }, (r2 > 0.0) & (cos > 0.0))
    }
}

/// The share of a spot's intensity that shines one way, and its derivatives.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Falloff {
    /// In [0, 1].
    pub value: f32,
    /// In the unit direction, perpendicular to it.
    pub by_direction: Vec3,
    /// In the axis of unit length, perpendicular to it.
    pub by_axis: Vec3,
    /// In beam and cutoff.
    pub by_angles: [f32; 2],
}

impl Cone {
    /// s² (3 − 2s), where s goes with the angle θ between axis and `dir` (of unit length) from 0 at the cutoff to 1 at the beam.
    pub fn falloff(&self, dir: Vec3) -> Falloff {
        let axis = self.axis.normalize();
        // By the sine as well: the cosine alone knows nothing of small angles.
        let (sin, cos) = (axis.cross(dir).length(), axis.dot(dir));
        let width = self.cutoff - self.beam;
        let s = ((self.cutoff - sin.atan2(cos)) / width).clamp(0.0, 1.0);
        let slope = 6.0 * s * (1.0 - s) / width;
        // ∂θ/∂dir = (dir cos θ − axis) / sin θ. In the axis the slope is 0, whatever the direction.
        let turn = if sin > 0.0 { -slope / sin } else { 0.0 };
        Falloff {
            value: s * s * (3.0 - 2.0 * s),
            by_direction: (dir * cos - axis) * turn,
            by_axis: (axis * cos - dir) * turn,
            by_angles: [slope * s, slope * (1.0 - s)],
        }
    }

    /// ∫ falloff over all directions, in steradians: by parts ∫ (1 − cos θ) ∂falloff/∂θ, which the midpoint rule adds up to a
    /// thousandth.
    fn solid_angle(&self) -> f64 {
        const STEPS: u32 = 32;
        let (beam, width) = (f64::from(self.beam), f64::from(self.cutoff - self.beam));
        let step = |i: u32| {
            let x = (f64::from(i) + 0.5) / f64::from(STEPS);
            6.0 * x * (1.0 - x) * 2.0 * (0.5 * (beam + width * x)).sin().powi(2)
        };
        2.0 * std::f64::consts::PI * (0..STEPS).map(step).sum::<f64>() / f64::from(STEPS)
    }
}

impl LightSample {
    /// Stands where there is none.
    pub(crate) const NONE: LightSample = LightSample {
        kind: LightKind::Area,
        y: Vec3::ZERO,
        n: Vec3::ZERO,
        power: Vec3::ZERO,
        pdf: 0.0,
        prim: NO_PRIM,
        b: [0.0; 3],
        two_sided: false,
        cone: None,
    };

    /// Seen from `x`, without visibility; `None` if the light does not shine that way.
    #[inline]
    pub fn arrive(&self, x: Vec3) -> Option<Arrival> {
        match self.kind {
            LightKind::Area => {
                let (arrival, shines) = Arrival::from_surface(self.y, self.n, self.two_sided, x);
                shines.then_some(arrival)
            }
            LightKind::Point(_) => {
                let d = self.y - x;
                let r2 = d.length_squared();
                let r = r2.sqrt();
                let dir = d * r.recip();
                let falloff = self.cone.map_or(1.0, |cone| cone.falloff(-dir).value);
                (r2 > 0.0 && falloff > 0.0).then(|| Arrival { dir, distance: r, geometry: falloff / r2 })
            }
            LightKind::Directional(_) | LightKind::Environment => {
                Some(Arrival { dir: self.y, distance: f32::INFINITY, geometry: 1.0 })
            }
        }
    }

    pub fn is_delta(&self) -> bool {
        matches!(self.kind, LightKind::Point(_) | LightKind::Directional(_))
    }
}

#[derive(Clone, Copy, Debug)]
enum Entry {
    /// With the density per unit area of its points, of all lights of the table.
    Triangle {
        prim: PrimId,
        pdf: f32,
    },
    Delta(u32),
    Environment,
    Peak,
}

/// All lights with the probability of choosing each, proportional to power with a uniform share.
#[derive(Clone, Debug, Default)]
pub struct LightTable {
    entries: Vec<Entry>,
    pmf: Discrete,
    /// With the environment's peak only, for edge-first shadow sampling.
    local_entries: Vec<Entry>,
    local_pmf: Discrete,
    /// Probability per unit area of a primitive, 0 if it does not emit.
    area_pdf: Vec<f32>,
    environment_pmf: f32,
    last_turns: f32,
}

/// Of the paths at a diffuse surface that may turn once more only to find a light, the share that do. The others leave it to the
/// light that was chosen: rays are saved where it is the better technique, and close to lights it is not alone.
const LAST_TURNS: f32 = 0.25;
/// The share of all surfaces' area that emits above which they all turn: among lights a direction is the better choice.
const MANY_LIGHTS: f32 = 0.125;

fn mean_luminance(description: &SceneDescription, input: Input) -> f64 {
    match input.texture() {
        Some(t) => {
            let t = &description.textures[t];
            let sum: f64 = match t.channels {
                3 => t.data.chunks_exact(3).map(|c| f64::from(luminance(Vec3::new(c[0], c[1], c[2])).abs())).sum(),
                _ => t.data.iter().map(|&v| f64::from(v.abs())).sum(),
            };
            sum / (t.width * t.height).max(1) as f64
        }
        None => 1.0,
    }
}

impl LightTable {
    pub fn new(
        description: &SceneDescription,
        prims: &[Prim],
        radius: f32,
        peak: Option<&EnvironmentPeak>,
    ) -> LightTable {
        let (mut entries, mut weights, mut areas) = (Vec::new(), Vec::new(), Vec::new());
        let per_shape: Vec<f64> = description
            .shapes
            .iter()
            .map(|s| s.emission.as_ref().map_or(0.0, |e| mean_luminance(description, e.radiance)))
            .collect();
        let (mut surfaces, mut emitting) = (0.0, 0.0);
        for (i, prim) in prims.iter().enumerate() {
            let shape = &description.shapes[prim.shape as usize];
            let [a, b, c] = shape.mesh.faces[prim.face as usize].map(|v| shape.mesh.vertices[v as usize]);
            let area = 0.5 * (b - a).cross(c - a).length();
            surfaces += area;
            if shape.emission.is_some() && area > 0.0 {
                emitting += area;
                entries.push(Entry::Triangle { prim: i as u32, pdf: 0.0 });
                areas.push(area);
                weights.push(std::f64::consts::PI * f64::from(area) * per_shape[prim.shape as usize]);
            }
        }
        for (i, light) in description.delta_lights.iter().enumerate() {
            entries.push(Entry::Delta(i as u32));
            weights.push(match light {
                DeltaLight::Point { intensity, .. } => {
                    4.0 * std::f64::consts::PI * f64::from(luminance(*intensity).abs())
                }
                DeltaLight::Spot { intensity, cone, .. } => cone.solid_angle() * f64::from(luminance(*intensity).abs()),
                DeltaLight::Directional { irradiance, .. } => {
                    std::f64::consts::PI * f64::from(radius).powi(2) * f64::from(luminance(*irradiance).abs())
                }
            });
        }
        let sky = std::f64::consts::PI.powi(2) * f64::from(radius).powi(2);
        let (mut local_entries, mut local_weights) = (entries.clone(), weights.clone());
        if let Some(peak) = peak {
            local_entries.push(Entry::Peak);
            local_weights.push(sky * f64::from(peak.mean));
        }
        let local_pmf = Discrete::new(defensive(&local_weights));
        // All weights may be beyond what can be added up: then nothing is chosen.
        let probability = |pmf: &Discrete, i: usize| if pmf.is_empty() { 0.0 } else { pmf.pmf(i) as f32 };
        let set_densities = |entries: &mut [Entry], pmf: &Discrete| {
            for (i, entry) in entries.iter_mut().enumerate() {
                if let Entry::Triangle { pdf, .. } = entry {
                    *pdf = probability(pmf, i) / areas[i]; // triangles come first
                }
            }
        };
        set_densities(&mut local_entries, &local_pmf);
        if let Some(e) = &description.environment {
            entries.push(Entry::Environment);
            let mean = mean_luminance(description, Input::Texture(e.radiance));
            weights.push(sky * mean);
        }
        let pmf = Discrete::new(defensive(&weights));
        set_densities(&mut entries, &pmf);
        let mut area_pdf = vec![0.0; prims.len()];
        let mut environment_pmf = 0.0;
        for (i, entry) in entries.iter().enumerate() {
            match entry {
                Entry::Triangle { prim, pdf } => area_pdf[*prim as usize] = *pdf,
                Entry::Environment => environment_pmf = probability(&pmf, i),
                Entry::Delta(_) | Entry::Peak => {}
            }
        }
        let last_turns = match entries.last() {
            Some(Entry::Environment) => 1.0,
            _ if emitting > MANY_LIGHTS * surfaces => 1.0,
            _ if emitting > 0.0 => LAST_TURNS,
            _ => 0.0,
        };
        LightTable { entries, pmf, local_entries, local_pmf, area_pdf, environment_pmf, last_turns }
    }

    /// Probability per unit area with which `Scene::sample_light` finds points of an emissive primitive.
    #[inline]
    pub fn area_pdf(&self, prim: PrimId) -> f32 {
        self.area_pdf[prim as usize]
    }

    /// Probability of choosing the environment.
    #[inline]
    pub fn environment_pmf(&self) -> f32 {
        self.environment_pmf
    }

    /// The share of paths that are worth a turn at a diffuse surface which nothing but a light can follow: none where no ray can find
    /// one, all under a sky.
    #[inline]
    pub fn last_turns(&self) -> f32 {
        self.last_turns
    }

    /// Whether the only light is one without area.
    pub fn is_single_delta(&self) -> bool {
        matches!(self.entries.as_slice(), [Entry::Delta(_)])
    }

    /// Number of lights, the environment one of them.
    pub fn count(&self) -> usize {
        self.entries.len()
    }

    /// Number of lights, of the environment only its peak.
    pub fn local_count(&self) -> usize {
        self.local_entries.len()
    }
}

/// Power-proportional with a tenth shared equally: a light estimated as dark (a texture of zeros that is being optimised)
/// is still found.
fn defensive(weights: &[f64]) -> Vec<f64> {
    let total: f64 = weights.iter().filter(|w| w.is_finite()).sum();
    let share = if total > 0.0 { 0.1 * total / weights.len() as f64 } else { 1.0 };
    weights.iter().map(|w| w + share).collect()
}

impl Scene {
    /// Chooses a light and a point on it; `None` without lights. The first number chooses the light and, stretched, is used
    /// again: a light's own two dimensions stay stratified together with whatever else the sample's first numbers decide.
    #[inline(always)]
    pub(crate) fn sample_light(&self, u: Vec2) -> Option<LightSample> {
        self.sample_from(&self.lights.entries, &self.lights.pmf, u)
    }

    /// As [`Scene::sample_light`], of the environment only its peak.
    pub(crate) fn sample_local_light(&self, u: Vec2) -> Option<LightSample> {
        self.sample_from(&self.lights.local_entries, &self.lights.local_pmf, u)
    }

    #[inline(always)]
    fn sample_from(&self, entries: &[Entry], pmf: &Discrete, u: Vec2) -> Option<LightSample> {
        let mut light = None;
        self.sample_into(entries, pmf, u, |l| light = Some(*l));
        light
    }

    /// [`Scene::sample_light`], handed over where it is found: what brings all kinds of light together waits for the memory.
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

    /// A light that is not a triangle, chosen with probability `p`.
    fn sample_other(&self, entry: Entry, p: f32, u: [f32; 2]) -> Option<LightSample> {
        let base = LightSample { pdf: p, ..LightSample::NONE };
        Some(match entry {
            Entry::Triangle { .. } => return None,
            Entry::Delta(i) => match self.description.delta_lights[i as usize] {
                DeltaLight::Point { position, intensity } => {
                    LightSample { kind: LightKind::Point(i), y: position, power: intensity, ..base }
                }
                DeltaLight::Spot { position, intensity, cone } => {
                    LightSample { kind: LightKind::Point(i), y: position, power: intensity, cone: Some(cone), ..base }
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
                // Elevation by the number that chose the light: to know it well matters most to a guide.
                let (local, pdf) = self.environment.as_ref()?.sample([u[1], u[0]]);
                let y = (rotation * local).normalize();
                let power = self.environment_radiance(y);
                LightSample { kind: LightKind::Environment, y, power, pdf: p * pdf, ..base }
            }
        })
    }

    /// The light sample of a given point, unless the primitive does not emit.
    #[inline]
    pub(crate) fn area_sample(&self, prim: PrimId, b: [f32; 3], pdf: f32) -> Option<LightSample> {
        let emits = self.looks[self.facets[prim as usize].shape as usize].emits;
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
            two_sided: self.looks[facet.shape as usize].two_sided,
            cone: None,
        }
    }

    /// Luminance that a primitive emits per unit area, averaged over its shape, but for a constant factor.
    pub(crate) fn emitted_power(&self, prim: PrimId) -> f64 {
        let emission = self.description.shapes[self.prims[prim as usize].shape as usize].emission.as_ref();
        let sides = |two_sided: bool| if two_sided { 2.0 } else { 1.0 };
        emission.map_or(0.0, |e| sides(e.two_sided) * mean_luminance(&self.description, e.radiance))
    }

    /// Solid-angle density of finding world direction `dir` on the environment by light sampling.
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
    use crate::render::scene::{Emission, Environment, Material, MaterialKind, Shape};
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
                material: Material { kind: MaterialKind::Black, one_sided: false, opacity: None },
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
        d.delta_lights.push(DeltaLight::Spot { position: v(0.5, 2.0, 0.0), intensity: Vec3::splat(0.8), cone });
        let mut sky = vec![0.02; 8 * 4 * 3];
        sky[(8 + 7) * 3..][..3].fill(3.0);
        d.textures.push(Texture::new(8, 4, 3, sky, Wrap::Repeat, Filter::Bilinear).unwrap());
        let rotation = Mat3::from_rotation_x(0.7) * Mat3::from_rotation_y(1.9);
        d.environment = Some(Environment { radiance: d.textures.len() - 1, rotation });
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
            let light = scene.sample_light(rng.next_2d().into()).unwrap();
            let Some(arrival) = light.arrive(x) else { continue };
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
