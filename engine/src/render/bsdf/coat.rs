//! A rough dielectric over a base that scatters what the dielectric lets through.
//!
//! With Schlick's Fresnel term, and without the light that is lost between microfacets, the directional albedo of the dielectric at cosine c
//! is E(c) = F0 + (F90 − F0) P(c), where P is the directional albedo of a lobe with Fresnel term (1 − wi·h)⁵. What enters at ci and leaves
//! at co has the weight (1 − E(ci)) (1 − E(co)), which is symmetric, so that the base is reciprocal (Kelemen & Szirmay-Kalos 2001, "A
//! Microfacet Based Coupled Specular-Matte BRDF Model with Importance Sampling"). P is tabulated by roughness and cosine, and where the
//! table is not exact its values are too large, never too small, so that no energy is gained.

use super::albedo::{Albedo, AlbedoTable};

/// Reflectance of a dielectric at normal incidence and at grazing angles, and its roughness.
#[derive(Clone, Copy, Debug)]
pub struct Coat {
    pub f0: f32,
    pub f90: f32,
    pub roughness: f32,
}

/// What a coat lets through: the shares at both cosines, and that of light from everywhere, which is 1 − Ē with Ē = 2 ∫ E(c) c dc.
#[derive(Clone, Copy, Debug)]
pub struct Passed {
    pub i: f32,
    pub o: f32,
    pub mean: f32,
    albedos: [Albedo; 3],
}

/// Derivatives in the cosines ci and co, and in the fields of [`Coat`].
#[derive(Clone, Copy, Debug, Default)]
pub struct CoatAdjoint {
    pub cosines: [f32; 2],
    pub f0: f32,
    pub f90: f32,
    pub roughness: f32,
}

impl Coat {
    fn albedo(&self, p: f32) -> f32 {
        self.f0 + (self.f90 - self.f0) * p
    }

    /// The share E of light from the cosine `c` that does not pass.
    pub fn reflected(&self, c: f32) -> Albedo {
        let (p, slope) = (SCHLICK.directional(c, self.roughness), self.f90 - self.f0);
        Albedo { value: self.albedo(p.value), by_c: slope * p.by_c, by_roughness: slope * p.by_roughness }
    }

    /// The share of light from the cosine `ci` that passes.
    pub fn passed_at(&self, ci: f32) -> f32 {
        1.0 - self.albedo(SCHLICK.directional(ci, self.roughness).value)
    }

    pub fn passed(&self, ci: f32, co: f32) -> Passed {
        let albedos = [
            SCHLICK.directional(ci, self.roughness),
            SCHLICK.directional(co, self.roughness),
            SCHLICK.mean(self.roughness),
        ];
        let [i, o, mean] = albedos.map(|p| 1.0 - self.albedo(p.value));
        Passed { i, o, mean, albedos }
    }

    /// Adjoint of [`Coat::passed`]: `d_passed` are the derivatives in its `i`, `o` and `mean`.
    pub fn d_passed(&self, passed: &Passed, d_passed: [f32; 3]) -> CoatAdjoint {
        let slope = self.f90 - self.f0;
        let mut d = CoatAdjoint::default();
        for (d_passed, p) in d_passed.into_iter().zip(&passed.albedos) {
            d.f0 -= d_passed * (1.0 - p.value);
            d.f90 -= d_passed * p.value;
            d.roughness -= d_passed * slope * p.by_roughness;
        }
        d.cosines = [0, 1].map(|k| -d_passed[k] * slope * passed.albedos[k].by_c);
        d
    }
}

/// P, the albedo of a lobe with the Fresnel term (1 − wi·h)⁵, by quadrature over the visible normals. Nodes are raised where linear interpolation
/// between them would be less than P: by at most 0.024, except in the first column, at a cosine of zero.
#[rustfmt::skip]
pub static SCHLICK: AlbedoTable = AlbedoTable::new([
    [
        1.0, 0.809, 0.6473, 0.5129, 0.4019, 0.311, 0.2373, 0.1783, 0.1317, 0.0954, 0.0675, 0.0466, 0.0312, 0.0202, 0.0126, 0.0074, 0.0041, 0.0021, 0.001, 0.0004, 0.0001, 0.0, 0.0, 0.0, 0.0,
    ],
    [
        0.9931, 0.8177, 0.6497, 0.5143, 0.4021, 0.3108, 0.2372, 0.1783, 0.1317, 0.0954, 0.0676, 0.0466, 0.0313, 0.0202, 0.0126, 0.0074, 0.0041, 0.0021, 0.001, 0.0004, 0.0001, 0.0, 0.0, 0.0, 0.0,
    ],
    [
        0.9298, 0.7783, 0.6429, 0.5094, 0.3998, 0.3092, 0.2362, 0.1778, 0.1315, 0.0954, 0.0677, 0.0468, 0.0314, 0.0204, 0.0127, 0.0075, 0.0042, 0.0022, 0.001, 0.0004, 0.0001, 0.0, 0.0, 0.0, 0.0,
    ],
    [
        0.7405, 0.6545, 0.5884, 0.484, 0.3871, 0.3027, 0.2324, 0.1756, 0.1305, 0.0951, 0.0678, 0.0471, 0.0318, 0.0207, 0.013, 0.0077, 0.0044, 0.0023, 0.0011, 0.0005, 0.0002, 0.0, 0.0, 0.0, 0.0,
    ],
    [
        0.6132, 0.5365, 0.4963, 0.4305, 0.3556, 0.2851, 0.2227, 0.17, 0.1277, 0.0939, 0.0675, 0.0474, 0.0323, 0.0213, 0.0135, 0.0082, 0.0047, 0.0025, 0.0012, 0.0006, 0.0002, 0.0001, 0.0, 0.0, 0.0,
    ],
    [
        0.5166, 0.4416, 0.4069, 0.3621, 0.3085, 0.2547, 0.2039, 0.159, 0.1215, 0.0908, 0.0663, 0.0471, 0.0326, 0.0219, 0.0142, 0.0088, 0.0052, 0.0029, 0.0015, 0.0007, 0.0003, 0.0001, 0.0, 0.0, 0.0,
    ],
    [
        0.4241, 0.3593, 0.3303, 0.2955, 0.2567, 0.2167, 0.178, 0.1424, 0.1112, 0.0848, 0.0632, 0.0459, 0.0324, 0.0222, 0.0147, 0.0094, 0.0058, 0.0033, 0.0018, 0.0009, 0.0004, 0.0002, 0.0001, 0.0, 0.0,
    ],
    [
        0.3421, 0.2888, 0.2654, 0.2377, 0.2085, 0.1788, 0.1496, 0.1223, 0.0976, 0.0762, 0.058, 0.0431, 0.0312, 0.0219, 0.015, 0.0099, 0.0062, 0.0038, 0.0022, 0.0012, 0.0006, 0.0003, 0.0001, 0.0, 0.0,
    ],
    [
        0.274, 0.2303, 0.2116, 0.1897, 0.1671, 0.1444, 0.1224, 0.1016, 0.0827, 0.0658, 0.0512, 0.0389, 0.0289, 0.0209, 0.0146, 0.01, 0.0065, 0.0041, 0.0025, 0.0014, 0.0007, 0.0004, 0.0002, 0.0001, 0.0,
    ],
    [
        0.2187, 0.1829, 0.1678, 0.1505, 0.1328, 0.1153, 0.0984, 0.0826, 0.0681, 0.0551, 0.0437, 0.0339, 0.0258, 0.0191, 0.0138, 0.0096, 0.0065, 0.0043, 0.0027, 0.0016, 0.0009, 0.0005, 0.0002, 0.0001, 0.0,
    ],
    [
        0.1745, 0.1448, 0.1325, 0.1189, 0.105, 0.0914, 0.0784, 0.0662, 0.0551, 0.0451, 0.0363, 0.0287, 0.0222, 0.0168, 0.0124, 0.0089, 0.0062, 0.0042, 0.0027, 0.0017, 0.001, 0.0005, 0.0003, 0.0001, 0.0,
    ],
    [
        0.1393, 0.115, 0.1048, 0.0938, 0.0828, 0.0721, 0.062, 0.0527, 0.0441, 0.0364, 0.0296, 0.0237, 0.0186, 0.0144, 0.0108, 0.008, 0.0057, 0.0039, 0.0026, 0.0017, 0.001, 0.0006, 0.0003, 0.0001, 0.0,
    ],
    [
        0.1115, 0.0915, 0.0829, 0.074, 0.0652, 0.0568, 0.0489, 0.0417, 0.0351, 0.0291, 0.0239, 0.0193, 0.0153, 0.012, 0.0092, 0.0069, 0.005, 0.0036, 0.0024, 0.0016, 0.001, 0.0006, 0.0003, 0.0001, 0.0,
    ],
    [
        0.0895, 0.0731, 0.0658, 0.0585, 0.0514, 0.0448, 0.0386, 0.0329, 0.0277, 0.0231, 0.0191, 0.0155, 0.0124, 0.0098, 0.0076, 0.0058, 0.0043, 0.0031, 0.0022, 0.0015, 0.0009, 0.0006, 0.0003, 0.0001, 0.0,
    ],
    [
        0.072, 0.0585, 0.0523, 0.0463, 0.0406, 0.0353, 0.0304, 0.0259, 0.0219, 0.0183, 0.0151, 0.0124, 0.01, 0.008, 0.0062, 0.0048, 0.0036, 0.0027, 0.0019, 0.0013, 0.0009, 0.0005, 0.0003, 0.0001, 0.0,
    ],
    [
        0.0582, 0.0471, 0.0418, 0.0368, 0.0322, 0.0278, 0.0239, 0.0204, 0.0172, 0.0144, 0.012, 0.0098, 0.008, 0.0064, 0.005, 0.0039, 0.003, 0.0022, 0.0016, 0.0011, 0.0008, 0.0005, 0.0003, 0.0001, 0.0,
    ],
    [
        0.0473, 0.038, 0.0335, 0.0294, 0.0255, 0.022, 0.0189, 0.0161, 0.0136, 0.0114, 0.0094, 0.0078, 0.0063, 0.0051, 0.004, 0.0032, 0.0024, 0.0018, 0.0013, 0.0009, 0.0006, 0.0004, 0.0002, 0.0001, 0.0,
    ],
    [
        0.0387, 0.0308, 0.027, 0.0235, 0.0203, 0.0175, 0.0149, 0.0127, 0.0107, 0.009, 0.0074, 0.0061, 0.005, 0.004, 0.0032, 0.0025, 0.002, 0.0015, 0.0011, 0.0008, 0.0005, 0.0004, 0.0002, 0.0001, 0.0,
    ],
    [
        0.0317, 0.0251, 0.0218, 0.0189, 0.0162, 0.0139, 0.0118, 0.01, 0.0084, 0.0071, 0.0059, 0.0048, 0.004, 0.0032, 0.0026, 0.002, 0.0016, 0.0012, 0.0009, 0.0006, 0.0005, 0.0003, 0.0002, 0.0001, 0.0,
    ],
    [
        0.0261, 0.0206, 0.0177, 0.0152, 0.013, 0.0111, 0.0094, 0.0079, 0.0067, 0.0056, 0.0046, 0.0038, 0.0031, 0.0025, 0.002, 0.0016, 0.0013, 0.001, 0.0007, 0.0005, 0.0004, 0.0003, 0.0002, 0.0001, 0.0,
    ],
    [
        0.0217, 0.0169, 0.0144, 0.0123, 0.0105, 0.0089, 0.0075, 0.0063, 0.0053, 0.0044, 0.0036, 0.003, 0.0025, 0.002, 0.0016, 0.0013, 0.001, 0.0008, 0.0006, 0.0004, 0.0003, 0.0002, 0.0001, 0.0001, 0.0,
    ],
]);
