//! What mirrors show: flat ones are further viewpoints of the camera, curved ones are searched triangle by triangle.

pub mod curved;
pub mod viewpoint;
