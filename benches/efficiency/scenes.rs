//! The benchmark's scenes: each is a function of one number θ, to be differentiated at 0.
//!
//! The loss is linear: the mean over pixels and channels of image × ramp, a ramp of (column + ½) / width or of rows.

use std::f32::consts::PI;

use dscene::mesh::{Mesh, ops, shapes};
use dscene::render::texture::{Filter, Texture, Wrap};
use dscene::render::{
    Camera, ClearCoat, DeltaLight, Emission, Input, Material, MaterialKind, Method, Output, PixelFilter, Projection,
    SceneDescription, Shape, SphericalMap,
};
use glam::{DVec3, Mat3, Vec3, vec3};

use crate::closed::{grey, intersection, moment, outline};
use crate::common::{Builder, Pieces as _, ceiling, cuboid, floor, mesh, quad};

/// Width and height of all images.
pub const SIZE: usize = 256;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ramp {
    X,
    Y,
}

/// What a row of the table stands for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    Silhouette,
    SmallLight,
    SoftShadow,
    EnvironmentShadow,
    Glossy,
    Cornell,
    Material,
    Glass,
    /// Coats and normal maps.
    Layers,
    /// Receivers, creases, seams, cameras, lights, mirrors, channels.
    Special,
}

impl Kind {
    pub fn name(self) -> &'static str {
        match self {
            Kind::Silhouette => "silhouette",
            Kind::SmallLight => "small-light shadow",
            Kind::SoftShadow => "soft shadow",
            Kind::EnvironmentShadow => "environment shadow",
            Kind::Glossy => "glossy reflection",
            Kind::Cornell => "Cornell geometry",
            Kind::Material => "material",
            Kind::Glass => "glass",
            Kind::Layers => "coats and relief",
            Kind::Special => "special",
        }
    }
}

pub type Build = Box<dyn Fn(f32) -> (SceneDescription, Camera)>;

pub struct Case {
    pub kind: Kind,
    pub scene: &'static str,
    pub param: &'static str,
    pub build: Build,
    pub output: Output,
    pub bounces: u32,
    pub spp: u32,
    pub ramp: Ramp,
    pub method: Method,
    /// The smaller step of finite differences.
    pub step: f32,
    /// How many times the ordinary number of samples finite differences take.
    pub effort: u32,
    /// The loss in closed form.
    pub exact: Option<Box<dyn Fn(f64) -> f64>>,
}

impl Case {
    fn new(
        kind: Kind,
        scene: &'static str,
        param: &'static str,
        build: impl Fn(f32) -> (SceneDescription, Camera) + 'static,
    ) -> Case {
        Case {
            kind,
            scene,
            param,
            build: Box::new(build),
            output: Output::Radiance,
            bounces: 1,
            spp: 4,
            ramp: Ramp::X,
            method: Method::Path,
            step: 0.02,
            effort: 1,
            exact: None,
        }
    }

    pub fn id(&self) -> String {
        format!("{} / {}", self.scene, self.param)
    }
}

fn camera(origin: Vec3, target: Vec3, fov_degrees: f32) -> Camera {
    let steep = (target - origin).normalize().y.abs() > 0.99;
    let up = if steep { Vec3::Z } else { Vec3::Y };
    Camera::look_at(origin, target, up, fov_degrees.to_radians(), [SIZE, SIZE])
}

fn exact3(v: [Vec3; 3], index: usize, direction: DVec3) -> impl Fn(f64) -> [DVec3; 3] {
    move |t| {
        let mut v = v.map(|p| p.as_dvec3());
        v[index] += direction * t;
        v
    }
}

pub fn all() -> Vec<Case> {
    let mut cases = Vec::new();
    emissive_triangles(&mut cases);
    triangles(&mut cases);
    roof_and_channels(&mut cases);
    blockers(&mut cases);
    environments(&mut cases);
    mirrors(&mut cases);
    cornell_box(&mut cases);
    furnace(&mut cases);
    interpenetrating(&mut cases);
    textures(&mut cases);
    seams(&mut cases);
    glass(&mut cases);
    layers(&mut cases);
    cases
}

const TRIANGLE: [Vec3; 3] = [vec3(-1.0, -0.8, 0.0), vec3(1.1, -0.6, 0.0), vec3(-0.2, 1.2, 0.3)];
const WARM: Vec3 = vec3(1.0, 0.8, 0.6);

fn emissive_triangles(cases: &mut Vec<Case>) {
    let triangle = |v: [Vec3; 3], camera: Camera| {
        move |t: f32| {
            let mut v = v;
            v[2].y += t;
            let mut b = Builder::default();
            b.lamp(mesh(v.to_vec(), vec![[0, 1, 2]]), WARM);
            (b.description, camera)
        }
    };
    let mut add = |kind, scene, v: [Vec3; 3], camera: Camera| {
        let moving = exact3(v, 2, DVec3::Y);
        let build = triangle(v, camera);
        cases.push(Case {
            bounces: 0,
            exact: Some(Box::new(move |t| grey(WARM) * moment(&outline(&camera, &moving(t)), Ramp::X))),
            ..Case::new(kind, scene, "vertex 2 y", build)
        });
    };
    let eye = camera(vec3(0., 0., 5.), Vec3::ZERO, 45.0);
    add(Kind::Silhouette, "01 emissive triangle", TRIANGLE, eye);
    for (scene, z) in [("04 fisheye, z = 2", 2.0), ("04 fisheye, z = 5", 5.0), ("04 fisheye, z = 10", 10.0)] {
        let fisheye = Camera {
            projection: Projection::Fisheye,
            origin: vec3(0.3, -0.2, z),
            scale: [80f32.to_radians(); 2],
            ..eye
        };
        add(Kind::Special, scene, TRIANGLE, fisheye);
    }
    for (scene, z) in [("04 panorama, z = 2", 2.0), ("04 panorama, z = 5", 5.0), ("04 panorama, z = 10", 10.0)] {
        let panorama =
            Camera { projection: Projection::Panorama, origin: vec3(0.3, -0.2, z), scale: [PI, 0.5 * PI], ..eye };
        add(Kind::Special, scene, TRIANGLE, panorama);
    }
}

fn triangles(cases: &mut Vec<Case>) {
    cases.push(Case {
        ramp: Ramp::Y,
        ..Case::new(Kind::Silhouette, "02 lit triangle, small light", "vertex 1 x", |t| {
            let mut b = Builder::default();
            let grey = b.diffuse(vec3(0.5, 0.4, 0.6));
            let v = vec![vec3(-1.7, 1.0, 0.0), vec3(1.0 + t, 1.0, 0.0), vec3(-0.5, -1.0, 0.0)];
            b.add(mesh(v, vec![[0, 1, 2]]), grey);
            let (x, y, z) = (1.0, 1.0, -7.0);
            let light = quad(vec3(-x, -y, z), vec3(x, -y, z), vec3(x, y, z), vec3(-x, y, z));
            let light = Mesh { vertices: light.vertices.iter().map(|p| *p * vec3(0.1, 0.1, 1.0)).collect(), ..light };
            b.lamp(light, Vec3::splat(2000.0));
            (b.description, camera(vec3(0., 0., -5.), Vec3::ZERO, 45.0))
        })
    });

    const BACK: [Vec3; 3] = [vec3(-1.0, -0.8, 0.0), vec3(1.1, -0.6, 0.0), vec3(-0.2, 1.2, 0.0)];
    const FRONT: [Vec3; 3] = [vec3(0.0, -0.3, 1.0), vec3(1.2, 0.1, 1.0), vec3(0.3, 0.9, 1.0)];
    const COLD: Vec3 = vec3(0.2, 0.5, 0.9);
    let eye = camera(vec3(0., 0., 5.), Vec3::ZERO, 45.0);
    cases.push(Case {
        bounces: 0,
        exact: Some(Box::new(move |t| {
            let back = outline(&eye, &BACK.map(|v| v.as_dvec3()));
            let front = outline(&eye, &FRONT.map(|v| v.as_dvec3() + DVec3::X * t));
            let hidden = moment(&intersection(&back, &front), Ramp::X);
            grey(WARM) * (moment(&back, Ramp::X) - hidden) + grey(COLD) * moment(&front, Ramp::X)
        })),
        ..Case::new(Kind::Silhouette, "03 two triangles", "front triangle x", move |t| {
            let mut b = Builder::default();
            b.lamp(mesh(BACK.to_vec(), vec![[0, 1, 2]]), WARM);
            b.lamp(mesh(FRONT.map(|v| v + Vec3::X * t).to_vec(), vec![[0, 1, 2]]), COLD);
            (b.description, eye)
        })
    });
}

/// A sphere with bumps: 20·4ⁿ triangles, smooth normals.
fn blob(radius: f32, subdivisions: usize) -> Mesh {
    let mut mesh = shapes::icosphere(1.0, subdivisions).unwrap_or_default();
    for v in &mut mesh.vertices {
        let d = *v;
        *v = d * radius * (1.0 + 0.12 * (6.0 * d.x + 1.0).sin() * (5.0 * d.y).sin() + 0.08 * (7.0 * d.z).cos());
    }
    mesh.uvs = None;
    ops::with_smooth_normals(mesh).unwrap_or_default()
}

fn turned(mesh: &Mesh, turn: Mat3, shift: Vec3) -> Mesh {
    Mesh {
        vertices: mesh.vertices.iter().map(|v| turn * *v + shift).collect(),
        normals: mesh.normals.as_ref().map(|n| n.iter().map(|n| turn * *n).collect()),
        ..mesh.clone()
    }
}

fn black() -> Material {
    Material::from(MaterialKind::Black)
}

fn roof_and_channels(cases: &mut Vec<Case>) {
    let eye = camera(vec3(0.1, 5., -0.5), Vec3::ZERO, 35.0);
    let sun = vec3(1.0, -1.5, 0.2);
    // Both sides stay lit and seen: radiance times projected area of each, both depending on the ridge.
    let exact = move |ridge: f64, moved: f64| {
        let side = |base: f64| {
            let (base, x) = (base + moved, 0.2 + moved + ridge);
            let p = [(base, 0., -1.), (x, 1., -1.), (x, 1., 1.), (base, 0., 1.)].map(|(x, y, z)| DVec3::new(x, y, z));
            let normal = (p[1] - p[0]).cross(p[3] - p[0]).normalize();
            let cosine = (normal * normal.y.signum()).dot(-sun.as_dvec3().normalize());
            f64::from(0.8_f32) / std::f64::consts::PI * 3.0 * cosine * moment(&outline(&eye, &p), Ramp::X)
        };
        side(-1.0) + side(1.0)
    };
    let roof = move |ridge: f32, moved: f32| {
        let mut b = Builder::default();
        let grey = b.diffuse(Vec3::splat(0.8));
        let x = 0.2 + ridge;
        let v = [
            vec3(-1., 0., -1.),
            vec3(x, 1., -1.),
            vec3(1., 0., -1.),
            vec3(-1., 0., 1.),
            vec3(x, 1., 1.),
            vec3(1., 0., 1.),
        ];
        let v = v.map(|v| v + Vec3::X * moved).to_vec();
        b.add(mesh(v, vec![[0, 3, 4], [0, 4, 1], [1, 4, 5], [1, 5, 2]]), grey);
        b.description.delta_lights.push(DeltaLight::Directional { direction: sun, irradiance: Vec3::splat(3.0) });
        (b.description, eye)
    };
    let scene = "05 flat-shaded roof";
    cases.push(Case {
        exact: Some(Box::new(move |t| exact(t, 0.0))),
        ..Case::new(Kind::Special, scene, "ridge x (crease)", move |t| roof(t, 0.0))
    });
    cases.push(Case {
        exact: Some(Box::new(move |t| exact(0.0, t))),
        ..Case::new(Kind::Special, scene, "roof x", move |t| roof(0.0, t))
    });

    let shape = blob(1.0, 6);
    cases.push(Case {
        output: Output::Normal,
        step: 0.03,
        ..Case::new(Kind::Special, "06 blob of 82k triangles, normals", "rotation", move |t| {
            let mut b = Builder::default();
            let turn = Mat3::from_axis_angle(vec3(1.0, 2.0, 0.5).normalize(), t);
            let moved = turned(&shape, turn, Vec3::ZERO);
            b.add(moved, black());
            (b.description, camera(vec3(0.5, 1., -4.), Vec3::ZERO, 40.0))
        })
    });
}

/// Floor, quadrilateral above it, square lights above that (Li et al. 2018).
#[derive(Clone)]
struct Shadow {
    floor: f32,
    /// Centre and half size.
    lights: Vec<(Vec3, f32)>,
    /// The blocker's centre; half size ½. `None` without a blocker.
    blocker: Option<Vec3>,
    /// One of its corners moves by this.
    corner: Vec3,
    eye: Vec3,
}

impl Shadow {
    fn one(half: f32) -> Shadow {
        Shadow {
            floor: 0.0,
            lights: vec![(vec3(0., 5., 0.), half)],
            blocker: Some(vec3(0., 3., 0.)),
            corner: Vec3::ZERO,
            eye: vec3(0., 2., -5.),
        }
    }

    fn many() -> Shadow {
        let light = |i: usize| {
            let (x, z) = ((i % 4) as f32 - 1.5, (i / 4) as f32 - 1.5);
            (vec3(0.9 * x, 4.6 + 0.05 * i as f32, 0.9 * z), 0.02 * 1.24f32.powi(i as i32))
        };
        Shadow { lights: (0..16).map(light).collect(), ..Shadow::one(0.0) }
    }

    fn build(&self) -> (SceneDescription, Camera) {
        let mut b = Builder::default();
        let grey = b.diffuse(Vec3::splat(0.5));
        b.add(floor(Vec3::Y * self.floor, 2.0), grey.clone());
        if let Some(c) = self.blocker {
            let mut blocker = floor(c, 0.5);
            blocker.vertices[1] += self.corner;
            b.add(blocker, grey);
        }
        for &(c, half) in &self.lights {
            let power = 40.0 / self.lights.len() as f32;
            b.lamp(ceiling(c, half), Vec3::splat(power / (4.0 * half * half)));
        }
        (b.description, camera(self.eye, Vec3::ZERO, 45.0))
    }
}

fn blockers(cases: &mut Vec<Case>) {
    let shadow = |base: Shadow, change: fn(f32, &mut Shadow)| {
        move |t: f32| {
            let mut s = base.clone();
            change(t, &mut s);
            s.build()
        }
    };
    let blocker_x: fn(f32, &mut Shadow) = |t, s| s.blocker = s.blocker.map(|c| c + Vec3::X * t);
    let corner_z: fn(f32, &mut Shadow) = |t, s| s.corner.z = t;
    let light_x: fn(f32, &mut Shadow) = |t, s| s.lights[0].0.x += t;
    let light_y: fn(f32, &mut Shadow) = |t, s| s.lights[0].0.y += t;
    let light_z: fn(f32, &mut Shadow) = |t, s| s.lights[0].0.z += t;
    let small = Kind::SmallLight;
    let step = 0.08;
    for (kind, scene, base) in [
        (small, "07 shadow, light 0.2", Shadow::one(0.1)),
        (Kind::SoftShadow, "08 shadow, light 2", Shadow::one(1.0)),
        (Kind::SoftShadow, "09 shadow, 16 lights", Shadow::many()),
    ] {
        cases.push(Case { step, ..Case::new(kind, scene, "blocker x", shadow(base.clone(), blocker_x)) });
        let corner = shadow(base, corner_z);
        cases.push(Case { step, ramp: Ramp::Y, ..Case::new(kind, scene, "blocker corner z", corner) });
    }
    cases.push(Case {
        bounces: 1,
        spp: 16,
        ..Case::new(Kind::SoftShadow, "08 soft shadow, blocker out of view", "blocker x", |t| {
            let mut b = Builder::default();
            let grey = b.diffuse(Vec3::splat(0.7));
            b.add(floor(Vec3::ZERO, 6.0), grey);
            b.add(floor(vec3(0.6 + t, 2., 0.), 0.5), black());
            b.lamp(ceiling(vec3(0., 4., 0.), 0.5), vec3(20., 18., 15.));
            (b.description, camera(vec3(0., 3., 5.), Vec3::ZERO, 30.0))
        })
    });
    let bare = Shadow { blocker: None, ..Shadow::one(0.1) };
    cases.push(Case { step, ..Case::new(Kind::Special, "10 no blocker", "light x", shadow(bare.clone(), light_x)) });
    cases.push(Case { step, ..Case::new(Kind::Special, "10 no blocker", "light y", shadow(bare.clone(), light_y)) });
    let along = shadow(bare, light_z);
    cases.push(Case { step, ramp: Ramp::Y, ..Case::new(Kind::Special, "10 no blocker", "light z", along) });
    let lit = || Shadow::one(0.1);
    cases.push(Case { step, ..Case::new(small, "10 with blocker", "light x", shadow(lit(), light_x)) });
    cases.push(Case { step, ..Case::new(small, "10 with blocker", "light y", shadow(lit(), light_y)) });
    let along = shadow(lit(), light_z);
    cases.push(Case { step, ramp: Ramp::Y, ..Case::new(small, "10 with blocker", "light z", along) });
    let receiver = shadow(lit(), |t, s| s.floor += t);
    cases.push(Case { step, ..Case::new(small, "11 receiver along its normal", "floor y", receiver) });
    let eye = shadow(lit(), |t, s| s.eye.x += t);
    cases.push(Case { step, ..Case::new(Kind::Special, "12 camera, blocker in view", "camera x", eye) });
    cases.push(Case {
        step: 0.1,
        ..Case::new(Kind::Special, "12 camera, blocker out of view", "camera x", |t| {
            let mut b = Builder::default();
            let grey = b.diffuse(Vec3::splat(0.5));
            b.add(floor(Vec3::ZERO, 20.0), grey.clone());
            b.add(floor(vec3(0., 10., 0.), 0.5), grey);
            b.lamp(ceiling(vec3(0., 15., 0.), 0.1), Vec3::splat(5000.0));
            (b.description, camera(vec3(t, 9., 0.), vec3(t, 0., 0.), 45.0))
        })
    });
}

/// A sky, brighter near the horizon, with a sun: a lobe exp(κ (cos − 1)).
fn sky(width: usize, height: usize, sun: Vec3, peak: f32, sharpness: f32) -> Texture {
    let radiance = |i: usize| {
        let (u, v) = ((i % width) as f32 + 0.5, (i / width) as f32 + 0.5);
        let d = dscene::render::environment::environment_direction(glam::vec2(u / width as f32, v / height as f32));
        let sky = vec3(0.35, 0.5, 0.9) * (0.4 + 0.6 * (1.0 - d.y.max(0.0)));
        let lobe = peak * (sharpness * (d.dot(sun) - 1.0)).exp();
        (sky + vec3(1.0, 0.9, 0.7) * lobe).to_array()
    };
    let data = (0..width * height).flat_map(radiance).collect();
    Texture { width, height, channels: 3, data, packed: None, wrap: Wrap::Repeat, filter: Filter::Bilinear }
}

fn environments(cases: &mut Vec<Case>) {
    let kind = Kind::EnvironmentShadow;
    let lit = |b: &mut Builder, texture: Texture, rotation: Mat3| {
        b.description.textures.push(texture);
        b.description.environment = Some(SphericalMap { texels: b.description.textures.len() - 1, rotation });
    };
    for (param, ramp, slide, raise) in [("blocker x", Ramp::X, 1.0, 0.0), ("blocker y", Ramp::Y, 0.0, 1.0)] {
        cases.push(Case {
            ramp,
            step: 0.06,
            spp: 16,
            effort: 2,
            ..Case::new(kind, "13 constant environment", param, move |t| {
                let mut b = Builder::default();
                let grey = b.diffuse(Vec3::splat(0.5));
                b.add(floor(Vec3::ZERO, 2.0), grey);
                let c = vec3(0.1 + slide * t, 0.7 + raise * t, 0.0);
                b.add(floor(c, 0.5), black());
                lit(&mut b, Texture::constant(Vec3::splat(0.8)), Mat3::IDENTITY);
                (b.description, camera(vec3(0., 2.5, -5.), Vec3::ZERO, 45.0))
            })
        });
    }
    let teapot = Mesh { normals: None, uvs: None, ..shapes::teapot(8).unwrap_or_default() };
    let sun = vec3(0.5, 0.8, -0.4).normalize();
    let sunny = sky(512, 256, sun, 300.0, 2000.0);
    for (param, slide, turn) in [("teapot x", 1.0, 0.0), ("sun's azimuth", 0.0, 1.0)] {
        let (teapot, sunny) = (teapot.clone(), sunny.clone());
        cases.push(Case {
            step: 0.05,
            effort: 2,
            ..Case::new(kind, "14 sun, sky and teapot", param, move |t| {
                let mut b = Builder::default();
                let grey = b.diffuse(vec3(0.5, 0.45, 0.4));
                b.add(floor(Vec3::ZERO, 3.0), grey);
                let shift = vec3(slide * t, 0.02, 0.0);
                b.add(turned(&teapot, Mat3::from_diagonal(Vec3::splat(0.35)), shift), black());
                lit(&mut b, sunny.clone(), Mat3::from_rotation_y(turn * t));
                (b.description, camera(vec3(0., 2.5, -5.), vec3(0., 0.3, 0.), 40.0))
            })
        });
    }
}

fn mirrors(cases: &mut Vec<Case>) {
    // A triangle above a mirror, seen directly and as its image. Both are seen from the front.
    const V: [Vec3; 3] = [vec3(-0.9, 0.5, 0.0), vec3(0.1, 1.9, 0.1), vec3(1.0, 0.4, 0.0)];
    let eye = camera(vec3(0.2, 1.6, -6.), vec3(0., 0.2, 0.), 45.0);
    let image = |v: DVec3, height: f64| DVec3::new(v.x, 2.0 * height - v.y, v.z);
    let reflectance = f64::from(0.9_f32);
    for (param, mirror, vertex) in [("mirror height", 1.0, 0.0), ("vertex 1 y", 0.0, 1.0)] {
        cases.push(Case {
            ramp: Ramp::Y,
            exact: Some(Box::new(move |t| {
                let v = exact3(V, 1, DVec3::Y * vertex)(t);
                let seen = |v: [DVec3; 3]| moment(&outline(&eye, &v), Ramp::Y);
                grey(WARM) * (seen(v) + reflectance * seen(v.map(|v| image(v, mirror * t))))
            })),
            ..Case::new(Kind::Special, "15 planar mirror", param, move |t| {
                let mut b = Builder::default();
                let (mirror, vertex) = (mirror as f32, vertex as f32);
                let material = Material::from(MaterialKind::Mirror { reflectance: b.constant(Vec3::splat(0.9)) });
                b.add(floor(Vec3::Y * mirror * t, 4.5), material);
                let mut v = V;
                v[1].y += vertex * t;
                b.lamp(mesh(v.to_vec(), vec![[0, 1, 2]]), WARM);
                (b.description, eye)
            })
        });
    }
    // The same above a ball of mirror.
    for (param, mirror, vertex) in [("mirror height", 1.0, 0.0), ("vertex 1 y", 0.0, 1.0)] {
        cases.push(Case {
            ramp: Ramp::Y,
            ..Case::new(Kind::Special, "15 sphere mirror", param, move |t| {
                let mut b = Builder::default();
                let kind = MaterialKind::Mirror { reflectance: b.constant(Vec3::splat(0.9)) };
                let ball =
                    turned(&shapes::sphere(1.0, 64).expect("a sphere"), Mat3::IDENTITY, Vec3::Y * (mirror * t - 0.8));
                b.add(ball, Material::from(kind));
                let mut v = V;
                v[1].y += vertex * t;
                b.lamp(mesh(v.to_vec(), vec![[0, 1, 2]]), WARM);
                (b.description, eye)
            })
        });
    }
    // A black blob in front of a wall of light, seen in a glossy floor.
    let shape = Mesh { normals: None, ..blob(0.6, 4) };
    for (scene, alpha) in
        [("16 glossy floor, α = 0.05", 0.05f32), ("16 glossy floor, α = 0.1", 0.1), ("16 glossy floor, α = 0.3", 0.3)]
    {
        let shape = shape.clone();
        cases.push(Case {
            step: 0.04,
            effort: 2,
            spp: 16,
            ..Case::new(Kind::Glossy, scene, "blob x", move |t| {
                let mut b = Builder::default();
                let (reflectance, roughness) = (b.constant(Vec3::ONE), b.scalar(alpha.sqrt()));
                let glossy = MaterialKind::Conductor { reflectance, roughness };
                b.add(floor(Vec3::ZERO, 3.0), Material::from(glossy));
                b.add(turned(&shape, Mat3::IDENTITY, vec3(0.2 + t, 1.1, 0.5)), black());
                let (x, z) = (3.0, 2.9);
                b.lamp(quad(vec3(x, 0.1, z), vec3(-x, 0.1, z), vec3(-x, 4.0, z), vec3(x, 4.0, z)), WARM);
                (b.description, camera(vec3(0., 2.2, -5.), vec3(0., 0., -0.5), 40.0))
            })
        });
    }
}

/// What moves in the Cornell box.
#[derive(Clone, Copy, Default)]
struct Cornell {
    small_x: f32,
    tall_turn: f32,
    light_y: f32,
    floor: f32,
    light: f32,
}

impl Cornell {
    fn build(self) -> (SceneDescription, Camera) {
        let mut b = Builder::default();
        let white = vec3(0.885809, 0.698859, 0.666422);
        let (x, y, z) = (Vec3::X, Vec3::Y, Vec3::Z);
        let wall = |c: Vec3, a: Vec3, u: Vec3| quad(c - a - u, c + a - u, c + a + u, c - a + u);
        let ground = b.diffuse(white + self.floor);
        b.add(wall(-y, z, x), ground);
        for (m, colour) in [
            (wall(y, x, z), white),
            (wall(-z, x, y), white),
            (wall(x, z, y), vec3(0.105421, 0.37798, 0.076425)),
            (wall(-x, -z, y), vec3(0.570068, 0.0430135, 0.0443706)),
            (cuboid(vec3(0.335 + self.small_x, -0.7, 0.38), vec3(0.3, 0.3, 0.3), -17f32.to_radians()), white),
            (cuboid(vec3(-0.33, -0.4, -0.28), vec3(0.3, 0.6, 0.3), 18.25f32.to_radians() + self.tall_turn), white),
        ] {
            let material = b.diffuse(colour);
            b.add(m, material);
        }
        let light = ceiling(Vec3::ZERO, 1.0);
        let place = |v: &Vec3| *v * vec3(0.23, 1.0, 0.19) + vec3(0.0, 0.99 + self.light_y, 0.01);
        let light = Mesh { vertices: light.vertices.iter().map(place).collect(), ..light };
        b.lamp(light, vec3(18.387, 13.9873, 6.75357) * (1.0 + self.light));
        (b.description, camera(vec3(0., 0., 3.9), Vec3::ZERO, 39.3077))
    }
}

/// The scene of the forward benchmark.
pub fn cornell() -> (SceneDescription, Camera) {
    Cornell::default().build()
}

fn cornell_box(cases: &mut Vec<Case>) {
    let small: fn(f32) -> Cornell = |t| Cornell { small_x: t, ..Cornell::default() };
    let tall: fn(f32) -> Cornell = |t| Cornell { tall_turn: t, ..Cornell::default() };
    // Where it belongs the light is 0.01 below the ceiling. It also moves from a place that leaves room for wider differences.
    let light: fn(f32) -> Cornell = |t| Cornell { light_y: t, ..Cornell::default() };
    let lowered: fn(f32) -> Cornell = |t| Cornell { light_y: t - 0.2, ..Cornell::default() };
    let floor: fn(f32) -> Cornell = |t| Cornell { floor: t, ..Cornell::default() };
    let power: fn(f32) -> Cornell = |t| Cornell { light: t, ..Cornell::default() };
    for (bounces, scene) in [(1, "17 Cornell box, 1 bounce"), (4, "17 Cornell box, 4 bounces")] {
        for (kind, param, step, change) in [
            (Kind::Cornell, "small box x", 0.03, small),
            (Kind::Cornell, "tall box turned", 0.08, tall),
            (Kind::Cornell, "light y", 0.05, lowered),
            (Kind::Cornell, "light y at the ceiling", 0.004, light),
            (Kind::Material, "floor albedo", 0.03, floor),
            (Kind::Material, "light radiance", 0.1, power),
        ] {
            // Precise at any rate: errors of well spread samples fall faster than with their square root, as long as paths are short.
            let spp = if kind == Kind::Material && bounces == 1 { 64 } else { 16 };
            // Where shadows have sharp kinks differences need small steps; where they are noisy they cannot have them.
            let step = if bounces == 1 && param != "light y at the ceiling" { 0.5 * step } else { step };
            // Where the upright edges of the tall box come to the next column, a ramp of columns has a kink, and differences step over
            // several: they are off by 1.3 % of a sum that cancels. (At four bounces one of rows would cancel altogether.)
            let ramp = if param == "tall box turned" && bounces == 1 { Ramp::Y } else { Ramp::X };
            let build = move |t: f32| change(t).build();
            cases.push(Case { bounces, spp, step, ramp, ..Case::new(kind, scene, param, build) });
        }
    }
}

fn furnace(cases: &mut Vec<Case>) {
    let mut state = 1u64;
    let mut random = move || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 40) as f32 / (1u64 << 24) as f32 * 2.0 - 1.0
    };
    let mut point = move || vec3(random(), random(), random());
    let (mut vertices, mut velocities) = (Vec::new(), Vec::new());
    for _ in 0..1000 {
        let c = point() * 0.85;
        vertices.extend([(); 3].map(|()| c + point() * 0.12));
        velocities.extend([(); 3].map(|()| point()));
    }
    // Of unit length, so that the error of its derivative, which is zero, can be compared with the loss.
    let length = velocities.iter().map(|v: &Vec3| v.length_squared()).sum::<f32>().sqrt();
    velocities.iter_mut().for_each(|v| *v /= length);
    cases.push(Case {
        bounces: 2,
        exact: Some(Box::new(|_| 0.0)),
        ..Case::new(Kind::Special, "18 furnace, 1000 triangles", "all vertices", move |t| {
            let mut b = Builder::default();
            let (reflectance, radiance) = (b.constant(Vec3::splat(0.5)), b.constant(Vec3::ONE));
            let mut add = |mesh: Mesh| {
                let material = Material::from(MaterialKind::Diffuse { reflectance });
                let emission = Some(Emission { radiance, two_sided: true });
                b.description.shapes.push(Shape { mesh, material, emission });
            };
            add(cuboid(Vec3::ZERO, Vec3::ONE, 0.0));
            let moved = vertices.iter().zip(&velocities).map(|(v, w)| *v + *w * t).collect();
            add(mesh(moved, (0..1000).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect()));
            (b.description, camera(vec3(0.1, 0.05, -0.98), Vec3::ZERO, 70.0))
        })
    });
}

/// Curves of intersection: none of these meshes has an edge where the image changes.
fn interpenetrating(cases: &mut Vec<Case>) {
    let quads = |turn: f32, rise: f32| {
        let mut b = Builder::default();
        for (i, colour) in [vec3(0.7, 0.2, 0.2), vec3(0.2, 0.3, 0.7), vec3(0.3, 0.6, 0.2)].into_iter().enumerate() {
            let (moved, i) = (f32::from(i == 0), i as f32);
            let tilt = Mat3::from_rotation_y(0.3 + 2.1 * i) * Mat3::from_rotation_x(0.9 + 0.2 * i + moved * turn);
            let material = b.diffuse(colour);
            b.add(turned(&floor(Vec3::ZERO, 1.2), tilt, vec3(0.1 * i, moved * rise, 0.0)), material);
        }
        b.lamp(ceiling(vec3(0.5, 5., -2.), 0.5), Vec3::splat(30.));
        (b.description, camera(vec3(0., 3., -4.), Vec3::ZERO, 40.0))
    };
    let scene = "19 three quads through each other";
    cases.push(Case { step: 0.03, ..Case::new(Kind::Special, scene, "one turned", move |t| quads(t, 0.0)) });
    cases.push(Case { step: 0.03, ..Case::new(Kind::Special, scene, "one raised", move |t| quads(0.0, t)) });
    for (bounces, scene) in [(1, "19 teapot in a floor, 1 bounce"), (3, "19 teapot in a floor, 3 bounces")] {
        let build = |t: f32| {
            let mut b = Builder::default();
            let (red, grey) = (b.diffuse(vec3(0.7, 0.3, 0.2)), b.diffuse(Vec3::splat(0.6)));
            let pot = Mesh { normals: None, ..shapes::teapot(6).unwrap_or_default() };
            b.add(turned(&pot, Mat3::from_rotation_z(0.3), vec3(0.0, t - 0.5, 0.0)), red);
            b.add(floor(Vec3::ZERO, 4.0), grey);
            b.lamp(ceiling(vec3(1.5, 6., -3.), 0.7), Vec3::splat(40.));
            (b.description, camera(vec3(0., 4., -6.), vec3(0., 0.5, 0.), 40.0))
        };
        cases.push(Case { bounces, spp: 16, step: 0.03, ..Case::new(Kind::Special, scene, "teapot y", build) });
    }
}

/// `f` of texture coordinates, on n×n texels.
fn painted(n: usize, channels: usize, f: impl Fn(f32, f32) -> f32) -> Texture {
    let data = (0..n * n)
        .flat_map(|i| {
            let (u, v) = ((i % n) as f32 / n as f32, (i / n) as f32 / n as f32);
            (0..channels).map(move |c| (u, v + 0.1 * c as f32))
        })
        .map(|(u, v)| f(u, v))
        .collect();
    Texture { width: n, height: n, channels, data, packed: None, wrap: Wrap::Repeat, filter: Filter::Bilinear }
}

fn textures(cases: &mut Vec<Case>) {
    let sunny = sky(128, 64, vec3(0.5, 0.7, -0.5).normalize(), 20.0, 50.0);
    let wave = |u: f32, v: f32| (40.0 * u).sin() * (25.0 * v).cos();
    for (param, albedo, roughness) in [("albedo", 1.0, 0.0), ("roughness", 0.0, 1.0)] {
        let sunny = sunny.clone();
        cases.push(Case {
            spp: 16,
            step: 0.02,
            ..Case::new(Kind::Material, "20 textures of 2048²", param, move |t| {
                let mut b = Builder::default();
                let sphere = Mesh { normals: None, ..shapes::sphere(0.95, 96).unwrap_or_default() };
                let mut texture = |texture: Texture| {
                    b.description.textures.push(texture);
                    Input::Texture(b.description.textures.len() - 1)
                };
                let direction = |u: f32, v: f32| 1.0 + 0.5 * wave(u + 0.1, v);
                let base = painted(2048, 3, |u, v| 0.5 + 0.3 * wave(u, v) + albedo * t * direction(u, v));
                let rough = painted(2048, 1, |u, v| 0.4 + 0.1 * wave(u, v) + roughness * t * direction(u, v));
                let diffuse = MaterialKind::Diffuse { reflectance: texture(base) };
                let one = texture(Texture::constant(Vec3::ONE));
                let metal = MaterialKind::Conductor { reflectance: one, roughness: texture(rough) };
                for (kind, x) in [(diffuse, -1.0), (metal, 1.0)] {
                    let sphere = turned(&sphere, Mat3::IDENTITY, vec3(x, 0.0, 0.0));
                    b.add(sphere, Material::from(kind));
                }
                b.description.textures.push(sunny.clone());
                b.description.environment =
                    Some(SphericalMap { texels: b.description.textures.len() - 1, rotation: Mat3::IDENTITY });
                (b.description, camera(vec3(0., 0.8, -5.), Vec3::ZERO, 45.0))
            })
        });
    }
}

fn seams(cases: &mut Vec<Case>) {
    // A textured box whose triangles have vertices of their own, as files with texture coordinates have them.
    cases.push(Case {
        step: 0.06,
        ..Case::new(Kind::Special, "21 uv seams", "textured box x", |t| {
            let mut b = Builder::default();
            let whole = cuboid(vec3(0.1 + t, 0.6, 0.2), Vec3::splat(0.5), 0.5);
            let vertices: Vec<Vec3> = whole.faces.iter().flatten().map(|&v| whole.vertices[v as usize]).collect();
            let faces = (0..vertices.len() as u32 / 3).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
            let corners = [[(0., 0.), (1., 0.), (1., 1.)], [(0., 0.), (1., 1.), (0., 1.)]];
            let uvs = (0..vertices.len()).map(|i| glam::Vec2::from(corners[i / 3 % 2][i % 3])).collect();
            b.description.textures.push(painted(64, 3, |u, v| 0.5 + 0.3 * (6.0 * u).sin() * (5.0 * v).cos()));
            let kind = MaterialKind::Diffuse { reflectance: Input::Texture(0) };
            let mesh = Mesh { uvs: Some(uvs), ..mesh(vertices, faces) };
            b.add(mesh, Material::from(kind));
            let grey = b.diffuse(Vec3::splat(0.5));
            b.add(floor(Vec3::ZERO, 3.0), grey);
            b.lamp(ceiling(vec3(1., 5., -2.), 0.7), Vec3::splat(20.));
            (b.description, camera(vec3(0.2, 3., -4.), vec3(0., 0.4, 0.), 45.0))
        })
    });
}

/// A ball of glass over a floor.
#[derive(Clone, Copy, Default)]
struct GlassBall {
    ior: f32,
    roughness: f32,
    floor: f32,
}

impl GlassBall {
    /// Its material is `rough` or smooth; a lamp of this size lights it, or a point.
    fn build(self, rough: Option<f32>, lamp: Option<f32>) -> (SceneDescription, Camera) {
        let mut b = Builder::default();
        let grey = b.diffuse(Vec3::splat(0.6 + self.floor));
        b.add(floor(Vec3::ZERO, 3.0), grey);
        let roughness = rough.map(|r| b.scalar(r + self.roughness));
        let glass = MaterialKind::Dielectric { ior: b.scalar(1.5 + self.ior), roughness, absorption: None };
        let ball = shapes::sphere(0.8, 48).unwrap_or_default();
        b.add(turned(&ball, Mat3::IDENTITY, vec3(0.1, 1.0, 0.2)), Material::from(glass));
        match lamp {
            Some(size) => {
                b.lamp(ceiling(vec3(1.0, 4.0, -1.0), size), Vec3::splat(20.0));
            }
            None => {
                let (position, intensity) = (vec3(0.6, 4.0, -0.3), Vec3::splat(20.0));
                b.description.delta_lights.push(DeltaLight::Point { position, intensity });
            }
        }
        (b.description, camera(vec3(0., 2.6, -4.), vec3(0., 0.6, 0.), 45.0))
    }
}

/// The scene of the forward benchmark in glass.
pub fn glass_ball() -> (SceneDescription, Camera) {
    GlassBall::default().build(Some(0.4), Some(0.6))
}

fn glass(cases: &mut Vec<Case>) {
    let moves = |param: &str, t: f32| match param {
        "ior" => GlassBall { ior: t, ..GlassBall::default() },
        "roughness" => GlassBall { roughness: t, ..GlassBall::default() },
        _ => GlassBall { floor: t, ..GlassBall::default() },
    };
    for (param, step) in [("floor albedo", 0.03), ("roughness", 0.06)] {
        let build = move |t: f32| moves(param, t).build(Some(0.4), Some(0.6));
        let case = Case::new(Kind::Glass, "22 ball of rough glass, α = 0.16, 4 bounces", param, build);
        cases.push(Case { bounces: 4, spp: 16, step, effort: 4, ramp: Ramp::Y, ..case });
    }
    // With all other light, as another renderer's light tracer has it, and alone.
    for (param, method, step) in [("floor albedo", Method::Both, 0.03), ("ior", Method::Light, 0.004)] {
        let build = move |t: f32| {
            let (scene, eye) = moves(param, t).build(None, None);
            (scene, Camera { filter: PixelFilter::Tent, ..eye })
        };
        let case = Case::new(Kind::Glass, "23 caustic of a smooth ball, by light tracing", param, build);
        cases.push(Case { method, bounces: 4, spp: 16, step, effort: 4, ..case });
    }
}

/// Coats and relief.
fn layers(cases: &mut Vec<Case>) {
    for (param, base, coat) in [("albedo", 1.0, 0.0), ("coat roughness", 0.0, 1.0)] {
        let build = move |t: f32| {
            let mut b = Builder::default();
            let grey = b.diffuse(Vec3::splat(0.5));
            b.add(floor(vec3(0., -0.8, 0.), 3.0), grey);
            let diffuse = b.diffuse(vec3(0.5, 0.3, 0.2) + base * t);
            let (weight, roughness) = (b.scalar(1.0), b.scalar(0.4 + coat * t));
            let ball = Mesh { normals: None, ..shapes::sphere(0.8, 48).unwrap_or_default() };
            b.add(ball, Material { coat: Some(ClearCoat { weight, roughness }), ..diffuse });
            b.lamp(ceiling(vec3(0.7, 3.5, -2.0), 0.6), Vec3::splat(20.0));
            (b.description, camera(vec3(0., 0.8, -4.), Vec3::ZERO, 40.0))
        };
        let case = Case::new(Kind::Layers, "24 coated ball", param, build);
        cases.push(Case { bounces: 2, spp: 16, step: 0.02, ..case });
    }
    let build = |t: f32| {
        let mut b = Builder::default();
        let wave = |u: f32, v: f32| (40.0 * u).sin() * (25.0 * v).cos();
        // A relief's normals, z outwards; what changes is their tilt.
        let tilt = |u: f32, v: f32| (0.5 + t * (1.0 + wave(v, u))) * wave(u, v);
        let n = 256;
        let texels = (0..n * n).flat_map(|i| {
            let (u, v) = ((i % n) as f32 / n as f32, (i / n) as f32 / n as f32);
            let normal = vec3(tilt(u, v), tilt(v, u), 1.0).normalize();
            (0.5 * normal + 0.5).to_array()
        });
        let (wrap, filter) = (Wrap::Repeat, Filter::Bilinear);
        let map = Texture { width: n, height: n, channels: 3, data: texels.collect(), packed: None, wrap, filter };
        b.description.textures.push(map);
        let normals = Some(Input::Texture(b.description.textures.len() - 1));
        let grey = b.diffuse(Vec3::splat(0.6));
        let ground = floor(Vec3::ZERO, 2.0);
        let uvs = ground.vertices.iter().map(|v| glam::vec2(0.25 * v.x + 0.5, 0.25 * v.z + 0.5)).collect();
        b.add(Mesh { uvs: Some(uvs), ..ground }, Material { normals, ..grey });
        b.lamp(ceiling(vec3(3.0, 1.2, 1.0), 0.3), Vec3::splat(60.0));
        (b.description, camera(vec3(0., 2.5, -4.), Vec3::ZERO, 45.0))
    };
    cases.push(Case {
        spp: 16,
        step: 0.02,
        ..Case::new(Kind::Layers, "25 relief at grazing light", "normal map", build)
    });
}
