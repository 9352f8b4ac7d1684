//! Reflections in perfect mirrors: flat mirrors are further viewpoints of the camera, curved ones are searched triangle by triangle.

pub mod curved;
pub mod viewpoint;
