use std::f64::consts::PI;

use dscene::render::{Cone, DeltaLight, Projection, Slot};
use glam::{DVec3, Vec3};

use super::support::{Builder, Measured, Pieces as _, camera, contract, difference, floor, probe, settings};

/// A spot light in double precision.
#[derive(Clone, Copy)]
struct Spot {
    position: DVec3,
    axis: DVec3,
    beam: f64,
    cutoff: f64,
}

const INTENSITY: f64 = 5.0;
const REFLECTANCE: f64 = 0.6;

impl Spot {
    /// The share of its intensity at an angle from the axis.
    fn falloff(&self, angle: f64) -> f64 {
        let s = ((self.cutoff - angle) / (self.cutoff - self.beam)).clamp(0.0, 1.0);
        s * s * (3.0 - 2.0 * s)
    }

    /// Radiance of a horizontal floor at `x`.
    fn radiance(&self, x: DVec3) -> f64 {
        let d = self.position - x;
        let angle = (-d).angle_between(self.axis);
        REFLECTANCE / PI * INTENSITY * self.falloff(angle) * d.y / d.length().powi(3)
    }

    /// All its light, over the intensity: ∫ falloff over directions.
    fn flux(&self) -> f64 {
        let n = 100_000;
        let step = PI / f64::from(n);
        let ring = |i: u32| {
            let angle = (f64::from(i) + 0.5) * step;
            2.0 * PI * angle.sin() * self.falloff(angle) * step
        };
        (0..n).map(ring).sum()
    }

    fn light(&self) -> DeltaLight {
        let cone = Cone { axis: self.axis.as_vec3(), beam: self.beam as f32, cutoff: self.cutoff as f32 };
        let intensity = Vec3::splat(INTENSITY as f32);
        DeltaLight::Spot { position: self.position.as_vec3(), intensity, cone, profile: None }
    }
}

/// Derivatives in position, axis (which has any length), beam and cutoff.
fn by_each(spot: Spot, value: impl Fn(Spot) -> f64) -> [Vec<f64>; 3] {
    let along = |f: &dyn Fn(f64) -> Spot| difference(|t| value(f(t)));
    let position = DVec3::AXES.map(|a| along(&|t| Spot { position: spot.position + a * t, ..spot }));
    let axis = DVec3::AXES.map(|a| along(&|t| Spot { axis: spot.axis + a * t, ..spot }));
    let cone = [along(&|t| Spot { beam: spot.beam + t, ..spot }), along(&|t| Spot { cutoff: spot.cutoff + t, ..spot })];
    [position.to_vec(), axis.to_vec(), cone.to_vec()]
}

/// Radiance where it fades: nothing is left to chance.
#[test]
fn radiance_below_a_spot() {
    let spot = Spot { position: DVec3::new(0.3, 2.0, -0.2), axis: DVec3::new(0.2, -1.5, 0.1), beam: 0.1, cutoff: 0.7 };
    // In the beam, between beam and cutoff, and beyond.
    for (x, fades) in
        [(DVec3::new(0.57, 0.0, -0.07), false), (DVec3::new(0.9, 0.0, 0.6), true), (DVec3::new(-2.0, 0.0, 1.0), false)]
    {
        let mut b = Builder::default();
        b.matte(floor(Vec3::ZERO, 4.0), REFLECTANCE as f32);
        b.description.delta_lights.push(spot.light());
        let scene = b.scene();
        // Looks past the light.
        let camera = probe(x.as_vec3(), Vec3::new(0.3, -1.0, 0.4), 3.0);
        let measured = Measured { scene: &scene, camera: &camera, settings: settings(64, 1) };
        let value = spot.radiance(x);
        measured.values(4).check_scaled("value", &[value], 1e-3, INTENSITY);
        let exact = by_each(spot, |spot| spot.radiance(x));
        assert_eq!(exact[2].iter().all(|d| d.abs() > 0.01), fades, "{exact:?}");
        for (slot, exact) in [Slot::LightPlacement(0), Slot::LightAxis(0), Slot::LightCone(0)].into_iter().zip(&exact) {
            let found = measured.gradients(4, slot);
            found.check_scaled(&format!("spot, {slot:?} at {x}"), exact, 2e-3, value.max(0.1));
        }
    }
}

/// All the light falls on a floor that is large enough, wherever the spot is and whichever way it points: only the cone changes it.
#[test]
fn flux_of_a_spot() {
    let spot = Spot { position: DVec3::new(0.3, 2.0, -0.2), axis: DVec3::new(0.2, -1.5, 0.1), beam: 0.2, cutoff: 0.6 };
    let half = 2.5;
    let mut b = Builder::default();
    b.matte(floor(Vec3::ZERO, 4.0), REFLECTANCE as f32);
    b.description.delta_lights.push(spot.light());
    let scene = b.scene();
    let camera = camera(Projection::Orthographic, Vec3::Y * 5.0, -Vec3::Y, half, 32);
    let measured = Measured { scene: &scene, camera: &camera, settings: settings(256, 1) };
    // The sum over pixels of area `pixel`.
    let pixel = (2.0 * f64::from(half) / 32.0).powi(2);
    let value = |spot: Spot| REFLECTANCE / PI * INTENSITY * spot.flux() / pixel;
    let size = value(spot);
    measured.values(8).check("flux", &[size], 1e-3);
    for slot in [Slot::LightPlacement(0), Slot::LightAxis(0)] {
        measured.gradients(8, slot).check_scaled(&format!("flux, {slot:?}"), &[0.0; 3], 2e-3, size);
    }
    let [_, _, by_cone] = by_each(spot, value);
    measured.gradients(8, Slot::LightCone(0)).check("flux, cone", &by_cone, 2e-3);
    // The image is linear in the intensity.
    let up = measured.gradient(1, &[Slot::LightPower(0)]).remove(0);
    let scaled = contract(&up, &[Vec3::X * INTENSITY as f32]);
    assert!((scaled - size).abs() < 2e-3 * size, "{scaled} {size}");
}
