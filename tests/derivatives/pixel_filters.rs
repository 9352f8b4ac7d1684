//! Pixel filters: images of a straight edge and their derivatives against integrals of the filter, written anew here.

use crate::common::*;
use dscene::grad::{render_backward, render_forward};
use dscene::image::Image;
use dscene::render::*;
use glam::{DVec2, Vec3, vec3};

/// Pixels along each side of the film. One unit of the world is one pixel.
const FILM: usize = 6;
const HALF: f64 = 3.0;

/// A filter along one axis: the formulas of the books.
fn along(filter: PixelFilter, x: f64) -> f64 {
    let x = x.abs();
    match filter {
        PixelFilter::Box => f64::from(u8::from(x < 0.5)),
        PixelFilter::Tent => (1.0 - x).max(0.0),
        // 0.99993666 of the distribution lies within four deviations.
        PixelFilter::Gaussian if x < 2.0 => {
            (-2.0 * x * x).exp() * (2.0 / std::f64::consts::PI).sqrt() / 0.999_936_657_5
        }
        PixelFilter::Mitchell if x < 1.0 => (21.0 * x.powi(3) - 36.0 * x.powi(2) + 16.0) / 18.0,
        PixelFilter::Mitchell if x < 2.0 => (-7.0 * x.powi(3) + 36.0 * x.powi(2) - 60.0 * x + 32.0) / 18.0,
        _ => 0.0,
    }
}

/// A straight edge on film: what is to the left of it, along `u`, glows.
#[derive(Clone, Copy)]
struct Line {
    p: DVec2,
    u: DVec2,
}

impl Line {
    fn slanted() -> Line {
        Line { p: DVec2::new(2.3, 3.1), u: DVec2::from_angle(1.2) }
    }

    /// From what glows to what is dark. (y points down.)
    fn normal(&self) -> DVec2 {
        DVec2::new(self.u.y, -self.u.x)
    }

    /// The integral of a pixel's filter along the edge, moved by `offset`.
    fn weight(&self, filter: PixelFilter, pixel: usize, offset: DVec2) -> f64 {
        // The box has steps.
        let (count, step) = if filter == PixelFilter::Box { (3000, 0.001) } else { (150, 0.02) };
        let centre = DVec2::new((pixel % FILM) as f64 + 0.5, (pixel / FILM) as f64 + 0.5);
        let from_centre = self.p + offset - centre;
        let nearest = -from_centre.dot(self.u);
        let at = |i: i32| from_centre + self.u * (nearest + (f64::from(i) + 0.5) * step);
        (-count..count).map(|i| along(filter, at(i).x) * along(filter, at(i).y) * step).sum()
    }

    /// The corners of a rectangle that ends at the edge, and beyond the film elsewhere.
    fn rectangle(&self) -> [DVec2; 4] {
        let (u, n) = (30.0 * self.u, 30.0 * self.normal());
        [self.p - u, self.p + u, self.p + u - n, self.p - u - n]
    }
}

/// An orthographic camera that looks along z and sees pixel (x, y) at world (x − 3, 3 − y).
fn eye(filter: PixelFilter) -> Camera {
    let frame = [Vec3::X, Vec3::Y, Vec3::Z];
    let origin = vec3(0.0, 0.0, -10.0);
    let projection = Projection::Orthographic;
    let scale = [HALF as f32; 2];
    Camera { projection, origin, frame, scale, filter, ..look_at(Vec3::ZERO, Vec3::Z, 45.0, FILM) }
}

fn corners(line: Line, place: impl Fn(f32, f32) -> Vec3) -> dscene::mesh::Mesh {
    let [a, b, c, d] = line.rectangle().map(|p| place((p.x - HALF) as f32, (HALF - p.y) as f32));
    quad(a, b, c, d)
}

/// A scene of which the camera sees an edge that moves to the right, one pixel for a unit of θ.
struct View {
    name: &'static str,
    build: fn(PixelFilter, Line, f32) -> (SceneDescription, Camera),
    bounces: u32,
    /// The radiance that appears where the edge has passed.
    jump: f64,
    /// Radius of the blur of the edge, in pixels.
    blur: f64,
}

const VIEWS: [View; 5] = [
    View { name: "a lamp", build: lamp, bounces: 0, jump: 1.0, blur: 0.0 },
    View { name: "a moving camera", build: moving_camera, bounces: 0, jump: 1.0, blur: 0.0 },
    View { name: "a lamp in a mirror", build: mirrored, bounces: 1, jump: 1.0, blur: 0.0 },
    View { name: "a lamp through a lens", build: blurred, bounces: 0, jump: 1.0, blur: 0.8 },
    View { name: "a shadow", build: shadow, bounces: 1, jump: -1.0, blur: 0.0 },
];

fn lamp(filter: PixelFilter, line: Line, t: f32) -> (SceneDescription, Camera) {
    let mut b = Builder::default();
    b.glowing(corners(line, |x, y| vec3(x + t, y, 0.0)), 1.0);
    (b.description, eye(filter))
}

fn moving_camera(filter: PixelFilter, line: Line, t: f32) -> (SceneDescription, Camera) {
    let (description, camera) = lamp(filter, line, 0.0);
    (description, Camera { origin: camera.origin - t * Vec3::X, ..camera })
}

fn blurred(filter: PixelFilter, line: Line, t: f32) -> (SceneDescription, Camera) {
    let (description, camera) = lamp(filter, line, t);
    // The lamp is ten units away: twice as far as what is sharp.
    (description, Camera { lens: Lens { radius: 0.8, focus: 5.0, ..Lens::PINHOLE }, ..camera })
}

fn mirrored(filter: PixelFilter, line: Line, t: f32) -> (SceneDescription, Camera) {
    let mut b = Builder::default();
    let reflectance = b.grey(1.0);
    // The plane y = z turns what the camera sees upwards.
    let at = |x: f32, y: f32| vec3(x, y, y);
    b.add(quad(at(-9.0, -9.0), at(9.0, -9.0), at(9.0, 9.0), at(-9.0, 9.0)), MaterialKind::Mirror { reflectance });
    b.glowing(corners(line, |x, y| vec3(x + t, 40.0, y)), 1.0);
    (b.description, eye(filter))
}

/// The sun throws the shadow of what is behind the camera.
fn shadow(filter: PixelFilter, line: Line, t: f32) -> (SceneDescription, Camera) {
    let mut b = Builder::default();
    let wall = |x: f32, y: f32| vec3(x, y, 0.0);
    b.matte(quad(wall(-20.0, -20.0), wall(-20.0, 20.0), wall(20.0, 20.0), wall(20.0, -20.0)), 1.0);
    let direction = vec3(0.5, 0.2, 1.0);
    b.black(corners(line, |x, y| vec3(x + t, y, 0.0) - 20.0 * direction));
    // A white wall of radiance 1.
    let irradiance = Vec3::splat(std::f32::consts::PI * direction.length());
    b.description.delta_lights.push(DeltaLight::Directional { direction, irradiance });
    (b.description, eye(filter))
}

/// Mean over the blur of the edge.
fn over_blur(blur: f64, f: impl Fn(DVec2) -> f64) -> f64 {
    const RINGS: usize = 6;
    const SPOKES: usize = 24;
    if blur == 0.0 {
        return f(DVec2::ZERO);
    }
    let offset = |i: usize| {
        let r = blur * ((i / SPOKES) as f64 + 0.5).sqrt() / (RINGS as f64).sqrt();
        DVec2::from_angle(std::f64::consts::TAU * (i % SPOKES) as f64 / SPOKES as f64) * r
    };
    (0..RINGS * SPOKES).map(|i| f(offset(i))).sum::<f64>() / (RINGS * SPOKES) as f64
}

fn settings(spp: u32, bounces: u32, seed: u64) -> Settings {
    Settings { output: Output::Radiance, spp, max_bounces: bounces, seed, boundary: true, ..Settings::default() }
}

/// The mean of images, pixel by pixel, with its errors.
fn measured(seeds: u64, image: impl Fn(u64) -> Image) -> Vec<Measured> {
    let images: Vec<Image> = (0..seeds).map(image).collect();
    let pixel = |p: usize| statistics(&images.iter().map(|i| f64::from(i.data[3 * p])).collect::<Vec<f64>>());
    (0..FILM * FILM).map(pixel).collect()
}

fn compare(what: &str, found: &[Measured], exact: &[f64], tolerance: f64) {
    for (pixel, (found, exact)) in found.iter().zip(exact).enumerate() {
        let (off, error) = ((found.mean - exact).abs(), found.error);
        assert!(off < 4.5 * error + 4e-3, "{what}, pixel {pixel}: {} ± {error} instead of {exact}", found.mean);
        assert!(error < tolerance, "{what}, pixel {pixel}: {} ± {error} says nothing", found.mean);
    }
}

/// The same view as a part of a larger film, from its second column and its third row on.
fn part_of_a_film(camera: Camera) -> Camera {
    let crop = Crop { corner: [1, 2], film: [10, 9] };
    let middle =
        [crop.corner[0] as f32 + 0.5 * (FILM as f32 - 10.0), crop.corner[1] as f32 + 0.5 * (FILM as f32 - 9.0)];
    let origin = camera.origin - middle[0] * Vec3::X + middle[1] * Vec3::Y;
    Camera { crop: Some(crop), scale: [5.0, 4.5], origin, ..camera }
}

/// Every pixel of the image of an edge, its derivative in forward mode, and sums over pixels with any weights in reverse mode.
#[test]
fn the_image_of_an_edge_is_an_integral_of_the_filter() {
    let parts = VIEWS.into_iter().take(if long() { VIEWS.len() } else { 1 }).map(|view| (view, true));
    let views = VIEWS.into_iter().map(|view| (view, false)).chain(parts);
    for (number, (view, is_part)) in views.enumerate() {
        let filters = PixelFilter::NAMES.into_iter().filter(|(name, _)| !is_part || *name != "gaussian");
        // In brief by other filters from view to view.
        for (name, filter) in every_second(filters.skip(if long() { 0 } else { number % 2 })) {
            let what = format!("{} under {name}{}", view.name, if is_part { ", in part" } else { "" });
            let line = Line::slanted();
            let build = |t: f32| {
                let (description, camera) = (view.build)(filter, line, t);
                (description, if is_part { part_of_a_film(camera) } else { camera })
            };
            let (description, camera) = build(0.0);
            let scene = Scene::new(description).unwrap();
            let offset = |d: f64| line.normal() * d;
            // The part of the filter to the left of the edge, as far as it reaches.
            let left = |pixel: usize| {
                let steps = (-200..0).map(|i| offset((f64::from(i) + 0.5) * 0.025));
                steps.map(|by| line.weight(filter, pixel, by)).sum::<f64>() * 0.025
            };
            let value = |pixel: usize| 0.5 - view.jump * 0.5 + view.jump * left(pixel);
            if view.blur == 0.0 && filter != PixelFilter::Box {
                let exact: Vec<f64> = (0..FILM * FILM).map(value).collect();
                let image = |seed| render(&scene, &camera, &settings(256, view.bounces, seed)).unwrap();
                compare(&format!("image of {what}"), &measured(8, image), &exact, 0.02);
            }
            let speed = view.jump * line.normal().x;
            let exact: Vec<f64> =
                (0..FILM * FILM).map(|p| speed * over_blur(view.blur, |by| line.weight(filter, p, by))).collect();
            let tangents = tangents(&build, 0.01);
            let forward = |seed| render_forward(&scene, &camera, &settings(64, view.bounces, seed), &tangents).unwrap();
            compare(&format!("derivative of {what}"), &measured(8, forward), &exact, 0.02);

            let mut weights = Image::new(FILM, FILM, 3);
            let signs = (0..FILM * FILM).map(|p| [1.0, -2.0, 0.0, 3.0, 0.5, -1.0, 0.0][p * 5 % 7]);
            weights.data.chunks_mut(3).zip(signs).for_each(|(pixel, sign)| pixel[0] = sign);
            let wrt: Vec<Slot> = tangents.iter().map(|t| t.0).collect();
            let reverse = |seed| {
                let found =
                    render_backward(&scene, &camera, &settings(64, view.bounces, seed), &weights, &wrt).unwrap();
                found.iter().zip(&tangents).flat_map(|(g, t)| g.iter().zip(&t.1)).map(|(g, t)| g * f64::from(*t)).sum()
            };
            let found = statistics(&(0..8).map(reverse).collect::<Vec<f64>>());
            let exact: f64 = exact.iter().zip(weights.data.chunks(3)).map(|(e, w)| e * f64::from(w[0])).sum();
            assert!((found.mean - exact).abs() < 4.5 * found.error + 5e-3, "{what}: {found:?} instead of {exact}");
            assert!(found.error < 0.05, "{what}: {found:?} says nothing");
        }
    }
}

/// Where an upright edge passes a pixel, a tent sees (1 + d)² / 2 of what is to the left of it, d pixels before the centre.
#[test]
fn a_tent_sees_a_square_of_the_way() {
    for d in [-0.75, -0.25, 0.0, 0.5] {
        let line = Line { p: DVec2::new(2.5 + d, 3.0), u: DVec2::Y };
        let (description, camera) = lamp(PixelFilter::Tent, line, 0.0);
        let scene = Scene::new(description).unwrap();
        let image = render(&scene, &camera, &settings(1024, 0, 1)).unwrap();
        let exact = if d < 0.0 { 0.5 * (1.0 + d).powi(2) } else { 1.0 - 0.5 * (1.0 - d).powi(2) };
        let found = f64::from(image.pixel(2, 3)[0]);
        assert!((found - exact).abs() < 3e-3, "at {d}: {found} instead of {exact}");
    }
}

/// Weights of samples add up to one in every pixel: an even sky is even.
#[test]
fn what_is_even_stays_even() {
    let mut b = Builder::default();
    let Input::Texture(radiance) = b.constant(Vec3::splat(0.3)) else { unreachable!() };
    b.description.environment = Some(SphericalMap { texels: radiance, rotation: glam::Mat3::IDENTITY });
    let scene = Scene::new(b.description).unwrap();
    for (name, filter) in PixelFilter::NAMES {
        for spp in [2, 3, 16, 100] {
            let camera = Camera { filter, ..look_at(Vec3::Z, Vec3::ZERO, 45.0, 5) };
            let image = render(&scene, &camera, &settings(spp, 0, 4)).unwrap();
            assert!(image.data.iter().all(|x| (x - 0.3).abs() < 1e-6), "{name}, {spp}: {:?}", image.data);
        }
    }
}

/// Whole renderings on a film so small that its borders matter, against differences.
#[test]
fn filters_against_differences() {
    let scene = |t: f32, eye: Vec3, filter: PixelFilter, mirror: bool| {
        let mut b = Builder::default();
        let grey = b.diffuse(Vec3::splat(0.6));
        b.add(floor(Vec3::ZERO, 2.0), grey.clone());
        b.add(cuboid(vec3(0.1 + t, 0.7, -0.1), vec3(0.4, 0.3, 0.5), 0.4), grey);
        if mirror {
            b.ball(vec3(-0.7, 0.6, 0.4), 0.5);
        }
        b.lamp(ceiling(vec3(0.3, 3.0, -0.5), 0.4), Vec3::splat(20.0));
        (b.description, Camera { filter, ..look_at(eye, vec3(0.0, 0.4, 0.0), 30.0, FILM) })
    };
    let at = vec3(0.5, 2.0, -4.0);
    let plan = Plan { h: 0.06, ..Plan::default() };
    for (name, filter) in &PixelFilter::NAMES[1..] {
        agree(&format!("{name}: box x"), &|t| scene(t, at, *filter, false), &plan);
        agree(&format!("{name}: camera y"), &|t| scene(0.0, at + t * Vec3::Y, *filter, false), &plan);
    }
    // What the mirror shows moves fast: the differences take small steps.
    let mirror = Plan { h: 0.02, spp: 128, fd_spp: 2048, max_bounces: 2, ..plan };
    agree_in_long("mitchell: box x beside a mirror", &|t| scene(t, at, PixelFilter::Mitchell, true), &mirror);
    let depth = Plan { output: Output::Depth, h: 0.02, spp: 64, fd_spp: 4096, ..plan };
    agree_in_long("tent: box x, its depth", &|t| scene(t, at, PixelFilter::Tent, false), &depth);
    let distortion = Distortion { coefficients: [-0.2, 0.05, 0.01, 0.02, 0.0] };
    let bent = |t: f32| {
        let (description, camera) = scene(t, at, PixelFilter::Gaussian, false);
        (description, Camera { distortion, ..camera })
    };
    agree("gaussian: box x through a lens that distorts", &bent, &plan);
    let crop = |t: f32| {
        let (description, camera) = scene(0.0, at + t * Vec3::Y, PixelFilter::Box, false);
        (description, Camera { width: 4, height: 3, crop: Some(Crop { corner: [1, 2], film: [6, 6] }), ..camera })
    };
    agree("camera y, of a part of the film", &crop, &plan);
}

/// The part of a film that a camera shows has the samples of the whole, whatever the camera.
#[test]
fn a_part_of_an_image_has_its_bits() {
    let mut b = Builder::default();
    b.matte(floor(Vec3::ZERO, 2.0), 0.6);
    b.matte(cuboid(vec3(0.1, 0.7, -0.1), vec3(0.4, 0.3, 0.5), 0.4), 0.4);
    b.lamp(ceiling(vec3(0.3, 3.0, -0.5), 0.4), Vec3::splat(20.0));
    let mut moving = b.description.clone();
    let vertices = cuboid(vec3(0.5, 0.7, 0.0), vec3(0.4, 0.3, 0.5), 0.7).vertices;
    moving.motions.push(Motion { shape: 1, vertices, normals: None });
    let still = Scene::new(b.description).unwrap();
    let moving = Scene::new(moving).unwrap();
    let camera = Camera { height: 13, ..look_at(vec3(0.5, 2.0, -4.0), vec3(0.0, 0.4, 0.0), 30.0, 20) };
    let lens = Lens { radius: 0.3, focus: 3.0, ..Lens::PINHOLE };
    let distortion = Distortion { coefficients: [-0.2, 0.05, 0.01, 0.02, 0.0] };
    let cameras = [
        (&still, Camera { filter: PixelFilter::Mitchell, ..camera }),
        (&still, Camera { lens, filter: PixelFilter::Tent, ..camera }),
        (&still, Camera { distortion, ..camera }),
        (&moving, Camera { shutter: [0.2, 0.9], filter: PixelFilter::Mitchell, ..camera }),
        (&still, Camera { projection: Projection::Panorama, scale: [3.0, 1.5], ..camera }),
    ];
    for (scene, whole) in cameras {
        for output in [Output::Radiance, Output::Depth] {
            let settings = Settings { output, ..settings(5, 2, 3) };
            let image = render(scene, &whole, &settings).unwrap();
            for [x0, y0, width, height] in [[0, 0, 20, 13], [7, 2, 9, 10], [19, 12, 1, 1]] {
                let crop = Some(Crop { corner: [x0, y0], film: [20, 13] });
                let part = render(scene, &Camera { width, height, crop, ..whole }, &settings).unwrap();
                for (x, y) in (0..height).flat_map(|y| (0..width).map(move |x| (x, y))) {
                    assert_eq!(
                        part.pixel(x, y),
                        image.pixel(x0 + x, y0 + y),
                        "{whole:?} at {x}, {y} of {width}×{height}"
                    );
                }
            }
            let beyond = Camera { width: 9, crop: Some(Crop { corner: [12, 0], film: [20, 13] }), ..whole };
            assert!(render(scene, &beyond, &settings).is_err_and(|e| e.to_string().contains("beyond the film")));
        }
    }
}

/// A stage's smaller film has a smaller part, of whole pixels: of columns 3 to 20 and rows 2 to 17 half.
#[test]
fn a_scaled_film_has_a_scaled_part() {
    let script = "param x = 0.3
        camera eye { position: [0, 0, 4], look_at: [0, 0, 0], film: [32, 24], crop: [3, 2, 20, 17] }
        shape ball { mesh: sphere() |> translate([x, 0, 0]) }
        light sky = constant(1)
        let seen = render(eye, spp: 1)
        loss size = seen.width + 100 * seen.height + 0 * mean(seen)
        optimize size { over: x, using: sgd(lr: 0), stage half { steps: 1, film_scale: 0.5 } stage whole { steps: 1 } }";
    let (losses, _) = optimized(script).unwrap();
    assert_eq!(losses, [808.0, 1517.0]);
}

/// What would see beyond the seam of a panorama is refused, and so is a filter that reaches into the fold of a lens.
#[test]
fn filters_that_see_nothing_are_refused() {
    let scene = Builder::default().scene();
    let camera = look_at(Vec3::Z, Vec3::ZERO, 45.0, 6);
    let refusal = |camera: Camera| render(&scene, &camera, &settings(1, 0, 0)).err().map(|e| e.to_string());
    let panorama = Camera { projection: Projection::Panorama, scale: [3.1, 1.5], ..camera };
    assert_eq!(refusal(panorama), None);
    assert!(refusal(Camera { filter: PixelFilter::Tent, ..panorama }).is_some_and(|e| e.contains("seam")));
    let bent = Camera { distortion: Distortion { coefficients: [-0.62, 0.0, 0.0, 0.0, 0.0] }, ..camera };
    let narrow = Camera { scale: [0.34, 0.34], ..bent };
    assert_eq!(refusal(narrow), None);
    assert!(refusal(Camera { filter: PixelFilter::Mitchell, ..narrow }).is_some_and(|e| e.contains("folds")));
}
