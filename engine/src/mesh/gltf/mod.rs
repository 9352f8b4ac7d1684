//! Reads glTF 2.0 and GLB: the default scene in world space, without animation. Triangles with metallic-roughness materials, morph
//! targets with their default weights, skins with their joints at rest, lights without area, and cameras. Animations are not read.
//! `write` writes what is read.

mod accessor;
mod material;
mod parse;
mod skin;
pub(super) mod write;

use std::collections::HashMap;

use glam::{DMat3, DMat4, DVec3, Vec3, vec2};
use gltf::khr_lights_punctual::Kind;
use gltf::mesh::{Mode, Semantic};

use super::Mesh;
use super::load::{Loaded, LoadedCamera, LoadedLight, LoadedLightKind, LoadedPart, LoadedProjection, within_limits};
use super::reading::{Notes, Reading};

use accessor::Accessors;
use material::{Materials, placement};
use skin::Pose;

pub(super) fn decode(bytes: &[u8], reading: &mut Reading) -> Result<Loaded, String> {
    let file = parse::parse(bytes, &mut reading.notes)?;
    let scene = Walk::new(&file.document)?;
    // Counts vertices by the accessors, so that the memory for all nodes is requested before any is read.
    let (vertices, faces) = scene.size();
    within_limits(vertices, faces)?;
    reading.expect(vertices, faces)?;
    scene.tell(&mut reading.notes);
    let accessors = Accessors { document: &file.document, buffers: file.buffers(reading)? };
    let mut uses = HashMap::new();
    for mesh in scene.nodes.iter().filter_map(|(n, _)| n.mesh()) {
        *uses.entry(mesh.index()).or_default() += 1;
    }
    let mut reader = Reader { accessors, materials: Materials::default(), uses, known: HashMap::new() };
    let mut loaded = Loaded::default();
    for (node, transform) in &scene.nodes {
        if let Some(light) = node.light() {
            loaded.lights.extend(convert_light(&light, *transform, &mut reading.notes)?);
        }
        let Some(mesh) = node.mesh() else { continue };
        let weights = node.weights().or(mesh.weights()).unwrap_or(&[]);
        let pose = node.skin().map(|s| Pose::new(&s, &scene, &reader.accessors)).transpose()?;
        for primitive in mesh.primitives() {
            let name = node.name().or(mesh.name()).unwrap_or(reading.name).to_string();
            if let Some(mut part) = reader.part(&mesh, &primitive, name, weights, pose.as_ref(), reading)? {
                // A skinned mesh is placed by its joints; the transform of its node does not count.
                if pose.is_none() {
                    place(&mut part.mesh, *transform);
                }
                loaded.parts.push(part);
            }
        }
    }
    Ok(loaded)
}

/// The cameras of the default scene, and notes about what was not read.
pub(super) fn cameras(bytes: &[u8]) -> Result<(Vec<LoadedCamera>, Vec<String>), String> {
    let mut notes = Notes::default();
    let file = parse::parse(bytes, &mut notes)?;
    let scene = Walk::new(&file.document)?;
    let mut cameras = Vec::new();
    for (node, transform) in &scene.nodes {
        let Some(camera) = node.camera() else { continue };
        let name = node.name().or(camera.name()).unwrap_or_default().to_string();
        // The crate's `projection` panics if the member for the camera's type is missing, so it is not used.
        let json = file.document.as_json().cameras.get(camera.index());
        let (perspective, orthographic) =
            json.map_or((None, None), |c| (c.perspective.as_ref(), c.orthographic.as_ref()));
        let (projection, aspect) = match (perspective, orthographic) {
            (Some(p), _) => (LoadedProjection::Perspective { fov: f64::from(p.yfov) }, p.aspect_ratio.map(f64::from)),
            (None, Some(o)) => {
                let height = LoadedProjection::Orthographic { height: 2.0 * f64::from(o.ymag).abs() };
                (height, Some(f64::from(o.xmag / o.ymag).abs()))
            }
            (None, None) => continue,
        };
        let axes = DMat3::from_mat4(*transform);
        let (forward, up) = ((-axes.z_axis).normalize_or_zero(), axes.y_axis.normalize_or_zero());
        let up = (up - forward * up.dot(forward)).normalize_or_zero();
        if !(transform.is_finite() && forward != DVec3::ZERO && up != DVec3::ZERO) {
            return Err(format!("the camera “{name}” has no direction"));
        }
        if axes.determinant() < 0.0 {
            notes.about("cameras that mirror are shown unmirrored", format!("“{name}”"));
        }
        let position = transform.w_axis.truncate();
        let aspect = aspect.filter(|a| a.is_finite() && *a > 0.0);
        cameras.push(LoadedCamera { name, position, forward, up, projection, aspect });
    }
    Ok((cameras, notes.sentences()))
}

/// The nodes of the default scene with their transforms to world space.
struct Walk<'a> {
    document: &'a gltf::Document,
    nodes: Vec<(gltf::Node<'a>, DMat4)>,
    /// By node index of the file: its position among these nodes.
    place: Vec<Option<usize>>,
    /// By node of the file: its parent.
    parents: Vec<Option<usize>>,
}

impl<'a> Walk<'a> {
    fn new(document: &'a gltf::Document) -> Result<Walk<'a>, String> {
        let scene = document.default_scene().or(document.scenes().next());
        let roots: Vec<gltf::Node> = match &scene {
            Some(scene) => scene.nodes().collect(),
            None => document.nodes().collect(),
        };
        let mut visited = vec![false; document.nodes().count()];
        let mut stack: Vec<(gltf::Node, DMat4)> = roots.into_iter().rev().map(|n| (n, DMat4::IDENTITY)).collect();
        let mut nodes = Vec::new();
        let mut place = vec![None; visited.len()];
        let mut parents = vec![None; visited.len()];
        for node in document.nodes() {
            node.children().for_each(|child| parents[child.index()] = Some(node.index()));
        }
        while let Some((node, parent)) = stack.pop() {
            // A node may have one parent at most. This also rules out cycles.
            if std::mem::replace(&mut visited[node.index()], true) {
                if scene.is_some() {
                    return Err(format!("node {} of the glTF file has two parents", node.index()));
                }
                continue;
            }
            let transform = parent * local(&node);
            stack.extend(node.children().collect::<Vec<_>>().into_iter().rev().map(|child| (child, transform)));
            place[node.index()] = Some(nodes.len());
            nodes.push((node, transform));
        }
        Ok(Walk { document, nodes, place, parents })
    }

    /// The transform from a node to world space, also for a node outside of the scene.
    fn world(&self, node: &gltf::Node) -> Result<DMat4, String> {
        if let Some(place) = self.place[node.index()] {
            return Ok(self.nodes[place].1);
        }
        let mut transform = local(node);
        let mut at = node.index();
        for _ in 0..self.parents.len() {
            let Some(parent) = self.parents[at] else { return Ok(transform) };
            let node = self.document.nodes().nth(parent).ok_or("a node of the glTF file is missing")?;
            (transform, at) = (local(&node) * transform, parent);
        }
        Err(format!("node {} of the glTF file is among its own children", node.index()))
    }

    /// Numbers of vertices and triangles of all nodes, by the accessors.
    fn size(&self) -> (u64, u64) {
        let mut total = (0u64, 0u64);
        for primitive in self.nodes.iter().filter_map(|(n, _)| n.mesh()).flat_map(|m| m.primitives()) {
            let vertices = primitive.get(&Semantic::Positions).map_or(0, |a| a.count() as u64);
            let corners = primitive.indices().map_or(vertices, |a| a.count() as u64);
            let faces = if primitive.mode() == Mode::Triangles { corners / 3 } else { corners };
            total = (total.0.saturating_add(vertices), total.1.saturating_add(faces));
        }
        total
    }

    fn tell(&self, notes: &mut Notes) {
        let name = |name: Option<&str>, what: &str, i: usize| name.map_or(format!("{what} {i}"), |n| format!("“{n}”"));
        for a in self.document.animations() {
            let sentence = "animations are left out: everything is as it stands without them";
            notes.about(sentence, name(a.name(), "animation", a.index()));
        }
        let shown = self.document.default_scene().or(self.document.scenes().next());
        for extension in shown.iter().filter_map(|s| s.extensions()).flat_map(|e| e.keys()) {
            notes.about("extensions of the scene are left out", extension);
        }
        let shown = shown.map(|s| s.index());
        for s in self.document.scenes().filter(|s| Some(s.index()) != shown) {
            notes.about("scenes beside the default one are left out", name(s.name(), "scene", s.index()));
        }
        for (node, _) in &self.nodes {
            for extension in node.extensions().into_iter().flat_map(|e| e.keys()) {
                let whose = name(node.name(), "node", node.index());
                notes.about("extensions of nodes are left out", format!("{extension} of {whose}"));
            }
        }
    }
}

fn local(node: &gltf::Node) -> DMat4 {
    let columns = node.transform().matrix().map(|column| column.map(f64::from));
    DMat4::from_cols_array_2d(&columns)
}

/// Transforms a mesh to world space. If the transform is a reflection, the winding of the faces is reversed.
fn place(mesh: &mut Mesh, transform: DMat4) {
    let linear = DMat3::from_mat4(transform);
    mesh.vertices.iter_mut().for_each(|v| *v = transform.transform_point3(v.as_dvec3()).as_vec3());
    if let Some(normals) = &mut mesh.normals {
        let turned = cofactor(linear);
        normals.iter_mut().for_each(|n| *n = (turned * n.as_dvec3()).normalize_or_zero().as_vec3());
    }
    if linear.determinant() < 0.0 {
        mesh.faces.iter_mut().for_each(|f| f.swap(1, 2));
    }
}

/// The matrix for normals: the inverse transpose times the absolute value of the determinant. It is computed without a division, so that
/// it exists for singular matrices too, and keeps normals on the outside if `linear` is a reflection.
fn cofactor(linear: DMat3) -> DMat3 {
    let [x, y, z] = [linear.x_axis, linear.y_axis, linear.z_axis];
    let sign = if linear.determinant() < 0.0 { -1.0 } else { 1.0 };
    DMat3::from_cols(y.cross(z), z.cross(x), x.cross(y)) * sign
}

struct Reader<'a> {
    accessors: Accessors<'a>,
    materials: Materials,
    /// By mesh: the number of nodes that show it.
    uses: HashMap<usize, usize>,
    /// Geometry of primitives that several nodes show, by mesh and primitive, before morph targets and skins are applied.
    known: HashMap<(usize, usize), Mesh>,
}

impl Reader<'_> {
    fn part(
        &mut self,
        mesh: &gltf::Mesh,
        primitive: &gltf::Primitive,
        name: String,
        weights: &[f32],
        pose: Option<&Pose>,
        reading: &mut Reading,
    ) -> Result<Option<LoadedPart>, String> {
        if !matches!(primitive.mode(), Mode::Triangles | Mode::TriangleStrip | Mode::TriangleFan) {
            reading.notes.about("points and lines are left out", format!("“{name}”"));
            return Ok(None);
        }
        for extension in primitive.extensions().into_iter().flat_map(|e| e.keys()) {
            reading.notes.about("extensions of meshes are left out", format!("{extension} of “{name}”"));
        }
        if primitive.attributes().any(|(semantic, _)| matches!(semantic, Semantic::Colors(1..))) {
            reading.notes.about("vertex colours beside the first ones (COLOR_0) are left out", format!("“{name}”"));
        }
        if reading.materials() {
            tell_of_attributes(primitive, &name, &mut reading.notes);
        }
        let key = (mesh.index(), primitive.index());
        let mut mesh = match self.known.get(&key) {
            Some(mesh) => mesh.clone(),
            None => {
                let geometry = self.geometry(primitive, &name, reading)?;
                if self.uses.get(&mesh.index()).is_some_and(|&n| n > 1) {
                    self.known.insert(key, geometry.clone());
                }
                geometry
            }
        };
        self.morph(primitive, weights, &mut mesh, &name)?;
        if let Some(pose) = pose {
            pose.apply(primitive, &mut mesh, &name, &self.accessors)?;
        }
        let material = self.materials.material(&primitive.material(), &self.accessors, reading)?;
        Ok(Some(LoadedPart { name, mesh, material }))
    }

    fn geometry(&self, primitive: &gltf::Primitive, name: &str, reading: &mut Reading) -> Result<Mesh, String> {
        let accessors = &self.accessors;
        let triples = |accessor: gltf::Accessor| -> Result<Vec<Vec3>, String> {
            Ok(accessors.floats(&accessor, 3)?.chunks_exact(3).map(Vec3::from_slice).collect())
        };
        let vertices = match primitive.get(&Semantic::Positions) {
            Some(accessor) => triples(accessor)?,
            None => return Err(format!("a primitive of “{name}” has no positions")),
        };
        let indices: Vec<u32> = match primitive.indices() {
            Some(accessor) => accessors.integers(&accessor, 1)?,
            None => (0..vertices.len() as u32).collect(),
        };
        let normals = primitive.get(&Semantic::Normals).map(triples).transpose()?;
        let colors = match primitive.get(&Semantic::Colors(0)) {
            Some(accessor) => {
                let n = accessor.dimensions().multiplicity();
                if !(3..=4).contains(&n) {
                    return Err(format!("the colours of “{name}” have {n} components"));
                }
                let numbers = accessors.floats(&accessor, n)?;
                let is_shown = primitive.material().alpha_mode() != gltf::material::AlphaMode::Opaque;
                if n == 4 && is_shown && numbers.chunks_exact(4).any(|c| c[3] != 1.0) {
                    reading.notes.about("the alpha of vertex colours is left out", format!("“{name}”"));
                }
                Some(numbers.chunks_exact(n).map(Vec3::from_slice).collect())
            }
            None => None,
        };
        let (set, transform) = placement(&primitive.material());
        let uvs = match primitive.get(&Semantic::TexCoords(set)) {
            Some(accessor) => {
                let raw = accessors.floats(&accessor, 2)?;
                Some(raw.chunks_exact(2).map(|uv| transform.apply(vec2(uv[0], uv[1]))).collect())
            }
            None => None,
        };
        let mesh = Mesh { vertices, faces: triangles(primitive.mode(), &indices), normals, uvs, colors };
        mesh.validate().map_err(|e| format!("“{name}”: {e}"))?;
        // What is left out of a file is no reason to believe what cannot be.
        let count = mesh.vertices.len();
        match primitive.attributes().find(|(_, accessor)| accessor.count() != count) {
            Some((semantic, accessor)) => Err(format!(
                "“{name}”: the mesh has {count} vertices but {} of {}",
                accessor.count(),
                semantic.to_string()
            )),
            None => Ok(mesh),
        }
    }

    /// Adds the morph targets by their weights.
    fn morph(&self, primitive: &gltf::Primitive, weights: &[f32], mesh: &mut Mesh, name: &str) -> Result<(), String> {
        for (target, &weight) in primitive.morph_targets().zip(weights).filter(|(_, w)| **w != 0.0) {
            let add = |to: &mut [Vec3], accessor: Option<gltf::Accessor>| -> Result<(), String> {
                let Some(accessor) = accessor else { return Ok(()) };
                if accessor.count() != to.len() {
                    return Err(format!("a morph target of “{name}” has another number of vertices than the mesh"));
                }
                let by = self.accessors.floats(&accessor, 3)?;
                to.iter_mut().zip(by.chunks_exact(3)).for_each(|(v, d)| *v += weight * Vec3::from_slice(d));
                Ok(())
            };
            add(&mut mesh.vertices, target.positions())?;
            if let Some(normals) = &mut mesh.normals {
                add(normals, target.normals())?;
            }
        }
        Ok(())
    }
}

/// Tells of attributes of a primitive that its material may ask for, and that are not read.
fn tell_of_attributes(primitive: &gltf::Primitive, name: &str, notes: &mut Notes) {
    let material = primitive.material();
    let is_aimed = material.normal_texture().is_some() || material.extension_value(material::ANISOTROPY).is_some();
    let (set, _) = placement(&material);
    for (semantic, _) in primitive.attributes() {
        match semantic {
            Semantic::Tangents if is_aimed => notes
                .about("tangents (TANGENT) are left out: they are made from texture coordinates", format!("“{name}”")),
            Semantic::TexCoords(other) if other != set => {
                let sentence = "texture coordinates beside those of a material's first image are left out";
                notes.about(sentence, format!("TEXCOORD_{other} of “{name}”"));
            }
            _ => {}
        }
    }
}

fn triangles(mode: Mode, i: &[u32]) -> Vec<[u32; 3]> {
    match mode {
        Mode::TriangleStrip => i
            .windows(3)
            .enumerate()
            .map(|(k, w)| if k % 2 == 0 { [w[0], w[1], w[2]] } else { [w[1], w[0], w[2]] })
            .collect(),
        Mode::TriangleFan => i.windows(2).skip(1).map(|w| [i[0], w[0], w[1]]).collect(),
        _ => i.chunks_exact(3).map(|f| [f[0], f[1], f[2]]).collect(),
    }
}

/// A light of the extension KHR_lights_punctual. Candela and lux are taken as radiant intensity and irradiance, and nits as radiance.
fn convert_light(
    light: &gltf::khr_lights_punctual::Light,
    transform: DMat4,
    notes: &mut Notes,
) -> Result<Option<LoadedLight>, String> {
    let name = light.name().map_or_else(|| format!("light {}", light.index()), str::to_string);
    let intensity = Vec3::from(light.color()) * light.intensity();
    let direction = -DMat3::from_mat4(transform).z_axis;
    if !(intensity.is_finite() && transform.is_finite()) {
        return Err(format!("the light “{name}” of the glTF file has a number that is not finite"));
    }
    if intensity.min_element() < 0.0 {
        notes.about("lights of negative intensity are left out", format!("“{name}”"));
        return Ok(None);
    }
    if light.range().is_some() && !matches!(light.kind(), Kind::Directional) {
        notes.about(
            "the range of lights is left out: they fall off with the square of the distance",
            format!("“{name}”"),
        );
    }
    let kind = match light.kind() {
        Kind::Directional => LoadedLightKind::Directional,
        Kind::Point => LoadedLightKind::Point,
        Kind::Spot { inner_cone_angle, outer_cone_angle } => {
            let (beam, cutoff) = (f64::from(inner_cone_angle), f64::from(outer_cone_angle));
            if !(cutoff > 0.0 && cutoff <= std::f64::consts::PI && beam >= 0.0) {
                return Err(format!("the cone of the light “{name}” of the glTF file has no such angles"));
            }
            // A cone with a sharp edge is not differentiable, so it gets a narrow falloff.
            let widest = 0.99 * cutoff;
            if beam > widest {
                notes.about("cones of light with a sharp edge get a narrow soft one", format!("“{name}”"));
            }
            LoadedLightKind::Spot { beam: beam.min(widest), cutoff }
        }
    };
    let is_aimed = kind != LoadedLightKind::Point;
    if is_aimed && direction == DVec3::ZERO {
        return Err(format!("the light “{name}” of the glTF file has no direction"));
    }
    let direction = direction.normalize_or(DVec3::NEG_Z);
    Ok(Some(LoadedLight { name, kind, position: transform.w_axis.truncate(), direction, intensity }))
}
