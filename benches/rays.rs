//! Ray queries a second on one thread: camera rays, diffuse bounces and shadow rays.
//!
//! With DSCENE_EXPORT_RAYS=FOLDER the triangles and rays are written there too, as little-endian numbers of 32 bits: nine a triangle;
//! origin, direction, t_min and t_max a ray. `docs/peers/embree_rays.cpp` asks them of Embree.

use std::path::Path;

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use dscene::math::{Frame, Pcg32, cosine_hemisphere};
use dscene::mesh::shapes;
use dscene::render::Camera;
use dscene::render::accel::{Accel, Ray};
use glam::{Vec2, Vec3};

mod common;

type Triangles = Vec<[Vec3; 3]>;

fn triangles(mesh: &dscene::mesh::Mesh) -> impl Iterator<Item = [Vec3; 3]> + '_ {
    mesh.faces.iter().map(|f| f.map(|i| mesh.vertices[i as usize]))
}

/// A bumpy sphere of 4 n² triangles.
fn sphere(n: usize) -> (Triangles, Camera) {
    let mut mesh = shapes::sphere(1.0, n).unwrap();
    for v in &mut mesh.vertices {
        *v *= 1.0 + 0.03 * (25.0 * v.x).sin() * (23.0 * v.y).sin() * (21.0 * v.z).sin();
    }
    (triangles(&mesh).collect(), common::camera(Vec3::new(0.6, 0.8, 2.6), Vec3::ZERO, 0.42, 512))
}

fn cornell() -> (Triangles, Camera) {
    let (scene, camera, _) = common::cornell(512);
    (scene.shapes.iter().flat_map(|s| triangles(&s.mesh)).collect(), camera)
}

fn primary_rays(camera: &Camera) -> Vec<Ray> {
    let pixel = |i: usize| Vec2::new((i % camera.width) as f32 + 0.5, (i / camera.width) as f32 + 0.5);
    (0..camera.width * camera.height).map(|i| camera.ray(pixel(i))).collect()
}

/// A cosine-distributed ray from each hit.
fn bounce_rays(accel: &Accel, triangles: &Triangles, primary: &[Ray]) -> Vec<Ray> {
    let mut rng = Pcg32::new(1);
    primary
        .iter()
        .filter_map(|ray| {
            let hit = accel.closest(ray, &[])?;
            let [a, b, c] = triangles[hit.prim as usize];
            let n = (b - a).cross(c - a).normalize();
            let n = if n.dot(ray.dir) > 0.0 { -n } else { n };
            let dir = Frame::from_normal(n).to_world(cosine_hemisphere(rng.next_2d()));
            Some(Ray::new(ray.origin + ray.dir * hit.t + n * 1e-4, dir))
        })
        .collect()
}

fn rays(c: &mut Criterion) {
    let spheres = [143, 224, 570].map(|n| ("sphere", sphere(n)));
    for (name, (triangles, camera)) in [("cornell", cornell())].into_iter().chain(spheres) {
        let accel = Accel::new(&triangles);
        let primary = primary_rays(&camera);
        let bounce = bounce_rays(&accel, &triangles, &primary);
        let shadow: Vec<Ray> = bounce.iter().map(|r| Ray { t_max: 0.8, ..*r }).collect();
        if let Some(folder) = std::env::var_os("DSCENE_EXPORT_RAYS") {
            let numbers = |r: &Ray| [r.origin.to_array().to_vec(), r.dir.to_array().to_vec(), vec![r.t_min, r.t_max]];
            let of_rays = |rays: &[Ray]| rays.iter().flat_map(numbers).flatten().collect::<Vec<f32>>();
            let corners = triangles.iter().flatten().flat_map(|v| v.to_array()).collect::<Vec<f32>>();
            for (kind, numbers) in [
                ("triangles", corners),
                ("primary", of_rays(&primary)),
                ("bounce", of_rays(&bounce)),
                ("shadow", of_rays(&shadow)),
            ] {
                let file = Path::new(&folder).join(format!("{name}-{}.{kind}", triangles.len()));
                std::fs::write(file, bytemuck::cast_slice(&numbers)).expect("the folder can be written to");
            }
        }
        let mut group = c.benchmark_group(format!("{name} ({} triangles)", triangles.len()));
        group.sample_size(10);
        for (kind, rays) in [("primary", &primary), ("bounce", &bounce)] {
            group.throughput(Throughput::Elements(rays.len() as u64));
            group.bench_with_input(BenchmarkId::from_parameter(kind), rays, |b, rays| {
                b.iter(|| rays.iter().filter(|r| accel.closest(r, &[]).is_some()).count())
            });
        }
        group.throughput(Throughput::Elements(shadow.len() as u64));
        group.bench_with_input(BenchmarkId::from_parameter("shadow"), &shadow, |b, rays| {
            b.iter(|| rays.iter().filter(|r| accel.occluded(r, &[])).count())
        });
        group.finish();
    }
}

criterion_group!(benches, rays);
criterion_main!(benches);
