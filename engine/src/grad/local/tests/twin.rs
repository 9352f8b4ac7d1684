//! Scenes in dual numbers: all that a scene has moves at once, along a random direction.

use std::array::from_fn;

use glam::{Mat3, Vec2, Vec3};

use crate::grad::sink::{Adjoints, DenseSums, Layout, SparseSums};
use crate::math::{Dual, Pcg32};
use crate::mesh::Mesh;
use crate::render::accel::PrimId;
use crate::render::bsdf::Part;
use crate::render::bsdf::tests::{twin_conductor, twins};
use crate::render::environment::EnvironmentPeak;
use crate::render::interaction::SurfaceInteraction;
use crate::render::light::{LightKind, LightSample};
use crate::render::mask::MaskCrossing;
use crate::render::texture::{Filter, Texture, Wrap};
use crate::render::{
    BLEND_WEIGHT, Blend, COVERS, ClearCoat, Emission, GRAIN, Grain, Input, LAYER_INPUTS, MAX_INPUTS, Material,
    MaterialKind, SHEEN_COLOR, Scene, SceneDescription, Shape, SheenLayer, Slot, SphericalMap,
};

/// Numbers in three coordinates, with their derivatives.
pub type Twin<const N: usize> = [Dual<N>; 3];

/// Variables number `first` and the two after it.
pub fn variables<const N: usize>(v: Vec3, first: usize) -> Twin<N> {
    std::array::from_fn(|i| Dual::variable(f64::from(v[i]), first + i))
}

pub fn constants<const N: usize>(v: Vec3) -> Twin<N> {
    std::array::from_fn(|i| Dual::constant(f64::from(v[i])))
}

pub fn minus<const N: usize>(a: Twin<N>, b: Twin<N>) -> Twin<N> {
    std::array::from_fn(|i| a[i] - b[i])
}

pub fn times<const N: usize>(a: Twin<N>, s: Dual<N>) -> Twin<N> {
    a.map(|x| x * s)
}

pub fn dot<const N: usize>(a: Twin<N>, b: Twin<N>) -> Dual<N> {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

pub fn cross<const N: usize>(a: Twin<N>, b: Twin<N>) -> Twin<N> {
    std::array::from_fn(|i| a[(i + 1) % 3] * b[(i + 2) % 3] - a[(i + 2) % 3] * b[(i + 1) % 3])
}

pub fn unit<const N: usize>(a: Twin<N>) -> Twin<N> {
    times(a, 1.0 / dot(a, a).sqrt())
}

/// All of so many derivatives, in the layout's order.
pub fn dense(mut sums: SparseSums, len: usize) -> Vec<f64> {
    let mut total = DenseSums::new(len);
    sums.drain_to(&mut total);
    total.into_vec()
}

/// With the derivative along the direction in which everything moves.
pub type Number = Dual<1>;
pub type Vector = Twin<1>;

pub fn number(value: f64, tangent: f64) -> Number {
    Dual { value, partials: [tangent] }
}

pub fn vector(value: Vec3, tangent: Vec3) -> Vector {
    from_fn(|i| number(f64::from(value[i]), f64::from(tangent[i])))
}

pub fn plus(a: Vector, b: Vector) -> Vector {
    from_fn(|i| a[i] + b[i])
}

/// Channel by channel.
pub fn product(a: Vector, b: Vector) -> Vector {
    from_fn(|i| a[i] * b[i])
}

/// As it is now, at rest.
pub fn still(v: Vector) -> Vector {
    v.map(|x| Dual::constant(x.value))
}

/// A sum Σ bᵢ vᵢ.
pub fn mix(b: [Number; 3], v: [Vector; 3]) -> Vector {
    plus(plus(times(v[0], b[0]), times(v[1], b[1])), times(v[2], b[2]))
}

/// In the cube [−1, 1]³.
pub fn anywhere(rng: &mut Pcg32) -> Vec3 {
    Vec3::from_array(rng.next_3d()) * 2.0 - 1.0
}

/// Triangles that have whatever a triangle may have. All numbers of textures and colours lie between 0.3 and 0.8.
#[derive(Default)]
pub struct Builder {
    pub description: SceneDescription,
}

impl Builder {
    pub fn texture(&mut self, rng: &mut Pcg32, [width, height]: [usize; 2], channels: usize) -> usize {
        let data = (0..width * height * channels).map(|_| 0.3 + 0.5 * rng.next_f32()).collect();
        let wrap = [Wrap::Repeat, Wrap::Clamp, Wrap::Mirror][(3.0 * rng.next_f32()) as usize];
        self.description.textures.push(Texture::new(width, height, channels, data, wrap, Filter::Bilinear).unwrap());
        self.description.textures.len() - 1
    }

    /// A texture, a constant, the colours of the vertices, or, where it need not stay within the bounds, both.
    pub fn input(&mut self, rng: &mut Pcg32, scalar: bool) -> Input {
        let channels = if scalar && rng.next_f32() < 0.5 { 1 } else { 3 };
        match rng.next_u32() % 4 {
            0 => Input::VertexColor,
            1 => Input::Texture(self.texture(rng, [1, 1], channels)),
            2 if !scalar => Input::Tinted(self.texture(rng, [3, 4], channels)),
            _ => Input::Texture(self.texture(rng, [3, 4], channels)),
        }
    }

    /// Of any kind but a mirror; lobes may be narrow enough to be attached.
    pub fn material(&mut self, rng: &mut Pcg32) -> Material {
        let [a, b] = from_fn(|_| self.input(rng, false));
        let [c, d, roughness] = from_fn(|_| self.input(rng, true));
        let kind = match rng.next_u32() % 7 {
            0 => MaterialKind::Diffuse { reflectance: a },
            1 => MaterialKind::Conductor { reflectance: a, roughness },
            2 => MaterialKind::ConductorIor { eta: a, k: b, roughness },
            3 => {
                let narrow = self.texture(rng, [3, 4], 1);
                self.description.textures[narrow].data.iter_mut().for_each(|r| *r *= 0.05);
                let roughness = if rng.next_f32() < 0.5 { Input::Texture(narrow) } else { roughness };
                MaterialKind::Phong { diffuse: a, specular: b, roughness }
            }
            4 => {
                let ior = self.texture(rng, [3, 4], 1);
                self.description.textures[ior].data.iter_mut().for_each(|x| *x += 1.0);
                MaterialKind::Plastic { diffuse: a, ior: Input::Texture(ior), roughness }
            }
            5 => MaterialKind::Cloth { diffuse: a, sheen: b, roughness },
            _ => MaterialKind::Principled { base_color: a, metallic: c, roughness, specular: d },
        };
        let (kind, grain) = self.brushed(rng, kind);
        let coat = self.coat(rng);
        Material { grain, sheen: self.sheen(rng, &kind), coat, ..Material::from(kind) }
    }

    /// A grain for some of those that can have one. Every other one is strong, on a surface that is smooth across it.
    fn brushed(&mut self, rng: &mut Pcg32, kind: MaterialKind) -> (MaterialKind, Option<Grain>) {
        if !kind.takes_grain() || rng.next_f32() > 0.5 {
            return (kind, None);
        }
        let grain = Grain { anisotropy: self.input(rng, true), turn: self.input(rng, true) };
        if rng.next_f32() < 0.5 {
            return (kind, Some(grain));
        }
        let mut within = |least: f32, range: f32| {
            let texels = self.texture(rng, [3, 4], 1);
            self.description.textures[texels].data.iter_mut().for_each(|x| *x = least + 2.0 * range * (*x - 0.3));
            Input::Texture(texels)
        };
        let (roughness, anisotropy) = (within(0.12, 0.03), within(0.9, 0.05));
        let kind = kind.map(|field, input| if field.name == "roughness" { roughness } else { *input });
        (kind, Some(Grain { anisotropy, ..grain }))
    }

    fn sheen(&mut self, rng: &mut Pcg32, over: &MaterialKind) -> Option<SheenLayer> {
        let wanted = !matches!(over, MaterialKind::Cloth { .. }) && rng.next_f32() < 0.3;
        wanted.then(|| SheenLayer { color: self.input(rng, false), roughness: self.input(rng, true) })
    }

    fn coat(&mut self, rng: &mut Pcg32) -> Option<ClearCoat> {
        (rng.next_f32() < 0.4).then(|| ClearCoat { weight: self.input(rng, true), roughness: self.input(rng, true) })
    }

    /// A material, or a blend of two.
    pub fn material_or_blend(&mut self, rng: &mut Pcg32) -> Material {
        let own = self.material(rng);
        let blend = (rng.next_f32() < 0.3).then(|| {
            let Material { kind, grain, sheen, coat, .. } = self.material(rng);
            Blend { kind, grain, sheen, coat, weight: self.input(rng, true) }
        });
        Material { blend, ..own }
    }

    pub fn shape(&mut self, rng: &mut Pcg32, vertices: [Vec3; 3], material: Material) -> &mut Shape {
        let face = (vertices[1] - vertices[0]).cross(vertices[2] - vertices[0]).normalize();
        let side = if rng.next_f32() < 0.5 { -1.0 } else { 1.0 };
        let normals = vertices.map(|_| side * (face + 0.6 * anywhere(rng)) * (1.0 + rng.next_f32()));
        let uvs = vertices.map(|_| Vec2::from(rng.next_2d()));
        let colors = vertices.map(|_| Vec3::splat(0.3) + 0.5 * Vec3::from(rng.next_3d()));
        let mesh = Mesh {
            vertices: vertices.to_vec(),
            faces: vec![[0, 1, 2]],
            normals: (rng.next_f32() < 0.7).then(|| normals.to_vec()),
            uvs: (rng.next_f32() < 0.7 || material.needs_tangents()).then(|| uvs.to_vec()),
            colors: Some(colors.to_vec()),
        };
        self.description.shapes.push(Shape { mesh, material, emission: None });
        self.description.shapes.last_mut().unwrap()
    }

    pub fn mask(&mut self, rng: &mut Pcg32, vertices: [Vec3; 3]) {
        let opacity = Some(self.input(rng, true));
        self.shape(rng, vertices, MaterialKind::Black.into()).material.opacity = opacity;
    }

    /// A light, of which every other one has a mask.
    pub fn light(&mut self, rng: &mut Pcg32, vertices: [Vec3; 3], material: Material) {
        let emission = Some(Emission { radiance: self.input(rng, false), two_sided: true });
        let opacity = (rng.next_f32() < 0.5).then(|| self.input(rng, true));
        let shape = self.shape(rng, vertices, material);
        (shape.emission, shape.material.opacity) = (emission, opacity);
    }

    /// An environment, of which something stands out if there is to be a sun.
    pub fn sky(&mut self, rng: &mut Pcg32, sun: bool) {
        let map = self.spherical_map(rng, !sun);
        if sun {
            self.description.textures[map.texels].data[3 * 17..3 * 18].fill(30.0);
        }
        self.description.environment = Some(map);
    }

    /// A turned map, that may be the same in all directions.
    pub fn spherical_map(&mut self, rng: &mut Pcg32, constant: bool) -> SphericalMap {
        let size = if constant && rng.next_f32() < 0.1 { [1, 1] } else { [8, 5] };
        let texels = self.texture(rng, size, 3);
        let axis = anywhere(rng).normalize();
        let rotation = Mat3::from_axis_angle(axis, std::f32::consts::TAU * rng.next_f32());
        SphericalMap { texels, rotation }
    }
}

/// A scene that moves along a random direction in the space of all its numbers.
pub struct Moving {
    pub scene: Scene,
    pub layout: Layout,
    tangents: Vec<f64>,
}

impl Moving {
    pub fn new(rng: &mut Pcg32, description: SceneDescription) -> Moving {
        let shapes = 0..description.shapes.len();
        let mut slots: Vec<Slot> = shapes
            .flat_map(|i| [Slot::Vertices(i), Slot::Normals(i), Slot::Uvs(i), Slot::Colors(i)])
            .chain((0..description.textures.len()).map(Slot::Texels))
            .collect();
        for (i, light) in description.delta_lights.iter().enumerate() {
            slots.extend(light.arrays(i).into_iter().map(|(slot, _)| slot));
        }
        slots.push(Slot::EnvironmentRotation);
        let scene = Scene::new(description).unwrap();
        let layout = Layout::new(&scene, &slots);
        let mut tangents: Vec<f64> = (0..layout.size()).map(|_| f64::from(2.0 * rng.next_f32() - 1.0)).collect();
        if let Some(e) = &scene.description.environment {
            // Only what remains a rotation.
            let spin = anywhere(rng);
            let turned = Mat3::from_cols(
                spin.cross(e.rotation.x_axis),
                spin.cross(e.rotation.y_axis),
                spin.cross(e.rotation.z_axis),
            );
            let start = tangents.len() - 9;
            for (k, tangent) in tangents[start..].iter_mut().enumerate() {
                *tangent = f64::from(turned.row(k / 3)[k % 3]);
            }
        }
        Moving { scene, layout, tangents }
    }

    pub fn sums(&self) -> SparseSums {
        SparseSums::new(self.layout.size())
    }

    pub fn adjoints<'a>(&'a self, sums: &'a mut SparseSums) -> Adjoints<'a> {
        Adjoints::new(&self.scene, &self.layout, sums)
    }

    /// Asserts that the adjoints of the scene (`sums`), and others with the directions in which these move, say what the twin does.
    /// All but the twin is in single precision: errors are some 1e-7 of the largest terms, divided by cosines, by distances and by
    /// how narrow a lobe is (its 1 − cos² against α²), which makes up to 3e-5 of them; in four of 448,000 cases of reflected light, by 16 seeds and
    /// for all sorts of materials, it made more than 1e-4 and at most 2e-4. The seeds of the tests have none of these.
    pub fn assert_alike(
        &self,
        what: &dyn Fn() -> String,
        value: f32,
        sums: SparseSums,
        others: &[(Vec3, Vec3)],
        twin: Number,
    ) {
        let of_scene = dense(sums, self.layout.size()).into_iter().zip(&self.tangents).map(|(d, t)| d * t);
        let of_others = others.iter().flat_map(|(d, t)| d.to_array().into_iter().zip(t.to_array()));
        let terms: Vec<f64> = of_scene.chain(of_others.map(|(d, t)| f64::from(d) * f64::from(t))).collect();
        let (found, expected) = (terms.iter().sum::<f64>(), twin.partials[0]);
        let scale = terms.iter().map(|t| t.abs()).sum::<f64>().max(expected.abs());
        let difference = (f64::from(value) - twin.value).abs();
        assert!(difference <= 1e-4 * twin.value.abs() + 1e-6, "{}: {value} for {}", what(), twin.value);
        assert!((found - expected).abs() <= 1e-4 * scale, "{}: {found} for {expected} of {scale}", what());
    }

    fn number(&self, slot: Slot, i: usize, value: f32) -> Number {
        let k = self.layout.slots.iter().position(|s| *s == slot).unwrap();
        number(f64::from(value), self.tangents[self.layout.starts[k] + i])
    }

    fn vector(&self, slot: Slot, i: usize, value: Vec3) -> Vector {
        from_fn(|axis| self.number(slot, 3 * i + axis, value[axis]))
    }

    /// Every triangle has a shape of its own.
    fn mesh(&self, prim: PrimId) -> &Mesh {
        &self.scene.description.shapes[prim as usize].mesh
    }

    pub fn corners(&self, prim: PrimId) -> [Vector; 3] {
        from_fn(|i| self.vector(Slot::Vertices(prim as usize), i, self.mesh(prim).vertices[i]))
    }

    /// By the right-hand rule, twice as long as the triangle is large.
    pub fn normal(&self, prim: PrimId) -> Vector {
        let p = self.corners(prim);
        cross(minus(p[1], p[0]), minus(p[2], p[0]))
    }

    /// Where a line meets the plane of a triangle, and the barycentric coordinates there.
    pub fn hit(&self, prim: PrimId, [origin, dir]: [Vector; 2]) -> (Vector, [Number; 3]) {
        let (p, n) = (self.corners(prim), self.normal(prim));
        let x = plus(origin, times(dir, dot(n, minus(p[0], origin)) / dot(n, dir)));
        let area = |i: usize| dot(n, cross(minus(p[(i + 2) % 3], p[(i + 1) % 3]), minus(x, p[(i + 1) % 3])));
        (x, from_fn(|i| area(i) / dot(n, n)))
    }

    /// The vertex that a line finds: where `si` is now.
    pub fn vertex(&self, si: &SurfaceInteraction, line: [Vector; 2]) -> Vertex {
        let (p, b) = self.hit(si.prim, line);
        let ng = times(unit(self.normal(si.prim)), Dual::constant(f64::from(si.flip)));
        let smooth = self.mesh(si.prim).normals.as_ref().map(|normals| {
            let n = unit(mix(b, from_fn(|i| self.vector(Slot::Normals(si.prim as usize), i, normals[i]))));
            if dot(n, ng).value < 0.0 { n.map(|x| -x) } else { n }
        });
        let material = &self.scene.description.shapes[si.prim as usize].material;
        let mut inputs = [constants(Vec3::ZERO); MAX_INPUTS];
        type Covers<'a> = (&'a Option<SheenLayer>, &'a Option<ClearCoat>);
        let mut of_layer = |kind: &MaterialKind, grain: &Option<Grain>, (sheen, coat): Covers, from: usize| {
            for (value, (_, input)) in inputs[from..].iter_mut().zip(kind.inputs()) {
                *value = self.lookup(*input, si.prim, b);
            }
            if let Some(coat) = coat {
                let [weight, roughness] = [coat.weight, coat.roughness].map(|input| self.lookup(input, si.prim, b)[0]);
                (inputs[from + COVERS][0], inputs[from + COVERS][1]) = (weight, roughness);
            }
            if let Some(sheen) = sheen {
                inputs[from + SHEEN_COLOR] = self.lookup(sheen.color, si.prim, b);
                inputs[from + COVERS][2] = self.lookup(sheen.roughness, si.prim, b)[0];
            }
            if let Some(grain) = grain {
                let [anisotropy, turn] = [grain.anisotropy, grain.turn].map(|input| self.lookup(input, si.prim, b)[0]);
                inputs[from + GRAIN] = [anisotropy, turn, number(0.0, 0.0)];
            }
        };
        of_layer(&material.kind, &material.grain, (&material.sheen, &material.coat), 0);
        if let Some(blend) = &material.blend {
            of_layer(&blend.kind, &blend.grain, (&blend.sheen, &blend.coat), LAYER_INPUTS);
            inputs[BLEND_WEIGHT] = self.lookup(blend.weight, si.prim, b);
        }
        let ns = smooth.unwrap_or(ng);
        let axes = if material.needs_tangents() { self.axes(si, ns) } else { [constants(Vec3::ZERO); 2] };
        Vertex { p, b, ng, ns, axes, wi: line[1].map(|x| -x), smooth: smooth.is_some(), inputs }
    }

    /// Where u grows and where v falls, perpendicular to the normal `n`.
    fn axes(&self, si: &SurfaceInteraction, n: Vector) -> [Vector; 2] {
        let p = self.corners(si.prim);
        let corner = |i: usize| self.uv(si.prim, from_fn(|k| number(f64::from(u8::from(k == i)), 0.0)));
        let uv = [0, 1, 2].map(corner);
        let (p, uv) = ([minus(p[1], p[0]), minus(p[2], p[0])], [1, 2].map(|i| [0, 1].map(|k| uv[i][k] - uv[0][k])));
        // p = u ∂p/∂u + v ∂p/∂v along both edges, solved for the first.
        let area = uv[0][0] * uv[1][1] - uv[0][1] * uv[1][0];
        let by_u = times(minus(times(p[0], uv[1][1]), times(p[1], uv[0][1])), 1.0 / area);
        let tangent = unit(minus(by_u, times(n, dot(n, by_u))));
        let is_seen_from_behind = dot(self.normal(si.prim), n).value < 0.0;
        let falls = if (area.value > 0.0) == is_seen_from_behind { 1.0 } else { -1.0 };
        [tangent, times(cross(n, tangent), Dual::constant(falls))]
    }

    pub fn uv(&self, prim: PrimId, b: [Number; 3]) -> [Number; 2] {
        let Some(uvs) = &self.mesh(prim).uvs else { return [b[1], b[2]] };
        let at = |i: usize, axis: usize| b[i] * self.number(Slot::Uvs(prim as usize), 2 * i + axis, uvs[i][axis]);
        from_fn(|axis| at(0, axis) + at(1, axis) + at(2, axis))
    }

    pub fn lookup(&self, input: Input, prim: PrimId, b: [Number; 3]) -> Vector {
        let t = match input {
            Input::Texture(t) => t,
            Input::Tinted(t) => {
                let factors = [Input::Texture(t), Input::VertexColor].map(|factor| self.lookup(factor, prim, b));
                return from_fn(|c| factors[0][c] * factors[1][c]);
            }
            Input::VertexColor => {
                let colors = self.mesh(prim).colors.as_ref().unwrap();
                return mix(b, from_fn(|i| self.vector(Slot::Colors(prim as usize), i, colors[i])));
            }
        };
        let texture = &self.scene.description.textures[t];
        bilinear(texture, self.uv(prim, b), [texture.wrap; 2], |i| self.number(Slot::Texels(t), i, texture.data[i]))
    }

    /// What of a surface is there.
    pub fn opacity(&self, prim: PrimId, b: [Number; 3]) -> Number {
        let input = self.scene.description.shapes[prim as usize].material.opacity;
        input.map_or(Dual::constant(1.0), |input| self.lookup(input, prim, b)[0])
    }

    /// What masks let through along a line, over the probability of passing.
    pub fn pass(&self, crossings: &[MaskCrossing], line: [Vector; 2]) -> Number {
        let one = |c: &MaskCrossing| (1.0 - self.opacity(c.prim, self.hit(c.prim, line).1)) * f64::from(c.inv_choice);
        crossings.iter().fold(Dual::constant(1.0), |all, c| all * one(c))
    }

    pub fn emitted(&self, prim: PrimId, b: [Number; 3]) -> Vector {
        let emission = self.scene.description.shapes[prim as usize].emission.as_ref().unwrap();
        times(self.lookup(emission.radiance, prim, b), self.opacity(prim, b))
    }

    fn sky(&self) -> &SphericalMap {
        self.scene.description.environment.as_ref().unwrap()
    }

    /// The columns of a map's rotation.
    fn rotation(&self, slot: Slot, map: &SphericalMap) -> [Vector; 3] {
        let entry = |i: usize, j: usize| self.number(slot, 3 * i + j, map.rotation.col(j)[i]);
        from_fn(|j| from_fn(|i| entry(i, j)))
    }

    /// What a map holds in a direction of its own frame.
    fn texels(&self, map: &SphericalMap, local: Vector) -> Vector {
        let texture = &self.scene.description.textures[map.texels];
        equirectangular(texture, local, |i| self.number(Slot::Texels(map.texels), i, texture.data[i]))
    }

    /// A direction of the world in the environment's frame.
    pub fn in_map(&self, dir: Vector) -> Vector {
        self.rotation(Slot::EnvironmentRotation, self.sky()).map(|column| dot(column, dir))
    }

    /// A direction of the environment's frame in the world.
    pub fn in_world(&self, local: Vector) -> Vector {
        mix(local, self.rotation(Slot::EnvironmentRotation, self.sky()))
    }

    /// What the environment holds in a direction of its own frame.
    pub fn radiance(&self, local: Vector) -> Vector {
        self.texels(self.sky(), local)
    }

    /// What of it does not stand out, which does not change with the texels.
    pub fn base(&self, local: Vector) -> Vector {
        let peak: Option<&EnvironmentPeak> = self.scene.environment_peak.as_ref();
        let map = peak.map_or(&self.scene.description.textures[self.sky().texels], |peak| &peak.base);
        equirectangular(map, local, |i| Dual::constant(f64::from(map.data[i])))
    }

    /// Light of a point that keeps its place on its light, as it arrives at `p`: direction, geometry and power.
    pub fn arriving(&self, light: &LightSample, p: Vector) -> (Vector, Number, Vector) {
        let to = |y: Vector| (unit(minus(y, p)), dot(minus(y, p), minus(y, p)));
        let lights = &self.scene.description.delta_lights;
        match light.kind {
            LightKind::Area => {
                let (b, n) = (light.b.map(|b| Dual::constant(f64::from(b))), self.normal(light.prim));
                let (dir, r2) = to(mix(b, self.corners(light.prim)));
                // |cos| dA / r², of a light of today's area.
                let area = dot(n, n).sqrt().value;
                (
                    dir,
                    dot(n, dir).abs() / r2 / area,
                    self.emitted(light.prim, light.b.map(|b| Dual::constant(b.into()))),
                )
            }
            LightKind::Point(i) => {
                let (delta, i) = (&lights[i as usize], i as usize);
                let (dir, r2) = to(self.vector(Slot::LightPlacement(i), 0, delta.placement()));
                let falloff = delta.cone().map_or(Dual::constant(1.0), |cone| {
                    let axis = unit(self.vector(Slot::LightAxis(i), 0, cone.axis));
                    let [beam, cutoff] =
                        [(0, cone.beam), (1, cone.cutoff)].map(|(k, x)| self.number(Slot::LightCone(i), k, x));
                    // Half the angle to the axis is that of a rhombus: tan = |a − b| / |a + b|.
                    let (across, along) = (plus(axis, dir), minus(axis, dir));
                    let angle = 2.0 * dot(across, across).sqrt().atan2(dot(along, along).sqrt());
                    let s = (cutoff - angle) / (cutoff - beam);
                    if s.value > 1.0 { Dual::constant(1.0) } else { s * s * 3.0 - s * s * s * 2.0 }
                });
                let power = self.vector(Slot::LightPower(i), 0, delta.power());
                let power = delta.profile().map_or(power, |map| {
                    let away = dir.map(|x| -x);
                    let local = self.rotation(Slot::LightRotation(i), &map).map(|column| dot(column, away));
                    product(power, self.texels(&map, local))
                });
                (dir, falloff / r2, power)
            }
            LightKind::Directional(i) => {
                let delta = &lights[i as usize];
                let direction = unit(self.vector(Slot::LightPlacement(i as usize), 0, delta.placement()));
                let power = self.vector(Slot::LightPower(i as usize), 0, delta.power());
                (direction.map(|x| -x), Dual::constant(1.0), power)
            }
            LightKind::Environment => {
                let local = still(self.in_map(constants(light.y)));
                (self.in_world(local), Dual::constant(1.0), self.radiance(local))
            }
        }
    }

    /// What a line finds of a light.
    pub fn found(&self, light: &LightSample, line: [Vector; 2]) -> Vector {
        match light.kind {
            LightKind::Environment => self.radiance(self.in_map(line[1])),
            _ => self.emitted(light.prim, self.hit(light.prim, line).1),
        }
    }
}

/// Between the centres of texels: at a lookup within rounding of one of them the derivative would be anyone's guess, but seeds are
/// fixed, and there is none.
fn bilinear(texture: &Texture, uv: [Number; 2], wrap: [Wrap; 2], texel: impl Fn(usize) -> Number) -> Vector {
    let size = [texture.width, texture.height];
    let at: [Number; 2] = from_fn(|axis| uv[axis] * size[axis] as f64 - 0.5);
    let place = |axis: usize, i: f64| match wrap[axis] {
        Wrap::Repeat => i.rem_euclid(size[axis] as f64) as usize,
        Wrap::Clamp => i.clamp(0.0, (size[axis] - 1) as f64) as usize,
        Wrap::Mirror => {
            let (last, odd) = (size[axis] as f64 - 1.0, (i / size[axis] as f64).floor().rem_euclid(2.0) == 1.0);
            let i = i.rem_euclid(size[axis] as f64);
            (if odd { last - i } else { i }) as usize
        }
    };
    let mut sum = [Dual::constant(0.0); 3];
    for k in 0..4 {
        let corner: [f64; 2] = from_fn(|axis| at[axis].value.floor() + f64::from(k >> axis & 1));
        let weight = (1.0 - (at[0] - corner[0]).abs()) * (1.0 - (at[1] - corner[1]).abs());
        let index = (place(1, corner[1]) * texture.width + place(0, corner[0])) * texture.channels;
        let color: Vector = from_fn(|c| texel(if texture.channels == 1 { index } else { index + c }));
        sum = plus(sum, times(color, weight));
    }
    sum
}

fn equirectangular(map: &Texture, d: Vector, texel: impl Fn(usize) -> Number) -> Vector {
    let u = 0.5 + d[0].atan2(-d[2]) / std::f64::consts::TAU;
    let v = (d[0] * d[0] + d[2] * d[2]).sqrt().atan2(d[1]) / std::f64::consts::PI;
    bilinear(map, [u, v], [Wrap::Repeat, Wrap::Clamp], texel)
}

/// A point of a surface with everything shading needs.
pub struct Vertex {
    pub p: Vector,
    pub b: [Number; 3],
    pub ng: Vector,
    pub ns: Vector,
    /// Tangent and bitangent, of what has a grain.
    pub axes: [Vector; 2],
    pub wi: Vector,
    pub smooth: bool,
    pub inputs: [Vector; MAX_INPUTS],
}

impl Vertex {
    /// What arrives from `wi`, mirrored at the tangent plane if it is behind.
    fn front(&self) -> Vector {
        let ci = dot(self.ns, self.wi);
        if ci.value < 0.0 { minus(self.wi, times(self.ns, 2.0 * ci)) } else { self.wi }
    }

    /// BSDF times cosine towards `wo`, of one part or both.
    pub fn scattered(&self, material: &Material, part: Option<Part>, wo: Vector) -> Vector {
        // Lengths in single precision are off by 1e-7, which makes the half vector of nearly opposite directions wrong by 1e-5.
        let (wi, unit_wo) = (unit(self.wi), unit(wo));
        let cosines = [dot(self.ns, wi), dot(self.ns, unit_wo), dot(wi, unit_wo)];
        let along = [wi, unit_wo].map(|w| self.axes.map(|axis| dot(axis, w)));
        let [matte, lobe] = twins(material, cosines, along, &self.inputs);
        let f = match part {
            Some(Part::Diffuse) => matte,
            Some(Part::Specular) => lobe,
            None => plus(matte, lobe),
        };
        if self.smooth { times(f, self.terminator(wo)) } else { f }
    }

    pub fn albedo(&self, material: &Material) -> Vector {
        let of = |kind: &MaterialKind, a: Vector, b: Vector| match kind {
            MaterialKind::ConductorIor { .. } => from_fn(|c| twin_conductor(Dual::constant(1.0), a[c], b[c])),
            _ => a,
        };
        let v = &self.inputs;
        let own = of(&material.kind, v[0], v[1]);
        let Some(blend) = &material.blend else { return own };
        let weight = v[BLEND_WEIGHT][0];
        plus(times(own, 1.0 - weight), times(of(&blend.kind, v[LAYER_INPUTS], v[LAYER_INPUTS + 1]), weight))
    }

    /// Light fades out towards the horizon of the face.
    fn terminator(&self, wo: Vector) -> Number {
        let g = dot(self.ng, wo) / (dot(self.ns, wo) * dot(self.ng, self.ns));
        match g.value {
            x if x >= 1.0 => Dual::constant(1.0),
            x if x <= 0.0 => Dual::constant(0.0),
            _ => g + g * g - g * g * g,
        }
    }

    /// The direction of a perfect mirror, which is mirrored once more at the face if it would go below.
    pub fn mirrored(&self) -> (Vector, bool) {
        let at = |n: Vector, d: Vector| minus(times(n, 2.0 * dot(n, d)), d);
        let dir = at(self.ns, self.wi);
        let folded = dot(self.ng, dir).value < 0.0;
        (if folded { at(self.ng, dir).map(|x| -x) } else { dir }, folded)
    }

    /// A direction that is `wo` now and mirrored at a half vector that turns with the shading normal by the smallest rotation,
    /// and the density of directions over half vectors, which is 1 now.
    pub fn attached(&self, wo: Vec3) -> (Vector, Number) {
        let (front, was) = (self.front(), still(self.ns));
        let h = unit(plus(still(front), constants(wo)));
        // Rodrigues' formula for an axis k of length sin.
        let (k, cos) = (cross(was, self.ns), dot(was, self.ns));
        let h = plus(plus(times(h, cos), cross(k, h)), times(k, dot(k, h) / (1.0 + cos)));
        let half = dot(h, front);
        (minus(times(h, 2.0 * half), front), half / half.value)
    }
}
