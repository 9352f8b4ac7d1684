//! Triangle meshes: the value type, built-in shapes, operations with their derivatives, files.

#![deny(missing_docs)]

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

/// What can be wrong with a mesh, a request for one, or a file that holds one.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum MeshError {
    /// A number given to a built-in shape makes no such shape.
    #[error("{name} must be {expected}, not {found}")]
    Argument {
        /// Of which argument.
        name: &'static str,
        /// What it may be, in words.
        expected: &'static str,
        /// What it is.
        found: String,
    },
    /// A face has a corner that is no vertex.
    #[error("face {face} uses vertex {index}, but the mesh has {vertices} vertices (0 to {})", vertices.saturating_sub(1))]
    IndexOutOfRange {
        /// Index of the face.
        face: usize,
        /// The vertex it asks for, counted from 0.
        index: u32,
        /// How many vertices there are.
        vertices: usize,
    },
    /// A position is infinite or not a number.
    #[error("vertex {vertex} is not finite: [{}, {}, {}]", position[0], position[1], position[2])]
    NotFinite {
        /// Index of the first such vertex.
        vertex: usize,
        /// Its x, y and z.
        position: [f32; 3],
    },
    /// There is not one normal, texture coordinate or colour for each vertex.
    #[error("the mesh has {vertices} vertices but {count} {what}")]
    AttributeCount {
        /// `normals`, `uvs` or `colors`.
        what: &'static str,
        /// How many of them there are.
        count: usize,
        /// How many vertices there are.
        vertices: usize,
    },
    /// A normal, texture coordinate or colour is infinite or not a number.
    #[error("{what} of vertex {vertex} are not finite")]
    AttributeNotFinite {
        /// `normals`, `uvs` or `colors`.
        what: &'static str,
        /// Index of the first such vertex.
        vertex: usize,
    },
    /// A mesh of more triangles (or vertices) than an index can name or a machine can hold.
    #[error("{what} would have {count} triangles, more than the limit of {limit}")]
    TooLarge {
        /// Which mesh.
        what: &'static str,
        /// How many triangles it would have.
        count: u64,
        /// How many it may have: [`MAX_ELEMENTS`] or [`MAX_BUILT`].
        limit: u64,
    },
    /// It would take more memory than there is.
    #[error("{0}")]
    Memory(#[from] Shortage),
    /// A file that could not be read.
    #[error("{path}: {message}")]
    File {
        /// Which file.
        path: String,
        /// What is wrong with it, in words.
        message: String,
    },
    /// The name of a file ends in what is no format of meshes here.
    #[error("{path}: files ending in “.{extension}” hold no mesh that can be read here; supported are {}", load::EXTENSIONS.map(|e| format!(".{e}")).join(", "))]
    UnsupportedExtension {
        /// Which file.
        path: String,
        /// The end of its name, without the dot.
        extension: String,
    },
}

/// The most vertices or faces that a file, or meshes merged, may have.
pub const MAX_ELEMENTS: u64 = 1 << 27;

/// The most triangles of a built-in or subdivided mesh: more would only exhaust the memory.
pub const MAX_BUILT: u64 = 10_000_000;

impl Mesh {
    /// A mesh of positions and faces alone, checked.
    pub fn new(vertices: Vec<Vec3>, faces: Vec<[u32; 3]>) -> Result<Mesh, MeshError> {
        let mesh = Mesh { vertices, faces, ..Mesh::default() };
        mesh.validate()?;
        Ok(mesh)
    }

    /// Indices in range, everything finite, one attribute per vertex. Degenerate triangles are allowed (they have no
    /// area and are never hit); so is a mesh without any triangle.
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
