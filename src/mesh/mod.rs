//! Triangle meshes: the value type, built-in shapes, operations with their derivatives, files.

use glam::{Vec2, Vec3};

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
