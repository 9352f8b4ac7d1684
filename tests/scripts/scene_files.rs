//! Scenes that a script saves for other programs, and what is told of what a file does not hold.

use dscene::image::Image;
use dscene::image::file::{encode_bytes, encode_png};
use dscene::mesh::load::{Coat, Loaded, LoadedLightKind, Sheen, Wanted, load, load_cameras};
use serde_json::json;

use crate::gltf::Builder;
use crate::place::{Place, assert_code, assert_diagnosed, stderr, stdout};

fn read(place: &Place, name: &str) -> Loaded {
    load(&place.path(name), Wanted::Scene).unwrap_or_else(|e| panic!("{e}"))
}

/// A room with all that glTF has.
const ROOM: &str = r#"
camera eye { position: [1, 3, 7], look_at: [0, 0.5, 0], fov: 40deg, film: [48, 32] }
camera plan { kind: orthographic, position: [0, 6, 0], look_at: [0, 0, 0], up: [0, 0, -1], height: 6, film: [32, 32] }

shape floor {
  mesh: rectangle(width: 8, depth: 8)
  material: normal_map(diffuse(checkerboard(tiles: 6)), normals: texture([[[0.4 + 0.05 * x, 0.55 - 0.04 * y, 0.95] for x in 0..4] for y in 0..3], wrap: mirror))
}
shape balls = [
  shape(
    mesh: sphere(radius: 0.5) |> translate([x, 0.5, 0]),
    material: principled(base_color: [0.8, 0.3, 0.1], metallic: 0.5 + x / 3, roughness: 0.4, specular: 0.7),
  )
  for x in [-1, 0.2, 1.4]
]
shape painted {
  mesh: mesh(vertices: [[-3, 0, -2], [-1, 0, -2], [-2, 2, -2]], faces: [[0, 1, 2]], colors: [[1, 0, 0], [0, 1, 0], [0, 0, 1]])
  material: principled(base_color: vertex_color(), metallic: 0, roughness: 0.5, specular: 0.5)
}
shape drop { mesh: icosphere(radius: 0.4) |> translate([0.3, 0.5, 2]), material: dielectric(ior: 1.4, absorption: [0.2, 1.5, 0.7]) }
shape ice { mesh: icosphere(radius: 0.3) |> translate([-1.3, 0.3, 2]), material: dielectric(ior: 1.31, roughness: texture([[0.4, 0.5], [0.6, 0.4]])) }
shape window { mesh: rectangle() |> rotate(x: 90deg) |> translate([2.5, 1, 0.5]), material: thin_dielectric(tint: [0.4, 0.9, 0.6]) }
shape screen {
  mesh: rectangle() |> rotate(x: 80deg) |> translate([-2.6, 0.6, 2])
  material: thin_dielectric(tint: [0.9, 0.7, 0.5], roughness: texture([[0.3, 0.5], [0.6, 0.4]]))
}
shape leaf {
  mesh: rectangle() |> rotate(x: 60deg) |> translate([-2, 1, 1])
  material: one_sided(mask(diffuse([0.2, 0.6, 0.1]), opacity: texture([[0, 1, 1], [1, 0.3, 1]])))
}
shape rail {
  mesh: cylinder(radius: 0.2) |> translate([1.8, 1, -2])
  material: conductor(reflectance: [0.9, 0.7, 0.3], roughness: texture([[0.2, 0.6], [0.4, 0.3]], filter: nearest))
}
shape cushion { mesh: sphere(radius: 0.3) |> translate([-0.5, 0.3, 1.5]), material: cloth(diffuse: [0.3, 0.02, 0.1], sheen: [0.9, 0.6, 0.5], roughness: 0.3) }
shape paper {
  mesh: rectangle(width: 0.5, depth: 0.7) |> rotate(x: 70deg) |> translate([1.6, 0.5, 1.8])
  material: blend(
    principled(base_color: [0.8, 0.6, 0.3], roughness: 0.4),
    thin_dielectric(tint: [0.8, 0.6, 0.3], roughness: 0.4),
    weight: texture([[0.2, 0.7], [0.5, 0.9]]),
  )
}
shape ribbon {
  mesh: sphere(radius: 0.3) |> translate([0.2, 0.3, -1.4])
  material: sheened(
    brushed(principled(base_color: [0.2, 0.3, 0.5], metallic: 0.7, roughness: 0.4), anisotropy: 0.5),
    sheen: texture([[[0.9, 0.6, 0.5], [0.2, 0.8, 0.4]]]),
    sheen_roughness: 0.5,
  )
}
shape lacquered {
  mesh: sphere(radius: 0.3) |> translate([0.9, 0.3, 1.4])
  material: coated(principled(base_color: [0.5, 0.02, 0.05], metallic: 0.8, roughness: 0.5), coat: texture([[1, 0.4], [0.6, 0.8]]), coat_roughness: 0.3)
}
light lamp = area(rectangle() |> flip() |> translate([0, 4, 0]), radiance: [6, 5, 3])
light strip = light(
  mesh: rectangle(width: 1, depth: 0.3) |> rotate(x: 90deg) |> translate([0, 2, -2.5]),
  radiance: texture([[[1, 3, 0.5], [4, 1, 2]]], wrap: clamp),
  two_sided: true,
  material: diffuse(0.3),
)
light spark = point(position: [-2, 3, 2], intensity: [3, 4, 5])
light cone = spot(position: [3, 4, 3], direction: [-1, -2, -1], intensity: 20, cutoff: 30deg, beam: 20deg)
light sun = directional(direction: [1, -3, -1], irradiance: [0.2, 0.15, 0.1])
"#;

/// What is saved looks the same when it is loaded, from its own cameras.
#[test]
fn a_scene_that_was_saved_looks_the_same() {
    let place = Place::new();
    let shown = |scene: &str| {
        format!(
            "[render(eye, {scene}spp: 64, seed: 3), render(plan, {scene}spp: 64, seed: 4), depth(eye, {scene}spp: 16, seed: 5), \
             albedo(eye, {scene}spp: 16, seed: 6), normal(plan, {scene}spp: 16, seed: 7)]"
        )
    };
    let saves: String = (0..5).map(|i| format!("save shown[{i}] to \"{i}.exr\"\n")).collect();
    let script = format!("{ROOM}\nlet shown = {}\n{saves}save [scene, [eye, plan]] to \"room.glb\"\n", shown(""));
    place.write("a.dscene", script);
    let output = place.dsl(&["run", "a.dscene", "--out", "run"]);
    assert_code(&output, 0);
    assert!(!stderr(&output).contains("simplified"), "{}", stderr(&output));

    // The first two are noisy, and materials of the file are sampled in another way; the others are the same but for rounding.
    let expected: String = [(0.004, 0.08), (0.005, 0.12), (1e-4, 1e-3), (1e-4, 2e-3), (1e-3, 1e-2)]
        .iter()
        .enumerate()
        .map(|(i, (of_all, of_pixels))| {
            format!(
                "let apart{i} = shown[{i}] - load_image(\"run/{i}.exr\")\nlet size{i} = mean(abs(load_image(\"run/{i}.exr\")))\n\
                 expect abs(mean(apart{i})) < {of_all} * size{i}, \"{i}: {{mean(apart{i})}} of {{size{i}}}\"\n\
                 expect sqrt(mean(apart{i} * apart{i})) < {of_pixels} * size{i}, \"{i}: {{sqrt(mean(apart{i} * apart{i}))}} of {{size{i}}}\"\n"
            )
        })
        .collect();
    place.write(
        "b.dscene",
        format!(
            "let room = load_scene(\"run/room.glb\")\n\
             camera eye = load_cameras(\"run/room.glb\", film: [48, 32])[0]\ncamera plan = load_cameras(\"run/room.glb\", film: [32, 32])[1]\n\
             let shown = {}\n{expected}",
            shown("scene: room, ")
        ),
    );
    let output = place.dsl(&["run", "b.dscene", "--out", "again"]);
    assert_code(&output, 0);
    assert!(!stderr(&output).contains("warning"), "{}", stderr(&output));
    let names: Vec<String> = read(&place, "run/room.glb").parts.into_iter().map(|part| part.name).collect();
    assert_eq!(
        names,
        [
            "floor",
            "balls 0",
            "balls 1",
            "balls 2",
            "painted",
            "drop",
            "ice",
            "window",
            "screen",
            "leaf",
            "rail",
            "cushion",
            "paper",
            "ribbon",
            "lacquered",
            "lamp",
            "strip"
        ]
    );
    let cameras = load_cameras(&place.path("run/room.glb")).unwrap().0;
    assert_eq!(cameras.iter().map(|c| &*c.name).collect::<Vec<_>>(), ["eye", "plan"]);
}

/// Materials that glTF does not have are told with their declarations; what can be kept of them is.
#[test]
fn what_a_scene_file_does_not_hold_is_told() {
    let place = Place::new();
    place.write(
        "a.dscene",
        r#"
camera eye { position: [0, 1, 5], fov: 40deg, film: [16, 16], aperture: 0.1, focus: 5 }
camera around { kind: panorama, film: [16, 8] }
shape pot { mesh: sphere(), material: phong(diffuse: [0.5, 0.2, 0.1], specular: 0.08, roughness: 0.0625) }
shape cup { mesh: cube() |> translate([3, 0, 0]), material: plastic(diffuse: 0.4, ior: 1.5, roughness: 0.3) }
shape glossy { mesh: cube() |> translate([6, 0, 0]), material: mirror(0.8) }
shape gold { mesh: cube() |> translate([9, 0, 0]), material: conductor(eta: 1, k: [1, 2, 3], roughness: 0.2) }
shape worn { mesh: cube() |> translate([12, 0, 0]), material: blend(diffuse(0.5), conductor(reflectance: 0.7), weight: 0.8) }
shape mover { mesh: moving(cube(), cube() |> translate([0, 1, 0])) }
light sky = constant(1)
light lamp = area(rectangle() |> translate([0, 5, 0]), radiance: 2, material: diffuse(0.5))
save [scene, eye, around] to "a.glb"
"#,
    );
    let output = place.dsl(&["run", "a.dscene", "--out", "run"]);
    assert_code(&output, 0);
    // Without the frame, and where its lines end.
    let told = stderr(&output).replace('│', "").split_whitespace().collect::<Vec<_>>().join(" ");
    let like = |kind: &str| format!("its `{kind}` becomes a metallic-roughness material");
    for (name, sentence) in [
        ("pot", &*like("phong")),
        ("cup", &like("plastic")),
        ("glossy", &like("mirror")),
        ("gold", &like("conductor")),
        ("worn", "glTF has no blends: of the two materials that of the larger share is written"),
        ("mover", "what moves stands"),
        ("sky", "glTF has no environments"),
        ("lamp", "a material of glTF emits on the sides"),
        ("eye", "a camera of glTF has no lens"),
        ("around", "glTF has perspective and orthographic cameras only"),
    ] {
        assert!(told.contains(&format!("`{name}`: {sentence}")), "{name}: {told}");
    }
    assert_eq!(told.matches("dscene::file::simplified").count(), 1, "{told}");
    let loaded = read(&place, "run/a.glb");
    let material = |name: &str| loaded.parts.iter().find(|p| p.name == name).unwrap().material.clone().unwrap();
    let near = |a: f32, b: f32| (a - b).abs() < 1e-4;
    let pot = material("pot");
    assert!(near(pot.roughness, 0.5) && near(pot.specular, 2.0) && near(pot.base_color.x, 0.5), "{pot:?}");
    let cup = material("cup");
    assert!(near(cup.specular, 1.0) && near(cup.roughness, 0.3), "{cup:?}");
    let glossy = material("glossy");
    assert!(near(glossy.metallic, 1.0) && near(glossy.roughness, 0.0) && near(glossy.base_color.y, 0.8), "{glossy:?}");
    // |(n − 1 + ik) / (n + 1 + ik)|² with n = 1 is k² / (4 + k²).
    let gold = material("gold");
    assert!((gold.base_color - glam::vec3(0.2, 0.5, 9.0 / 13.0)).abs().max_element() < 1e-5, "{gold:?}");
    let worn = material("worn");
    assert!(near(worn.metallic, 1.0) && near(worn.base_color.x, 0.7), "{worn:?}");
    assert_eq!(loaded.lights.len(), 0);
}

/// Parts, and lists of them, are saved by themselves; the scene is that which renderings show, with what libraries declare and the params' values.
#[test]
fn parts_of_a_scene_are_saved_too() {
    let place = Place::new();
    place.write("things.dscene", "shape stool { mesh: cube() }\nfn two(): scene = scene(shapes: [stool])\n");
    place.write(
        "a.dscene",
        r#"
import "things.dscene" as things
param size: scalar = 2
shape ball { mesh: sphere(radius: size) }
light lamp = point(position: [0, 5, 0])
camera eye { film: [8, 8] }
save ball to "ball.glb"
save [ball, ball] to "balls.glb"
save lamp to "lamp.glb"
save eye to "eye.glb"
save [sphere(), cube()] to "meshes.glb"
save [eye, eye] to "eyes.json"
save scene to "all.glb"
save scene with { size: 3 } to "large.glb"
save things.two() to "two.glb"
expect sum([1 for part in scene.shapes]) == 2
let extent = mean(scene.shapes[0].mesh.vertices ^ 2)
expect grad(extent, size) ≈ 2 * extent / size within 0.001%
expect max(abs(render(eye, scene: scene, seed: 1) - render(eye, seed: 1))) == 0
"#,
    );
    let output = place.dsl(&["run", "a.dscene", "--out", "run"]);
    assert_code(&output, 0);
    let parts = |name: &str| read(&place, &format!("run/{name}.glb")).parts;
    let radius = |name: &str| {
        let part = parts(name).into_iter().find(|p| p.name == "ball").unwrap();
        part.mesh.vertices.iter().map(|v| v.length()).fold(0.0, f32::max)
    };
    assert!((radius("all") - 2.0).abs() < 1e-5 && (radius("ball") - 2.0).abs() < 1e-5);
    assert_eq!((parts("balls").len(), parts("meshes").len(), parts("two").len(), parts("all").len()), (2, 2, 1, 2));
    let largest = parts("large").iter().flat_map(|p| p.mesh.vertices.clone()).map(|v| v.length()).fold(0.0, f32::max);
    assert!((largest - 3.0).abs() < 1e-5);
    let lamp = read(&place, "run/lamp.glb");
    assert_eq!((lamp.parts.len(), lamp.lights.len(), lamp.lights[0].kind), (0, 1, LoadedLightKind::Point));
    assert_eq!(load_cameras(&place.path("run/eye.glb")).unwrap().0.len(), 1);
}

#[test]
fn what_is_no_scene_is_refused() {
    for (text, code, help) in [
        ("camera eye { film: [4, 4] }\nsave eye to \"eye.png\"\n", "dscene::file::format", "`save render(eye) to"),
        ("shape a { mesh: cube() }\nsave a to \"a.obj\"\n", "dscene::file::format", "the endings are: `.glb`"),
        ("save diffuse() to \"a.glb\"\n", "dscene::type::mismatch", "images, meshes, scenes"),
        ("save [cube(), 3] to \"a.glb\"\n", "dscene::file::format", "the endings are: `.json`"),
        ("shape a { mesh: cube() }\nsave scene() to \"a.glb\"\n", "dscene::run::save", "without parentheses"),
        ("light sky = constant(1)\nsave scene to \"a.glb\"\n", "dscene::run::save", "there is nothing to save"),
        ("save scene to \"a.glb\"\n", "dscene::run::scene", "add for instance `shape ball"),
        (
            "shape a { mesh: cube() |> scale(sum([1 for part in scene.shapes])) }\nsave scene to \"a.glb\"\n",
            "dscene::name::cycle",
            "",
        ),
    ] {
        let place = Place::new();
        place.write("a.dscene", text);
        let output = place.dsl(&["run", "a.dscene", "--out", "run"]);
        assert_diagnosed(&output);
        let told = stderr(&output);
        assert!(told.contains(code) && told.contains(help), "{text}: {told}");
    }
}

/// The sheen of a file's materials is read: over what mirrors nothing it makes cloth, and lies over what else there is.
#[test]
fn cloth_of_gltf() {
    let place = Place::new();
    let mut file = Builder::new();
    let pbr = |metallic: f32| json!({"baseColorFactor": [0.2, 0.1, 0.3, 1], "metallicFactor": metallic, "roughnessFactor": 0.9});
    let cloth = |name: &str, metallic: f32, specular: f32, sheen: serde_json::Value| {
        json!({"name": name, "pbrMetallicRoughness": pbr(metallic), "extensions": {
            "KHR_materials_sheen": sheen, "KHR_materials_specular": {"specularFactor": specular}}})
    };
    let red = json!({"sheenColorFactor": [0.9, 0.2, 0.1], "sheenRoughnessFactor": 0.5});
    // The colours say how red the sheen is, alpha how rough.
    let image = Image { width: 2, height: 1, channels: 4, data: vec![1.0, 0.0, 0.0, 0.2, 0.5, 1.0, 1.0, 0.8] };
    place.write("woven.png", encode_png(&image).unwrap());
    file.add("images", json!({"uri": "woven.png"}));
    file.add("textures", json!({"source": 0}));
    let mut woven = json!({"sheenColorFactor": [0.9, 0.2, 0.1], "sheenRoughnessFactor": 1});
    (woven["sheenColorTexture"], woven["sheenRoughnessTexture"]) = (json!({"index": 0}), json!({"index": 0}));
    file.add("materials", cloth("felt", 0.0, 0.0, red.clone()));
    file.add("materials", cloth("satin", 0.0, 1.0, red.clone()));
    file.add("materials", cloth("woven", 0.0, 0.0, woven));
    file.add("materials", cloth("foil", 1.0, 1.0, red));
    file.add("materials", cloth("none", 0.0, 0.0, json!({"sheenColorFactor": [0, 0, 0]})));
    for material in 0..5 {
        let uvs = file.floats("VEC2", &[0.0, 0.0, 1.0, 0.0, 0.0, 1.0]);
        let mesh = file.triangle(json!({"TEXCOORD_0": uvs}), json!({"material": material}));
        file.add("nodes", json!({"mesh": mesh, "name": format!("part {material}")}));
    }
    file.json["scenes"] = json!([{"nodes": [0, 1, 2, 3, 4]}]);
    file.json["extensionsRequired"] = json!(["KHR_materials_sheen"]);
    place.write("a.gltf", file.text());
    let loaded = read(&place, "a.gltf");
    assert_eq!(loaded.warnings, [""; 0]);
    let sheen = |i: usize| loaded.parts[i].material.as_ref().unwrap().sheen.clone();
    let (color_image, roughness_image) = (None, None);
    let red = Sheen { color: glam::vec3(0.9, 0.2, 0.1), color_image, roughness: 0.5, roughness_image };
    assert_eq!([0, 1, 3, 4].map(sheen), [Some(red.clone()), Some(red.clone()), Some(red), None]);
    let woven = sheen(2).unwrap();
    let near = |image: &[f32], expected: &[f32]| image.iter().zip(expected).all(|(a, b)| (a - b).abs() < 0.003);
    assert!(near(&woven.color_texels().image.data, &[0.9, 0.0, 0.0, 0.45, 0.2, 0.1]), "{woven:?}");
    assert!(near(&woven.roughness_texels().image.data, &[0.2, 0.8]), "{woven:?}");
    // α is 0.25 in the file, and 0.07 + 0.93 roughness² here.
    place.write("a.dscene", "let felt = load_shapes(\"a.gltf\")[0].material\nprint felt.diffuse, felt.sheen\nexpect felt.roughness ≈ sqrt(0.18 / 0.93) within 0.01%\n\
        let foil = load_shapes(\"a.gltf\")[3].material\nprint foil, load_shapes(\"a.gltf\")[1].material.base_color\n\
        expect foil.metallic.texels[0, 0, 0] == 1\nexpect foil.sheen.r ≈ 0.9 within 0.01%\nexpect foil.sheen_roughness ≈ felt.roughness within 0.01%\n");
    let output = place.dsl(&["run", "a.dscene", "--out", "run"]);
    assert_code(&output, 0);
    // Texel by texel: α is 0.04 in one, which no roughness has here, and 0.64 in the other.
    place.write(
        "b.dscene",
        "let woven = load_shapes(\"a.gltf\")[2].material\nlet rough = woven.roughness.texels\n\
         expect max(rough) ≈ sqrt(0.57 / 0.93) within 0.5%\nexpect min(rough) == 0\nexpect max(woven.sheen.texels) ≈ 0.9 within 0.1%\n",
    );
    assert_code(&place.dsl(&["run", "b.dscene", "--out", "b"]), 0);
}

/// Thin surfaces let the share of the light through that a file says, of what is no metal; what has a volume is glass.
#[test]
fn transmission_of_gltf() {
    let place = Place::new();
    let mut file = Builder::new();
    // The numbers of the file count, not the light that they stand for in a picture: 255, and 137 for the red of 0.25.
    let image = Image { width: 2, height: 1, channels: 3, data: vec![1.0, 0.0, 0.0, 0.25, 1.0, 1.0] };
    place.write("share.png", encode_png(&image).unwrap());
    file.add("images", json!({"uri": "share.png"}));
    file.add("textures", json!({"source": 0}));
    let thin = |name: &str, metallic: f32, transmission: serde_json::Value, thickness: f32| {
        json!({"name": name, "doubleSided": true,
            "pbrMetallicRoughness": {"baseColorFactor": [0.2, 0.4, 0.3, 1], "metallicFactor": metallic, "roughnessFactor": 0.6},
            "extensions": {"KHR_materials_transmission": transmission, "KHR_materials_ior": {"ior": 1.4},
                "KHR_materials_volume": {"thicknessFactor": thickness}}})
    };
    let share = |share: f32| json!({"transmissionFactor": share});
    file.add("materials", thin("leaf", 0.0, share(0.3), 0.0));
    file.add("materials", thin("foil", 0.5, share(0.5), 0.0));
    file.add(
        "materials",
        thin("lace", 0.0, json!({"transmissionFactor": 0.8, "transmissionTexture": {"index": 0}}), 0.0),
    );
    file.add("materials", thin("none", 0.0, share(0.0), 0.0));
    file.add("materials", thin("pane", 0.0, share(1.0), 0.0));
    file.add("materials", thin("milk", 0.0, share(0.3), 1.0));
    let mut dented = thin("dented", 0.0, share(0.3), 0.0);
    (dented["normalTexture"], dented["extensions"]["KHR_materials_clearcoat"]) =
        (json!({"index": 0}), json!({"clearcoatFactor": 1}));
    file.add("materials", dented);
    for material in 0..7 {
        let uvs = file.floats("VEC2", &[0.0, 0.0, 1.0, 0.0, 0.0, 1.0]);
        let mesh = file.triangle(json!({"TEXCOORD_0": uvs}), json!({"material": material}));
        file.add("nodes", json!({"mesh": mesh, "name": format!("part {material}")}));
    }
    file.json["scenes"] = json!([{"nodes": [0, 1, 2, 3, 4, 5, 6]}]);
    place.write("a.gltf", file.text());
    let loaded = read(&place, "a.gltf");
    let told = [
        "extensions of materials are left out: KHR_materials_transmission of “milk”, KHR_materials_volume of “milk”",
        "normal maps of what lets a part of the light through are left out: “dented”",
        "coats and sheens lie over what light does not pass: “dented”",
    ];
    let mut warnings = loaded.warnings.clone();
    warnings.sort_unstable_by_key(|warning| told.iter().position(|told| told == warning));
    assert_eq!(warnings, told);
    let share = |i: usize| loaded.parts[i].material.as_ref().unwrap().transmission.as_ref().map(|t| (t.share, t.ior));
    let of_none = [3, 4, 5].map(share);
    assert_eq!([0, 1, 2].map(share), [Some((0.3, 1.4)), Some((0.5, 1.4)), Some((0.8, 1.4))]);
    assert_eq!(of_none, [None; 3]);
    // Half of the foil is metal, and a half of the rest lets light through: of the three quarters that do not, two thirds are metal.
    place.write(
        "a.dscene",
        "let parts = load_shapes(\"a.gltf\")\nlet leaf = parts[0].material\nlet foil = parts[1].material\nlet lace = parts[2].material\n\
         expect max(leaf.weight.texels) ≈ 0.3 within 0.01%\nexpect max(leaf.a.metallic.texels) == 0\n\
         expect leaf.b.ior ≈ 1.4 within 0.01%\nexpect leaf.b.tint.texels[0, 0, 1] ≈ 0.4 within 0.01%\n\
         expect max(leaf.b.roughness.texels) ≈ 0.6 within 0.01%\nexpect max(foil.weight.texels) ≈ 0.25 within 0.01%\n\
         expect max(foil.a.metallic.texels) ≈ 2 / 3 within 0.01%\nexpect max(lace.weight.texels) ≈ 0.8 within 0.01%\n\
         expect min(lace.weight.texels) ≈ 0.8 * 137 / 255 within 0.01%\nprint parts[4].material\n",
    );
    assert_code(&place.dsl(&["run", "a.dscene", "--out", "run"]), 0);
}

/// The clear coat of a file's material is read with its images; its own normals are told by name.
#[test]
fn coats_of_gltf() {
    let place = Place::new();
    let mut file = Builder::new();
    // Red says where the coat is, green how rough it is.
    place.write("worn.png", encode_bytes(2, 1, 3, &[255, 51, 230, 102, 255, 25]).unwrap());
    file.add("images", json!({"uri": "worn.png"}));
    file.add("textures", json!({"source": 0}));
    let coat = |name: &str, metallic: f32, coat: serde_json::Value| {
        json!({"name": name, "pbrMetallicRoughness": {"metallicFactor": metallic, "roughnessFactor": 0.4},
               "extensions": {"KHR_materials_clearcoat": coat}})
    };
    let image = json!({"index": 0});
    file.add("materials", coat("lacquer", 1.0, json!({"clearcoatFactor": 0.8, "clearcoatRoughnessFactor": 0.1})));
    file.add(
        "materials",
        coat(
            "worn",
            0.0,
            json!({"clearcoatFactor": 0.5, "clearcoatTexture": image.clone(),
        "clearcoatRoughnessFactor": 1, "clearcoatRoughnessTexture": image.clone()}),
        ),
    );
    file.add("materials", coat("orange", 0.0, json!({"clearcoatFactor": 1, "clearcoatNormalTexture": image})));
    file.add("materials", coat("none", 0.0, json!({"clearcoatRoughnessFactor": 0.3})));
    for material in 0..4 {
        let uvs = file.floats("VEC2", &[0.0, 0.0, 1.0, 0.0, 0.0, 1.0]);
        let mesh = file.triangle(json!({"TEXCOORD_0": uvs}), json!({"material": material}));
        file.add("nodes", json!({"mesh": mesh, "name": format!("part {material}")}));
    }
    file.json["scenes"] = json!([{"nodes": [0, 1, 2, 3]}]);
    file.json["extensionsRequired"] = json!(["KHR_materials_clearcoat"]);
    place.write("a.gltf", file.text());
    let loaded = read(&place, "a.gltf");
    let told =
        "a clear coat has the normals of what is under it: its own (clearcoatNormalTexture) are left out: “orange”";
    assert_eq!(loaded.warnings, [told]);
    let coat = |i: usize| loaded.parts[i].material.as_ref().unwrap().coat.clone();
    let plain = |weight, roughness| Some(Coat { weight, weight_image: None, roughness, roughness_image: None });
    assert_eq!([0, 2, 3].map(coat), [plain(0.8, 0.1), plain(1.0, 0.0), None]);
    let worn = coat(1).unwrap();
    let near = |image: &[f32], expected: [f32; 2]| image.iter().zip(expected).all(|(a, b)| (a - b).abs() < 0.003);
    assert!(near(&worn.weight_texels().image.data, [0.5, 0.2]), "{worn:?}");
    assert!(near(&worn.roughness_texels().image.data, [0.2, 1.0]), "{worn:?}");
    place.write(
        "a.dscene",
        "let parts = load_shapes(\"a.gltf\")\nlet lacquer = parts[0].material\nexpect lacquer.coat ≈ 0.8 within 0.01%\n\
         expect lacquer.coat_roughness ≈ 0.1 within 0.01%\nprint lacquer, parts[1].material.coat\n",
    );
    let output = place.dsl(&["run", "a.dscene", "--out", "run"]);
    assert_code(&output, 0);
}

/// The anisotropy of a file's material is read with the image of its strength; directions that differ from texel to texel are told by name.
#[test]
fn anisotropy_of_gltf() {
    let place = Place::new();
    let mut file = Builder::new();
    // Red and green are the direction, blue the strength.
    place.write("even.png", encode_bytes(2, 1, 3, &[128, 255, 255, 128, 255, 51]).unwrap());
    place.write("round.png", encode_bytes(2, 1, 3, &[128, 255, 255, 255, 128, 255]).unwrap());
    for (i, name) in ["even.png", "round.png"].into_iter().enumerate() {
        file.add("images", json!({"uri": name}));
        file.add("textures", json!({"source": i}));
    }
    let all = [
        ("plain", json!({"anisotropyStrength": 0.6, "anisotropyRotation": 0.5})),
        ("even", json!({"anisotropyStrength": 0.5, "anisotropyTexture": {"index": 0}})),
        ("round", json!({"anisotropyStrength": 1, "anisotropyTexture": {"index": 1}})),
        ("none", json!({"anisotropyRotation": 0.5})),
    ];
    for (i, (name, anisotropy)) in all.into_iter().enumerate() {
        file.add("materials", json!({"name": name, "extensions": {"KHR_materials_anisotropy": anisotropy}}));
        let uvs = file.floats("VEC2", &[0.0, 0.0, 1.0, 0.0, 0.0, 1.0]);
        let mesh = file.triangle(json!({"TEXCOORD_0": uvs}), json!({"material": i}));
        file.add("nodes", json!({"mesh": mesh, "name": format!("part {i}")}));
    }
    // Without texture coordinates there is no direction.
    let mesh = file.triangle(json!({}), json!({"material": 0}));
    file.add("nodes", json!({"mesh": mesh}));
    file.json["scenes"] = json!([{"nodes": [0, 1, 2, 3, 4]}]);
    file.json["extensionsRequired"] = json!(["KHR_materials_anisotropy"]);
    place.write("a.gltf", file.text());
    let loaded = read(&place, "a.gltf");
    let told = "a surface is anisotropic in one direction: those of an anisotropyTexture are left out: “round”";
    let nowhere = "without texture coordinates an image is shown on every face anew, and a normal map or an anisotropy is left out: “a”";
    assert_eq!(loaded.warnings, [told, nowhere]);
    place.write(
        "a.dscene",
        "let parts = load_shapes(\"a.gltf\")\nlet plain = parts[0].material\nlet even = parts[1].material\n\
         expect plain.anisotropy ≈ 0.6 within 0.01%\nexpect plain.turn ≈ 0.5rad within 0.01%\n\
         expect even.turn ≈ 90deg within 1%\nprint parts[0].material, even.anisotropy, parts[3].material, parts[4].material\n\
         camera eye { position: [0.2, 0.2, 2], look_at: [0.2, 0.2, 0], film: [8, 8] }\n\
         light sky = constant(1)\nshape a = parts[0]\nshape b = parts[4]\nexpect mean(render(eye, spp: 4)) > 0\n",
    );
    let output = place.dsl(&["run", "a.dscene", "--out", "run"]);
    assert_code(&output, 0);
    let text = stdout(&output);
    assert_eq!(text.matches("brushed(").count(), 1, "{text}");
    assert!(text.contains("brushed(principled(") && text.contains("turn: 28.6"), "{text}");
}
