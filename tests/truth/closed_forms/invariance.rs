//! What cannot change: furnaces and rigid motions.

use std::ops::RangeInclusive;

use dscene::image::Image;
use dscene::math::{Pcg32, uniform_sphere};
use dscene::mesh::{Mesh, shapes};
use dscene::render::texture::Texture;
use dscene::render::{Camera, DeltaLight, Emission, MaterialKind, Projection, Scene, Settings, Slot};
use glam::{DVec3, Vec3};

use super::support::*;
use crate::common::percent;

fn random_vector(rng: &mut Pcg32) -> Vec3 {
    uniform_sphere(rng.next_2d()) * rng.next_f32().cbrt()
}

/// An icosphere with jittered vertices.
fn blob(center: Vec3, radius: f32, jitter: f32, rng: &mut Pcg32) -> Mesh {
    let mut mesh = shapes::icosphere(radius, 1).unwrap();
    mesh.normals = None;
    mesh.vertices.iter_mut().for_each(|v| *v = center + *v * (1.0 + jitter * (rng.next_f32() - 0.5)));
    mesh
}

/// A closed room of random shapes, everything in it glowing and reflecting alike, and a camera inside.
struct Furnace {
    scene: Scene,
    camera: Camera,
    reflectance: Slot,
    /// Random motions of each shape's vertices.
    motions: Vec<Vec<Vec3>>,
}

impl Furnace {
    const RHO: f32 = 0.5;

    fn new(seed: u64, bounces: u32) -> Furnace {
        let mut rng = Pcg32::new(seed);
        let mut b = Builder::default();
        let reflectance = b.grey(Self::RHO);
        let radiance = b.grey(1.0);
        // Direct light in a jagged room. With interreflections a convex one: where everything glows, light close to an
        // edge makes 1/r² tails that only many samples would average out.
        let mut room = blob(Vec3::ZERO, 3.0, if bounces == 1 { 0.4 } else { 0.0 }, &mut rng);
        let squeeze = Vec3::from_array(rng.next_3d().map(|x| 0.8 + 0.4 * x));
        room.vertices.iter_mut().for_each(|v| *v *= squeeze);
        let mut meshes = vec![room];
        for _ in 0..3 {
            // Away from the camera in the middle.
            let center = uniform_sphere(rng.next_2d()) * 1.5;
            meshes.push(triangle(std::array::from_fn(|_| center + 0.6 * random_vector(&mut rng))));
        }
        let center = uniform_sphere(rng.next_2d()) * 1.5;
        meshes.push(blob(center, 0.4, if bounces == 1 { 0.5 } else { 0.1 }, &mut rng));
        for mesh in &meshes {
            let material = MaterialKind::Diffuse { reflectance }.into();
            b.push(mesh.clone(), material, Some(Emission { radiance, two_sided: true }));
        }
        let forward = uniform_sphere(rng.next_2d());
        let camera = camera(Projection::Perspective, Vec3::ZERO, forward, 1.2, 2);
        let motions = meshes.iter().map(|m| m.vertices.iter().map(|_| random_vector(&mut rng)).collect()).collect();
        Furnace { scene: b.scene(), camera, reflectance: texels(reflectance), motions }
    }

    /// Derivatives along the motions, shape by shape: all zero.
    fn geometry(&self, measured: &Measured, seeds: RangeInclusive<u64>) -> Estimate {
        let slots: Vec<Slot> = (0..self.motions.len()).map(Slot::Vertices).collect();
        estimate_over(seeds, |seed| {
            let gradients = measured.gradient(seed, &slots);
            gradients.iter().zip(&self.motions).map(|(g, m)| contract(g, m)).collect()
        })
    }
}

/// T8: in a closed room where everything glows and reflects alike, no motion changes anything.
#[test]
fn furnace_of_random_geometry() {
    for (seed, bounces) in [(1, 1), (2, 2), (3, 3)] {
        let furnace = Furnace::new(seed, bounces);
        let measured = Measured { scene: &furnace.scene, camera: &furnace.camera, settings: settings(128, bounces) };
        let rho = f64::from(Furnace::RHO);
        let value: f64 = (0..=bounces as i32).map(|i| rho.powi(i)).sum();
        let slope: f64 = (1..=bounces as i32).map(|i| f64::from(i) * rho.powi(i - 1)).sum();
        let pixels = 4.0;
        measured.values(8).check("T8 value", &[pixels * value], 0.01);
        let by_rho = estimate(8, |seed| vec![measured.gradient(seed, &[furnace.reflectance])[0].iter().sum()]);
        by_rho.check("T8 reflectance", &[pixels * slope], 0.01);
        // The image's sum is `pixels * value`. Of fifteen numbers in sixteen draws each one is four standard errors off in one run of
        // sixty: what looks doubtful is drawn afresh, four times as often.
        let geometry = furnace.geometry(&measured, 1..=16);
        let geometry = if geometry.seems_zero() { geometry } else { furnace.geometry(&measured, 17..=80) };
        geometry.check_zero("T8 geometry", 0.003 * pixels * value);
    }
}

/// Derivatives of rooms over their errors, a number for each shape that is seen, from few samples; and the errors.
fn scores_of_furnaces(rooms: u64, spp: u32, boundary: bool) -> (Vec<f64>, Vec<f64>) {
    let mut scores = Vec::new();
    let mut errors = Vec::new();
    for seed in 0..rooms {
        let bounces = 1 + (seed % 3) as u32;
        let furnace = Furnace::new(100 + seed, bounces);
        let settings = Settings { boundary, ..settings(spp, bounces) };
        let measured = Measured { scene: &furnace.scene, camera: &furnace.camera, settings };
        let geometry = furnace.geometry(&measured, 1..=8);
        assert!(geometry.mean.iter().chain(&geometry.error).all(|x| x.is_finite()));
        let seen = geometry.mean.iter().zip(&geometry.error).filter(|(_, error)| **error > 0.0);
        scores.extend(seen.clone().map(|(mean, error)| mean / error));
        errors.extend(seen.map(|(_, error)| *error));
    }
    (scores, errors)
}

fn mean_square(scores: &[f64]) -> f64 {
    scores.iter().map(|s| s * s).sum::<f64>() / scores.len() as f64
}

/// The same for many rooms, with few samples each: together they would show a bias of a fraction of an error.
#[test]
fn many_furnaces() {
    let rooms = if percent().is_some_and(|percent| percent <= 1.0) { 100 } else { 28 };
    let (scores, mut errors) = scores_of_furnaces(rooms, 48, true);
    let n = scores.len() as f64;
    let mean = scores.iter().sum::<f64>() / n;
    let square = mean_square(&scores);
    let worst = scores.iter().fold(0.0, |w: f64, s| w.max(s.abs()));
    errors.sort_by(f64::total_cmp);
    let median = errors[errors.len() / 2];
    println!("{n} scores: mean {mean:.3}, mean square {square:.3}, worst {worst:.2}; median error {median:.4}");
    // Student's t of eight seeds: variance 7/5, and the mean of its squares is known to about 0.15 with a hundred rooms.
    assert!(n > 3.0 * rooms as f64, "only {n} shapes were seen");
    assert!(median < 0.01, "too noisy to say anything: {median}");
    assert!(mean.abs() < 4.5 * (1.4 / n).sqrt(), "the mean score is {mean}");
    assert!(square < 2.1, "the mean square of the scores is {square}");
    assert!(worst < 12.0, "a score of {worst}");
}

/// That furnaces are zero says something: without what passes behind edges they are not.
#[test]
fn furnaces_notice_missing_edges() {
    let square = mean_square(&scores_of_furnaces(20, 128, false).0);
    println!("mean square {square:.1}");
    assert!(square > 4.0, "without boundary terms the mean square of the scores is {square}");
}

/// T8 again, with triangles that go through each other and through the walls: what glows of them ends at the curves.
#[test]
fn furnace_of_interpenetrating_triangles() {
    const RHO: f32 = 0.5;
    for (seed, bounces) in [(1, 1), (3, 2)] {
        let mut rng = Pcg32::new(seed);
        let mut b = Builder::default();
        let reflectance = b.grey(RHO);
        let radiance = b.grey(1.0);
        let mut meshes = vec![blob(Vec3::ZERO, 2.0, 0.0, &mut rng)];
        for _ in 0..4 {
            let center = Vec3::new(0.0, 0.0, -1.2);
            meshes.push(triangle(std::array::from_fn(|_| center + 1.6 * uniform_sphere(rng.next_2d()))));
        }
        for mesh in &meshes {
            let material = MaterialKind::Diffuse { reflectance }.into();
            b.push(mesh.clone(), material, Some(Emission { radiance, two_sided: true }));
        }
        let scene = b.scene();
        let camera = camera(Projection::Perspective, Vec3::Z * 1.5, -Vec3::Z, 0.8, 2);
        let measured = Measured { scene: &scene, camera: &camera, settings: settings(256, bounces) };
        let slots: Vec<Slot> = (0..meshes.len()).map(Slot::Vertices).collect();
        let motions: Vec<Vec<Vec3>> =
            meshes.iter().map(|m| m.vertices.iter().map(|_| random_vector(&mut rng)).collect()).collect();
        let geometry = estimate(16, |seed| {
            let gradients = measured.gradient(seed, &slots);
            gradients.iter().zip(&motions).map(|(g, m)| contract(g, m)).collect()
        });
        geometry.check_zero("T8 interpenetrating", 0.05);
    }
}

/// T9: a white convex body under a white sky is invisible.
#[test]
fn white_furnace() {
    let mut rng = Pcg32::new(11);
    let mut b = Builder::default();
    let mut body = shapes::icosphere(1.0, 1).unwrap();
    body.normals = None;
    body.vertices.iter_mut().for_each(|v| *v *= Vec3::new(1.0, 0.7, 1.2));
    let count = body.vertices.len();
    let shape = b.matte(body, 1.0);
    b.environment(Texture::constant(Vec3::ONE));
    let scene = b.scene();
    let camera = camera(Projection::Perspective, Vec3::new(0.5, 1.0, 3.0), Vec3::new(-0.15, -0.3, -1.0), 0.6, 4);
    let measured = Measured { scene: &scene, camera: &camera, settings: settings(384, 2) };
    measured.values(64).check("T9 value", &[16.0], 2e-4);
    let motions: Vec<Vec<Vec3>> = (0..4).map(|_| (0..count).map(|_| random_vector(&mut rng)).collect()).collect();
    measured.along(48, Slot::Vertices(shape), &motions).check_zero("T9", 0.05);
    measured.gradients(16, Slot::CameraOrigin).check_zero("T9 camera", 0.0025);
}

/// T15: moving, turning and scaling the whole world with its camera changes no image.
#[test]
fn the_world_moves_as_one() {
    let mut b = Builder::default();
    let mut rng = Pcg32::new(13);
    b.matte(floor(Vec3::ZERO, 3.0), 0.7);
    b.matte(blob(Vec3::new(0.3, 0.8, -0.2), 0.5, 0.3, &mut rng), 0.5);
    b.matte(blob(Vec3::new(-0.5, 0.1, 0.6), 0.4, 0.3, &mut rng), 0.5); // in the floor
    b.black(triangle([Vec3::new(-1.0, 1.2, 0.3), Vec3::new(0.0, 1.5, 0.1), Vec3::new(-0.6, 1.4, -0.8)]));
    b.glowing(floor(Vec3::new(0.4, 3.0, 0.5), 0.5), 6.0);
    let shapes = b.description.shapes.len();
    let direction = Vec3::new(0.4, -1.0, 0.3);
    b.description.delta_lights.push(DeltaLight::Directional { direction, irradiance: Vec3::splat(0.8) });
    let area_and_sun = b.scene();

    let camera = camera(Projection::Perspective, Vec3::new(0.0, 2.0, 4.0), Vec3::new(0.0, -0.4, -1.0), 0.6, 8);
    let mut d_image = Image::new(8, 8, 3);
    d_image.data.iter_mut().for_each(|d| *d = 0.5 + rng.next_f32());

    let mut slots: Vec<Slot> = (0..shapes).map(Slot::Vertices).collect();
    slots.extend([Slot::CameraOrigin, Slot::CameraFrame, Slot::LightPlacement(0)]);
    for bounces in [1, 2] {
        let measured = Measured { scene: &area_and_sun, camera: &camera, settings: settings(64, bounces) };
        let mut magnitudes = [0.0f64; 3];
        let invariants = estimate(12, |seed| {
            let gradients = measured.gradient_of(seed, &slots, &d_image);
            let (mut shift, mut turn, mut scale) = (DVec3::ZERO, DVec3::ZERO, 0.0);
            let mut sums = [0.0; 3];
            let mut at = |p: Vec3, g: DVec3| {
                let p = p.as_dvec3();
                shift += g;
                turn += p.cross(g);
                scale += p.dot(g);
                sums = [sums[0] + g.length(), sums[1] + p.cross(g).length(), sums[2] + p.dot(g).abs()];
            };
            for (shape, gradient) in measured.scene.description.shapes.iter().zip(&gradients) {
                for (&p, g) in shape.mesh.vertices.iter().zip(gradient.chunks(3)) {
                    at(p, vector(g));
                }
            }
            at(camera.origin, vector(&gradients[shapes]));
            for (row, g) in camera.frame.iter().zip(gradients[shapes + 1].chunks(3)) {
                turn += row.as_dvec3().cross(vector(g));
            }
            turn += direction.as_dvec3().cross(vector(&gradients[shapes + 2]));
            magnitudes = std::array::from_fn(|i| magnitudes[i].max(sums[i]));
            vec![shift.x, shift.y, shift.z, turn.x, turn.y, turn.z, scale]
        });
        let part = |range: std::ops::Range<usize>| Estimate {
            mean: invariants.mean[range.clone()].to_vec(),
            error: invariants.error[range].to_vec(),
        };
        // Shifts and scalings cancel sample by sample; turns do in the mean, as sampled directions do not turn along.
        part(0..3).check_scaled("T15 shift", &[0.0; 3], 1e-3, magnitudes[0]);
        part(3..6).check_scaled("T15 turn", &[0.0; 3], 0.02, magnitudes[1]);
        part(6..7).check_scaled("T15 scale", &[0.0], 1e-3, magnitudes[2]);
    }
}

/// A white mirror ball under an even sky is not to be seen: nothing changes with it, or with the camera (T8). Its contours are looked at
/// right beside edges, at grazing angles, from where a ray must not meet the faces around the corner.
#[test]
fn a_mirror_ball_in_a_furnace_has_no_contour() {
    let mut ball = dscene::mesh::shapes::sphere(0.5, 64).unwrap();
    ball.vertices.iter_mut().for_each(|v| *v += Vec3::new(0.5, -0.7, -1.7));
    let forward = Vec3::new(0.0, -0.07, -1.0);
    let camera = camera(Projection::Perspective, Vec3::ZERO, forward, 0.58, 24);
    let along_scale = |mirror: bool| {
        let mut b = Builder::default();
        let reflectance = b.grey(1.0);
        let kind = if mirror { MaterialKind::Mirror { reflectance } } else { MaterialKind::Black };
        let shape = b.add(ball.clone(), kind);
        b.environment(Texture::constant(Vec3::splat(0.7)));
        let scene = b.scene();
        let measured = Measured { scene: &scene, camera: &camera, settings: settings(64, 4) };
        let motion: Vec<f64> = ball.vertices.iter().flat_map(|v| [f64::from(v.x), 0.0, 0.0]).collect();
        estimate(if mirror { 16 } else { 4 }, |seed| {
            let [scale, vertices] = &measured.gradient(seed, &[Slot::CameraScale, Slot::Vertices(shape)])[..] else {
                panic!("two slots")
            };
            vec![scale.iter().sum(), vertices.iter().zip(&motion).map(|(g, m)| g * m).sum()]
        })
    };
    let black = along_scale(false);
    let size = black.mean.iter().map(|m| m.abs()).fold(f64::INFINITY, f64::min);
    along_scale(true).check_zero("mirror ball", 1e-3 * size);
}
