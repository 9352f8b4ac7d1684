//! Triangle meshes: the value type, built-in shapes, operations with their derivatives, files.

pub mod load;
pub mod nearest;
pub mod ops;
pub mod save;
pub mod shapes;

mod gltf;
mod mtl;
mod obj;
mod ply;
mod polygon;
mod reading;
mod stl;
mod teapot;

use glam::{Vec2, Vec3};
use thiserror::Error;

use crate::memory::Shortage;

/// An indexed triangle mesh. `normals`, `uvs` and `colors`, where given, have one entry per vertex.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mesh {
    /// Positions, length units.
    pub vertices: Vec<Vec3>,
    /// Vertex indices, counter-clockwise seen from the outside (right-hand-rule normal).
    pub faces: Vec<[u32; 3]>,
    /// Shading normals (need not be unit length); `None` means flat shading.
    pub normals: Option<Vec<Vec3>>,
    /// Texture coordinates.
    pub uvs: Option<Vec<Vec2>>,
    /// Linear RGB vertex colours.
    pub colors: Option<Vec<Vec3>>,
}

/// Errors of meshes, of built-in shapes and of mesh files.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum MeshError {
    /// A number given to a built-in shape is out of its range.
    #[error("{name} must be {expected}, not {found}")]
    Argument {
        /// Name of the argument.
        name: &'static str,
        /// Its range, in words.
        expected: &'static str,
        /// The value given.
        found: String,
    },
    /// A face refers to a vertex that does not exist.
    #[error("face {face} uses vertex {index}, but the mesh has {vertices} vertices (0 to {})", vertices.saturating_sub(1))]
    IndexOutOfRange {
        /// Index of the face.
        face: usize,
        /// Index of the vertex, from 0.
        index: u32,
        /// How many vertices there are.
        vertices: usize,
    },
    /// A position is infinite or NaN.
    #[error("vertex {vertex} (counted from 0) is not finite: [{}, {}, {}]", position[0], position[1], position[2])]
    NotFinite {
        /// Index of the first such vertex.
        vertex: usize,
        /// Its x, y and z.
        position: [f32; 3],
    },
    /// The number of normals, texture coordinates or colours differs from the number of vertices.
    #[error("the mesh has {vertices} vertices but {count} {what}")]
    AttributeCount {
        /// `normals`, `uvs` or `colors`.
        what: &'static str,
        /// How many of them there are.
        count: usize,
        /// How many vertices there are.
        vertices: usize,
    },
    /// A normal, texture coordinate or colour is infinite or NaN.
    #[error("{what} of vertex {vertex} (counted from 0) are not finite")]
    AttributeNotFinite {
        /// `normals`, `uvs` or `colors`.
        what: &'static str,
        /// Index of the first such vertex.
        vertex: usize,
    },
    /// A mesh with more triangles or vertices than are supported.
    #[error("{what} would have {count} triangles, more than the limit of {limit}")]
    TooLarge {
        /// The mesh, in words.
        what: &'static str,
        /// How many triangles it would have.
        count: u64,
        /// How many it may have: [`MAX_ELEMENTS`] or [`MAX_BUILT`].
        limit: u64,
    },
    /// There is not enough memory.
    #[error("{0}")]
    Memory(#[from] Shortage),
    /// A file that could not be read.
    #[error("{path}: {message}")]
    File {
        /// Which file.
        path: String,
        /// The reason, in words.
        message: String,
    },
    /// The extension of a file is none of a supported mesh format.
    #[error("{path}: {} hold no mesh that can be read here; supported are {}", files_of(extension), load::EXTENSIONS.map(|e| format!(".{e}")).join(", "))]
    UnsupportedExtension {
        /// Which file.
        path: String,
        /// The extension, without the dot.
        extension: String,
    },
}

/// Files with an extension, in words.
pub(crate) fn files_of(extension: &str) -> String {
    if extension.is_empty() {
        "files without an ending".to_owned()
    } else {
        format!("files ending in “.{extension}”")
    }
}

/// Most vertices or faces of a mesh from a file, or of merged meshes.
pub const MAX_ELEMENTS: u64 = 1 << 27;

/// Most triangles of a built-in or subdivided mesh. More would only exhaust the memory.
pub const MAX_BUILT: u64 = 10_000_000;

impl Mesh {
    /// A mesh that has positions and faces only; an error if it is not valid.
    pub fn new(vertices: Vec<Vec3>, faces: Vec<[u32; 3]>) -> Result<Mesh, MeshError> {
        let mesh = Mesh { vertices, faces, ..Mesh::default() };
        mesh.validate()?;
        Ok(mesh)
    }

    /// Checks that indices are in range, that all numbers are finite and that attributes have one entry per vertex. Degenerate triangles
    /// are allowed (they have no area and are never hit), and so is a mesh without triangles.
    pub fn validate(&self) -> Result<(), MeshError> {
        let vertices = self.vertices.len();
        for (face, indices) in self.faces.iter().enumerate() {
            if let Some(&index) = indices.iter().find(|&&i| i as usize >= vertices) {
                return Err(MeshError::IndexOutOfRange { face, index, vertices });
            }
        }
        if let Some(vertex) = self.vertices.iter().position(|p| !p.is_finite()) {
            return Err(MeshError::NotFinite { vertex, position: self.vertices[vertex].to_array() });
        }
        check_attribute("normals", self.normals.as_deref(), vertices, |n| n.is_finite())?;
        check_attribute("uvs", self.uvs.as_deref(), vertices, |uv| uv.is_finite())?;
        check_attribute("colors", self.colors.as_deref(), vertices, |c| c.is_finite())
    }

    /// Corner positions of a face.
    pub fn triangle(&self, face: usize) -> [Vec3; 3] {
        self.faces[face].map(|i| self.vertices[i as usize])
    }
}

fn check_attribute<T>(
    what: &'static str,
    values: Option<&[T]>,
    vertices: usize,
    finite: impl Fn(&T) -> bool,
) -> Result<(), MeshError> {
    let Some(values) = values else { return Ok(()) };
    if values.len() != vertices {
        return Err(MeshError::AttributeCount { what, count: values.len(), vertices });
    }
    match values.iter().position(|v| !finite(v)) {
        Some(vertex) => Err(MeshError::AttributeNotFinite { what, vertex }),
        None => Ok(()),
    }
}
