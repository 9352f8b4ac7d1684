//! The sheen of cloth: a microfacet lobe whose facets stand upright, as fibres do, and scatter light forwards and backwards at grazing angles.
//!
//! Estevez & Kulla 2017, "Production Friendly Microfacet Sheen BRDF": the distribution D = (2 + 1/α) sin^{1/α} θ / 2π of the half vector, and
//! shadowing 1 / (1 + Λi + Λo) with a fit to Λ. Theirs reflects more than it receives at grazing angles where α is below 0.07, so that α
//! is 0.07 + 0.93 roughness² here (glTF has α = roughness²).

use std::f32::consts::{FRAC_1_PI, TAU};

use glam::Vec3;

use super::albedo::AlbedoTable;
use super::angles::Angles;
use super::microfacet::{Lobe, Microfacets};

/// The distribution of upright fibres.
#[derive(Clone, Copy, Debug)]
pub struct Sheen {
    roughness: f32,
    alpha: f32,
}

const LEAST_ALPHA: f32 = 0.07;

/// Below this cosine shadowing stays as it is there.
const LEAST_COSINE: f32 = 1e-4;

/// Numbers a to e of the fit at α = 0 and at α = 1, between which they go by (1 − α)².
const FIT: [[f32; 5]; 2] =
    [[25.3245, 3.32435, 0.16801, -1.27393, -4.85967], [21.5473, 3.82987, 0.19823, -1.97760, -4.32054]];

/// A function of cosine and α, with its derivatives.
#[derive(Clone, Copy)]
struct Fitted {
    value: f32,
    by_c: f32,
    by_alpha: f32,
}

impl Sheen {
    pub fn new(roughness: f32) -> Sheen {
        Sheen { roughness, alpha: LEAST_ALPHA + (1.0 - LEAST_ALPHA) * roughness * roughness }
    }

    /// The roughness that has this α; 0 if α is less than any roughness has.
    pub fn roughness_of(alpha: f32) -> f32 {
        ((alpha - LEAST_ALPHA).max(0.0) / (1.0 - LEAST_ALPHA)).sqrt()
    }

    /// The α of the distribution.
    pub fn width(&self) -> f32 {
        self.alpha
    }

    fn alpha_by_roughness(&self) -> f32 {
        2.0 * (1.0 - LEAST_ALPHA) * self.roughness
    }

    fn distribution(&self, sin2: f32) -> f32 {
        let exponent = 1.0 / self.alpha;
        (2.0 + exponent) * (0.5 * FRAC_1_PI) * sin2.max(1e-12).powf(0.5 * exponent)
    }

    /// ∂ ln D in sin² and in α.
    fn d_log_distribution(&self, sin2: f32) -> (f32, f32) {
        let (sin2, exponent) = (sin2.max(1e-12), 1.0 / self.alpha);
        let by_exponent = 1.0 / (2.0 + exponent) + 0.5 * sin2.ln();
        (0.5 * exponent / sin2, -exponent * exponent * by_exponent)
    }

    /// a / (1 + b x^c) + d x + e
    fn fit(&self, x: f32) -> Fitted {
        let t = (1.0 - self.alpha) * (1.0 - self.alpha);
        let [a, b, c, d, e] = [0, 1, 2, 3, 4].map(|i| FIT[1][i] + (FIT[0][i] - FIT[1][i]) * t);
        let [da, db, dc, dd, de] = [0, 1, 2, 3, 4].map(|i| FIT[0][i] - FIT[1][i]);
        let power = x.powf(c);
        let below = 1.0 / (1.0 + b * power);
        let by_power = -a * b * below * below;
        let by_t = da * below - a * below * below * power * db + by_power * power * x.ln() * dc + dd * x + de;
        Fitted {
            value: a * below + d * x + e,
            by_c: by_power * c * power / x + d,
            by_alpha: -2.0 * (1.0 - self.alpha) * by_t,
        }
    }

    /// Λ at a cosine: of the fit up to a half, and beyond it so that ln Λ goes on as it came.
    fn lambda(&self, c: f32) -> Fitted {
        let c = c.max(LEAST_COSINE);
        let log = if c < 0.5 {
            self.fit(c)
        } else {
            let (middle, mirrored) = (self.fit(0.5), self.fit((1.0 - c).max(1e-7)));
            Fitted {
                value: 2.0 * middle.value - mirrored.value,
                by_c: mirrored.by_c,
                by_alpha: 2.0 * middle.by_alpha - mirrored.by_alpha,
            }
        };
        let value = log.value.exp();
        Fitted { value, by_c: value * log.by_c, by_alpha: value * log.by_alpha }
    }
}

impl Microfacets for Sheen {
    fn eval(&self, &Angles { ci, co, sin2, .. }: &Angles) -> f32 {
        let shadow = 1.0 / (1.0 + self.lambda(ci).value + self.lambda(co).value);
        self.distribution(sin2) * shadow / (4.0 * ci.max(LEAST_COSINE))
    }

    fn d_eval(&self, angles: &Angles, half_fixed: bool) -> Lobe {
        let &Angles { ci, co, sin2, .. } = angles;
        let value = self.eval(angles);
        let (i, o) = (self.lambda(ci), self.lambda(co));
        let shadow = 1.0 / (1.0 + i.value + o.value);
        let (by_sin2, by_alpha) = self.d_log_distribution(sin2);
        let by_cosine = |c: f32| if c > LEAST_COSINE { -1.0 / c } else { 0.0 };
        Lobe {
            value,
            d_ci: value * (by_cosine(ci) - shadow * i.by_c),
            d_co: -value * shadow * o.by_c,
            d_sin2: if half_fixed { 0.0 } else { value * by_sin2 },
            d_roughness: value * (by_alpha - shadow * (i.by_alpha + o.by_alpha)) * self.alpha_by_roughness(),
        }
    }

    /// The normal half way to a direction that is uniform over the hemisphere: the lobe is wide, and mirrored at upright facets most
    /// directions would end below the surface.
    fn sample(&self, wi: Vec3, u: [f32; 2]) -> Vec3 {
        let sin = (1.0 - u[0] * u[0]).max(0.0).sqrt();
        let (sin_phi, cos_phi) = (TAU * u[1]).sin_cos();
        (wi + Vec3::new(sin * cos_phi, sin * sin_phi, u[0])).normalize_or(Vec3::Z)
    }

    fn pdf(&self, _: &Angles) -> f32 {
        0.5 * FRAC_1_PI
    }

    /// Half vectors lie anywhere.
    fn alpha(&self) -> f32 {
        1.0
    }
}

/// What the lobe reflects, by quadrature. Nodes are raised where linear interpolation between them would be less: by at most 0.008, except
/// between the first two columns, at grazing angles.
#[rustfmt::skip]
pub static REFLECTED: AlbedoTable = AlbedoTable::new([
    [
        1.0, 0.9037, 0.6005, 0.4772, 0.3844, 0.3118, 0.2536, 0.2061, 0.167, 0.1348, 0.1081, 0.0861, 0.0679, 0.0531, 0.0411, 0.0314, 0.0236, 0.0173, 0.0124, 0.0086, 0.0057, 0.0035, 0.002, 0.0009, 0.0003,
    ],
    [
        1.0, 0.8991, 0.5989, 0.4774, 0.3858, 0.314, 0.2562, 0.2089, 0.17, 0.1377, 0.1109, 0.0887, 0.0703, 0.0552, 0.043, 0.033, 0.0249, 0.0185, 0.0133, 0.0093, 0.0062, 0.0039, 0.0022, 0.0011, 0.0004,
    ],
    [
        0.9793, 0.8853, 0.5944, 0.4781, 0.3898, 0.3201, 0.2636, 0.217, 0.1783, 0.146, 0.1189, 0.0962, 0.0772, 0.0614, 0.0485, 0.0378, 0.0291, 0.0219, 0.0161, 0.0115, 0.0079, 0.0051, 0.003, 0.0016, 0.0006,
    ],
    [
        0.9413, 0.8665, 0.5885, 0.4793, 0.3958, 0.3291, 0.2745, 0.229, 0.1908, 0.1584, 0.131, 0.1077, 0.0879, 0.0713, 0.0574, 0.0457, 0.036, 0.0278, 0.0211, 0.0155, 0.011, 0.0075, 0.0047, 0.0026, 0.0011,
    ],
    [
        0.9026, 0.8478, 0.5832, 0.4818, 0.4033, 0.34, 0.2876, 0.2435, 0.206, 0.1738, 0.1461, 0.1222, 0.1016, 0.0841, 0.0691, 0.0563, 0.0454, 0.0361, 0.0282, 0.0215, 0.0159, 0.0113, 0.0075, 0.0045, 0.0021,
    ],
    [
        0.8688, 0.832, 0.5802, 0.4858, 0.4122, 0.3523, 0.3022, 0.2595, 0.2228, 0.1909, 0.1631, 0.1388, 0.1175, 0.0991, 0.0831, 0.0693, 0.0572, 0.0467, 0.0376, 0.0296, 0.0227, 0.0168, 0.0118, 0.0076, 0.0042,
    ],
    [
        0.8424, 0.8212, 0.5803, 0.492, 0.4227, 0.3658, 0.3178, 0.2766, 0.2407, 0.2092, 0.1814, 0.1568, 0.1349, 0.1157, 0.0989, 0.0841, 0.071, 0.0593, 0.0489, 0.0397, 0.0315, 0.0243, 0.0179, 0.0124, 0.0076,
    ],
    [
        0.8241, 0.8173, 0.5839, 0.5007, 0.4349, 0.3806, 0.3345, 0.2945, 0.2594, 0.2282, 0.2005, 0.1756, 0.1533, 0.1334, 0.1159, 0.1003, 0.0862, 0.0735, 0.062, 0.0516, 0.0422, 0.0337, 0.026, 0.019, 0.0128,
    ],
    [
        0.8143, 0.8202, 0.5913, 0.512, 0.4491, 0.3968, 0.3521, 0.3131, 0.2787, 0.2478, 0.2201, 0.1951, 0.1723, 0.152, 0.1338, 0.1175, 0.1026, 0.089, 0.0766, 0.0651, 0.0545, 0.0448, 0.0358, 0.0275, 0.02,
    ],
    [
        0.8125, 0.8288, 0.6024, 0.5259, 0.465, 0.4143, 0.3707, 0.3325, 0.2985, 0.2679, 0.2402, 0.2149, 0.1919, 0.171, 0.1523, 0.1354, 0.1199, 0.1055, 0.0922, 0.0799, 0.0683, 0.0575, 0.0473, 0.0379, 0.029,
    ],
    [
        0.8179, 0.8424, 0.6167, 0.5422, 0.4827, 0.4331, 0.3902, 0.3525, 0.3188, 0.2883, 0.2605, 0.2351, 0.2117, 0.1904, 0.1712, 0.1538, 0.1377, 0.1227, 0.1087, 0.0955, 0.0831, 0.0714, 0.0603, 0.0497, 0.0398,
    ],
    [
        0.8293, 0.8599, 0.6338, 0.5605, 0.5019, 0.4528, 0.4104, 0.373, 0.3394, 0.3089, 0.281, 0.2553, 0.2315, 0.2099, 0.1903, 0.1724, 0.1557, 0.1402, 0.1256, 0.1118, 0.0986, 0.0861, 0.0742, 0.0628, 0.0519,
    ],
    [
        0.8457, 0.8804, 0.6531, 0.5802, 0.522, 0.4732, 0.431, 0.3936, 0.36, 0.3294, 0.3013, 0.2753, 0.2512, 0.2291, 0.2092, 0.1908, 0.1738, 0.1578, 0.1427, 0.1283, 0.1146, 0.1014, 0.0889, 0.0768, 0.0652,
    ],
    [
        0.8656, 0.9026, 0.6736, 0.6007, 0.5426, 0.4938, 0.4515, 0.4141, 0.3803, 0.3494, 0.3211, 0.2948, 0.2703, 0.2479, 0.2276, 0.2089, 0.1915, 0.1751, 0.1595, 0.1447, 0.1306, 0.1169, 0.1038, 0.0912, 0.079,
    ],
    [
        0.8876, 0.9251, 0.6945, 0.6212, 0.5628, 0.5138, 0.4714, 0.4337, 0.3997, 0.3686, 0.34, 0.3134, 0.2886, 0.2659, 0.2453, 0.2262, 0.2085, 0.1918, 0.1759, 0.1607, 0.1462, 0.1322, 0.1187, 0.1057, 0.0932,
    ],
    [
        0.9096, 0.9465, 0.7145, 0.6407, 0.5819, 0.5326, 0.49, 0.4521, 0.4178, 0.3865, 0.3576, 0.3307, 0.3057, 0.2827, 0.2618, 0.2425, 0.2245, 0.2075, 0.1914, 0.176, 0.1612, 0.147, 0.1333, 0.12, 0.1072,
    ],
    [
        0.9298, 0.9655, 0.7323, 0.658, 0.5989, 0.5494, 0.5065, 0.4684, 0.434, 0.4025, 0.3734, 0.3463, 0.3211, 0.2979, 0.2768, 0.2574, 0.2392, 0.2221, 0.2058, 0.1903, 0.1753, 0.1609, 0.147, 0.1336, 0.1207,
    ],
    [
        0.9456, 0.9803, 0.7467, 0.672, 0.6127, 0.5631, 0.5201, 0.482, 0.4475, 0.416, 0.3868, 0.3597, 0.3344, 0.3111, 0.29, 0.2705, 0.2523, 0.2351, 0.2188, 0.2031, 0.1882, 0.1737, 0.1598, 0.1464, 0.1334,
    ],
    [
        0.9549, 0.9893, 0.7559, 0.6813, 0.6222, 0.5728, 0.53, 0.4921, 0.4578, 0.4264, 0.3973, 0.3703, 0.3451, 0.3219, 0.3009, 0.2814, 0.2633, 0.2462, 0.23, 0.2144, 0.1995, 0.1851, 0.1713, 0.1579, 0.145,
    ],
    [
        0.9555, 0.9901, 0.7585, 0.6847, 0.6263, 0.5775, 0.5353, 0.4979, 0.464, 0.433, 0.4044, 0.3777, 0.3528, 0.3299, 0.3091, 0.2899, 0.272, 0.2551, 0.2391, 0.2238, 0.209, 0.1949, 0.1812, 0.168, 0.1553,
    ],
    [
        0.9329, 0.9809, 0.7528, 0.6807, 0.6237, 0.5762, 0.535, 0.4985, 0.4655, 0.4352, 0.4072, 0.3812, 0.3568, 0.3344, 0.3141, 0.2954, 0.2779, 0.2615, 0.2458, 0.2309, 0.2165, 0.2026, 0.1893, 0.1764, 0.164,
    ],
]);
