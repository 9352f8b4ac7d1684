use glam::Vec3;

/// An orthonormal, right-handed frame around a unit normal.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Frame {
    pub(crate) tangent: Vec3,
    pub(crate) bitangent: Vec3,
    pub(crate) normal: Vec3,
}

impl Frame {
    /// Duff et al. 2017, "Building an Orthonormal Basis, Revisited".
    #[inline]
    pub fn from_normal(n: Vec3) -> Frame {
        let sign = 1f32.copysign(n.z);
        let a = -1.0 / (sign + n.z);
        let b = n.x * n.y * a;
        Frame {
            tangent: Vec3::new(1.0 + sign * n.x * n.x * a, sign * b, -sign * n.x),
            bitangent: Vec3::new(b, sign + n.y * n.y * a, -n.y),
            normal: n,
        }
    }

    /// A vector in the frame's coordinates, in those in which the frame is given.
    #[inline]
    pub fn to_world(&self, v: Vec3) -> Vec3 {
        self.tangent * v.x + self.bitangent * v.y + self.normal * v.z
    }

    /// A vector in the coordinates in which the frame is given, in the frame's.
    #[inline]
    pub fn to_local(&self, v: Vec3) -> Vec3 {
        Vec3::new(self.tangent.dot(v), self.bitangent.dot(v), self.normal.dot(v))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::{Pcg32, uniform_sphere};

    #[test]
    fn frames_are_orthonormal_and_right_handed() {
        let mut rng = Pcg32::new(1);
        for i in 0..1000 {
            let n = match i {
                0 => Vec3::Z,
                1 => -Vec3::Z,
                _ => uniform_sphere(rng.next_2d()),
            };
            let f = Frame::from_normal(n);
            assert!(f.tangent.cross(f.bitangent).dot(n) > 1.0 - 1e-5);
            assert!((f.tangent.length() - 1.0).abs() < 1e-5 && f.tangent.dot(f.bitangent).abs() < 1e-5);
            let v = uniform_sphere(rng.next_2d());
            assert!((f.to_world(f.to_local(v)) - v).length() < 1e-5);
        }
    }
}
