//! T19: the area of an emissive triangle in the image of every camera, against the outline projected in double precision.

use crate::common::*;
use dscene::grad::{coverage_gaps, render_backward};
use dscene::image::Image;
use dscene::render::*;
use glam::{DMat3, DVec2, DVec3, Mat3, Vec3, vec3};

/// A film position that a lens shifts: the formulas of OpenCV's manual, in which y points down.
fn distort([k1, k2, p1, p2, k3]: [f64; 5], (x, y): (f64, f64)) -> (f64, f64) {
    let y = -y;
    let r2 = x * x + y * y;
    let radial = 1.0 + k1 * r2 + k2 * r2 * r2 + k3 * r2 * r2 * r2;
    let dx = 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x);
    let dy = p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y;
    (x * radial + dx, -(y * radial + dy))
}

/// What the outline is projected by, besides the position.
#[derive(Clone, Copy)]
struct Film {
    projection: Projection,
    scale: [f64; 2],
    size: f64,
    distortion: [f64; 5],
}

/// Film position in pixels of a point, written anew in double precision.
fn project(film: Film, frame: &DMat3, origin: DVec3, p: DVec3) -> DVec2 {
    let q = frame.transpose() * (p - origin);
    let ideal = match film.projection {
        Projection::Perspective => (q.x / q.z, q.y / q.z),
        Projection::Orthographic => (q.x, q.y),
        Projection::Fisheye => {
            let direction = DVec2::new(q.x, q.y).normalize() * (q.z / q.length()).acos();
            (direction.x, direction.y)
        }
        Projection::Panorama => (q.x.atan2(q.z), (q.y / q.length()).asin()),
    };
    let (x, y) = distort(film.distortion, ideal);
    DVec2::new(0.5 * film.size * (1.0 + x / film.scale[0]), 0.5 * film.size * (1.0 - y / film.scale[1]))
}

/// Area in pixels² inside the projected outline.
fn area(distortion: [f64; 5], camera: &Camera, v: &[Vec3], shift: DVec3, roll: f64) -> f64 {
    let [r, u, f] = camera.frame.map(|v| v.as_dvec3());
    let turn = DMat3::from_axis_angle(r, roll);
    let frame = DMat3::from_cols(r, turn * u, turn * f);
    let scale = camera.scale.map(f64::from);
    let film = Film { projection: camera.projection, scale, size: camera.width as f64, distortion };
    let mut points = Vec::new();
    for i in 0..3 {
        let (a, b) = (v[i].as_dvec3(), v[(i + 1) % 3].as_dvec3());
        for k in 0..1000 {
            let p = a.lerp(b, k as f64 / 1000.0);
            points.push(project(film, &frame, camera.origin.as_dvec3() + shift, p));
        }
    }
    let n = points.len();
    (0.5 * (0..n).map(|i| points[i].perp_dot(points[(i + 1) % n])).sum::<f64>()).abs()
}

/// The derivatives of the triangle's area by its coordinates, the camera's place, its tilt and what its lens distorts: by differences, and those
/// of a gradient by vertices, place, frame and distortion.
fn by_differences(camera: &Camera, v: &[Vec3; 3], g: &[Vec<f64>; 4]) -> (Vec<f64>, Vec<f64>) {
    let bent = camera.distortion.coefficients.map(f64::from);
    let h = 1e-4;
    let moved = |f: &dyn Fn(f64) -> f64| (f(h) - f(-h)) / (2.0 * h);
    let mut expected = Vec::new();
    let mut found = Vec::new();
    for i in 0..9 {
        expected.push(moved(&|t| {
            let mut w = *v;
            w[i / 3][i % 3] += t as f32;
            let exact = f64::from(w[i / 3][i % 3]) - f64::from(v[i / 3][i % 3]);
            let base = area(bent, camera, v, DVec3::ZERO, 0.0);
            base + (area(bent, camera, &w, DVec3::ZERO, 0.0) - base) * t / exact
        }));
        found.push(g[0][i]);
    }
    for (axis, found_here) in DVec3::AXES.into_iter().zip(&g[1]) {
        expected.push(moved(&|t| area(bent, camera, v, axis * t, 0.0)));
        found.push(*found_here);
    }
    // Tilting: up and forward turn about right.
    expected.push(moved(&|t| area(bent, camera, v, DVec3::ZERO, t)));
    let r = camera.frame[0];
    let turned = [Vec3::ZERO, r.cross(camera.frame[1]), r.cross(camera.frame[2])];
    let rows = turned.iter().flat_map(|v| v.to_array());
    found.push(g[2].iter().zip(rows).map(|(g, t)| g * f64::from(t)).sum());

    if camera.supports_distortion() {
        for (i, found_here) in g[3].iter().enumerate() {
            let with = |t: f64| {
                let mut bent = bent;
                bent[i] += t;
                area(bent, camera, v, DVec3::ZERO, 0.0)
            };
            expected.push(moved(&with));
            found.push(*found_here);
        }
    }
    (expected, found)
}

#[test]
fn area_of_a_triangle_in_every_camera() {
    /// After nine vertex coordinates and three of the camera; then the distortion's coefficients.
    const TILT: usize = 12;
    let straight = [0.0f32; 5];
    let lenses = [
        (Projection::Perspective, straight),
        (Projection::Orthographic, straight),
        (Projection::Fisheye, straight),
        (Projection::Panorama, straight),
        (Projection::Perspective, [-0.1, 0.01, 0.01, -0.02, 0.005]),
        (Projection::Fisheye, [0.05, -0.01, 0.01, 0.01, 0.002]),
    ];
    // Where images of edges are curved they are sampled, which takes long: in brief by one lens of each kind.
    let lenses = lenses.into_iter().filter(|(projection, _)| long() || *projection != Projection::Fisheye);
    for (projection, coefficients) in lenses {
        let distances = if long() { &[2.0, 5.0, 10.0][..] } else { &[5.0] };
        for &z in distances {
            let v = [vec3(-1.0, -0.8, 0.2), vec3(1.1, -0.5, -0.3), vec3(0.1, 1.0, 0.4)];
            let mut camera = look_at(vec3(0.3, 0.2, -z), vec3(0.1, 0., 0.), 60., 48);
            camera.projection = projection;
            camera.distortion = Distortion { coefficients };
            camera.scale = match projection {
                Projection::Perspective => [1.1, 1.1],
                Projection::Orthographic => [2.0, 2.0],
                Projection::Fisheye => [1.5, 1.5],
                Projection::Panorama => [3.0, 1.5],
            };
            let mut b = Builder::default();
            b.lamp(mesh(v.to_vec(), vec![[0, 2, 1]]), Vec3::ONE);
            let emission = b.description.shapes[0].emission.as_mut().unwrap();
            emission.two_sided = true;
            let scene = Scene::new(b.description).unwrap();
            let mut d_image = Image::new(48, 48, 3);
            d_image.data.iter_mut().step_by(3).for_each(|d| *d = 1.0);
            let wrt = [Slot::Vertices(0), Slot::CameraOrigin, Slot::CameraFrame, Slot::CameraDistortion];
            // Straight images of edges are integrated exactly, up to rounding, where velocities are linear on film: not by a lens that
            // distorts. Curved ones are sampled.
            let bounds = if camera.is_rectilinear() { [3e-6, 5e-4] } else { [3e-4, 5e-4] };
            let mut g = [vec![0.0; 9], vec![0.0; 3], vec![0.0; 9], vec![0.0; 5]];
            // What is integrated exactly needs few samples.
            let seeds = if long() || !camera.is_rectilinear() { 8 } else { 2 };
            for seed in 0..seeds {
                let settings = Settings {
                    output: Output::Radiance,
                    spp: 512,
                    max_bounces: 0,
                    seed,
                    boundary: true,
                    ..Settings::default()
                };
                let run = render_backward(&scene, &camera, &settings, &d_image, &wrt).unwrap();
                for (sum, x) in g.iter_mut().flatten().zip(run.iter().flatten()) {
                    *sum += x / seeds as f64;
                }
            }

            let (expected, found) = by_differences(&camera, &v, &g);
            // What is not much smaller than the largest is measured by itself; a tilt less closely, for it nearly cancels.
            let largest = expected.iter().fold(0.0f64, |m, e| m.max(e.abs()));
            let mut worst = [0.0f64; 2];
            for (i, (e, f)) in expected.iter().zip(&found).enumerate() {
                let size = if e.abs() > 0.1 * largest { e.abs() } else { largest };
                let size = if i == TILT { 5.0 * size } else { size };
                let (off, bound) = ((e - f).abs() / size, bounds[usize::from(i > TILT)]);
                assert!(off < bound, "{projection:?} at {z}, {i}: {f} instead of {e} (of {size})");
                worst[usize::from(i > TILT)] = worst[usize::from(i > TILT)].max(off);
            }
            println!("{projection:?} {coefficients:?} at {z}: off by {worst:?}");
        }
    }
}

/// A sky of one radiance, as bright with a million samples as with one.
#[test]
fn many_samples_add_up() {
    let mut b = Builder::default();
    let Input::Texture(radiance) = b.constant(Vec3::splat(0.3)) else { unreachable!() };
    b.description.environment = Some(SphericalMap { texels: radiance, rotation: Mat3::IDENTITY });
    let scene = Scene::new(b.description).unwrap();
    for spp in [1, 1 << 20] {
        let settings =
            Settings { output: Output::Radiance, spp, max_bounces: 0, seed: 0, boundary: false, ..Settings::default() };
        let image = render(&scene, &look_at(Vec3::Z, Vec3::ZERO, 45., 2), &settings).unwrap();
        assert!(image.data.iter().all(|x| (x - 0.3).abs() < 1e-7), "{:?}", image.data);
    }
}

/// From a film that cuts through a floor, what is in front of it is seen and what is behind it is not; no edge is there to say so.
#[test]
fn a_film_that_cuts_through_something_is_reported() {
    let gaps = |back: f32, lens: f32| {
        let mut b = Builder::default();
        let grey = b.diffuse(Vec3::splat(0.5));
        b.add(floor(Vec3::ZERO, 8.0), grey);
        let camera = look_at(vec3(0.0, 0.9, 1.8), vec3(0.0, 0.3, 0.0), 40.0, 8);
        let origin = camera.origin - back * camera.frame[2];
        let lens = Lens { radius: lens, ..Lens::PINHOLE };
        let camera = Camera { projection: Projection::Orthographic, scale: [1.0, 1.0], origin, lens, ..camera };
        let settings =
            Settings { output: Output::Depth, spp: 1, max_bounces: 1, seed: 0, boundary: true, ..Settings::default() };
        coverage_gaps(&Scene::new(b.description).unwrap(), &camera, &settings, &[Slot::CameraOrigin]).len()
    };
    assert_eq!([gaps(0.0, 0.0), gaps(3.0, 0.0)], [1, 0]);
    // Through the rim of a wide lens.
    assert_eq!([gaps(2.0, 0.0), gaps(2.0, 1.0)], [0, 1]);
}
