mod energy;

use std::f64::consts::{PI, TAU};

use glam::{DVec3, Quat};

use super::albedo::AlbedoTable;
use super::coat::SCHLICK;
use super::microfacet::Microfacets;
use super::sheen::REFLECTED;
use super::*;
use crate::math::{Dual, Frame, Pcg32};
use crate::render::interaction::SurfaceInteraction;
use crate::render::material::{
    self, ANISOTROPY, BLEND_WEIGHT, Blend, COAT, COAT_ROUGHNESS, COVERS, ClearCoat, InputField, LAYER_INPUTS,
    MAX_INPUTS, SHEEN, SHEEN_COLOR, SHEEN_ROUGHNESS, SheenLayer, TURN, WEIGHT,
};

/// What a twin sees of the directions: three cosines, and the coordinates of both directions along tangent and bitangent.
const SEEN: usize = 7;
/// That, and the RGB inputs.
type D = Dual<{ SEEN + 3 * MAX_INPUTS }>;

const INPUT: Input = Input::VertexColor;

/// Every model, some of them under a coat, a sheen or both, and blends of bare and covered ones.
fn kinds() -> Vec<Material> {
    let models = [
        MaterialKind::Diffuse { reflectance: INPUT },
        MaterialKind::Conductor { reflectance: INPUT, roughness: INPUT },
        MaterialKind::ConductorIor { eta: INPUT, k: INPUT, roughness: INPUT },
        MaterialKind::Phong { diffuse: INPUT, specular: INPUT, roughness: INPUT },
        MaterialKind::Principled { base_color: INPUT, metallic: INPUT, roughness: INPUT, specular: INPUT },
        MaterialKind::Plastic { diffuse: INPUT, ior: INPUT, roughness: INPUT },
        MaterialKind::Cloth { diffuse: INPUT, sheen: INPUT, roughness: INPUT },
        MaterialKind::Mirror { reflectance: INPUT },
    ];
    let grain = |wanted: bool| wanted.then_some(material::Grain { anisotropy: INPUT, turn: INPUT });
    let brushed = [1, 2, 4, 5].map(|i| Material { grain: grain(true), ..Material::from(models[i].clone()) });
    let coat = |wanted: bool| wanted.then_some(ClearCoat { weight: INPUT, roughness: INPUT });
    let sheen = |wanted: bool| wanted.then_some(SheenLayer { color: INPUT, roughness: INPUT });
    let coated = [(0, false), (1, false), (3, false), (4, false), (4, true)].map(|(i, is_brushed)| Material {
        grain: grain(is_brushed),
        coat: coat(true),
        ..Material::from(models[i].clone())
    });
    let sheened = [0, 1, 2, 4, 5].into_iter().flat_map(|i| [false, true].map(|is_coated| (i, is_coated)));
    let sheened = sheened.map(|(i, is_coated)| Material {
        grain: grain(i == 2),
        sheen: sheen(true),
        coat: coat(is_coated),
        ..Material::from(models[i].clone())
    });
    let blended = [(0, 1), (1, 4), (3, 0), (6, 5), (2, 1)].into_iter().enumerate().map(|(i, (a, b))| {
        let (kind, grains, coat) = (models[b].clone(), [i == 1, i == 4].map(grain), [i >= 3, i % 3 == 1].map(coat));
        let [own, other] = [i == 1, i == 2].map(sheen);
        let blend = Some(Blend { kind, grain: grains[1].clone(), sheen: other, coat: coat[1].clone(), weight: INPUT });
        let own = Material { sheen: own, coat: coat[0].clone(), ..Material::from(models[a].clone()) };
        Material { grain: grains[0].clone(), blend, ..own }
    });
    let bare = models.iter().cloned().map(Material::from);
    bare.chain(brushed).chain(coated).chain(sheened.collect::<Vec<_>>()).chain(blended).collect()
}

/// Plausible values of a material's inputs, with the given roughness; that of a coat is the same, another one, or always a third. The second
/// material of a blend is rougher.
fn values(material: &Material, roughness: f32) -> [Vec3; MAX_INPUTS] {
    let mut all = [Vec3::splat(0.3); MAX_INPUTS];
    all[..LAYER_INPUTS].copy_from_slice(&layer_values(&material.kind, roughness));
    if let Some(blend) = &material.blend {
        let rougher = (roughness + 0.3).min(0.95);
        all[LAYER_INPUTS..BLEND_WEIGHT].copy_from_slice(&layer_values(&blend.kind, rougher));
    }
    all
}

fn layer_values(kind: &MaterialKind, roughness: f32) -> [Vec3; LAYER_INPUTS] {
    let (a, b) = (Vec3::new(0.8, 0.45, 0.2), Vec3::new(0.1, 0.3, 0.15));
    let r = Vec3::splat(roughness);
    let of_coat = match kind {
        MaterialKind::Diffuse { .. } => roughness,
        MaterialKind::Conductor { .. } => (1.35 - roughness).min(1.0),
        _ => 0.35,
    };
    let [x, y, z, w] = match kind {
        MaterialKind::Conductor { .. } => [a, r, r, r],
        // Copper.
        MaterialKind::ConductorIor { .. } => [Vec3::new(0.27, 0.68, 1.3), Vec3::new(3.6, 2.6, 2.3), r, r],
        MaterialKind::Phong { .. } => [a, b, r, r],
        MaterialKind::Principled { .. } => [a, Vec3::splat(0.35), r, Vec3::splat(0.6)],
        MaterialKind::Plastic { .. } => [a, Vec3::splat(1.45), r, r],
        MaterialKind::Cloth { .. } => [a, Vec3::new(0.9, 0.6, 0.3), r, r],
        _ => [a, a, a, a],
    };
    let of_sheen = (roughness + 0.12).min(0.98);
    [x, y, z, w, Vec3::new(0.7, of_coat, of_sheen), Vec3::new(0.6, 0.4, 0.0), Vec3::new(0.9, 0.5, 0.2)]
}

/// A material whose inputs have these values, by their places.
fn looked_up(material: &Material, values: &[Vec3; MAX_INPUTS]) -> Bsdf {
    let mut places = places(material).into_iter();
    material.bsdf(|_, _| {
        let (_, place, channel) = places.next().unwrap();
        channel.map_or(values[place], |c| Vec3::splat(values[place][c]))
    })
}

/// All inputs with their places, and of those of covers, which share one, the channel.
fn places(material: &Material) -> Vec<(InputField, usize, Option<usize>)> {
    let of_layer = |kind: &MaterialKind, [grain, sheen, coat]: [bool; 3], from: usize| {
        let of_grain = [(ANISOTROPY, from + GRAIN, Some(0)), (TURN, from + GRAIN, Some(1))];
        let of_sheen = [(SHEEN, from + SHEEN_COLOR, None), (SHEEN_ROUGHNESS, from + COVERS, Some(2))];
        let of_coat = [(COAT, from + COVERS, Some(0)), (COAT_ROUGHNESS, from + COVERS, Some(1))];
        let of_model: Vec<_> = kind.inputs().enumerate().map(|(i, (field, _))| (field, from + i, None)).collect();
        let more = [(grain, of_grain), (sheen, of_sheen), (coat, of_coat)];
        of_model.into_iter().chain(more.into_iter().filter(|(is_there, _)| *is_there).flat_map(|(_, inputs)| inputs))
    };
    let own = [material.grain.is_some(), material.sheen.is_some(), material.coat.is_some()];
    let mut all: Vec<_> = of_layer(&material.kind, own, 0).collect();
    if let Some(blend) = &material.blend {
        let other = [blend.grain.is_some(), blend.sheen.is_some(), blend.coat.is_some()];
        all.extend(of_layer(&blend.kind, other, LAYER_INPUTS));
        all.push((WEIGHT, BLEND_WEIGHT, None));
    }
    all
}

/// What the numbers of an input mean; `None` if the material has no such input.
fn field(material: &Material, place: usize, channel: usize) -> Option<InputField> {
    let is_it = |of: &Option<usize>| of.is_none_or(|c| c == channel);
    places(material).into_iter().find(|(_, p, c)| *p == place && is_it(c)).map(|(field, ..)| field)
}

/// All non-delta materials over several roughnesses, their grains laid along x and y.
fn bsdfs(roughnesses: &[f32]) -> Vec<(Material, [Vec3; MAX_INPUTS], Bsdf)> {
    let mut all = Vec::new();
    for kind in kinds() {
        for &roughness in roughnesses {
            let values = values(&kind, roughness);
            let bsdf = looked_up(&kind, &values).laid([Vec3::X, Vec3::Y]);
            if !bsdf.is_delta() {
                all.push((kind.clone(), values, bsdf));
            }
        }
    }
    all
}

fn direction(cos_theta: f32, phi: f32) -> Vec3 {
    let sin = (1.0 - cos_theta * cos_theta).max(0.0).sqrt();
    Vec3::new(sin * phi.cos(), sin * phi.sin(), cos_theta)
}

// ---- The twin: the formulas as the documentation states them, in dual numbers ----

/// Both parts of a material: lobes below a width of 0.2 turn with the surface, the others stay with the matte part; but if all are wide, they
/// stand together.
///
/// `along` has the coordinates of both directions along tangent and bitangent.
pub(crate) fn twins<const N: usize>(
    material: &Material,
    cosines: [Dual<N>; 3],
    along: [[Dual<N>; 2]; 2],
    v: &[[Dual<N>; 3]; MAX_INPUTS],
) -> [[Dual<N>; 3]; 2] {
    let [ci, co, io] = cosines;
    // Mirror wi at the tangent plane where it lies behind it.
    let (ci, io) = if ci.value < 0.0 { (-ci, io - 2.0 * ci * co) } else { (ci, io) };
    let length = (2.0 + 2.0 * io).sqrt();
    let cosines = [ci, co, (ci + co) / length, length / 2.0];
    let (mut lobes, one) = (Vec::new(), Dual::constant(1.0));
    let weight = v[BLEND_WEIGHT][0];
    let share = if material.blend.is_some() { 1.0 - weight } else { one };
    // How many times as strong as without it the lobe is that has a grain.
    let brushed = |v: &[[Dual<N>; 3]], kind: &MaterialKind| {
        let roughness = if matches!(kind, MaterialKind::Conductor { .. }) { v[1][0] } else { v[2][0] };
        twin_brush(roughness, v[GRAIN], cosines, along) / twin_ggx(roughness, cosines[2], cosines[0], cosines[1])
    };
    let own = material.grain.is_some().then(|| brushed(&v[..LAYER_INPUTS], &material.kind));
    let covers = [material.sheen.is_some(), material.coat.is_some()];
    lobes.extend(layer_twins(&material.kind, (own, covers), cosines, &v[..LAYER_INPUTS], share));
    if let Some(blend) = &material.blend {
        let v = &v[LAYER_INPUTS..BLEND_WEIGHT];
        let other = blend.grain.is_some().then(|| brushed(v, &blend.kind));
        let covers = [blend.sheen.is_some(), blend.coat.is_some()];
        lobes.extend(layer_twins(&blend.kind, (other, covers), cosines, v, weight));
    }
    let all_wide = !lobes.iter().any(|(is_narrow, _)| *is_narrow == Some(true));
    std::array::from_fn(|part| {
        std::array::from_fn(|c| {
            let belongs = |is_narrow: Option<bool>| is_narrow.is_some_and(|narrow| narrow || all_wide) == (part == 1);
            let of_part = lobes.iter().filter(|(is_narrow, _)| belongs(*is_narrow));
            of_part.fold(Dual::constant(0.0), |sum, (_, lobe)| sum + lobe[c])
        })
    })
}

/// The lobes of a layer that covers a share of the surface: the matte one, the model's, the sheen's and the coat's, with what sheen and coat do to
/// the others. Of each that does not always stand with the matte one it is said whether it is narrow.
#[allow(clippy::type_complexity)]
fn layer_twins<const N: usize>(
    kind: &MaterialKind,
    (brushed, [is_sheened, is_coated]): (Option<Dual<N>>, [bool; 2]),
    [ci, co, nh, ih]: [Dual<N>; 4],
    v: &[[Dual<N>; 3]],
    share: Dual<N>,
) -> Vec<(Option<bool>, [Dual<N>; 3])> {
    let [matte, lobe] = model_twins(kind, [ci, co, nh, ih], v);
    let lobe = brushed.map_or(lobe, |times| lobe.map(|x| x * times));
    let is_narrow = |alpha2: f64| alpha2 + 1e-7 < 0.04;
    let lobe_is_narrow = match kind {
        MaterialKind::Diffuse { .. } | MaterialKind::Cloth { .. } => false,
        MaterialKind::Phong { .. } => v[2][0].value < 0.04,
        MaterialKind::Conductor { .. } => is_narrow(v[1][0].value.powi(4)),
        _ => is_narrow(v[2][0].value.powi(4)),
    };
    let [weight, roughness, sheen_roughness] = v[COVERS];
    let grazing = if ci.value < co.value { ci } else { co };
    let passed = match is_coated {
        true => share * (1.0 - weight * (0.04 + 0.96 * twin_reflected(Some(grazing), roughness))),
        false => share,
    };
    let mut lobes = vec![(None, matte), (Some(lobe_is_narrow), lobe)];
    if is_sheened {
        let [i, o] = [ci, co].map(|c| twin_tabulated(&REFLECTED, Some(c), sheen_roughness));
        let most = if i.value > o.value { i } else { o };
        for lobe in lobes.iter_mut().map(|(_, lobe)| lobe) {
            *lobe = std::array::from_fn(|c| lobe[c] * (1.0 - v[SHEEN_COLOR][c] * most));
        }
        let sheen = twin_sheen(sheen_roughness, nh, ci, co);
        lobes.push((None, v[SHEEN_COLOR].map(|color| color * sheen)));
    }
    for lobe in lobes.iter_mut().map(|(_, lobe)| lobe) {
        *lobe = lobe.map(|x| x * passed);
    }
    if is_coated {
        let coat = share * weight * (0.04 + 0.96 * (1.0 - ih).powi(5)) * twin_ggx(roughness, nh, ci, co);
        lobes.push((Some(is_narrow(roughness.value.powi(4))), [coat; 3]));
    }
    lobes
}

/// The matte part and the lobe of a model, by the cosines of both directions and of the half vector with the normal, and of half the angle
/// between the directions.
fn model_twins<const N: usize>(
    kind: &MaterialKind,
    [ci, co, nh, ih]: [Dual<N>; 4],
    v: &[[Dual<N>; 3]],
) -> [[Dual<N>; 3]; 2] {
    let schlick = |f0: Dual<N>| f0 + (1.0 - f0) * (1.0 - ih).powi(5);
    let lambert = |rho: Dual<N>| rho * co / PI;
    let none = Dual::constant(0.0);
    let channels: [[Dual<N>; 2]; 3] = std::array::from_fn(|c| match kind {
        MaterialKind::Diffuse { .. } => [lambert(v[0][c]), none],
        MaterialKind::Conductor { .. } => [none, schlick(v[0][c]) * twin_ggx(v[1][0], nh, ci, co)],
        MaterialKind::ConductorIor { .. } => {
            [none, twin_conductor(ih, v[0][c], v[1][c]) * twin_ggx(v[2][0], nh, ci, co)]
        }
        MaterialKind::Phong { .. } => [lambert(v[0][c]), schlick(v[1][c]) * twin_phong(v[2][0], nh, ci, co)],
        MaterialKind::Principled { .. } => {
            let (base, metallic, specular) = (v[0][c], v[1][0], v[3][0]);
            let f90 = if specular.value < 0.25 { 4.0 * specular } else { Dual::constant(1.0) };
            let fresnel = |p: Dual<N>| {
                let dielectric = 0.08 * specular * (1.0 - p) + f90 * p;
                let metal = base * (1.0 - p) + p;
                (dielectric, dielectric * (1.0 - metallic) + metal * metallic)
            };
            let passed = |p: Dual<N>| 1.0 - fresnel(p).0;
            let reflected = |cos: Option<Dual<N>>| twin_reflected(cos, v[2][0]);
            let share = passed(reflected(Some(ci))) * passed(reflected(Some(co))) / passed(reflected(None));
            let lobe = fresnel((1.0 - ih).powi(5)).1 * twin_ggx(v[2][0], nh, ci, co);
            [lambert((1.0 - metallic) * base * share), lobe]
        }
        MaterialKind::Plastic { .. } => {
            let (rho, ior) = (v[0][c], v[1][0]);
            let f0 = ((ior - 1.0) / (ior + 1.0)).powi(2);
            let f90 = if f0.value < 0.02 { 50.0 * f0 } else { Dual::constant(1.0) };
            let reflected = |cos: Option<Dual<N>>| f0 + (f90 - f0) * twin_reflected(cos, v[2][0]);
            let inner = 1.0 - (1.0 - reflected(None)) / (ior * ior);
            let enters_and_leaves = (1.0 - reflected(Some(ci))) * (1.0 - reflected(Some(co))) / (ior * ior);
            let lobe = (f0 + (f90 - f0) * (1.0 - ih).powi(5)) * twin_ggx(v[2][0], nh, ci, co);
            [lambert(enters_and_leaves * rho / (1.0 - rho * inner)), lobe]
        }
        MaterialKind::Cloth { .. } => {
            let (rho, sheen) = (v[0][c], v[1][c]);
            let passed = |cos: Option<Dual<N>>| 1.0 - sheen * twin_tabulated(&REFLECTED, cos, v[2][0]);
            let share = passed(Some(ci)) * passed(Some(co)) / passed(None);
            [lambert(rho * share), sheen * twin_sheen(v[2][0], nh, ci, co)]
        }
        MaterialKind::Black
        | MaterialKind::Mirror { .. }
        | MaterialKind::Dielectric { .. }
        | MaterialKind::ThinDielectric { .. } => [none; 2],
    });
    std::array::from_fn(|part| channels.map(|c| c[part]))
}

fn twin(material: &Material, [ci, co, io, ti, bi, to, bo]: [D; SEEN], v: &[[D; 3]; MAX_INPUTS]) -> [D; 3] {
    let [matte, lobe] = twins(material, [ci, co, io], [[ti, bi], [to, bo]], v);
    std::array::from_fn(|c| matte[c] + lobe[c])
}

/// What a dielectric's lobe with Fresnel term (1 − wi·h)⁵ reflects at a cosine or on average, as the table has it.
fn twin_reflected<const N: usize>(cos: Option<Dual<N>>, roughness: Dual<N>) -> Dual<N> {
    twin_tabulated(&SCHLICK, cos, roughness)
}

fn twin_tabulated<const N: usize>(table: &AlbedoTable, cos: Option<Dual<N>>, roughness: Dual<N>) -> Dual<N> {
    let r = roughness.value as f32;
    match cos {
        Some(cos) => {
            let at = table.directional(cos.value as f32, r);
            let slopes =
                (cos - cos.value) * f64::from(at.by_c) + (roughness - roughness.value) * f64::from(at.by_roughness);
            slopes + f64::from(at.value)
        }
        None => {
            let mean = table.mean(r);
            (roughness - roughness.value) * f64::from(mean.by_roughness) + f64::from(mean.value)
        }
    }
}

fn tan2<const N: usize>(c: Dual<N>) -> Dual<N> {
    (1.0 - c * c) / (c * c)
}

/// D G / (4 ci) in tangents, as Walter et al. print it, with the α of a mirror added.
pub(crate) fn twin_ggx<const N: usize>(roughness: Dual<N>, nh: Dual<N>, ci: Dual<N>, co: Dual<N>) -> Dual<N> {
    let a2 = roughness.powi(4) + 1e-7;
    let d = a2 / (PI * nh.powi(4) * (a2 + tan2(nh)).powi(2));
    let g1 = |c: Dual<N>| 2.0 / (1.0 + (1.0 + a2 * tan2(c)).sqrt());
    d * g1(ci) * g1(co) / (4.0 * ci)
}

/// D G / (4 ci) in tangents, as Heitz prints it, with the widths of glTF; `grain` has the anisotropy and the turn.
fn twin_brush<const N: usize>(
    roughness: Dual<N>,
    grain: [Dual<N>; 3],
    [ci, co, nh, ih]: [Dual<N>; 4],
    along: [[Dual<N>; 2]; 2],
) -> Dual<N> {
    let across = (roughness.powi(4) + 1e-7).sqrt();
    let alphas = [across + (1.0 - across) * grain[0] * grain[0], across];
    let [wi, wo] =
        along.map(|[x, y]| [x * grain[1].cos() + y * grain[1].sin(), y * grain[1].cos() - x * grain[1].sin()]);
    let h: [Dual<N>; 2] = std::array::from_fn(|k| (wi[k] + wo[k]) / (2.0 * ih));
    let q = 1.0 + ((h[0] / alphas[0]).powi(2) + (h[1] / alphas[1]).powi(2)) / (nh * nh);
    let d = 1.0 / (PI * alphas[0] * alphas[1] * nh.powi(4) * q * q);
    let g1 = |[x, y]: [Dual<N>; 2], c: Dual<N>| {
        2.0 / (1.0 + (1.0 + ((alphas[0] * x).powi(2) + (alphas[1] * y).powi(2)) / (c * c)).sqrt())
    };
    d * g1(wi, ci) * g1(wo, co) / (4.0 * ci)
}

/// D G / (4 ci) with the exponents and the fit as Estevez & Kulla print them.
fn twin_sheen<const N: usize>(roughness: Dual<N>, nh: Dual<N>, ci: Dual<N>, co: Dual<N>) -> Dual<N> {
    let alpha = 0.07 + 0.93 * roughness * roughness;
    let sin = (1.0 - nh * nh).sqrt();
    let d = (2.0 + 1.0 / alpha) * sin.pow(1.0 / alpha) / TAU;
    let log_lambda = |x: Dual<N>| {
        let between = |at_0: f64, at_1: f64| (1.0 - alpha).powi(2) * at_0 + (1.0 - (1.0 - alpha).powi(2)) * at_1;
        let (a, b, c) = (between(25.3245, 21.5473), between(3.32435, 3.82987), between(0.16801, 0.19823));
        a / (1.0 + b * x.pow(c)) + between(-1.27393, -1.9776) * x + between(-4.85967, -4.32054)
    };
    let half = Dual::constant(0.5);
    let lambda = |c: Dual<N>| {
        let log = if c.value < 0.5 { log_lambda(c) } else { 2.0 * log_lambda(half) - log_lambda(1.0 - c) };
        log.exp()
    };
    d / (1.0 + lambda(ci) + lambda(co)) / (4.0 * ci)
}

fn twin_phong<const N: usize>(r: Dual<N>, nh: Dual<N>, ci: Dual<N>, co: Dual<N>) -> Dual<N> {
    let e = 2.0 / r - 2.0;
    let d = (e + 2.0) / TAU * nh.pow(e);
    let g1 = |c: Dual<N>| {
        let a = 1.0 / (r.sqrt() * tan2(c).sqrt());
        if a.value >= 1.6 {
            return Dual::constant(1.0);
        }
        (3.535 * a + 2.181 * a * a) / (1.0 + 2.276 * a + 2.577 * a * a)
    };
    d * g1(ci) * g1(co) / (4.0 * ci)
}

/// |r|² of the complex Fresnel equations, with complex numbers as pairs.
pub(crate) fn twin_conductor<const N: usize>(c: Dual<N>, eta: Dual<N>, k: Dual<N>) -> Dual<N> {
    let mul = |a: (Dual<N>, Dual<N>), b: (Dual<N>, Dual<N>)| (a.0 * b.0 - a.1 * b.1, a.0 * b.1 + a.1 * b.0);
    let square = |a: (Dual<N>, Dual<N>)| a.0 * a.0 + a.1 * a.1;
    let m = (eta, k);
    let m2 = mul(m, m);
    // n cos θt = √(m² − sin²)
    let (x, y) = (m2.0 - (1.0 - c * c), m2.1);
    let modulus = (x * x + y * y).sqrt();
    let t = (((modulus + x) / 2.0).sqrt(), ((modulus - x) / 2.0).sqrt());
    let rs = square((c - t.0, -t.1)) / square((c + t.0, t.1));
    let m2c = (m2.0 * c, m2.1 * c);
    let rp = square((m2c.0 - t.0, m2c.1 - t.1)) / square((m2c.0 + t.0, m2c.1 + t.1));
    (rs + rp) / 2.0
}

/// Derivatives of a function of what a twin sees in the three unit vectors, without what is along each. The axes turn with the normal, by the
/// smallest rotation.
fn d_vectors(by: [f64; SEEN], [n, wi, wo]: [DVec3; 3], [t, b]: [DVec3; 2]) -> [DVec3; 3] {
    let [by_ci, by_co, by_io, by_ti, by_bi, by_to, by_bo] = by;
    let (by_t, by_b) = (wi * by_ti + wo * by_to, wi * by_bi + wo * by_bo);
    let all = [
        (n, wi * by_ci + wo * by_co - t * n.dot(by_t) - b * n.dot(by_b)),
        (wi, n * by_ci + wo * by_io + t * by_ti + b * by_bi),
        (wo, n * by_co + wi * by_io + t * by_to + b * by_bo),
    ];
    all.map(|(v, d)| d - v * v.dot(d))
}

/// Directions about a random normal: `wi` in front of it, or now and then behind; `wo` within some widths of the mirror direction, or
/// anywhere.
fn directions(i: usize, width: f32, least: f32, rng: &mut Pcg32) -> [Vec3; 3] {
    let mut anywhere = || direction(least + (0.99 - least) * rng.next_f32(), std::f32::consts::TAU * rng.next_f32());
    let (wi, mut wo, axis) = (anywhere(), anywhere(), anywhere());
    if i.is_multiple_of(2) {
        wo = (Vec3::new(-wi.x, -wi.y, wi.z) + width * wo).normalize();
    }
    let wi = if i.is_multiple_of(5) { wi.with_z(-wi.z) } else { wi };
    let turn = Quat::from_axis_angle(axis, 7.0 * axis.x);
    [Vec3::Z, wi, wo].map(|v| (turn * v).normalize())
}

#[test]
fn value_and_adjoint_match_the_dual_number_twin() {
    let mut rng = Pcg32::new(21);
    for (material, values, bsdf) in bsdfs(&[0.0, 0.02, 0.05, 0.08, 0.2, 0.45, 0.9, 1.0]) {
        if matches!(material.kind, MaterialKind::Phong { .. }) && values[2].x == 1.0 {
            continue; // Its exponent is zero, where the twin's power has no derivative.
        }
        let alpha = bsdf.roughness_alpha().unwrap_or(1.0);
        // Across a grain a lobe is narrower than on the whole.
        let roughnesses = places(&material).into_iter().filter(|(field, ..)| field.name == "roughness");
        let across = roughnesses.map(|(_, place, _)| Ggx::new(values[place].x).alpha()).fold(alpha, f32::min);
        let alpha = if bsdf.has_grain() { across } else { alpha };
        for i in 0..240 {
            let vectors = directions(i, [0.1, alpha, 3.0 * alpha][i % 3], 0.03, &mut rng);
            let [n, wi, wo] = vectors;
            let d_f = Vec3::new(rng.next_f32() - 0.5, rng.next_f32(), rng.next_f32());

            let frame = Frame::from_normal(n);
            let bsdf = bsdf.laid([frame.tangent, frame.bitangent]);
            let exact = vectors.map(|v| v.as_dvec3().normalize());
            let axes = [frame.tangent, frame.bitangent].map(|v| v.as_dvec3());
            let cosines = [exact[0].dot(exact[1]), exact[0].dot(exact[2]), exact[1].dot(exact[2])];
            if cosines[1] < 0.02 {
                continue;
            }
            let variable = |x: f32, index: usize| D::variable(f64::from(x), index);
            let inputs = std::array::from_fn(|i| {
                std::array::from_fn(|c| match (&material.kind, i) {
                    // The least that a lobe has.
                    (MaterialKind::Phong { .. }, 2) => variable(values[i][c].max(1e-7), SEEN + 3 * i + c),
                    _ => variable(values[i][c], SEEN + 3 * i + c),
                })
            });
            let along: [f64; 4] = std::array::from_fn(|i| axes[i % 2].dot(exact[1 + i / 2]));
            let seen: [f64; SEEN] = std::array::from_fn(|i| if i < 3 { cosines[i] } else { along[i - 3] });
            let f = twin(&material, std::array::from_fn(|i| D::variable(seen[i], i)), &inputs);
            let expected = f[0] * f64::from(d_f.x) + f[1] * f64::from(d_f.y) + f[2] * f64::from(d_f.z);
            // The sine of the half vector, some α, is known to the rounding of the directions.
            let half = (0.5 + 0.5 * cosines[2]).sqrt().min(1.0).max(cosines[0].abs().min(cosines[1]));
            let rounding = 6e-7 / (f64::from(alpha) * half);

            let found = bsdf.eval(n, wi, wo);
            for c in 0..3 {
                let (a, b) = (f64::from(found[c]), f[c].value);
                assert!((a - b).abs() < (2e-3 + rounding) * b.abs() + 1e-6, "{bsdf:?} {vectors:?}: {a} {b}");
            }
            let adjoint = bsdf.d_eval(n, wi, wo, d_f);
            let by_vectors = d_vectors(std::array::from_fn(|i| expected.partials[i]), exact, axes);
            let ours = [adjoint.directions.n, adjoint.directions.wi, adjoint.directions.wo].map(Vec3::as_dvec3);
            let scale = by_vectors.iter().fold(0.0, |m: f64, v| m.max(v.length()));
            // On the ridge of a lobe that is narrow in one direction only there is no slope across it, but for the rounding of the directions.
            let size = (0..3).map(|c| (f64::from(d_f[c]) * f[c].value).abs()).sum::<f64>();
            let ridge = if bsdf.has_grain() { 4.0 * rounding * size / f64::from(alpha) } else { 0.0 };
            for (j, (a, b)) in ours.into_iter().zip(by_vectors).enumerate() {
                let a = a - exact[j] * exact[j].dot(a);
                let tolerance = (4e-3 + 4.0 * rounding) * scale + ridge + 1e-5;
                assert!((a - b).length() < tolerance, "{bsdf:?} {vectors:?}, vector {j}: {a} {b}");
            }
            let derivatives = adjoint.d_values.iter().flat_map(|v| v.to_array());
            for (j, (a, &b)) in derivatives.zip(&expected.partials[SEEN..]).enumerate() {
                // Those in a roughness change sign where the lobe does not: measure errors against the score's size.
                let roughness = field(&material, j / 3, j % 3).is_some_and(|field| field.name.ends_with("roughness"));
                // ∂ ln D is up to 4 over the roughness; only Phong's lobes go on narrowing where it is 0.
                let least =
                    if matches!(material.kind, MaterialKind::Phong { .. }) { MIN_PHONG_ROUGHNESS } else { 0.02 };
                let of_grain = field(&material, j / 3, j % 3).is_some_and(|field| [ANISOTROPY, TURN].contains(&field));
                let score = match (roughness, of_grain) {
                    (true, _) => 4.0 / f64::from(values[j / 3][j % 3].max(least)).min(1.0),
                    // ∂ ln D is up to 2 αx/αy.
                    (_, true) => 1.0 / f64::from(alpha),
                    _ => 1.0,
                };
                let tolerance = (4e-3 + 4.0 * rounding) * (b.abs() + score * expected.value.abs()) + 1e-5;
                assert!((f64::from(a) - b).abs() < tolerance, "{bsdf:?} {vectors:?}, input {j}: {a} {b}");
            }
        }
    }
}

#[test]
fn values_are_continuous_where_the_normal_turns_away() {
    let wo = direction(0.6, 1.0);
    for (_, _, bsdf) in bsdfs(&[0.3, 0.7]) {
        let at = |c: f32| {
            let wi = direction(c.abs(), 0.3);
            let wi = Vec3::new(wi.x, wi.y, c);
            bsdf.eval(Vec3::Z, wi, wo)
        };
        let (front, back) = (at(1e-4), at(-1e-4));
        assert!((front - back).length() < 1e-2 * front.length() + 1e-4, "{bsdf:?} {front} {back}");
        assert!(at(0.0).is_finite());
        assert_eq!(bsdf.eval(Vec3::Z, direction(0.5, 0.0), direction(-0.1, 1.0)), Vec3::ZERO);
    }
}

/// Calls `visit(wo, solid angle)` for a fine grid of the upper hemisphere, `rows` in cos θ.
fn integrate(rows: usize, columns: usize, mut visit: impl FnMut(Vec3, f64)) {
    let area = TAU / (rows * columns) as f64;
    for row in 0..rows {
        for column in 0..columns {
            let cos = (row as f32 + 0.5) / rows as f32;
            visit(direction(cos, (column as f32 + 0.5) / columns as f32 * TAU as f32), area);
        }
    }
}

/// Compares the numbers of samples in bins with those that a density expects, by chi². Bins with few expected samples are pooled.
pub(super) fn assert_as_frequent(expected: &[f64], found: &[f64], whose: &dyn std::fmt::Debug) {
    let (mut chi2, mut freedom, mut pool) = (0.0, -1.0f64, (0.0, 0.0));
    for (e, f) in expected.iter().zip(found) {
        if *e < 8.0 {
            pool = (pool.0 + e, pool.1 + f);
        } else {
            chi2 += (f - e).powi(2) / e;
            freedom += 1.0;
        }
    }
    if pool.0 > 1.0 {
        chi2 += (pool.1 - pool.0).powi(2) / pool.0;
        freedom += 1.0;
    }
    let limit = freedom + 5.0 * (2.0 * freedom).sqrt() + 5.0;
    assert!(chi2 < limit, "{whose:?}: chi² {chi2:.1} for {freedom} degrees of freedom");
}

#[test]
fn samples_follow_the_density() {
    const ROWS: usize = 12;
    const COLUMNS: usize = 16;
    const N: usize = 40_000;
    let bin = |wo: Vec3| {
        let phi = wo.y.atan2(wo.x) / std::f32::consts::TAU;
        let column = (((phi + 1.0).fract()) * COLUMNS as f32) as usize;
        ((wo.z * ROWS as f32) as usize).min(ROWS - 1) * COLUMNS + column.min(COLUMNS - 1)
    };
    let mut rng = Pcg32::new(31);
    for (_, _, bsdf) in bsdfs(&[0.35, 0.6, 1.0]) {
        for cos in [0.95, 0.6, 0.15, -0.4] {
            let wi = direction(cos, 0.7);
            // The last bin holds what is lost below the surface.
            let mut expected = vec![0.0; ROWS * COLUMNS + 1];
            integrate(ROWS * 16, COLUMNS * 16, |wo, area| {
                expected[bin(wo)] += f64::from(bsdf.pdf(Vec3::Z, wi, wo)) * area
            });
            let inside: f64 = expected.iter().sum();
            assert!(inside < 1.001, "{bsdf:?} at {cos}: density integrates to {inside}");
            expected[ROWS * COLUMNS] = (1.0 - inside).max(0.0);

            let mut found = vec![0.0; ROWS * COLUMNS + 1];
            for i in 0..N {
                match bsdf.sample(wi, rng.next_3d()) {
                    None => found[ROWS * COLUMNS] += 1.0,
                    Some(s) if i % 8 > 0 => found[bin(s.wo)] += 1.0,
                    Some(s) => {
                        found[bin(s.wo)] += 1.0;
                        assert!((s.pdf - bsdf.pdf(Vec3::Z, wi, s.wo)).abs() <= 1e-4 * s.pdf && !s.lobe.is_delta());
                        assert!(s.f.abs_diff_eq(bsdf.eval(Vec3::Z, wi, s.wo), 1e-4 * s.f.max_element()));
                    }
                }
            }
            assert_as_frequent(&expected.iter().map(|e| e * N as f64).collect::<Vec<_>>(), &found, &(bsdf, cos));
        }
    }
}

#[test]
fn narrow_lobes_average_to_their_quadrature() {
    // Reflected energy by sampling equals that by quadrature for lobes too narrow for bins.
    let mut rng = Pcg32::new(41);
    for (_, _, bsdf) in bsdfs(&[0.15, 0.25]) {
        let wi = direction(0.7, 0.0);
        let mut by_quadrature = Vec3::ZERO;
        integrate(700, 700, |wo, area| by_quadrature += bsdf.eval(Vec3::Z, wi, wo) * area as f32);
        let n = 40_000;
        let weight = |s: BsdfSample| s.f / s.pdf;
        let by_samples: Vec3 = (0..n).filter_map(|_| bsdf.sample(wi, rng.next_3d())).map(weight).sum::<Vec3>();
        let error = (by_samples / n as f32 - by_quadrature).length();
        assert!(error < 0.015 * by_quadrature.length(), "{bsdf:?}: {by_quadrature} {}", by_samples / n as f32);
    }
}

#[test]
fn values_are_reciprocal() {
    let mut rng = Pcg32::new(51);
    for (_, _, bsdf) in bsdfs(&[0.2, 0.6]) {
        for _ in 0..100 {
            let (a, b) = (direction(0.05 + 0.9 * rng.next_f32(), 0.0), direction(0.05 + 0.9 * rng.next_f32(), 2.5));
            let forth = bsdf.eval(Vec3::Z, a, b) / b.z;
            let back = bsdf.eval(Vec3::Z, b, a) / a.z;
            assert!((forth - back).length() < 1e-3 * forth.length(), "{bsdf:?} {forth} {back}");
        }
    }
}

#[test]
fn the_mirror_reflects_in_one_direction() {
    let tint = Vec3::new(0.9, 0.5, 0.1);
    let mirror = Bsdf::new(&MaterialKind::Mirror { reflectance: tint });
    let wi = Vec3::new(0.6, 0.0, 0.8);
    let si = SurfaceInteraction { bsdf: mirror, wi, ng: Vec3::Z, ns: Vec3::Z, ..SurfaceInteraction::NOWHERE };
    let sample = si.sample([0.3, 0.4, 0.5], 0.0).unwrap();
    assert!(sample.lobe == Lobe::SPECULAR && sample.f == tint && mirror.is_delta());
    assert!((sample.wo - Vec3::new(-0.6, 0.0, 0.8)).length() < 1e-6);
    assert_eq!(mirror.pdf(Vec3::Z, Vec3::Z, Vec3::Z), 0.0);
    assert_eq!(mirror.eval(Vec3::Z, Vec3::Z, Vec3::Z), Vec3::ZERO);
    assert_eq!(mirror.mirror_reflectance(), tint);
}

#[test]
fn absurd_inputs_give_numbers() {
    let absurd = [0.0, -3.0, 1e9, -1e9, 1e-30, 1.0];
    let mut rng = Pcg32::new(61);
    for kind in kinds() {
        for a in absurd {
            for b in absurd {
                let bsdf = looked_up(&kind, &std::array::from_fn(|i| Vec3::new([a, b][i % 2], b, a)));
                for cos in [1.0, 0.5, 1e-6, 0.0, -1.0] {
                    let wi = direction(f32::abs(cos), 0.0) * Vec3::new(1.0, 1.0, 1f32.copysign(cos));
                    if let Some(s) = bsdf.sample(wi, rng.next_3d()) {
                        assert!(s.pdf.is_finite() && s.pdf > 0.0 && s.wo.is_finite());
                    }
                    let wo = direction(0.3, 3.0);
                    let adjoint = bsdf.d_eval(Vec3::Z, wi, wo, Vec3::ONE);
                    assert!(bsdf.eval(Vec3::Z, wi, wo).is_finite(), "{bsdf:?} {wi}");
                    let by = adjoint.directions;
                    assert!(by.n.is_finite() && by.wi.is_finite() && by.wo.is_finite());
                    assert!(adjoint.d_values.iter().all(|v| v.is_finite()), "{bsdf:?} {wi} {adjoint:?}");
                }
            }
        }
    }
}

#[test]
fn albedo_adjoint_matches_differences() {
    for (kind, values, bsdf) in bsdfs(&[0.4]) {
        let d = Vec3::new(0.3, -0.8, 0.5);
        let gradient = bsdf.d_albedo(d);
        for i in 0..MAX_INPUTS {
            for c in 0..3 {
                let shifted = |h: f32| {
                    let mut values = values;
                    values[i][c] += h;
                    d.dot(looked_up(&kind, &values).albedo())
                };
                let fd = (shifted(1e-2) - shifted(-1e-2)) / 2e-2;
                assert!((fd - gradient[i][c]).abs() < 2e-3, "{kind:?} {i} {c}: {fd} {}", gradient[i][c]);
            }
        }
    }
}
