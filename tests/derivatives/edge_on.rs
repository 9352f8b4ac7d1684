//! Cameras and lights in the plane of a face: the sun right above a box, a plan view of it. Which border of the face is a contour is then
//! left to rounding unless it is decided once for the whole face (`Edge::view_from`).

use crate::common::*;
use dscene::render::*;
use glam::{Vec3, vec3};

/// A box whose sides are upright, turned about y so that rounding has a say, with its foot at the given height above a floor.
struct Upright {
    foot: f32,
    angle: f32,
    /// All coordinates are that much larger: what is rounded is too.
    aside: Vec3,
}

/// How θ moves the box: its foot's centre and its size.
type Motion = fn(f32, &mut Vec3, &mut f32);

impl Upright {
    fn scene(&self, t: f32, motion: Motion) -> Builder {
        let (mut foot, mut size) = (vec3(0.1, self.foot, 0.05), 1.0);
        motion(t, &mut foot, &mut size);
        let h = vec3(0.5, 0.4, 0.6) * size;
        let mut b = Builder::default();
        let (red, grey) = (b.diffuse(vec3(0.7, 0.3, 0.2)), b.diffuse(Vec3::splat(0.5)));
        b.add(cuboid(foot + vec3(0.0, h.y, 0.0) + self.aside, h, self.angle), red);
        b.add(floor(self.aside, 3.0), grey);
        b
    }

    fn eye(&self) -> Camera {
        look_at(vec3(1.2, 3.9, -4.0) + self.aside, vec3(0.0, 0.5, 0.0) + self.aside, 40.0, 32)
    }

    /// From straight above, without perspective.
    fn plan_view(&self) -> Camera {
        let mut camera = look_at(vec3(0.0, 5.0, 0.0) + self.aside, self.aside, 45.0, 128);
        camera.projection = Projection::Orthographic;
        camera.scale = [1.7; 2];
        camera
    }
}

const SLIDE: Motion = |t, foot, _| *foot += vec3(t, 0.0, 0.5 * t);
const GROW: Motion = |t, _, size| *size += t;

fn sun(b: &mut Builder) {
    b.description
        .delta_lights
        .push(DeltaLight::Directional { direction: vec3(0.0, -1.0, 0.0), irradiance: Vec3::splat(2.0) });
}

#[test]
fn under_a_sun_right_above() {
    let plan = Plan { h: 0.02, spp: 32, ..Plan::default() };
    let boxes = [
        ("floating", Upright { foot: 0.4, angle: 0.0, aside: Vec3::ZERO }),
        ("floating, turned", Upright { foot: 0.4, angle: 0.6, aside: Vec3::ZERO }),
        ("floating, turned, aside", Upright { foot: 0.4, angle: 0.6, aside: vec3(40.0, 7.0, -30.0) }),
        ("standing", Upright { foot: 0.0, angle: 0.0, aside: Vec3::ZERO }),
        ("standing, turned", Upright { foot: 0.0, angle: 0.6, aside: Vec3::ZERO }),
    ];
    for (name, upright) in &boxes {
        for (what, motion) in [("slides", SLIDE), ("grows", GROW)] {
            let build = |t: f32| {
                let mut b = upright.scene(t, motion);
                sun(&mut b);
                (b.description, upright.eye())
            };
            agree(&format!("{name}: {what}"), &build, &plan);
        }
    }
}

#[test]
fn seen_from_right_above() {
    let plan = Plan { h: 0.01, spp: 4, fd_spp: 32, ..Plan::default() };
    let boxes = [
        ("floating, turned", Upright { foot: 0.4, angle: 0.6, aside: Vec3::ZERO }),
        ("standing", Upright { foot: 0.0, angle: 0.3, aside: Vec3::ZERO }),
        ("standing, turned, aside", Upright { foot: 0.0, angle: 0.6, aside: vec3(40.0, 7.0, -30.0) }),
    ];
    for (name, upright) in &boxes {
        for (what, motion) in [("slides", SLIDE), ("grows", GROW)] {
            let build = |t: f32| {
                let mut b = upright.scene(t, motion);
                b.lamp(ceiling(vec3(-0.8, 4.0, -1.5) + upright.aside, 0.4), Vec3::splat(30.0));
                (b.description, upright.plan_view())
            };
            agree(&format!("plan view, {name}: {what}"), &build, &plan);
        }
    }
}

/// Eye and lamp at the height of the lid, or in the plane of a side: moved within that plane the image changes smoothly.
#[test]
fn an_eye_and_a_lamp_in_the_plane_of_a_side() {
    let plan = Plan { h: 0.02, spp: 32, ..Plan::default() };
    let upright = Upright { foot: 0.4, angle: 0.0, aside: Vec3::ZERO };
    let lamp = |t: f32, position: Vec3, motion: Motion, eye: Vec3| {
        let mut b = upright.scene(t, motion);
        b.description.delta_lights.push(DeltaLight::Point { position, intensity: Vec3::splat(20.0) });
        (b.description, look_at(eye, vec3(0.0, 0.5, 0.0), 40.0, 32))
    };
    // The right side is at 0.1 + 0.5.
    let [above, beside] = [vec3(1.2, 3.9, -4.0), vec3(0.6, 3.9, -4.0)];
    let within: Motion = |t, foot, _| *foot += vec3(0.0, 0.3 * t, t);
    agree("lamp beside", &|t| lamp(t, vec3(0.6, 3.0, -1.0), within, above), &plan);
    agree("eye beside", &|t| lamp(t, vec3(-0.6, 3.0, -1.0), within, beside), &plan);
    agree("both beside", &|t| lamp(t, vec3(0.6, 3.0, -1.0), within, beside), &plan);
    agree_in_long(
        "both beside, global",
        &|t| lamp(t, vec3(0.6, 3.0, -1.0), within, beside),
        &Plan { max_bounces: 3, ..plan },
    );
}

/// Where there is a kink the derivative is the one of the side on which the face is hidden.
#[test]
fn a_kink_has_the_derivative_of_one_side() {
    let shining = |angle: f32, eye: Vec3, motion: Motion| {
        let build = move |t: f32| {
            let mut b = Builder::default();
            let (mut foot, mut size) = (Vec3::ZERO, 1.0);
            motion(t, &mut foot, &mut size);
            let lamp = cuboid(foot, Vec3::splat(0.5 * size), angle);
            b.lamp(lamp, Vec3::ONE);
            (b.description, look_at(eye, vec3(0.0, 0.1, 0.2), 40.0, 32))
        };
        let plan = Plan { max_bounces: 0, spp: 64, ..Plan::default() };
        statistics(&gradients(&build, &plan, 0..8)).mean
    };
    let out: Motion = |t, foot, _| foot.x += t;
    let turn = |angle: f32, v: Vec3| glam::Mat3::from_rotation_y(angle) * v;
    for angle in [0.0, 0.3, 1.1] {
        let eye = |x: f32| turn(angle, vec3(x, 0.4, -4.0));
        let [hidden, there, shown] = [0.49, 0.5, 0.51].map(|x| shining(angle, eye(x), out));
        let difference = (there / hidden - 1.0).abs();
        assert!(difference < 5e-3, "{angle}: {hidden} {there} {shown}");
    }
}

/// The faces of a thin pipe are slivers: from a point of their edges the third corner is next to straight along the edge, and single
/// precision knows their planes only roughly.
#[test]
fn slivers() {
    let build = |t: f32| {
        let mut b = Builder::default();
        let segments = 96;
        let mut vertices = Vec::new();
        for i in 0..segments {
            let (sin, cos) = (std::f32::consts::TAU * i as f32 / segments as f32).sin_cos();
            for x in [-2.0, 2.0] {
                vertices.push(vec3(x, 1.0 + 0.02 * sin + 0.1 * x + t, 0.02 * cos + 0.2 * x));
            }
        }
        let face = |i: u32| {
            let (a, b) = (2 * i, 2 * ((i + 1) % segments));
            [[a, b, a + 1], [b, b + 1, a + 1]]
        };
        let (pipe, ground) = (b.diffuse(Vec3::splat(0.6)), b.diffuse(Vec3::splat(0.3)));
        b.add(mesh(vertices, (0..segments).flat_map(face).collect()), pipe);
        b.add(floor(vec3(0.0, 0.85, 0.0), 2.0), ground);
        let position = vec3(0.3, 3.0, -1.4);
        b.description.delta_lights.push(DeltaLight::Point { position, intensity: Vec3::splat(9.0) });
        (b.description, look_at(vec3(0.2, 2.0, -3.5), vec3(0.0, 0.95, 0.05), 4.0, 24))
    };
    agree("a thin pipe and its shadow", &build, &Plan { h: 0.002, spp: 16, fd_spp: 512, ..Plan::default() });
}
