//! The lights of a scene, the probabilities with which they are chosen, and the light that arrives from a point of one.

use glam::Vec3;

use crate::math::luminance;
use crate::render::accel::{NO_PRIM, PrimId};
use crate::render::environment::EnvironmentPeak;
use crate::render::facets::Prim;
use crate::render::material::Input;
use crate::render::sampler::Discrete;
use crate::render::scene::{Cone, DeltaLight, SceneDescription};
use crate::render::texture::Texture;
use crate::stop::paced;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LightKind {
    /// A point on an emissive triangle.
    Area,
    /// The delta light with this index: a point light, a spot or a goniometric light.
    Point(u32),
    Directional(u32),
    Environment,
}

/// A point (or direction) on a light, sampled independently of the receiver.
#[derive(Clone, Copy, Debug)]
pub struct LightSample {
    pub kind: LightKind,
    /// Area, point: the position. Directional, environment: the unit direction towards the light.
    pub y: Vec3,
    /// Area: right-hand-rule unit normal.
    pub n: Vec3,
    /// Radiance (area light, times the opacity of its mask; environment), intensity (point light) or perpendicular irradiance
    /// (directional light), without any geometry factor. That of a goniometric light is in no direction until `Scene::arrive` gives it one.
    pub power: Vec3,
    /// Area: per unit area; environment: per steradian; delta lights: probability.
    pub pdf: f32,
    pub prim: PrimId,
    pub b: [f32; 3],
    pub two_sided: bool,
    /// The cone of a spot light.
    pub cone: Option<Cone>,
    /// Whether the light is goniometric.
    pub has_profile: bool,
}

/// Light as it arrives at a point: `power · geometry` is multiplied with the BSDF and divided by the pdf.
#[derive(Clone, Copy, Debug)]
pub struct Arrival {
    /// Unit direction towards the light.
    pub dir: Vec3,
    pub distance: f32,
    /// cos θ_y / r² (area), 1 / r² (point, goniometric), [`Cone::falloff`] / r² (spot), 1 (distant).
    pub geometry: f32,
}

impl Arrival {
    /// The light from a surface point `y` with normal `n` at the point `x`, and whether the surface emits in that direction. Has no
    /// branches.
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

/// The factor on a spot light's intensity in one direction, and its derivatives.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Falloff {
    /// The factor, in [0, 1].
    pub value: f32,
    /// Derivative in the unit direction, perpendicular to it.
    pub by_direction: Vec3,
    /// Derivative in the unit axis, perpendicular to it.
    pub by_axis: Vec3,
    /// Derivatives in beam and cutoff.
    pub by_angles: [f32; 2],
}

impl Cone {
    /// The falloff s² (3 − 2s), where s goes from 0 at the cutoff to 1 at the beam, linearly in the angle θ between the axis and the unit
    /// direction `dir`.
    pub fn falloff(&self, dir: Vec3) -> Falloff {
        let axis = self.axis.normalize();
        // Computed from sine and cosine, because the cosine alone does not resolve small angles.
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

    /// ∫ falloff over all directions, in steradians. Integrated by parts it is ∫ (1 − cos θ) ∂falloff/∂θ, which the midpoint rule gives
    /// to a thousandth.
    pub(super) fn solid_angle(&self) -> f64 {
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
    /// A placeholder for no light.
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
        has_profile: false,
    };

    /// `Scene::arrive`, with the power of a goniometric light left to do.
    #[inline]
    pub(super) fn arrive(&self, x: Vec3) -> Option<Arrival> {
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
pub(super) enum Entry {
    /// Area lights, with the density per unit area of their points among all lights of the table.
    Triangle {
        prim: PrimId,
        pdf: f32,
    },
    Delta(u32),
    Environment,
    Peak,
}

/// All lights and the probability of choosing each: in proportion to power, mixed with a uniform part.
#[derive(Clone, Debug, Default)]
pub struct LightTable {
    pub(super) entries: Vec<Entry>,
    pub(super) pmf: Discrete,
    /// The same distribution, with only the peak of the environment, for edge-first shadow sampling.
    pub(super) local_entries: Vec<Entry>,
    pub(super) local_pmf: Discrete,
    /// Probability per unit area of a primitive, 0 if it does not emit.
    pub(super) area_pdf: Vec<f32>,
    pub(super) environment_pmf: f32,
    pub(super) last_bounce_probability: f32,
    /// All lights are triangles.
    are_surfaces: bool,
}

/// The probability with which a path continues for its last bounce at a diffuse surface. The ray of that bounce can only find a light, which
/// light sampling finds too. Leaving out most of these rays saves time where light sampling is the better technique; close to lights it is
/// not, so some must remain.
const LAST_BOUNCE: f32 = 0.25;
/// If more than this fraction of all surfaces' area emits, all paths take the last bounce: among many lights BSDF sampling is the better
/// technique.
const MANY_LIGHTS: f32 = 0.125;

pub(super) fn mean_luminance(description: &SceneDescription, input: Input) -> f64 {
    match input.texture() {
        Some(t) => {
            let t = &description.textures[t];
            let of = |c: Vec3| if t.channels == 3 { luminance(c) } else { c.x };
            let sum: f64 = paced(t.colors(), 3).map(|c| f64::from(of(c).abs())).sum();
            sum / (t.width * t.height).max(1) as f64
        }
        None => 1.0,
    }
}

/// The largest luminance of a map's texels.
fn brightest(map: &Texture) -> f64 {
    f64::from(paced(map.colors(), 3).map(luminance).fold(0.0, f32::max))
}

/// The mean luminance of an equirectangular map over all directions.
fn mean_over_sphere(map: &Texture) -> f64 {
    let of = |c: Vec3| if map.channels == 3 { luminance(c) } else { c.x };
    let row = |y: usize| {
        let edge = |y: usize| (std::f64::consts::PI * y as f64 / map.height as f64).cos();
        let colors = (0..map.width).map(|x| of(map.color_at(x, y)));
        0.5 * (edge(y) - edge(y + 1)) * colors.map(|l| f64::from(l.abs())).sum::<f64>() / map.width as f64
    };
    paced(0..map.height, map.width).map(row).sum()
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
        for (i, prim) in paced(prims.iter().enumerate(), 8) {
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
                DeltaLight::Spot { intensity, cone, profile, .. } => {
                    // A profile is brightest where its light is aimed: more than its mean.
                    let most = profile.map_or(1.0, |p| description.textures.get(p.texels).map_or(0.0, brightest));
                    cone.solid_angle() * most * f64::from(luminance(*intensity).abs())
                }
                DeltaLight::Goniometric { intensity, profile, .. } => {
                    let mean = description.textures.get(profile.texels).map_or(0.0, mean_over_sphere);
                    4.0 * std::f64::consts::PI * mean * f64::from(luminance(*intensity).abs())
                }
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
        // The sum of weights may overflow; then no light is chosen.
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
            let mean = mean_luminance(description, Input::Texture(e.texels));
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
        let last_bounce_probability = match entries.last() {
            Some(Entry::Environment) => 1.0,
            _ if emitting > MANY_LIGHTS * surfaces => 1.0,
            _ if emitting > 0.0 => LAST_BOUNCE,
            _ => 0.0,
        };
        let are_surfaces = entries.iter().all(|entry| matches!(entry, Entry::Triangle { .. }));
        LightTable {
            entries,
            pmf,
            local_entries,
            local_pmf,
            area_pdf,
            environment_pmf,
            last_bounce_probability,
            are_surfaces,
        }
    }

    /// Probability per unit area with which `Scene::sample_light` finds points of an emissive primitive.
    #[inline]
    pub fn area_pdf(&self, prim: PrimId) -> f32 {
        self.area_pdf[prim as usize]
    }

    /// The probability with which a path takes its last bounce at a diffuse surface: 0 if no ray can find a light, 1 if there is an
    /// environment.
    #[inline]
    pub fn last_bounce_probability(&self) -> f32 {
        self.last_bounce_probability
    }

    /// Whether all lights are points on surfaces.
    #[inline]
    pub fn are_surfaces(&self) -> bool {
        self.are_surfaces
    }

    /// Whether there is exactly one light, a point or directional one.
    pub fn is_single_delta(&self) -> bool {
        matches!(self.entries.as_slice(), [Entry::Delta(_)])
    }

    /// Number of lights, including the environment.
    pub fn count(&self) -> usize {
        self.entries.len()
    }

    /// Number of lights, including the environment only if it has a peak.
    pub fn local_count(&self) -> usize {
        self.local_entries.len()
    }
}

/// Probabilities in proportion to power, with a tenth shared equally among all lights: a light that is estimated as dark (such as a black
/// texture that is being optimised) is still sampled.
pub(in crate::render) fn defensive(weights: &[f64]) -> Vec<f64> {
    let total: f64 = weights.iter().filter(|w| w.is_finite()).sum();
    let share = if total > 0.0 { 0.1 * total / weights.len() as f64 } else { 1.0 };
    weights.iter().map(|w| w + share).collect()
}
