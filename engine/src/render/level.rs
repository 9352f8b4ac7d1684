//! Which levels of a mip map a point of a surface shows: those whose texels are as large as what a pixel would see of the surface there.
//!
//! The level is a function of the point, as if the camera saw it directly, and of nothing else: what is seen in a mirror, what lights
//! another surface and what light tracing meets is the same surface everywhere, so that all estimators render one scene. (pbrt-v4 has
//! the same rule, `Camera::Approximate_dp_dxy`; following the spread of each ray would be sharper in flat mirrors only.) The level is
//! where a texel's area is that of the pixel's footprint, which is sharper at grazing angles than the footprint's longer side: what it
//! leaves is averaged by the pixel's samples. Normal and density of texels are those of the triangle, so that levels differ a little between the
//! triangles of a curved or unevenly unwrapped mesh. Derivatives take the level as it is, and know nothing of these steps (`grad`'s coverage
//! gaps say so).

use super::accel::PrimId;
use super::texture::Texture;
use super::view::View;
use super::world::Scene;

impl Scene {
    /// Where between the levels of a texture a point of a triangle is: 0 is the finest one, and without a mip map or a view the only one.
    #[inline]
    pub(crate) fn level_of_detail(&self, texture: &Texture, prim: PrimId, b: [f32; 3]) -> f32 {
        match &self.view {
            Some(view) if texture.is_mipmapped() => self.level_seen(view, texture, prim, b),
            _ => 0.0,
        }
    }

    fn level_seen(&self, view: &View, texture: &Texture, prim: PrimId, b: [f32; 3]) -> f32 {
        let facet = &self.facets[prim as usize];
        let [p0, p1, p2] = facet.corners;
        let area = (p1 - p0).cross(p2 - p0).length();
        let [uv0, uv1, uv2] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]].map(|b| self.uv(prim, b));
        let texels = (uv1 - uv0).perp_dot(uv2 - uv0).abs() * (texture.width * texture.height) as f32;
        let level = 0.5 * (texels / area * view.footprint(facet.point(b), facet.normal)).log2();
        // A triangle without area shows nothing.
        if level.is_nan() { 0.0 } else { level }
    }
}

#[cfg(test)]
mod tests {
    use glam::{Vec2, Vec3};

    use super::*;
    use crate::mesh::Mesh;
    use crate::render::texture::{Filter, Wrap};
    use crate::render::{Camera, Input, MaterialKind, Projection, SceneDescription, Shape};

    /// A square of side 2 about the origin, facing +z, with a mip map of 64² texels.
    fn board() -> Scene {
        let corners = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)];
        let mesh = Mesh {
            vertices: corners.map(|(x, y)| Vec3::new(x, y, 0.0)).to_vec(),
            faces: vec![[0, 1, 2], [0, 2, 3]],
            uvs: Some(corners.map(|(x, y)| Vec2::new(0.5 + 0.5 * x, 0.5 - 0.5 * y)).to_vec()),
            ..Mesh::default()
        };
        let texture = Texture::new(64, 64, 1, vec![0.5; 64 * 64], Wrap::Repeat, Filter::Trilinear).unwrap();
        let kind = MaterialKind::Diffuse { reflectance: Input::Texture(0) };
        let shapes = vec![Shape { mesh, material: kind.into(), emission: None }];
        Scene::new(SceneDescription { shapes, textures: vec![texture], ..Default::default() }).unwrap()
    }

    fn level(camera: &Camera) -> f32 {
        let scene = board().seen_by(camera);
        scene.level_of_detail(&scene.description.textures[0], 0, [0.5, 0.0, 0.5])
    }

    /// A film of 64 pixels that the board fills shows the finest level, and each doubling of the distance or of the pixels' size one more.
    /// Seen at 60° from the normal, a pixel sees twice the area: half a level.
    #[test]
    fn levels_follow_distance_size_and_angle() {
        let at =
            |position: Vec3, n: usize| Camera::look_at(position, Vec3::ZERO, Vec3::Y, 2.0 * (0.25f32).atan(), [n, n]);
        for (camera, expected) in [
            (at(4.0 * Vec3::Z, 64), 0.0),
            (at(8.0 * Vec3::Z, 64), 1.0),
            (at(4.0 * Vec3::Z, 16), 2.0),
            (at(2.0 * Vec3::Z, 64), -1.0),
            (at(4.0 * Vec3::new(0.75f32.sqrt(), 0.0, 0.5), 64), 0.5),
        ] {
            assert!((level(&camera) - expected).abs() < 1e-4, "{} instead of {expected}", level(&camera));
        }
        let parallel = Camera { projection: Projection::Orthographic, scale: [2.0, 2.0], ..at(9.0 * Vec3::Z, 64) };
        assert!((level(&parallel) - 1.0).abs() < 1e-4);
        let round = Camera { projection: Projection::Fisheye, scale: [0.5, 0.5], ..at(2.0 * Vec3::Z, 32) };
        assert!((level(&round) - 1.0).abs() < 1e-4);
    }

    /// The area is what the rays through the corners of a small pixel cut out of the plane, anywhere on the film.
    #[test]
    fn footprints_are_what_pixels_see() {
        let straight = Camera::look_at(Vec3::new(0.3, -0.2, 4.0), Vec3::new(0.5, 0.4, 0.0), Vec3::Y, 1.6, [400, 300]);
        for (projection, scale) in [
            (Projection::Perspective, straight.scale),
            (Projection::Orthographic, [2.0, 1.5]),
            (Projection::Fisheye, [1.2, 0.9]),
            (Projection::Panorama, [1.2, 0.9]),
        ] {
            let camera = Camera { projection, scale, ..straight };
            let view = View::new(&camera);
            for place in [Vec2::new(200.0, 150.0), Vec2::new(40.0, 220.0), Vec2::new(330.0, 60.0)] {
                let seen = |offset: Vec2| {
                    let ray = camera.ray(place + offset);
                    ray.origin - ray.dir * (ray.origin.z / ray.dir.z)
                };
                let half = 0.5;
                let [a, b, c, d] =
                    [(-half, -half), (half, -half), (half, half), (-half, half)].map(|(x, y)| seen(Vec2::new(x, y)));
                let area = 0.5 * (c - a).cross(d - b).length();
                let found = view.footprint(seen(Vec2::ZERO), Vec3::Z);
                assert!((found / area - 1.0).abs() < 0.02, "{projection:?} at {place}: {found} and {area}");
            }
        }
    }
}
