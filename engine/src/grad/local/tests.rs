mod twin;

use std::array::from_fn;

use glam::{DQuat, DVec3, Vec2};

use super::*;
use crate::grad::sink::{Layout, SparseSums};
use crate::math::{Dual, Pcg32};
use crate::mesh::Mesh;
use crate::render::accel::{Hit, Ray};
use crate::render::bsdf::Bsdf;
use crate::render::light::Arrival;
use crate::render::mask::MaskSampling;
use crate::render::sampler::Sampler;
use crate::render::scene::Cone;
use crate::render::texture::Texture;
use crate::render::{DeltaLight, Emission, Material, MaterialKind, Scene, SceneDescription, Shape, Slot};
use twin::*;

fn vertex(ns: Vec3, wi: Vec3, bsdf: Bsdf) -> SurfaceInteraction {
    SurfaceInteraction {
        prim: 0,
        shape: 0,
        b: [1.0, 0.0, 0.0],
        p: Vec3::ZERO,
        ng: ns,
        ns,
        flip: 1.0,
        shading_flip: 0.0,
        mapped: false,
        wi,
        bsdf,
        emission: Vec3::ZERO,
    }
}

/// D G / (4 ci) in double precision.
fn ggx(roughness: f64, ci: f64, co: f64, cos_h: f64) -> f64 {
    let a2 = roughness.powi(4);
    let tan2 = |c: f64| (1.0 - c * c) / (c * c);
    let d = a2 / (std::f64::consts::PI * cos_h.powi(4) * (a2 + tan2(cos_h)).powi(2));
    let g = |c: f64| 2.0 / (1.0 + (1.0 + a2 * tan2(c)).sqrt());
    d * g(ci) * g(co) / (4.0 * ci)
}

/// Attached lobes that reflect as a GGX lobe does.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Attached {
    Conductor,
    PaneReflects,
    PanePasses,
}

impl Attached {
    fn bsdf(self, roughness: f32) -> Bsdf {
        let roughness = Vec3::splat(roughness);
        Bsdf::new(&match self {
            Attached::Conductor => MaterialKind::Conductor { reflectance: Vec3::splat(0.8), roughness },
            _ => MaterialKind::ThinDielectric {
                ior: Vec3::splat(1.7),
                tint: Vec3::splat(0.6),
                roughness: Some(roughness),
            },
        })
    }

    /// What a facet reflects or lets through at a cosine.
    fn share(self, c: f64) -> f64 {
        if self == Attached::Conductor {
            return 0.8 + 0.2 * (1.0 - c).powi(5);
        }
        const INDEX: f64 = 1.7;
        let s = (1.0 - (1.0 - c * c) / (INDEX * INDEX)).sqrt();
        let (rs, rp) = ((c - INDEX * s) / (c + INDEX * s), (INDEX * c - s) / (INDEX * c + s));
        let face = 0.5 * (rs * rs + rp * rp);
        let reflected = 2.0 * face / (1.0 + face);
        if self == Attached::PanePasses { 0.6 * (1.0 - reflected) } else { reflected }
    }

    /// The integrand in the half vector's measure, with a radiance that changes with direction.
    fn integrand(self, roughness: f64, [ns, wi, h, gradient]: [DVec3; 4]) -> f64 {
        let ci = ns.dot(wi);
        let front = if ci < 0.0 { wi - ns * (2.0 * ci) } else { wi };
        let half = h.dot(front);
        let reflected = h * (2.0 * half) - front;
        let co = ns.dot(reflected);
        let wo = if self == Attached::PanePasses { reflected - ns * (2.0 * co) } else { reflected };
        self.share(half) * ggx(roughness, ci.abs(), co, ns.dot(h)) * half * (1.0 + gradient.dot(wo))
    }
}

#[test]
fn attached_lobes_follow_their_surface() {
    let mut rng = Pcg32::new(5);
    let mut unit = || (Vec3::from_array(rng.next_3d()) * 2.0 - 1.0).normalize();
    let mut checked = [0; 3];
    for i in 0..1800 {
        let roughness = [0.44f32, 0.35, 0.2][i % 3];
        let lobe = [Attached::Conductor, Attached::PaneReflects, Attached::PanePasses][i / 3 % 3];
        let bsdf = lobe.bsdf(roughness);
        assert!(bsdf.is_attached());
        let (ns, wi, gradient) = (unit(), unit(), unit());
        let h = (ns + roughness * roughness * unit()).normalize();
        let ci = ns.dot(wi);
        let front = if ci < 0.0 { wi - ns * (2.0 * ci) } else { wi };
        let half = h.dot(front);
        let mut wo = h * (2.0 * half) - front;
        let co = ns.dot(wo);
        if ci.abs() < 0.2 || co < 0.2 {
            continue;
        }
        if lobe == Attached::PanePasses {
            wo -= ns * (2.0 * co);
        }
        checked[lobe as usize] += 1;
        let mut adj = VertexAdjoint::default();
        let si = vertex(ns, wi, bsdf);
        let f = si.eval_part(Part::Specular, wo).x;
        d_eval_attached(&si, wo, Vec3::X * (1.0 + gradient.dot(wo)), gradient * f, &mut adj);
        // With respect to a rotation of the incoming direction, and to the smallest one that takes the normal along.
        let at = [ns, wi, h, gradient].map(Vec3::as_dvec3);
        let allowed = 0.005 * (f64::from(f) + f64::from(adj.wi.length() + adj.ns.length()));
        for axis in Vec3::AXES {
            let step = 1e-5;
            let difference = |axis: DVec3, turned: [bool; 4]| {
                let value = |angle: f64| {
                    let q = DQuat::from_axis_angle(axis, angle);
                    let v = std::array::from_fn(|i| if turned[i] { q * at[i] } else { at[i] });
                    lobe.integrand(f64::from(roughness), v)
                };
                (value(step) - value(-step)) / (2.0 * step * f64::from(half))
            };
            let by_wi = difference(axis.as_dvec3(), [false, true, false, false]);
            let expected = f64::from(adj.wi.dot(axis.cross(wi)));
            assert!((by_wi - expected).abs() < allowed, "{lobe:?}, wi: {by_wi} {expected} {roughness}");
            let Some(turn) = (axis - ns * ns.dot(axis)).try_normalize() else { continue };
            let by_n = difference(turn.as_dvec3().normalize(), [true, false, true, false]);
            let expected = f64::from(adj.ns.dot(turn.cross(ns)));
            assert!((by_n - expected).abs() < allowed, "{lobe:?}, n: {by_n} {expected} {roughness}");
        }
    }
    assert!(checked.iter().all(|n| *n > 200), "{checked:?}");
}

fn assert_alike(what: &str, found: &[f64], expected: &[f64]) {
    let scale = expected.iter().fold(0.0, |m: f64, x| m.max(x.abs()));
    for (i, (a, b)) in found.iter().zip(expected).enumerate() {
        assert!((a - b).abs() <= 1e-3 * scale + 1e-6, "{what}, {i}: {a} for {b} of {scale}");
    }
    assert_eq!(found.len(), expected.len());
}

fn numbers(vectors: &[Vec3]) -> Vec<f64> {
    vectors.iter().flat_map(|v| v.to_array()).map(f64::from).collect()
}

/// A matte triangle, which shines with a radiance of 5 if it is a light.
fn triangle(corners: [Vec3; 3], light: bool) -> SceneDescription {
    let textures = vec![Texture::constant(Vec3::splat(0.6)), Texture::constant(Vec3::splat(5.0))];
    let kind = MaterialKind::Diffuse { reflectance: Input::Texture(0) };
    let emission = light.then_some(Emission { radiance: Input::Texture(1), two_sided: true });
    let mesh = Mesh { vertices: corners.to_vec(), faces: vec![[0, 1, 2]], ..Default::default() };
    let shapes = vec![Shape { mesh, material: Material::from(kind), emission }];
    SceneDescription { shapes, textures, ..Default::default() }
}

/// Where a ray meets a triangle: the position, the barycentric coordinates, both normals and the place in the texture, as all
/// that the triangle has and the ray move.
#[test]
fn sliding_matches_the_dual_number_twin() {
    let mut rng = Pcg32::new(11);
    let mut random = || Vec3::from_array(rng.next_3d()) * 2.0 - 1.0;
    let mut checked = 0;
    for _ in 0..200 {
        let corners: [Vec3; 3] = std::array::from_fn(|_| random());
        let (origin, [d_p, d_ng, d_ns, d_b, d_uv, inside]) =
            (3.0 * random().normalize(), std::array::from_fn(|_| random()));
        let inside = inside.abs() / inside.abs().element_sum();
        let target = corners[0] * inside.x + corners[1] * inside.y + corners[2] * inside.z;
        let dir = (target - origin).normalize();
        let face = (corners[1] - corners[0]).cross(corners[2] - corners[0]).normalize();
        let normals: [Vec3; 3] = std::array::from_fn(|_| (face + 0.4 * random()).normalize());
        let uvs: [Vec2; 3] = std::array::from_fn(|_| random().truncate());
        let mut description = triangle(corners, false);
        description.shapes[0].mesh.normals = Some(normals.to_vec());
        description.shapes[0].mesh.uvs = Some(uvs.to_vec());
        let scene = Scene::new(description).unwrap();
        let Some(hit) = scene.accel.closest(&Ray::new(origin, dir), &[]) else { continue };
        let si = scene.interaction(0, hit.b, -dir);
        if si.ng.dot(dir).abs() < 0.1 {
            continue;
        }
        checked += 1;
        let layout = Layout::new(&scene, &[Slot::Vertices(0), Slot::Normals(0), Slot::Uvs(0)]);
        let mut sums = SparseSums::new(layout.size());
        let mut out = Adjoints::new(&scene, &layout, &mut sums);
        let mut adj = VertexAdjoint { p: d_p, ng: d_ng, ns: d_ns, b: d_b.to_array(), ..Default::default() };
        adj.add_b(out.uv(si.prim, si.b, d_uv.truncate()));
        let ray = d_intersection(&mut out, &si, hit.t, adj);

        let p: [Twin<30>; 3] = std::array::from_fn(|i| variables(corners[i], 3 * i));
        let m: [Twin<30>; 3] = std::array::from_fn(|i| variables(normals[i], 9 + 3 * i));
        let uv = |i: usize, axis: usize| Dual::variable(f64::from(uvs[i][axis]), 18 + 2 * i + axis);
        let (o, d) = (variables(origin, 24), variables(dir, 27));
        let n = cross(minus(p[1], p[0]), minus(p[2], p[0]));
        let t = dot(n, minus(p[0], o)) / dot(n, d);
        let x: Twin<30> = std::array::from_fn(|i| o[i] + t * d[i]);
        let b: Twin<30> = std::array::from_fn(|i| {
            let (next, last) = (p[(i + 1) % 3], p[(i + 2) % 3]);
            dot(n, cross(minus(last, next), minus(x, next))) / dot(n, n)
        });
        let between = |of: &dyn Fn(usize) -> Dual<30>| b[0] * of(0) + b[1] * of(1) + b[2] * of(2);
        let normal = times(unit(n), Dual::constant(f64::from(si.flip)));
        let smooth: Twin<30> = unit(std::array::from_fn(|axis| between(&|i| m[i][axis])));
        let side = dot(smooth, constants(si.ns)).value.signum();
        let mut loss = dot(x, constants(d_p)) + dot(normal, constants(d_ng)) + dot(b, constants(d_b));
        loss = loss + dot(smooth, constants(d_ns)) * side;
        for axis in 0..2 {
            loss = loss + between(&|i| uv(i, axis)) * f64::from(d_uv[axis]);
        }
        let found = [dense(sums, layout.size()), numbers(&[ray.origin, ray.dir])].concat();
        assert_alike("slide", &found, &loss.partials);
    }
    assert!(checked > 100, "{checked}");
}

/// A matte point in the light of a triangle, of a point and of a direction, as both move and the surface turns.
#[test]
fn arriving_light_matches_the_dual_number_twin() {
    let mut rng = Pcg32::new(12);
    let mut random = || Vec3::from_array(rng.next_3d()) * 2.0 - 1.0;
    let mut checked = [0; 3];
    for i in 0..600 {
        let corners: [Vec3; 3] = std::array::from_fn(|_| random());
        let (x, ns, a) = (3.0 * random().normalize(), random().normalize(), random());
        let mut description = triangle(corners, i % 3 == 0);
        match i % 3 {
            1 => description.delta_lights.push(DeltaLight::Point { position: corners[0], intensity: a.abs() }),
            2 => description.delta_lights.push(DeltaLight::Directional { direction: corners[0], irradiance: a.abs() }),
            _ => {}
        }
        let slot = if i % 3 == 0 { Slot::Vertices(0) } else { Slot::LightPlacement(0) };
        let scene = Scene::new(description).unwrap();
        let mut light = scene.sample_light(Vec2::new(0.3, 0.6)).unwrap();
        let Some(arrival) = scene.arrive(&mut light, x) else { continue };
        let si = SurfaceInteraction { p: x, ..vertex(ns, ns, Bsdf::Diffuse { reflectance: Vec3::splat(0.6) }) };
        let f = si.eval(arrival.dir);
        if ns.dot(arrival.dir) < 0.05 || light.n.dot(arrival.dir).abs() < 0.05 && i % 3 == 0 {
            continue;
        }
        checked[i % 3] += 1;
        let layout = Layout::new(&scene, &[slot]);
        let mut sums = SparseSums::new(layout.size());
        let mut out = Adjoints::new(&scene, &layout, &mut sums);
        let incident = IncidentLight {
            light: &light,
            dir: arrival.dir,
            distance: arrival.distance,
            geometry: arrival.geometry,
            weight: 0.7,
            masks: Masks { crossings: &[], weight: 0.7 },
        };
        let mut adj = VertexAdjoint::default();
        d_material_fixed(&mut out, &si, &incident, Scattering { f, part: None, a }, &mut adj);

        let (at, normal): (Twin<15>, Twin<15>) = (variables(x, 9), variables(ns, 12));
        let power = 0.7 * 0.6 * f64::from(a.dot(light.power)) / std::f64::consts::PI;
        let p: [Twin<15>; 3] = std::array::from_fn(|k| variables(corners[k], 3 * k));
        let value = match i % 3 {
            0 => {
                let b = light.b.map(f64::from);
                let y: Twin<15> = std::array::from_fn(|k| p[0][k] * b[0] + p[1][k] * b[1] + p[2][k] * b[2]);
                let n = cross(minus(p[1], p[0]), minus(p[2], p[0]));
                let (to, double_area) = (minus(y, at), dot(n, n).sqrt());
                let (dir, r2) = (unit(to), dot(to, to));
                // |cos| / r² dA, of a light of today's area.
                dot(normal, dir) * dot(n, dir).abs() / r2 * (power / double_area.value)
            }
            1 => {
                let to = minus(p[0], at);
                dot(normal, unit(to)) / dot(to, to) * power
            }
            _ => dot(normal, unit(p[0])) * -power,
        };
        let found = [dense(sums, layout.size()), numbers(&[adj.p, adj.ns])].concat();
        let moves = if i % 3 == 0 { 9 } else { 3 };
        let expected = [&value.partials[..moves], &value.partials[9..]].concat();
        assert_alike(["area", "point", "directional"][i % 3], &found, &expected);
    }
    assert!(checked.iter().all(|n| *n > 40), "{checked:?}");
}

/// A ray that finds a triangle, and how both move.
struct CameraHit {
    si: SurfaceInteraction,
    t: f32,
    ray: Ray,
    moves: [Vec3; 2],
}

impl CameraHit {
    /// Of a triangle with these corners, if it is not too grazing and nothing is a sliver, whose normal has too few digits.
    fn new(rng: &mut Pcg32, scene: &Scene, corners: [Vec3; 3]) -> Option<CameraHit> {
        let b = Vec3::from(rng.next_3d());
        let target = (corners[0] * b.x + corners[1] * b.y + corners[2] * b.z) / b.element_sum();
        let origin = target + 2.0 * anywhere(rng).normalize();
        let ray = Ray::new(origin, (target - origin).normalize());
        let others: Vec<PrimId> = (1..scene.prims.len() as PrimId).collect();
        let Hit { prim, b, t } = scene.accel.closest(&ray, &others)?;
        let si = scene.interaction(prim, b, -ray.dir);
        let stout = |[a, b, c]: [Vec3; 3]| {
            let longest = (b - a).length_squared().max((c - a).length_squared()).max((c - b).length_squared());
            (b - a).cross(c - a).length() > 0.1 * longest
        };
        let stout = scene.facets.iter().all(|facet| stout(facet.corners));
        let clear = stout && si.ng.dot(si.wi) > STEEP && si.ns.dot(si.wi).abs() > STEEP;
        // Directions remain of unit length.
        let turn = ray.dir.cross(anywhere(rng));
        clear.then(|| CameraHit { si, t, ray, moves: [anywhere(rng), turn] })
    }

    fn line(&self) -> [Vector; 2] {
        [vector(self.ray.origin, self.moves[0]), vector(self.ray.dir, self.moves[1])]
    }

    fn terms(&self, ray: RayAdjoint) -> [(Vec3, Vec3); 2] {
        [(ray.origin, self.moves[0]), (ray.dir, self.moves[1])]
    }
}

/// Cosine below which a line is grazing: what is divided by it has too few digits.
const STEEP: f32 = 0.15;

/// The masks that a ray passes, unless one is met at a grazing angle.
fn masks(scene: &Scene, ray: &Ray, skip: &[PrimId]) -> Option<(Vec<MaskCrossing>, f32)> {
    let mut crossings = Vec::new();
    let pass = scene.unoccluded(ray, None, skip, MaskSampling::Opacity, |c| crossings.push(c))?;
    let steep = |c: &MaskCrossing| scene.facets[c.prim as usize].normal.dot(ray.dir).abs() > STEEP;
    crossings.iter().all(steep).then_some((crossings, pass))
}

const KINDS: [&str; 8] = ["area", "touching", "point", "spot", "directional", "sky", "sky with a base", "goniometric"];

/// The light of scene number `i`, which stands about `at` or touches a triangle with these corners.
fn add_light(rng: &mut Pcg32, builder: &mut Builder, i: usize, (corners, at): ([Vec3; 3], Vec3)) {
    let kind = i % KINDS.len();
    let power = 1.0 + 0.5 * anywhere(rng);
    match kind {
        0 | 1 => {
            let mut vertices = from_fn(|_| at + anywhere(rng));
            if kind == 1 {
                vertices[0] = corners[i % 3];
            }
            builder.light(rng, vertices, MaterialKind::Black.into());
        }
        5 | 6 => builder.sky(rng, !i.is_multiple_of(3)),
        _ => {
            let beam = 0.5 * rng.next_f32();
            let cone = Cone { axis: -at + anywhere(rng), beam, cutoff: beam + 0.3 + 0.5 * rng.next_f32() };
            let light = match kind {
                2 => DeltaLight::Point { position: at, intensity: power },
                3 => {
                    // Every second one has a profile.
                    let profile = (i / KINDS.len()).is_multiple_of(2).then(|| builder.spherical_map(rng, true));
                    DeltaLight::Spot { position: at, intensity: power, cone, profile }
                }
                7 => DeltaLight::Goniometric {
                    position: at,
                    intensity: power,
                    profile: builder.spherical_map(rng, true),
                },
                _ => DeltaLight::Directional { direction: -at, irradiance: power },
            };
            builder.description.delta_lights.push(light);
        }
    }
}

/// Whether light shows what is special about its kind: surfaces that touch, the soft border of a spot, a profile that differs from direction to
/// direction, a sun in the sky. `None` where derivatives are too steep to be compared.
fn is_special(moving: &Moving, light: &LightSample, Arrival { dir, distance, .. }: &Arrival) -> Option<bool> {
    let scene = &moving.scene;
    // At the poles of a map, neighbouring rows of texels meet.
    let at_pole = |y: f64| y.abs() > 0.98;
    Some(match light.kind {
        LightKind::Area if light.n.dot(*dir).abs() < STEEP || *distance < 0.2 => return None,
        LightKind::Area => scene.touch(0, light.prim),
        LightKind::Point(i) => match (light.cone, scene.description.delta_lights[i as usize].profile()) {
            (_, Some(map)) if at_pole(f64::from((map.rotation.transpose() * *dir).y)) => return None,
            (Some(cone), _) => match cone.falloff(-*dir).value {
                falloff if falloff < 0.01 => return None,
                falloff => falloff < 1.0,
            },
            (_, Some(map)) => !scene.description.textures[map.texels].is_constant(),
            _ => false,
        },
        LightKind::Directional(_) => true,
        LightKind::Environment if at_pole(moving.in_map(constants(*dir))[1].value) => return None,
        LightKind::Environment => scene.environment_peak.is_some(),
    })
}

/// Light of all kinds that is reflected, through masks, at a point that is seen along a ray: matte or shiny, smooth or flat, by
/// textures, as everything there is moves.
#[test]
fn reflected_light_matches_the_dual_number_twin() {
    let mut rng = Pcg32::new(22);
    let rng = &mut rng;
    // By kind: all, through masks, with an attached lobe, and with what is special about the kind.
    let mut checked = [[0; 4]; KINDS.len()];
    for i in 0..32_000 {
        let kind = i % KINDS.len();
        let mut builder = Builder::default();
        let material = builder.material_or_blend(rng);
        let corners = from_fn(|_| anywhere(rng));
        builder.shape(rng, corners, material.clone());
        let at = 3.0 * anywhere(rng).normalize();
        add_light(rng, &mut builder, i, (corners, at));
        for _ in 0..rng.next_u32() % 3 {
            let vertices = from_fn(|_| 0.5 * at + 3.0 * anywhere(rng));
            builder.mask(rng, vertices);
        }
        let moving = Moving::new(rng, builder.description);
        let scene = &moving.scene;
        let Some(hit) = CameraHit::new(rng, scene, corners) else { continue };
        let (si, line) = (&hit.si, hit.line());
        let mut light = scene.sample_light(Vec2::from(rng.next_2d())).unwrap();
        let Some(arrival) = scene.arrive(&mut light, si.p) else { continue };
        let dir = arrival.dir;
        let Some((crossings, pass)) = masks(scene, &si.spawn_ray_to(dir, arrival.distance), &[0, light.prim]) else {
            continue;
        };
        let clear = si.ns.dot(dir) > STEEP && si.ng.dot(dir) > STEEP;
        let Some(special) = is_special(&moving, &light, &arrival) else { continue };
        if !clear {
            continue;
        }
        let attached = si.bsdf.is_attached();
        let also = [true, !crossings.is_empty(), attached, special];
        checked[kind].iter_mut().zip(also).for_each(|(n, also)| *n += i32::from(also));

        let (a, w) = (0.6 + 0.4 * anywhere(rng), 0.7);
        let incident = IncidentLight {
            light: &light,
            dir,
            distance: arrival.distance,
            geometry: arrival.geometry,
            weight: w * pass,
            masks: Masks { crossings: &crossings, weight: w },
        };
        let environment = if kind == 6 { MovingEnvironment::Peak } else { MovingEnvironment::Whole };
        let (mut sums, mut adj) = (moving.sums(), VertexAdjoint::default());
        let mut out = moving.adjoints(&mut sums);
        let d_values = d_incident(&mut out, si, &incident, a, false, environment, &mut adj);
        d_inputs(&mut out, si, &d_values, &mut adj);
        let ray = d_intersection(&mut out, si, hit.t, adj);
        let value = a.dot(si.eval(dir) * light.power) * (arrival.geometry * w * pass);

        let v = moving.vertex(si, line);
        let through = |part: Option<Part>, dir: Vector, power: Vector| {
            let f = product(v.scattered(&material, part, dir), power);
            dot(f, constants(a)) * moving.pass(&crossings, [v.p, dir]) * f64::from(w)
        };
        let (towards, geometry, power) = moving.arriving(&light, v.p);
        let (fixed, now) = (constants(dir), f64::from(arrival.geometry));
        let mut twin = if light.is_delta() {
            through(None, towards, power) * geometry
        } else {
            let part = attached.then_some(Part::Diffuse);
            match light.kind {
                LightKind::Area if special => through(part, fixed, moving.found(&light, [v.p, fixed])) * now,
                LightKind::Environment if kind == 6 => {
                    let base = moving.base(still(moving.in_map(fixed)));
                    through(part, towards, minus(power, base)) + through(part, fixed, moving.base(moving.in_map(fixed)))
                }
                _ => through(part, towards, power) * geometry,
            }
        };
        if attached && !light.is_delta() {
            let (turning, density) = v.attached(dir);
            let found = moving.found(&light, [v.p, turning]);
            twin = twin + through(Some(Part::Specular), turning, found) * density * now;
        }
        let what = || format!("{}, {:?}", KINDS[kind], si.bsdf);
        moving.assert_alike(&what, value, sums, &hit.terms(ray), twin);
    }
    let ordinary = |kind: usize| matches!(KINDS[kind], "area" | "point");
    let enough = |kind: usize| checked[kind][..4 - usize::from(ordinary(kind))].iter().all(|n| *n > 30);
    assert!((0..KINDS.len()).all(enough), "{checked:?}");
}

/// What a mirror shows of a sky, and what an attached direction does, both through masks: mirrored directions that are folded
/// up at the face among them.
#[test]
fn directions_that_turn_with_a_normal_match_the_dual_number_twin() {
    let mut rng = Pcg32::new(22);
    let rng = &mut rng;
    let (mut folded, mut mirrored, mut attached, mut masked) = (0, 0, 0, 0);
    for i in 0..4000 {
        let mut builder = Builder::default();
        let corners = from_fn(|_| anywhere(rng));
        builder.shape(rng, corners, MaterialKind::Mirror { reflectance: Input::VertexColor }.into());
        builder.sky(rng, false);
        for _ in 0..rng.next_u32() % 3 {
            let vertices = from_fn(|_| 4.0 * anywhere(rng));
            builder.mask(rng, vertices);
        }
        let moving = Moving::new(rng, builder.description);
        let scene = &moving.scene;
        let Some(hit) = CameraHit::new(rng, scene, corners) else { continue };
        let si = &hit.si;
        let v = moving.vertex(si, hit.line());
        let (dir, turning) = if i % 2 == 0 {
            (si.mirrored(), v.mirrored())
        } else {
            let ci = si.ns.dot(si.wi);
            let (h, front) = ((si.ns + 0.5 * anywhere(rng)).normalize(), si.wi - si.ns * (ci - ci.abs()));
            let dir = h * (2.0 * h.dot(front)) - front;
            (dir, (v.attached(dir).0, false))
        };
        // Rounding must not tell on which side of the fold it is.
        let unfolded = si.ns * (2.0 * si.ns.dot(si.wi)) - si.wi;
        let clear = moving.in_map(constants(dir))[1].value.abs() < 0.98 && si.ng.dot(unfolded).abs() > 1e-3;
        let Some((crossings, pass)) = masks(scene, &si.spawn_ray(dir), &[0]).filter(|_| clear) else { continue };
        folded += i32::from(turning.1);
        mirrored += i32::from(i % 2 == 0);
        attached += i32::from(i % 2 == 1);
        masked += i32::from(!crossings.is_empty());

        let a = 0.6 + 0.4 * anywhere(rng);
        let radiance = scene.environment_radiance(dir);
        let (mut sums, mut adj) = (moving.sums(), VertexAdjoint::default());
        let mut out = moving.adjoints(&mut sums);
        let beyond = d_masks(&mut out, dir, &crossings, a.dot(radiance));
        let d_dir = beyond.dir + out.environment(dir, a * pass);
        adj.p += beyond.origin;
        if i % 2 == 0 {
            d_mirrored(si, d_dir, &mut adj);
        } else {
            d_attached_direction(&mut out, si, dir, d_dir, &mut adj);
        }
        let ray = d_intersection(&mut out, si, hit.t, adj);
        let seen = moving.radiance(moving.in_map(turning.0));
        let twin = dot(seen, constants(a)) * moving.pass(&crossings, [v.p, turning.0]);
        moving.assert_alike(
            &|| ["mirrored", "attached"][i % 2].to_owned(),
            a.dot(radiance) * pass,
            sums,
            &hit.terms(ray),
            twin,
        );
    }
    assert!([folded, mirrored, attached, masked].iter().all(|n| *n > 40), "{folded} {mirrored} {attached} {masked}");
}

/// What a camera's ray finds first, by a toss at every mask: emission and all other channels.
#[test]
fn first_hits_match_the_dual_number_twin() {
    const OUTPUTS: [Output; 8] = [
        Output::Radiance,
        Output::Depth,
        Output::Alpha,
        Output::Position,
        Output::Normal,
        Output::GeometricNormal,
        Output::Albedo,
        Output::Uv,
    ];
    let mut rng = Pcg32::new(23);
    let rng = &mut rng;
    // By output: all, through masks, of a mask.
    let mut checked = [[0; 3]; OUTPUTS.len()];
    for i in 0..12_000 {
        let output = OUTPUTS[i % OUTPUTS.len()];
        let mut builder = Builder::default();
        let first = from_fn(|_| anywhere(rng));
        for k in 0..5 {
            let material = builder.material_or_blend(rng);
            let vertices = if k == 0 { first } else { from_fn(|_| 2.0 * anywhere(rng)) };
            builder.light(rng, vertices, material);
        }
        let moving = Moving::new(rng, builder.description);
        let scene = &moving.scene;
        let Some(hit) = CameraHit::new(rng, scene, first) else { continue };
        let mut crossings = Vec::new();
        let mut sampler = Sampler::new(5, i as u64);
        let found =
            scene.sample_interaction(&hit.ray, &[], &mut sampler, MaskSampling::BothSides, |c| crossings.push(c));
        let (Some((si, t)), through) = found else { continue };
        let steep = |prim: PrimId| scene.facets[prim as usize].normal.dot(hit.ray.dir).abs() > STEEP;
        if !(steep(si.prim) && crossings.iter().all(|c| steep(c.prim))) {
            continue;
        }
        let masked = scene.description.shapes[si.prim as usize].material.opacity.is_some();
        let also = [true, !crossings.is_empty(), masked];
        checked[i % OUTPUTS.len()].iter_mut().zip(also).for_each(|(n, also)| *n += i32::from(also));

        let (origin, frame) = (4.0 * anywhere(rng), from_fn(|_| anywhere(rng)));
        let camera = Camera { origin, frame, ..Camera::look_at(Vec3::ZERO, Vec3::Z, Vec3::Y, 1.0, [1, 1]) };
        let moves: [Vec3; 3] = from_fn(|_| anywhere(rng));
        let d = anywhere(rng);
        let mut sums = moving.sums();
        let mut out = moving.adjoints(&mut sums);
        let (channel, ray) = if output == Output::Radiance {
            let mut adj = VertexAdjoint::default();
            d_emission_sliding(&mut out, &si, d * through.weight, &mut adj);
            d_opacity(&mut out, &si, d.dot(si.emission) * through.pass * through.inv_choice, &mut adj);
            (si.emission, d_intersection(&mut out, &si, t, adj))
        } else {
            let ray = d_first_hit(&mut out, output, &camera, (&si, t), &through, d);
            (first_hit(scene, output, &camera, &si), ray)
        };
        let d_pass = d.dot(channel) * (through.opacity * through.inv_choice);
        let ray = ray + d_masks(&mut out, hit.ray.dir, &crossings, d_pass);

        let v = moving.vertex(&si, hit.line());
        let first_of = |x: Number| [x, Dual::constant(0.0), Dual::constant(0.0)];
        let [right, up, forward] = camera.frame;
        let side = f64::from(right.cross(up).dot(forward).signum());
        let axis = unit(times(cross(vector(right, moves[1]), vector(up, moves[2])), Dual::constant(side)));
        let eye = vector(camera.origin, moves[0]);
        let emission = scene.description.shapes[si.prim as usize].emission.as_ref().unwrap();
        let twin = match output {
            Output::Radiance => moving.lookup(emission.radiance, si.prim, v.b),
            Output::Depth => first_of(dot(axis, minus(v.p, eye))),
            Output::Position => v.p,
            Output::Normal => v.ns,
            Output::GeometricNormal => v.ng,
            Output::Albedo => v.albedo(&scene.description.shapes[si.prim as usize].material),
            Output::Uv => {
                let [x, y] = moving.uv(si.prim, v.b);
                [x, y, Dual::constant(0.0)]
            }
            _ => first_of(Dual::constant(1.0)),
        };
        let stops = moving.opacity(si.prim, v.b) * f64::from(through.inv_choice);
        let twin = dot(twin, constants(d)) * stops * moving.pass(&crossings, hit.line());
        let [by_origin, by_dir] = hit.terms(ray);
        let others = [
            by_origin,
            by_dir,
            (out.camera.origin, moves[0]),
            (out.camera.frame[0], moves[1]),
            (out.camera.frame[1], moves[2]),
        ];
        let value = d.dot(channel) * through.weight;
        moving.assert_alike(&|| format!("{output:?}"), value, sums, &others, twin);
    }
    assert!(checked.iter().flatten().all(|n| *n > 30), "{checked:?}");
}
