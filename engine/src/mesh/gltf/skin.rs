//! Skins at rest: each vertex is transformed by its joints, without animation.

use glam::{DMat3, DMat4, DVec3};
use gltf::mesh::Semantic;

use crate::mesh::Mesh;

use super::accessor::Accessors;
use super::{Walk, cofactor};

/// For each joint of a skin: the transform from the bind pose of a vertex to world space.
pub(super) struct Pose {
    joints: Vec<DMat4>,
}

impl Pose {
    pub fn new(skin: &gltf::Skin, scene: &Walk, accessors: &Accessors) -> Result<Pose, String> {
        let name = skin.name().map_or_else(|| format!("skin {}", skin.index()), |n| format!("skin “{n}”"));
        let inverse: Option<Vec<DMat4>> = match skin.inverse_bind_matrices() {
            Some(accessor) => {
                let numbers = accessors.floats(&accessor, 16)?;
                let matrix = |m: &[f32]| DMat4::from_cols_array(&std::array::from_fn(|i| f64::from(m[i])));
                Some(numbers.chunks_exact(16).map(matrix).collect())
            }
            None => None,
        };
        let mut joints = Vec::new();
        for (k, joint) in skin.joints().enumerate() {
            let bind = match &inverse {
                Some(all) => *all.get(k).ok_or(format!("{name} of the glTF file has fewer matrices than joints"))?,
                None => DMat4::IDENTITY,
            };
            joints.push(scene.world(&joint)? * bind);
        }
        Ok(Pose { joints })
    }

    /// Transforms the vertices of a primitive to world space.
    pub fn apply(
        &self,
        primitive: &gltf::Primitive,
        mesh: &mut Mesh,
        name: &str,
        accessors: &Accessors,
    ) -> Result<(), String> {
        let count = mesh.vertices.len();
        let mut sets = Vec::new();
        for set in 0.. {
            let (Some(joints), Some(weights)) =
                (primitive.get(&Semantic::Joints(set)), primitive.get(&Semantic::Weights(set)))
            else {
                break;
            };
            let (joints, weights) = (accessors.integers(&joints, 4)?, accessors.floats(&weights, 4)?);
            if joints.len() != 4 * count || weights.len() != 4 * count {
                return Err(format!("“{name}” has another number of joints than of vertices"));
            }
            sets.push((joints, weights));
        }
        if sets.is_empty() {
            return Err(format!("“{name}” has a skin but no joints and weights"));
        }
        for v in 0..count {
            let mut sum = DMat4::ZERO;
            let mut total = 0.0;
            let entries = sets.iter().flat_map(|(j, w)| j[4 * v..4 * v + 4].iter().zip(&w[4 * v..4 * v + 4]));
            for (&joint, &weight) in entries.filter(|(_, w)| **w != 0.0) {
                let matrix = self
                    .joints
                    .get(joint as usize)
                    .ok_or(format!("“{name}” uses joint {joint} of {}", self.joints.len()))?;
                sum += *matrix * f64::from(weight);
                total += f64::from(weight);
            }
            // The weights of a vertex are normalised, because rounding may keep their sum from being 1. A vertex without weights follows
            // the first joint.
            let matrix = match self.joints.first() {
                _ if total != 0.0 => sum * (1.0 / total),
                Some(first) => *first,
                None => DMat4::IDENTITY,
            };
            mesh.vertices[v] = matrix.transform_point3(mesh.vertices[v].as_dvec3()).as_vec3();
            if let Some(normals) = &mut mesh.normals {
                let turned: DVec3 = cofactor(DMat3::from_mat4(matrix)) * normals[v].as_dvec3();
                normals[v] = turned.normalize_or_zero().as_vec3();
            }
        }
        // Reverses the winding if the joints' transforms are reflections.
        if self.joints.first().is_some_and(|m| m.determinant() < 0.0) {
            mesh.faces.iter_mut().for_each(|f| f.swap(1, 2));
        }
        Ok(())
    }
}
