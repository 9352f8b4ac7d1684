//! The light of the clear sky and of the sun: sunlight scattered once by air and by haze on its way through a round atmosphere.
//!
//! The model is that of Nishita et al. 1993, "Display of the Earth Taking into Account Atmospheric Scattering": densities of air and haze fall
//! exponentially with height, air scatters as Rayleigh's law says and haze by the phase function of Cornette and Shanks. Light that is
//! scattered several times is left out, so the sky is somewhat darker, and bluer near the horizon, than the real one. All radiance is
//! relative to the sun's irradiance outside of the atmosphere, by channel; derivatives are those of dual numbers.

use std::f64::consts::{FRAC_1_PI, PI};

use glam::{DVec3, Vec2};
use rayon::prelude::*;

use super::environment::environment_direction;
use crate::math::Dual;
use crate::stop;

/// Radius of the Earth, in metres.
const EARTH: f64 = 6360e3;
/// Height above which there is no air to speak of.
const TOP: f64 = 60e3;
/// Height of the observer.
const EYE: f64 = 2.0;
/// Heights over which the densities of air and of haze fall by a factor e.
const SCALE_HEIGHTS: [f64; 2] = [7994.0, 1200.0];
/// Scattering of air at sea level per metre, for 680, 550 and 440 nm (Riley et al. 2004).
const RAYLEIGH: [f64; 3] = [5.8e-6, 13.5e-6, 33.1e-6];
/// Haze absorbs a little: extinction over scattering.
const HAZE_EXTINCTION: f64 = 1.1;
/// Asymmetry of the haze's phase function.
const ASYMMETRY: f64 = 0.76;
/// Steps along the line of sight, and from each of them towards the sun. They get longer with the distance.
const STEPS: [usize; 2] = [40, 24];

/// A number with derivatives in the three components of the sun's direction and in the turbidity.
pub type Number = Dual<4>;

/// A clear sky.
#[derive(Clone, Copy, Debug)]
pub struct Sky {
    /// The unit direction towards the sun; +y is up.
    sun: [Number; 3],
    /// Scattering of haze at sea level, per metre.
    haze: Number,
}

impl Sky {
    /// `sun` points towards the sun, with any length; `turbidity` is the vertical optical depth of the atmosphere over that of clean air, at
    /// 550 nm: 2 on a clear day, 10 in haze.
    pub fn new(sun: DVec3, turbidity: f64) -> Sky {
        let [x, y, z] = [0, 1, 2].map(|i| Number::variable(sun[i], i));
        let length = (x * x + y * y + z * z).sqrt();
        let clean = RAYLEIGH[1] * SCALE_HEIGHTS[0];
        let haze = (Number::variable(turbidity, 3) - 1.0) * (clean / (HAZE_EXTINCTION * SCALE_HEIGHTS[1]));
        Sky { sun: [x / length, y / length, z / length], haze }
    }

    /// The perpendicular irradiance of the sun on the ground, over that outside of the atmosphere.
    pub fn sun_irradiance(&self) -> [Number; 3] {
        self.transmittance(self.depths_to_sun(DVec3::new(0.0, EARTH + EYE, 0.0)))
    }

    /// An equirectangular map of the radiance from all around, by rows, as the renderer's environments have it; below the horizon lies ground
    /// that reflects all light, as a Lambertian surface.
    pub fn map(&self, width: usize, height: usize) -> Vec<[Number; 3]> {
        let direction = |x: usize, y: usize| {
            let uv = Vec2::new((x as f32 + 0.5) / width as f32, (y as f32 + 0.5) / height as f32);
            environment_direction(uv).as_dvec3().normalize()
        };
        let black = [Number::constant(0.0); 3];
        let is_sky = |dir: DVec3| dir.y > 0.0;
        let stop = stop::flag();
        let row = |y: usize| -> Vec<[Number; 3]> {
            if stop.load(std::sync::atomic::Ordering::Relaxed) {
                return Vec::new(); // the result will not be used
            }
            let of = |dir: DVec3| if is_sky(dir) { self.radiance(dir) } else { black };
            (0..width).map(|x| of(direction(x, y))).collect()
        };
        let mut map: Vec<[Number; 3]> = (0..height).into_par_iter().flat_map_iter(row).collect();
        stop::check();
        // Of the ground: the sum over the sky's solid angles, and the sun.
        let facing = if self.sun[1].value > 0.0 { self.sun[1] } else { Number::constant(0.0) };
        let mut irradiance = self.sun_irradiance().map(|e| e * facing);
        // Directions of a row are equally high.
        let is_sky_row = |y: usize| is_sky(direction(0, y));
        for y in (0..height).filter(|&y| is_sky_row(y)) {
            stop::check();
            let (upper, lower) = (PI * y as f64 / height as f64, PI * (y + 1) as f64 / height as f64);
            // The integral of the cosine over the row's solid angle.
            let weight = 0.5 * (lower.sin().powi(2) - upper.sin().powi(2)) * 2.0 * PI / width as f64;
            for x in 0..width {
                for (sum, radiance) in irradiance.iter_mut().zip(map[y * width + x]) {
                    *sum = *sum + radiance * weight;
                }
            }
        }
        let ground = irradiance.map(|e| e * FRAC_1_PI);
        for y in (0..height).filter(|&y| !is_sky_row(y)) {
            map[y * width..(y + 1) * width].fill(ground);
        }
        map
    }

    /// Radiance from a unit direction above the horizon.
    fn radiance(&self, dir: DVec3) -> [Number; 3] {
        let eye = DVec3::new(0.0, EARTH + EYE, 0.0);
        let along = self.sun.iter().zip(dir.to_array()).fold(Number::constant(0.0), |sum, (s, d)| sum + *s * d);
        let end = way_out(eye, dir);
        let zero = Number::constant(0.0);
        let (mut air, mut haze) = ([zero; 3], [zero; 3]);
        let mut passed = [0.0; 2];
        for (middle, length) in steps(end, STEPS[0]) {
            let p = eye + dir * middle;
            let here = densities(p).map(|d| d * length);
            let to_sun = self.depths_to_sun(p);
            let depths = [0, 1].map(|i| to_sun[i] + (passed[i] + 0.5 * here[i]));
            let light = self.transmittance(depths);
            for c in 0..3 {
                air[c] = air[c] + light[c] * here[0];
                haze[c] = haze[c] + light[c] * here[1];
            }
            passed = [passed[0] + here[0], passed[1] + here[1]];
        }
        let (by_air, by_haze) = (rayleigh_phase(along), haze_phase(along) * self.haze);
        std::array::from_fn(|c| air[c] * by_air * RAYLEIGH[c] + haze[c] * by_haze)
    }

    /// How much of the light remains after these optical depths of air and of haze, each in metres at sea level.
    fn transmittance(&self, [air, haze]: [Number; 2]) -> [Number; 3] {
        RAYLEIGH.map(|beta| (-(air * beta + haze * self.haze * HAZE_EXTINCTION)).exp())
    }

    /// The depths of air and haze from a point to the sun. Below the ground densities go on to grow, so that the Earth's shadow has no sharp
    /// border, and a derivative.
    fn depths_to_sun(&self, p: DVec3) -> [Number; 2] {
        let [sx, sy, sz] = self.sun;
        let along = sx * p.x + sy * p.y + sz * p.z;
        let radius2 = p.length_squared();
        let top = EARTH + TOP;
        let end = (along * along + (top * top - radius2)).sqrt() - along;
        let mut depths = [Number::constant(0.0); 2];
        for (middle, length) in steps(1.0, STEPS[1]) {
            let t = end * middle;
            // The height by the cosine rule.
            let radius = (t * t + along * t * 2.0 + radius2).sqrt();
            let height = radius - EARTH;
            for (depth, scale) in depths.iter_mut().zip(SCALE_HEIGHTS) {
                // Deeper than this nothing arrives anyway.
                let exponent = height * (-1.0 / scale);
                let density = if exponent.value > 30.0 { Number::constant(30f64.exp()) } else { exponent.exp() };
                *depth = *depth + density * (end * length);
            }
        }
        depths
    }
}

/// Middles and lengths of steps that cut the way from 0 to `end`, and grow.
fn steps(end: f64, count: usize) -> impl Iterator<Item = (f64, f64)> {
    let at = move |i: usize| end * (i as f64 / count as f64).powi(3);
    (0..count).map(move |i| (0.5 * (at(i) + at(i + 1)), at(i + 1) - at(i)))
}

/// The distance at which a ray from inside leaves the atmosphere.
fn way_out(p: DVec3, dir: DVec3) -> f64 {
    let (along, top) = (p.dot(dir), EARTH + TOP);
    (along * along + top * top - p.length_squared()).sqrt() - along
}

/// Densities of air and haze over those at sea level.
fn densities(p: DVec3) -> [f64; 2] {
    let height = p.length() - EARTH;
    SCALE_HEIGHTS.map(|scale| (-height / scale).exp())
}

/// The share of the light that air scatters by an angle of this cosine, per steradian.
fn rayleigh_phase(cos: Number) -> Number {
    (cos * cos + 1.0) * (3.0 / (16.0 * PI))
}

/// The same for haze (Cornette and Shanks 1992).
fn haze_phase(cos: Number) -> Number {
    let g2 = ASYMMETRY * ASYMMETRY;
    let base = cos * (-2.0 * ASYMMETRY) + (1.0 + g2);
    (cos * cos + 1.0) * (3.0 * (1.0 - g2) / (8.0 * PI * (2.0 + g2))) / (base * base.sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Scattering neither makes light nor loses it.
    #[test]
    fn phase_functions_integrate_to_one() {
        const N: usize = 20_000;
        for phase in [rayleigh_phase, haze_phase] {
            let cosines = (0..N).map(|i| -1.0 + (2.0 * i as f64 + 1.0) / N as f64);
            let integral: f64 = cosines.map(|c| phase(Number::constant(c)).value * 4.0 * PI / N as f64).sum();
            assert!((integral - 1.0).abs() < 1e-4, "{integral}");
        }
    }

    /// Towards the zenith optical depths are known: the scale height, less what lies above the top.
    #[test]
    fn the_sun_overhead_is_dimmed_by_the_vertical_depth() {
        for turbidity in [1.0, 2.0, 6.0] {
            let found = Sky::new(DVec3::new(0.0, 3.0, 0.0), turbidity).sun_irradiance();
            let depth = |scale: f64| scale * ((-EYE / scale).exp() - (-TOP / scale).exp());
            let haze = (turbidity - 1.0) * RAYLEIGH[1] * SCALE_HEIGHTS[0] / SCALE_HEIGHTS[1];
            for c in 0..3 {
                let expected = (-RAYLEIGH[c] * depth(SCALE_HEIGHTS[0]) - haze * depth(SCALE_HEIGHTS[1])).exp();
                assert!(
                    (found[c].value - expected).abs() < 0.01 * expected,
                    "{} instead of {expected}",
                    found[c].value
                );
            }
        }
    }

    /// The ground gets no more than what the atmosphere gets, the sun sets red and the sky above is blue.
    #[test]
    fn skies_are_plausible() {
        for (elevation, turbidity) in [(60f64, 2.0), (30.0, 3.0), (5.0, 2.0), (0.5, 4.0), (-4.0, 2.0)] {
            let (sin, cos) = elevation.to_radians().sin_cos();
            let sky = Sky::new(DVec3::new(cos, sin, 0.0), turbidity);
            let map = sky.map(64, 32);
            let ground = map[31 * 64].map(|r| r.value * PI);
            let sun = sky.sun_irradiance().map(|e| e.value);
            assert!((0..3).all(|c| ground[c] >= 0.0 && ground[c] <= sin.max(0.0) + 0.05), "{elevation}° {ground:?}");
            assert!(map.iter().flatten().all(|r| r.value.is_finite() && r.value >= 0.0));
            assert!(sun[0] >= sun[1] && sun[1] >= sun[2], "{sun:?}");
            let zenith = map[5].map(|r| r.value);
            assert!(elevation < 20.0 || zenith[2] > 1.2 * zenith[0], "{elevation}°: {zenith:?}");
        }
    }

    #[test]
    fn derivatives_match_differences() {
        let at = |v: [f64; 4]| {
            let sky = Sky::new(DVec3::new(v[0], v[1], v[2]), v[3]);
            let map = sky.map(16, 8);
            let pixels = [map[20], map[37], map[60], map[100], sky.sun_irradiance()];
            pixels.into_iter().flatten().collect::<Vec<_>>()
        };
        for v in [[0.5, 0.7, -0.3, 2.5], [0.9, 0.05, 0.4, 4.0], [0.9, -0.02, 0.4, 2.0]] {
            let here = at(v);
            for i in 0..4 {
                let h = 1e-5;
                let shifted = |h: f64| at(std::array::from_fn(|j| v[j] + if i == j { h } else { 0.0 }));
                let (up, down) = (shifted(h), shifted(-h));
                for k in 0..here.len() {
                    let fd = (up[k].value - down[k].value) / (2.0 * h);
                    let found = here[k].partials[i];
                    assert!((found - fd).abs() < 1e-6 + 1e-4 * fd.abs(), "{v:?} {i} {k}: {found} and {fd}");
                }
            }
        }
    }
}
