use super::*;
use crate::math::Pcg32;
use crate::mesh::shapes;

type Corners = Vec<[Vec3; 3]>;

fn random_vec(rng: &mut Pcg32) -> Vec3 {
    Vec3::new(rng.next_f32(), rng.next_f32(), rng.next_f32()) * 2.0 - 1.0
}

fn below(rng: &mut Pcg32, count: usize) -> usize {
    rng.next_u32() as usize % count
}

/// The same tree with and without the processor's own instructions, all and some of them.
fn all_ways(corners: &[[Vec3; 3]]) -> [Accel; 3] {
    let accel = Accel::new(corners);
    let fewer = match accel.instructions {
        #[cfg(target_arch = "x86_64")]
        Instructions::Avx2(avx2) => Instructions::Avx2(avx2.without_avx512()),
        Instructions::Portable => Instructions::Portable,
    };
    [Instructions::Portable, fewer, accel.instructions].map(|instructions| Accel { instructions, ..accel.clone() })
}

/// The triangle test written down for one triangle.
fn intersect(corners: &[Vec3; 3], ray: &Ray) -> Option<(f32, [f32; 3])> {
    let size = ray.dir.abs();
    let z = if size.x > size.y && size.x > size.z {
        0
    } else if size.y > size.z {
        1
    } else {
        2
    };
    let (x, y) = ((z + 1) % 3, (z + 2) % 3);
    let inv = 1.0 / ray.dir[z];
    let (shear_x, shear_y) = (ray.dir[x] * inv, ray.dir[y] * inv);
    let [a, b, c] = corners.map(|p| {
        let p = p - ray.origin;
        Vec3::new(p[x] - shear_x * p[z], p[y] - shear_y * p[z], p[z])
    });
    let edge = |p: Vec3, q: Vec3| p.x * q.y - p.y * q.x;
    let (u, v, w) = (edge(c, b), edge(a, c), edge(b, a));
    let inside = (u >= 0.0 && v >= 0.0 && w >= 0.0) || (u <= 0.0 && v <= 0.0 && w <= 0.0);
    let det = u + v + w;
    if !inside || det == 0.0 {
        return None;
    }
    let scale = 1.0 / det;
    let (u, v, w) = (u * scale, v * scale, w * scale);
    let t = (u * a.z + v * b.z + w * c.z) * inv;
    (ray.t_min <= t && t < ray.t_max).then_some((t, [u, v, w]))
}

fn brute_force(corners: &[[Vec3; 3]], ray: &Ray, skip: &[PrimId]) -> Option<Hit> {
    (0..)
        .zip(corners)
        .filter(|(prim, _)| !skip.contains(prim))
        .filter_map(|(prim, corners)| intersect(corners, ray).map(|(t, b)| Hit { t, prim, b }))
        .min_by(|a, b| a.t.total_cmp(&b.t).then(a.prim.cmp(&b.prim)))
}

/// Asks for the hits of a ray in all ways; they must be the same to the last bit.
fn check(accels: &[Accel; 3], corners: &[[Vec3; 3]], ray: &Ray, skip: &[PrimId]) -> Option<Hit> {
    let expected = brute_force(corners, ray, skip);
    for accel in accels {
        assert_eq!(accel.closest(ray, skip), expected, "{ray:?} {skip:?}");
        assert_eq!(accel.occluded(ray, skip), expected.is_some(), "{ray:?} {skip:?}");
    }
    expected
}

/// A triangle of each kind.
fn soups() -> Vec<(&'static str, Corners)> {
    let mut rng = Pcg32::new(7);
    let mut soup = |count: usize, make: &dyn Fn(&mut Pcg32) -> [Vec3; 3]| -> Corners {
        (0..count).map(|_| make(&mut rng)).collect()
    };
    let small = |rng: &mut Pcg32| {
        let p = random_vec(rng);
        [p, p + 0.3 * random_vec(rng), p + 0.3 * random_vec(rng)]
    };
    // On a grid, rays lie in the planes of triangles and boxes, and go through corners and along edges.
    let on_grid = |rng: &mut Pcg32| [0; 3].map(|_| (random_vec(rng) * 3.0).round() / 3.0);
    let sliver = |rng: &mut Pcg32| {
        let (p, d) = (random_vec(rng), random_vec(rng));
        [p, p + d, p + 0.5 * d + 1e-5 * random_vec(rng)]
    };
    let mut twice = soup(150, &small);
    twice.extend_from_within(..);
    // Not walked, but tested all at once: with several hits at the same distance, in the same lane and in others.
    let mut few_twice = soup(13, &on_grid);
    few_twice.extend_from_within(..);
    vec![
        ("one", soup(1, &small)),
        ("few", soup(9, &small)),
        ("small", soup(500, &small)),
        ("everywhere", soup(1000, &|rng| [0; 3].map(|_| random_vec(rng)))),
        ("on a grid", soup(300, &on_grid)),
        ("slivers", soup(300, &sliver)),
        ("each twice", twice),
        ("few on a grid", soup(40, &on_grid)),
        ("few, each twice", few_twice),
    ]
}

fn random_ray(rng: &mut Pcg32, corners: &[[Vec3; 3]]) -> Ray {
    let tri = corners[below(rng, corners.len())];
    let mut origin = 2.0 * random_vec(rng);
    let mut dir = random_vec(rng);
    match below(rng, 5) {
        0 => dir = tri[below(rng, 3)] - origin,
        1 => dir = tri[0].lerp(tri[1], rng.next_f32()) - origin,
        2 => {
            // Along an axis, through a corner, with zeros of any sign.
            let zero = [0.0, -0.0][below(rng, 2)];
            dir = Vec3::splat(zero);
            let axis = below(rng, 3);
            dir[axis] = [1.0, -1.0][below(rng, 2)];
            origin = tri[below(rng, 3)] - 4.0 * dir;
        }
        3 => origin = (origin * 3.0).round() / 3.0,
        _ => {}
    }
    let mut ray = Ray::new(origin, dir.try_normalize().unwrap_or(Vec3::X));
    if below(rng, 2) == 0 {
        ray.t_min = rng.next_f32();
        ray.t_max = ray.t_min + 2.0 * rng.next_f32();
    }
    ray
}

#[test]
fn agrees_with_brute_force_to_the_last_bit() {
    let mut rng = Pcg32::new(1);
    for (name, corners) in soups() {
        let accels = all_ways(&corners);
        assert_eq!(accels[0].tree.is_small(), name.starts_with("few") || name == "one", "{name}");
        let rays = 3_000_000 / (corners.len() + 600);
        let mut hits = 0;
        for _ in 0..rays {
            let ray = random_ray(&mut rng, &corners);
            let skip: Vec<PrimId> = (0..below(&mut rng, 4)).map(|_| below(&mut rng, corners.len()) as PrimId).collect();
            let Some(hit) = check(&accels, &corners, &ray, &skip) else { continue };
            hits += 1;
            // The next one behind it, and nothing before it.
            check(&accels, &corners, &ray, &[skip, vec![hit.prim]].concat());
            check(&accels, &corners, &Ray { t_max: hit.t, ..ray }, &[]);
            check(&accels, &corners, &Ray { t_min: hit.t, ..ray }, &[]);
        }
        assert!(hits > rays / 50, "{name}: {hits} of {rays}");
    }
}

#[test]
fn any_size_of_coordinates_will_do() {
    let mut rng = Pcg32::new(5);
    let unit: Corners = soups().swap_remove(2).1;
    for scale in [1e-9f32, 1e9, 1e18] {
        let corners: Corners = unit.iter().map(|t| t.map(|p| p * scale)).collect();
        let accels = all_ways(&corners);
        let mut hits = 0;
        for _ in 0..1000 {
            let mut ray = random_ray(&mut rng, &unit);
            ray.origin *= scale;
            ray.t_min *= scale;
            ray.t_max *= scale;
            hits += check(&accels, &corners, &ray, &[]).is_some() as usize;
        }
        assert!(hits > 200, "{scale}: {hits}");
    }
}

#[test]
fn what_overflows_is_not_hit() {
    // The edge functions are finite, but not their sum: everything divided by it is zero, the distance too.
    let far = 1.2e19;
    let corners = [[Vec3::new(-far, -far, far), Vec3::new(far, -far, far), Vec3::new(0.0, far, far)]];
    for accel in all_ways(&corners) {
        for x in [0.0, 0.01, -0.3] {
            let ray = Ray::new(Vec3::ZERO, Vec3::new(x, 0.0, 1.0).normalize());
            assert!(accel.closest(&ray, &[]).is_none() && !accel.occluded(&ray, &[]));
        }
    }
}

#[test]
fn distances_and_barycentric_coordinates_are_those_of_the_hit_point() {
    let mut rng = Pcg32::new(11);
    let corners = soups().swap_remove(2).1;
    for accel in all_ways(&corners) {
        for _ in 0..2000 {
            let ray = Ray::new(2.0 * random_vec(&mut rng), random_vec(&mut rng).normalize());
            let Some(hit) = accel.closest(&ray, &[]) else { continue };
            let [a, b, c] = corners[hit.prim as usize];
            let p = a * hit.b[0] + b * hit.b[1] + c * hit.b[2];
            assert!(p.distance(ray.origin + ray.dir * hit.t) < 1e-5, "{hit:?}");
            assert!((hit.b.iter().sum::<f32>() - 1.0).abs() < 1e-6, "{hit:?}");
        }
    }
}

#[test]
fn of_triangles_in_one_place_the_first_is_hit() {
    for size in [1.0f32, 1e-3, 1e-12, 1e-25, 0.0] {
        let one = [Vec3::ZERO, Vec3::X * size, Vec3::Y * size];
        let behind = [Vec3::ZERO, Vec3::X, Vec3::Y].map(|p| p + Vec3::Z);
        let mut corners = vec![one; 2000];
        corners.push(behind);
        let ray = Ray::new(Vec3::new(0.2 * size, 0.2 * size, -2.0), Vec3::Z);
        for accel in all_ways(&corners) {
            let first = if size > 1e-20 { 0 } else { 2000 };
            assert_eq!(accel.closest(&ray, &[]).unwrap().prim, first, "size {size}");
            let nearly_all: Vec<PrimId> = (0..1999).collect();
            let last = if size > 1e-20 { 1999 } else { 2000 };
            assert_eq!(accel.closest(&ray, &nearly_all).unwrap().prim, last, "size {size}");
            assert!(!accel.occluded(&ray, &[nearly_all, vec![1999, 2000]].concat()));
        }
    }
}

/// Rays from inside a closed mesh hit it, whatever they are aimed at.
#[test]
fn nothing_leaves_a_closed_mesh() {
    let mut rng = Pcg32::new(3);
    let mut mesh = shapes::sphere(1.0, 24).unwrap();
    for v in &mut mesh.vertices {
        *v *= 1.0 + 0.2 * (9.0 * v.x).sin() * (8.0 * v.y).sin();
    }
    let corners: Corners = mesh.faces.iter().map(|f| f.map(|i| mesh.vertices[i as usize])).collect();
    for accel in all_ways(&corners) {
        for origin in [Vec3::ZERO, Vec3::new(0.1, -0.2, 0.05), Vec3::new(0.5, 0.0, 0.0)] {
            for tri in &corners {
                let [a, b, c] = *tri;
                let targets = [a, a.midpoint(b), b.lerp(c, rng.next_f32()), c.lerp(a, rng.next_f32())];
                for target in targets {
                    let ray = Ray::new(origin, (target - origin).normalize());
                    assert!(accel.closest(&ray, &[]).is_some() && accel.occluded(&ray, &[]), "{ray:?}");
                }
            }
            for axis in [Vec3::X, Vec3::Y, Vec3::Z] {
                for dir in [axis, -axis, axis * -1.0] {
                    assert!(accel.closest(&Ray::new(origin, dir), &[]).is_some(), "{origin} {dir}");
                }
            }
        }
    }
}

#[test]
fn no_gap_at_the_shared_edges_of_slivers() {
    // A fan: rays at points of the shared edges must hit one of the two neighbours.
    let mut rng = Pcg32::new(3);
    let n = 64;
    let rim: Vec<Vec3> = (0..n)
        .map(|i| {
            let a = i as f32 / n as f32 * std::f32::consts::TAU;
            Vec3::new(a.cos(), a.sin(), 0.1 * (3.0 * a).sin())
        })
        .collect();
    let centre = Vec3::new(0.03, -0.02, 0.3);
    let corners: Corners = (0..n).map(|i| [centre, rim[i], rim[(i + 1) % n]]).collect();
    let accels = all_ways(&corners);
    for _ in 0..20000 {
        let i = below(&mut rng, n);
        let target = centre.lerp(rim[i], 0.99 * rng.next_f32());
        let origin = Vec3::new(0.2 * rng.next_f32(), 0.2 * rng.next_f32(), 5.0);
        let ray = Ray::new(origin, (target - origin).normalize());
        assert!(accels.iter().all(|a| a.closest(&ray, &[]).is_some()), "{ray:?}");
    }
}

#[test]
fn rays_along_an_axis_hit_whatever_the_sign_of_their_zeros() {
    let corners = [[Vec3::ZERO, Vec3::X, Vec3::Y].map(|p| p - Vec3::Z)];
    for accel in all_ways(&corners) {
        // Inside of it, and in the planes of its box.
        for (px, py) in [(0.2, 0.2), (0.0, 0.2), (0.2, 0.0), (0.0, 0.0), (0.5, 0.5), (1.0, 0.0)] {
            for (x, y) in [(0.0, 0.0), (0.0, -0.0), (-0.0, 0.0), (-0.0, -0.0)] {
                let ray = Ray::new(Vec3::new(px, py, 0.0), Vec3::new(x, y, -1.0));
                assert!(accel.closest(&ray, &[]).is_some() && accel.occluded(&ray, &[]), "{ray:?}");
            }
        }
    }
}

#[test]
fn rays_that_are_no_rays_hit_nothing() {
    let corners = [[Vec3::ZERO, Vec3::X, Vec3::Y]];
    for accel in all_ways(&corners) {
        for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            let rays = [
                Ray::new(Vec3::splat(bad), Vec3::Z),
                Ray::new(Vec3::ZERO, Vec3::new(0.0, bad, 1.0)),
                Ray::new(Vec3::new(0.2, 0.2, bad), Vec3::Z),
            ];
            for ray in rays {
                assert!(accel.closest(&ray, &[]).is_none() && accel.occluded(&ray, &[]), "{ray:?}");
            }
        }
        let ahead = Ray::new(Vec3::new(0.2, 0.2, -1.0), Vec3::Z);
        assert!(accel.closest(&ahead, &[]).is_some());
        for ray in [
            Ray { dir: Vec3::ZERO, ..ahead },
            Ray { t_max: f32::NAN, ..ahead },
            Ray { t_min: f32::NAN, ..ahead },
            Ray { t_max: 0.0, ..ahead },
            Ray { t_max: -1.0, ..ahead },
            Ray { t_min: 2.0, ..ahead },
        ] {
            assert!(accel.closest(&ray, &[]).is_none() && !accel.occluded(&ray, &[]), "{ray:?}");
        }
    }
}

#[test]
fn scenes_without_area_are_empty() {
    for corners in [vec![], vec![[Vec3::ONE; 3]; 5], vec![[Vec3::ZERO, Vec3::X, Vec3::X * 2.0]]] {
        for mut accel in all_ways(&corners) {
            let ray = Ray::new(Vec3::ZERO, Vec3::X);
            assert!(accel.closest(&ray, &[]).is_none() && !accel.occluded(&ray, &[]));
            assert!(!accel.occluded(&Ray::new(Vec3::NAN, Vec3::X), &[]));
            assert_eq!(accel.refit(&corners), 1.0);
        }
    }
}

#[test]
fn a_tree_refitted_is_as_good_as_a_new_one() {
    let mut rng = Pcg32::new(17);
    for (name, corners) in soups() {
        let mut accels = all_ways(&corners);
        for step in 1..4 {
            let moved: Corners = corners
                .iter()
                .map(|t| t.map(|p| p + 0.1 * step as f32 * Vec3::new((3.0 * p.y).sin(), (2.0 * p.z).cos(), p.x * p.y)))
                .collect();
            for accel in &mut accels {
                let growth = accel.refit(&moved);
                assert!((0.4..1.6).contains(&growth), "{name}: {growth}");
            }
            for _ in 0..300 {
                let ray = random_ray(&mut rng, &moved);
                check(&accels, &moved, &ray, &[]);
            }
        }
    }
}

#[test]
fn refitting_tells_when_to_build_anew() {
    let mut rng = Pcg32::new(23);
    let mut corners = soups().swap_remove(2).1;
    let mut accel = Accel::new(&corners);
    assert_eq!(accel.refit(&corners), 1.0);
    // The heuristic has no place and no scale.
    let elsewhere: Corners = corners.iter().map(|t| t.map(|p| 3.0 * p + Vec3::ONE)).collect();
    assert!((accel.refit(&elsewhere) - 1.0).abs() < 1e-4);
    // Triangles that change places make boxes that overlap.
    for _ in 0..1000 {
        let (i, k) = (below(&mut rng, corners.len()), below(&mut rng, corners.len()));
        corners.swap(i, k);
    }
    assert!(accel.refit(&corners) > 2.0);
    assert_eq!(Accel::new(&corners).refit(&corners), 1.0);
}

#[test]
fn what_refitting_cannot_do_is_built_anew() {
    let corners = soups().swap_remove(1).1;
    let mut flat = corners.clone();
    flat[4] = [flat[4][0]; 3];
    let through = |t: &[Vec3; 3]| {
        let target = (t[0] + t[1] + t[2]) / 3.0;
        Ray::new(target + Vec3::Z * 5.0, -Vec3::Z)
    };
    let others: Vec<PrimId> = (0..9).filter(|&i| i != 4).collect();
    for mut accel in all_ways(&flat) {
        let ray = through(&corners[4]);
        assert!(accel.closest(&ray, &others).is_none());
        // A triangle that had no area has one.
        assert_eq!(accel.refit(&corners), 1.0);
        assert_eq!(accel.closest(&ray, &others).unwrap().prim, 4);
        // It loses it again.
        accel.refit(&flat);
        assert!(accel.closest(&ray, &others).is_none());
        // Another number of triangles.
        assert_eq!(accel.refit(&corners[..5]), 1.0);
        assert_eq!(accel.closest(&ray, &others).unwrap().prim, 4);
        assert_eq!(accel.refit(&corners), 1.0);
    }
}

#[test]
fn what_follows_keeps_its_tree_unless_that_is_worn() {
    let mut rng = Pcg32::new(31);
    let corners = soups().swap_remove(2).1;
    let moved: Corners =
        corners.iter().map(|t| t.map(|p| p + 0.05 * Vec3::new(p.y.sin(), p.z.cos(), p.x * p.y))).collect();
    let mut shuffled = corners.clone();
    for _ in 0..1000 {
        let (i, k) = (below(&mut rng, corners.len()), below(&mut rng, corners.len()));
        shuffled.swap(i, k);
    }
    let order = |accel: &Accel| accel.tree.blocks.iter().flat_map(|b| b.prims).collect::<Vec<PrimId>>();
    let first = Accel::new(&corners);
    let mut accels = all_ways(&corners);
    for (now, kept) in [(&moved, true), (&shuffled, false)] {
        for accel in &mut accels {
            accel.refit_or_rebuild(now);
            assert_eq!(order(accel) == order(&first), kept);
            assert!(kept || order(accel) == order(&Accel::new(now)));
        }
        for _ in 0..300 {
            check(&accels, now, &random_ray(&mut rng, now), &[]);
        }
    }
}

#[test]
fn trees_are_built_with_checks() {
    let corner = |i: u32| Vec3::new((i % 512) as f32, (i / 512) as f32, 0.0);
    let corners: Vec<[Vec3; 3]> = (0..100_000).map(|i| [corner(i), corner(i) + Vec3::X, corner(i) + Vec3::Y]).collect();
    let before = crate::stop::checks();
    let tree = Accel::new(&corners);
    let found: Vec<PrimId> = tree.overlapping_pairs(0.0, |_| true, |[a, _], found| found.push(a));
    assert!(found.len() > 100_000);
    assert!(crate::stop::checks() - before > 10, "{}", crate::stop::checks() - before);
    let set = std::sync::Arc::new(true.into());
    let stopped = Err(crate::stop::Stopped);
    assert_eq!(crate::stop::until(&set, || drop(Accel::new(&corners))), stopped);
    assert_eq!(
        crate::stop::until(&set, || drop(tree.overlapping_pairs(0.0, |_| true, |_, found| found.push(0)))),
        stopped
    );
}
