//! One step of an optimisation: primal render and gradient, at 256×256 and 4 samples a pixel on all threads.

use criterion::{Criterion, criterion_group, criterion_main};
use dscene::grad::{Output, Scene, Settings, render, render_backward};
use dscene::image::Image;
use dscene::render::Slot;

mod common;

fn steps(c: &mut Criterion) {
    let (blocker, blocker_camera, blocker_shape) = common::blocker(256);
    let (cornell, cornell_camera, cornell_shape) = common::cornell(256);
    let blocker_wrt = vec![Slot::Vertices(blocker_shape)];
    // The short block, the red wall's colour, the light's power.
    let light = cornell.textures.len() - 1;
    let cornell_wrt = vec![Slot::Vertices(cornell_shape), Slot::Texels(3), Slot::Texels(light)];
    for (name, description, camera, wrt, max_bounces) in [
        ("blocker", blocker, blocker_camera, blocker_wrt, 1),
        ("cornell, 1 bounce", cornell.clone(), cornell_camera, cornell_wrt.clone(), 1),
        ("cornell, 4 bounces", cornell, cornell_camera, cornell_wrt, 4),
    ] {
        let scene = Scene::new(description).unwrap();
        let settings =
            Settings { output: Output::Radiance, spp: 4, max_bounces, seed: 1, boundary: true, ..Settings::default() };
        let mut d_image = Image::new(camera.width, camera.height, 3);
        d_image.data.iter_mut().enumerate().for_each(|(i, d)| *d = if i % 7 < 3 { 1.0 } else { -0.5 });
        let mut group = c.benchmark_group(name);
        group.sample_size(10);
        group.bench_function("primal", |b| b.iter(|| render(&scene, &camera, &settings).unwrap()));
        group.bench_function("gradient", |b| {
            b.iter(|| render_backward(&scene, &camera, &settings, &d_image, &wrt).unwrap())
        });
        group.finish();
    }
}

criterion_group!(benches, steps);
criterion_main!(benches);
