//! Forward and reverse mode agree; results do not depend on the number of threads, nor on that of processes.

use crate::common::*;
use dscene::grad::estimate::{Images, forward, reverse};
use dscene::grad::sampling::allocate::Estimator;
use dscene::grad::sink::{DenseSums, DirectionalDerivatives, Layout, Tangents};
use dscene::grad::terms::interior::Interior;
use dscene::grad::{
    Direction, GuideCache, NEVER, Sampling, render_backward, render_backward_until, render_forward, render_jacobian,
    render_rows_until,
};
use dscene::image::Image;
use dscene::ranks::{self, Link, Lost};
use dscene::render::texture::{Filter, Texture, Wrap};
use dscene::render::*;
use glam::{Mat3, Vec3, vec3};
use std::sync::{Arc, Barrier, Mutex};

fn scene() -> (SceneDescription, Camera) {
    let mut b = Builder::default();
    let grey = b.diffuse(Vec3::splat(0.6));
    b.add(floor(Vec3::ZERO, 2.0), grey.clone());
    b.add(cuboid(vec3(0.2, 0.5, 0.1), vec3(0.4, 0.3, 0.5), 0.4), grey);
    let (diffuse, specular) = (b.constant(Vec3::splat(0.2)), b.constant(Vec3::splat(0.5)));
    let roughness = b.scalar(0.03); // narrow: attached
    let phong = Material::from(MaterialKind::Phong { diffuse, specular, roughness });
    b.add(quad(vec3(-2., 0., 1.5), vec3(2., 0., 1.5), vec3(2., 2., 1.6), vec3(-2., 2., 1.6)), phong);
    b.lamp(ceiling(vec3(0.3, 3., -0.5), 0.5), Vec3::splat(10.));
    b.description.delta_lights.push(DeltaLight::Point { position: vec3(-1., 2., -1.), intensity: Vec3::splat(4.) });
    b.description.delta_lights.push(DeltaLight::Directional { direction: vec3(0.4, -1., 0.3), irradiance: Vec3::ONE });
    let cone = Cone { axis: vec3(-0.3, -1., 0.4), beam: 0.2, cutoff: 0.5 };
    b.description.delta_lights.push(DeltaLight::Spot {
        position: vec3(1., 2.5, -0.5),
        intensity: Vec3::splat(6.),
        cone,
        profile: None,
    });
    (b.description, look_at(vec3(0.5, 2., -4.), vec3(0., 0.4, 0.), 45., 24))
}

/// As above, through a pinhole, in part and under a filter with two signs, through a lens, through one that distorts, with a box that moves, with masks on box, wall and light,
/// with a ball of mirror, and under a sky with a sun.
fn scenes() -> [(SceneDescription, Camera); 8] {
    let (description, camera) = scene();
    let lens = Lens { radius: 0.3, focus: 3.0, ..Lens::PINHOLE };
    let crop = Some(Crop { corner: [5, 0], film: [24, 24] });
    let mut moving = description.clone();
    let vertices = cuboid(vec3(0.5, 0.7, 0.0), vec3(0.4, 0.3, 0.5), 0.7).vertices;
    moving.motions.push(Motion { shape: 1, vertices, normals: None });
    let shutter = [0.2, 0.9];
    let distortion = Distortion { coefficients: [-0.2, 0.05, 0.01, 0.02, 0.0] };
    let mut masked = description.clone();
    let data = (0..12).map(|i| (i * 7 % 10) as f32 / 9.0).collect();
    masked.textures.push(Texture::new(4, 3, 1, data, Wrap::Repeat, Filter::Bilinear).unwrap());
    for shape in &mut masked.shapes[1..] {
        shape.material.opacity = Some(Input::Texture(masked.textures.len() - 1));
    }
    let mut mirrored = Builder::new();
    mirrored.description = description.clone();
    mirrored.ball(vec3(-0.5, 0.6, -1.0), 0.5);
    let mut sunny = description.clone();
    let data = (0..16 * 8 * 3).map(|i| if i / 3 == 37 { 40.0 } else { 0.2 + 0.1 * (i * 7 % 5) as f32 }).collect();
    sunny.textures.push(Texture::new(16, 8, 3, data, Wrap::Repeat, Filter::Bilinear).unwrap());
    let rotation = Mat3::from_rotation_y(0.3);
    sunny.environment = Some(SphericalMap { texels: sunny.textures.len() - 1, rotation });
    [
        (description.clone(), camera),
        (description.clone(), Camera { filter: PixelFilter::Mitchell, width: 17, crop, ..camera }),
        (description.clone(), Camera { lens, ..camera }),
        (description, Camera { distortion, ..camera }),
        (moving, Camera { shutter, ..camera }),
        (masked, camera),
        (mirrored.description, camera),
        (sunny, camera),
    ]
}

fn settings(output: Output, spp: u32, seed: u64) -> Settings {
    Settings { output, spp, max_bounces: 3, seed, boundary: true, ..Settings::default() }
}

/// ⟨Jv, w⟩ = ⟨v, Jᵀw⟩: with w = 1 both modes draw the same samples, so they agree to rounding.
#[test]
fn forward_is_the_transpose_of_reverse() {
    for (description, camera) in scenes() {
        let slots = all_slots(&description, &camera);
        let mut rng = dscene::math::Pcg32::new(5);
        let tangents: Vec<(Slot, Vec<f32>)> =
            slots.into_iter().map(|(s, v)| (s, v.iter().map(|_| rng.next_f32() - 0.5).collect())).collect();
        let wrt: Vec<Slot> = tangents.iter().map(|t| t.0).collect();
        let scene = Scene::new(description).unwrap();
        for output in [Output::Radiance, Output::Depth, Output::Normal, Output::Position, Output::Alpha] {
            let settings = settings(output, 4, 3);
            let forward = render_forward(&scene, &camera, &settings, &tangents).unwrap();
            let ones = Image { data: vec![1.0; forward.data.len()], ..forward.clone() };
            let reverse = render_backward(&scene, &camera, &settings, &ones, &wrt).unwrap();
            let jv: f64 = forward.data.iter().map(|v| f64::from(*v)).sum();
            let terms = reverse.iter().zip(&tangents).flat_map(|(g, t)| g.iter().zip(&t.1));
            let jtw: f64 = terms.map(|(g, t)| g * f64::from(*t)).sum();
            let size: f64 = forward.data.iter().map(|v| f64::from(v.abs())).sum();
            println!("{output:?}: {jv} {jtw} of {size}");
            assert!(size > 0.0 && (jv - jtw).abs() < 1e-4 * size, "{output:?}: ⟨Jv, 1⟩ = {jv}, ⟨v, Jᵀ1⟩ = {jtw}");
        }
    }
}

/// Stored as a matrix, along a direction and against any weights: the same samples, so that all agree to rounding.
#[test]
fn a_derivative_with_even_samples_is_one_matrix() {
    for (description, camera) in scenes() {
        let slots = all_slots(&description, &camera);
        let mut rng = dscene::math::Pcg32::new(6);
        let mut random = |n: usize| -> Vec<f32> { (0..n).map(|_| rng.next_f32() - 0.5).collect() };
        let tangents: Direction = slots.iter().map(|(s, v)| (*s, random(v.len()))).collect();
        let wrt: Vec<Slot> = tangents.iter().map(|t| t.0).collect();
        let scene = Scene::new(description).unwrap();
        for output in [Output::Radiance, Output::Normal] {
            let settings = settings(output, 2, 3);
            let forward = render_forward(&scene, &camera, &settings, &tangents).unwrap();
            let weights = Image { data: random(forward.data.len()), ..forward.clone() };
            let reverse =
                render_backward_until(&scene, &camera, &settings, &weights, &wrt, Sampling::Even, &NEVER).unwrap();
            let products = || forward.data.iter().zip(&weights.data).map(|(v, w)| f64::from(*v) * f64::from(*w));
            let (jv, size) = (products().sum::<f64>(), products().map(f64::abs).sum::<f64>());
            let terms = reverse.iter().zip(&tangents).flat_map(|(g, t)| g.iter().zip(&t.1));
            let jtw: f64 = terms.map(|(g, t)| g * f64::from(*t)).sum();
            assert!(size > 0.0 && (jv - jtw).abs() < 1e-4 * size, "{output:?}: ⟨Jv, w⟩ = {jv}, ⟨v, Jᵀw⟩ = {jtw}");

            let rows = |room: usize| render_rows_until(&scene, &camera, &settings, &wrt, room, &NEVER).unwrap();
            let Some(matrix) = rows(usize::MAX) else {
                assert!(scene.moves_for(&camera));
                continue;
            };
            assert!(rows(matrix.len() - 1).is_none());
            let v: Vec<f64> = tangents.iter().flat_map(|t| &t.1).map(|x| f64::from(*x)).collect();
            let w: Vec<f64> = weights.data.iter().map(|x| f64::from(*x)).collect();
            let jv: Vec<f64> = forward.data.iter().map(|x| f64::from(*x)).collect();
            for (found, expected) in [(matrix.times(&v), jv), (matrix.transposed_times(&w), reverse.concat())] {
                let most = expected.iter().fold(0.0, |most: f64, x| most.max(x.abs()));
                let off = found.iter().zip(&expected).fold(0.0, |off: f64, (a, b)| off.max((a - b).abs()));
                assert!(found.len() == expected.len() && off < 1e-4 * most, "{output:?}: {off} of {most}");
            }
        }
    }
}

/// Directions, each of which moves one slot, and a last one that moves all.
fn directions(description: &SceneDescription, camera: &Camera) -> Vec<Direction> {
    let slots = all_slots(description, camera);
    let mut rng = dscene::math::Pcg32::new(8);
    let direction = |moved: usize| {
        let tangent = |(i, (slot, values)): (usize, &(Slot, Vec<f32>))| {
            let moves = moved == i || moved == slots.len();
            (*slot, values.iter().map(|_| if moves { rng.next_f32() - 0.5 } else { 0.0 }).collect())
        };
        slots.iter().enumerate().map(tangent).collect()
    };
    (0..=slots.len()).map(direction).collect()
}

/// Several directions cost one sweep, and each gets the bits that it would get alone.
#[test]
fn directions_at_once_are_directions_one_by_one() {
    for (description, camera) in every_second(scenes()) {
        let directions = directions(&description, &camera);
        let scene = Scene::new(description).unwrap();
        let settings = settings(Output::Radiance, 2, 3);
        let together = render_jacobian(&scene, &camera, &settings, &directions).unwrap();
        assert_eq!(together.len(), directions.len());
        for k in [0, 2, directions.len() / 2, directions.len() - 1] {
            let alone = render_forward(&scene, &camera, &settings, &directions[k]).unwrap();
            assert!(together[k] == alone, "direction {k}");
            assert!(k != directions.len() - 1 || alone.data.iter().any(|x| *x != 0.0));
        }
        // More than one sweep holds.
        let many: Vec<Direction> = directions.iter().cycle().take(70).cloned().collect();
        let many = render_jacobian(&scene, &camera, &settings, &many).unwrap();
        assert!(many.iter().zip(together.iter().cycle()).all(|(a, b)| a == b));
    }
}

/// Σ r · ∂image/∂x, once from the rows of the Jacobian and once in reverse mode, from the same samples.
#[test]
fn rows_of_the_jacobian_make_the_gradient_of_any_adjoint() {
    let (description, camera) = scene();
    let directions = directions(&description, &camera);
    let wrt: Vec<Slot> = directions[0].iter().map(|t| t.0).collect();
    let scene = Scene::new(description).unwrap();
    let settings = settings(Output::Radiance, 4, 3);
    let layout = Layout::new(&scene, &wrt);
    let mut even = Image::new(camera.width, camera.height, 3);
    even.data.fill(1.0);
    let interior = Interior::new(&scene, &camera, &settings, &layout, &even);
    let pass = interior.pass(interior.count(), 1.0, 5);
    let residual = weights(&camera, 3);
    let mut gradient = DenseSums::new(layout.size());
    reverse(&scene, &layout, &residual, &pass, &mut gradient, &NEVER);
    let gradient = gradient.into_vec();
    let dense: Vec<Vec<f32>> = directions.iter().map(|d| d.iter().flat_map(|t| t.1.clone()).collect()).collect();
    let tangents = Tangents::new(&dense, layout.size());
    let data = vec![0.0; even.data.len() * dense.len()];
    let mut rows = Images { directions: dense.len(), channels: 3, data };
    forward(&scene, &layout, || DirectionalDerivatives::new(&tangents), &pass, 1, &mut rows, &NEVER);
    for (k, tangent) in dense.iter().enumerate() {
        let row = rows.data.chunks_exact(3).skip(k).step_by(dense.len()).flatten();
        let terms: Vec<f64> = row.zip(&residual.data).map(|(j, r)| j * f64::from(*r)).collect();
        let (found, size) = (terms.iter().sum::<f64>(), terms.iter().map(|x| x.abs()).sum::<f64>());
        let expected: f64 = gradient.iter().zip(tangent).map(|(g, t)| g * f64::from(*t)).sum();
        assert!((found - expected).abs() <= 1e-4 * size, "direction {k}: {found} and {expected} of {size}");
    }
    assert!(gradient.iter().any(|g| *g != 0.0));
}

/// An adjoint that is not a number cannot be followed, and must not pass for zero.
#[test]
fn an_adjoint_that_is_not_finite_gives_no_numbers() {
    let (description, camera) = scene();
    let wrt: Vec<Slot> = all_slots(&description, &camera).into_iter().map(|s| s.0).collect();
    let scene = Scene::new(description).unwrap();
    for bad in [f32::NAN, f32::INFINITY] {
        let mut adjoint = Image::new(camera.width, camera.height, 3);
        adjoint.data[7] = bad;
        let settings = settings(Output::Radiance, 1, 3);
        let gradient = render_backward(&scene, &camera, &settings, &adjoint, &wrt).unwrap();
        assert!(gradient.iter().flatten().all(|g| g.is_nan()));
    }
}

/// Ranks that are threads of this process: a table of messages, by sender and receiver.
struct Threads {
    rank: usize,
    table: Arc<(Barrier, Mutex<Vec<Messages>>)>,
}

/// A message for each rank.
type Messages = Vec<Vec<u8>>;

impl Link for Threads {
    fn rank(&self) -> usize {
        self.rank
    }

    fn count(&self) -> usize {
        self.table.1.lock().unwrap().len()
    }

    fn neighbours(&self) -> usize {
        self.count()
    }

    fn exchange(&self, messages: Vec<Vec<u8>>) -> Result<Vec<Vec<u8>>, Lost> {
        let (barrier, table) = &*self.table;
        table.lock().unwrap()[self.rank] = messages;
        barrier.wait();
        let found = table.lock().unwrap().iter().map(|messages| messages[self.rank].clone()).collect();
        barrier.wait();
        Ok(found)
    }

    fn share(&self, message: Vec<u8>) -> Result<Vec<Vec<u8>>, Lost> {
        self.exchange(vec![message; self.count()])
    }

    fn end(&self) -> bool {
        true
    }
}

/// What each of so many ranks finds, with so many threads each.
fn by_ranks<T: Send>(count: usize, threads: usize, work: impl Fn() -> T + Sync) -> Vec<T> {
    let table = Arc::new((Barrier::new(count), Mutex::new(vec![Vec::new(); count])));
    let rank = |rank| {
        // Threads of a pool are no ranks, and what runs in one is alone: the work is done on this thread, with the pool's help.
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).use_current_thread().build().unwrap();
        let link = Arc::new(Threads { rank, table: table.clone() });
        pool.install(|| ranks::within(link, &work))
    };
    std::thread::scope(|scope| {
        let ranks: Vec<_> = (0..count).map(|number| scope.spawn(move || rank(number))).collect();
        ranks.into_iter().map(|rank| rank.join().unwrap()).collect()
    })
}

#[test]
fn any_number_of_threads_and_of_ranks_gives_the_same_bits() {
    let work = || -> Vec<_> {
        let one = |(description, camera): (SceneDescription, Camera)| {
            let wrt: Vec<Slot> = all_slots(&description, &camera).into_iter().map(|s| s.0).collect();
            let directions = directions(&description, &camera);
            let scene = Scene::new(description).unwrap();
            let settings = settings(Output::Radiance, 2, 9);
            let image = render(&scene, &camera, &settings).unwrap();
            let gradient = render_backward(&scene, &camera, &settings, &image, &wrt).unwrap();
            let jacobian = render_jacobian(&scene, &camera, &settings, &directions).unwrap();
            // Those of an optimisation's steps, which learn from one another.
            let memory = GuideCache::default();
            let steps = (0..3).map(|seed| {
                let (settings, sampling) = (Settings { seed, ..settings }, Sampling::ByAdjoint(Some(&memory)));
                render_backward_until(&scene, &camera, &settings, &image, &wrt, sampling, &NEVER).unwrap()
            });
            let steps: Vec<_> = steps.collect();
            assert!(
                steps[1] != render_backward(&scene, &camera, &Settings { seed: 1, ..settings }, &image, &wrt).unwrap()
            );
            let rows = render_rows_until(&scene, &camera, &settings, &wrt, 1 << 22, &NEVER).unwrap();
            // There are none of a scene that moves.
            let weights: Vec<f64> = image.data.iter().map(|x| f64::from(*x)).collect();
            let product = rows.map(|rows| rows.transposed_times(&weights));
            (image, gradient, jacobian, steps, product)
        };
        // In brief the plain scene and the one that moves.
        every_second(every_second(scenes())).map(one).collect()
    };
    let one = by_ranks(1, 1, work).remove(0);
    for (ranks, threads) in [(1, 3), (3, 2)] {
        for found in by_ranks(ranks, threads, work) {
            assert!(one == found, "{ranks} ranks with {threads} threads each");
        }
    }
    assert!(one.iter().all(|(_, gradient, ..)| gradient.iter().flatten().any(|g| *g != 0.0)));
}

/// Translating everything together changes nothing: the derivatives of all placements cancel, sample by sample (T15).
#[test]
fn common_translation_cancels() {
    for which in 0..scenes().len() {
        let build = |t: f32| {
            let (mut d, mut c) = scenes()[which].clone();
            let offset = vec3(0.3, -0.2, 0.5) * t;
            d.shapes.iter_mut().for_each(|s| s.mesh.vertices.iter_mut().for_each(|v| *v += offset));
            d.motions.iter_mut().for_each(|m| m.vertices.iter_mut().for_each(|v| *v += offset));
            for light in &mut d.delta_lights {
                if let DeltaLight::Point { position, .. } | DeltaLight::Spot { position, .. } = light {
                    *position += offset;
                }
            }
            c.origin += offset;
            (d, c)
        };
        let (description, camera) = build(0.0);
        let tangents = tangents(&build, 0.5);
        let wrt: Vec<Slot> = tangents.iter().map(|t| t.0).collect();
        let scene = Scene::new(description).unwrap();
        let settings = settings(Output::Radiance, 4, 1);
        let image = render(&scene, &camera, &settings).unwrap();
        let gradient = render_backward(&scene, &camera, &settings, &image, &wrt).unwrap();
        let terms =
            gradient.iter().zip(&tangents).flat_map(|(g, t)| g.iter().zip(&t.1)).map(|(g, t)| g * f64::from(*t));
        let (sum, size) = terms.fold((0.0, 0.0), |(s, a), x| (s + x, a + x.abs()));
        println!("{sum} of {size}");
        assert!(sum.abs() < 1e-4 * size, "translation gives {sum} of {size}");
    }
}
