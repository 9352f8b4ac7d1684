use std::path::Path;

use glam::vec3;

use super::*;
use crate::mesh::load::{Wanted, decode_mesh};
use crate::mesh::{gltf, shapes};

fn image(width: usize, height: usize, channels: usize, of: impl Fn(usize, usize) -> f32) -> LoadedImage {
    let data = (0..width * height).flat_map(|i| (0..channels).map(move |c| (i, c))).map(|(i, c)| of(i, c)).collect();
    let image = Image { width, height, channels, data };
    LoadedImage { image: Arc::new(image), wrap: Wrap::Repeat, nearest: false }
}

fn written(materials: Vec<LoadedMaterial>) -> (Loaded, Vec<String>) {
    let mesh = shapes::cube(1.0).unwrap();
    let part = |material: LoadedMaterial| LoadedPart {
        name: format!("{} box", material.name),
        mesh: mesh.clone(),
        material: Some(Arc::new(material)),
    };
    let scene = Loaded { parts: materials.into_iter().map(part).collect(), ..Loaded::default() };
    let (bytes, told) = encode(&scene, &[]).unwrap();
    let read = decode_mesh(&bytes, "glb", Path::new(""), "x", Wanted::Scene).unwrap();
    assert_eq!(read.warnings, Vec::<String>::new());
    assert_eq!(read.parts.len(), scene.parts.len());
    for (read, part) in read.parts.iter().zip(&scene.parts) {
        assert_eq!(read.name, part.name);
        compare(read.material.as_ref().unwrap(), part.material.as_ref().unwrap());
    }
    (read, told)
}

/// What both look like, to the rounding of 16 bits.
fn compare(read: &LoadedMaterial, written: &LoadedMaterial) {
    let name = &written.name;
    let same = |a: &LoadedImage, b: &LoadedImage, what: &str| {
        let (x, y) = (&a.image, &b.image);
        let is_one = |image: &Image| image.width * image.height == 1;
        assert!(is_one(y) || (a.wrap, a.nearest) == (b.wrap, b.nearest), "{name}: {what} is looked up in another way");
        // What the larger image of a pair decides is looked at where both have texels.
        for v in 0..x.height {
            for u in 0..x.width {
                let at = (v * y.height / x.height, u * y.width / x.width);
                for c in 0..x.channels {
                    let (p, q) = (x.pixel(u, v)[c], y.pixel(at.1, at.0)[c]);
                    assert!((p - q).abs() < 1e-4 * (1.0 + q), "{name}: {what} at {u}, {v}: {p} instead of {q}");
                }
            }
        }
    };
    same(&read.base_color_texels(), &written.base_color_texels(), "colour");
    same(&read.metallic_texels(), &written.metallic_texels(), "metallicity");
    same(&read.roughness_texels(), &written.roughness_texels(), "roughness");
    let optional = |a: &Option<LoadedImage>, b: &Option<LoadedImage>, what: &str| match (a, b) {
        (Some(a), Some(b)) => same(a, b, what),
        (a, b) => assert_eq!(a, b, "{name}: {what}"),
    };
    optional(&read.emissive_texels(), &written.emissive_texels(), "emission");
    optional(&read.opacity, &written.opacity, "opacity");
    optional(&read.normals, &written.normals, "normals");
    let of_sheen = |m: &LoadedMaterial, texels: fn(&Sheen) -> LoadedImage| m.sheen.as_ref().map(texels);
    optional(&of_sheen(read, Sheen::color_texels), &of_sheen(written, Sheen::color_texels), "sheen");
    let roughness = [read, written].map(|m| of_sheen(m, Sheen::roughness_texels));
    optional(&roughness[0], &roughness[1], "roughness of the sheen");
    let [a, b] = [read, written].map(|m| m.grain.as_ref());
    let strength = |grain: Option<&LoadedGrain>| grain.map(LoadedGrain::strength_texels);
    optional(&strength(a), &strength(b), "anisotropy");
    let [a, b] = [a, b].map(|grain| grain.map_or(0.0, |grain| grain.rotation));
    assert!((a - b).abs() < 5e-3, "{name}: turned by {a} and not {b}");
    let of_coat = |m: &LoadedMaterial, texels: fn(&Coat) -> LoadedImage| m.coat.as_ref().map(texels);
    optional(&of_coat(read, Coat::weight_texels), &of_coat(written, Coat::weight_texels), "coat");
    let roughness = [read, written].map(|m| of_coat(m, Coat::roughness_texels));
    optional(&roughness[0], &roughness[1], "roughness of the coat");
    assert!(
        (read.specular - written.specular).abs() < 1e-4 * written.specular.max(1.0) || read.clear.is_some(),
        "{name}"
    );
    let [a, b] = [read, written].map(|m| m.transmission.as_ref());
    let of_share = |transmission: Option<&Transmission>| transmission.map(Transmission::share_texels);
    optional(&of_share(a), &of_share(b), "transmission");
    let ior = |transmission: Option<&Transmission>| transmission.map_or(0.0, |transmission| transmission.ior);
    assert!((ior(a) - ior(b)).abs() < 1e-5, "{name}: {a:?} {b:?}");
    let absorbed = |m: &LoadedMaterial| match m.clear {
        Some(Clear::Body { absorption, .. }) => absorption,
        _ => Vec3::ZERO,
    };
    let (found, expected) = (absorbed(read), absorbed(written));
    assert!((found - expected).length() < 1e-4 * (1.0 + expected.length()), "{name}: {found} {expected}");
    let index = |m: &LoadedMaterial| {
        m.clear.map(|clear| match clear {
            Clear::Body { ior, .. } => (true, ior),
            Clear::Pane(ior) => (false, ior),
        })
    };
    assert_eq!((index(read), read.double_sided, &read.name), (index(written), written.double_sided, name));
}

fn named(name: &str) -> LoadedMaterial {
    LoadedMaterial { name: name.to_owned(), ..LoadedMaterial::default() }
}

fn body(ior: f32, absorption: Vec3) -> Clear {
    Clear::Body { ior, absorption }
}

fn coat(weight: f32, image: Option<LoadedImage>, roughness: f32, rough: Option<LoadedImage>) -> Coat {
    Coat { weight, weight_image: image, roughness, roughness_image: rough }
}

fn grain(strength_image: Option<LoadedImage>) -> LoadedGrain {
    LoadedGrain { strength: 0.8, strength_image, rotation: 0.7 }
}

#[test]
fn materials_are_read_as_they_were_written() {
    let colors = image(3, 2, 3, |i, c| 0.1 + 0.13 * i as f32 + 0.05 * c as f32);
    let grey = |n| image(n, n, 1, |i, _| (0.15 + 0.17 * i as f32).fract());
    let fine = image(3, 3, 1, |i, _| 0.9 - 0.1 * i as f32);
    let nearest = LoadedImage { wrap: Wrap::Clamp, nearest: true, ..grey(2) };
    let mirrored = |image: LoadedImage| LoadedImage { wrap: Wrap::Mirror, ..image };
    let cut = image(2, 2, 1, |i, _| (i % 2) as f32);
    let materials = vec![
        LoadedMaterial { base_color: vec3(0.2, 0.5, 1.0), metallic: 0.3, roughness: 0.7, specular: 0.6, ..named("a") },
        LoadedMaterial { base_color_image: Some(colors.clone()), specular: 3.0, double_sided: false, ..named("b") },
        LoadedMaterial { roughness_image: Some(nearest), metallic: 0.5, ..named("c") },
        LoadedMaterial { metallic_image: Some(mirrored(grey(3))), metallic: 1.0, roughness: 0.4, ..named("d") },
        LoadedMaterial {
            metallic_image: Some(grey(3)),
            roughness_image: Some(grey(3)),
            metallic: 1.0,
            normals: Some(image(2, 1, 3, |i, c| [0.5, 0.4 + 0.1 * i as f32, 0.95][c])),
            ..named("e")
        },
        LoadedMaterial { metallic_image: Some(LoadedImage::constant(&[0.3])), metallic: 1.0, ..named("one texel") },
        LoadedMaterial { emissive: vec3(0.5, 12.0, 3.0), ..named("f") },
        LoadedMaterial { emissive: vec3(4.0, 2.0, 0.5), emissive_image: Some(colors.clone()), ..named("g") },
        LoadedMaterial { opacity: Some(cut.clone()), base_color: vec3(0.9, 0.1, 0.4), ..named("h") },
        LoadedMaterial {
            opacity: Some(grey(3)),
            base_color_image: Some(image(3, 3, 3, |i, _| 0.1 * i as f32)),
            ..named("i")
        },
        LoadedMaterial { opacity: Some(LoadedImage::constant(&[0.25])), ..named("j") },
        LoadedMaterial { coat: Some(coat(0.8, None, 0.1, None)), metallic: 1.0, ..named("lacquer") },
        LoadedMaterial { coat: Some(coat(0.8, Some(grey(3)), 0.1, None)), ..named("worn") },
        LoadedMaterial { coat: Some(coat(1.0, Some(grey(3)), 0.5, Some(fine))), ..named("worn and rough") },
        LoadedMaterial { grain: Some(grain(None)), metallic: 1.0, ..named("brushed") },
        LoadedMaterial {
            transmission: Some(Transmission { share: 0.4, share_image: None, ior: 1.5 }),
            roughness: 0.3,
            ..named("leaf")
        },
        LoadedMaterial {
            transmission: Some(Transmission { share: 0.9, share_image: Some(grey(3)), ior: 1.33 }),
            base_color_image: Some(colors.clone()),
            specular: 0.5015,
            metallic: 0.2,
            ..named("lace")
        },
        LoadedMaterial {
            sheen: Some(Sheen {
                color: vec3(0.9, 0.5, 0.2),
                color_image: None,
                roughness: 0.4,
                roughness_image: Some(grey(3)),
            }),
            grain: Some(grain(None)),
            coat: Some(coat(0.8, None, 0.1, None)),
            metallic: 0.6,
            ..named("metal under fibres")
        },
        LoadedMaterial { grain: Some(grain(Some(grey(3)))), roughness: 0.2, ..named("brushed here and there") },
        LoadedMaterial { emissive: vec3(0.0, 0.0, 2.0), base_color: Vec3::ZERO, ..named("blue lamp") },
        LoadedMaterial { emissive: vec3(1.0, 0.5, 0.0), emissive_image: Some(colors.clone()), ..named("amber sign") },
        LoadedMaterial { clear: Some(body(1.33, Vec3::ZERO)), roughness: 0.0, double_sided: false, ..named("k") },
        LoadedMaterial {
            clear: Some(body(1.5, vec3(0.0, 0.4, 6.0))),
            roughness: 0.0,
            double_sided: false,
            ..named("green glass")
        },
        LoadedMaterial { clear: Some(Clear::Pane(1.5)), base_color: vec3(0.3, 0.9, 0.5), roughness: 0.0, ..named("l") },
        LoadedMaterial {
            clear: Some(Clear::Pane(1.4)),
            base_color_image: Some(colors.clone()),
            roughness: 0.6,
            roughness_image: Some(grey(2)),
            ..named("frosted")
        },
    ];
    let cloth = |name: &str, color_image: Option<LoadedImage>, roughness_image: Option<LoadedImage>| {
        let sheen = Some(Sheen { color: vec3(0.9, 0.5, 0.25), color_image, roughness: 0.6, roughness_image });
        LoadedMaterial { sheen, specular: 0.0, base_color: vec3(0.3, 0.02, 0.05), ..named(name) }
    };
    let cloths = [
        cloth("felt", None, None),
        cloth("woven", Some(colors.clone()), None),
        cloth("worn in places", None, Some(grey(3))),
        cloth("both", Some(image(3, 3, 3, |i, _| 0.1 * i as f32)), Some(grey(3))),
    ];
    let (_, told) = written(materials.into_iter().chain(cloths).collect());
    assert_eq!(told, Vec::<String>::new());
}

#[test]
fn what_does_not_fit_is_told_by_name() {
    let small = image(2, 2, 1, |i, _| 0.25 * i as f32);
    let large = image(4, 4, 1, |i, _| 0.5 + 0.25 * (i % 2) as f32);
    let nearest = |image: LoadedImage| LoadedImage { nearest: true, ..image };
    let pair = LoadedMaterial {
        metallic_image: Some(nearest(small.clone())),
        roughness_image: Some(nearest(large.clone())),
        metallic: 1.0,
        ..named("pair")
    };
    let (_, told) = written(vec![pair]);
    assert_eq!(told, ["images of a pair get one size, the larger one: the smaller is interpolated: “pair”"]);

    let bright = LoadedMaterial { base_color: vec3(2.0, 0.5, 0.5), ..named("bright") };
    let mixed =
        LoadedMaterial { metallic_image: Some(nearest(large.clone())), roughness_image: Some(large), ..named("mixed") };
    let part = |material| LoadedPart {
        material: Some(Arc::new(material)),
        mesh: shapes::cube(1.0).unwrap(),
        ..LoadedPart::default()
    };
    let wide = LoadedLight {
        name: String::new(),
        kind: LoadedLightKind::Spot { beam: 1.0, cutoff: 2.0 },
        position: DVec3::ZERO,
        direction: DVec3::X,
        intensity: Vec3::ONE,
    };
    let scene = Loaded { parts: vec![part(bright), part(mixed)], lights: vec![wide], ..Loaded::default() };
    let (_, told) = encode(&scene, &[]).unwrap();
    assert_eq!(told.len(), 3, "{told:?}");
    assert!(told[0].ends_with("beyond 1: “bright”") && told[1].ends_with(": “mixed”"), "{told:?}");
    assert!(told[2].ends_with("90° from their axis: a spot light"), "{told:?}");
}

#[test]
fn lights_and_cameras_stand_where_they_stood() {
    let tilted = DVec3::new(0.3, -0.8, 0.5).normalize();
    let light = |name: &str, kind, intensity| LoadedLight {
        name: name.to_owned(),
        kind,
        position: DVec3::new(1.0, 2.0, -3.5),
        direction: tilted,
        intensity,
    };
    let lights = vec![
        light("lamp", LoadedLightKind::Point, vec3(20.0, 10.0, 5.0)),
        light("sun", LoadedLightKind::Directional, vec3(0.0, 0.5, 0.25)),
        light("cone", LoadedLightKind::Spot { beam: 0.3, cutoff: 0.5 }, Vec3::splat(3.0)),
        light("dark", LoadedLightKind::Point, Vec3::ZERO),
    ];
    let up = (DVec3::Y - tilted * tilted.y).normalize();
    let camera = |name: &str, projection| LoadedCamera {
        name: name.to_owned(),
        position: DVec3::new(-1.0, 4.0, 2.0),
        forward: tilted,
        up,
        projection,
        aspect: Some(1.5),
    };
    let cameras = [
        camera("eye", LoadedProjection::Perspective { fov: 0.7 }),
        camera("plan", LoadedProjection::Orthographic { height: 3.0 }),
    ];
    let (bytes, told) = encode(&Loaded { lights: lights.clone(), ..Loaded::default() }, &cameras).unwrap();
    assert_eq!(told, Vec::<String>::new());
    let read = decode_mesh(&bytes, "glb", Path::new(""), "x", Wanted::Scene).unwrap();
    assert_eq!(read.warnings, ["the file holds no triangle"]);
    assert_eq!(read.lights.len(), 4);
    for (read, light) in read.lights.iter().zip(&lights) {
        assert_eq!(read.name, light.name);
        assert!((read.intensity - light.intensity).abs().max_element() < 1e-5, "{read:?}");
        if light.kind != LoadedLightKind::Directional {
            assert!((read.position - light.position).length() < 1e-6, "{read:?}");
        }
        if light.kind != LoadedLightKind::Point {
            assert!((read.direction - light.direction).length() < 1e-6, "{read:?}");
        }
        match (read.kind, light.kind) {
            (LoadedLightKind::Spot { beam, cutoff }, LoadedLightKind::Spot { beam: b, cutoff: c }) => {
                assert!((beam - b).abs() < 1e-6 && (cutoff - c).abs() < 1e-6, "{read:?}");
            }
            (found, kind) => assert_eq!(found, kind),
        }
    }
    let (read, told) = gltf::cameras(&bytes).unwrap();
    assert_eq!((read.len(), told), (2, Vec::new()));
    for (read, camera) in read.iter().zip(&cameras) {
        assert_eq!(read.name, camera.name);
        let apart = [read.position - camera.position, read.forward - camera.forward, read.up - camera.up];
        assert!(apart.iter().all(|d| d.length() < 1e-6), "{read:?}");
        assert!((read.aspect.unwrap() - 1.5).abs() < 1e-6);
        match (read.projection, camera.projection) {
            (LoadedProjection::Perspective { fov }, LoadedProjection::Perspective { fov: f }) => {
                assert!((fov - f).abs() < 1e-6)
            }
            (LoadedProjection::Orthographic { height }, LoadedProjection::Orthographic { height: h }) => {
                assert!((height - h).abs() < 1e-6)
            }
            (found, projection) => panic!("{found:?} instead of {projection:?}"),
        }
    }
}

/// Several materials with one image, and several parts with one material, have it once.
#[test]
fn what_is_shared_is_written_once() {
    let colors = image(16, 16, 3, |i, c| (0.37 * (i * 3 + c) as f32).fract());
    let [a, b] =
        ["a", "b"].map(|name| Arc::new(LoadedMaterial { base_color_image: Some(colors.clone()), ..named(name) }));
    let part = |material: &Arc<LoadedMaterial>| LoadedPart {
        material: Some(material.clone()),
        mesh: shapes::cube(1.0).unwrap(),
        ..LoadedPart::default()
    };
    let scene = Loaded { parts: vec![part(&a), part(&b), part(&a)], ..Loaded::default() };
    let (bytes, _) = encode(&scene, &[]).unwrap();
    let length = u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize;
    let root: Value = serde_json::from_slice(&bytes[20..20 + length]).unwrap();
    let count = |list: &str| root[list].as_array().unwrap().len();
    let counts = ["meshes", "materials", "textures", "images", "samplers"].map(count);
    assert_eq!(counts, [3, 2, 1, 1, 1]);
    assert_eq!(bytes.len() % 4, 0);
}
