//! Two materials in one: each reflects light in proportion to its share of the surface, as if both lay side by side in spots too small to be
//! seen. So the value is linear in the weight, reciprocal if both are, and between those of both. A rough pane may be one of them, which lets
//! its share of the light through: a leaf, a lampshade, paper.

use glam::Vec3;

use super::angles::Angles;
use super::layer::Layer;
use super::lit::Lit;
use super::lobes::share;
use super::rough_pane::RoughPane;
use super::{BsdfAdjoint, Part};
use crate::render::material::{BLEND_WEIGHT, LAYER_INPUTS, MAX_INPUTS};

/// Both materials, and the share of the second.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Blended {
    pub layers: [Layer; 2],
    /// From 0 to 1.
    pub weight: f32,
}

impl Blended {
    fn weights(&self) -> [f32; 2] {
        [1.0 - self.weight, self.weight]
    }

    fn mixed(&self, of: impl Fn(&Layer) -> Vec3) -> Vec3 {
        let [a, b] = &self.layers;
        of(a) * (1.0 - self.weight) + of(b) * self.weight
    }

    /// Whether a lobe is so narrow that it is attached.
    pub fn is_narrow(&self) -> bool {
        self.layers.iter().any(Layer::is_narrow)
    }

    /// Whether light passes one of them.
    #[inline]
    pub fn has_pane(&self) -> bool {
        self.layers.iter().any(|layer| layer.pane().is_some())
    }

    /// The width α of the lobe by which light passes, if it does; of two the narrower one.
    pub fn pane_alpha(&self) -> Option<f32> {
        self.layers.iter().filter_map(|layer| layer.pane().map(RoughPane::alpha)).reduce(f32::min)
    }

    /// Whether all light belongs to the specular part.
    pub fn is_specular(&self) -> bool {
        self.layers.iter().all(|layer| layer.is_specular(self.is_narrow()))
    }

    pub fn eval(&self, angles: &Angles) -> Vec3 {
        self.mixed(|layer| layer.eval(angles))
    }

    /// Everything, and the density of [`Blended::sample_facet`].
    pub fn eval_and_pdf(&self, angles: &Angles) -> (Vec3, f32) {
        let share = self.second_share(angles.ci);
        let [(a, pdf_a), (b, pdf_b)] = self.layers.map(|layer| layer.eval_and_pdf(angles));
        (a * (1.0 - self.weight) + b * self.weight, (1.0 - share) * pdf_a + share * pdf_b)
    }

    /// What passes to the other side, and the density of [`Blended::sample_facet`] there.
    pub fn through(&self, n: Vec3, wi: Vec3, wo: Vec3) -> (Vec3, f32) {
        let share = self.second_share(n.dot(wi).abs());
        let of_pane = |pane: &RoughPane| pane.eval_and_pdf(n, wi, wo);
        let [(a, pdf_a), (b, pdf_b)] = self.layers.map(|layer| layer.pane().map_or((Vec3::ZERO, 0.0), of_pane));
        (a * (1.0 - self.weight) + b * self.weight, (1.0 - share) * pdf_a + share * pdf_b)
    }

    pub fn eval_part(&self, part: Part, angles: &Angles) -> Vec3 {
        let any_narrow = self.is_narrow();
        self.mixed(|layer| layer.eval_chosen(layer.chosen(part, any_narrow), angles))
    }

    /// Adjoint of [`Blended::eval_part`], and on the other side of [`Blended::through`], which belongs to the specular part. `half_fixed` is as in [`Microfacets::d_eval`](super::microfacet::Microfacets::d_eval).
    pub fn d_eval_part(&self, part: Part, n: Vec3, wi: Vec3, wo: Vec3, d_f: Vec3, half_fixed: bool) -> BsdfAdjoint {
        let (any_narrow, angles, passes) = (self.is_narrow(), Angles::new(n, wi, wo), n.dot(wo) <= 0.0);
        let [(first, a), (second, b)] = std::array::from_fn(|i| {
            let layer = &self.layers[i];
            let chosen = layer.chosen(part, any_narrow);
            let value = match layer.pane() {
                Some(pane) if passes && chosen.lobe => pane.eval_and_pdf(n, wi, wo).0,
                _ if passes => return Default::default(),
                _ => layer.eval_chosen(chosen, &angles),
            };
            (layer.d_eval_chosen(chosen, n, wi, wo, d_f * self.weights()[i], half_fixed), value)
        });
        let mut out = first;
        out.directions.add(&second.directions);
        out.d_values[LAYER_INPUTS..BLEND_WEIGHT].copy_from_slice(&second.d_values[..LAYER_INPUTS]);
        out.d_values[BLEND_WEIGHT].x = d_f.dot(b - a);
        out
    }

    /// A normal of the microfacets, as [`Lit::sample_facet`] has it, and whether light passes the facet.
    pub fn sample_facet(&self, wi: Vec3, square: [f32; 2], u: f32) -> (Option<Vec3>, bool) {
        let share = self.second_share(wi.z);
        let [a, b] = &self.layers;
        let (layer, u) = if u < share { (b, u / share) } else { (a, (u - share) / (1.0 - share)) };
        let facet = layer.sample_facet(wi, square, u);
        (facet, layer.pane().zip(facet).is_some_and(|(pane, h)| pane.passes(wi, h, u)))
    }

    pub fn pdf(&self, angles: &Angles) -> f32 {
        let share = self.second_share(angles.ci);
        let [a, b] = self.layers.map(|layer| layer.pdf(angles));
        (1.0 - share) * a + share * b
    }

    /// Approximate albedos of all lobes of both layers, weighted: of each the narrowest, in second place, and the others.
    fn albedos(&self, ci: f32) -> [[f32; 2]; 2] {
        let ci = ci.abs().max(1e-3);
        std::array::from_fn(|i| self.layers[i].lobe_albedos(ci).map(|albedo| albedo * self.weights()[i]))
    }

    /// Share of the samples that go to the second layer.
    fn second_share(&self, ci: f32) -> f32 {
        let [a, b] = self.albedos(ci).map(|[others, narrowest]| others + narrowest);
        share(b, a)
    }

    /// The width α of the narrowest lobe.
    pub fn alpha(&self) -> f32 {
        self.layers[0].alpha().min(self.layers[1].alpha())
    }

    /// The albedos of the narrowest lobe, in second place, and of the others together.
    pub fn lobe_albedos(&self, ci: f32) -> [f32; 2] {
        let [a, b] = self.albedos(ci);
        let (narrowest, other) = if self.layers[0].alpha() <= self.layers[1].alpha() { (a, b) } else { (b, a) };
        [narrowest[0] + other[0] + other[1], narrowest[1]]
    }

    /// What the albedo channel shows.
    pub fn albedo(&self) -> Vec3 {
        self.mixed(Layer::albedo)
    }

    /// Adjoint of [`Blended::albedo`], by input.
    pub fn d_albedo(&self, d_albedo: Vec3) -> [Vec3; MAX_INPUTS] {
        let [a, b] = &self.layers;
        let mut d = a.d_albedo(d_albedo * (1.0 - self.weight));
        let second = b.d_albedo(d_albedo * self.weight);
        d[LAYER_INPUTS..BLEND_WEIGHT].copy_from_slice(&second[..LAYER_INPUTS]);
        d[BLEND_WEIGHT].x = d_albedo.dot(b.albedo() - a.albedo());
        d
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Pcg32;
    use crate::render::bsdf::rough_dielectric::tests::{assert_samples_follow, integrate};
    use crate::render::bsdf::{Bsdf, Lobe};
    use crate::render::material::{Blend, ClearCoat, MaterialKind, SheenLayer};

    const TINT: Vec3 = Vec3::new(0.9, 0.5, 0.3);

    fn pane(roughness: f32) -> MaterialKind<Vec3> {
        MaterialKind::ThinDielectric { ior: Vec3::splat(1.5), tint: TINT, roughness: Some(Vec3::splat(roughness)) }
    }

    /// What a leaf is made of beside its pane: matte, glossy, and a narrow lobe under fibres and varnish.
    fn opaque() -> [Bsdf; 3] {
        let half = Vec3::splat(0.5);
        let principled =
            MaterialKind::Principled { base_color: TINT, metallic: half * 0.4, roughness: half, specular: half };
        let metal = MaterialKind::Conductor { reflectance: TINT, roughness: Vec3::splat(0.3) };
        let sheen = SheenLayer { color: TINT * 0.5, roughness: half };
        let coat = ClearCoat { weight: half, roughness: Vec3::splat(0.2) };
        [
            Bsdf::new(&MaterialKind::Diffuse { reflectance: TINT }),
            Bsdf::new(&principled),
            Bsdf::new(&metal).sheened(&sheen).coated(&coat),
        ]
    }

    /// The opaque materials with a pane as the second one.
    fn leaves(weight: f32, roughness: f32) -> [Bsdf; 3] {
        let kind = pane(roughness);
        let blend = Blend { kind, grain: None, sheen: None, coat: None, weight: Vec3::splat(weight) };
        opaque().map(|bsdf| bsdf.blended(&blend))
    }

    fn anywhere(rng: &mut Pcg32) -> Vec3 {
        (Vec3::from(rng.next_3d()) * 2.0 - 1.0).normalize()
    }

    /// On both sides a blend with a pane is the sum of its materials by their shares, and so are its derivatives.
    #[test]
    fn leaves_are_sums_of_what_they_are_made_of() {
        let mut rng = Pcg32::new(17);
        let mut counts = [0; 2];
        for i in 0..3000 {
            let (weight, roughness) = ([0.0, 0.3, 1.0][i % 3], [0.15, 0.4, 0.9][i / 3 % 3]);
            let (own, clear) = (opaque()[i / 9 % 3], Bsdf::new(&pane(roughness)));
            let leaf = leaves(weight, roughness)[i / 9 % 3];
            let [n, wi, wo, d_f] = [(); 4].map(|()| anywhere(&mut rng));
            if n.dot(wo).abs() < 0.05 || n.dot(wi).abs() < 0.05 {
                continue;
            }
            counts[usize::from(n.dot(wo) < 0.0)] += 1;
            let [a, b] = [own, clear].map(|bsdf| bsdf.eval(n, wi, wo));
            let expected = a * (1.0 - weight) + b * weight;
            let found = leaf.eval(n, wi, wo);
            assert!((found - expected).length() <= 1e-5 * expected.length(), "{leaf:?}: {found} {expected}");
            let (value, pdf) = leaf.eval_and_pdf(n, wi, wo);
            assert!((value - found).length() <= 1e-5 * found.length(), "{leaf:?}: {value} {found}");
            assert!((pdf - leaf.pdf(n, wi, wo)).abs() <= 1e-5 * pdf, "{leaf:?}: {pdf}");
            let parts = [Part::Diffuse, Part::Specular].map(|part| leaf.eval_part(part, n, wi, wo));
            assert!((parts[0] + parts[1] - found).length() <= 1e-5 * found.length(), "{leaf:?}: {parts:?} {found}");
            if n.dot(wo) < 0.0 {
                assert_eq!(parts[0], Vec3::ZERO, "what passes is attached to the surface");
            }
            let d = leaf.d_eval(n, wi, wo, d_f);
            let [of_own, of_pane] =
                [(own, 1.0 - weight), (clear, weight)].map(|(bsdf, share)| bsdf.d_eval(n, wi, wo, d_f * share));
            let mut values = of_own.d_values;
            values[LAYER_INPUTS..BLEND_WEIGHT].copy_from_slice(&of_pane.d_values[..LAYER_INPUTS]);
            values[BLEND_WEIGHT].x = d_f.dot(b - a);
            let mut directions = of_own.directions;
            directions.add(&of_pane.directions);
            let near = |found: Vec3, expected: Vec3, scale: f32| (found - expected).length() <= 1e-4 * scale + 1e-6;
            for (found, expected) in d.d_values.iter().zip(&values) {
                assert!(near(*found, *expected, expected.length()), "{leaf:?}: {d:?} {values:?}");
            }
            let scale = directions.n.length() + directions.wi.length() + directions.wo.length();
            let found = d.directions;
            for (found, expected) in [(found.n, directions.n), (found.wi, directions.wi), (found.wo, directions.wo)] {
                assert!(near(found, expected, scale), "{leaf:?}: {d:?} {directions:?}");
            }
        }
        assert!(counts.iter().all(|n| *n > 500), "{counts:?}");
    }

    /// Light takes the same way back, through the leaf as well.
    #[test]
    fn leaves_are_reciprocal() {
        let mut rng = Pcg32::new(18);
        for leaf in leaves(0.4, 0.5) {
            for _ in 0..300 {
                let (a, b) = (anywhere(&mut rng), anywhere(&mut rng));
                let a = if a.z < 0.0 { -a } else { a };
                if a.z < 0.05 || b.z.abs() < 0.05 {
                    continue;
                }
                // Seen from where it has gone, its normal is on that side.
                let side = Vec3::Z * b.z.signum();
                let (there, back) = (leaf.eval(Vec3::Z, a, b) / b.z.abs(), leaf.eval(side, b, a) / a.z);
                assert!((there - back).length() < 0.01 * back.length() + 1e-6, "{leaf:?}: {there} {back}");
            }
        }
    }

    /// Samples are as frequent as their density says, and lose energy only.
    #[test]
    fn samples_of_leaves_follow_the_density() {
        let mut rng = Pcg32::new(19);
        for weight in [0.0, 0.35, 1.0] {
            for leaf in [leaves(weight, 0.7)[0], leaves(weight, 0.5)[1]] {
                for cos in [0.95f32, 0.5, 0.2] {
                    let wi = Vec3::new((1.0 - cos * cos).sqrt() * 0.6, (1.0 - cos * cos).sqrt() * 0.8, cos);
                    let mut energy = 0.0;
                    integrate(288, 384, |wo, area| energy += f64::from(leaf.eval(Vec3::Z, wi, wo).x) * area);
                    assert!(energy < 1.0 && energy > 0.5, "{leaf:?} at {cos}: {energy}");
                    let mut draw = || {
                        let s = leaf.sample(wi, rng.next_3d())?;
                        let (f, pdf) = leaf.eval_and_pdf(Vec3::Z, wi, s.wo);
                        assert!((s.pdf - pdf).abs() <= 2e-3 * pdf, "{leaf:?} at {cos}: {s:?} {pdf}");
                        assert!(s.f.abs_diff_eq(f, 2e-3 * f.max_element()), "{leaf:?} at {cos}: {s:?} {f}");
                        assert_eq!(s.lobe == Lobe::GLOSSY_REFRACTED, s.wo.z < 0.0);
                        Some(s.wo)
                    };
                    assert_samples_follow(|wo| leaf.pdf(Vec3::Z, wi, wo), &mut draw, &(leaf, cos));
                }
            }
        }
    }
}
