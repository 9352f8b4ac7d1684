//! Where derivatives go. All requested slots lie in one flat array of numbers ([`Layout`]). Reverse mode sums derivatives into that array;
//! forward mode multiplies each by the tangent of its number and sums these products.

mod maps;

use glam::{DVec3, Vec2, Vec3};

use crate::ranks::Packed;
use crate::render::accel::PrimId;
use crate::render::edges::Edge;
use crate::render::sensor::CameraAdjoint;
use crate::render::{Input, MaterialKind, Scene, Shape, Slot};

/// The position of a slot that was not requested.
const NONE: u32 = u32::MAX;

/// Positions of the requested slots in one flat array.
#[derive(Clone, Debug)]
pub struct Layout {
    pub(crate) slots: Vec<Slot>,
    /// Position of each slot's first number, and the end of the last slot.
    pub starts: Vec<usize>,
    vertices: Vec<u32>,
    normals: Vec<u32>,
    uvs: Vec<u32>,
    colors: Vec<u32>,
    texels: Vec<u32>,
    light_placement: Vec<u32>,
    light_power: Vec<u32>,
    light_axis: Vec<u32>,
    light_cone: Vec<u32>,
    light_rotation: Vec<u32>,
    environment_rotation: u32,
    camera_origin: u32,
    camera_frame: u32,
    camera_scale: u32,
    camera_lens: u32,
    camera_distortion: u32,
    /// No requested slot moves anything, turns a normal or changes a refractive index, so that paths do not depend on the slots.
    pub is_static: bool,
    /// By shape: a requested slot is its refractive index, which turns what it refracts, or changes what its normal map tilts.
    turns: Vec<bool>,
    /// A requested slot turns the normals of a mirror or of a surface with narrow lobes, or changes a refractive index, and so moves what
    /// is seen by way of the surface.
    turns_reflections: bool,
}

impl Layout {
    /// The positions of these slots, one after the other, each with as many numbers as the scene has for it.
    pub fn new(scene: &Scene, slots: &[Slot]) -> Layout {
        let d = &scene.description;
        let refracts = |(i, shape): (usize, &Shape)| match shape.material.kind {
            MaterialKind::Dielectric { ior, .. } => slots.iter().any(|slot| slot.is_read_by(ior, i)),
            _ => false,
        };
        let tilts = |(i, shape): (usize, &Shape)| {
            let by = |slot: &Slot, map| slot.is_read_by(map, i) || *slot == Slot::Uvs(i);
            shape.material.normals.is_some_and(|map| slots.iter().any(|slot| by(slot, map)))
        };
        let turns: Vec<bool> = d.shapes.iter().enumerate().map(|shape| refracts(shape) || tilts(shape)).collect();
        let turns_normals = |i: usize| slots.iter().any(|slot| slot.opening() == Slot::Normals(i));
        let shapes = vec![NONE; d.shapes.len()];
        let lights = vec![NONE; d.delta_lights.len()];
        let mut layout = Layout {
            slots: slots.to_vec(),
            starts: vec![0],
            vertices: shapes.clone(),
            normals: shapes.clone(),
            uvs: shapes.clone(),
            colors: shapes,
            texels: vec![NONE; d.textures.len()],
            light_placement: lights.clone(),
            light_power: lights.clone(),
            light_axis: lights.clone(),
            light_cone: lights.clone(),
            light_rotation: lights,
            environment_rotation: NONE,
            camera_origin: NONE,
            camera_frame: NONE,
            camera_scale: NONE,
            camera_lens: NONE,
            camera_distortion: NONE,
            is_static: !turns.contains(&true)
                && !slots.iter().any(|s| s.moves_things() || matches!(s.opening(), Slot::Normals(_))),
            turns_reflections: d
                .shapes
                .iter()
                .enumerate()
                .any(|(i, shape)| (turns[i] || turns_normals(i)) && shape.material.may_follow_normals()),
            turns,
        };
        let mut start = 0;
        for slot in slots {
            let len = d.slot_len(*slot);
            if let Some(entry) = layout.entry(*slot).filter(|_| len > 0) {
                *entry = start as u32;
            }
            start += len;
            layout.starts.push(start);
        }
        layout
    }

    /// Splits the flat array into the slots.
    pub fn by_slot(&self, mut flat: Vec<f64>) -> Vec<Vec<f64>> {
        // The first slot keeps the array's memory, so that a single large slot is not copied; the array is shrunk to it.
        let mut parts: Vec<Vec<f64>> =
            self.starts[1..self.slots.len().max(1)].iter().rev().map(|&s| flat.split_off(s)).collect();
        flat.shrink_to_fit();
        parts.extend((!self.slots.is_empty()).then_some(flat));
        parts.reverse();
        parts
    }

    /// The position of a slot, to be set; `None` for slots of closing keyframes and the shutter, since estimators see one moment only.
    fn entry(&mut self, slot: Slot) -> Option<&mut u32> {
        Some(match slot {
            Slot::Vertices(i) => self.vertices.get_mut(i)?,
            Slot::Normals(i) => self.normals.get_mut(i)?,
            Slot::Uvs(i) => self.uvs.get_mut(i)?,
            Slot::Colors(i) => self.colors.get_mut(i)?,
            Slot::Texels(i) => self.texels.get_mut(i)?,
            Slot::LightPlacement(i) => self.light_placement.get_mut(i)?,
            Slot::LightPower(i) => self.light_power.get_mut(i)?,
            Slot::LightAxis(i) => self.light_axis.get_mut(i)?,
            Slot::LightCone(i) => self.light_cone.get_mut(i)?,
            Slot::LightRotation(i) => self.light_rotation.get_mut(i)?,
            Slot::EnvironmentRotation => &mut self.environment_rotation,
            Slot::CameraOrigin => &mut self.camera_origin,
            Slot::CameraFrame => &mut self.camera_frame,
            Slot::CameraScale => &mut self.camera_scale,
            Slot::CameraLens => &mut self.camera_lens,
            Slot::CameraDistortion => &mut self.camera_distortion,
            Slot::ClosingVertices(_)
            | Slot::ClosingNormals(_)
            | Slot::ClosingLightPlacement(_)
            | Slot::ClosingLightPower(_)
            | Slot::ClosingLightAxis(_)
            | Slot::ClosingLightCone(_)
            | Slot::ClosingLightRotation(_)
            | Slot::ClosingCameraOrigin
            | Slot::ClosingCameraFrame
            | Slot::ClosingCameraScale
            | Slot::ClosingCameraLens
            | Slot::CameraShutter => return None,
        })
    }

    /// Number of derivatives of all slots together.
    pub fn size(&self) -> usize {
        self.starts.last().copied().unwrap_or(0)
    }

    /// Whether a requested slot moves a shape's vertices, or turns its normals or what it refracts.
    pub fn moves(&self, shape: u32) -> bool {
        let asked = |slots: &[u32]| slots.get(shape as usize).is_some_and(|&start| start != NONE);
        asked(&self.vertices) || asked(&self.normals) || self.turns.get(shape as usize) == Some(&true)
    }

    /// Whether a requested slot moves camera rays or turns the environment.
    pub fn moves_view(&self) -> bool {
        let all = [
            self.camera_origin,
            self.camera_frame,
            self.camera_scale,
            self.camera_lens,
            self.camera_distortion,
            self.environment_rotation,
        ];
        all.iter().any(|&start| start != NONE)
    }

    /// Whether the environment's rotation is requested.
    pub fn turns_environment(&self) -> bool {
        self.environment_rotation != NONE
    }

    /// Whether a requested slot moves surfaces, the camera or what a mirror reflects, so that path vertices slide over surfaces.
    pub fn moves_points(&self) -> bool {
        let slides = |s: &Slot| !matches!(s, Slot::LightPlacement(_) | Slot::EnvironmentRotation);
        self.turns_reflections || self.slots.iter().any(|s| s.moves_things() && slides(s))
    }

    /// Whether a requested slot moves shapes, lights or the camera.
    pub fn moves_things(&self) -> bool {
        self.slots.iter().any(|s| s.moves_things())
    }

    /// Whether a requested slot can move a silhouette, a shadow or the mirror image of one, so that boundary terms are needed.
    pub fn moves_visibility(&self) -> bool {
        self.turns_reflections || self.moves_things()
    }
}

/// Takes derivatives: `value` is one sample's derivative in the number at `index` of the flat array. Whoever computes derivatives knows
/// a sink as a trait object: so all of that is compiled once, and not for each kind of sink.
pub trait Sink {
    /// Adds to the number at `index`.
    fn add(&mut self, index: usize, value: f32);
}

/// Reverse mode: the sums of one chunk of samples. Only blocks of numbers that received a derivative have memory, all of it contiguous.
/// So a chunk's cost depends on how many texels of a large texture it reaches, and not on the size of the texture.
pub struct SparseSums {
    /// Where in `sums` each block's numbers start, or [`NONE`].
    starts: Vec<u32>,
    /// The blocks that have memory, in the order of their memory in `sums`.
    blocks: Vec<u32>,
    sums: Vec<f64>,
}

/// Numbers in a block of [`SparseSums`]: a few texels. Larger blocks would be mostly zeros where a texture is finer than the samples.
const BLOCK: usize = 32;

impl SparseSums {
    /// Sums of `len` numbers, all zero.
    pub fn new(len: usize) -> SparseSums {
        SparseSums { starts: vec![NONE; len.div_ceil(BLOCK)], blocks: Vec::new(), sums: Vec::new() }
    }

    /// Adds all sums to `total`, which has the same length, and sets them to zero.
    pub fn drain_to(&mut self, total: &mut DenseSums) {
        for (&block, from) in self.blocks.iter().zip(self.sums.chunks_exact(BLOCK)) {
            total.add(block as usize, from);
            self.starts[block as usize] = NONE;
        }
        self.blocks.clear();
        self.sums.clear();
    }

    /// Its blocks, dealt to so many owners: block i goes to owner i modulo their number.
    pub fn deal(&self, owners: usize) -> Vec<Blocks> {
        let mut dealt = vec![Blocks::default(); owners];
        for (&block, sums) in self.blocks.iter().zip(self.sums.chunks_exact(BLOCK)) {
            let to = &mut dealt[block as usize % owners];
            to.0.push(block);
            to.1.extend(sums);
        }
        dealt
    }

    /// Gives memory to a block. Returns where it starts.
    #[cold]
    fn open(&mut self, block: usize) -> usize {
        let start = self.sums.len();
        self.starts[block] = start as u32;
        self.blocks.push(block as u32);
        self.sums.resize(start + BLOCK, 0.0);
        start
    }
}

/// Blocks of sums on their way to another process: their numbers, and the sums of each.
#[derive(Clone, Default)]
pub struct Blocks(pub Vec<u32>, Vec<f64>);

impl Packed for Blocks {
    fn pack(&self, to: &mut Vec<u8>) {
        self.0.pack(to);
        self.1.pack(to);
    }

    fn unpack(from: &mut &[u8]) -> Option<Blocks> {
        Some(Blocks(Vec::unpack(from)?, Vec::unpack(from)?))
    }
}

/// Reverse mode: the derivatives of all samples, in the layout's order.
pub struct DenseSums {
    data: Vec<f64>,
    /// Which blocks received anything. The first sums of a block are copied and not added: pages of zeros that were never written have no
    /// memory yet, and a page that is read before it is written is mapped twice by the operating system.
    reached: Vec<bool>,
}

impl DenseSums {
    /// Zeros for a layout of `len` numbers.
    pub fn new(len: usize) -> DenseSums {
        DenseSums { data: vec![0.0; len], reached: vec![false; len.div_ceil(BLOCK)] }
    }

    /// Number of derivatives.
    pub fn size(&self) -> usize {
        self.data.len()
    }

    /// All derivatives, in the layout's order.
    pub fn into_vec(self) -> Vec<f64> {
        self.data
    }

    /// Adds some blocks of sums.
    pub fn add_blocks(&mut self, Blocks(blocks, sums): &Blocks) {
        blocks.iter().zip(sums.chunks_exact(BLOCK)).for_each(|(block, sums)| self.add(*block as usize, sums));
    }

    /// Some of its blocks. What the last one has beyond the end is zero.
    pub fn blocks(&self, blocks: impl IntoIterator<Item = u32>) -> Blocks {
        let mut found = Blocks::default();
        for block in blocks {
            let from = &self.data[block as usize * BLOCK..];
            found.0.push(block);
            found.1.extend(&from[..from.len().min(BLOCK)]);
            found.1.resize(found.0.len() * BLOCK, 0.0);
        }
        found
    }

    /// Puts blocks in place of those that are there.
    pub fn set_blocks(&mut self, Blocks(blocks, sums): &Blocks) {
        for (&block, sums) in blocks.iter().zip(sums.chunks_exact(BLOCK)) {
            let to = &mut self.data[block as usize * BLOCK..];
            let len = to.len().min(BLOCK);
            to[..len].copy_from_slice(&sums[..len]);
            self.reached[block as usize] = true;
        }
    }

    fn add(&mut self, block: usize, sums: &[f64]) {
        let to = &mut self.data[block * BLOCK..];
        let len = to.len().min(BLOCK);
        let (to, sums) = (&mut to[..len], &sums[..len]);
        if std::mem::replace(&mut self.reached[block], true) {
            to.iter_mut().zip(sums).for_each(|(t, s)| *t += s);
        } else {
            to.copy_from_slice(sums);
        }
    }
}

impl Sink for SparseSums {
    #[inline]
    fn add(&mut self, index: usize, value: f32) {
        let block = index / BLOCK;
        let start = self.starts[block];
        let start = if start == NONE { self.open(block) } else { start as usize };
        self.sums[start + index % BLOCK] += f64::from(value);
    }
}

/// Forward mode: sums derivative · tangent along one or more directions in the space of all slots.
pub trait ForwardSink: Sink {
    /// Passes the sum of each direction to `to`, and sets it to zero.
    fn take(&mut self, to: impl FnMut(usize, f64));
}

/// Forward mode along one direction, whose tangent has the layout's order.
pub struct DirectionalDerivative<'a> {
    pub(crate) tangent: &'a [f32],
    pub(crate) sum: f64,
}

impl Sink for DirectionalDerivative<'_> {
    #[inline]
    fn add(&mut self, index: usize, value: f32) {
        self.sum += f64::from(value) * f64::from(self.tangent[index]);
    }
}

impl ForwardSink for DirectionalDerivative<'_> {
    #[inline]
    fn take(&mut self, mut to: impl FnMut(usize, f64)) {
        to(0, std::mem::take(&mut self.sum));
    }
}

/// The tangents of several directions as a sparse matrix: for each number of the layout its non-zero tangents.
pub struct Tangents {
    pub(crate) directions: usize,
    /// Start of each number's entries, and the end of the last.
    starts: Vec<usize>,
    /// Direction and tangent of each entry.
    entries: Vec<(u32, f32)>,
}

impl Tangents {
    /// From dense tangents, one for each direction, each with `size` numbers in the layout's order.
    pub fn new(dense: &[Vec<f32>], size: usize) -> Tangents {
        let mut tangents = Tangents { directions: dense.len(), starts: vec![0], entries: Vec::new() };
        for index in 0..size {
            let along = dense.iter().enumerate().map(|(k, t)| (k as u32, t[index]));
            tangents.entries.extend(along.filter(|(_, t)| *t != 0.0));
            tangents.starts.push(tangents.entries.len());
        }
        tangents
    }
}

/// Forward mode along several directions. Adding a derivative takes as many operations as directions have a non-zero tangent there.
pub struct DirectionalDerivatives<'a> {
    tangents: &'a Tangents,
    sums: Vec<f64>,
}

impl<'a> DirectionalDerivatives<'a> {
    /// Sums of zero along each of the directions.
    pub fn new(tangents: &'a Tangents) -> Self {
        DirectionalDerivatives { tangents, sums: vec![0.0; tangents.directions] }
    }
}

impl Sink for DirectionalDerivatives<'_> {
    #[inline]
    fn add(&mut self, index: usize, value: f32) {
        let value = f64::from(value);
        let starts = &self.tangents.starts;
        for (direction, tangent) in &self.tangents.entries[starts[index]..starts[index + 1]] {
            self.sums[*direction as usize] += value * f64::from(*tangent);
        }
    }
}

impl ForwardSink for DirectionalDerivatives<'_> {
    fn take(&mut self, mut to: impl FnMut(usize, f64)) {
        for (direction, sum) in self.sums.iter_mut().enumerate() {
            to(direction, std::mem::take(sum));
        }
    }
}

/// Turns adjoints of quantities of the scene (a point of a surface, a normal, a radiance) into derivatives in the requested slots.
pub struct Adjoints<'a> {
    pub(crate) scene: &'a Scene,
    pub(crate) layout: &'a Layout,
    sink: &'a mut dyn Sink,
    pub(crate) camera: CameraAdjoint,
}

impl<'a> Adjoints<'a> {
    /// Adjoints that go to a sink, for a scene and the requested slots.
    pub fn new(scene: &'a Scene, layout: &'a Layout, sink: &'a mut dyn Sink) -> Self {
        Adjoints { scene, layout, sink, camera: CameraAdjoint::default() }
    }

    #[inline]
    fn add3(&mut self, start: u32, i: usize, d: Vec3) {
        if start != NONE {
            let at = start as usize + 3 * i;
            self.sink.add(at, d.x);
            self.sink.add(at + 1, d.y);
            self.sink.add(at + 2, d.z);
        }
    }

    fn add_all<const N: usize>(&mut self, start: u32, d: [f32; N]) {
        if start != NONE {
            for (i, d) in d.into_iter().enumerate() {
                self.sink.add(start as usize + i, d);
            }
        }
    }

    /// Adjoint of one vertex position.
    #[inline]
    pub fn vertex(&mut self, shape: u32, vertex: u32, d: Vec3) {
        self.add3(self.layout.vertices[shape as usize], vertex as usize, d);
    }

    #[inline]
    pub(crate) fn wants_vertices(&self, shape: u32) -> bool {
        self.layout.vertices[shape as usize] != NONE
    }

    /// Adjoint of a material point of a primitive: a point with fixed barycentric coordinates `b`.
    #[inline]
    pub fn material_point(&mut self, prim: PrimId, b: [f32; 3], d: Vec3) {
        let id = self.scene.prims[prim as usize];
        if !self.wants_vertices(id.shape) {
            return;
        }
        let face = self.scene.description.shapes[id.shape as usize].mesh.faces[id.face as usize];
        for (v, b) in face.into_iter().zip(b).filter(|(_, b)| *b != 0.0) {
            self.vertex(id.shape, v, d * b);
        }
    }

    /// Adjoint of an edge's point at parameter `s`; `d` is perpendicular to the edge. A point of a mesh edge is a material point of its
    /// faces, one of which is `face`. A point at which two surfaces cross stays in the planes of both: n·(ṗ − V) = 0 with the normal n of
    /// either plane and the velocity V of its material point there. So of d = α n_A + β n_B one surface gets α n_A, the other β n_B.
    pub fn edge_point(&mut self, edge: &Edge, face: usize, s: f32, d: Vec3) {
        if !edge.crossing {
            return self.material_point(edge.faces[face].prim, edge.barycentric(face, s, 0.0), d);
        }
        let planes = [0, 2]; // one half of each surface
        let [a, b] = planes.map(|i| {
            let [p0, p1, p2] = self.scene.corners(edge.faces[i].prim).map(|p| p.as_dvec3());
            (p1 - p0).cross(p2 - p0).normalize_or_zero()
        });
        let (d, cos, sin2) = (d.as_dvec3(), a.dot(b), a.cross(b).length_squared());
        let share = |n: DVec3, other: DVec3| n * ((n.dot(d) - cos * other.dot(d)) / sin2);
        for (i, d) in planes.into_iter().zip([share(a, b), share(b, a)]) {
            self.material_point(edge.faces[i].prim, edge.barycentric(i, s, 0.0), d.as_vec3());
        }
    }

    /// Adjoints of the three corners of a primitive.
    #[inline]
    pub fn corners(&mut self, prim: PrimId, d: [Vec3; 3]) {
        let id = self.scene.prims[prim as usize];
        let face = self.scene.description.shapes[id.shape as usize].mesh.faces[id.face as usize];
        for (v, d) in face.into_iter().zip(d) {
            self.vertex(id.shape, v, d);
        }
    }

    /// Adjoint of a primitive's unit normal, which has the direction (v1 − v0) × (v2 − v0).
    pub fn geometric_normal(&mut self, prim: PrimId, d_n: Vec3) {
        let id = self.scene.prims[prim as usize];
        if d_n == Vec3::ZERO || !self.wants_vertices(id.shape) {
            return;
        }
        let [p0, p1, p2] = self.scene.corners(prim);
        let n = (p1 - p0).cross(p2 - p0);
        let length = n.length();
        if length <= 0.0 {
            return;
        }
        let unit = n / length;
        let m = (d_n - unit * unit.dot(d_n)) / length;
        let d1 = (p2 - p0).cross(m);
        let d2 = m.cross(p1 - p0);
        self.corners(prim, [-d1 - d2, d1, d2]);
    }

    /// Adjoint of a primitive's area: ∂A/∂v_i = ½ n × (v_{i+2} − v_{i+1}).
    pub fn area(&mut self, prim: PrimId, d_area: f32) {
        let id = self.scene.prims[prim as usize];
        if !self.wants_vertices(id.shape) {
            return;
        }
        let [p0, p1, p2] = self.scene.corners(prim);
        let n = (p1 - p0).cross(p2 - p0).normalize_or_zero() * (0.5 * d_area);
        self.corners(prim, [n.cross(p2 - p1), n.cross(p0 - p2), n.cross(p1 - p0)]);
    }

    /// Adjoint of the interpolated vertex normal Σ b_i n_i, before normalisation; returns the adjoint of b.
    pub fn interpolated_normal(&mut self, prim: PrimId, b: [f32; 3], d: Vec3) -> [f32; 3] {
        let id = self.scene.prims[prim as usize];
        let mesh = &self.scene.description.shapes[id.shape as usize].mesh;
        let Some(normals) = &mesh.normals else { return [0.0; 3] };
        let face = mesh.faces[id.face as usize];
        let start = self.layout.normals[id.shape as usize];
        for (v, b) in face.into_iter().zip(b) {
            self.add3(start, v as usize, d * b);
        }
        face.map(|v| normals[v as usize].dot(d))
    }

    /// Adjoint of the interpolated tangent of a shape with a normal map or a grain; returns the adjoint of b.
    pub fn tangent(&mut self, prim: PrimId, b: [f32; 3], d: Vec3) -> [f32; 3] {
        let scene = self.scene;
        let id = scene.prims[prim as usize];
        let Some(tangents) = &scene.tangents[id.shape as usize] else { return [0.0; 3] };
        let mesh = &scene.description.shapes[id.shape as usize].mesh;
        let face = mesh.faces[id.face as usize];
        let start = self.layout.uvs[id.shape as usize];
        if self.wants_vertices(id.shape) || start != NONE {
            for (v, b) in face.into_iter().zip(b) {
                tangents.scatter(mesh, v, d * b, |v, d_p, d_v| {
                    self.vertex(id.shape, v, d_p);
                    if start != NONE {
                        self.sink.add(start as usize + 2 * v as usize + 1, d_v);
                    }
                });
            }
        }
        face.map(|v| tangents.by_vertex[v as usize].dot(d))
    }

    /// Adjoint of the interpolated texture coordinates; returns the adjoint of b.
    pub fn uv(&mut self, prim: PrimId, b: [f32; 3], d: Vec2) -> [f32; 3] {
        let id = self.scene.prims[prim as usize];
        let mesh = &self.scene.description.shapes[id.shape as usize].mesh;
        let Some(uvs) = &mesh.uvs else { return [0.0, d.x, d.y] };
        let face = mesh.faces[id.face as usize];
        let start = self.layout.uvs[id.shape as usize];
        if start != NONE {
            for (v, b) in face.into_iter().zip(b) {
                let at = start as usize + 2 * v as usize;
                self.sink.add(at, d.x * b);
                self.sink.add(at + 1, d.y * b);
            }
        }
        face.map(|v| uvs[v as usize].dot(d))
    }

    /// Adjoint of an input's value at a point of a primitive. Returns the adjoint of b; if the point does not slide over the surface
    /// (`slides`) and texture coordinates are not requested, that of a texture is not computed and zero.
    pub fn input(&mut self, input: Input, prim: PrimId, b: [f32; 3], d: Vec3, slides: bool) -> [f32; 3] {
        match input {
            Input::Texture(t) => {
                let texture = &self.scene.description.textures[t];
                let start = self.layout.texels[t];
                if texture.is_constant() {
                    if start != NONE {
                        let at = start as usize;
                        if texture.channels == 1 {
                            self.sink.add(at, d.x + d.y + d.z);
                        } else {
                            self.add3(start, 0, d);
                        }
                    }
                    return [0.0; 3];
                }
                let uv = self.scene.uv(prim, b);
                let still = !slides && self.layout.uvs[self.scene.prims[prim as usize].shape as usize] == NONE;
                let mut d_uv = Vec2::ZERO;
                // Which levels of a mip map are read is not differentiated.
                let lod = self.scene.level_of_detail(texture, prim, b);
                for (footprint, weight) in texture.footprints(uv, lod) {
                    if weight == 0.0 {
                        continue;
                    }
                    let d = d * weight;
                    if start != NONE {
                        let sink = &mut *self.sink;
                        texture.scatter_footprint(&footprint, d, |i, v| sink.add(start as usize + i, v));
                    }
                    if !still {
                        let [du, dv] = texture.uv_gradient(&footprint);
                        d_uv += Vec2::new(du.dot(d), dv.dot(d));
                    }
                }
                if still { [0.0; 3] } else { self.uv(prim, b, d_uv) }
            }
            Input::VertexColor => {
                let id = self.scene.prims[prim as usize];
                let mesh = &self.scene.description.shapes[id.shape as usize].mesh;
                let Some(colors) = &mesh.colors else { return [0.0; 3] };
                let face = mesh.faces[id.face as usize];
                let start = self.layout.colors[id.shape as usize];
                for (v, b) in face.into_iter().zip(b) {
                    self.add3(start, v as usize, d * b);
                }
                face.map(|v| colors[v as usize].dot(d))
            }
            // The value is a product: the adjoint of each factor is `d` times the other factor.
            Input::Tinted(t) => {
                let (texture, tint) = (Input::Texture(t), Input::VertexColor);
                let (value, color) = (self.scene.lookup(texture, prim, b), self.scene.lookup(tint, prim, b));
                let by_texture = self.input(texture, prim, b, d * color, slides);
                let by_color = self.input(tint, prim, b, d * value, slides);
                std::array::from_fn(|k| by_texture[k] + by_color[k])
            }
        }
    }

    /// Adjoint of a delta light's position, or of its direction before normalisation.
    pub fn light_placement(&mut self, light: u32, d: Vec3) {
        self.add3(self.layout.light_placement[light as usize], 0, d);
    }

    /// Adjoint of a delta light's intensity or irradiance.
    pub fn light_power(&mut self, light: u32, d: Vec3) {
        self.add3(self.layout.light_power[light as usize], 0, d);
    }

    /// Adjoint of a spot light's axis before normalisation, and of its beam and cutoff angles.
    pub fn light_cone(&mut self, light: u32, d_axis: Vec3, d_angles: [f32; 2]) {
        self.add3(self.layout.light_axis[light as usize], 0, d_axis);
        self.add_all(self.layout.light_cone[light as usize], d_angles);
    }

    /// Passes the camera's adjoint, which was summed up so far, to the sink and sets it to zero.
    pub fn flush_camera(&mut self) {
        let c = std::mem::take(&mut self.camera);
        self.add3(self.layout.camera_origin, 0, c.origin);
        for (i, row) in c.frame.into_iter().enumerate() {
            self.add3(self.layout.camera_frame, i, row);
        }
        self.add_all(self.layout.camera_scale, c.scale);
        self.add_all(self.layout.camera_lens, c.lens);
        self.add_all(self.layout.camera_distortion, c.distortion);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Pcg32;

    #[test]
    fn what_is_summed_in_blocks_reaches_its_place() {
        // The last block is not full, and some numbers receive nothing.
        const LEN: usize = 5 * BLOCK + 3;
        let mut rng = Pcg32::new(3);
        let (mut sums, mut total) = (SparseSums::new(LEN), DenseSums::new(LEN));
        let mut expected = vec![0.0; LEN];
        for _chunk in 0..3 {
            let mut chunk = vec![0.0; LEN];
            for _ in 0..20 {
                let index = rng.next_u32() as usize % LEN;
                let value = rng.next_f32() - 0.5;
                sums.add(index, value);
                chunk[index] += f64::from(value);
            }
            sums.add(LEN - 1, 1.0);
            chunk[LEN - 1] += 1.0;
            sums.drain_to(&mut total);
            expected.iter_mut().zip(&chunk).for_each(|(e, c)| *e += c);
        }
        sums.drain_to(&mut total);
        let found = total.into_vec();
        assert_eq!(found, expected);
        assert!(found.contains(&0.0) && found[LEN - 1] >= 2.0);
    }
}
